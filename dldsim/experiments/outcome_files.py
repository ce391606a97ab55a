"""Tables of one simulation: what of a result is written, where, and when it may be used again."""

import shutil
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from dldsim.config import identifiers
from dldsim.config.provenance import provenance
from dldsim.errors import DldsimError
from dldsim.tables.parquet import describe, read_columns, read_rows, write_table
from dldsim.tables.registry import schema

Progress = Callable[[str], None]
"""Takes a sentence about what is going on."""


def flow_row(result) -> dict:
    """Row of `flows` of an EmptyFlow."""
    from dldsim.experiments.streamlines import critical_follower

    follower = critical_follower(result)
    return {
        "stop_reason": "the mean velocity is steady",
        **result.summary(),
        "follower_diameter_um": None if follower is None else follower * result.geometry.gap_um,
    }


class OutcomeFiles(NamedTuple):
    """Tables of one outcome: row of `outcomes`, its `runs`, `trajectory` of all releases."""

    outcome: Path
    runs: Path
    trajectory: Path


def write_outcome(result, files: OutcomeFiles, settings: Mapping) -> None:
    """Write the tables of an OutcomeResult, its row last."""
    about = provenance(settings)
    write_table("trajectory", result.trajectory(), files.trajectory, about)
    write_table("runs", result.rows(), files.runs, about)
    write_table("outcomes", [{**NOT_JOINED, **result.row}], files.outcome, about)


NOT_JOINED = {
    "deformation_index": None,
    "deformation_index_std": None,
    "sigma_num_deg": None,
    "sigma_num_kind": "not joined yet",
    "mode_open": None,
    "sigma_num_basis": "not joined yet",
}
"""Columns of `outcomes` that are filled when the outcomes are gathered."""


def write_run(result, row: Path, trajectory: Path, settings: Mapping) -> None:
    """Write the two tables of a RunResult."""
    write_table("trajectory", result.trajectory, trajectory, provenance(settings))
    write_table("runs", [result.row], row, provenance(settings))


class Measured(NamedTuple):
    """One passage of an assay: row of `assay_runs`, columns of `assay_trajectory`."""

    row: dict
    trajectory: dict


def write_assay_runs(
    results: Iterable[Measured], rows: Path, trajectory: Path, settings: Mapping
) -> None:
    """Write the two tables of the passages of a point, its rows last."""
    about = provenance(settings)
    names = schema("assay_trajectory").names
    path = {name: [v for r in results for v in r.trajectory[name]] for name in names}
    write_table("assay_trajectory", path, trajectory, about)
    write_table("assay_runs", [r.row for r in results], rows, about)


def made_with(path: Path, digest: str) -> bool:
    """Whether a table exists, is readable, of this physics, and made with these settings."""
    try:
        about = describe(path)
        read_columns(about["kind"], path)
    except DldsimError:
        return False
    return about["provenance"]["config_hash"] == digest


class Partial:
    """Finished releases of an outcome under way, in a folder of their own until it is written.

    A stop then costs at most the release under way. What was made with other settings is not used.
    """

    def __init__(self, directory: Path, outcome: str, settings: Mapping):
        self.directory, self.outcome, self.about = Path(directory), outcome, provenance(settings)

    def _files(self, place: float) -> tuple[Path, Path, Path]:
        name = identifiers.run_id(self.outcome, place)
        return (
            self.directory / f"{name}.run.parquet",
            self.directory / f"{name}.trajectory.parquet",
            self.directory / f"{name}.cell.npz",
        )

    def keep(self, place: float, result) -> None:
        """Write a RunResult; its row last, which says that all of it is there."""
        from dldsim.experiments.settled import save

        row, trajectory, cell = self._files(place)
        save({place: result.cell} if result.cell else {}, cell)
        write_table("trajectory", result.trajectory, trajectory, self.about)
        write_table("runs", [result.row], row, self.about)

    def finished(self, places: Iterable[float]) -> dict[float, Any]:
        """The RunResults that are there, by place."""
        from dldsim.experiments.array_run import RunResult
        from dldsim.experiments.settled import load

        found = {}
        for place in places:
            row, trajectory, cell = self._files(place)
            if all(made_with(path, self.about["config_hash"]) for path in (row, trajectory)):
                columns = read_columns("trajectory", trajectory)
                path = {name: columns[name].to_numpy() for name in columns.column_names}
                left = load(cell).get(place) if cell.exists() else None
                found[place] = RunResult(read_rows("runs", row)[0], path, left)
        return found

    def remove(self) -> None:
        shutil.rmtree(self.directory, ignore_errors=True)
