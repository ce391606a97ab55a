"""Flow, membrane and coupling below a mirror: the same as in the lower half of the whole."""

import numpy as np
import pytest

from dldsim.errors import DldsimError
from dldsim.solver.collide import collision_parameters
from dldsim.solver.d3q19 import MIRRORED, VELOCITIES
from dldsim.solver.flow import Fluid
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
from dldsim.solver.stream_collide import stream_collide
from tests.solver import naive
from tests.solver.nodes import UP, nodes_of

SHAPES = ["sphere", "biconcave", "ellipsoid"]


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
