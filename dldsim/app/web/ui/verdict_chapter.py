"""The chapter of a design about its simulation: how far it is, then the verdict."""

import streamlit as st

from dldsim.app.web.api import answers
from dldsim.app.web.ui import candidate_charts, client, parts
from dldsim.app.web.ui.client import ApiError
from dldsim.app.web.ui.parts import chart, frame, plain

VERDICT_POLL_S = 5.0


def show(status: answers.DesignStatus) -> None:
    st.subheader("Verification by simulation")
    state = status.verification.state
    if state in ("waiting", "queued", "running"):
        _pending(status.id)
    elif state == "not-wanted":
        st.write("Not asked for. Switch on *Simulate the best designs afterwards* in the request.")
    elif state == "failed":
        st.error("**The simulation failed.** " + plain(status.verification.message))
    elif state == "cancelled":
        st.info("The simulation was cancelled.")
    else:
        _verdict(status.verification)


@st.fragment(run_every=VERDICT_POLL_S)
def _pending(identifier: str) -> None:
    try:
        found = client.design(identifier).verification
    except ApiError as error:
        parts.show(error)
        return
    if found.state not in ("waiting", "queued", "running"):
        st.rerun()
    elapsed = "" if found.elapsed_s is None else f" ({found.elapsed_s / 60:.1f} min)"
    words = {
        "waiting": "Waits for the search.",
        "queued": "Waits for its turn.",
        "running": f"Simulating{elapsed}: {plain(found.message or 'starting')}",
    }
    st.write(words[found.state])
    st.caption("The verdict appears here when it is ready; the page can be closed meanwhile.")
    if st.button("Cancel the simulation", icon=":material/cancel:"):
        try:
            client.cancel(identifier)
        except ApiError as error:
            parts.show(error)
        st.rerun()


def _verdict(found: answers.Verdict) -> None:
    designs = [d.model_dump() for d in found.designs]
    for d in designs:
        words = (
            f"Simulated design {d['rank']}, P_r {d['pillar_radius_um']:.2f} µm, P_g "
            f"{d['gap_um']:.2f} µm, N_p {d['periodicity']}: {d['verdict']}"
        )
        {True: st.success, False: st.error}.get(d["separates"], st.info)(plain(words))
    if designs:
        frame(
            designs,
            {
                "rank": ("rank", ""),
                "pillar_radius_um": ("P_r [µm]", "%.2f"),
                "gap_um": ("P_g [µm]", "%.2f"),
                "periodicity": ("N_p", ""),
                "separation_deg": ("simulated |Δθ| [°]", "%.2f"),
                "sigma_num_deg": ("σ_num [°]", "%.2f"),
                "predicted_separation_deg": ("predicted [°]", "%.2f"),
                "uncertainty_deg": ("± 90 % [°]", "%.2f"),
                "mode_1": ("mode 1", ""),
                "mode_2": ("mode 2", ""),
                "status_1": ("run 1", ""),
                "status_2": ("run 2", ""),
                "separation_low_height_deg": ("lower channel [°]", "%.2f"),
                "separation_high_height_deg": ("higher channel [°]", "%.2f"),
                "pressure_drop_kPa": ("Δp [kPa]", "%.3g"),
                "agrees": ("as predicted", ""),
            },
            "verified",
        )
        st.caption(plain(designs[0]["stopped"]))
    rows = [r.model_dump() for r in found.verifications]
    if rows:
        chart(
            candidate_charts.verdicts(rows),
            "verdicts",
            "predicted interval and simulated difference",
        )
