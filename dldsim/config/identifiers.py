"""Names of geometries, outcomes, runs and constriction runs: each formatter with its parser."""

import re
from typing import NamedTuple

from dldsim.config.explain import validate
from dldsim.config.sections import Geometry
from dldsim.errors import DldsimError

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


def _no_identifier(of: str, text: str, example: str) -> DldsimError:
    return DldsimError(
        f"{text!r} is not {of} identifier such as {example}.", value=text, allowed=example
    )


def geometry_id(geometry: Geometry) -> str:
    """Identifier such as r06.0_g18.0_n08. Raises DldsimError for more than three decimals."""
    text = _format(geometry)
    if parse_geometry(text) != geometry:
        raise DldsimError(
            f"No identifier for pillar_radius_um = {geometry.pillar_radius_um!r}, gap_um = "
            f"{geometry.gap_um!r}: lengths may have three decimals.",
            key=("pillar_radius_um", "gap_um"),
            value=(geometry.pillar_radius_um, geometry.gap_um),
            allowed="at most three decimals",
            remedy="Round them.",
        )
    return text


def parse_geometry(text: str) -> Geometry:
    """The inverse of `geometry_id`."""
    if re.fullmatch(GEOMETRY_PATTERN, text):
        radius, gap, periodicity = (part[1:] for part in text.split("_"))
        geometry = validate(
            Geometry,
            {
                "pillar_radius_um": float(radius),
                "gap_um": float(gap),
                "periodicity": int(periodicity),
            },
        )
        if _format(geometry) == text:
            return geometry
    raise _no_identifier("a geometry", text, "r06.0_g18.0_n08")


def outcome_id(pair: Pair) -> str:
    """Identifier such as r06.0_g18.0_n08_s3."""
    if not re.fullmatch(r"[A-Za-z0-9-]+", pair.stiffness_set):
        raise DldsimError(
            f"Stiffness set {pair.stiffness_set!r}: a name has letters, digits and hyphens only.",
            key="stiffness_set",
            value=pair.stiffness_set,
            allowed="letters, digits and hyphens",
        )
    return f"{geometry_id(pair.geometry)}_s{pair.stiffness_set}"


def parse_outcome(text: str) -> Pair:
    """The inverse of `outcome_id`."""
    geometry, found, name = text.rpartition("_s")
    if not found or not re.fullmatch(OUTCOME_PATTERN, text):
        raise _no_identifier("an outcome", text, "r06.0_g18.0_n08_s3")
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
            "1, of at most three decimals.",
            key="release_gap_fraction",
            value=release_gap_fraction,
            allowed="0 to 1, at most three decimals",
            remedy="Round it.",
        )
    return f"{outcome}_y{text}"


def parse_run(text: str) -> tuple[str, float]:
    """The inverse of `run_id`: outcome identifier and place of release."""
    outcome, _, place = text.rpartition("_y")
    if re.fullmatch(RUN_PATTERN, text) and float(place) <= 1:
        parse_outcome(outcome)
        if run_id(outcome, float(place)) == text:
            return outcome, float(place)
    raise _no_identifier("a run", text, "r06.0_g18.0_n08_s3_y0.50")


GROUP_VELOCITY, FIXED_VELOCITY = "group-velocity", "fixed-velocity"
"""Designs of the calibration: each group at its own velocity (the source paper's), all at one."""
CONSTRICTION_PATTERN = r"[A-Za-z0-9-]+_(?:fixed_)?\d+"


def constriction_id(group: str, position: int, design: str = GROUP_VELOCITY) -> str:
    """Identifier such as G1_0, or G1_fixed_0 at fixed velocity; `position` counts the releases."""
    return f"{group}_{'fixed_' if design == FIXED_VELOCITY else ''}{position}"


def parse_constriction(text: str) -> tuple[str, int, str]:
    """The inverse of `constriction_id`."""
    if not re.fullmatch(CONSTRICTION_PATTERN, text):
        raise _no_identifier("a constriction run", text, "G1_0")
    group, *fixed, position = text.split("_")
    return group, int(position), FIXED_VELOCITY if fixed else GROUP_VELOCITY
