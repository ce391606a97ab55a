"""What a setting that is valid alone cannot be together with others: gaps, cells, lattices."""

import math

from dldsim import laws
from dldsim.config.configuration import Config
from dldsim.config.sections import CellShape, Geometry
from dldsim.errors import DldsimError

AREA_RESERVE = 0.1
"""Relative area growth that a squeezed membrane is assumed to bear in `smallest_passable_um`."""


def check_gap(geometry: Geometry, safety_distance_um: float) -> None:
    """Refuse a gap that does not exceed P_r + d_safety."""
    least = geometry.pillar_radius_um + safety_distance_um
    if geometry.gap_um <= least:
        raise DldsimError(
            f"gap_um = {geometry.gap_um:g} is too small for pillar_radius_um = "
            f"{geometry.pillar_radius_um:g}: a gap must exceed P_r + d_safety = {least:g} µm. "
            "Widen the gap, take a smaller pillar, or lower sweep.safety_distance_um."
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
                f"{cell.radius_um:g} µm, about {least:.1f} µm across. Widen it, or lower "
                "cell.radius_um."
            )


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
                    f"sweep: {error} Or set sweep.skip_infeasible: true to leave such "
                    "combinations out."
                ) from None
            check_passable(geometry, config.cell, config.flow.height_um)
            feasible += 1
    if not feasible:
        raise DldsimError(
            "sweep: no combination is left, every gap_um is at most P_r + d_safety "
            f"(d_safety = {sweep.safety_distance_um:g} µm). Add wider gaps or smaller pillars."
        )
