"""Fourth page: angles measured on fabricated devices, and campaigns of the user's own."""

from typing import Any

import pandas as pd
import streamlit as st

from dldsim.app.web.api import answers, field_limits, specs
from dldsim.app.web.ui import client, parts
from dldsim.app.web.ui.client import ApiError
from dldsim.app.web.ui.parts import at_field, number, plain

COLUMNS = {
    "pillar_radius_um": "P_r [µm]",
    "gap_um": "P_g [µm]",
    "periodicity": "N_p [rows]",
    "deformation_index": "deformation index",
    "cell_radius_um": "R [µm]",
    "migration_angle_deg": "θ [°]",
    "error_deg": "± [°]",
    "note": "note",
}
POLL_S = 1.5


def page() -> None:
    st.title("Measurements and own campaigns")
    info = parts.read_model()
    parts.provenance(info.provenance)
    _state_of_campaigns()
    tabs = st.tabs(["Measured angles", "Upload a campaign"])
    with tabs[0]:
        _measurements(info)
    with tabs[1]:
        _upload(info)


def _remember(found: answers.CampaignStatus) -> None:
    st.session_state.setdefault("campaigns_made", {})[found.id] = found.name


# ------------------------------------------------------------------------------ measured angles


def _measurements(info: answers.ModelInfo) -> None:
    st.write(
        "Type or paste the angles of cell types in devices that were made. The surrogate is "
        "fitted anew to the campaign chosen at the side and these; each angle counts as one "
        "run. The campaign itself stays as it is."
    )
    limits = {f.name: f for f in field_limits.limits_of(specs.Measurement)}
    empty = pd.DataFrame(
        {name: pd.Series(dtype=str if name == "note" else float) for name in COLUMNS}
    )
    table = st.data_editor(
        empty,
        num_rows="dynamic",
        hide_index=True,
        key="measured",
        width="stretch",
        column_config={name: _column(name, title, limits[name]) for name, title in COLUMNS.items()},
    )
    st.caption(
        "; ".join(f"{COLUMNS[n]}: {parts.allowed(limits[n])}" for n in COLUMNS if n != "note")
        + ". Angles against the flow, positive as the rows shift. "
        "The error ± is kept with the data; the fit does not use it."
    )
    at_field("measure", "measurements")
    whole = {f.name: f for f in field_limits.limits_of(specs.MeasurementsSpec)}
    first, second, third = st.columns(3)
    with first:
        height = number(
            whole["height_um"], "Channel height", "form:measured_height", info.flow["height_um"]
        )
        st.caption(
            f"allowed {parts.allowed(whole['height_um'])}; simulated {info.flow['height_um']:g} µm"
        )
        at_field("measure", "height_um")
    with second:
        speed = number(
            whole["mean_velocity_mm_s"],
            "Mean velocity",
            "form:measured_velocity",
            info.flow["mean_velocity_mm_s"],
        )
        st.caption(
            f"allowed {parts.allowed(whole['mean_velocity_mm_s'])}; simulated "
            f"{info.flow['mean_velocity_mm_s']:g} mm/s"
        )
        at_field("measure", "mean_velocity_mm_s")
    with third:
        st.session_state.setdefault("form:measured_name", "measured")
        name = st.text_input(
            "Name, shown beside every answer", key="form:measured_name", max_chars=80
        )
        at_field("measure", "name")
    parts.show_problem("measure")
    if not st.button("Fit with these angles", type="primary", icon=":material/model_training:"):
        return
    parts.clear("measure")
    rows = [
        {k: _plain_value(k, v) for k, v in row.items() if not _missing(v)}
        for row in table.to_dict("records")
    ]
    spec: dict[str, Any] = {
        "measurements": [r for r in rows if r],
        "height_um": height,
        "mean_velocity_mm_s": speed,
        "name": name,
    }
    if parts.campaign():
        spec["campaign"] = parts.campaign()
    try:
        _remember(client.measure(spec))
    except ApiError as error:
        parts.keep("measure", error)
    st.rerun()


def _column(name: str, title: str, limit: field_limits.FieldLimit):
    about = plain(f"{limit.description}. Allowed: {parts.allowed(limit)}.")
    if name == "note":
        return st.column_config.TextColumn(title, help=about, max_chars=200)
    return st.column_config.NumberColumn(
        title,
        help=about,
        min_value=limit.minimum,
        max_value=limit.maximum,
        step=1 if name == "periodicity" else None,
    )  # were any required, such rows would be lost


def _missing(value: Any) -> bool:
    return value is None or value == "" or (isinstance(value, float) and value != value)


def _plain_value(name: str, value: Any) -> Any:
    return int(value) if name == "periodicity" and float(value).is_integer() else value


# ------------------------------------------------------------------------------- own campaigns


def _upload(info: answers.ModelInfo) -> None:
    most = int(info.limits.get("upload_max_bytes", 0)) or None
    st.write(
        "Bring the table `outcomes` that a campaign of your own wrote, as CSV or Parquet. Its "
        "columns are checked, and a surrogate is fitted to it. With its `calibration` cell "
        "types can be named by stiffness set and designs be verified; with its `flows` "
        "pressure drops are known."
    )
    megabytes = most and max(1, most // 1024**2)
    files = {}
    for kind, column in zip(("outcomes", "calibration", "flows"), st.columns(3), strict=True):
        with column:
            given = st.file_uploader(
                kind if kind == "outcomes" else f"{kind}, if wanted",
                type=["csv", "txt", "tsv", "parquet"],
                key=f"upload_{kind}",
                max_upload_size=megabytes,
            )
            if given is not None:
                files[kind] = (given.name, given.getvalue())
            at_field("upload", kind)
    if most:
        rows = info.limits.get("upload_rows_max")
        st.caption(f"At most {most / 1e6:.1f} MB together" + (f", {rows:g} rows." if rows else "."))
    st.session_state.setdefault("form:upload_name", "my campaign")
    name = st.text_input("Name, shown beside every answer", key="form:upload_name", max_chars=80)
    at_field("upload", "name")
    parts.show_problem("upload")
    if st.button(
        "Upload and fit", type="primary", icon=":material/upload:", disabled="outcomes" not in files
    ):
        parts.clear("upload")
        try:
            _remember(client.upload(name, files))
        except ApiError as error:
            parts.keep("upload", error)
        st.rerun()


# ---------------------------------------------------------------------------- state of campaigns


def _state_of_campaigns() -> None:
    """Campaigns of this session, and those being fitted."""
    made = st.session_state.get("campaigns_made", {})
    if parts.campaign() and parts.campaign() not in made:
        made = {**made, parts.campaign(): "campaign"}
    for identifier in reversed(made):
        status = st.session_state.get(f"campaign_status:{identifier}")
        if status is None:
            _fitting(identifier)
        else:
            _campaign(status)


@st.fragment(run_every=POLL_S)
def _fitting(identifier: str) -> None:
    try:
        status = client.campaign(identifier)
    except ApiError as error:
        parts.show(error)
        if error.status == 404 and st.button("Remove it from this page", key=f"drop-{identifier}"):
            _drop(identifier)
        return
    if status.state in ("ready", "failed", "cancelled"):
        st.session_state[f"campaign_status:{identifier}"] = status
        if status.state == "ready":
            st.session_state.setdefault("campaigns", {})[identifier] = status.name
        st.rerun()
    st.info(
        f"**{plain(status.name)}**: {'waiting' if status.state == 'queued' else 'fitting'}, "
        f"{status.rows} rows. Fitting takes a minute or so.",
        icon=":material/hourglass_top:",
    )


def _campaign(status: answers.CampaignStatus) -> None:
    with st.container(border=True):
        if status.state != "ready":
            st.error(
                f"**{plain(status.name)}** could not be used: "
                f"{plain(status.error or status.state)}",
                icon=":material/error:",
            )
        else:
            used = parts.campaign() == status.id
            st.success(
                f"**{plain(status.name)}** is ready: {status.rows} rows."
                + (" Answers come from it." if used else ""),
                icon=":material/check_circle:",
            )
            if status.found:
                st.caption("Read as: " + plain("; ".join(status.found)) + ".")
            _scores(status)
        with st.container(horizontal=True):
            if status.state == "ready" and parts.campaign() != status.id:
                st.button(
                    "Use it",
                    key=f"use-{status.id}",
                    type="primary",
                    on_click=parts.use_campaign,
                    args=(status.id,),
                )
            if parts.campaign() == status.id:
                st.button(
                    "Use the service's own again",
                    key=f"own-{status.id}",
                    on_click=parts.use_campaign,
                    args=(None,),
                )
            if st.button("Delete it", key=f"delete-{status.id}", icon=":material/delete:"):
                try:
                    client.forget(status.id)
                except ApiError as error:
                    if error.status != 404:
                        parts.show(error)
                        return
                _drop(status.id)


def _drop(identifier: str) -> None:
    state = st.session_state
    for name in ("campaigns_made", "campaigns"):
        state.get(name, {}).pop(identifier, None)
    state.pop(f"campaign_status:{identifier}", None)
    if parts.campaign() == identifier:
        parts.use_campaign(None)
    st.rerun()


def _scores(status: answers.CampaignStatus) -> None:
    """Error on arrays held out, beside that of the service's own campaign."""
    try:
        own = parts.model(None, client.address()).provenance.scores_by_geometry
    except ApiError:  # the service may have none of its own
        own = {}
    found = status.provenance.scores_by_geometry if status.provenance else {}
    rows = [
        {
            "surrogate": label,
            "rmse": s["rmse_deg"],
            "median": s["median_absolute_error_deg"],
            "r2": s["r2"],
            "count": s["predictions"],
        }
        for label, s in ((status.name, found), ("the service's own", own))
        if "rmse_deg" in s
    ]
    if rows:
        parts.frame(
            rows,
            {
                "surrogate": ("error on arrays held out", ""),
                "rmse": ("root mean square [°]", "%.2f"),
                "median": ("median [°]", "%.2f"),
                "r2": ("R²", "%.3f"),
                "count": ("predictions", ""),
            },
            f"scores-{status.id}",
        )
