"""One simulation, one pair of files: what the campaign's jobs and the commands share.

In a campaign a crash (an exception) becomes a row of status "failed"; see :mod:`dldsim.campaign`.
"""

import contextlib
import json
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from dldsim import accuracy, campaign
from dldsim.config import (
    Cell,
    Config,
    Constriction,
    ConstrictionGroup,
    Flow,
    Geometry,
    Numerics,
    RunControl,
    Stiffness,
)
from dldsim.errors import DldsimError
from dldsim.tables import COLUMNS, atomic_path, read_rows, write_csv, write_table

Progress = Callable[[str], None]

@contextlib.contextmanager
def job_log(path: Path) -> Iterator[Progress]:
    """Send everything printed to a log file; a DldsimError ends the job without a traceback."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    console = sys.stderr
    with path.open("w", encoding="utf-8", buffering=1) as log:
        with contextlib.redirect_stdout(log), contextlib.redirect_stderr(log):
            try:
                yield _writer(log)
            except DldsimError as error:
                log.write(f"{error}\n")
                console.write(f"{error}\n")
                raise SystemExit(1) from None
            except Exception:
                log.write(traceback.format_exc())
                raise


def _writer(log: TextIO) -> Progress:
    start = time.perf_counter()

    def progress(sentence: str) -> None:
        log.write(f"{time.perf_counter() - start:8.1f} s  {sentence}\n")

    return progress


def provenance(settings: Mapping[str, Any], seed: int | None = None) -> dict:
    """Metadata of a file that depends on these settings and this seed."""
    settings = dict(settings)
    return {"config_hash": campaign.settings_hash(settings), "seed": seed, "settings": settings}


def flow_job(identifier: str, settings: Mapping, *, flow: Path, row: Path, crashes: Path,
             progress: Progress) -> None:
    """Empty-array flow of one geometry: `flow` (.npz) and its row of `flows`."""
    geometry = campaign.parse_geometry(identifier)

    def simulate() -> None:
        from dldsim.flow import solve_empty_array

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


def flow_row(result) -> dict:
    """Row of `flows` of an EmptyFlow."""
    return {"stop_reason": "the mean velocity is steady", **result.summary()}


def run_job(identifier: str, settings: Mapping, *, flow: Path, flow_row: Path, row: Path,
            trajectory: Path, crashes: Path, progress: Progress) -> None:
    """One run of the campaign: `row` of `runs`, and its `trajectory`."""
    run = campaign.parse_run(identifier)

    def simulate() -> None:
        [start] = read_rows("flows", flow_row)
        if start["status"] == "failed":
            raise DldsimError(f"The flow without a cell failed: {start['stop_reason']}")
        from dldsim.flow import EmptyFlow
        from dldsim.simulation import simulate_run

        result = simulate_run(
            run.geometry, Stiffness(**settings["stiffness"]), Cell(**settings["cell"]),
            Flow(**settings["flow"]), Numerics(**settings["numerics"]),
            RunControl(**settings["run_control"]), run_id=identifier,
            stiffness_set=run.stiffness_set, empty_flow=EmptyFlow.load(flow), progress=progress,
        )  # fmt: skip
        write_run(result, row, trajectory, settings)

    def give_up(reason: str) -> None:
        write_failed_run(identifier, settings, reason, row, trajectory)

    _attempt(identifier, simulate, give_up, crashes, progress)


def write_run(result, row: Path, trajectory: Path, settings: Mapping) -> None:
    """Write the two tables of a RunResult."""
    write_table("trajectory", result.trajectory, trajectory, provenance(settings))
    write_table("runs", [{**NOT_JOINED, **result.row}], row, provenance(settings))


NOT_JOINED = {"deformation_index": None, "deformation_index_std": None, "sigma_num_deg": None,
              "sigma_num_basis": "not joined yet"}
"""Columns of `runs` that are filled when the runs are gathered."""


def accuracy_job(identifier: str, settings: Mapping, *, row: Path, crashes: Path,
                 progress: Progress) -> None:
    """One run of the accuracy study: its row of `runs` or `constriction_runs`."""
    variant = accuracy.parse_variant(identifier)
    kind = accuracy.kind_of(variant)
    cell, flow = Cell(**settings["cell"]), Flow(**settings["flow"])
    numerics = Numerics(**settings["numerics"])

    def simulate() -> None:
        if kind == "runs":
            from dldsim.simulation import simulate_run

            result = simulate_run(
                Geometry(**settings["geometry"]), Stiffness(**settings["stiffness"]), cell, flow,
                numerics, RunControl(**settings["run_control"]), run_id=identifier,
                stiffness_set=settings["stiffness_set"], progress=progress,
            )  # fmt: skip
            result = {**NOT_JOINED, **result.row}
        else:
            from dldsim.constriction import simulate_constriction

            result = simulate_constriction(
                variant.run, ConstrictionGroup(**settings["group"]),
                Constriction(**settings["constriction"]), cell, flow, numerics,
                release_position_um=settings["release_position_um"], run_id=identifier,
                progress=progress,
            ).row
        write_table(kind, [result], row, provenance(settings))

    def give_up(reason: str) -> None:
        if kind == "runs":
            known = _known_of_run(identifier, Geometry(**settings["geometry"]), settings)
        else:
            known = _known_of_constriction(identifier, variant.run, settings)
        write_table(kind, [_failed(kind, known, reason)], row, provenance(settings))

    _attempt(identifier, simulate, give_up, crashes, progress)


def gather_accuracy(rows: Iterable[tuple[str, Path]], config: Config, settings: Mapping, *,
                    table: Path, model: Path, classes: Path, runs: Path) -> None:
    """Tables and model of the accuracy study from its runs (variant, file of its row)."""
    found = []
    for identifier, path in rows:
        variant = accuracy.parse_variant(identifier)
        found.append((variant, read_rows(accuracy.kind_of(variant), path)[0]))
    points, fitted, checked = accuracy.study(found, config)
    about = provenance(settings)
    for kind, content, path in (
        ("accuracy", points, table), ("sigma_num", accuracy.class_rows(fitted), classes),
        ("sigma_num_runs", checked, runs),
    ):  # fmt: skip
        write_table(kind, content, path, about)
        write_csv(kind, path)
    with atomic_path(model) as part:
        part.write_text(json.dumps(fitted, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def write_failed_run(identifier: str, settings: Mapping, reason: str, row: Path,
                     trajectory: Path) -> None:
    """Write the tables of a run that crashed."""
    run = campaign.parse_run(identifier)
    named = {**settings, "stiffness_set": run.stiffness_set}
    known = _known_of_run(identifier, run.geometry, named)
    write_table("trajectory", _empty("trajectory"), trajectory, provenance(settings))
    write_table("runs", [_failed("runs", known, reason)], row, provenance(settings))


def _known_of_run(identifier: str, geometry: Geometry, settings: Mapping) -> dict:
    """Columns of `runs` that do not need a simulation."""
    cell = Cell(**settings["cell"])
    return {
        "run_id": identifier,
        **geometry.model_dump(),
        "pitch_um": geometry.pitch_um,
        "row_shift_fraction": geometry.row_shift_fraction,
        "stiffness_set": settings["stiffness_set"],
        "cell_shape": cell.shape,
        "cell_radius_um": cell.radius_um,
        "height_um": settings["flow"]["height_um"],
        **settings["stiffness"],
        "mean_velocity_mm_s": settings["flow"]["mean_velocity_mm_s"],
        "mode": "none",
        "sigma_num_basis": "no angle",
        "bump_angle_deg": float(np.degrees(np.arctan(geometry.row_shift_fraction))),
        "rows_completed": 0,
        "orbit_rows": 0,
        "lateral_steps_um": [],
        "confinement": 2 * cell.radius_um / geometry.gap_um,
        "left_out": "",
        "numerics": json.dumps(settings["numerics"]),
    }


def constriction_job(identifier: str, settings: Mapping, *, row: Path, trajectory: Path,
                     crashes: Path, progress: Progress) -> None:
    """One constriction run: `row` of `constriction_runs`, and its `trajectory`."""
    name, _, design = campaign.parse_constriction(identifier)
    group = ConstrictionGroup(**settings["group"])
    channel = Constriction(**settings["constriction"])
    release = settings["release_position_um"]

    def simulate() -> None:
        from dldsim.constriction import simulate_constriction

        result = simulate_constriction(
            name, group, channel, Cell(**settings["cell"]), Flow(**settings["flow"]),
            Numerics(**settings["numerics"]), release_position_um=release, run_id=identifier,
            progress=progress,
        )  # fmt: skip
        result.row["design"] = design
        write_constriction(result, row, trajectory, settings)

    def give_up(reason: str) -> None:
        known = _known_of_constriction(identifier, name, settings) | {"design": design}
        kind = "constriction_runs"
        write_table("constriction_trajectory", _empty("constriction_trajectory"), trajectory,
                    provenance(settings))
        write_table(kind, [_failed(kind, known, reason)], row, provenance(settings))

    _attempt(identifier, simulate, give_up, crashes, progress)


def _known_of_constriction(identifier: str, name: str, settings: Mapping) -> dict:
    """Columns of `constriction_runs` that do not need a simulation."""
    group = ConstrictionGroup(**settings["group"])
    return {
        "run_id": identifier,
        "group": name,
        "stiffness_set": group.stiffness_set or "",
        **group.stiffness.model_dump(include={"ks_uN_per_m", "kb_pN_um", "kal_uN_per_m"}),
        "velocity_mm_s": group.velocity_mm_s,
        "design": campaign.GROUP_VELOCITY,
        "release_position_um": settings["release_position_um"],
    }


def write_constriction(result, row: Path, trajectory: Path, settings: Mapping) -> None:
    """Write the two tables of a ConstrictionResult."""
    about = provenance(settings)
    write_table("constriction_trajectory", result.trajectory, trajectory, about)
    write_table("constriction_runs", [result.row], row, about)


def validation_job(case: str, settings: Mapping, *, table: Path, crashes: Path,
                   progress: Progress) -> None:
    """Run one validation case and write its rows; a case that raises is counted as a crash."""
    from dldsim.validation import BROKEN, run_case

    rows = run_case(case, progress)
    if rows[-1]["quantity"] == BROKEN:
        progress(rows[-1]["note"])
        campaign.record_crash(crashes, case, rows[-1]["note"])
    write_table("validation", rows, table, provenance(settings))


def _attempt(identifier: str, simulate: Callable[[], None], give_up: Callable[[str], None],
             crashes: Path, progress: Progress) -> None:
    """Simulate; on an exception log it, count it, and write what stands for the result."""
    try:
        simulate()
    except Exception as error:
        expected = isinstance(error, DldsimError)
        reason = str(error) if expected else f"{type(error).__name__}: {error}"
        progress(reason if expected else traceback.format_exc())
        campaign.record_crash(crashes, identifier, reason)
        give_up(reason)


def _failed(kind: str, known: Mapping, reason: str) -> dict:
    blank = {column.name: None for column in COLUMNS[kind] if column.nullable}
    return {**blank, **known, "status": "failed", "stop_reason": reason}


def _empty(kind: str) -> dict:
    return {column.name: [] for column in COLUMNS[kind]}
