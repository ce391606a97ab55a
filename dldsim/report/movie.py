"""Picture and animation of cells passing an array, seen from above.

Each cell was simulated alone; cells of one picture share array, release and clock only. Outlines
are those of the membrane, where it turns from facing up to facing down.
"""

from collections.abc import Mapping
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PatchCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.patheffects import withStroke

from dldsim.errors import DldsimError
from dldsim.experiments.vtk import Shapes, pillars_near
from dldsim.files import atomic_path
from dldsim.report.style import PILLAR, STYLE
from dldsim.solver.mesh import area_vectors, make_topology

COLOURS = ("#D55E00", "#0072B2", "#009E73", "#CC79A7")
LINES = ("-", "--", "-.", ":")
"""Colour and line of the cells, safe for colour-blind readers and for print."""
MOST_ROWS = 16
"""Rows that are shown at most, from the release."""
PALETTE = 64


def rows_shown(passages: Mapping[str, Shapes]) -> int:
    """Rows that picture and animation show."""
    passed = max(
        int((s.centre_um[-1, 0] - s.centre_um[0, 0]) / s.geometry.pitch_um)
        for s in passages.values()
    )
    return max(1, min(MOST_ROWS, passed))


def silhouette(points_um: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A membrane (V, 3) seen along z: triangles facing up (n, 3, 2), and contour edges (m, 2, 2).

    The triangles facing up cover the whole shadow of a closed surface; a contour edge has one face
    up and one down.
    """
    up = area_vectors(points_um.astype(float), faces)[:, 2] > 0
    topology = make_topology(faces)
    contour = up[topology.edge_faces[:, 0]] != up[topology.edge_faces[:, 1]]
    flat = points_um[:, :2]
    return flat[faces[up]], flat[topology.edges[contour]]


def draw_passage(passages: Mapping[str, Shapes], instants: int = 9) -> Figure:
    """Paths of the cells through one array, with their shapes at equal steps of time.

    ``passages``: shapes by the cells' names, as the legend shows them. Raises DldsimError if they
    belong to different arrays.
    """
    with matplotlib.rc_context(STYLE):
        figure, panel, end = _stage(passages)
        times = np.linspace(0, end, instants)
        for i, shapes in enumerate(passages.values()):
            panel.plot(*shapes.centre_um[:, :2].T, LINES[i], color=COLOURS[i], linewidth=1.2)
            for t in times[times <= shapes.t_ms[-1]]:
                for artist in _cell(shapes, _frame(shapes, t), COLOURS[i]):
                    panel.add_collection(artist)
        panel.text(
            1,
            1.02,
            f"cells every {end / (instants - 1):.3g} ms",
            transform=panel.transAxes,
            ha="right",
        )
    return figure


def write_animation(
    passages: Mapping[str, Shapes], path: Path, frames: int = 90, frames_per_second: int = 15
) -> None:
    """Animated GIF of the cells passing the array, with the time since release.

    A cell whose run ended before the animation does stays as an empty outline. Raises DldsimError
    if the passages belong to different arrays.
    """
    from PIL import Image

    with matplotlib.rc_context(STYLE):
        figure, panel, end = _stage(passages)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        background = canvas.copy_from_bbox(figure.bbox)
        images = []
        for t in np.linspace(0, end, frames):
            canvas.restore_region(background)
            for i, shapes in enumerate(passages.values()):
                n = _frame(shapes, t)
                way = Line2D(
                    *shapes.centre_um[: n + 1, :2].T,
                    color=COLOURS[i],
                    linewidth=1.2,
                    linestyle=LINES[i],
                )
                panel.add_line(way)
                panel.draw_artist(way)
                for artist in _cell(shapes, n, COLOURS[i], filled=t <= shapes.t_ms[-1]):
                    panel.add_collection(artist)
                    panel.draw_artist(artist)
                    artist.remove()
                way.remove()
            clock = panel.text(1, 1.02, f"{t:.1f} ms", transform=panel.transAxes, ha="right")
            panel.draw_artist(clock)
            clock.remove()
            images.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3]))
    palette = images[len(images) // 2].quantize(PALETTE, dither=Image.Dither.NONE)
    images = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    with atomic_path(path) as part:
        images[0].save(
            part,
            format="GIF",
            save_all=True,
            append_images=images[1:],
            loop=0,
            duration=round(1000 / frames_per_second),
        )


def _stage(passages: Mapping[str, Shapes]) -> tuple[Figure, matplotlib.axes.Axes, float]:
    """Figure and panel with pillars, legend, scale bar and flow; time [ms] at which all is over."""
    first = next(iter(passages.values()))
    geometry = first.geometry
    for name, shapes in passages.items():
        if shapes.geometry != geometry:
            raise DldsimError(
                f"{name} passed the array {shapes.geometry}, not {geometry}: cells of one picture "
                "must have passed the same. Draw them one by one."
            )
    pitch = geometry.pitch_um
    left = first.centre_um[0, 0] - 0.5 * pitch
    right = first.centre_um[0, 0] + (rows_shown(passages) + 0.5) * pitch
    seen = [s.centre_um[s.centre_um[:, 0] < right] for s in passages.values()]
    end = max(s.t_ms[len(part) - 1] for s, part in zip(passages.values(), seen, strict=True))
    path = np.concatenate(seen)
    low, high = path[:, 1].min() - 1.2 * pitch, path[:, 1].max() + 1.2 * pitch
    width = 9.2
    figure = Figure(
        figsize=(width, width * (high - low) / (right - left) + 0.7), layout="constrained"
    )
    panel = figure.subplots()
    pillars = pillars_near(geometry, path[:, :2], high - low)
    panel.add_collection(
        PatchCollection(
            [Circle(p, geometry.pillar_radius_um) for p in pillars], facecolor=PILLAR, linewidth=0
        )
    )
    panel.set(xlim=(left, right), ylim=(low, high), aspect="equal", xticks=[], yticks=[])
    panel.spines[:].set_visible(True)
    panel.grid(False)
    figure.legend(
        [
            Line2D([], [], color=c, linestyle=line)
            for c, line, _ in zip(COLOURS, LINES, passages, strict=False)
        ],
        list(passages),
        loc="outside lower center",
        ncols=len(passages),
    )
    bar = _round_length((right - left) / 6)
    x, y = left + 0.03 * (right - left), low + 0.05 * (high - low)
    halo = [withStroke(linewidth=4, foreground="white")]
    panel.plot(
        [x, x + bar],
        [y, y],
        color="black",
        linewidth=2.5,
        solid_capstyle="butt",
        zorder=5,
        path_effects=halo,
    )
    panel.text(
        x + bar / 2,
        y + 0.04 * bar,
        f"{bar:g} µm",
        ha="center",
        va="bottom",
        zorder=5,
        path_effects=halo,
    )
    panel.text(
        0,
        1.02,
        f"flow →    P_r {geometry.pillar_radius_um:g} µm, P_g {geometry.gap_um:g} "
        f"µm, N_p {geometry.periodicity}",
        transform=panel.transAxes,
    )
    return figure, panel, float(end)


def _frame(shapes: Shapes, t_ms: float) -> int:
    """Number of the recorded shape nearest to a time."""
    return int(np.abs(shapes.t_ms - t_ms).argmin())


def _cell(shapes: Shapes, frame: int, colour: str, filled: bool = True) -> list:
    body, contour = silhouette(shapes.points_um[frame], shapes.faces)
    light = 1 - 0.4 * (1 - np.array(to_rgb(colour)))
    outline = LineCollection(contour, colors=colour, linewidths=1, zorder=3)
    return (
        [PolyCollection(body, facecolor=light, edgecolor=light, linewidth=0.3, zorder=2.5), outline]
        if filled
        else [outline]
    )


def _round_length(most_um: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that does not exceed a length."""
    power = 10.0 ** np.floor(np.log10(most_um))
    return float(max(m for m in (1, 2, 5) if m * power <= most_um) * power)
