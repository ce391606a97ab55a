"""First page: ask for an array that separates two cell types, watch the search, read the result."""

import streamlit as st

from dldsim.app.web.api import answers
from dldsim.app.web.ui import client, design_form, design_result, parts, search_charts
from dldsim.app.web.ui.client import ApiError
from dldsim.app.web.ui.parts import chart

POLL_S = 0.7


def page() -> None:
    st.title("Design an array for two cell types")
    info = parts.read_model()
    status = _current()
    if status is None or status.provenance is None:
        parts.provenance(info.provenance)
    design_form.show(info, status)
    identifier = st.session_state.get("design")
    if identifier is None:
        return
    st.divider()
    if status is None:
        st.button("Forget this design", on_click=_forget)
    elif _has_ended(status):
        design_result.show(info, status)
    else:
        _live(identifier)


def _has_ended(status: answers.DesignStatus) -> bool:
    """Whether the search has; the files of a result may still be written."""
    return status.state in client.FINAL or status.result is not None


def _forget() -> None:
    st.session_state.pop("design", None)
    st.session_state.pop("status", None)
    st.query_params.pop("design", None)


def _current() -> answers.DesignStatus | None:
    """State of the design in the address; one that does not change any more is asked for once."""
    identifier = st.session_state.get("design")
    if identifier is None:
        return None
    known = st.session_state.get("status")
    if known is not None and known.id == identifier:
        return known
    try:
        status = client.design(identifier)
    except ApiError as error:
        parts.show(error)
        return None
    if status.state in client.FINAL and status.verification.state in (*client.FINAL, "not-wanted"):
        st.session_state["status"] = status
    if st.session_state.get("form_of") != identifier and "form:objective" not in st.session_state:
        design_form.fill(status.spec)
    st.session_state["form_of"] = identifier
    return status


# ------------------------------------------------------------------------------------------- live


@st.fragment(run_every=POLL_S)
def _live(identifier: str) -> None:
    """Course of the search; the whole page is drawn anew when it ends."""
    try:
        status = client.design(identifier)
    except ApiError as error:
        parts.show(error)
        st.caption("The design is kept by the service. This page goes on asking.")
        return
    if _has_ended(status):
        st.rerun()
    progress = status.progress
    if status.state == "queued":
        before = status.queue_position
        st.subheader("Waiting")
        st.write("Next in the queue." if not before else f"{before} jobs are before this one.")
    else:
        st.subheader("Searching")
        share = progress.trial / progress.trials if progress.trials else 0.0
        left = "" if not progress.left_s else f", about {progress.left_s:.0f} s left"
        st.progress(
            min(share, 1.0),
            f"trial {progress.trial} of {progress.trials}, {progress.elapsed_s:.0f} s{left}",
        )
        if status.attempts > 1:
            st.caption(f"Attempt {status.attempts}: the service was restarted in between.")
    if st.button("Cancel", icon=":material/cancel:"):
        try:
            client.cancel(identifier)
        except ApiError as error:
            parts.show(error)
        st.rerun()
    best = progress.best
    if best is not None:
        design_result.metrics(best.model_dump())
        if not best.inside_training_domain:
            st.warning("The best so far lies outside the arrays learnt from.")
    if progress.convergence:
        chart(
            search_charts.convergence(progress.convergence, status.spec.objective, progress.trials),
            "live",
            "best value after each trial",
        )
