"""Half a scene below a mirror at mid-height: the same as the lower half of the whole one.

The kernels of the mirror alone are in test_mirror.py.
"""

import itertools

import numpy as np
import pytest

from dldsim.config.sections import (
    Cell,
    Constriction,
    Flow,
    Geometry,
    Numerics,
    RunControl,
    Stiffness,
)
from dldsim.errors import DldsimError
from dldsim.experiments.array_run import simulate_run
from dldsim.experiments.array_scene import make_scene
from dldsim.experiments.constriction import simulate_constriction
from dldsim.experiments.vtk import Recorder
from dldsim.solver.flow import solve_empty_array
from dldsim.solver.immersed_boundary import interpolate, locate, spread
from dldsim.solver.membrane_forces import elastic_forces
from dldsim.solver.pillars import make_array
from dldsim.solver.scene import ITERATIONS, STRAIN, largest_gain
from dldsim.solver.time_step import elastic_frequency, margins
from tests.solver.nodes import UP, nodes_of

HEIGHTS = {"link": 13.8, "node": 12.0}
"""Ten and nine nodes of the array below: a mirror between two layers, and through one."""
SET_1 = Stiffness(
    ks_uN_per_m=5.1,
    kb_pN_um=0.043,
    kal_uN_per_m=10.2,
    kag_uN_per_m=500,
    kv_Pa=900,
    kvisc_nN_s_per_m=1.5,
)
GEOMETRY = Geometry(pillar_radius_um=5, gap_um=12, periodicity=4)
# Slow enough for every scene here.
NUMERICS = Numerics(precision="float64", velocity_lu=0.004)
BOTH = {True: NUMERICS, False: NUMERICS.model_copy(update={"half_scene": False})}


@pytest.fixture(scope="module", params=HEIGHTS, ids=list(HEIGHTS))
def flows(request):
    """Empty flow on half a lattice and on the whole one, by whether it is half."""
    flow = Flow(height_um=HEIGHTS[request.param])
    solved = {half: solve_empty_array(GEOMETRY, flow, numerics) for half, numerics in BOTH.items()}
    assert make_array(GEOMETRY, flow, NUMERICS).lattice.split == (request.param == "node")
    return solved


def pair(flows, shape="biconcave", axis="x", **change):
    """The same cell in half a scene and in the whole one."""
    scenes = []
    for half, empty in flows.items():
        numerics = BOTH[half].model_copy(update=change)
        array = make_array(GEOMETRY, empty.flow, numerics)
        aspect = {"aspect_ratio": 0.7} if shape == "ellipsoid" else {}
        cell = Cell(shape=shape, axis=axis, radius_um=4.0, **aspect)
        scenes.append(make_scene(array, empty, SET_1, cell, empty.flow, numerics))
    assert [scene.half is not None for scene in scenes] == [True, False]
    return scenes


def test_empty_flow_is_that_of_the_whole_height(flows):
    half, whole = flows[True], flows[False]
    assert half.nodes < 0.6 * whole.nodes
    assert half.steps == whole.steps
    np.testing.assert_allclose(half.mobility, whole.mobility, rtol=1e-12)
    np.testing.assert_allclose(half.body_force, whole.body_force, rtol=1e-11)
    lattices = [make_array(GEOMETRY, e.flow, e.numerics).lattice for e in (half, whole)]
    f, expected = (
        nodes_of(e.populations, lattice)[:19]
        for e, lattice in zip((half, whole), lattices, strict=True)
    )
    expected = expected[:, :, : f.shape[-1]]
    np.testing.assert_allclose(f, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_scenes_that_stay_whole():
    for flow, numerics in ((Flow(), BOTH[False]), (Flow(height_um=0), NUMERICS)):
        assert not make_array(GEOMETRY, flow, numerics).lattice.half
    lattice = make_array(GEOMETRY, Flow(), NUMERICS).lattice
    assert lattice.half and lattice.nz == -(-lattice.height // 2)


def assert_same(half, whole):
    """Everything that is observed of a cell, to 1e-9 of a node, of its speed and so on."""
    np.testing.assert_allclose(half.positions(), whole.positions(), rtol=0, atol=1e-9)
    ours, theirs = half.sample(), whole.sample()
    units = {
        "centre": 1,
        "extent": 1,
        "clearance": 1,
        "volume_ratio": 1,
        "area_ratio": 1,
        "speed_max": theirs.speed_max,
        "velocity": theirs.speed_max,
        "mean_velocity": theirs.speed_max,
    }
    for name, unit in units.items():
        np.testing.assert_allclose(
            getattr(ours, name), getattr(theirs, name), rtol=0, atol=1e-9 * unit, err_msg=name
        )
    assert ours.inverted == theirs.inverted
    np.testing.assert_allclose(half.energies(), whole.energies(), rtol=1e-8, atol=1e-15)


@pytest.mark.parametrize(
    ("shape", "axis", "coupling"),
    [
        *itertools.product(["sphere"], ["x"], ["no-slip", "dissipative"]),
        *itertools.product(["biconcave", "ellipsoid"], ["x", "y", "z"], ["no-slip"]),
        *itertools.product(["biconcave"], ["y", "z"], ["dissipative"]),
    ],
)
def test_a_cell_goes_the_same_way(flows, shape, axis, coupling):
    # Stretched towards a pillar and pressed flat, a contact that reaches far, so that every term
    # bears; past the damping of staggered momentum and corrections of the drive.
    half, whole = pair(flows, shape, axis, coupling=coupling, contact_range_um=4.0)
    middle = whole.positions().mean(axis=0)
    for scene in (half, whole):
        x = scene.body.x
        x[:] = middle + [1.1, 1.15, 0.9] * (x - middle)
    assert_same(half, whole)
    start, pressed = whole.positions().copy(), np.inf
    for _ in range(3):
        half.advance(110)
        whole.advance(110)
        assert_same(half, whole)
        pressed = min(pressed, whole.sample().clearance)
    assert np.abs(whole.positions() - start).max() > 0.5
    assert pressed < whole.contact.reach


@pytest.mark.parametrize("kernel", ["linear", "4-point"])
def test_other_kernels_go_the_same_way(flows, kernel):
    half, whole = pair(flows, kernel=kernel)
    for scene in (half, whole):
        scene.advance(220)
    assert_same(half, whole)


@pytest.mark.parametrize("coupling", ["no-slip", "dissipative"])
def test_margins_are_those_of_symmetric_modes(flows, coupling):
    # What does not come from an iteration is the same; that from its symmetric start is, too.
    half, whole = pair(flows, coupling=coupling)
    ours, theirs = margins(half), margins(whole)
    for name in ("mass", "speed", "inertia"):
        assert getattr(ours, name) == pytest.approx(getattr(theirs, name), rel=1e-9), name
    # Antisymmetric modes, which only the whole has, and other starts of the iteration.
    assert elastic_frequency(half) == pytest.approx(elastic_frequency(whole), rel=0.1)


def test_largest_gain_of_half_is_that_of_symmetric_modes(flows):
    half, whole = pair(flows)
    x, opposite = whole.positions(), half.half.opposite
    alone = half.moduli._replace(ks=0.0, kb=0.0, kal=0.0, kag=0.0, kv=0.0)

    def push(scene):
        def act(mode, force):
            elastic_forces(scene.body.x, mode, scene.membrane, alone, scene.scratch, force)

        return act

    mode = np.random.default_rng(0).normal(size=x.shape)
    mode += UP * mode[opposite]
    force, answer = np.empty_like(x), np.empty_like(x)
    locate(x, whole.domain, whole.stencil)
    nothing = np.zeros_like(whole.fluid.force)
    for _ in range(ITERATIONS):
        mode *= STRAIN / np.linalg.norm(mode)
        push(whole)(mode, force)
        density = np.zeros_like(nothing)
        spread(force, whole.stencil, density)
        interpolate(density, nothing, 0.0, whole.stencil, answer)
        gain = -np.vdot(force, answer) / np.vdot(force, mode)
        mode = (answer + UP * answer[opposite]) / 2
    assert largest_gain(half, push(half)) == pytest.approx(gain, rel=1e-9)


def test_a_place_off_the_mirror_is_refused(flows):
    scene, _ = pair(flows)
    with pytest.raises(DldsimError, match=r"has no half: allowed is .*half_scene: false"):
        scene.place([10.0, 10.0, 4.0])


def test_shapes_and_tables_of_a_run_are_those_of_the_whole(flows):
    results = []
    for half, empty in flows.items():
        recorder = Recorder(5)
        run = simulate_run(
            GEOMETRY,
            SET_1,
            Cell(radius_um=4.0),
            empty.flow,
            BOTH[half],
            RunControl(max_rows=2),
            run_id="r",
            stiffness_set="1",
            empty_flow=empty,
            observe=recorder,
        )
        results.append((run, recorder.shapes(GEOMETRY, run)))
    (ours, half), (theirs, whole) = results
    assert np.array_equal(half.faces, whole.faces) and np.array_equal(half.step, whole.step)
    # Written in single precision, in µm.
    np.testing.assert_allclose(half.points_um, whole.points_um, rtol=0, atol=1e-4)
    for name, values in theirs.trajectory.items():
        if name != "run_id":
            expected = np.asarray(values, float)
            # By symmetry there is neither height nor velocity along z: of x then.
            scale = np.abs(theirs.trajectory[name.replace("z", "x", 1)]).max()
            np.testing.assert_allclose(
                ours.trajectory[name], expected, rtol=0, atol=1e-8 * scale, err_msg=name
            )
    assert ours.row["steps"] == theirs.row["steps"] and ours.row["status"] == theirs.row["status"]
    assert ours.row["nodes"] < 0.6 * theirs.row["nodes"]
    assert ours.row["vertices"] < 0.6 * theirs.row["vertices"]
    assert "half of the height (mirror plane)" in ours.row["left_out"]
    assert "mirror" not in theirs.row["left_out"]


def test_a_constriction_is_passed_alike():
    channel = Constriction(
        spacing_um=1.34,
        width_um=16,
        throat_width_um=8,
        throat_length_um=8,
        taper_length_um=4,
        approach_length_um=12,
        height_um=10,
    )
    ours, theirs = (
        simulate_constriction(
            SET_1,
            1.0,
            channel,
            Cell(radius_um=5.0),
            Flow(),
            numerics.model_copy(update={"velocity_lu": 0.02}),
            release_position_um=0.0,
            run_id="r",
        )
        for numerics in BOTH.values()
    )
    assert ours.row["status"] == theirs.row["status"] == "converged"
    for name in ("deformation_index", "diameter_d_um", "diameter_h_um", "volume_drift_max"):
        assert ours.row[name] == pytest.approx(theirs.row[name], rel=1e-7), name
