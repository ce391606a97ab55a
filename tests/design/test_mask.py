"""Photomasks: files are opened again with their libraries and measured."""

import math
import re
from dataclasses import replace

import ezdxf
import gdstk
import numpy as np
import pytest
from scipy.spatial import cKDTree

from dldsim.config.design_sections import Device
from dldsim.config.sections import Geometry
from dldsim.design.layout import Stream, make_layout
from dldsim.design.mask import draw_mask, write_dxf, write_gds
from dldsim.design.side_walls import wall_levels, whole_array
from dldsim.errors import DldsimError

NM = 1e-3
"""A GDSII file holds whole nanometres: a coordinate is off by half of one at most."""
SMALL = Device(array_length_mm=1.5, array_width_mm=0.8)
GEOMETRIES = [(7.3218, 16.345, 8), (5.0, 12.0, 4), (12.0, 22.0, 11), (6.0, 14.0, 3)]


def layout_of(radius, gap, periodicity, device=SMALL, angles=(0.4, 4.0)):
    geometry = Geometry(pillar_radius_um=radius, gap_um=gap, periodicity=periodicity)
    cells = [Stream(f"cell {i}", 7.5, a, 0.5) for i, a in enumerate(angles, 1)]
    return make_layout(geometry, device, cells, "a-design-01")


@pytest.fixture(scope="module", params=GEOMETRIES, ids=str)
def made(request, tmp_path_factory):
    """Requested geometry, GDSII cell at the top, DXF document."""
    layout = layout_of(*request.param)
    gds, dxf = (tmp_path_factory.mktemp("mask") / f"d.{e}" for e in ("gds", "dxf"))
    write_gds(layout, gds)
    write_dxf(layout, dxf)
    library = gdstk.read_gds(gds)
    assert (library.unit, library.precision) == (1e-6, 1e-9)
    [top] = library.top_level()
    return request.param, top, ezdxf.readfile(dxf)


def on_layer(top, name, device=SMALL):
    return [p.points for p in top.get_polygons(layer=getattr(device, f"layer_{name}"), datatype=0)]


def gds_centres(top):
    """Centre of every pillar (n, 2), midway between its outermost corners."""
    return np.array([(p.min(axis=0) + p.max(axis=0)) / 2 for p in on_layer(top, "pillars")])


def dxf_circles(document):
    inserts = document.modelspace().query("INSERT")
    return [
        circle
        for insert in inserts
        for one in insert.multi_insert()
        for circle in one.virtual_entities()
    ]


def measure(centres, radius):
    """Gap, pitch along x, and shifts from row to row modulo the pitch, of pillars (n, 2)."""
    names, row = np.unique(np.round(centres[:, 0], 1), return_inverse=True)
    x, lowest, pitch = [], [], []
    for i in range(len(names)):
        y = np.sort(centres[row == i, 1])
        x.append(centres[row == i, 0].mean())
        lowest.append(y[0])
        pitch.append(np.diff(y))
    pitch = np.concatenate(pitch)
    return pitch - 2 * radius, np.diff(x), np.diff(lowest) % pitch.mean()


def assert_array(centres, radius, requested, tolerance):
    wanted, gap, periodicity = requested
    assert radius == pytest.approx(wanted, abs=tolerance)
    gaps, pitches, shifts = measure(centres, radius)
    np.testing.assert_allclose(gaps, gap, atol=3 * tolerance)
    np.testing.assert_allclose(pitches, 2 * wanted + gap, atol=3 * tolerance)
    np.testing.assert_allclose(shifts, (2 * wanted + gap) / periodicity, atol=3 * tolerance)


def test_gds_has_the_requested_pillars(made):
    requested, top, _ = made
    for polygon in on_layer(top, "pillars"):
        distance = np.linalg.norm(polygon - (polygon.min(axis=0) + polygon.max(axis=0)) / 2, axis=1)
        # corners on the circle, sides within the facet tolerance inside it
        assert distance.max() == pytest.approx(requested[0], abs=2 * NM)
        middle = (polygon + np.roll(polygon, 1, axis=0)) / 2
        inner = np.linalg.norm(middle - middle.mean(axis=0), axis=1).min()
        assert inner >= requested[0] - SMALL.facet_tolerance_um - 2 * NM
    width = np.mean([np.ptp(p[:, 0]) for p in on_layer(top, "pillars")])
    assert_array(gds_centres(top), width / 2, requested, SMALL.facet_tolerance_um)


def test_dxf_has_the_same_pillars_as_true_circles(made):
    requested, top, document = made
    circles = dxf_circles(document)
    assert {c.dxftype() for c in circles} == {"CIRCLE"}
    assert {c.dxf.radius for c in circles} == {round(requested[0], 3)}
    centres = np.array([(c.dxf.center.x, c.dxf.center.y) for c in circles])
    assert_array(centres, circles[0].dxf.radius, requested, NM)
    distance, other = cKDTree(gds_centres(top)).query(centres)
    assert distance.max() < 2 * NM and len(set(other)) == len(centres) == len(gds_centres(top))


def test_dxf_names_unit_and_layers(made):
    _, _, document = made
    assert document.header["$INSUNITS"] == 13  # micrometres
    assert not document.audit().errors
    used = {e.dxf.layer for e in document.modelspace()}
    assert used == {"CHANNEL", "PILLARS", "ALIGNMENT", "LABEL", "DOCUMENTATION"}
    assert used <= {layer.dxf.name for layer in document.layers}


def test_pillars_are_apart_and_inside_the_channel(made):
    (radius, gap, _), top, _ = made
    centres = gds_centres(top)
    nearest = cKDTree(centres).query(centres, k=2)[0][:, 1]
    assert nearest.min() >= 2 * radius + gap - 3 * NM
    [channel] = on_layer(top, "channel")
    corners = np.concatenate(on_layer(top, "pillars"))
    assert all(gdstk.inside(corners, gdstk.Polygon(channel)))
    assert corners[:, 0].min() > 0 and corners[:, 0].max() < 1500


def test_gaps_at_the_side_walls(made):
    """From every pillar beside a wall straight across to it, in the file as it is."""
    (radius, gap, periodicity), top, _ = made
    centres = gds_centres(top)
    [channel] = on_layer(top, "channel")
    expected = layout_of(radius, gap, periodicity).expected()
    found = []
    for number, x in enumerate(np.unique(np.round(centres[:, 0], 2))):
        y = np.sort(centres[np.abs(centres[:, 0] - x) < 0.1, 1])
        part = (number % periodicity + 1) / periodicity
        wanted = [gap * p ** (1 / 2.463) for p in (part, 2 - part)]
        for place, way, size in ((y[0] - radius, -1, wanted[0]), (y[-1] + radius, 1, wanted[1])):
            points = [(x, place + way * (size + d)) for d in (-5 * NM, 5 * NM)]
            assert gdstk.inside(points, gdstk.Polygon(channel)) == (True, False)
        found += wanted
    assert expected["wall_gap_min_um"] == pytest.approx(min(found))
    assert expected["wall_gap_max_um"] == pytest.approx(max(found))
    assert expected["pillars"] == len(centres)


def test_side_walls_are_straight_where_a_period_ends():
    """In row N_p a gap P_g is left at the lower wall, and at the upper one; elsewhere both walls
    are lower, so that the array never leaves the room of the channel upwards."""
    geometry = Geometry(pillar_radius_um=7, gap_um=16, periodicity=10)
    low, high = wall_levels(geometry, lanes=20)
    width = 20 * 30 + 16
    assert low[-1] == pytest.approx(0, abs=1e-12) and high[-1] == pytest.approx(width)
    assert (low[:-1] < 0).all() and (high[:-1] < width).all()
    assert low.min() > -2 * 7 - 16
    array, rows, lanes = whole_array(geometry, Device(array_length_mm=1.0, array_width_mm=0.64))
    assert (rows, lanes, array.length_um, array.width_um) == (33, 20, 990, width)


def test_one_pillar_cell_is_repeated(made, tmp_path):
    (radius, gap, periodicity), top, _ = made
    cells = {c.name.rpartition("_")[2]: c for c in top.dependencies(True)}
    assert len(cells["PILLAR"].polygons) == 1
    assert all(not c.polygons for name, c in cells.items() if name != "PILLAR")
    [periods] = [r for r in top.references if r.cell.name.endswith("_PERIOD")]
    assert periods.repetition.columns == math.floor(1500 / (2 * radius + gap)) // periodicity


def test_three_streams_enter_and_two_leave(made):
    requested, top, _ = made
    [channel] = on_layer(top, "channel")
    layout = layout_of(*requested)
    inlet, outlet = (-500.0, layout.length_um + 500)
    # from wall to wall across the inlet: fluid, wall, sample, wall, fluid
    across = [(inlet, y) for y in (100, 400 - 45, 400, 400 + 45, 700)]
    assert gdstk.inside(across, gdstk.Polygon(channel)) == (True, False, True, False, True)
    [wall] = layout.walls_um
    across = [(outlet, y) for y in (wall - 30, wall, wall + 30)]
    assert gdstk.inside(across, gdstk.Polygon(channel)) == (True, False, True)
    assert not any(gdstk.inside([(-100, -1), (-100, 801)], gdstk.Polygon(channel)))


@pytest.mark.parametrize(
    ("device", "walls", "given"),
    [
        ({"outlet_walls_um": [300.0, 500.0]}, (300, 500), None),
        ({"outlets": 4}, (199, 398, 597), None),
        ({}, (333,), (333.0,)),
    ],
)
def test_outlets_are_where_they_are_asked_for(tmp_path, device, walls, given):
    geometry = Geometry(pillar_radius_um=7, gap_um=16, periodicity=10)
    device = Device(**dict(array_length_mm=1.5, array_width_mm=0.8, **device))
    cells = [Stream(f"cell {i}", 7.5, a) for i, a in ((1, 0.4), (2, 4.0))]
    layout = make_layout(geometry, device, cells, "d", given)
    assert layout.walls_um == pytest.approx(walls)
    write_gds(layout, tmp_path / "d.gds")
    [top] = gdstk.read_gds(tmp_path / "d.gds").top_level()
    [channel] = on_layer(top, "channel")
    across = [(layout.length_um + 500, y + d) for y in walls for d in (-16, 0, 16)]
    assert gdstk.inside(across, gdstk.Polygon(channel)) == (True, False, True) * len(walls)


def test_label_names_the_design(made):
    (radius, gap, periodicity), top, document = made
    for texts in (
        [label.text for label in top.labels],
        [t.dxf.text for t in document.modelspace().query("TEXT")],
    ):
        text = " ".join(texts)
        for part in (
            "a-design-01",
            f"P_r {radius:.3f}",
            f"P_g {gap:.3f}",
            f"N_p {periodicity}",
            f"eps 1/{periodicity}",
            "cell 1: 0.40 deg",
            "cell 2: 4.00 deg",
        ):
            assert part in text
    assert len(on_layer(top, "label")) > 20 and len(on_layer(top, "alignment")) == 4


def test_expected_exits_follow_from_the_angles():
    layout = layout_of(6, 14, 8, Device(array_length_mm=4.0), angles=(-0.5, 7.0))
    length = layout.length_um
    assert length == math.floor(4000 / 26) * 26
    expected = layout.expected()
    first, second = expected["populations"]
    for exit_, angle, mode in ((first, -0.5, "zigzag"), (second, 7.0, "bump")):
        assert exit_["exit_um"] == pytest.approx(400 + length * math.tan(math.radians(angle)))
        assert exit_["mode"] == mode
        half = length * (math.tan(math.radians(angle + 0.5)) - math.tan(math.radians(angle)))
        assert exit_["exit_highest_um"] - exit_["exit_um"] == pytest.approx(half)
    apart = second["exit_um"] - first["exit_um"]
    assert expected["separation_at_exit_um"] == pytest.approx(apart)
    assert expected["free_distance_between_streams_um"] == pytest.approx(apart - 60 - 15)
    assert first["exit_um"] < expected["outlet_walls_um"][0] < second["exit_um"]
    # drawn where they are listed
    ends = [path[-1] for path in layout.paths]
    np.testing.assert_allclose(ends, [(length, p["exit_um"]) for p in expected["populations"]])


def test_an_unknown_error_gives_no_range():
    geometry = Geometry(pillar_radius_um=6, gap_um=14, periodicity=8)
    cells = [Stream("a", 7.5, 1.0), Stream("b", 7.5, 5.0)]
    for exit_ in make_layout(geometry, Device(), cells, "d").expected()["populations"]:
        assert exit_["exit_lowest_um"] is exit_["exit_highest_um"] is None


def test_notes_say_what_a_user_must_know():
    def notes(angles, **device):
        return " ".join(layout_of(6, 14, 8, Device(**device), angles).expected()["notes"])

    assert "An array of" not in notes((0, 7)) and "wall after" not in notes((0, 7))
    below = notes((3.0, 3.1))  # 9 µm at the exit
    assert "less than a cell diameter (15.0 µm): no outlet can divide them" in below
    parted = float(below.split("An array of ")[1].split(" mm")[0])
    low, high = np.tan(np.radians([3.0, 3.1]))
    assert parted == pytest.approx(0.075 / (high - low), rel=0.01)
    assert "overlap by" in notes((3.0, 3.5))
    same = notes((3.0, 3.0))
    assert "no outlet" in same and "An array of" not in same
    assert "reaches a side wall after 3.99 mm" in notes((0, 7), array_width_mm=0.92)
    assert "within 3 pitches of a side wall" in notes((0, 7), sample_position_mm=0.07)


def test_equal_layouts_give_equal_gds(tmp_path):
    for name in "ab":
        write_gds(layout_of(6, 14, 4), tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_rows_that_are_whole_periods(tmp_path):
    device = Device(array_length_mm=0.026 * 16, array_width_mm=0.8)
    write_gds(layout_of(6, 14, 8, device), tmp_path / "d.gds")
    [top] = gdstk.read_gds(tmp_path / "d.gds").top_level()
    assert len(np.unique(np.round(gds_centres(top)[:, 0], 2))) == 16
    assert not [c.name for c in top.dependencies(True) if c.name.endswith("LAST_ROWS")]


def test_two_designs_fit_into_one_layout(tmp_path):
    """Also two of one name, as commands give them; names are those that GDSII allows."""
    names = []
    for i, (radius, name) in enumerate([(6, "a-design-01"), (7, "a-design-01"), (6, "b" * 80)]):
        layout = replace(layout_of(radius, 14, 8), name=name)
        write_gds(layout, tmp_path / f"{i}.gds")
        write_dxf(layout, tmp_path / f"{i}.dxf")
        [top] = gdstk.read_gds(tmp_path / f"{i}.gds").top_level()
        names += [top.name, *(c.name for c in top.dependencies(True))]
        blocks = ezdxf.readfile(tmp_path / f"{i}.dxf").blocks
        names += [f"{b.name}-dxf" for b in blocks if b.name.endswith("_PILLAR")]
    assert len(names) == len(set(names)) == 3 * 5
    assert all(re.fullmatch(r"[A-Za-z0-9_?$]{1,32}", name.removesuffix("-dxf")) for name in names)


def test_the_two_lengths_are_explained():
    layout = layout_of(6, 14, 8, Device())
    notes = " ".join(layout.expected()["notes"])
    assert "4.99 mm long: the 192 whole rows" in notes and "lateral_separation_um" in notes


def test_facets_follow_the_tolerance(tmp_path):
    corners = []
    for tolerance in (0.1, 0.01):
        device = SMALL.model_copy(update={"facet_tolerance_um": tolerance})
        write_gds(layout_of(10, 20, 4, device), tmp_path / "d.gds")
        [top] = gdstk.read_gds(tmp_path / "d.gds").top_level()
        n = len(on_layer(top, "pillars")[0])
        assert (
            10 * (1 - math.cos(math.pi / n)) <= tolerance < 10 * (1 - math.cos(math.pi / (n - 4)))
        )
        corners.append(n)
    assert corners[0] < corners[1]


def test_picture_shows_the_file(tmp_path):
    write_gds(layout_of(10, 20, 4), tmp_path / "d.gds")
    figure = draw_mask(tmp_path / "d.gds", SMALL)
    device, detail = figure.axes
    [pillars] = device.collections[1].get_paths()
    begun = int((pillars.codes == pillars.MOVETO).sum())
    assert begun == layout_of(10, 20, 4).expected()["pillars"]
    assert detail.get_ylim()[0] < 400 < detail.get_ylim()[1]


@pytest.mark.parametrize(
    ("device", "message"),
    [
        ({"array_length_mm": 0.1}, "array_length_mm = 0.1 holds 3 rows.*one period of 8.*0.208 mm"),
        (
            {
                "array_width_mm": 0.08,
                "sample_position_mm": 0.04,
                "sample_width_um": 10,
                "divider_um": 5,
            },
            "array_width_mm = 0.08 holds 2 pillars",
        ),
        ({"outlet_walls_um": [1980.0]}, r"\[1980.0\]: an outlet has no room.*1990 µm wide"),
        ({"outlets": 20, "array_width_mm": 0.5}, "outlets = 20: an outlet has no room"),
        (
            {"array_width_mm": 0.507, "sample_position_mm": 0.41, "sample_width_um": 100},
            "sample_position_mm = 0.41: .* up to 490 µm, but .* 482 µm wide",
        ),
    ],
)
def test_a_device_too_small_is_refused(device, message):
    with pytest.raises(DldsimError, match=message):
        layout_of(6, 14, 8, Device(**device))


@pytest.mark.parametrize(
    ("device", "message"),
    [
        ({"sample_position_mm": 0.05}, "sample_position_mm between 0.06 and 1.94"),
        ({"layer_label": 1}, "another number"),
        ({"outlet_walls_um": [900.0, 500.0]}, "outlet_walls_um rising"),
        ({"outlet_walls_um": [2000.0]}, "every outlet has a width"),
        ({"outlet_walls_um": [500.0, 900.0], "outlets": 2}, "outlets = 3 with 2"),
    ],
)
def test_a_device_that_contradicts_itself_is_refused(device, message):
    with pytest.raises(ValueError, match=message):
        Device(**device)
