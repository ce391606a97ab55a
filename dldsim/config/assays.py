"""What the assays of a configuration consist of: cells, membranes, passages.

Rule files import this module in every job, so it imports nothing heavy.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from dldsim.config.assay_sections import (
    Assay,
    AssayCell,
    ConstrictionAssay,
    SimulatedAssay,
    TableAssay,
)
from dldsim.config.configuration import Config, Partial
from dldsim.config.explain import did_you_mean
from dldsim.config.identifiers import Point
from dldsim.config.sections import CellShape, Flow, Stiffness
from dldsim.errors import DldsimError

NOTHING, RELEASE, OFFSET, SIZE, ORIENTATION = "nothing", "release", "offset", "size", "orientation"
"""In what a passage differs from the first of its point."""


class Membrane(NamedTuple):
    """A membrane that an assay measures: its name, moduli, stiffness set (or ""), and its own
    velocity, if the assay leaves that to it."""

    name: str
    stiffness: Stiffness
    stiffness_set: str = ""
    velocity_mm_s: float | None = None


class Passage(NamedTuple):
    """One passage of a point: what it differs in, and all that may."""

    varied: str
    release_position_um: float
    offset_um: float
    radius_factor: float
    axis: str


def assay_of(name: str, config: Partial) -> Assay:
    """An assay by name, also one of the study, with its channel in place.

    Raises DldsimError if there is none.
    """
    known = {**config.assay_study.assays, **config.assays}
    if name not in known:
        names = ", ".join(config.assays) or "none"
        raise DldsimError(
            f"Assay {name!r} is unknown.{did_you_mean(name, config.assays)} Known: {names}.",
            key="assay",
            value=name,
            allowed=names,
            remedy="Name one of these, or add it to the section assays.",
        )
    assay = known[name]
    if isinstance(assay, ConstrictionAssay) and assay.channel is None:
        return assay.model_copy(update={"channel": config.constriction})
    return assay


def cells_of(assay: SimulatedAssay, config: Partial) -> list[CellShape]:
    """The cells at rest that an assay is calibrated for."""
    own = config.cell
    if not assay.cells:
        return [own]
    return [own.model_copy(update=cell.model_dump()) for cell in assay.cells]


def membranes_of(assay: SimulatedAssay, config: Partial) -> list[Membrane]:
    """The membranes that an assay measures, softest first but for those of groups.

    Between two sets k_s rises in equal ratios and the other moduli are linear in it.
    """
    if isinstance(assay, ConstrictionAssay) and assay.groups:
        return [
            Membrane(
                name,
                group.stiffness,
                "" if assay.velocity_mm_s else group.stiffness_set or "",
                assay.velocity_mm_s or group.velocity_mm_s,
            )
            for name, group in config.constriction_groups.items()
        ]
    sets = sorted(config.stiffness_sets.items(), key=lambda item: item[1].ks_uN_per_m)
    found = []
    for i, (name, stiffness) in enumerate(sets):
        found.append(Membrane(name, stiffness, name))
        if i + 1 < len(sets):
            found += _between(stiffness, sets[i + 1][1], assay.between)
    return found


def _between(soft: Stiffness, stiff: Stiffness, count: int) -> Iterator[Membrane]:
    """``count`` membranes between two, without them."""
    low, high = soft.ks_uN_per_m, stiff.ks_uN_per_m
    for k in range(1, count + 1):
        if not 0 < low < high:
            return
        ks = low * (high / low) ** (k / (count + 1))
        share = (ks - low) / (high - low)
        moduli = {name: value + share * (getattr(stiff, name) - value) for name, value in soft}
        yield Membrane(f"ks-{ks:.4g}", Stiffness(**moduli))


def passages_of(assay: SimulatedAssay, shape: str) -> list[Passage]:
    """The passages of one cell and membrane: the first, then those that differ from it in one
    thing. A sphere has no orientation."""
    releases = assay.slit.release_positions_um if isinstance(assay, ConstrictionAssay) else [0.0]
    first = Passage(NOTHING, releases[0], 0.0, 1.0, assay.axis)
    found = [first]
    found += [first._replace(varied=RELEASE, release_position_um=r) for r in releases[1:]]
    found += [first._replace(varied=OFFSET, offset_um=o) for o in getattr(assay, "offsets_um", [])]
    found += [first._replace(varied=SIZE, radius_factor=f) for f in assay.radius_factors]
    if shape != "sphere":
        found += [first._replace(varied=ORIENTATION, axis=axis) for axis in assay.other_axes]
    return found


def points_of(name: str, config: Partial, cells: Sequence[AssayCell] = ()) -> list[Point]:
    """What an assay measures, ``cells`` if it has none of its own; nothing for published pairs."""
    assay = assay_of(name, config)
    if isinstance(assay, TableAssay):
        return []
    if cells and not assay.cells:
        assay = assay.model_copy(update={"cells": list(cells)})
    return [
        Point(name, cell.shape, cell.radius_um, membrane.name)
        for cell in cells_of(assay, config)
        for membrane in membranes_of(assay, config)
    ]


def points(config: Config) -> list[Point]:
    """What the campaign measures in assays."""
    return [point for name in config.assays for point in points_of(name, config)]


def points_of_library(config: Config) -> list[Point]:
    """What the library of calibrations holds."""
    library = config.calibration_library
    return [p for name in library.assays for p in points_of(name, config, library.cells)]


def study_points(config: Config) -> list[Point]:
    """What the study of assays measures."""
    study = config.assay_study
    names = [*study.of_campaign, *study.assays]
    return [point for name in names for point in points_of(name, config, study.cells)]


def simulated(name: str, config: Partial) -> SimulatedAssay:
    """An assay that a point is of: none of published pairs."""
    assay = assay_of(name, config)
    assert not isinstance(assay, TableAssay)
    return assay


def settings_of_point(point: Point, config: Partial) -> dict:
    """Everything that a point depends on, as plain values, but the physics version."""
    assay = simulated(point.assay, config)
    [membrane] = [m for m in membranes_of(assay, config) if m.name == point.membrane]
    cell = config.cell.model_copy(update={"shape": point.shape, "radius_um": point.radius_um})
    return {
        "numerics": config.numerics.model_dump(mode="json", exclude=NOT_IN_ASSAYS),
        **settings_of_passages(assay, membrane, cell, config.flow),
    }


def settings_of_passages(
    assay: SimulatedAssay, membrane: Membrane, cell: CellShape, flow: Flow
) -> dict:
    """The same of passages but for the numerics."""
    viscosity = assay.viscosity_mPa_s or flow.viscosity_mPa_s
    return {
        "assay": assay.model_dump(mode="json", exclude=NOT_OF_A_POINT),
        "membrane": {**membrane._asdict(), "stiffness": membrane.stiffness.model_dump(mode="json")},
        "cell": cell.model_dump(mode="json", exclude={"axis"}),
        "flow": {"viscosity_mPa_s": viscosity},
    }


NOT_OF_A_POINT = {"cells", "between", "viscosity_mPa_s"}
"""Settings of an assay that say which points there are, or are handed out as the flow's."""
NOT_IN_ASSAYS = {"spacing_um", "bounce_back", "rows", "lanes", "images"}
"""Numerics of arrays; an assay has a spacing of its own."""
