"""What the pages share: problems in place, fields with their range, campaign, provenance."""

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import pandas as pd
import plotly.graph_objects as go
import streamlit as st

from dldsim.app.web.api import answers, field_limits, specs
from dldsim.app.web.ui import client
from dldsim.app.web.ui.client import ApiError

STEP = {
    "deformation_index": 0.001,
    "deformation_index_std": 0.001,
    "error": 0.001,
    "level": 0.05,
    **dict.fromkeys(
        ("radius_um", "cell_radius_um", "pillar_radius_um", "gap_um", "tolerance_um"), 0.1
    ),
}
FORMAT = {0.001: "%.4f", 0.1: "%.2f", 0.05: "%.2f"}
KEPT_S = 30


def plain(text: str) -> str:
    """Text of others as it is: nothing in it is taken for markup, but for code."""
    marks = r"([\\*_{}\[\]()#+\-.!|~<>$:&])"
    pieces = re.split(r"(`[^`]*`)", text)
    return "".join(
        piece if k % 2 else re.sub(marks, r"\\\1", piece) for k, piece in enumerate(pieces)
    )


def campaign() -> str | None:
    """Id of the campaign in use; None: the service's own."""
    return st.session_state.get("campaign")


@st.cache_data(ttl=KEPT_S, max_entries=16, show_spinner=False)
def model(identifier: str | None, base: str) -> answers.ModelInfo:
    return client.model(identifier)


@st.cache_data(ttl=KEPT_S, max_entries=8, show_spinner="Reading the campaign …")
def table(kind: str, identifier: str | None, base: str) -> answers.Table:
    return client.table(kind, identifier)


# --------------------------------------------------------------------------------------- problems


def keep(place: str, error: ApiError) -> None:
    """Remember a refusal, to be shown at its fields until the next request of this form."""
    st.session_state[f"problem:{place}"] = error


def clear(place: str) -> None:
    st.session_state.pop(f"problem:{place}", None)


def show_problem(place: str) -> None:
    """The refusal of a form as a whole."""
    error = st.session_state.get(f"problem:{place}")
    if error is not None:
        show(error)


def show(error: ApiError) -> None:
    """A refusal: what is wrong, field by field, and what to do."""
    problem = error.problem
    title = {
        "invalid": "The request was refused",
        "infeasible": "This request cannot be met",
        "busy": "The service is busy",
        "unreachable": "The service does not answer",
        "unhealthy": "The service cannot answer now",
        "too-large": "This is too large",
        "not-found": "Not found",
        "not-ready": "Not ready yet",
        "not-available": "Not available",
    }.get(problem.error, "This did not work")
    # a sentence of its own for each field; the message repeats them in one line
    sentences = list(dict.fromkeys(f.message for f in problem.fields)) or [problem.message]
    text = f"**{title}.** " + (
        plain(sentences[0])
        if len(sentences) == 1
        else "\n" + "\n".join(f"- {plain(s)}" for s in sentences)
    )
    if problem.retry_after_s is not None and "Try again" not in problem.message:
        text += f" Try again in {problem.retry_after_s} s."
    st.error(text, icon=":material/error:")


def at_field(place: str, *names: str) -> None:
    """What the API said of these fields, below them; what it said of several is said once."""
    error = st.session_state.get(f"problem:{place}")
    fields = error.problem.fields if error else []
    messages = [f.message for f in fields]
    for field in fields:
        if field.field.split(".")[0] in names:
            text = (
                plain(field.message)
                if messages.count(field.message) == 1
                else ("named in the refusal below")
            )
            st.markdown(f":red[:material/error: {text}]")


# ----------------------------------------------------------------------------------------- fields


def allowed(field: field_limits.FieldLimit, most: float | None = None) -> str:
    """Allowed range in words."""
    low, high = field.minimum, field.maximum if most is None else most
    unit = f" {field.unit}" if field.unit else ""
    if low is None and high is None:
        return "any"
    if high is None:
        return f"{'above' if field.exclusive_minimum else 'from'} {low:g}{unit}"
    return f"{'above ' if field.exclusive_minimum else ''}{low:g} to {high:g}{unit}"


def number(
    field: field_limits.FieldLimit,
    label: str,
    key: str,
    default: float | None,
    *,
    high: float | None = None,
    whole: bool = False,
    slider: bool = False,
    empty: str | None = None,
    about: str = "",
    disabled: bool = False,
) -> float | None:
    """A number field with unit and allowed range; `empty`: what leaving it out means.

    Its value is kept in the session as `key`, which begins with "form:".
    """
    step = STEP.get(re.sub(r"_[12]\b|_[12](?=_)", "", field.name), 1 if whole else 0.5)
    kind = int if whole else float
    low = field.minimum
    if field.exclusive_minimum and low is not None:
        low += step / 10 if not whole else 1
    most = field.maximum if high is None else min(high, field.maximum or high)
    low, most = (None if v is None else kind(v) for v in (low, most))
    if empty is None:
        value = st.session_state.setdefault(key, default)
        if low is not None:  # another campaign may allow less than the one before
            value = max(value, low)
        st.session_state[key] = kind(value if most is None else min(value, most))
    unit = f" [{field.unit}]" if field.unit else ""
    words = [(about or field.description) + ".", f"Allowed: {allowed(field, most)}."]
    common = {
        "key": key,
        "disabled": disabled,
        "help": plain(" ".join(words + ([f"Empty: {empty}."] if empty else []))),
    }
    if slider:
        return st.slider(f"{label}{unit}", low, most, step=kind(step), **common)
    if empty is not None:
        common |= {"value": None, "placeholder": empty}
    return st.number_input(
        f"{label}{unit}",
        low,
        most,
        step=kind(step),
        format=None if whole else FORMAT.get(step, "%g"),
        **common,
    )


def survive() -> None:
    """Keep the fields of all forms while another page is shown."""
    for key in st.session_state:
        if key.startswith("form:"):
            st.session_state[key] = st.session_state[key]


# ------------------------------------------------------------------------------------ common parts


def chart(figure: go.Figure, key: str, alt: str) -> None:
    st.plotly_chart(
        figure,
        theme=None,
        key=key,
        alt=alt,
        config={
            "displaylogo": False,
            "modeBarButtonsToRemove": [
                "lasso2d",
                "select2d",
                "zoomIn2d",
                "zoomOut2d",
                "autoScale2d",
            ],
        },
    )


def metrics(values: Iterable[tuple[str, str]]) -> None:
    """Headline figures, each as wide as it is; they wrap and are never cut."""
    with st.container(horizontal=True, gap="small"):
        for label, value in values:
            st.metric(label, value, width="content")


def frame(
    rows: Sequence[Mapping[str, Any]], columns: Mapping[str, tuple[str, str]], key: str
) -> None:
    """A table; `columns`: name → (title with unit, number format or empty)."""
    shown = pd.DataFrame([{n: r[n] for n in columns} for r in rows], columns=list(columns))
    st.dataframe(
        shown,
        hide_index=True,
        key=key,
        width="stretch",
        column_config={
            name: st.column_config.NumberColumn(title, format=form)
            if form
            else st.column_config.Column(title)
            for name, (title, form) in columns.items()
        },
    )


def read_model() -> answers.ModelInfo:
    """The surrogate in use; ends the page with the reason if there is none."""
    try:
        return model(campaign(), client.address())
    except ApiError as error:
        show(error)
        if campaign() is not None:
            st.button("Use the service's own campaign", on_click=use_campaign, args=(None,))
        st.button("Try again", key="again")
        st.stop()


def use_campaign(identifier: str | None) -> None:
    """Answers come from this campaign from now on."""
    st.session_state["campaign"] = identifier
    if identifier is None:
        st.query_params.pop("campaign", None)
    else:
        st.session_state.setdefault("campaigns", {}).setdefault(identifier, "campaign")
        st.query_params["campaign"] = identifier


def settle_address() -> None:
    """Take ids from the page's address into the session, and put those of the session there."""
    for name in ("campaign", "design", "check"):
        given = st.query_params.get(name)
        if given and re.fullmatch(specs.UUID, given):
            if name == "campaign" and given != campaign():
                use_campaign(given)
            st.session_state[name] = given
        elif given:
            st.query_params.pop(name)
            st.error(f"The address of this page names a {name} that is no id of one; ignored.")
        elif st.session_state.get(name):
            st.query_params[name] = st.session_state[name]


def sidebar() -> None:
    """State of the service, and which campaign answers come from."""
    with st.sidebar:
        _health()
        known = {None: "the service's own", **st.session_state.get("campaigns", {})}
        if campaign() not in known:
            known[campaign()] = "campaign"
        chosen = st.selectbox(
            "Answers come from",
            list(known),
            index=list(known).index(campaign()),
            format_func=lambda i: known[i] if i is None else f"{known[i]} ({i[:8]})",
            help="Campaigns that you upload, or measurements that you add, on the fourth page "
            "appear here. The address of this page keeps the one in use.",
        )
        if chosen != campaign():
            use_campaign(chosen)
            st.rerun()


@st.fragment(run_every=20)
def _health() -> None:
    try:
        found = client.health()
    except ApiError as error:
        st.error(plain(error.problem.message), icon=":material/cloud_off:")
        return
    if found.status == "healthy":
        st.markdown(
            f":green[:material/check_circle:] Service healthy · {found.running} running, "
            f"{found.queued} waiting"
        )
    else:
        st.error(
            "Service unhealthy\n\n" + "\n".join(f"- {plain(p)}" for p in found.problems),
            icon=":material/warning:",
        )


def provenance(found: answers.Provenance) -> None:
    """Where the numbers of this page come from."""
    origin = {
        "tracked": "simulations tracked with the service",
        "uploaded": "uploaded by a user",
        "measurements": "simulations and measured angles",
    }[found.origin]
    if found.holds_for:
        st.markdown(f"Holds for {plain(found.holds_for)}.")
    measured = f", {found.measured} of them measured on devices" if found.measured else ""
    st.caption(
        f":material/database: **{plain(found.campaign_name)}** ({origin}): {found.outcomes} "
        f"outcomes, {found.used} learnt from{measured}, {found.geometries} arrays · physics "
        f"version {found.physics_version} · dldsim {plain(found.dldsim_version)} · model "
        f"`{found.model_sha256[:12] or 'none'}`"
    )
    for warning in found.warnings:
        st.caption(f":material/warning: {plain(warning)}")
    with st.expander("Provenance"):
        scores = found.scores_by_geometry
        rows = {
            "data learnt from, SHA-256": found.outcomes_sha256,
            "surrogate, SHA-256": found.model_sha256,
            "fitted by": ", ".join(f"{k} {v}" for k, v in found.fitted_by.items()),
            "campaign id": found.campaign or "the service's own",
            "settings of this result, hash": found.config_hash,
            "seed of this result": found.seed,
            "error on arrays held out": f"root mean square {scores['rmse_deg']:.2f}°, median "
            f"{scores['median_absolute_error_deg']:.2f}°, R² {scores['r2']:.3f}, "
            f"{scores['predictions']} predictions"
            if "rmse_deg" in scores
            else None,
        }
        st.table(pd.Series({k: str(v) for k, v in rows.items() if v is not None}, name="value"))


def warn(sentences: Iterable[str]) -> None:
    for sentence in dict.fromkeys(sentences):
        st.warning(plain(sentence), icon=":material/warning:")
