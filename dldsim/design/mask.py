"""Photomask of a design: a complete small device as GDSII and as DXF, lengths in µm.

Three streams (buffer, sample, buffer) run side by side through the array into two outlets; each has
a reservoir. x points along the flow, y across it, the origin is where the array meets the lower
side wall. The row shift is towards +y, as in the simulation.

Fluid is the channel layer without the pillars layer. The simulated array has no side walls. Here a
pillar is left out where its gap to a side wall would be below `wall_gap_fraction` · P_g, so that
every pillar is whole, and the gaps at a wall range from there to one pitch more. Within a few
pitches of a wall the flow, and with it the critical diameter, is not that of the array (Inglis,
Appl. Phys. Lett. 94, 013510, 2009); `expected` says where a stream comes so near.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dldsim.config.design_sections import Device
from dldsim.config.sections import Geometry
from dldsim.errors import DldsimError
from dldsim.experiments.migration import mode_of
from dldsim.tables.parquet import atomic_path

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LAYERS = ("channel", "pillars", "alignment", "label", "documentation")
MAX_POINTS = 8190
"""A GDSII polygon holds no more."""
TIMESTAMP = datetime(2000, 1, 1)
"""Written into every GDSII file, so that equal devices give equal files."""
NEAR_WALL_PITCHES = 3
TEXT_HEIGHT_UM = 120.0


class Population(NamedTuple):
    """A cell type that enters the device; `error_deg`: ± on its angle, None if unknown."""

    name: str
    radius_um: float
    angle_deg: float
    error_deg: float | None = None


class Exit(NamedTuple):
    """Where the middle of a population's stream leaves the array [µm above the lower wall].

    Lowest and highest are those within the error of the angle, None if that is unknown.
    """

    population: Population
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

    ``lanes`` (N_p,): pillars in row 0 … N_p − 1, after which the rows repeat. ``polygons``: by
    layer; ``paths``: expected ways of the populations (documentation layer).
    """

    name: str
    geometry: Geometry
    device: Device
    rows: int
    lanes: tuple[int, ...]
    lowest_um: float
    exits: tuple[Exit, ...]
    split_um: float
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
    def width_um(self) -> float:
        return 1e3 * self.device.array_width_mm

    def pillars_in_row(self, row: int) -> int:
        return self.lanes[row % self.geometry.periodicity]

    def expected(self) -> dict[str, Any]:
        """Dimensions, expected exits and what they mean, for JSON."""
        geometry, device = self.geometry, self.device
        clearances = self._wall_gaps()
        return {
            "name": self.name,
            **geometry.model_dump(),
            "pitch_um": geometry.pitch_um,
            "row_shift_um": self.shift_um,
            "rows": self.rows,
            "pillars": sum(self.pillars_in_row(i) for i in range(self.rows)),
            "array_length_um": self.length_um,
            "array_width_um": self.width_um,
            "wall_gap_min_um": min(clearances),
            "wall_gap_max_um": max(clearances),
            "sample_position_um": 1e3 * device.sample_position_mm,
            "sample_width_um": device.sample_width_um,
            "outlet_split_um": self.split_um,
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

    def _wall_gaps(self) -> list[float]:
        """Gaps between side walls and the next pillar, of every row of a period."""
        radius, pitch = self.geometry.pillar_radius_um, self.geometry.pitch_um
        gaps = []
        for row, lanes in enumerate(self.lanes):
            low = self.lowest_um + row * self.shift_um
            gaps += [low - radius, self.width_um - (low + (lanes - 1) * pitch) - radius]
        return gaps


def make_layout(
    geometry: Geometry, device: Device, populations: Sequence[Population], name: str
) -> Layout:
    """Lay out a device for two populations or more; lengths are rounded to the nanometre.

    Raises DldsimError if the array is shorter than one period or narrower than three pillars.
    """
    geometry = geometry.model_copy(
        update={key: round(getattr(geometry, key), 3) for key in ("pillar_radius_um", "gap_um")}
    )
    pitch, radius, period = geometry.pitch_um, geometry.pillar_radius_um, geometry.periodicity
    rows = math.floor(1e3 * device.array_length_mm / pitch + 1e-9)
    if rows < period:
        raise DldsimError(
            f"device.array_length_mm = {device.array_length_mm:g} holds {rows} rows of "
            f"{pitch:.4g} µm, fewer than one period of {period}; {period * pitch / 1e3:.3g} mm "
            "or more are needed."
        )
    width = 1e3 * device.array_width_mm
    lowest = device.wall_gap_fraction * geometry.gap_um + radius
    lanes = tuple(
        math.floor((width - 2 * lowest - row * pitch / period) / pitch + 1e-9) + 1
        for row in range(period)
    )
    if min(lanes) < 3:
        raise DldsimError(
            f"device.array_width_mm = {device.array_width_mm:g} holds {max(min(lanes), 0)} pillars "
            f"of pitch {pitch:.4g} µm in a row; 3 are needed. Widen the array."
        )
    length = rows * pitch
    exits = tuple(_exit(geometry, device, length, p) for p in populations)
    layout = Layout(name, geometry, device, rows, lanes, lowest, exits, _split(exits, device))
    _draw(layout)
    return layout


def _exit(geometry: Geometry, device: Device, length: float, population: Population) -> Exit:
    start, width = 1e3 * device.sample_position_mm, 1e3 * device.array_width_mm
    wall = population.radius_um, width - population.radius_um

    def at(angle_deg: float) -> float:
        free = start + length * math.tan(math.radians(angle_deg))
        return min(max(free, wall[0]), wall[1])

    angle, error = population.angle_deg, population.error_deg
    extremes = (None, None) if error is None else (at(angle - error), at(angle + error))
    slope = math.tan(math.radians(angle))
    reached = math.inf if slope == 0 else (wall[slope > 0] - start) / slope
    return Exit(
        population, mode_of(angle, geometry.row_shift_fraction), at(angle), *extremes,
        reached if reached < length else None,
    )  # fmt: skip


def _split(exits: Sequence[Exit], device: Device) -> float:
    """Lateral position of the wall between the outlets, midway between the nearest cell edges."""
    width = 1e3 * device.array_width_mm
    low, *_, high = sorted(exits, key=lambda e: e.position_um)
    middle = (low.position_um + low.population.radius_um
              + high.position_um - high.population.radius_um) / 2  # fmt: skip
    narrowest = device.sample_width_um + device.divider_um / 2
    return min(max(middle, narrowest), width - narrowest)


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
    apart, free = (figures[k] for k in
                   ("separation_at_exit_um", "free_distance_between_streams_um"))  # fmt: skip
    diameter = 2 * max(e.population.radius_um for e in layout.exits)
    length = figures["length_for_parted_streams_mm"]
    more = "" if length is None else f" An array of {length:.3g} mm would part the streams."
    if apart < diameter:
        notes = [f"The populations leave {apart:.1f} µm apart, less than a cell diameter "
                 f"({diameter:.1f} µm): no outlet can divide them.{more}"]  # fmt: skip
    elif free <= 0:
        notes = [f"The populations leave {apart:.0f} µm apart, but their streams, as wide as the "
                 f"sample stream and a cell, overlap by {-free:.0f} µm.{more}"]  # fmt: skip
    else:
        notes = [f"The populations leave {apart:.0f} µm apart, with {free:.0f} µm between their "
                 "streams."]  # fmt: skip
    pitch, width = layout.geometry.pitch_um, layout.width_um
    for e in layout.exits:
        who = f"{e.population.name} ({e.population.angle_deg:.2f}°)"
        if e.wall_at_um is not None:
            notes.append(f"{who} reaches a side wall after {e.wall_at_um / 1e3:.2f} mm; widen the "
                         "array or move the sample stream.")  # fmt: skip
        elif min(e.position_um, width - e.position_um) < NEAR_WALL_PITCHES * pitch:
            notes.append(f"{who} leaves within {NEAR_WALL_PITCHES} pitches of a side wall, where "
                         "the flow is not that of the array.")  # fmt: skip
    notes.append(
        "The sample stream has its width if the three inlets are fed in proportion to their widths."
    )
    notes.append("Positions hold for the settled motion over the whole length; the first rows, "
                 "side walls, and dispersion among cells of one type are not in them.")  # fmt: skip
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
    leaving = [(0, layout.split_um - wall / 2), (layout.split_um + wall / 2, width)]
    parts = [_box(-lead, length + lead, 0, width)]
    ends = (inlet, -lead, entering, -1), (outlet, length + lead, leaving, 1)
    for end, near, streams, way in ends:
        beyond = end + 1.5 * way * port
        middles = width / 2 + 2 * port * (np.arange(len(streams)) - (len(streams) - 1) / 2)
        for (low, high), middle in zip(streams, middles, strict=True):
            feed = [(beyond, middle + port / 8), (beyond, middle - port / 8)]
            parts += [
                _box(near, end, low, high),
                np.array([(end, low), (end, high), *feed]),
                _circle((beyond, middle), port / 2, device.facet_tolerance_um),
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


def _circle(centre: tuple[float, float], radius: float, tolerance: float) -> np.ndarray:
    """Regular polygon with its corners on the circle and its sides within the tolerance of it.

    The number of corners is a multiple of 4, so that the extents along x and y are the diameter.
    """
    n = 4 * max(2, math.ceil(math.pi / math.acos(max(1 - tolerance / radius, 0)) / 4))
    angle = 2 * np.pi * np.arange(n) / n
    return np.column_stack([np.cos(angle), np.sin(angle)]) * radius + centre


def _cross(centre: tuple[float, float], size: float) -> np.ndarray:
    a, b = size / 2, size / 20
    corners = [(-a, -b), (-b, -b), (-b, -a), (b, -a), (b, -b), (a, -b),
               (a, b), (b, b), (b, a), (-b, a), (-b, b), (-a, b)]  # fmt: skip
    return np.array(corners) + centre


def _union(parts: Iterable[np.ndarray]) -> list[np.ndarray]:
    import gdstk

    whole = gdstk.boolean([gdstk.Polygon(p) for p in parts], [], "or", precision=1e-4)
    return [polygon.points for polygon in whole]


def write_gds(layout: Layout, path: Path) -> None:
    """GDSII: one pillar cell, repeated on the skewed lattice (λ, ελ), (0, λ) within a period of
    N_p rows, and the period repeated along the array. Units µm, resolution 1 nm."""
    import gdstk

    library = gdstk.Library(layout.name, unit=1e-6, precision=1e-9)
    layer = {name: getattr(layout.device, f"layer_{name}") for name in LAYERS}
    pillar, period, rest, device = (library.new_cell(name) for name in
                                    ("PILLAR", "PERIOD", "LAST_ROWS", "DEVICE"))  # fmt: skip
    g = layout.geometry
    circle = _circle((0, 0), g.pillar_radius_um, layout.device.facet_tolerance_um)
    pillar.add(gdstk.Polygon(circle, layer["pillars"]))
    periods, left = divmod(layout.rows, g.periodicity)
    for cell, rows in ((period, g.periodicity), (rest, left)):
        for first, count, lanes in _blocks(layout.lanes[:rows]):
            x, y = (first + 0.5) * g.pitch_um, layout.lowest_um + first * layout.shift_um
            block = gdstk.Reference(pillar, (x, y))
            block.repetition = gdstk.Repetition(
                columns=count, rows=lanes, v1=(g.pitch_um, layout.shift_um), v2=(0, g.pitch_um)
            )
            cell.add(block)
    length = g.periodicity * g.pitch_um
    device.add(gdstk.Reference(period, (0, 0), columns=periods, rows=1, spacing=(length, length)))
    if left:
        device.add(gdstk.Reference(rest, (periods * length, 0)))
    else:
        library.remove(rest)
    for name, polygons in layout.polygons.items():
        device.add(*(gdstk.Polygon(p, layer[name]) for p in polygons))
    for p in layout.paths:
        device.add(gdstk.FlexPath(p, 2.0, simple_path=True, layer=layer["documentation"]))
    for t in layout.texts:
        if t.layer == "label":
            device.add(*gdstk.text(t.text, t.height, t.place, layer=layer["label"]))
        device.add(gdstk.Label(t.text, t.place, layer=layer["documentation"]))
    with atomic_path(path) as part:
        library.write_gds(part, max_points=MAX_POINTS, timestamp=TIMESTAMP)


def _blocks(lanes: Sequence[int]) -> list[tuple[int, int, int]]:
    """Runs of rows with equally many pillars: (first row, rows, pillars)."""
    blocks, first = [], 0
    for count, rows in groupby(lanes):
        size = len(list(rows))
        blocks.append((first, size, count))
        first += size
    return blocks


def write_dxf(layout: Layout, path: Path) -> None:
    """DXF (R2010, units µm): pillars are true circles in a block, one insert with columns and rows
    for each row of a period; one layer a kind."""
    import ezdxf

    document = ezdxf.new("R2010")
    document.units = ezdxf.units.InsertUnits.Microns
    document.header["$MEASUREMENT"] = 1
    for number, name in enumerate(LAYERS, start=1):
        document.layers.add(name.upper(), color=number)
    g = layout.geometry
    block = document.blocks.new("PILLAR")
    block.add_circle((0, 0), g.pillar_radius_um, dxfattribs={"layer": "PILLARS"})
    space = document.modelspace()
    for row in range(g.periodicity):
        x, y = (row + 0.5) * g.pitch_um, layout.lowest_um + row * layout.shift_um
        space.add_blockref("PILLAR", (x, y), dxfattribs={
            "layer": "PILLARS",
            "row_count": layout.lanes[row], "row_spacing": g.pitch_um,
            "column_count": len(range(row, layout.rows, g.periodicity)),
            "column_spacing": g.periodicity * g.pitch_um,
        })  # fmt: skip
    for name, polygons in layout.polygons.items():
        for polygon in polygons:
            space.add_lwpolyline(polygon, close=True, dxfattribs={"layer": name.upper()})
    for p in layout.paths:
        space.add_lwpolyline(p, dxfattribs={"layer": "DOCUMENTATION"})
    for t in layout.texts:
        text = space.add_text(t.text, height=t.height, dxfattribs={"layer": t.layer.upper()})
        text.set_placement(t.place)
    # saving would list the classes of entities in an order that differs between processes
    classes = document.classes
    classes.add_required_classes(document.dxfversion)
    classes.classes = dict(sorted(classes.classes.items()))
    with atomic_path(path) as part:
        document.saveas(part)


def draw_mask(path: Path, device: Device) -> "Figure":
    """Picture of a GDSII file as it is on disk: the whole device, and its array at the inlet."""
    import gdstk
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure

    colours = {"channel": "#DCE9F5", "pillars": "#4A5560", "alignment": "#D55E00",
               "label": "#000000", "documentation": "#009E73"}  # fmt: skip
    [top] = gdstk.read_gds(path).top_level()
    figure = Figure(figsize=(9.2, 6.4), layout="constrained")
    panels = figure.subplots(2, 1, height_ratios=(3, 2))
    for name, colour in colours.items():
        shapes = [p.points for p in top.get_polygons(layer=getattr(device, f"layer_{name}"),
                                                     datatype=0)]  # fmt: skip
        alpha = 0.5 if name == "documentation" else 1
        for panel in panels:
            panel.add_collection(PolyCollection(shapes, facecolor=colour, alpha=alpha, linewidth=0))
    panels[0].autoscale()
    (left, _), (_, high) = top.bounding_box()
    x = min(1e3 * device.inlet_length_mm, 150.0)
    middle = 1e3 * device.sample_position_mm
    panels[1].set(xlim=(-x, 5 * x), ylim=(middle - 1.2 * x, middle + 1.2 * x))
    for panel, title in zip(panels, ("Device", "Sample stream entering the array"), strict=True):
        panel.set(aspect="equal", title=title, xlabel="x [µm]", ylabel="y [µm]")
    return figure
