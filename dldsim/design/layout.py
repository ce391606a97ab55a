"""Layout of a design's device: a complete small chip around the array, lengths in µm.

Three streams (buffer, sample, buffer) run side by side through the array into two outlets or more;
each has a reservoir. x points along the flow, y across it, the origin is where the array meets the
lower side wall. The row shift is towards +y, as in the simulation.

Fluid is the channel layer without the pillars layer. The simulated array has no side walls; those
of the device follow the pillars so that the flow beside them stays that of the array
(:mod:`dldsim.design.side_walls`), as far as a gap's width alone can do that. `expected` says where
a stream comes near them.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from dldsim.config.design_sections import Device
from dldsim.config.sections import Geometry
from dldsim.design.outlets import Array
from dldsim.design.side_walls import (
    FLOW_EXPONENT,
    array_outline,
    lowest_pillar_um,
    outlet_walls,
    wall_gaps,
    wall_range,
    whole_array,
)
from dldsim.experiments.migration import mode_of

LAYERS = ("channel", "pillars", "alignment", "label", "documentation")
NEAR_WALL_PITCHES = 3
TEXT_HEIGHT_UM = 120.0


class Stream(NamedTuple):
    """A cell type that enters the device; `error_deg`: ± on its angle, None if unknown."""

    name: str
    radius_um: float
    angle_deg: float
    error_deg: float | None = None


class Exit(NamedTuple):
    """Where the middle of a population's stream leaves the array [µm above the lower wall].

    Lowest and highest are those within the error of the angle, None if that is unknown.
    """

    population: Stream
    mode: str
    position_um: float
    lowest_um: float | None
    highest_um: float | None
    wall_at_um: float | None
    """Distance along the array after which the cells reach a side wall."""


class Text(NamedTuple):
    layer: str
    text: str
    place: tuple[float, float]
    height: float


@dataclass(frozen=True)
class Layout:
    """Everything a mask shows, in µm.

    ``lanes``: pillars in every row. ``walls_um``: middles of the walls between outlets.
    ``polygons``: by layer; ``paths``: expected ways of the populations (documentation layer).
    """

    name: str
    geometry: Geometry
    device: Device
    rows: int
    lanes: int
    width_um: float
    exits: tuple[Exit, ...]
    walls_um: tuple[float, ...]
    polygons: dict[str, list[np.ndarray]] = field(default_factory=dict)
    paths: list[np.ndarray] = field(default_factory=list)
    texts: list[Text] = field(default_factory=list)

    @property
    def shift_um(self) -> float:
        """Lateral shift from row to row."""
        return self.geometry.pitch_um / self.geometry.periodicity

    @property
    def length_um(self) -> float:
        """Length of the array, a whole number of rows."""
        return self.rows * self.geometry.pitch_um

    @property
    def lowest_um(self) -> float:
        """Centre of the lowest pillar of the first row."""
        return lowest_pillar_um(self.geometry)

    def expected(self) -> dict[str, Any]:
        """Dimensions, expected exits and what they mean, for JSON."""
        geometry, device = self.geometry, self.device
        lower, upper = wall_gaps(geometry)
        return {
            "name": self.name,
            **geometry.model_dump(),
            "pitch_um": geometry.pitch_um,
            "row_shift_um": self.shift_um,
            "rows": self.rows,
            "pillars": self.rows * self.lanes,
            "array_length_um": self.length_um,
            "array_width_um": self.width_um,
            "wall_gap_min_um": float(lower.min()),
            "wall_gap_max_um": float(upper.max()),
            "sample_position_um": 1e3 * device.sample_position_mm,
            "sample_width_um": device.sample_width_um,
            "outlet_walls_um": list(self.walls_um),
            "populations": [
                {
                    "name": e.population.name,
                    "radius_um": e.population.radius_um,
                    "migration_angle_deg": e.population.angle_deg,
                    "angle_error_deg": e.population.error_deg,
                    "mode": e.mode,
                    "exit_um": e.position_um,
                    "exit_lowest_um": e.lowest_um,
                    "exit_highest_um": e.highest_um,
                    "reaches_wall_after_um": e.wall_at_um,
                }
                for e in self.exits
            ],
            **_separation(self),
            "notes": _notes(self),
            "layers": {name: getattr(device, f"layer_{name}") for name in LAYERS},
        }


def make_layout(
    geometry: Geometry,
    device: Device,
    populations: Sequence[Stream],
    name: str,
    walls_um: Sequence[float] | None = None,
) -> Layout:
    """Lay out a device for two populations or more; lengths are rounded to the nanometre.

    ``walls_um``: middles of the walls between outlets; by default those of the device or, of two
    outlets, midway between the nearest cell edges. Raises DldsimError if the array is shorter than
    one period or narrower than three pillars, or leaves a stream no room.
    """
    geometry = geometry.model_copy(
        update={key: round(getattr(geometry, key), 3) for key in ("pillar_radius_um", "gap_um")}
    )
    array, rows, lanes = whole_array(geometry, device)
    exits = tuple(_exit(array, device, p) for p in populations)
    walls = walls_um or outlet_walls(array, device) or [_between(exits, array, device)]
    layout = Layout(name, geometry, device, rows, lanes, array.width_um, exits, tuple(walls))
    _draw(layout)
    return layout


def _exit(array: Array, device: Device, population: Stream) -> Exit:
    start, width, length = 1e3 * device.sample_position_mm, array.width_um, array.length_um
    wall = population.radius_um, width - population.radius_um

    def at(angle_deg: float) -> float:
        free = start + length * math.tan(math.radians(angle_deg))
        return min(max(free, wall[0]), wall[1])

    angle, error = population.angle_deg, population.error_deg
    lowest, highest = (None, None) if error is None else (at(angle - error), at(angle + error))
    slope = math.tan(math.radians(angle))
    reached = math.inf if slope == 0 else (wall[slope > 0] - start) / slope
    return Exit(
        population,
        mode_of(angle, 1 / array.periodicity),
        at(angle),
        lowest,
        highest,
        reached if reached < length else None,
    )


def _between(exits: Sequence[Exit], array: Array, device: Device) -> float:
    """Middle of a single wall between outlets, midway between the nearest cell edges."""
    low, *_, high = sorted(exits, key=lambda e: e.position_um)
    middle = (
        low.position_um + low.population.radius_um + high.position_um - high.population.radius_um
    ) / 2
    lowest, highest = wall_range(array, device)
    return min(max(middle, lowest), highest)


def _separation(layout: Layout) -> dict[str, Any]:
    """Lateral separation at the exit [µm], and the length for which the streams part [mm]."""
    low, *_, high = sorted(layout.exits, key=lambda e: e.position_um)
    radii = low.population.radius_um + high.population.radius_um
    apart = high.position_um - low.position_um
    slopes = [math.tan(math.radians(e.population.angle_deg)) for e in (low, high)]
    needed = layout.device.sample_width_um + radii
    slope = abs(slopes[1] - slopes[0])
    return {
        "separation_at_exit_um": apart,
        "free_distance_between_streams_um": apart - needed,
        "length_for_parted_streams_mm": needed / slope / 1e3 if slope > 0 else None,
    }


def _notes(layout: Layout) -> list[str]:
    """What a user of the device must know, in sentences."""
    figures = _separation(layout)
    apart, free = (
        figures[k] for k in ("separation_at_exit_um", "free_distance_between_streams_um")
    )
    diameter = 2 * max(e.population.radius_um for e in layout.exits)
    length = figures["length_for_parted_streams_mm"]
    more = "" if length is None else f" An array of {length:.3g} mm would part the streams."
    if apart < diameter:
        notes = [
            f"The populations leave {apart:.1f} µm apart, less than a cell diameter "
            f"({diameter:.1f} µm): no outlet can divide them.{more}"
        ]
    elif free <= 0:
        notes = [
            f"The populations leave {apart:.0f} µm apart, but their streams, as wide as the "
            f"sample stream and a cell, overlap by {-free:.0f} µm.{more}"
        ]
    else:
        notes = [
            f"The populations leave {apart:.0f} µm apart, with {free:.0f} µm between their streams."
        ]
    pitch, width = layout.geometry.pitch_um, layout.width_um
    for e in layout.exits:
        who = f"{e.population.name} ({e.population.angle_deg:.2f}°)"
        if e.wall_at_um is not None:
            notes.append(
                f"{who} reaches a side wall after {e.wall_at_um / 1e3:.2f} mm; widen the "
                "array or move the sample stream."
            )
        elif min(e.position_um, width - e.position_um) < NEAR_WALL_PITCHES * pitch:
            notes.append(
                f"{who} leaves within {NEAR_WALL_PITCHES} pitches of a side wall, where "
                "the flow is not that of the array."
            )
    notes.append(
        f"The array of this mask is {layout.length_um / 1e3:.2f} mm long: the {layout.rows} whole "
        f"rows that fit into {layout.device.array_length_mm:.4g} mm. The "
        "length in the tables of designs is that which parts the cell types by "
        "lateral_separation_um."
    )
    notes.append(
        f"Gaps beside the side walls follow the pillars, {layout.geometry.gap_um:.4g} µm · "
        f"(n/N_p)^(1/{FLOW_EXPONENT}) in row n of a period at the lower wall and "
        f"(2 − n/N_p)^(1/{FLOW_EXPONENT}) at the upper one (after Inglis 2009, Feng et al. 2017, "
        "Ebadi et al. 2019)."
    )
    notes.append(
        "The sample stream has its width if the three inlets are fed in proportion to their widths."
    )
    notes.append(
        "Positions hold for the settled motion over the whole length; the first rows, "
        "side walls, and dispersion among cells of one type are not in them."
    )
    return notes


def _draw(layout: Layout) -> None:
    """Fill in polygons, paths and texts."""
    device, length, width = layout.device, layout.length_um, layout.width_um
    inlet, outlet = -1e3 * device.inlet_length_mm, length + 1e3 * device.outlet_length_mm
    start, half = 1e3 * device.sample_position_mm, device.sample_width_um / 2
    wall, port = device.divider_um, 1e3 * device.port_diameter_mm
    lead = min(layout.geometry.pitch_um, -inlet / 2, (outlet - length) / 2)
    low, high = start - half, start + half
    entering = [(0, low - wall), (low, high), (high + wall, width)]
    edges = [-wall / 2, *layout.walls_um, width + wall / 2]
    leaving = [(a + wall / 2, b - wall / 2) for a, b in pairwise(edges)]
    parts = [_box(x, x + lead, 0, width) for x in (-lead, length)]
    parts.append(array_outline(layout.geometry, layout.rows, layout.lanes))
    ends = (inlet, -lead, entering, -1), (outlet, length + lead, leaving, 1)
    for end, near, streams, way in ends:
        beyond = end + 1.5 * way * port
        middles = width / 2 + 2 * port * (np.arange(len(streams)) - (len(streams) - 1) / 2)
        for (low, high), middle in zip(streams, middles, strict=True):
            feed = [(beyond, middle + port / 8), (beyond, middle - port / 8)]
            parts += [
                _box(near, end, low, high),
                np.array([(end, low), (end, high), *feed]),
                circle((beyond, middle), port / 2, device.facet_tolerance_um),
            ]
    layout.polygons["channel"] = _union(parts)
    corners = np.concatenate(layout.polygons["channel"])
    size = device.alignment_mark_um
    low, high = corners.min(axis=0) - size, corners.max(axis=0) + size
    layout.polygons["alignment"] = [
        _cross((x, y), size) for x in (low[0], high[0]) for y in (low[1], high[1])
    ]
    layout.polygons["documentation"] = []
    g = layout.geometry
    lines = [
        layout.name,
        f"P_r {g.pillar_radius_um:.3f}  P_g {g.gap_um:.3f}  N_p {g.periodicity}  "
        f"eps 1/{g.periodicity}  um",
    ]
    height = min(TEXT_HEIGHT_UM, length / (0.6 * max(map(len, lines))))
    for i, line in enumerate(lines):
        layout.texts.append(Text("label", line, (0.0, -(1.5 * i + 2) * height), height))
    layout.texts.append(Text("documentation", "flow ->", (inlet / 2, width + height), height))
    for e in layout.exits:
        corner = [] if e.wall_at_um is None else [(e.wall_at_um, e.position_um)]
        path = np.array([(0.0, start), *corner, (length, e.position_um)])
        layout.paths.append(path)
        layout.polygons["documentation"].append(
            np.concatenate([path - (0, half), path[::-1] + (0, half)])
        )
        note = (
            f"{e.population.name}: {e.population.angle_deg:.2f} deg, {e.mode}, "
            f"exit {e.position_um:.0f} um"
        )
        layout.texts.append(
            Text("documentation", note, (length + lead, e.position_um), min(height, 60.0))
        )


def _box(x0: float, x1: float, y0: float, y1: float) -> np.ndarray:
    return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])


def circle(centre: tuple[float, float], radius: float, tolerance: float) -> np.ndarray:
    """Regular polygon with its corners on the circle and its sides within the tolerance of it.

    The number of corners is a multiple of 4, so that the extents along x and y are the diameter.
    """
    n = 4 * max(2, math.ceil(math.pi / math.acos(max(1 - tolerance / radius, 0)) / 4))
    angle = 2 * np.pi * np.arange(n) / n
    return np.column_stack([np.cos(angle), np.sin(angle)]) * radius + centre


def _cross(centre: tuple[float, float], size: float) -> np.ndarray:
    a, b = size / 2, size / 20
    corners = [
        (-a, -b),
        (-b, -b),
        (-b, -a),
        (b, -a),
        (b, -b),
        (a, -b),
        (a, b),
        (b, b),
        (b, a),
        (-b, a),
        (-b, b),
        (-a, b),
    ]
    return np.array(corners) + centre


def _union(parts: Iterable[np.ndarray]) -> list[np.ndarray]:
    import gdstk

    whole = gdstk.boolean([gdstk.Polygon(p) for p in parts], [], "or", precision=1e-4)
    return [polygon.points for polygon in whole]
