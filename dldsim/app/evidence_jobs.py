"""Jobs of the accuracy study and of the validation."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from dldsim.app.assay_jobs import passages_of_point
from dldsim.app.jobs import attempt, failed
from dldsim.config import campaign
from dldsim.config.assay_sections import GROUP_VELOCITY
from dldsim.config.configuration import sections_from
from dldsim.config.provenance import provenance
from dldsim.config.sections import Cell, Flow, Geometry, Numerics, RunControl, Stiffness
from dldsim.evidence import accuracy
from dldsim.experiments.outcome_files import Progress
from dldsim.tables.parquet import read_rows, write_csv, write_table


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
                probe=False,
                progress=progress,
            )
        else:
            result = passage(progress)
        write_table(kind, [result.row], row, provenance(settings))

    def give_up(reason: str) -> None:
        write_table(kind, [failed(kind, known, reason)], row, provenance(settings))

    if kind == "runs":
        known = _known_of_run(identifier, variant.run, settings)
    else:
        [(known, passage)] = passages_of_point(GROUP_VELOCITY, identifier, settings)
    attempt(identifier, simulate, give_up, crashes, progress)


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
        **dict.fromkeys(("lateral_steps_um", "probe_offsets", "probe_steps"), []),
        "left_out": "",
    }


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
