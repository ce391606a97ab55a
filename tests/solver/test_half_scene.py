"""Half a scene below a mirror at mid-height: the same as the lower half of the whole one."""

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
from dldsim.solver.collide import collision_parameters
from dldsim.solver.d3q19 import MIRRORED, VELOCITIES
from dldsim.solver.flow import Fluid, solve_empty_array
from dldsim.solver.immersed_boundary import (
    KERNELS,
    interpolate,
    locate,
    make_domain,
    make_stencil,
    spread,
    surround,
)
from dldsim.solver.lattice import make_lattice
from dldsim.solver.membrane import Moduli, make_membrane, make_scratch
from dldsim.solver.membrane_forces import elastic_forces, measure_faces
from dldsim.solver.mesh import make_shape
from dldsim.solver.mirror import Mirror, half_of, images, reflect, spread_both
from dldsim.solver.pillars import make_array
from dldsim.solver.scene import ITERATIONS, STRAIN, largest_gain
from dldsim.solver.stream_collide import stream_collide
from dldsim.solver.time_step import elastic_frequency, margins
from tests.solver import naive

UP = np.array([1.0, 1.0, -1.0])
SHAPES = ["sphere", "biconcave", "ellipsoid"]
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


def nodes_of(array, lattice):
    """View (components, columns, nz) of a flat array of populations or vectors."""
    field = array.reshape(-1, lattice.stride)[:, : lattice.nodes]
    return field.reshape(-1, lattice.columns, lattice.nz)


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


# ------------------------------------------------------------------ fluid


def test_mirrored_directions():
    assert np.array_equal(VELOCITIES[MIRRORED], VELOCITIES * [1, 1, -1])


@pytest.mark.parametrize("interpolated", [False, True], ids=["half-way", "interpolated"])
@pytest.mark.parametrize("height", [38, 37], ids=["link", "node"])
def test_streaming_equals_the_lower_half_of_its_loop_form(height, interpolated):
    rng = np.random.default_rng(3)
    solid = rng.random((11, 9)) < 0.25
    distance = rng.random((11, 9, 3, 3))

    def link_fraction(ix, iy, cx, cy):
        return distance[ix, iy, cx, cy]

    fraction = link_fraction if interpolated else None
    lattice = make_lattice(
        solid, height, walls=True, half=True, row_shift=4, link_fraction=fraction, dtype=np.float64
    )
    assert lattice.nz == 19
    fluid = Fluid(lattice, 0.8, "trt", False, np.dtype(float))
    fluid.parameters = collision_parameters(np.inf, "bgk", (0, 0, 0), np.float64)  # no collision
    whole = rng.normal(size=(19, lattice.columns, height))
    whole += whole[MIRRORED, :, ::-1]
    nodes_of(fluid.f, lattice)[:19] = whole[:, :, :19]
    for step in range(4):
        stream_collide(step, *fluid.state)
        whole = naive.stream(whole, lattice.column, height, True, 4, fraction)
        if step % 2 == 1:
            after = nodes_of(fluid.f, lattice)
            np.testing.assert_allclose(after, whole[:, :, :19], rtol=0, atol=1e-12)


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


# ------------------------------------------------------------------ membrane


@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("frequency", [1, 6, 9, 14])
def test_every_mesh_is_symmetric(shape, axis, frequency):
    x, faces = make_shape(shape, 5.0, frequency, aspect_ratio=0.7, axis=axis)
    opposite = images(x)
    np.testing.assert_allclose(x[opposite], UP * x, rtol=0, atol=1e-14)
    corners = {frozenset(f) for f in faces.tolist()}
    assert {frozenset(f) for f in opposite[faces].tolist()} == corners


def test_a_membrane_without_symmetry_is_refused():
    x, faces = make_shape("sphere", 5.0, 4)
    x[7] += 1e-3
    membrane = make_membrane(x, faces)
    with pytest.raises(DldsimError, match=r"not symmetric.*half_scene: false"):
        half_of(x, membrane, make_scratch(membrane))


def halved(shape, axis):
    """A membrane deformed symmetrically, with velocities: half, and positions and velocities."""
    x0, faces = make_shape(shape, 5.0, 7, aspect_ratio=0.7, axis=axis)
    membrane = make_membrane(x0, faces)
    half = half_of(x0, membrane, make_scratch(membrane))
    rng = np.random.default_rng(1)
    bumps, v = rng.normal(0, 0.15, x0.shape), rng.normal(0, 0.1, x0.shape)
    opposite = half.opposite
    x = x0 * [1.3, 0.9, 0.8] + bumps + UP * bumps[opposite]
    return half, x + [2.0, 3.0, 4.5], v + UP * v[opposite]


@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(
    ("modulus", "isotropic"),
    [(name, False) for name in ("ks", "kb", "kal", "kag", "kv", "kvisc")]
    + [("kal", True), ("kag", True)],
)
def test_forces_on_half_a_membrane_are_those_on_the_whole(shape, axis, modulus, isotropic):
    half, x, v = halved(shape, axis)
    moduli = Moduli(**{**dict.fromkeys(Moduli._fields[:6], 0.0), modulus: 1.0})
    moduli = moduli._replace(isotropic=isotropic)
    expected = np.empty_like(x)
    elastic_forces(x, v, half.whole, moduli, half.whole_scratch, expected)
    mirror = half.mirror._replace(height=4.5)
    here, moving = x[half.vertex], v[half.vertex]
    count = len(half.share)
    here[count:], moving[count:] = np.nan, np.nan  # for reflection to fill
    reflect(here, moving, moving, mirror)
    np.testing.assert_allclose(here, x[half.vertex], rtol=0, atol=1e-14)
    force = np.empty((count, 3))
    elastic_forces(here, moving, half.membrane, moduli, half.scratch, force)
    expected = expected[half.vertex[:count]]
    np.testing.assert_allclose(force, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    assert np.abs(expected).max() > 1e-3
    totals = measure_faces(here, half.scratch)
    np.testing.assert_allclose(totals, measure_faces(x, half.whole_scratch), rtol=1e-13)
    assert half.share.sum() == len(x)
    np.testing.assert_allclose(half.unfold(here, 4.5), x, rtol=0, atol=1e-14)
    np.testing.assert_allclose(half.unfold(moving), v, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(half.fold(v), v[half.vertex])


# ------------------------------------------------------------------ coupling


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("height", [8, 9, 4, 5])
def test_spreading_and_interpolation_equal_those_of_the_whole(height, kernel):
    # Vertices below, on and near the mirror, near the plate, and in solids.
    rng = np.random.default_rng(0)
    solid = rng.random((12, 10)) < 0.2
    lattices = [
        make_lattice(solid, height, walls=True, half=half, row_shift=3, dtype=np.float64)
        for half in (True, False)
    ]
    middle = height / 2
    below = rng.uniform([-14, -12, 0.1], [26, 22, middle], (60, 3))
    below[:20, 2] = middle
    below[20:35, 2] = middle - rng.uniform(0, 1, 15)
    force = rng.normal(size=below.shape)
    force[:20, 2] = 0
    above = UP * below[20:] + [0, 0, height]
    positions = below, np.concatenate([below, above])
    forces = force.copy(), np.concatenate([force, UP * force[20:]])
    mirror = Mirror(middle, 20, np.arange(20, 60, dtype=np.uint32))
    fields, domains, stencils = [], [], []
    for lattice, x in zip(lattices, positions, strict=True):
        domains.append(make_domain(lattice))
        stencils.append(make_stencil(len(x), kernel))
        locate(x, domains[-1], stencils[-1])
        fields.append(np.zeros(3 * lattice.stride))
    near = np.zeros(len(lattices[0].streaming.part_start) - 1, np.uint8)
    surround(domains[0], stencils[0], near)
    spread_both(forces[0], stencils[0], domains[0], mirror, near, fields[0])
    spread(forces[1], stencils[1], fields[1])
    np.testing.assert_array_equal(forces[0], force)
    nz = lattices[0].nz
    density, expected = (
        nodes_of(field, lattice) for field, lattice in zip(fields, lattices, strict=True)
    )
    np.testing.assert_allclose(density, expected[:, :, :nz], rtol=0, atol=1e-13)
    flow = rng.normal(size=expected.shape)
    flow += UP[:, None, None] * flow[:, :, ::-1]
    density[:], expected[:] = flow[:, :, :nz], flow
    answers = [np.zeros_like(x) for x in positions]
    for field, stencil, answer in zip(fields, stencils, answers, strict=True):
        interpolate(field, field, 0.5, stencil, answer)
    np.testing.assert_allclose(answers[0], answers[1][:60], rtol=0, atol=1e-13)


# ------------------------------------------------------------------ scenes


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
