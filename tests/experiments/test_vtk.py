"""Membranes over time: the path is the run's, and the file is what the specification asks for."""

import h5py
import numpy as np
import pytest

from dldsim.config.sections import Cell, Flow, Geometry, Numerics, RunControl, Stiffness
from dldsim.errors import DldsimError
from dldsim.experiments.array_run import simulate_run
from dldsim.experiments.vtk import (
    TOPOLOGIES,
    Recorder,
    Shapes,
    pillars_near,
    read_vtkhdf,
    write_pillars,
    write_vtkhdf,
)
from dldsim.solver.flow import solve_empty_array
from dldsim.solver.mesh import make_shape, volume
from dldsim.solver.pillars import offset_from_pillar

SOFT = Stiffness(
    ks_uN_per_m=5.1,
    kb_pN_um=0.043,
    kal_uN_per_m=10.2,
    kag_uN_per_m=500,
    kv_Pa=900,
    kvisc_nN_s_per_m=1.5,
)
GEOMETRY = Geometry(pillar_radius_um=5, gap_um=12, periodicity=4)
SCENE = (GEOMETRY, SOFT, Cell(radius_um=4.0), Flow(height_um=12.0), Numerics())
CONTROL = RunControl(max_rows=2)


@pytest.fixture(scope="module")
def empty():
    return solve_empty_array(GEOMETRY, *SCENE[3:])


@pytest.fixture(scope="module")
def run(empty):
    return simulate_run(*SCENE, CONTROL, run_id="r", stiffness_set="1", empty_flow=empty)


def record(empty, every=1):
    recorder = Recorder(every)
    result = simulate_run(
        *SCENE, CONTROL, run_id="r", stiffness_set="1", empty_flow=empty, observe=recorder
    )
    return result, recorder.shapes(GEOMETRY, result)


@pytest.fixture(scope="module")
def shapes(empty):
    return record(empty)[1]


@pytest.fixture
def file(shapes, tmp_path):
    path = tmp_path / "cell.vtkhdf"
    write_vtkhdf(shapes, path, {"seed": 3})
    return path


def growing(factors):
    """A sphere of 5 µm radius times each factor, moving by 2 µm a step."""
    vertices, faces = make_shape("sphere", 5.0, 4)
    centres = np.array([(2.0 * n, 0.0, 1.0) for n in range(len(factors))])
    points = [f * vertices + c for f, c in zip(factors, centres, strict=True)]
    steps = 10 * np.arange(len(factors))
    return Shapes(
        GEOMETRY, 12.0, 5.0, steps, steps * 0.1, centres, np.array(points, np.float32), faces
    )


def test_recorded_path_is_the_run_to_the_last_bit(shapes, run):
    path = np.column_stack([run.trajectory[f"{axis}_um"] for axis in "xyz"])
    np.testing.assert_array_equal(shapes.centre_um, path)
    np.testing.assert_array_equal(shapes.step, run.trajectory["step"])
    np.testing.assert_array_equal(shapes.t_ms, run.trajectory["t_ms"])
    assert shapes.departure_um(run.trajectory) == 0


def test_recorded_shapes_are_the_cell(shapes, run):
    assert shapes.points_um.dtype == np.float32
    volumes = np.array([volume(p.astype(float), shapes.faces) for p in shapes.points_um])
    np.testing.assert_allclose(volumes / volumes[0], run.trajectory["volume_ratio"], rtol=1e-5)
    extent = np.ptp(shapes.points_um, axis=1)
    np.testing.assert_allclose(extent[:, :2].max(axis=1), run.trajectory["axis_a_um"], rtol=1e-5)
    # pillars and plates are where the simulation has them
    x, y = np.moveaxis(shapes.points_um[..., :2], -1, 0) + GEOMETRY.pitch_um / 2
    offset = np.hypot(*offset_from_pillar(x, y, GEOMETRY.pitch_um, GEOMETRY.pitch_um / 4))
    to_pillar = offset - GEOMETRY.pillar_radius_um
    to_plate = shapes.height_um / 2 - np.abs(shapes.points_um[..., 2])
    np.testing.assert_allclose(
        np.minimum(to_pillar, to_plate).min(axis=1), run.trajectory["clearance_um"], atol=1e-4
    )


def test_every_nth_sample(empty, run, shapes):
    _, sparse = record(empty, every=3)
    np.testing.assert_array_equal(sparse.points_um, shapes.points_um[::3])
    np.testing.assert_array_equal(sparse.step, shapes.step[::3])
    assert sparse.departure_um(run.trajectory) == 0


def test_departure_from_another_path(shapes, run):
    moved = {**run.trajectory, "y_um": run.trajectory["y_um"] + 0.25}
    assert shapes.departure_um(moved) == pytest.approx(0.25)
    with pytest.raises(DldsimError, match="other steps"):
        shapes.departure_um({**run.trajectory, "step": run.trajectory["step"] + 1})
    with pytest.raises(DldsimError, match="other steps"):
        shapes.departure_um({k: v[:5] for k, v in run.trajectory.items()})


def test_area_strain_of_a_growing_sphere():
    strain = growing([1.0, 1.1, 0.9]).area_strain()
    np.testing.assert_allclose(strain[1], 0.21, atol=1e-5)
    np.testing.assert_allclose(strain[2], -0.19, atol=1e-5)
    assert not strain[0].any()


def read_step(root, n):
    """Points, triangles and area strain of one time step, found as the specification says."""
    steps = root["Steps"]
    assert steps["NumberOfParts"][n] == 1
    part = steps["PartOffsets"][n]
    start, count = steps["PointOffsets"][n], root["NumberOfPoints"][part]
    points = root["Points"][start : start + count]
    kind = TOPOLOGIES.index("Polygons")
    cells = root["Polygons"]
    first, number = steps["CellOffsets"][n, kind], cells["NumberOfCells"][part]
    offsets = cells["Offsets"][first : first + number + 1]
    ids = cells["Connectivity"][steps["ConnectivityIdOffsets"][n, kind] :][: offsets[-1]]
    others = sum(root[f"{name}/NumberOfCells"][part] for name in TOPOLOGIES if name != "Polygons")
    start = steps["CellDataOffsets/area_strain"][n]
    strain = root["CellData/area_strain"][start : start + number + others]
    assert set(np.diff(offsets)) == {3} and others == 0
    return points, ids.reshape(-1, 3), strain


def test_file_holds_every_step_as_the_specification_asks(shapes, file):
    with h5py.File(file) as content:
        root = content["VTKHDF"]
        assert root.attrs["Type"] == b"PolyData" and tuple(root.attrs["Version"]) == (2, 0)
        assert root.attrs.get_id("Type").get_type().get_cset() == h5py.h5t.CSET_ASCII
        times = len(shapes.step)
        assert root["Steps"].attrs["NSteps"] == times
        np.testing.assert_array_equal(root["Steps/Values"], shapes.t_ms)
        strain = shapes.area_strain()
        for n in range(times):
            points, faces, data = read_step(root, n)
            np.testing.assert_array_equal(points, shapes.points_um[n])
            np.testing.assert_array_equal(faces, shapes.faces)
            np.testing.assert_array_equal(data, strain[n])
        assert len(root["Points"]) == times * shapes.points_um.shape[1]
        assert len(root["Polygons/Connectivity"]) == shapes.faces.size  # topology once
        assert '"seed": 3' in content["dldsim"].attrs["json"]


def test_file_reads_back(shapes, file):
    again = read_vtkhdf(file)
    for name in ("step", "t_ms", "centre_um", "points_um", "faces"):
        np.testing.assert_array_equal(getattr(again, name), getattr(shapes, name))
    assert (again.geometry, again.height_um, again.cell_radius_um) == (
        shapes.geometry,
        shapes.height_um,
        shapes.cell_radius_um,
    )


def test_foreign_and_damaged_files_are_refused(file, tmp_path):
    short = tmp_path / "short.vtkhdf"
    short.write_bytes(file.read_bytes()[:3000])
    other = tmp_path / "other.h5"
    with h5py.File(other, "w") as content:
        content["x"] = 1
    for path in (short, other, tmp_path / "absent.vtkhdf"):
        with pytest.raises(DldsimError, match="is no membrane time series"):
            read_vtkhdf(path)


def test_pillars_of_a_path():
    path = np.column_stack([np.linspace(-11, 60, 50), np.linspace(8, 20, 50)])
    centres = pillars_near(GEOMETRY, path, 20.0)
    x, y = centres.T + GEOMETRY.pitch_um / 2
    offset = offset_from_pillar(x, y, GEOMETRY.pitch_um, GEOMETRY.pitch_um / 4)
    np.testing.assert_allclose(offset, 0, atol=1e-9)
    assert set(centres[:, 0]) == {22.0 * i for i in range(-1, 4)}
    assert len(np.unique(centres.round(6), axis=0)) == len(centres)
    near = centres[centres[:, 0] == 22.0, 1]  # there the path is between 9.9 and 17.3
    assert near.min() >= 9 - 20 and near.max() <= 18 + 20 and len(near) == 2


def test_pillar_file(shapes, tmp_path):
    write_pillars([shapes], tmp_path / "p.vtkhdf")
    with h5py.File(tmp_path / "p.vtkhdf") as content:
        root = content["VTKHDF"]
        assert "Steps" not in root
        points = root["Points"][:]
        quads = root["Polygons/Connectivity"][:].reshape(-1, 4)
    assert root is not None and quads.max() == len(points) - 1
    x, y = points[:, :2].T + GEOMETRY.pitch_um / 2
    offset = np.hypot(*offset_from_pillar(x, y, GEOMETRY.pitch_um, GEOMETRY.pitch_um / 4))
    np.testing.assert_allclose(offset, GEOMETRY.pillar_radius_um, atol=1e-4)
    assert set(np.abs(points[:, 2])) == {np.float32(shapes.height_um / 2)}
    edges = np.linalg.norm(np.diff(points[quads], axis=1), axis=2)
    assert edges.min() > 0
