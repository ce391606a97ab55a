"""Jobs of the survey: plans and points in, tables out.

Finished releases of a point are kept for good: a plan that is made anew, because an earlier point
was, mostly has the same points.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from dldsim.analysis import survey
from dldsim.analysis.uncertainty import read_models, with_uncertainty
from dldsim.app.jobs import attempt_outcome
from dldsim.config.configuration import sections_from
from dldsim.config.identifiers import parse_outcome
from dldsim.config.provenance import provenance, settings_hash
from dldsim.config.sections import Flow, Numerics, Stiffness
from dldsim.errors import DldsimError
from dldsim.experiments.outcome_files import OutcomeFiles, Partial, Progress, flow_row, made_with
from dldsim.tables.parquet import concatenate, read_many, read_rows, write_csv, write_table

Row = Mapping[str, Any]


def plan_job(round_: int, settings: Mapping, *, outcomes: Iterable[Path], table: Path) -> None:
    """`survey_plan` of one round, from the outcomes of all earlier ones."""
    known = [row for path in outcomes for row in read_rows("outcomes", path)]
    rows = survey.plan(round_, sections_from(settings), known, settings["seed"])
    write_table("survey_plan", rows, table, provenance(settings))


def point_of(number: int, plan: Path) -> Row:
    """Row of `survey_plan` of one point."""
    [row] = [row for row in read_rows("survey_plan", plan) if row["number"] == number]
    return row


def sentence(point: Row) -> str:
    """What is simulated at a point."""
    return (
        f"point {point['number']:04d}, round {point['round']}: {point['cell_shape']} of R = "
        f"{point['cell_radius_um']:g} µm, Ca = {point['capillary_number']:.3g}; P_r = "
        f"{point['pillar_radius_um']:g}, P_g = {point['gap_um']:g}, height "
        f"{point['height_um']:g} µm, N_p = {point['periodicity']}"
    )


def sections_of(point: Row, settings: Mapping) -> dict[str, Any]:
    """Sections that a point is simulated with: what it has of its own, and the survey's."""
    flow = {key: point[key] for key in ("mean_velocity_mm_s", "height_um")}
    return {
        **settings,
        "cell": {
            **settings["cell"],
            "shape": point["cell_shape"],
            "radius_um": point["cell_radius_um"],
        },
        "flow": {**settings["flow"], **flow},
        "stiffness": {name: point[name] for name in Stiffness.model_fields},
    }


def point_job(
    point: Row,
    settings: Mapping,
    *,
    files: OutcomeFiles,
    flow: Path,
    releases: Path,
    crashes: Path,
    progress: Progress,
) -> None:
    """One point: its outcome, and its row of `flows` in `flow`, which has none if that failed.

    A failure becomes a row of status failed.
    """
    name = point["outcome_id"]
    sections = sections_of(point, settings)
    kept = Partial(Path(releases) / name, name, sections)
    kept_flow = kept.directory / "flow.parquet"

    def empty_flow():
        if made_with(kept_flow, settings_hash(sections)):
            return None
        from dldsim.solver.flow import solve_empty_array

        geometry = parse_outcome(name).geometry
        parts = Flow(**sections["flow"]), Numerics(**sections["numerics"])
        solved = solve_empty_array(geometry, *parts, progress)
        write_table("flows", [flow_row(solved)], kept_flow, provenance(sections))
        return solved

    attempt_outcome(
        name,
        sections,
        settings,
        empty_flow=empty_flow,
        files=files,
        kept=kept,
        job=f"{point['number']:04d}",
        crashes=crashes,
        progress=progress,
    )
    done = made_with(kept_flow, settings_hash(sections))
    write_table("flows", read_rows("flows", kept_flow) if done else [], flow, provenance(settings))


def gather(
    parts: Mapping[str, Sequence[Path]], settings: Mapping, *, tables: Mapping[str, Path]
) -> None:
    """One table of each kind from its parts, in order; outcomes with σ_num."""
    if not parts["outcomes"]:
        raise DldsimError(
            key="survey.shapes",
            value="nothing",
            allowed="one or more shapes",
            remedy="See the section survey of config.yaml.",
        )
    about = provenance(settings)
    for kind, table in tables.items():
        if kind == "outcomes":
            outcomes = with_uncertainty(read_many(kind, parts[kind]), read_models())
            write_table(kind, outcomes, table, about)
        else:
            concatenate(kind, parts[kind], table, about)
        write_csv(kind, table)
