"""One simulation, its files: what the campaign's jobs and the commands share.

In a campaign a failure (a DldsimError, or memory that is exhausted) becomes a row of status
"failed"; see :mod:`dldsim.config.campaign`. Any other exception is a bug: the job ends with its
traceback, and what depends on it is not made.
"""

import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dldsim.analysis import uncertainty
from dldsim.config import campaign, identifiers
from dldsim.config.provenance import provenance
from dldsim.config.sections import CellShape, Flow, Numerics, RunControl, Stiffness
from dldsim.errors import DldsimError
from dldsim.experiments.outcome_files import (
    OutcomeFiles,
    Partial,
    Progress,
    flow_row,
    write_outcome,
)
from dldsim.files import atomic_path
from dldsim.tables.parquet import read_rows, write_table
from dldsim.tables.registry import COLUMNS


def flow_job(
    identifier: str, settings: Mapping, *, flow: Path, row: Path, crashes: Path, progress: Progress
) -> None:
    """Empty-array flow of one geometry: `flow` (.npz) and its row of `flows`."""
    geometry = identifiers.parse_geometry(identifier)

    def simulate() -> None:
        from dldsim.solver.flow import solve_empty_array

        result = solve_empty_array(
            geometry, Flow(**settings["flow"]), Numerics(**settings["numerics"]), progress
        )
        write_table("flows", [flow_row(result)], row, provenance(settings))
        result.save(flow)

    def give_up(reason: str) -> None:
        known = {
            **geometry.model_dump(),
            "pitch_um": geometry.pitch_um,
            "height_um": settings["flow"]["height_um"],
            "drive": settings["flow"]["drive"],
        }
        write_table("flows", [failed("flows", known, reason)], row, provenance(settings))
        with atomic_path(flow) as part, part.open("wb") as file:
            np.savez(file)

    attempt(identifier, simulate, give_up, crashes, progress)


def outcome_job(
    identifier: str,
    settings: Mapping,
    *,
    flow: Path,
    flow_row: Path,
    files: OutcomeFiles,
    partial: Path,
    crashes: Path,
    progress: Progress,
) -> None:
    """One outcome: as many releases as it takes; finished ones wait in `partial`."""
    kept = Partial(partial, identifier, settings)

    def empty_flow():
        [start] = read_rows("flows", flow_row)
        if start["status"] == "failed":
            raise DldsimError(f"The flow without a cell failed: {start['stop_reason']}")
        from dldsim.solver.flow import EmptyFlow

        return EmptyFlow.load(flow)

    if attempt_outcome(
        identifier,
        settings,
        settings,
        empty_flow=empty_flow,
        files=files,
        kept=kept,
        job=identifier,
        crashes=crashes,
        progress=progress,
    ):
        kept.remove()


def attempt_outcome(
    identifier: str,
    sections: Mapping,
    settings: Mapping,
    *,
    empty_flow: Callable[[], Any],
    files: OutcomeFiles,
    kept: Partial,
    job: str,
    crashes: Path,
    progress: Progress,
) -> bool:
    """Simulate an outcome and write its tables; whether that went well. If not, they say why.

    ``sections``: what is simulated; ``settings``: what the tables say they were made with.
    ``empty_flow`` gives the flow without a cell, or None where it is solved when it is needed.
    """
    pair = identifiers.parse_outcome(identifier)
    control = RunControl(**sections["run_control"])
    parts = (
        pair.geometry,
        Stiffness(**sections["stiffness"]),
        CellShape(**sections["cell"]),
        Flow(**sections["flow"]),
        Numerics(**sections["numerics"]),
    )

    def simulate() -> None:
        start = empty_flow()
        from dldsim.experiments.array_outcome import simulate_outcome

        result = simulate_outcome(
            *parts,
            control,
            outcome_id=identifier,
            stiffness_set=pair.stiffness_set,
            empty_flow=start,
            keep=kept.keep,
            progress=progress,
            finished=kept.finished(control.release_gap_fractions),
        )
        write_outcome(result, files, settings)

    def give_up(reason: str) -> None:
        from dldsim.experiments.array_run import known_of

        geometry, stiffness, *rest = parts
        known = known_of(identifier, geometry, stiffness, pair.stiffness_set, *rest)
        done = kept.finished(control.release_gap_fractions).values()
        known |= {
            "mode": "none",
            "sigma_num_kind": uncertainty.NO_ANGLE,
            "sigma_num_basis": uncertainty.NO_ANGLE,
            "left_out": "",
            "releases": len(done),
            "rows_total": sum(r.row["rows_completed"] for r in done),
        }
        about = provenance(settings)
        write_table("trajectory", empty("trajectory"), files.trajectory, about)
        write_table("runs", [r.row for r in done] or empty("runs"), files.runs, about)
        write_table("outcomes", [failed("outcomes", known, reason)], files.outcome, about)

    return attempt(job, simulate, give_up, crashes, progress)


def attempt(
    identifier: str,
    simulate: Callable[[], None],
    give_up: Callable[[str], None],
    crashes: Path,
    progress: Progress,
) -> bool:
    """Simulate; log and count a failure that is none of the program, and write what stands for the
    result. Anything else is a bug, which ends the job with its traceback. Whether it went well."""
    try:
        simulate()
        return True
    except (DldsimError, MemoryError) as error:
        expected = isinstance(error, DldsimError)
        reason = str(error) if expected else f"{type(error).__name__}: {error}"
        progress(reason if expected else traceback.format_exc())
        campaign.record_crash(crashes, identifier, reason)
        give_up(reason)
        return False


def failed(kind: str, known: Mapping, reason: str) -> dict:
    """The row that stands for a result that there is none of."""
    blank = {column.name: None for column in COLUMNS[kind] if column.nullable}
    return {**blank, **known, "status": "failed", "stop_reason": reason}


def empty(kind: str) -> dict:
    """Columns without rows."""
    return {column.name: [] for column in COLUMNS[kind]}
