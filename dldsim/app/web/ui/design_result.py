"""The answer to a design request: candidates, outlets, files, course of the search."""

from collections.abc import Mapping
from typing import Any

import streamlit as st

from dldsim.app.web.api import answers
from dldsim.app.web.ui import (
    candidate_charts,
    chart_style,
    client,
    in_domain,
    outcome_page,
    outlets_chapter,
    parts,
    search_charts,
    verdict_chapter,
)
from dldsim.app.web.ui.client import ApiError
from dldsim.app.web.ui.design_form import BOUNDS
from dldsim.app.web.ui.parts import chart, frame, plain
from dldsim.vocabulary import together

FILES_POLL_S = 0.7
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
    "purity_recovery": ("purity, recovery ≥", "%.0f %%"),
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


def metrics(best: Mapping[str, Any], uncertainty: float | None = None) -> None:
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


def show(info: answers.ModelInfo, status: answers.DesignStatus) -> None:
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
    metrics(best, best["uncertainty_deg"])
    said = plain("; ".join([best["verdict"], *best["notes"]]))
    st.markdown(
        f"Candidate 1: **{said}**. Predicted, not simulated"
        + ("." if status.verification.state != "done" else "; simulations are below.")
    )
    st.subheader("Ranked candidates")
    shares = outlets_chapter.smallest(result.at_outlets)
    frame(
        [
            d
            | {
                "mode_change_probability": 100 * d["mode_change_probability"],
                "purity_recovery": shares.get(outlets_chapter.device(status.spec.name, d)),
            }
            for d in designs
        ],
        CANDIDATE_COLUMNS,
        "candidates",
    )
    st.caption(
        "± 90 %: half-width of the prediction interval. Robust: exceeded by nine of ten "
        "draws of cells, tolerance and prediction error; negative: the order of the cell "
        "types is open. Equal ranks differ by less than σ_num. Empty: not known. "
        f"Pressure: {plain(together([d['pressure_basis'] for d in designs]))}."
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
    if result.at_outlets is not None:
        name = outlets_chapter.device(status.spec.name, design)
        outlets_chapter.show(result.at_outlets, name, status.id)
        outlets_chapter.notes(result.at_outlets)
        _to_outcome(status, design, name)
    _downloads(status, design["design"])
    _search(status, designs, trials)
    _in_domain(info, result.request, designs)
    verdict_chapter.show(status)


def _to_outcome(status: answers.DesignStatus, design: dict[str, Any], device: str) -> None:
    """Take a candidate to the page where its device can be changed and its cells simulated."""
    rows = [row for row in status.result.at_outlets.device_outcomes if row.device == device]
    length = rows[0].array_length_mm if rows else None
    outlets = [row for row in status.result.at_outlets.device_outlets if row.device == device]
    wall = rows[0].cut_um if rows and len(outlets) == 2 else None
    # fields can be filled before the page is drawn alone, which is when a click is taken
    pressed = st.button(
        "Change or simulate it on the page Outcome",
        icon=":material/call_split:",
        on_click=outcome_page.take,
        args=(status.spec, design, length, wall),
    )
    if pressed:
        st.switch_page(st.Page(outcome_page.page, url_path="outcome"))


def _candidate(status: answers.DesignStatus, design: Mapping[str, Any], tolerances: list) -> None:
    request = status.result.request
    st.markdown("**Array to scale, with the predicted mean directions**")
    chart(
        candidate_charts.array(design, (request["radius_1_um"], request["radius_2_um"])),
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
                candidate_charts.tornado(tolerances, design["separation_deg"]),
                "tornado",
                "separation with one thing off at a time",
            )
            st.caption("Black: as wanted. Negative: the order of the cell types is reversed.")
        with right:
            frame(
                [
                    {**r, "parameter": chart_style.PLAIN.get(r["parameter"], r["parameter"])}
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


def _downloads(status: answers.DesignStatus, candidate: int) -> None:
    st.subheader("Downloads")
    if status.state not in client.FINAL:
        _files_pending(status.id)
        return
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


@st.fragment(run_every=FILES_POLL_S)
def _files_pending(identifier: str) -> None:
    try:
        found = client.design(identifier)
    except ApiError as error:
        parts.show(error)
        return
    if found.state in client.FINAL:
        st.rerun()
    st.write("Masks and report are being written.")


def _fetch(file: answers.FileInfo):
    return lambda: client.content(file)


def _size(count: int) -> str:
    return f"{count / 1e6:.1f} MB" if count >= 1e6 else f"{max(count / 1e3, 0.1):.1f} kB"


def _search(status: answers.DesignStatus, designs: list, trials: list) -> None:
    """How the search went, and what it says of the parameters."""
    result, objective = status.result, status.spec.objective
    st.subheader("The search")
    left, right = st.columns([3, 2])
    with left:
        st.markdown("**Convergence**")
        grid = status.spec.sampler == "grid"
        chart(
            search_charts.convergence(result.convergence, objective, trials=[] if grid else trials),
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
            chart(search_charts.importance(rows), "importance", "importance of each parameter")
        else:
            st.write("The values of the trials do not differ: no importance.")
        if rows:
            st.caption("Evaluator: " + plain(rows[0]["evaluator"]))
    st.markdown("**Parallel coordinates of the feasible trials**")
    same = [t["trial"] for t in trials if all(t[k] == designs[0][k] for k in BOUNDS)]
    chart(
        search_charts.parallel(trials, objective, same[0] if same else None),
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
        search_charts.surface([s.model_dump() for s in result.slices], x, y, designs),
        "surface",
        "predicted difference of the angles over two parameters",
    )
    st.caption(
        f"{BOUNDS[third]} as in candidate 1 ({designs[0][third]:g}). Hatched: outside "
        "the arrays learnt from, extrapolated. Grey: against a constraint. Stars: "
        f"candidates; hollow: with another {BOUNDS[third]}."
    )


def _in_domain(info: answers.ModelInfo, request: Mapping[str, Any], designs: list) -> None:
    st.subheader("The request in the training domain")
    in_domain.show(info, request, "done", designs)
    st.caption(
        "Lengths in units of the cell radius R. These are projections: what lies inside all "
        "three may still lie outside the hull of the arrays learnt from; the candidates' "
        "flag decides."
    )
