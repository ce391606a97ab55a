"""What a campaign consists of: identifiers, geometries, outcomes, seeds, crash records.

Rule files import this module in every job, so it imports nothing heavy.
"""

import csv
import hashlib
import json
import os
import re
import shlex
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from dldsim import PHYSICS_VERSION, __version__
from dldsim.config.sections import Config, Geometry, check_gap, in_force, preset_of, validate
from dldsim.errors import DldsimError
from dldsim.files import atomic_path, why_not_written

GEOMETRY_PATTERN = r"r\d\d+\.\d+_g\d\d+\.\d+_n\d\d+"
OUTCOME_PATTERN = GEOMETRY_PATTERN + r"_s[A-Za-z0-9-]+"
RUN_PATTERN = OUTCOME_PATTERN + r"_y\d\.\d\d+"


class Pair(NamedTuple):
    """What an outcome is of: a geometry and the name of a stiffness set."""

    geometry: Geometry
    stiffness_set: str


def _length(value: float) -> str:
    """At least two digits before the point and one after it: tenths of µm sort like numbers."""
    whole, decimals = f"{value:.3f}".split(".")
    return f"{whole:0>2}.{decimals.rstrip('0') or '0'}"


def _format(geometry: Geometry) -> str:
    radius, gap = _length(geometry.pillar_radius_um), _length(geometry.gap_um)
    return f"r{radius}_g{gap}_n{geometry.periodicity:02d}"


def geometry_id(geometry: Geometry) -> str:
    """Identifier such as r06.0_g18.0_n08. Raises DldsimError for more than three decimals."""
    text = _format(geometry)
    if parse_geometry(text) != geometry:
        raise DldsimError(
            f"No identifier for pillar_radius_um = {geometry.pillar_radius_um!r}, gap_um = "
            f"{geometry.gap_um!r}: lengths may have three decimals. Round them."
        )
    return text


def parse_geometry(text: str) -> Geometry:
    """The inverse of `geometry_id`."""
    if re.fullmatch(GEOMETRY_PATTERN, text):
        radius, gap, periodicity = (part[1:] for part in text.split("_"))
        geometry = validate(Geometry, {
            "pillar_radius_um": float(radius), "gap_um": float(gap), "periodicity": int(periodicity)
        })
        if _format(geometry) == text:
            return geometry
    raise DldsimError(f"{text!r} is not a geometry identifier such as r06.0_g18.0_n08.")


def outcome_id(pair: Pair) -> str:
    """Identifier such as r06.0_g18.0_n08_s3."""
    if not re.fullmatch(r"[A-Za-z0-9-]+", pair.stiffness_set):
        raise DldsimError(
            f"Stiffness set {pair.stiffness_set!r}: a name has letters, digits and hyphens only."
        )
    return f"{geometry_id(pair.geometry)}_s{pair.stiffness_set}"


def parse_outcome(text: str) -> Pair:
    """The inverse of `outcome_id`."""
    geometry, found, name = text.rpartition("_s")
    if not found or not re.fullmatch(OUTCOME_PATTERN, text):
        raise DldsimError(f"{text!r} is not an outcome identifier such as r06.0_g18.0_n08_s3.")
    return Pair(parse_geometry(geometry), name)


def run_id(outcome: str, release_gap_fraction: float) -> str:
    """Identifier of one release of an outcome, such as r06.0_g18.0_n08_s3_y0.50.

    Raises DldsimError for a place outside 0 to 1 or of more than three decimals.
    """
    whole, decimals = f"{release_gap_fraction:.3f}".split(".")
    text = f"{whole}.{decimals[:2]}{decimals[2:].rstrip('0')}"
    if not 0 <= release_gap_fraction <= 1 or float(text) != release_gap_fraction:
        raise DldsimError(
            f"No identifier for release_gap_fraction = {release_gap_fraction!r}: a place is 0 to "
            "1, of at most three decimals. Round it."
        )
    return f"{outcome}_y{text}"


def parse_run(text: str) -> tuple[str, float]:
    """The inverse of `run_id`: outcome identifier and place of release."""
    outcome, _, place = text.rpartition("_y")
    if re.fullmatch(RUN_PATTERN, text) and float(place) <= 1:
        parse_outcome(outcome)
        if run_id(outcome, float(place)) == text:
            return outcome, float(place)
    raise DldsimError(f"{text!r} is not a run identifier such as r06.0_g18.0_n08_s3_y0.50.")


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


GROUP_VELOCITY, FIXED_VELOCITY = "group-velocity", "fixed-velocity"
"""Designs of the calibration: each group at its own velocity (the source paper's), all at one."""
CONSTRICTION_PATTERN = r"[A-Za-z0-9-]+_(?:fixed_)?\d+"


def constriction_id(group: str, position: int, design: str = GROUP_VELOCITY) -> str:
    """Identifier such as G1_0, or G1_fixed_0 at fixed velocity; `position` counts the releases."""
    return f"{group}_{'fixed_' if design == FIXED_VELOCITY else ''}{position}"


def parse_constriction(text: str) -> tuple[str, int, str]:
    """The inverse of `constriction_id`."""
    if not re.fullmatch(CONSTRICTION_PATTERN, text):
        raise DldsimError(f"{text!r} is not a constriction run identifier such as G1_0.")
    group, *fixed, position = text.split("_")
    return group, int(position), FIXED_VELOCITY if fixed else GROUP_VELOCITY


def constrictions(config: Config) -> list[str]:
    """Identifiers of all constriction runs."""
    channel = config.constriction
    designs = [GROUP_VELOCITY] + [FIXED_VELOCITY] * (channel.fixed_velocity_mm_s is not None)
    return [constriction_id(g, i, design) for design in designs
            for g in config.constriction_groups for i in range(len(channel.release_positions_um))]


def derive_seed(seed: int, name: str) -> int:
    """A seed for one named task of a campaign, below 2³¹."""
    digest = hashlib.sha256(f"{seed}/{name}".encode()).digest()
    return int.from_bytes(digest[:4], "big") >> 1


def settings_hash(settings: Mapping[str, Any]) -> str:
    """Short hash of the settings that a file depends on."""
    text = json.dumps(settings, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def provenance(settings: Mapping[str, Any], seed: int | None = None) -> dict:
    """Metadata of a file that depends on these settings and this seed."""
    settings = dict(settings)
    return {"config_hash": settings_hash(settings), "seed": seed, "settings": settings}


def origins(layers: Mapping[str, Mapping]) -> str:
    """What the configuration was made of, in a sentence: sources by name, the lowest first."""
    preset = preset_of(layers.values())
    lowest, *others = layers
    sentence = f"Configuration: {lowest}, preset {preset}"
    for name in others:
        keys = dict.fromkeys(key for part in in_force(layers[name], preset)
                             for key in flattened(part))
        keys |= {"preset": None} if "preset" in layers[name] else {}
        if keys:
            sentence += f"; over it {name}: {', '.join(keys)}"
    return f"{sentence}."


def flattened(values: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    """Values by dotted key."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, Mapping) and value:
            flat |= flattened(value, f"{above}{key}.")
        else:
            flat[f"{above}{key}"] = value
    return flat


def import_from(folder: Path) -> None:
    """Let child processes import the package from here, whichever environment they run in."""
    others = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    paths = dict.fromkeys(path for path in (str(folder), *others) if path)
    os.environ["PYTHONPATH"] = os.pathsep.join(paths)


def quote_interpreter() -> None:
    """Let Snakemake start an interpreter whose path has a blank: it calls it unquoted."""
    if not sys.executable.startswith("'"):
        sys.executable = shlex.quote(sys.executable)


STAMP = ".dldsim.json"


def stamp() -> dict:
    """Versions that a results folder is stamped with."""
    return {"dldsim_version": __version__, "physics_version": PHYSICS_VERSION}


def write_stamp(directory: Path) -> None:
    """Stamp a results folder with the versions that fill it."""
    with atomic_path(Path(directory) / STAMP) as part:
        part.write_text(json.dumps(stamp()) + "\n", encoding="utf-8")


def check_stamp(directory: Path) -> None:
    """Refuse a results folder of another physics version."""
    path = Path(directory) / STAMP
    if not path.exists():
        return
    try:
        made_by = json.loads(path.read_text(encoding="utf-8"))
        physics, version = made_by["physics_version"], made_by["dldsim_version"]
    except (ValueError, KeyError, TypeError) as error:
        raise DldsimError(
            f"{path} is damaged, so that the physics version of what lies in {directory}/ is not "
            f"known. If it is this one ({PHYSICS_VERSION}), delete {path} alone, and all results "
            f"are used. Otherwise: mv {directory} {directory}-old."
        ) from error
    if physics != PHYSICS_VERSION:
        raise DldsimError(
            f"{directory} holds results of physics version {physics} (dldsim {version}); this is "
            f"version {PHYSICS_VERSION} (dldsim {__version__}), whose trajectories differ. To keep "
            f"the old results: mv {directory} {directory}-physics{physics}. To make everything "
            "anew in place: snakemake -j2 all --forceall."
        )


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
        broken = [f"{row['outcome_id']} ({row['status']}: {row['stop_reason']})" for row in rows
                  if row["status"] in ("stuck", "unstable", "failed")]
        sentence += f", all {len(rows)} outcomes." if not broken else (
            f", but {len(broken)} of {len(rows)} outcomes have no angle:\n  "
            + "\n  ".join(broken))
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
        most = ", ".join(f"{rule} {seconds / total:.0%}" for rule, seconds in spent.items()
                         if seconds >= total / 100)
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
