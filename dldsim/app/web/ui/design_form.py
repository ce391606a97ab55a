"""The request for a design: its fields, and where it lies in what was learnt."""

from collections.abc import Mapping
from typing import Any

import streamlit as st

from dldsim.app.web.api import answers, field_limits, specs
from dldsim.app.web.ui import cells_form, client, in_domain, parts
from dldsim.app.web.ui.client import ApiError
from dldsim.app.web.ui.parts import at_field, number, plain

BOUNDS = {
    "pillar_radius_um": "Pillar radius P_r",
    "gap_um": "Gap P_g",
    "periodicity": "Periodicity N_p",
}
OBJECTIVES = {
    "robust": "robust separation",
    "separation": "nominal separation",
    "purity-recovery": "purity and recovery",
}
SAMPLERS = {"tpe": "TPE, trial by trial", "grid": "every point of a grid"}


def fill(spec: specs.DesignSpec) -> None:
    """Put a request into the form, for one who comes back to a design."""
    given = spec.model_dump()
    state = st.session_state
    cells_form.fill(given)
    for name in BOUNDS:
        for side, value in zip(("low", "high"), given[name], strict=True):
            state[f"form:{name}_{side}"] = value
    for name in (
        "objective",
        "sampler",
        "trials",
        "startup_trials",
        "grid_steps",
        "draws",
        "candidates",
        "tolerance_um",
        "height_tolerance_um",
        "pillar_aspect_ratio_max",
        "lateral_separation_um",
        "pressure_max_kPa",
        "sample_min_uL_per_h",
        "footprint_max_mm2",
        "seed",
        "verify",
        "name",
    ):
        state[f"form:{name}"] = given[name]


def show(info: answers.ModelInfo, status: answers.DesignStatus | None) -> None:
    fields = {f.name: f for f in info.fields}
    with st.expander(
        "Request", expanded=status is None or status.state == "failed", icon=":material/tune:"
    ):
        spec: dict[str, Any] = cells_form.show("design", info, fields)
        spec |= _bounds(info, fields)
        with st.expander("Constraints, objective and search"):
            spec |= _options(info, fields)
        _look_ahead(info, spec)
        if info.provenance.campaign is not None:
            spec["campaign"] = info.provenance.campaign
        parts.show_problem("design")
        at_field("design", "name", "campaign", "")
        if st.button("Search for designs", type="primary", icon=":material/search:"):
            _send(spec)


def _send(spec: Mapping[str, Any]) -> None:
    parts.clear("design")
    try:
        accepted = client.ask(spec)
    except ApiError as error:
        parts.keep("design", error)
    else:
        st.session_state["design"] = st.session_state["form_of"] = accepted.id
        st.query_params["design"] = accepted.id
    st.rerun()


def _bounds(
    info: answers.ModelInfo, fields: Mapping[str, field_limits.FieldLimit]
) -> dict[str, Any]:
    """Bounds of the geometry."""
    found: dict[str, Any] = {}
    learnt = {n: [a[k] for a in info.domain["arrays"]] for k, n in enumerate(BOUNDS)}
    with st.container(border=True):
        st.markdown("**Bounds of the array**")
        for (name, label), column in zip(BOUNDS.items(), st.columns(3), strict=True):
            field = fields[name]
            with column:
                whole = name == "periodicity"
                st.markdown(f"{label} [{field.unit or 'rows'}]")
                left, right = st.columns(2)
                with left:
                    low = number(field, "lowest", f"form:{name}_low", field.default[0], whole=whole)
                with right:
                    high = number(
                        field, "highest", f"form:{name}_high", field.default[1], whole=whole
                    )
                found[name] = [low, high]
                values = learnt[name]
                st.caption(
                    f"allowed {parts.allowed(field)}; simulated {min(values):g} to "
                    f"{max(values):g} {field.unit or 'rows'}"
                )
                at_field("design", name)
        st.caption(f"P_g must exceed P_r by {info.safety_distance_um:g} µm (safety distance).")
    return found


def _options(
    info: answers.ModelInfo, fields: Mapping[str, field_limits.FieldLimit]
) -> dict[str, Any]:
    """Constraints, objective, search."""
    state = st.session_state
    found: dict[str, Any] = {}
    first, second, third = st.columns(3)

    def put(name: str, label: str, **more: Any) -> None:
        found[name] = number(fields[name], label, f"form:{name}", fields[name].default, **more)
        at_field("design", name)

    with first:
        st.markdown("**Constraints**")
        put("pressure_max_kPa", "Largest pressure drop", empty="no limit")
        put("pillar_aspect_ratio_max", "Largest height / diameter of a pillar")
        put("lateral_separation_um", "Distance of the cell types wanted")
        put("tolerance_um", "Fabrication tolerance ±")
        put("sample_min_uL_per_h", "Least flow of the sample", empty="no limit")
        if state.get("form:objective") == "purity-recovery":
            put("footprint_max_mm2", "Largest area of the array", empty="no limit")
    with second:
        st.markdown("**Objective**")
        for name, words in (("objective", OBJECTIVES), ("sampler", SAMPLERS)):
            state.setdefault(f"form:{name}", fields[name].default)
            found[name] = st.radio(
                {"objective": "maximise", "sampler": "search by"}[name],
                fields[name].choices,
                key=f"form:{name}",
                format_func=lambda v, w=words: w.get(v, v),
                help=plain(fields[name].description),
            )
            at_field("design", name)
    with third:
        st.markdown("**Search**")
        if found["sampler"] == "tpe":
            put("trials", "Trials", high=info.limits.get("trials_max"), whole=True, slider=True)
            put("startup_trials", "of which random at first", whole=True)
        else:
            put("grid_steps", "Values of P_r and of P_g", whole=True, slider=True)
        if found["objective"] != "separation":
            put("draws", "Monte Carlo draws", whole=True, empty="as many as are usual")
        put("candidates", "Candidates to report", whole=True, slider=True)
        put("seed", "Seed", whole=True)
        state.setdefault("form:name", fields["name"].default)
        found["name"] = st.text_input(
            "Name of the request",
            key="form:name",
            max_chars=40,
            help=plain(fields["name"].description),
        )
    # below the columns, which would cut its label in a narrow window
    state.setdefault("form:verify", False)
    found["verify"] = st.toggle(
        "Simulate the best designs afterwards",
        key="form:verify",
        help=plain(fields["verify"].description),
    )
    if found["verify"]:
        put("height_tolerance_um", "Tolerance of the channel height ±")
    return found


def _look_ahead(info: answers.ModelInfo, spec: Mapping[str, Any]) -> None:
    """The request in the training domain, before it is sent."""
    low, high = in_domain.index_range(info, spec["assay"])
    by_set = {s.stiffness_set: s for s in info.stiffness_sets}
    seen = dict(spec)
    for i in (1, 2):
        radius, index = f"radius_{i}_um", f"deformation_index_{i}"
        spread = f"deformation_index_std_{i}"
        seen.setdefault(radius, info.cell["radius_um"])  # of a table: the service knows its mean
        seen.setdefault(index, None)
        seen.setdefault(spread, None)
        known = by_set.get(spec.get(f"stiffness_set_{i}"))
        if known is not None and spec["assay"] is None:
            seen[index] = known.deformation_index
            if seen[spread] is None:
                seen[spread] = known.deformation_index_std
        elif seen[index] is not None and not low <= seen[index] <= high:
            st.warning(
                f"The deformation index {seen[index]:.4f} of cell type {i} is outside the "
                f"calibrated range, {low:.4f} to {high:.4f}: the service will refuse it."
            )
    beyond = []
    for i in (1, 2):
        arrays = in_domain.learnt(info, spec[f"shape_{i}"])
        if arrays is None or f"radius_{i}_um" not in spec:
            continue
        for k, name in enumerate(BOUNDS):
            ratios = [g[k] for g in arrays]
            scale = spec[f"radius_{i}_um"] if k < 2 else 1.0
            ends = [v / scale for v in spec[name]]
            if ends[0] < min(ratios) * (1 - 1e-9) or ends[1] > max(ratios) * (1 + 1e-9):
                beyond.append(BOUNDS[name])
    if beyond:
        st.info(
            "The bounds of " + ", ".join(dict.fromkeys(beyond)) + " reach beyond the arrays "
            "learnt from. The search looks inside first; a candidate outside is flagged as "
            "extrapolated and ranked behind.",
            icon=":material/info:",
        )
    with st.expander("The request in the training domain"):
        in_domain.show(info, seen, "ahead")
