"""Third page: what was simulated, the calibration with its inverse, and single predictions."""

import streamlit as st

from dldsim.app.web.api import answers, field_limits, specs
from dldsim.app.web.ui import campaign_charts, candidate_charts, client, parts
from dldsim.app.web.ui.client import ApiError
from dldsim.app.web.ui.parts import at_field, chart, frame, number, plain

AXES = {
    "gap_um": "gap P_g",
    "pillar_radius_um": "pillar radius P_r",
    "periodicity": "periodicity N_p",
    "deformation_index": "deformation index",
    "confinement": "confinement 2R / P_g",
}
GROUPS = {
    "mode": "mode",
    "stiffness_set": "stiffness set",
    "periodicity": "periodicity N_p",
    "pillar_radius_um": "pillar radius P_r",
    "gap_um": "gap P_g",
}
RESPONSES = {"migration_angle_deg": "angle θ_m", "share": "tan θ_m · N_p"}
FILTERS = ("pillar_radius_um", "gap_um", "periodicity", "stiffness_set")


def page() -> None:
    st.title("Campaign")
    info = parts.read_model()
    parts.provenance(info.provenance)
    tabs = st.tabs(["Angles and modes", "Deformation index and stiffness", "Predict one array"])
    with tabs[0]:
        _angles()
    with tabs[1]:
        _calibration(info)
    with tabs[2]:
        _predict(info)


def _rows(kind: str) -> list[dict] | None:
    try:
        return parts.table(kind, parts.campaign(), client.address()).rows
    except ApiError as error:
        parts.show(error)
        return None


def _angles() -> None:
    outcomes = _rows("outcomes")
    if not outcomes:
        return
    with st.container(border=True):
        left, middle, right = st.columns(3)
        x = left.selectbox("along x", AXES, format_func=AXES.get, key="form:angles_x")
        response = middle.selectbox(
            "along y", RESPONSES, format_func=RESPONSES.get, key="form:angles_y"
        )
        group = right.selectbox(
            "colour and marker", GROUPS, format_func=GROUPS.get, key="form:angles_group"
        )
        shown = outcomes
        for name, column in zip(FILTERS, st.columns(4), strict=True):
            values = sorted({r[name] for r in outcomes})
            chosen = column.multiselect(
                f"only {GROUPS[name]}", values, placeholder="all", key=f"form:only_{name}"
            )
            if chosen:
                shown = [r for r in shown if r[name] in chosen]
    without = sum(r["migration_angle_deg"] is None for r in shown)
    chart(campaign_charts.angles(shown, x, response, group), "angles", "angle of each outcome")
    st.caption(
        f"{len(shown)} outcomes, {without} of them without an angle (stuck, unstable or "
        "failed). Hollow: undecided, the motion had not settled when its rows were spent. "
        "Bars: numerical uncertainty σ_num where it was studied. Outcomes of the same value "
        "stand side by side."
        + (" Dotted: limits of zigzag (0.1) and bump (0.9)." if response == "share" else "")
    )
    st.markdown("**Modes**")
    chart(campaign_charts.modes(shown, x), "modes", "number of outcomes in each mode")
    with st.expander(f"The {len(shown)} outcomes"):
        frame(
            shown,
            {
                "outcome_id": ("outcome", ""),
                "pillar_radius_um": ("P_r [µm]", "%.3g"),
                "gap_um": ("P_g [µm]", "%.3g"),
                "periodicity": ("N_p", ""),
                "stiffness_set": ("set", ""),
                "deformation_index": ("DI", "%.4f"),
                "cell_radius_um": ("R [µm]", "%.3g"),
                "migration_angle_deg": ("θ_m [°]", "%.2f"),
                "sigma_num_deg": ("σ_num [°]", "%.2f"),
                "mode": ("mode", ""),
                "status": ("status", ""),
                "releases": ("releases", ""),
                "rows_total": ("rows", ""),
            },
            "outcomes",
        )


def _calibration(info: answers.ModelInfo) -> None:
    rows = _rows("calibration")
    if rows is None:
        return
    assays = list(dict.fromkeys(r["assay"] for r in rows if r["assay"] in info.calibrated_range))
    limits = {f.name: f for f in field_limits.limits_of(specs.StiffnessSpec)}
    left, right = st.columns([2, 3])
    with left:
        st.markdown("**Measured deformation index → stiffness**")
        assay = st.radio(
            "assay",
            assays,
            key="form:calibration",
            help="How the index was measured; docs/assays.md.",
        )
        low, high = info.calibrated_range.get(assay, (0.0, 1.0))
        index = number(
            limits["deformation_index"],
            "Deformation index",
            "form:measured_index",
            round((low + high) / 2, 4),
        )
        st.caption(f"calibrated {low:.4f} to {high:.4f}")
        error = number(limits["error"], "± standard error", "form:measured_error", 0.002)
        spec = {"deformation_index": index, "error": error, "assay": assay}
        found = None
        try:
            found = client.stiffness(spec | _campaign())
        except ApiError as error:
            parts.show(error)
        if found is not None:
            frame(
                [
                    {
                        "modulus": label,
                        "value": getattr(found, name),
                        "low": getattr(found, f"{name}_low"),
                        "high": getattr(found, f"{name}_high"),
                    }
                    for name, label in (
                        ("ks_uN_per_m", "k_s, edge springs [µN/m]"),
                        ("kal_uN_per_m", "k_α, local area [µN/m]"),
                        ("kb_pN_um", "k_b, bending [pN·µm]"),
                    )
                ],
                {
                    "modulus": ("modulus", ""),
                    "value": ("value", "%.4g"),
                    "low": ("from", "%.4g"),
                    "high": ("to", "%.4g"),
                },
                "moduli",
            )
            st.caption(f"Between {plain(' and '.join(found.between))}{_flow_of(found)}.")
            if found.truncated:
                st.warning(
                    "The interval reaches the end of the calibrated range; the true one is wider.",
                    icon=":material/warning:",
                )
    with right:
        chart(
            campaign_charts.calibration(rows, found and found.model_dump()),
            "calibration",
            "deformation index over the spring constant",
        )
        st.caption("Bars: standard deviation over what the passages vary.")
    with st.expander("The calibration"):
        frame(
            rows,
            {
                "assay": ("assay", ""),
                "group": ("group", ""),
                "stiffness_set": ("set", ""),
                "ks_uN_per_m": ("k_s [µN/m]", "%.4g"),
                "velocity_mm_s": ("velocity [mm/s]", "%.4g"),
                "runs": ("runs", ""),
                "deformation_index": ("DI", "%.4f"),
                "deformation_index_std": ("± [1]", "%.4f"),
                "label": ("from", ""),
            },
            "calibration-table",
        )


def _flow_of(found: answers.StiffnessAnswer) -> str:
    """At which velocity or stress it holds, and where it is from."""
    flow = ""
    if found.velocity_mm_s is not None:
        flow = f", at {found.velocity_mm_s:.3g} mm/s"
    elif found.shear_stress_Pa is not None:
        flow = f", at a shear stress of {found.shear_stress_Pa:.3g} Pa"
    return f"{flow}; {plain(found.label)}" if found.label else flow


def _campaign() -> dict[str, str]:
    return {"campaign": parts.campaign()} if parts.campaign() else {}


def _predict(info: answers.ModelInfo) -> None:
    limits = {f.name: f for f in field_limits.limits_of(specs.PredictSpec)}
    low, high = info.deformation_index_range
    arrays = info.domain["arrays"]
    middle = sorted(arrays)[len(arrays) // 2]
    spec: dict = {}
    left, right = st.columns([2, 3])
    with left:
        for name, label, default, whole in (
            ("pillar_radius_um", "Pillar radius P_r", middle[0], False),
            ("gap_um", "Gap P_g", middle[1], False),
            ("periodicity", "Periodicity N_p [rows]", int(middle[2]), True),
            ("deformation_index", "Deformation index", round((low + high) / 2, 4), False),
            ("cell_radius_um", "Cell radius R", info.cell["radius_um"], False),
        ):
            limit = limits[name]
            spec[name] = number(limit, label, f"form:predict_{name}", default, whole=whole)
            note = f"allowed {parts.allowed(limit)}"
            if name == "deformation_index":
                note += f"; learnt from {low:.4f} to {high:.4f}"
            st.caption(note)
            at_field("predict", name)
        spec["level"] = number(limits["level"], "Level of the interval", "form:predict_level", 0.9)
        at_field("predict", "level")
        asked = st.button("Predict", type="primary")
    with right:
        if asked:
            parts.clear("predict")
            try:
                st.session_state["prediction"] = (spec, client.predict(spec | _campaign()))
            except ApiError as error:
                parts.keep("predict", error)
                st.session_state.pop("prediction", None)
                st.rerun()
        parts.show_problem("predict")
        if "prediction" not in st.session_state:
            st.write("The predicted angle of one cell type in one array appears here.")
            return
        asked_for, found = st.session_state["prediction"]
        if asked_for != spec or found.provenance.campaign != parts.campaign():
            st.caption("The fields were changed since; press Predict again.")
        parts.metrics(
            (
                ("θ_m", f"{found.angle_deg:.2f}°"),
                (f"{found.level:.0%} interval", f"{found.low_deg:.2f} to {found.high_deg:.2f}°"),
                ("mode", found.mode),
            )
        )
        sigma = "not studied" if found.sigma_num_deg is None else f"{found.sigma_num_deg:.2f}°"
        inside = "inside" if found.inside_domain else "**outside**"
        st.markdown(
            f"Full bump: {found.bump_angle_deg:.2f}°. Numerical uncertainty σ_num: {sigma}."
            f" The array is {inside} the training domain."
        )
        parts.warn(w for w in found.warnings if w not in found.provenance.warnings)
    design = {
        "angle_1_deg": found.angle_deg,
        "angle_1_low_deg": found.low_deg,
        "angle_1_high_deg": found.high_deg,
        "mode_1": found.mode,
    } | asked_for
    chart(
        candidate_charts.array(design, [asked_for["cell_radius_um"]]),
        "predicted-array",
        "array with the predicted mean direction",
    )
    st.caption(
        "Line: predicted mean direction, shaded: its interval; the way from row to row is "
        "not predicted. The disc has the radius of the cell."
    )
