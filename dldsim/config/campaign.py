"""What a campaign consists of: geometries, outcomes, crash records, closing sentence.

Rule files import this module in every job, so it imports nothing heavy.
"""

import csv
import os
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path

from dldsim.config.configuration import Config
from dldsim.config.feasibility import check_gap
from dldsim.config.identifiers import Pair, geometry_id, outcome_id
from dldsim.config.sections import Geometry
from dldsim.errors import DldsimError
from dldsim.files import atomic_path, why_not_written
from dldsim.vocabulary import BROKEN


def geometries(config: Config) -> list[Geometry]:
    """The geometries of the sweep, in order of their identifiers."""
    return sorted(_feasible(config), key=geometry_id)


def _feasible(config: Config) -> Iterator[Geometry]:
    sweep = config.sweep
    for radius in sweep.pillar_radius_um:
        for gap in sweep.gaps_for(radius):
            for periodicity in sweep.periodicity:
                geometry = Geometry(pillar_radius_um=radius, gap_um=gap, periodicity=periodicity)
                try:
                    check_gap(geometry, sweep.safety_distance_um)
                except DldsimError:
                    if sweep.skip_infeasible:
                        continue
                    raise
                yield geometry


def outcomes(config: Config) -> list[Pair]:
    """The pairs of array and cell of the sweep, in order of their identifiers."""
    sets = config.sweep.stiffness_sets
    return sorted((Pair(g, s) for g in geometries(config) for s in sets), key=outcome_id)


def import_from(folder: Path) -> None:
    """Let child processes import the package from here, whichever environment they run in."""
    others = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    paths = dict.fromkeys(path for path in (str(folder), *others) if path)
    os.environ["PYTHONPATH"] = os.pathsep.join(paths)


def quote_interpreter() -> None:
    """Let Snakemake start an interpreter whose path has a blank: it calls it unquoted."""
    if not sys.executable.startswith("'"):
        sys.executable = shlex.quote(sys.executable)


def check_writable(directory: Path) -> None:
    """Refuse a folder in which nothing can be written, before any job fails on it."""
    try:
        with atomic_path(Path(directory) / ".writable") as part:
            part.write_bytes(b"\n")
        (Path(directory) / ".writable").unlink()
    except OSError as error:
        reason = why_not_written(error) or error
        folder = Path(directory).resolve()
        raise DldsimError(f"Folder {folder} cannot be written: {reason}") from None


def closing_sentence(directory: Path) -> str:
    """Where the results are, which outcomes have no angle or an open one, and which validation
    cases fail."""
    sentence = f"Done: {directory}/"
    if rows := _read_csv(Path(directory) / "outcomes.csv"):
        broken = [
            f"{row['outcome_id']} ({row['status']}: {row['stop_reason']})"
            for row in rows
            if row["status"] in BROKEN
        ]
        sentence += (
            f", all {len(rows)} outcomes."
            if not broken
            else (
                f", but {len(broken)} of {len(rows)} outcomes have no angle:\n  "
                + "\n  ".join(broken)
            )
        )
        for status, meaning in (
            ("undecided", "had not settled when their rows were spent"),
            ("coexisting", "depend on the place where the cell enters"),
        ):
            if count := sum(row["status"] == status for row in rows):
                sentence += f"\n{count} of {len(rows)} are {status}: they {meaning}."
    if rows := _read_csv(Path(directory) / "validation.csv"):
        failing = sorted({row["case"] for row in rows if row["passed"] == "false"})
        cases = len({row["case"] for row in rows})
        sentence += f"\nValidation: {cases - len(failing)} of {cases} cases pass."
        if failing:
            sentence += f" Failing, see {directory}/validation.csv: {', '.join(failing)}."
    if spent := time_split(directory):
        total = sum(spent.values())
        most = ", ".join(
            f"{rule} {seconds / total:.0%}"
            for rule, seconds in spent.items()
            if seconds >= total / 100
        )
        sentence += f"\nTime of all jobs together: {total / 60:.1f} minutes ({most})."
    return sentence


def time_split(directory: Path) -> dict[str, float]:
    """Seconds that the jobs of each rule took when they were last run, largest first."""
    spent: dict[str, float] = {}
    for path in (Path(directory) / "benchmarks").rglob("*.tsv"):
        rule = path.relative_to(Path(directory) / "benchmarks").parts[0].removesuffix(".tsv")
        with path.open(encoding="utf-8", newline="") as file:
            rows = csv.DictReader(file, delimiter="\t")
            spent[rule] = spent.get(rule, 0.0) + sum(float(row["s"]) for row in rows)
    return dict(sorted(spent.items(), key=lambda item: -item[1]))


def _read_csv(path: Path) -> list[dict]:
    """Rows of a table's CSV twin, none if it does not exist."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


# A crash is a DldsimError in a simulation, or memory that is exhausted, as against a physical
# failure, which is a result, and a bug, which ends the job. The job then writes a row of status
# "failed", so that the campaign goes on and reports it, and counts the crash in a file that is no
# output of any rule. The count is a parameter of the job's rule: it has changed at the next start
# of Snakemake, which therefore tries again. It never goes down, so a run that has recovered is left
# alone.


DAMAGED = -1
"""A number of crashes that no record holds, so that the job is tried again."""


def count_crashes(directory: Path, identifier: str) -> int:
    """How often the job has crashed so far; DAMAGED if the record cannot be read."""
    path = Path(directory) / f"{identifier}.txt"
    try:
        return int(path.read_text(encoding="utf-8").split(maxsplit=1)[0])
    except FileNotFoundError:
        return 0
    except (OSError, ValueError, IndexError):
        return DAMAGED


def record_crash(directory: Path, identifier: str, reason: str) -> None:
    """Count one more crash of the job and keep its reason."""
    count = max(count_crashes(directory, identifier), 0) + 1
    with atomic_path(Path(directory) / f"{identifier}.txt") as part:
        part.write_text(f"{count}\n{reason}\n", encoding="utf-8")
