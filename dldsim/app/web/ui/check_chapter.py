"""Simulated check of an outcome: asked for, watched, and beside the prediction."""

from collections.abc import Mapping
from typing import Any

import streamlit as st

from dldsim.app.web.api import answers, field_limits, outcome_specs
from dldsim.app.web.ui import client, outlet_charts, parts
from dldsim.app.web.ui.client import ApiError
from dldsim.app.web.ui.outlets_chapter import downloads, interval
from dldsim.app.web.ui.parts import at_field, chart, frame, number, plain

PLACE = "check"
POLL_S = 2.0
COLUMNS = {
    "cell": ("cells", ""),
    "simulated": ("simulated", ""),
    "own": ("at its outlet", ""),
    "lost": ("clog", ""),
    "open": ("not settled", ""),
    "failed": ("failed", ""),
    "predicted": ("recovery predicted", ""),
    "recovery": ("recovery simulated", ""),
    "chance_outlet": ("chance of the count", "%.2g"),
    "chance_exit": ("chance of the exits", "%.2g"),
    "agrees": ("agrees", ""),
}


def ask(spec: Mapping[str, Any]) -> None:
    """Fields and button that ask for the check of an outcome, whose request is ``spec``."""
    st.subheader("Simulated check")
    fields = {f.name: f for f in field_limits.limits_of(outcome_specs.CheckSpec)}
    left, right = st.columns([1, 2], vertical_alignment="bottom")
    with left:
        count = number(
            fields["simulate"],
            "Cells to simulate",
            "form:simulate",
            fields["simulate"].default,
            whole=True,
        )
    with right:
        pressed = st.button("Simulate them", icon=":material/science:")
    st.caption(
        "Half of each type, each drawn with its size, stiffness and place of entry and carried "
        "through the nominal array until its motion has settled"
        + (", of the first device alone" if spec.get("then") else "")
        + ". Minutes: some 5 to 15 s a cell."
    )
    if pressed:
        parts.clear(PLACE)
        one = {k: v for k, v in spec.items() if k not in ("then", "from_outlet")}
        try:
            status = client.check(one | {"simulate": count})
        except ApiError as error:
            parts.keep(PLACE, error)
        else:
            st.session_state["check"] = status.id
            st.query_params["check"] = status.id
        st.rerun()
    parts.show_problem(PLACE)
    at_field(PLACE, "simulate")


def current() -> answers.CheckStatus | None:
    """The check in the address; one that does not change any more is asked for once."""
    identifier = st.session_state.get("check")
    if identifier is None:
        return None
    known = st.session_state.get("check_status")
    if known is not None and known.id == identifier:
        return known
    try:
        status = client.checked(identifier)
    except ApiError as error:
        parts.show(error)
        st.button("Forget this check", on_click=_forget)
        return None
    if status.state in client.FINAL:
        st.session_state["check_status"] = status
    return status


def _forget() -> None:
    for name in ("check", "check_status"):
        st.session_state.pop(name, None)
    st.query_params.pop("check", None)


def show(status: answers.CheckStatus) -> None:
    """A check that was asked for."""
    spec = status.spec
    st.markdown(
        f"**{spec.simulate} cells in P_r {spec.pillar_radius_um:g} µm, P_g {spec.gap_um:g} µm, "
        f"N_p {spec.periodicity}.** The address of this page brings you back to it."
    )
    if status.state not in client.FINAL:
        _running(status.id)
    elif status.state == "cancelled":
        st.info("The simulation was cancelled.", icon=":material/cancel:")
    elif status.state == "failed":
        st.error(
            f"**The simulation failed.** {plain(status.error or 'No reason was given.')}",
            icon=":material/error:",
        )
    else:
        _beside(status)


@st.fragment(run_every=POLL_S)
def _running(identifier: str) -> None:
    """How far it is; the whole page is drawn anew when it ends."""
    try:
        status = client.checked(identifier)
    except ApiError as error:
        parts.show(error)
        st.caption("The check is kept by the service. This page goes on asking.")
        return
    if status.state in client.FINAL:
        st.rerun()
    if status.state == "queued":
        before = status.queue_position
        st.write("Next in the queue." if not before else f"{before} jobs are before this one.")
    else:
        elapsed = "" if status.elapsed_s is None else f" ({status.elapsed_s / 60:.1f} min)"
        st.write(f"Simulating{elapsed}: {plain(status.message or 'starting')}")
        if status.attempts > 1:
            st.caption(
                f"Attempt {status.attempts}: the service was restarted in between. Cells that "
                "were finished are kept."
            )
    st.caption("The result appears here when it is ready; the page can be closed meanwhile.")
    if st.button("Cancel the simulation", icon=":material/cancel:"):
        try:
            client.cancel_check(identifier)
        except ApiError as error:
            parts.show(error)
        st.rerun()


def _beside(status: answers.CheckStatus) -> None:
    """Predicted and simulated cells side by side."""
    result = status.result
    checks, cells = (
        [row.model_dump() for row in rows] for rows in (result.device_checks, result.checked_cells)
    )
    for row in checks:
        words = (
            f"Cell type {row['population']}: {row['own']} of {row['simulated']} simulated cells "
            f"leave by its outlet; predicted {interval(row, 'predicted')}."
        )
        if row["agrees"]:
            st.success(plain(f"{words} They agree."), icon=":material/check_circle:")
        else:
            st.error(plain(f"{words} They do not agree."), icon=":material/error:")
    chart(
        outlet_charts.checked(
            [row.model_dump() for row in result.device_exits],
            cells,
            result.device_outcomes[0].cut_um,
        ),
        "checked",
        "predicted and simulated places at the end of the array, a panel for each cell type",
    )
    frame(
        [
            row
            | {
                "cell": f"type {row['population']}",
                "predicted": interval(row, "predicted"),
                "recovery": interval(row, "recovery"),
                "agrees": "yes" if row["agrees"] else "no",
            }
            for row in checks
        ],
        COLUMNS,
        "checks",
    )
    st.caption(
        "Black: the wall between the outlets. Predicted for the nominal array, with the error of "
        "the prediction. Chances, by the prediction, of the count at the outlet and of the "
        "exits, and of all that is as unlikely; below 0.05 they do not agree. A prediction that "
        "knows little agrees easily: look at its interval."
    )
    whole = {"spec": status.spec.model_dump(mode="json"), "device_checks": checks}
    downloads(
        "Simulated cells", f"check-{status.id[:8]}", whole | {"checked_cells": cells}, cells, ""
    )
