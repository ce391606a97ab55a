"""Names of geometries, outcomes, runs and points of a calibration: formatters and their parsers."""

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


def checked_outcome_id(
    geometry: Geometry, name: str, finer: bool = False, height_um: float | None = None
) -> str:
    """Identifier of an outcome that checks a design, by the name of its cell type.

    ``height_um``: another than the design's, in nm part of the name.
    """
    name += "-finer" * finer
    if height_um is not None:
        name += f"-h{1e3 * height_um:.0f}"
    return outcome_id(Pair(geometry, name))


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


POINT_PATTERN = r"[A-Za-z0-9-]+_(?:biconcave|sphere|ellipsoid)-\d+(?:\.\d+)?_[A-Za-z0-9.-]+"


class Point(NamedTuple):
    """What a calibration has one index of: an assay, a cell at rest, the name of a membrane."""

    assay: str
    shape: str
    radius_um: float
    membrane: str


def point_id(point: Point) -> str:
    """Identifier such as gauge_biconcave-7.5_3.

    Raises DldsimError for a radius of more than three decimals.
    """
    radius = f"{point.radius_um:.3f}".rstrip("0").rstrip(".")
    text = f"{point.assay}_{point.shape}-{radius}_{point.membrane}"
    if float(radius) != point.radius_um or not re.fullmatch(POINT_PATTERN, text):
        raise DldsimError(
            f"No identifier for a {point.shape} cell of radius_um = {point.radius_um!r} and "
            f"membrane {point.membrane!r} in assay {point.assay!r}: a radius has at most three "
            "decimals, a name letters, digits and hyphens.",
            key="radius_um",
            value=point.radius_um,
            allowed="at most three decimals; names of letters, digits, hyphens",
            remedy="Round it.",
        )
    return text


def parse_point(text: str) -> Point:
    """The inverse of `point_id`."""
    if not re.fullmatch(POINT_PATTERN, text):
        raise _no_identifier("an assay", text, "gauge_biconcave-7.5_3")
    assay, cell, membrane = text.split("_")
    shape, radius = cell.split("-")
    return Point(assay, shape, float(radius), membrane)
