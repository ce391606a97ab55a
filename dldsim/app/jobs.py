"""One simulation, its files: what the campaign's jobs and the commands share.

In a campaign a failure (a DldsimError, or memory that is exhausted) becomes a row of status
"failed"; see :mod:`dldsim.config.campaign`. Any other exception is a bug: the job ends with its
traceback, and what depends on it is not made.
"""

import contextlib
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from pydantic import TypeAdapter

from dldsim.analysis import uncertainty
from dldsim.config import campaign, identifiers
from dldsim.config.assay_sections import GROUP_VELOCITY, Assay, TableAssay
from dldsim.config.assays import Membrane, passages_of
from dldsim.config.configuration import sections_from
from dldsim.config.provenance import provenance
from dldsim.config.sections import Cell, CellShape, Flow, Geometry, Numerics, RunControl, Stiffness
from dldsim.errors import DldsimError
from dldsim.evidence import accuracy
from dldsim.experiments.outcome_files import (
    Measured,
    OutcomeFiles,
    Partial,
    Progress,
    flow_row,
    write_assay_runs,
    write_outcome,
)
from dldsim.files import atomic_path, why_not_written
from dldsim.tables.parquet import read_many, read_rows, write_csv, write_table
from dldsim.tables.registry import COLUMNS


@contextlib.contextmanager
def job_log(path: Path) -> Iterator[Progress]:
    """Send everything printed to a log file.

    What the user can mend (a DldsimError, a full disk, a folder that is closed) and an interruption
    end the job without a traceback.
    """
    console = sys.stderr
    try:
        with _logged(Path(path)) as progress:
            yield progress
    except KeyboardInterrupt:
        raise SystemExit(INTERRUPTED) from None
    except DldsimError as error:
        console.write(f"{error}\n")
        raise SystemExit(1) from None
    except OSError as error:
        if (reason := why_not_written(error)) is None:
            raise
        console.write(f"{reason}\n")
        raise SystemExit(1) from None


INTERRUPTED = 130
"""Exit code of a process that Ctrl-C has ended."""


@contextlib.contextmanager
def _logged(path: Path) -> Iterator[Progress]:
    path.parent.mkdir(parents=True, exist_ok=True)
    with (
        path.open("w", encoding="utf-8", buffering=1) as log,
        contextlib.redirect_stdout(log),
        contextlib.redirect_stderr(log),
    ):
        try:
            yield _writer(log)
        except KeyboardInterrupt:
            log.write("interrupted\n")
            raise
        except DldsimError as error:
            log.write(f"{error}\n")
            raise
        except Exception as error:
            reason = why_not_written(error) if isinstance(error, OSError) else None
            log.write(f"{reason}\n" if reason else traceback.format_exc())
            raise


def _writer(log: TextIO) -> Progress:
    start = time.perf_counter()

    def progress(sentence: str) -> None:
        log.write(f"{time.perf_counter() - start:8.1f} s  {sentence}\n")

    return progress


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
        write_table("flows", [_failed("flows", known, reason)], row, provenance(settings))
        with atomic_path(flow) as part, part.open("wb") as file:
            np.savez(file)

    _attempt(identifier, simulate, give_up, crashes, progress)


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
        write_table("trajectory", _empty("trajectory"), files.trajectory, about)
        write_table("runs", [r.row for r in done] or _empty("runs"), files.runs, about)
        write_table("outcomes", [_failed("outcomes", known, reason)], files.outcome, about)

    return _attempt(job, simulate, give_up, crashes, progress)


def accuracy_job(
    identifier: str, settings: Mapping, *, row: Path, crashes: Path, progress: Progress
) -> None:
    """One run of the accuracy study: its row of `runs` or `constriction_runs`."""
    variant = accuracy.parse_variant(identifier)
    kind = accuracy.kind_of(variant)

    def simulate() -> None:
        if kind == "runs":
            from dldsim.experiments.array_run import simulate_run

            result = simulate_run(
                Geometry(**settings["geometry"]),
                Stiffness(**settings["stiffness"]),
                Cell(**settings["cell"]),
                Flow(**settings["flow"]),
                Numerics(**settings["numerics"]),
                RunControl(**settings["run_control"]),
                run_id=identifier,
                outcome_id=variant.run,
                stiffness_set=settings["stiffness_set"],
                progress=progress,
            )
        else:
            result = passage(progress)
        write_table(kind, [result.row], row, provenance(settings))

    def give_up(reason: str) -> None:
        write_table(kind, [_failed(kind, known, reason)], row, provenance(settings))

    if kind == "runs":
        known = _known_of_run(identifier, variant.run, settings)
    else:
        [(known, passage)] = passages_of_point(GROUP_VELOCITY, identifier, settings)
    _attempt(identifier, simulate, give_up, crashes, progress)


def gather_accuracy(rows: Iterable[tuple[str, Path]], settings: Mapping, *, table: Path) -> None:
    """Table of the accuracy study from its runs (variant, file of its row)."""
    found = []
    for identifier, path in rows:
        variant = accuracy.parse_variant(identifier)
        found.append((variant, read_rows(accuracy.kind_of(variant), path)[0]))
    compared = accuracy.table(found, sections_from(settings))
    write_table("accuracy", compared, table, provenance(settings))
    write_csv("accuracy", table)


def _known_of_run(identifier: str, outcome: str, settings: Mapping) -> dict:
    """Columns of `runs` that do not need a simulation."""
    from dldsim.experiments.array_run import known_of

    cell = Cell(**settings["cell"])
    known = known_of(
        outcome,
        Geometry(**settings["geometry"]),
        Stiffness(**settings["stiffness"]),
        settings["stiffness_set"],
        cell,
        Flow(**settings["flow"]),
        Numerics(**settings["numerics"]),
    )
    return known | {
        "run_id": identifier,
        "release_gap_fraction": cell.release_gap_fraction,
        "mode": "none",
        "rows_completed": 0,
        "orbit_rows": 0,
        "lateral_steps_um": [],
        "left_out": "",
    }


def assay_job(
    identifier: str,
    settings: Mapping,
    *,
    rows: Path,
    trajectory: Path,
    crashes: Path,
    progress: Progress,
) -> None:
    """One point of a calibration: `rows` of `assay_runs`, one for each passage, and `trajectory`.

    A passage that fails is a row of status failed; the others count.
    """
    found: list[Measured] = []
    name = identifiers.parse_point(identifier).assay
    for known, simulate in passages_of_point(name, identifier, settings):

        def give_up(reason: str, known=known) -> None:
            nothing = _empty("assay_trajectory")
            found.append(Measured(_failed("assay_runs", known, reason), nothing))

        _attempt(
            identifier,
            lambda simulate=simulate: found.append(simulate(progress)),
            give_up,
            crashes,
            progress,
        )
    write_assay_runs(found, rows, trajectory, settings)


def passages_of_point(
    name: str, identifier: str, settings: Mapping
) -> list[tuple[dict, Callable[[Progress | None], Measured]]]:
    """The passages of a point: what is known of each, and the call that simulates it."""
    from dldsim.experiments.assays import known_of, simulate_passage

    assay = TypeAdapter(Assay).validate_python(settings["assay"])
    given = settings["membrane"]
    membrane = Membrane(**{**given, "stiffness": Stiffness(**given["stiffness"])})
    cell, flow = CellShape(**settings["cell"]), Flow(**settings["flow"])
    about = name, assay, membrane, cell
    parts = []
    for number, passage in enumerate(passages_of(assay, cell.shape)):
        run = f"{identifier}_{number}"
        known = known_of(*about, flow.viscosity_mPa_s, passage, run)

        def simulate(progress: Progress | None, passage=passage, run=run) -> Measured:
            numerics = Numerics(**settings["numerics"])
            return simulate_passage(*about, flow, numerics, passage, run_id=run, progress=progress)

        parts.append((known, simulate))
    return parts


def published(settings: Mapping) -> dict:
    """Published pairs of index and stiffness set, with the moduli of the sets, by assay."""
    sets = {name: Stiffness(**values) for name, values in settings["stiffness_sets"].items()}
    return {name: (TableAssay(**pairs), sets) for name, pairs in settings["published"].items()}


def write_curves(
    kind: str, rows: Iterable[Path], settings: Mapping, *, table: Path, figure: Path | None = None
) -> None:
    """Calibrations from the passages of some points, with a figure of them if one is asked for."""
    from dldsim.analysis.passages import calibrate

    runs = read_many("assay_runs", rows)
    curves = calibrate(runs, settings["default_assay"], published(settings))
    write_table(kind, curves, table, provenance(settings))
    write_csv(kind, table)
    if figure is not None:
        from dldsim.report.assay_figures import draw_curves
        from dldsim.report.style import render

        with atomic_path(Path(figure)) as part:
            part.write_bytes(render(draw_curves(curves), "png"))


def validation_job(
    case: str, settings: Mapping, *, table: Path, crashes: Path, progress: Progress
) -> None:
    """Run one validation case and write its rows; a case that raises is counted as a crash."""
    from dldsim.evidence.validation import BROKEN, run_case

    rows = run_case(case, progress)
    if rows[-1]["quantity"] == BROKEN:
        progress(rows[-1]["note"])
        campaign.record_crash(crashes, case, rows[-1]["note"])
    write_table("validation", rows, table, provenance(settings))


def _attempt(
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


def _failed(kind: str, known: Mapping, reason: str) -> dict:
    blank = {column.name: None for column in COLUMNS[kind] if column.nullable}
    return {**blank, **known, "status": "failed", "stop_reason": reason}


def _empty(kind: str) -> dict:
    return {column.name: [] for column in COLUMNS[kind]}
