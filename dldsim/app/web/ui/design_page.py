"""First page: ask for an array that separates two cell types, watch the search, read the result."""

from collections.abc import Mapping
from math import ceil, floor
from typing import Any

import streamlit as st

from dldsim.app.web.api import models
from dldsim.app.web.ui import charts, client, parts
from dldsim.app.web.ui.client import ApiError
from dldsim.app.web.ui.parts import at_field, chart, frame, number, plain

BY_INDEX, BY_SET = "deformation index", "stiffness set"
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
POLL_S = 0.7
VERDICT_POLL_S = 5.0
FILE_NAMES = {"json": "JSON", "csv": "CSV", "gds": "GDSII mask", "dxf": "DXF mask"}
MIME = {
    "json": "application/json",
    "csv": "text/csv",
    "gds": "application/octet-stream",
    "dxf": "application/dxf",
    "report": "text/html",
}
CANDIDATE_COLUMNS = {
    "design": ("no.", ""),
    "rank": ("rank", ""),
    "pillar_radius_um": ("P_r [µm]", "%.2f"),
    "gap_um": ("P_g [µm]", "%.2f"),
    "periodicity": ("N_p", ""),
    "separation_deg": ("|Δθ| [°]", "%.2f"),
    "uncertainty_deg": ("± 90 % [°]", "%.2f"),
    "robust_separation_deg": ("robust |Δθ| [°]", "%.2f"),
    "sigma_num_deg": ("σ_num [°]", "%.2f"),
    "mode_1": ("mode 1", ""),
    "mode_2": ("mode 2", ""),
    "mode_change_probability": ("mode may change", "%.0f %%"),
    "length_mm": ("length [mm]", "%.1f"),
    "pressure_drop_kPa": ("Δp [kPa]", "%.3g"),
    "throughput_uL_per_h": ("flow [µL/h]", "%.0f"),
    "inside_training_domain": ("interpolated", ""),
    "verdict": ("verdict", ""),
    "notes": ("notes", ""),
}


def page() -> None:
    st.title("Design an array for two cell types")
    info = parts.read_model()
    status = _current()
    if status is None or status.provenance is None:
        parts.provenance(info.provenance)
    _form(info, status)
    identifier = st.session_state.get("design")
    if identifier is None:
        return
    st.divider()
    if status is None:
        st.button("Forget this design", on_click=_forget)
    elif status.state in client.FINAL:
        _finished(info, status)
    else:
        _live(identifier)


def _forget() -> None:
    st.session_state.pop("design", None)
    st.session_state.pop("status", None)
    st.query_params.pop("design", None)


def _current() -> models.DesignStatus | None:
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
        _fill(status.spec)
    st.session_state["form_of"] = identifier
    return status


# ------------------------------------------------------------------------------------------- form


def _fill(spec: models.DesignSpec) -> None:
    """Put a request into the form, for one who comes back to a design."""
    given = spec.model_dump()
    state = st.session_state
    for i in "12":
        by_set = given[f"stiffness_set_{i}"] is not None
        state[f"form:by_{i}"] = BY_SET if by_set else BY_INDEX
        key = f"stiffness_set_{i}" if by_set else f"deformation_index_{i}"
        state[f"form:{key}"] = given[key]
        state[f"form:deformation_index_std_{i}"] = given[f"deformation_index_std_{i}"]
        state[f"form:radius_{i}_um"] = given[f"radius_{i}_um"]
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
        "seed",
        "verify",
        "name",
    ):
        state[f"form:{name}"] = given[name]


def _form(info: models.ModelInfo, status: models.DesignStatus | None) -> None:
    fields = {f.name: f for f in info.fields}
    with st.expander(
        "Request", expanded=status is None or status.state == "failed", icon=":material/tune:"
    ):
        spec: dict[str, Any] = {}
        for i, column in zip("12", st.columns(2), strict=True):
            with column.container(border=True):
                spec |= _cell(i, info, fields)
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


def _cell(
    i: str, info: models.ModelInfo, fields: Mapping[str, models.FieldLimit]
) -> dict[str, Any]:
    """Fields of one cell type."""
    colour = ("blue", "orange")[int(i) - 1]
    st.markdown(f"**:{colour}[Cell type {i}]**")
    low, high = info.deformation_index_range
    sets = {s.stiffness_set: s for s in info.stiffness_sets}
    # a set of the campaign may have been measured outside of what was learnt from
    usable = sorted(
        (s for s in sets.values() if low <= s.deformation_index <= high),
        key=lambda s: s.deformation_index,
    )
    kind = BY_INDEX
    st.session_state.setdefault(f"form:by_{i}", BY_INDEX)
    if usable:
        kind = st.radio(
            "given by",
            (BY_INDEX, BY_SET),
            key=f"form:by_{i}",
            horizontal=True,
            label_visibility="collapsed",
        )
    left, right = st.columns(2)
    found: dict[str, Any] = {}
    with left:
        if kind == BY_SET:
            names = [s.stiffness_set for s in usable]
            key = f"form:stiffness_set_{i}"
            if st.session_state.get(key) not in names:
                st.session_state[key] = names[0 if i == "1" else -1]
            found[f"stiffness_set_{i}"] = st.selectbox(
                "Stiffness set",
                names,
                key=key,
                help="A membrane of the campaign.",
                format_func=lambda n: f"{n} (DI {sets[n].deformation_index:.4f})",
            )
            at_field("design", f"stiffness_set_{i}")
        else:
            ends = (ceil(low * 1e4) / 1e4, floor(high * 1e4) / 1e4)
            found[f"deformation_index_{i}"] = number(
                fields[f"deformation_index_{i}"],
                "Deformation index",
                f"form:deformation_index_{i}",
                ends[int(i) - 1],
                about="As measured in the default assay, mean of the cell type",
            )
            st.caption(f"learnt from {low:.4f} to {high:.4f}")
            at_field("design", f"deformation_index_{i}")
    with right:
        spread = 0.0
        if kind == BY_SET:
            spread = sets[found[f"stiffness_set_{i}"]].deformation_index_std or 0.0
        found[f"deformation_index_std_{i}"] = number(
            fields[f"deformation_index_std_{i}"],
            "± among cells",
            f"form:deformation_index_std_{i}",
            None,
            empty=f"{spread:.4f}, as calibrated" if kind == BY_SET else "0",
            about="Standard deviation of the deformation index among cells of this type",
        )
        at_field("design", f"deformation_index_std_{i}")
    found[f"radius_{i}_um"] = number(
        fields[f"radius_{i}_um"],
        "Cell radius R",
        f"form:radius_{i}_um",
        fields[f"radius_{i}_um"].default,
        about="Largest radius of the cell at rest",
    )
    st.caption(
        f"allowed {parts.allowed(fields[f'radius_{i}_um'])}; simulated with "
        f"{info.cell['radius_um']:g} µm, other radii by similarity"
    )
    at_field("design", f"radius_{i}_um")
    return found


def _bounds(info: models.ModelInfo, fields: Mapping[str, models.FieldLimit]) -> dict[str, Any]:
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
        st.caption(
            f"P_g must exceed P_r by {info.safety_distance_um:g} µm (safety distance); "
            f"channel height {info.flow['height_um']:g} µm and mean velocity "
            f"{info.flow['mean_velocity_mm_s']:g} mm/s are those of the simulations."
        )
    return found


def _options(info: models.ModelInfo, fields: Mapping[str, models.FieldLimit]) -> dict[str, Any]:
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
        state.setdefault("form:verify", False)
        found["verify"] = st.toggle(
            "Simulate the best designs afterwards",
            key="form:verify",
            help=plain(fields["verify"].description),
        )
        if found["verify"]:
            put("height_tolerance_um", "Tolerance of the channel height ±")
    with third:
        st.markdown("**Search**")
        if found["sampler"] == "tpe":
            put("trials", "Trials", high=info.limits.get("trials_max"), whole=True, slider=True)
            put("startup_trials", "of which random at first", whole=True)
        else:
            put("grid_steps", "Values of P_r and of P_g", whole=True, slider=True)
        if found["objective"] == "robust":
            put("draws", "Monte Carlo draws", whole=True)
        put("candidates", "Candidates to report", whole=True, slider=True)
        put("seed", "Seed", whole=True)
        state.setdefault("form:name", fields["name"].default)
        found["name"] = st.text_input(
            "Name of the request",
            key="form:name",
            max_chars=40,
            help=plain(fields["name"].description),
        )
    return found


def _look_ahead(info: models.ModelInfo, spec: Mapping[str, Any]) -> None:
    """The request in the training domain, before it is sent."""
    low, high = info.deformation_index_range
    by_set = {s.stiffness_set: s for s in info.stiffness_sets}
    cells = []
    for i in (1, 2):
        index, spread = spec.get(f"deformation_index_{i}"), spec[f"deformation_index_std_{i}"]
        if index is None:
            at = by_set[spec[f"stiffness_set_{i}"]]
            index = at.deformation_index
            spread = at.deformation_index_std if spread is None else spread
        cells.append((index, spread))
        if not low <= index <= high:
            st.warning(
                f"The deformation index {index:.4f} of cell type {i} is outside the "
                f"simulated range, {low:.4f} to {high:.4f}: the service will refuse it."
            )
    ratios = [[g[k] for g in info.domain["geometries"]] for k in range(3)]
    beyond = []
    for k, name in enumerate(BOUNDS):
        for i in (1, 2):
            scale = spec[f"radius_{i}_um"] if k < 2 else 1.0
            ends = [v / scale for v in spec[name]]
            if ends[0] < min(ratios[k]) * (1 - 1e-9) or ends[1] > max(ratios[k]) * (1 + 1e-9):
                beyond.append(BOUNDS[name])
    if beyond:
        st.info(
            "The bounds of " + ", ".join(dict.fromkeys(beyond)) + " reach beyond the arrays "
            "learnt from. The search looks inside first; a candidate outside is flagged as "
            "extrapolated and ranked behind.",
            icon=":material/info:",
        )
    with st.expander("The request in the training domain"):
        chart(
            charts.domain(info.domain["geometries"], spec),
            "domain-ahead",
            "arrays learnt from and the bounds of the request",
        )
        chart(
            charts.index_strip((low, high), cells),
            "strip-ahead",
            "deformation indices of both cell types in the range learnt from",
        )


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
    if status.state in client.FINAL:
        st.rerun()
    progress = status.progress
    if status.state == "queued":
        before = status.queue_position
        st.subheader("Waiting")
        st.write("Next in the queue." if not before else f"{before} jobs are before this one.")
    else:
        st.subheader("Searching" if progress.stage == "search" else "Writing the files")
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
        _metrics(best.model_dump())
        if not best.inside_training_domain:
            st.warning("The best so far lies outside the arrays learnt from.")
    if progress.convergence:
        chart(
            charts.convergence(progress.convergence, status.spec.objective, progress.trials),
            "live",
            "best value after each trial",
        )


def _metrics(best: Mapping[str, Any], uncertainty: float | None = None) -> None:
    error = "" if uncertainty is None else f" ± {uncertainty:.2f}"
    parts.metrics(
        (
            ("P_r, pillar radius", f"{best['pillar_radius_um']:.2f} µm"),
            ("P_g, gap", f"{best['gap_um']:.2f} µm"),
            ("N_p, periodicity", f"{best['periodicity']}"),
            ("|Δθ|, predicted", f"{best['separation_deg']:.2f}{error}°"),
            ("θ₁ and θ₂", f"{best['angle_1_deg']:.2f}°, {best['angle_2_deg']:.2f}°"),
        )
    )


# --------------------------------------------------------------------------------------- finished


def _finished(info: models.ModelInfo, status: models.DesignStatus) -> None:
    if status.state == "failed":
        st.error(
            f"**The search failed.** {plain(status.error or 'No reason was given.')}",
            icon=":material/error:",
        )
        return
    if status.result is None:
        st.info(
            "The search was cancelled before it had a result."
            if status.state == "cancelled"
            else "There is no result.",
            icon=":material/cancel:",
        )
        return
    result = status.result
    designs = [d.model_dump() for d in result.designs]
    trials = [t.model_dump() for t in result.trials]
    st.header(f"Result “{status.spec.name}”")
    seconds = result.seconds
    st.caption(
        f"Search {seconds.get('search', 0):.1f} s of {sum(seconds.values()):.1f} s in all "
        f"(" + ", ".join(f"{k} {v:.1f}" for k, v in seconds.items()) + " s). "
        "The address of this page brings you back to it."
    )
    about = status.provenance
    if about is not None:
        if about.model_sha256 != info.provenance.model_sha256:
            st.warning(
                "This result was made with another campaign than the one chosen at the side.",
                icon=":material/database:",
            )
        parts.provenance(about)
    parts.warn(w for w in result.warnings if about is None or w not in about.warnings)
    best = designs[0]
    _metrics(best, best["uncertainty_deg"])
    said = plain("; ".join([best["verdict"], *best["notes"]]))
    st.markdown(
        f"Candidate 1: **{said}**. Predicted, not simulated"
        + ("." if status.verification.state != "done" else "; simulations are below.")
    )
    st.subheader("Ranked candidates")
    frame(
        [d | {"mode_change_probability": 100 * d["mode_change_probability"]} for d in designs],
        CANDIDATE_COLUMNS,
        "candidates",
    )
    st.caption(
        "± 90 %: half-width of the prediction interval. Robust: exceeded by nine of ten "
        "draws of cells, tolerance and prediction error; negative: the order of the cell "
        "types is open. Equal ranks differ by less than σ_num. Empty: not known. "
        f"Pressure: {plain(best['pressure_basis'])}."
    )
    chosen = 1
    if len(designs) > 1:
        chosen = (
            st.segmented_control(
                "Look at candidate",
                [d["design"] for d in designs],
                default=1,
                required=True,
                key=f"candidate-{status.id}",
            )
            or 1
        )
    design = next(d for d in designs if d["design"] == chosen)
    _candidate(
        status, design, [t.model_dump() for t in result.tolerances if t.design == design["design"]]
    )
    _downloads(status, design["design"])
    _search(status, designs, trials)
    _in_domain(info, result.request, designs)
    _verification(status)


def _candidate(status: models.DesignStatus, design: Mapping[str, Any], tolerances: list) -> None:
    request = status.result.request
    st.markdown("**Array to scale, with the predicted mean directions**")
    chart(
        charts.array(design, (request["radius_1_um"], request["radius_2_um"])),
        "array",
        "pillars of the candidate with the mean directions of both cell types",
    )
    st.caption(
        "Lines: predicted mean direction of each cell type from a common start; shaded: its "
        "90 % interval. The way from row to row is not predicted. Discs have the radii of "
        "the cells."
    )
    left, right = st.columns(2)
    with left:
        frame(
            [
                {
                    "cell": f"type {i}",
                    "angle": design[f"angle_{i}_deg"],
                    "low": design[f"angle_{i}_low_deg"],
                    "high": design[f"angle_{i}_high_deg"],
                    "mode": design[f"mode_{i}"],
                }
                for i in (1, 2)
            ],
            {
                "cell": ("cell", ""),
                "angle": ("θ [°]", "%.2f"),
                "low": ("90 % from [°]", "%.2f"),
                "high": ("to [°]", "%.2f"),
                "mode": ("mode", ""),
            },
            "angles",
        )
    with right:
        st.markdown(
            plain(
                f"Over ± {request['tolerance_um']:g} µm on P_r and P_g the separation is "
                f"{_shown(design['separation_tolerance_min_deg'])} to "
                f"{_shown(design['separation_tolerance_max_deg'])}; a mode changes in "
                f"{design['mode_change_probability']:.0%} of the draws. "
                f"Length {_shown(design['length_mm'], ' mm', '.3g')} for "
                f"{request['lateral_separation_um']:g} µm between the cell types, pressure "
                f"drop {_shown(design['pressure_drop_kPa'], ' kPa', '.3g')}, flow "
                f"{design['throughput_uL_per_h']:.0f} µL/h."
            )
        )
    if not design["inside_training_domain"]:
        st.warning(
            "This candidate is extrapolated: it lies outside the arrays learnt from.",
            icon=":material/warning:",
        )
    if tolerances:
        st.markdown("**Tolerances: one thing off at a time**")
        left, right = st.columns(2)
        with left:
            chart(
                charts.tornado(tolerances, design["separation_deg"]),
                "tornado",
                "separation with one thing off at a time",
            )
            st.caption("Black: as wanted. Negative: the order of the cell types is reversed.")
        with right:
            frame(
                [
                    {**r, "parameter": charts.PLAIN.get(r["parameter"], r["parameter"])}
                    for r in tolerances
                ],
                {
                    "parameter": ("off", ""),
                    "offset": ("by [µm or 1]", "%+.3g"),
                    "separation_deg": ("|Δθ| [°]", "%.2f"),
                    "angle_1_deg": ("θ₁ [°]", "%.2f"),
                    "angle_2_deg": ("θ₂ [°]", "%.2f"),
                    "mode_1": ("mode 1", ""),
                    "mode_2": ("mode 2", ""),
                    "sensitivity_deg_per_unit": ("slope [° per unit]", "%.3g"),
                },
                "tolerances",
            )


def _shown(value: float | None, unit: str = "°", form: str = ".2f") -> str:
    return "not known" if value is None else f"{value:{form}}{unit}"


def _downloads(status: models.DesignStatus, candidate: int) -> None:
    st.subheader("Downloads")
    groups = [(f"Candidate {candidate}", [f for f in status.files if f.candidate == candidate])]
    groups += [
        (f"Simulated design {n}", [f for f in status.files if f.verified == n])
        for n in sorted({f.verified for f in status.files} - {None})
    ]
    groups += [("Report", [f for f in status.files if f.kind == "report"])]
    if not status.files:
        st.write("There are no files.")
    for title, files in groups:
        if not files:
            continue
        with st.container(horizontal=True, vertical_alignment="center"):
            st.markdown(f"**{title}**", width=170)
            for file in sorted(files, key=lambda f: list(MIME).index(f.kind)):
                label = FILE_NAMES.get(file.kind, "Report (HTML)")
                st.download_button(
                    f"{label}, {_size(file.bytes)}",
                    _fetch(file),
                    file.name,
                    MIME[file.kind],
                    key=f"file-{status.id}-{file.name}",
                    on_click="ignore",
                    icon=":material/download:",
                    help=plain(f"{file.name}, SHA-256 {file.sha256}"),
                )


def _fetch(file: models.FileInfo):
    return lambda: client.content(file)


def _size(count: int) -> str:
    return f"{count / 1e6:.1f} MB" if count >= 1e6 else f"{max(count / 1e3, 0.1):.1f} kB"


def _search(status: models.DesignStatus, designs: list, trials: list) -> None:
    """How the search went, and what it says of the parameters."""
    result, objective = status.result, status.spec.objective
    st.subheader("The search")
    left, right = st.columns([3, 2])
    with left:
        st.markdown("**Convergence**")
        grid = status.spec.sampler == "grid"
        chart(
            charts.convergence(result.convergence, objective, trials=[] if grid else trials),
            "convergence",
            "value of each trial and the best so far",
        )
        infeasible = sum(not t["feasible"] for t in trials)
        words = []
        if infeasible:
            words.append(
                f"{infeasible} of {len(trials)} trials violate a constraint and are not drawn."
            )
        if objective == "robust":
            words.append(
                "Below zero the order of the cell types is open; the value is then a "
                "share of the draws' range, not an angle."
            )
        st.caption(" ".join(words))
    with right:
        st.markdown("**Importance for the objective**")
        rows = [r.model_dump() for r in result.importance]
        if any(r["importance"] is not None for r in rows):
            chart(charts.importance(rows), "importance", "importance of each parameter")
        else:
            st.write("The values of the trials do not differ: no importance.")
        if rows:
            st.caption("Evaluator: " + plain(rows[0]["evaluator"]))
    st.markdown("**Parallel coordinates of the feasible trials**")
    same = [t["trial"] for t in trials if all(t[k] == designs[0][k] for k in BOUNDS)]
    chart(
        charts.parallel(trials, objective, same[0] if same else None),
        "parallel",
        "feasible trials over all parameters and the objective",
    )
    st.caption("Each line is a trial, yellow: good, blue: poor. Black: candidate 1.")
    st.markdown("**Predicted difference over two parameters**")
    first, second = st.columns(2)
    names = list(BOUNDS)
    x = first.selectbox("along x", names, format_func=BOUNDS.get, key="form:surface_x")
    others = [n for n in names if n != x]
    if st.session_state.get("form:surface_y") not in others:
        st.session_state["form:surface_y"] = others[0]
    y = second.selectbox("along y", others, format_func=BOUNDS.get, key="form:surface_y")
    [third] = [n for n in names if n not in (x, y)]
    chart(
        charts.surface([s.model_dump() for s in result.slices], x, y, designs),
        "surface",
        "predicted difference of the angles over two parameters",
    )
    st.caption(
        f"{BOUNDS[third]} as in candidate 1 ({designs[0][third]:g}). Hatched: outside "
        "the arrays learnt from, extrapolated. Grey: against a constraint. Stars: "
        f"candidates; hollow: with another {BOUNDS[third]}."
    )


def _in_domain(info: models.ModelInfo, request: Mapping[str, Any], designs: list) -> None:
    st.subheader("The request in the training domain")
    chart(
        charts.domain(info.domain["geometries"], request, designs),
        "domain",
        "arrays learnt from, bounds of the request and candidates",
    )
    st.caption(
        "Lengths in units of the cell radius R. These are projections: what lies inside all "
        "three may still lie outside the hull of the arrays learnt from; the candidates' "
        "flag decides."
    )
    chart(
        charts.index_strip(
            info.deformation_index_range,
            [
                (request[f"deformation_index_{i}"], request[f"deformation_index_std_{i}"])
                for i in (1, 2)
                if request[f"deformation_index_{i}"] is not None
            ],
        ),
        "strip",
        "deformation indices in the range learnt from",
    )


def _verification(status: models.DesignStatus) -> None:
    st.subheader("Verification by simulation")
    state = status.verification.state
    if state in ("waiting", "queued", "running"):
        _verdict_pending(status.id)
    elif state == "not-wanted":
        st.write("Not asked for. Switch on *Simulate the best designs afterwards* in the request.")
    elif state == "failed":
        st.error("**The simulation failed.** " + plain(status.verification.message))
    elif state == "cancelled":
        st.info("The simulation was cancelled.")
    else:
        _verdict(status.verification)


@st.fragment(run_every=VERDICT_POLL_S)
def _verdict_pending(identifier: str) -> None:
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


def _verdict(found: models.Verdict) -> None:
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
        chart(charts.verdicts(rows), "verdicts", "predicted interval and simulated difference")
