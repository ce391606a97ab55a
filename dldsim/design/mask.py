"""Photomask of a design's layout as GDSII and as DXF, lengths in µm."""

import hashlib
import re
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dldsim.config.design_sections import Device
from dldsim.design.layout import LAYERS, Layout, circle
from dldsim.files import atomic_path

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.path import Path as Outline

MAX_POINTS = 8190
"""A GDSII polygon holds no more."""
TIMESTAMP = datetime(2000, 1, 1)
"""Written into every GDSII file, so that equal devices give equal files."""


def write_gds(layout: Layout, path: Path) -> None:
    """GDSII: one pillar cell, repeated on the skewed lattice (λ, ελ), (0, λ) within a period of
    N_p rows, and the period repeated along the array. Units µm, resolution 1 nm."""
    import gdstk

    library = gdstk.Library(layout.name, unit=1e-6, precision=1e-9)
    layer = {name: getattr(layout.device, f"layer_{name}") for name in LAYERS}
    pillar, period, rest, device = (
        library.new_cell(structure_name(layout, part))
        for part in ("PILLAR", "PERIOD", "LAST_ROWS", "DEVICE")
    )
    g = layout.geometry
    outline = circle((0, 0), g.pillar_radius_um, layout.device.facet_tolerance_um)
    pillar.add(gdstk.Polygon(outline, layer["pillars"]))
    periods, left = divmod(layout.rows, g.periodicity)
    for cell, rows in ((period, g.periodicity), (rest, left)):
        if rows:
            block = gdstk.Reference(pillar, (g.pitch_um / 2, layout.lowest_um))
            block.repetition = gdstk.Repetition(
                columns=rows,
                rows=layout.lanes,
                v1=(g.pitch_um, layout.shift_um),
                v2=(0, g.pitch_um),
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


NAME_LENGTH = 32
"""A GDSII structure name has no more, of A to Z, a to z, 0 to 9, _, ? and $."""


def structure_name(layout: Layout, part: str) -> str:
    """Name of one part of a design's mask: its own, wherever it meets others in one layout.

    The design's name as far as it fits, a hash of all that is drawn, and the part. Layout programs
    take structures of one name for the same.
    """
    digest = hashlib.sha256(repr((layout.expected(), layout.device)).encode()).hexdigest()[:8]
    end = f"_{digest}_{part}"
    return re.sub("[^A-Za-z0-9_]", "_", layout.name)[: NAME_LENGTH - len(end)] + end


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
    pillar = structure_name(layout, "PILLAR")
    block = document.blocks.new(pillar)
    block.add_circle((0, 0), g.pillar_radius_um, dxfattribs={"layer": "PILLARS"})
    space = document.modelspace()
    for row in range(g.periodicity):
        x, y = (row + 0.5) * g.pitch_um, layout.lowest_um + row * layout.shift_um
        space.add_blockref(
            pillar,
            (x, y),
            dxfattribs={
                "layer": "PILLARS",
                "row_count": layout.lanes,
                "row_spacing": g.pitch_um,
                "column_count": len(range(row, layout.rows, g.periodicity)),
                "column_spacing": g.periodicity * g.pitch_um,
            },
        )
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
    from matplotlib.collections import PathCollection, PolyCollection
    from matplotlib.figure import Figure

    colours = {
        "channel": "#DCE9F5",
        "pillars": "#4A5560",
        "alignment": "#D55E00",
        "label": "#000000",
        "documentation": "#009E73",
    }
    [top] = gdstk.read_gds(path).top_level()
    figure = Figure(figsize=(9.2, 6.4), layout="constrained")
    panels = figure.subplots(2, 1, height_ratios=(3, 2))
    for name, colour in colours.items():
        shapes = [
            p.points for p in top.get_polygons(layer=getattr(device, f"layer_{name}"), datatype=0)
        ]
        for panel in panels:
            if name == "pillars":  # thousands, none of which meets another
                panel.add_collection(
                    PathCollection([_as_one(shapes)], facecolor=colour, linewidth=0)
                )
                continue
            alpha = 0.5 if name == "documentation" else 1
            panel.add_collection(PolyCollection(shapes, facecolor=colour, alpha=alpha, linewidth=0))
    panels[0].autoscale()
    (left, _), (_, high) = top.bounding_box()
    x = min(1e3 * device.inlet_length_mm, 150.0)
    middle = 1e3 * device.sample_position_mm
    panels[1].set(xlim=(-x, 5 * x), ylim=(middle - 1.2 * x, middle + 1.2 * x))
    for panel, title in zip(panels, ("Device", "Sample stream entering the array"), strict=True):
        panel.set(aspect="equal", title=title, xlabel="x [µm]", ylabel="y [µm]")
    return figure


def _as_one(polygons: Sequence[np.ndarray]) -> "Outline":
    """Polygons (n, 2) each as one outline, which is drawn at once."""
    from matplotlib.path import Path as Outline

    closed = [points for polygon in polygons for points in (polygon, polygon[:1])]
    ends = np.cumsum([len(polygon) + 1 for polygon in polygons])
    codes = np.full(ends[-1], Outline.LINETO, Outline.code_type)
    codes[ends - 1] = Outline.CLOSEPOLY
    codes[np.r_[0, ends[:-1]]] = Outline.MOVETO
    return Outline(np.concatenate(closed), codes)
