"""The whole rows and lanes of a device's array, its streams and its side walls.

The flow of an array without side walls takes the part n/N_p of the flow through a gap across every
place of row n of a period that lies where a straight wall would. So the gap beside the wall that
bumping cells leave carries the part n/N_p, and that beside the wall they come to 2 − n/N_p, of the
flow through a gap P_g (Inglis, Appl. Phys. Lett. 94, 013510, 2009; Feng et al., Biomicrofluidics
11, 024121, 2017). As wide as that takes are P_g (n/N_p)^(1/p) and P_g (2 − n/N_p)^(1/p): p = 2
after Inglis, p = 3 after Feng et al. for tall pillars. Here p = 2.463 (Ebadi et al., SN Appl. Sci.
1, 1184, 2019). Taken as rectangular ducts, such gaps of a channel 1 to 1.7 P_g high carry their
part to 18 %, and from n/N_p = 1/4 on to 13 %. The walls follow the pillars in steps, midway between
rows.
"""

import math
from itertools import pairwise

import numpy as np

from dldsim.config.design_sections import Device
from dldsim.config.sections import Geometry
from dldsim.design.outlets import Array
from dldsim.errors import DldsimError

FLOW_EXPONENT = 2.463
"""Of the flow through a gap beside a wall against its width."""
FEWEST_LANES = 3


def whole_array(geometry: Geometry, device: Device) -> tuple[Array, int, int]:
    """The array, rows and pillars per row that fit into a device's array length and width.

    Its width is that of as many lanes and one gap, P_g + lanes · λ. Raises DldsimError if the array
    is shorter than one period or narrower than three pillars.
    """
    pitch, period = geometry.pitch_um, geometry.periodicity
    rows = math.floor(1e3 * device.array_length_mm / pitch + 1e-9)
    if rows < period:
        needed = f"{period * pitch / 1e3:.3g} mm or more"
        raise DldsimError(
            f"device.array_length_mm = {device.array_length_mm:g} holds {rows} rows of "
            f"{pitch:.4g} µm, fewer than one period of {period}; {needed} are needed.",
            key="device.array_length_mm",
            value=device.array_length_mm,
            allowed=needed,
            remedy="Lengthen the array, or take a smaller periodicity or pitch.",
        )
    lanes = math.floor((1e3 * device.array_width_mm - geometry.gap_um) / pitch + 1e-9)
    if lanes < FEWEST_LANES:
        needed = f"{(FEWEST_LANES * pitch + geometry.gap_um) / 1e3:.3g} mm or more"
        raise DldsimError(
            f"device.array_width_mm = {device.array_width_mm:g} holds {max(lanes, 0)} pillars "
            f"of pitch {pitch:.4g} µm in a row; {FEWEST_LANES} are needed.",
            key="device.array_width_mm",
            value=device.array_width_mm,
            allowed=needed,
            remedy="Widen the array.",
        )
    array = Array(
        geometry.pillar_radius_um,
        geometry.gap_um,
        period,
        rows * pitch,
        lanes * pitch + geometry.gap_um,
    )
    return array, rows, lanes


def outlet_walls(array: Array, device: Device) -> list[float] | None:
    """Middles of the walls between outlets that a device names [µm]; None for a single one that is
    still to be placed.

    Raises DldsimError if the sample stream, or an outlet, has no room in the width of the array.
    """
    room = f"the whole lanes of this array are {array.width_um:.4g} µm wide"
    high = 1e3 * device.sample_position_mm + device.sample_width_um / 2 + device.divider_um
    if high >= array.width_um:
        raise DldsimError(
            f"device.sample_position_mm = {device.sample_position_mm:g}: the sample stream and its "
            f"divider reach up to {high:.4g} µm, but {room}.",
            key="device.sample_position_mm",
            value=device.sample_position_mm,
            allowed=f"where they end below {array.width_um:.4g} µm",
            remedy="Move the sample stream down, or widen the array.",
        )
    walls = device.walls_um(array.width_um)
    if walls is None:
        return None
    thick = device.divider_um
    edges = [-thick / 2, *walls, array.width_um + thick / 2]
    if min(b - a for a, b in pairwise(edges)) <= thick:
        key = "outlets" if device.outlet_walls_um is None else "outlet_walls_um"
        value = device.outlets if device.outlet_walls_um is None else walls
        raise DldsimError(
            f"device.{key} = {value}: an outlet has no room between walls {thick:g} µm thick; "
            f"{room}.",
            key=f"device.{key}",
            value=value,
            allowed=f"walls more than {thick:g} µm apart, inside the array",
            remedy="Move the walls, take fewer, or widen the array.",
        )
    return walls


def wall_range(array: Array, device: Device) -> tuple[float, float]:
    """Where a single wall between two outlets may be, so that neither is narrower than the sample
    stream [µm]. Raises DldsimError if there is no room."""
    narrowest = device.sample_width_um + device.divider_um / 2
    if 2 * narrowest >= array.width_um:
        raise DldsimError(
            f"device.array_width_mm: two outlets as wide as the sample stream, "
            f"{device.sample_width_um:g} µm, and their wall need more than the "
            f"{array.width_um:.4g} µm of this array.",
            key=("device.array_width_mm", "device.sample_width_um"),
            value=device.array_width_mm,
            allowed=f"more than {2 * narrowest / 1e3:.3g} mm",
            remedy="Widen the array or narrow the sample stream.",
        )
    return narrowest, array.width_um - narrowest


def wall_gaps(geometry: Geometry) -> tuple[np.ndarray, np.ndarray]:
    """Gaps (N_p,) [µm] between pillars and the wall that bumping cells leave, and that they come
    to, in rows 1 to N_p of a period."""
    part = np.arange(1, geometry.periodicity + 1) / geometry.periodicity
    gap = geometry.gap_um
    return gap * part ** (1 / FLOW_EXPONENT), gap * (2 - part) ** (1 / FLOW_EXPONENT)


def lowest_pillar_um(geometry: Geometry) -> float:
    """Centre of the lowest pillar of row 1 of a period, of row N_p P_g above a wall at 0 [µm]."""
    return geometry.pitch_um / geometry.periodicity - geometry.pillar_radius_um


def wall_levels(geometry: Geometry, lanes: int) -> tuple[np.ndarray, np.ndarray]:
    """Lateral positions (N_p,) [µm] of the lower and upper wall in rows 1 to N_p of a period.

    In row N_p they are 0 and the width of the array; elsewhere below both.
    """
    lower, upper = wall_gaps(geometry)
    shift = geometry.pitch_um / geometry.periodicity * np.arange(geometry.periodicity)
    lowest = lowest_pillar_um(geometry) + shift
    highest = lowest + (lanes - 1) * geometry.pitch_um
    radius = geometry.pillar_radius_um
    return lowest - radius - lower, highest + radius + upper


def array_outline(geometry: Geometry, rows: int, lanes: int) -> np.ndarray:
    """Corners of the fluid's outline around the array (n, 2), row 1 from x = 0 on [µm]."""
    low, high = (np.resize(level, rows) for level in wall_levels(geometry, lanes))
    ends = geometry.pitch_um * np.arange(rows + 1)
    x = np.repeat(ends, 2)[1:-1]
    lower = np.column_stack([x, np.repeat(low, 2)])
    upper = np.column_stack([x, np.repeat(high, 2)])
    return np.concatenate([lower, upper[::-1]])
