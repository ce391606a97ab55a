"""Picture and animation: outlines, what is shown, and the file as its library opens it."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import LineCollection, PatchCollection, PolyCollection
from matplotlib.colors import to_hex
from PIL import Image

from dldsim.config.sections import Geometry
from dldsim.errors import DldsimError
from dldsim.experiments.vtk import Shapes
from dldsim.report.movie import (
    COLOURS,
    MOST_ROWS,
    draw_passage,
    rows_shown,
    silhouette,
    write_animation,
)
from dldsim.solver.mesh import make_shape

GEOMETRY = Geometry(pillar_radius_um=5, gap_um=12, periodicity=4)


def passage(rows, angle_deg=0.0, times=40, ms_per_row=10.0):
    """A rigid sphere of 3 µm radius on a straight path from midway between two rows."""
    vertices, faces = make_shape("sphere", 3.0, 4)
    x = np.linspace(0, rows * GEOMETRY.pitch_um, times)
    centres = np.column_stack([x - 11, 8 + x * np.tan(np.radians(angle_deg)), 0 * x])
    points = (centres[:, None] + vertices).astype(np.float32)
    t = np.linspace(0, rows * ms_per_row, times)
    return Shapes(GEOMETRY, 12.0, 3.0, 10 * np.arange(times), t, centres, points, faces)


@pytest.fixture(scope="module")
def passages():
    return {"soft": passage(3), "stiff": passage(4, 8.0)}


def polygon_area(corners):
    x, y = np.moveaxis(corners, -1, 0)
    return 0.5 * np.abs(np.sum(x * np.roll(y, -1, axis=-1) - y * np.roll(x, -1, axis=-1), axis=-1))


def test_silhouette_of_a_sphere():
    vertices, faces = make_shape("sphere", 3.0, 12)
    body, contour = silhouette(vertices + (40, -7, 2), faces)
    assert polygon_area(body).sum() == pytest.approx(9 * np.pi, rel=0.01)
    length = np.linalg.norm(np.diff(contour, axis=1), axis=2).sum()
    assert length == pytest.approx(6 * np.pi, rel=0.05)
    radius = np.linalg.norm(contour - (40, -7), axis=2)
    assert radius.min() > 2.8 and radius.max() <= 3.0 + 1e-9


def test_silhouette_of_a_dented_cell_shows_the_dents():
    """From above, an upright biconcave disc; seen face on, its rim alone."""
    for axis, shadow in (("z", 9 * np.pi), ("y", None)):
        vertices, faces = make_shape("biconcave", 3.0, 12, axis=axis)
        body, contour = silhouette(vertices, faces)
        if shadow:
            assert polygon_area(body).sum() == pytest.approx(shadow, rel=0.02)
        reach = np.abs(contour).max(axis=(0, 1))
        np.testing.assert_allclose(reach, np.abs(vertices[:, :2]).max(axis=0), rtol=0.02)


def test_rows_shown(passages):
    assert rows_shown(passages) == 4
    assert rows_shown({"far": passage(50)}) == MOST_ROWS
    assert rows_shown({"stuck": passage(0.4)}) == 1


def test_picture_shows_pillars_paths_and_shapes(passages):
    figure = draw_passage(passages, instants=5)
    [panel] = figure.axes
    [pillars] = [c for c in panel.collections if type(c) is PatchCollection]
    for path in pillars.get_paths():
        box = path.get_extents()
        assert (box.width, box.height) == pytest.approx((10, 10))
        place = np.array([(box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2])
        row = round(place[0] / 22)
        assert place[0] == pytest.approx(22 * row)
        assert (place[1] - 5.5 * row) / 22 == pytest.approx(round((place[1] - 5.5 * row) / 22))
    # the slower one is seen at 0, 10, 20, 30 ms, the other at 40 ms too
    contours = [c for c in panel.collections if type(c) is LineCollection]
    colours = [to_hex(c.get_color()[0]).upper() for c in contours]
    assert [colours.count(c) for c in COLOURS[:2]] == [4, 5]
    path = panel.lines[-1].get_xydata()
    np.testing.assert_allclose(path, passages["stiff"].centre_um[:, :2])
    words = [t.get_text() for t in panel.texts]
    assert "20 µm" in words[0] or "10 µm" in words[0]
    assert any("P_r 5 µm, P_g 12 µm, N_p 4" in w for w in words)
    assert any("every 10 ms" in w for w in words)
    assert [t.get_text() for t in figure.legends[0].get_texts()] == ["soft", "stiff"]
    bar = panel.lines[0].get_xdata()
    assert f"{bar[1] - bar[0]:g} µm" in words


def test_animation_opens_and_moves(passages, tmp_path):
    path = tmp_path / "a.gif"
    write_animation(passages, path, frames=8, frames_per_second=10)
    with Image.open(path) as movie:
        assert (movie.n_frames, movie.info["duration"], movie.info["loop"]) == (8, 100, 0)
        frames = []
        for n in range(movie.n_frames):
            movie.seek(n)
            frames.append(np.asarray(movie.convert("RGB")).astype(int))
    # the blue cell's fill moves to the right from frame to frame
    blue = np.array([0x99, 0xC6, 0xE0])
    middle = []
    for frame in frames:
        found = np.argwhere(np.abs(frame - blue).sum(axis=2) < 30)
        middle.append(found[:, 1].mean())
    assert len(found) > 50 and np.all(np.diff(middle) > 5)
    assert path.stat().st_size < 400_000


def test_a_finished_run_stays_as_an_outline(passages, tmp_path):
    write_animation(passages, tmp_path / "a.gif", frames=5)
    with Image.open(tmp_path / "a.gif") as movie:
        frames = []
        for n in (3, 4):  # its last moment, and after
            movie.seek(n)
            frames.append(np.asarray(movie.convert("RGB")).astype(int))
    fill, line = np.array([0xEE, 0xBF, 0x99]), np.array([0xD5, 0x5E, 0x00])
    during, after = ((np.abs(f - fill).sum(axis=2) < 20).sum() for f in frames)
    assert during > 1000 and after < 200
    assert (np.abs(frames[1] - line).sum(axis=2) < 30).sum() > 50


def test_cells_of_different_arrays_are_refused(passages):
    other = Geometry(pillar_radius_um=5, gap_um=12, periodicity=6)
    mixed = {**passages, "other": replace(passages["soft"], geometry=other)}
    with pytest.raises(DldsimError, match="must have passed the same"):
        draw_passage(mixed)


def test_bodies_are_drawn_below_outlines(passages):
    panel = draw_passage(passages).axes[0]
    bodies = [c.get_zorder() for c in panel.collections if type(c) is PolyCollection]
    outlines = [c.get_zorder() for c in panel.collections if type(c) is LineCollection]
    assert max(bodies) < min(outlines)
