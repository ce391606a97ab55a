"""What a setting that is valid alone cannot be together with others: gaps, cells, lattices."""

import math

from dldsim import laws
from dldsim.config.configuration import Config
from dldsim.config.limits import Limits, check_memory
from dldsim.config.sections import CellShape, Constriction, Flow, Geometry, Numerics
from dldsim.errors import DldsimError

AREA_RESERVE = 0.1
"""Relative area growth that a squeezed membrane is assumed to bear in `smallest_passable_um`."""


def check_gap(geometry: Geometry, safety_distance_um: float) -> None:
    """Refuse a gap that does not exceed P_r + d_safety."""
    least = geometry.pillar_radius_um + safety_distance_um
    if geometry.gap_um <= least:
        raise DldsimError(
            f"gap_um = {geometry.gap_um:g} is too small for pillar_radius_um = "
            f"{geometry.pillar_radius_um:g}: a gap must exceed P_r + d_safety = {least:g} µm.",
            key="gap_um",
            value=geometry.gap_um,
            allowed=f"> {least:g}",
            remedy="Widen the gap, take a smaller pillar, or lower sweep.safety_distance_um.",
        )


def smallest_passable_um(cell: CellShape) -> float:
    """Diameter of the narrowest tube that the cell fits through [µm], a rough lower limit for gaps.

    A membrane keeps its volume and resists growth of its area, so the thinnest it can become is a
    cylinder with hemispherical ends of the same volume V and area A (Canham & Burton 1968):
    V = A r/2 − 2π r³/3. Here A is the rest area plus AREA_RESERVE. A cell between tall pillars can
    also flatten, which is easier: the limit is on the safe side, and only a simulation tells
    whether a wider gap is passed.
    """
    area = (1 + AREA_RESERVE) * laws.rest_area(cell.shape, cell.aspect_ratio)
    volume = 4 / 3 * math.pi * laws.rest_volume(cell.shape, cell.aspect_ratio)
    low, high = 0.0, math.sqrt(area / (4 * math.pi))  # V(r) rises up to the sphere of this area
    for _ in range(60):
        r = (low + high) / 2
        if area * r / 2 - 2 * math.pi * r**3 / 3 < volume:
            low = r
        else:
            high = r
    return 2 * high * cell.radius_um


def check_passable(geometry: Geometry, cell: CellShape, height_um: float = 0.0) -> None:
    """Refuse a gap, or a channel height other than 0, that the squeezed cell cannot pass."""
    least = smallest_passable_um(cell)
    for name, value in (("gap_um", geometry.gap_um), ("height_um", height_um or math.inf)):
        if value < least:
            raise DldsimError(
                f"{name} = {value:g} is smaller than a squeezed {cell.shape} cell of radius "
                f"{cell.radius_um:g} µm, about {least:.1f} µm across.",
                key=name,
                value=value,
                allowed=f"{least:.1f} or more",
                remedy="Widen it, or lower cell.radius_um.",
            )


LEAST_NODES = 4
"""Across a gap and between plates."""


def _check_nodes(key: str, length_um: float, spacing_um: float, finer: str, else_: str) -> None:
    """Refuse a length that the lattice divides into too few nodes."""
    if length_um < LEAST_NODES * spacing_um:
        raise DldsimError(
            f"{key} = {length_um:g} holds fewer than {LEAST_NODES} nodes of {spacing_um:.3g} µm.",
            key=key,
            value=length_um,
            allowed=f"{LEAST_NODES * spacing_um:.3g} or more",
            remedy=f"Refine {finer} to {length_um / LEAST_NODES:.3g} or less, or {else_}.",
        )


def check_array(
    geometry: Geometry, flow: Flow, numerics: Numerics, limits: Limits | None = None
) -> None:
    """Refuse an array that the lattice cannot carry, or that needs too much memory.

    ``limits``: by default those in force.
    """
    if numerics.rows > geometry.periodicity:
        raise DldsimError(
            key="numerics.rows",
            value=numerics.rows,
            allowed=f"1 to the periodicity {geometry.periodicity}",
            remedy="The domain repeats after a period: lower numerics.rows.",
        )
    spacing, shift = laws.whole_shift_spacing(geometry, numerics.spacing_um)
    _check_nodes("gap_um", geometry.gap_um, spacing, "numerics.spacing_um", "widen the gap")
    height = 1.0
    if flow.height_um > 0:
        height = round(flow.height_um / spacing)
        if height < LEAST_NODES:
            _check_nodes(
                "height_um",
                flow.height_um,
                spacing,
                "numerics.spacing_um",
                "set height_um to 0 for the two-dimensional limit",
            )
        height /= 1 + numerics.half_scene
    pitch = shift * geometry.periodicity
    nodes = numerics.rows * numerics.lanes * pitch**2 * height
    check_memory(nodes, numerics.precision, "numerics.spacing_um", numerics.spacing_um, limits)


def check_channel(channel: Constriction, numerics: Numerics, limits: Limits | None = None) -> None:
    """Refuse a constriction channel that the lattice cannot carry, or that needs too much memory.

    ``limits``: by default those in force.
    """
    if channel.throat_width_um >= channel.width_um:
        raise DldsimError(
            f"constriction.throat_width_um = {channel.throat_width_um:g} must be below "
            f"constriction.width_um = {channel.width_um:g}.",
            key="constriction.throat_width_um",
            value=channel.throat_width_um,
            allowed=f"< {channel.width_um:g}",
            remedy="Narrow the throat or widen the channel.",
        )
    spacing, _ = laws.even_throat(channel.throat_width_um, channel.spacing_um)
    height = round(channel.height_um / spacing)
    if height < LEAST_NODES:
        _check_nodes(
            "constriction.height_um",
            channel.height_um,
            spacing,
            "constriction.spacing_um",
            "raise the height",
        )
    length = channel.throat_length_um + 2 * (channel.approach_length_um + channel.taper_length_um)
    nodes = length / spacing * channel.width_um / spacing * height / (1 + numerics.half_scene)
    check_memory(nodes, numerics.precision, "constriction.spacing_um", channel.spacing_um, limits)


def check_release(position_um: float, channel: Constriction, cell: CellShape) -> None:
    """Refuse a position of release at which the cell is not in the straight approach."""
    most = channel.approach_length_um - 2 * cell.radius_um
    if not 0 <= position_um <= most:
        raise DldsimError(
            f"constriction.release_positions_um: {position_um:g} µm does not fit the approach of "
            f"{channel.approach_length_um:g} µm, counted back from its end; allowed 0 to {most:g}.",
            key="constriction.release_positions_um",
            value=position_um,
            allowed=f"0 to {most:g}",
            remedy="Release the cell there, or lengthen constriction.approach_length_um.",
        )


def check_throat(channel: Constriction, cell: CellShape) -> None:
    """Refuse a throat or a channel that the squeezed cell cannot pass."""
    least = smallest_passable_um(cell)
    for key in ("throat_width_um", "height_um"):
        if (value := getattr(channel, key)) < least:
            raise DldsimError(
                f"constriction.{key} = {value:g} is smaller than a squeezed {cell.shape} cell of "
                f"radius {cell.radius_um:g} µm, about {least:.1f} µm across.",
                key=f"constriction.{key}",
                value=value,
                allowed=f"{least:.1f} or more",
                remedy="Widen it, or lower cell.radius_um.",
            )


def check_campaign(config: Config) -> None:
    """Refuse a configuration of which a run could not start."""
    check_sweep(config)
    check_channel(config.constriction, config.numerics, config.limits)
    check_throat(config.constriction, config.cell)
    for position in config.constriction.release_positions_um:
        check_release(position, config.constriction, config.cell)


def check_sweep(config: Config) -> None:
    """Every combination of the sweep must be sound; see Sweep.skip_infeasible."""
    sweep, feasible = config.sweep, 0
    for radius in sweep.pillar_radius_um:
        for gap in sweep.gaps_for(radius):
            geometry = Geometry(pillar_radius_um=radius, gap_um=gap, periodicity=2)
            try:
                check_gap(geometry, sweep.safety_distance_um)
            except DldsimError as error:
                if sweep.skip_infeasible:
                    continue
                raise DldsimError(
                    f"sweep: {error} Or set sweep.skip_infeasible: true to leave such combinations "
                    "out.",
                    key=f"sweep.{error.key}",
                    value=error.value,
                    allowed=error.allowed,
                ) from None
            check_passable(geometry, config.cell, config.flow.height_um)
            for periodicity in sweep.periodicity:
                array = geometry.model_copy(update={"periodicity": periodicity})
                check_array(array, config.flow, config.numerics, config.limits)
            feasible += 1
    if not feasible:
        raise DldsimError(
            "sweep: no combination is left, every gap_um is at most P_r + d_safety "
            f"(d_safety = {sweep.safety_distance_um:g} µm).",
            key="sweep.gap_um",
            value=sweep.gap_um,
            allowed="> P_r + d_safety",
            remedy="Add wider gaps or smaller pillars.",
        )
