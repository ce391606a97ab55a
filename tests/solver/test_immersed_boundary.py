"""Laws of interpolation and spreading between membrane and fluid."""

import numpy as np
import pytest

from dldsim.solver.immersed_boundary import (
    KERNELS,
    LINEAR,
    PESKIN,
    POINTS,
    ROMA,
    TRAPEZOID,
    clear,
    interpolate,
    interpolate_both,
    kernel_weights,
    locate,
    make_domain,
    make_stencil,
    spread,
    surround,
)
from dldsim.solver.lattice import make_lattice
from dldsim.solver.streaming import BLOCK
from tests.solver import naive
from tests.solver.nodes import node_positions, nodes_of


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.mark.parametrize("kind", [LINEAR, TRAPEZOID, ROMA, PESKIN])
def test_kernel_moments(kind):
    # Partition of unity, no first moment, and what makes each smooth kernel what it is (Peskin
    # 2002): a sum of squares of 1/2 for ROMA and 3/8 for PESKIN; half the weight on even nodes.
    positions, points = np.linspace(-3, -2, 21), POINTS[kind]
    x = np.tile(positions[:, None], (1, 3))
    first, weight = np.empty((1, 21)), np.empty((1, 4, 21))
    kernel_weights(x, 1, kind, 0, first, weight)
    for v, p in enumerate(positions - 0.5):
        used, nodes = weight[0, :points, v], first[0, v] + np.arange(points)
        assert used.sum() == pytest.approx(1, abs=1e-14)
        assert used @ (nodes - p) == pytest.approx(0, abs=1e-14)
        assert (used >= -1e-15).all()
        if kind in (ROMA, PESKIN):
            assert used @ used == pytest.approx({ROMA: 1 / 2, PESKIN: 3 / 8}[kind], abs=1e-14)
        if kind in (TRAPEZOID, PESKIN):
            assert used[::2].sum() == pytest.approx(0.5, abs=1e-14)


def box_domain(shape=(12, 10, 8), row_shift=3, walls=False, solid=None):
    nx, ny, nz = shape
    solid = np.zeros((nx, ny), bool) if solid is None else solid
    lattice = make_lattice(solid, nz, walls=walls, row_shift=row_shift, dtype=np.float64)
    return lattice, make_domain(lattice)


def stencil_at(x, domain, kernel):
    stencil = make_stencil(len(x), kernel)
    locate(x, domain, stencil)
    return stencil


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("walls", [False, True], ids=["periodic", "plates"])
def test_interpolation_equals_its_loop_form(rng, kernel, walls):
    # Vertices all over and outside the domain, near plates and near and in solids.
    lattice, domain = box_domain(walls=walls, solid=rng.random((12, 10)) < 0.2)
    field = np.zeros(3 * lattice.stride)
    nodes_of(field, lattice)[:] = rng.normal(size=(3, lattice.columns, lattice.nz))
    x = rng.uniform([-14, -12, 0.1], [26, 22, 7.9], (60, 3))
    velocity = np.empty_like(x)
    interpolate(field, 0 * field, 0.0, stencil_at(x, domain, kernel), velocity)
    expected = [
        naive.interpolate(nodes_of(field, lattice), p, kernel, lattice.column, walls, 3) for p in x
    ]
    np.testing.assert_allclose(velocity, expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize("kernel", KERNELS)
def test_interpolation_reproduces_linear_fields(rng, kernel):
    lattice, domain = box_domain()
    gradient, constant = rng.normal(size=(3, 3)), rng.normal(size=3)
    field = np.zeros(3 * lattice.stride)
    linear = np.tensordot(gradient, node_positions(lattice), 1) + constant[:, None, None]
    nodes_of(field, lattice)[:] = linear
    x = rng.uniform(2.5, [9.5, 7.5, 5.5], (40, 3))  # clear of the jump at the periodic sides
    velocity = np.empty_like(x)
    interpolate(field, 0 * field, 0.0, stencil_at(x, domain, kernel), velocity)
    np.testing.assert_allclose(velocity, x @ gradient.T + constant, rtol=0, atol=1e-13)


@pytest.mark.parametrize("kernel", KERNELS)
def test_spreading_conserves_force_and_torque(rng, kernel):
    # Torque follows from the vanishing first moment of every kernel.
    lattice, domain = box_domain()
    x = rng.uniform(2.5, [9.5, 7.5, 5.5], (40, 3))
    force = rng.normal(size=x.shape)
    field = np.zeros(3 * lattice.stride)
    spread(force, stencil_at(x, domain, kernel), field)
    density = nodes_of(field, lattice)
    np.testing.assert_allclose(density.sum(axis=(1, 2)), force.sum(axis=0), atol=1e-13)
    torque = np.cross(node_positions(lattice), density, axis=0).sum(axis=(1, 2))
    np.testing.assert_allclose(torque, np.cross(x, force).sum(axis=0), atol=1e-12)


@pytest.mark.parametrize("kernel", KERNELS)
def test_spreading_and_interpolation_are_adjoint(rng, kernel):
    # The power of the spread force is that of the vertices, solids or not.
    lattice, domain = box_domain(walls=True, solid=rng.random((12, 10)) < 0.2)
    x = rng.uniform([-14, -12, 0.1], [26, 22, 7.9], (60, 3))
    force, velocity = rng.normal(size=x.shape), np.empty_like(x)
    field, density = rng.normal(size=3 * lattice.stride), np.zeros(3 * lattice.stride)
    stencil = stencil_at(x, domain, kernel)
    spread(force, stencil, density)
    interpolate(field, density, 0.0, stencil, velocity)
    assert (density * field).sum() == pytest.approx((force * velocity).sum(), abs=1e-12)


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_both_fields_are_interpolated_as_each_alone(rng, kernel, precision):
    lattice, domain = box_domain(walls=True, solid=rng.random((12, 10)) < 0.2)
    x = rng.uniform([-14, -12, 0.1], [26, 22, 7.9], (60, 3))
    fields = rng.normal(size=(2, 3 * lattice.stride)).astype(precision)
    stencil = stencil_at(x, domain, kernel)
    both, alone = np.empty((2, 60, 3)), np.empty((2, 60, 3))
    interpolate_both(*fields, stencil, *both)
    for field, values in zip(fields, alone, strict=True):
        interpolate(field, field, 0.0, stencil, values)
    np.testing.assert_allclose(both, alone, rtol=0, atol=20 * np.finfo(precision).eps)


@pytest.mark.parametrize("kernel", KERNELS)
def test_a_vertex_and_its_image_touch_the_same_nodes(rng, kernel):
    lattice, domain = box_domain(row_shift=3)
    x = rng.uniform([-1, 0, 0], [1, 10, 8], (40, 3))  # near the edge along x
    stencil = stencil_at(x, domain, kernel)
    for image in ((12, 3, 0), (-24, -6, 0), (0, 10, 0), (0, 0, -8), (12, -7, 16)):
        moved = stencil_at(x + image, domain, kernel)
        for table in ("column", "level"):
            assert np.array_equal(getattr(moved, table), getattr(stencil, table))
            before, after = (getattr(each, f"{table}_weight") for each in (stencil, moved))
            np.testing.assert_allclose(after, before, rtol=0, atol=1e-13)


# ------------------------------------------------------------------ blocks near the membrane


def blocks(lattice):
    return np.zeros(len(lattice.streaming.part_start) - 1, np.uint8)


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("height", [8, 17, 150])
@pytest.mark.parametrize("centre", [(6, 5), (12.3, 0.2), (-11.8, 9.9), (100.1, -47.4)])
def test_near_blocks_hold_the_stencil(rng, kernel, height, centre):
    # Across both periodic sides, with solids; the densities that are not zero are all in them, and
    # blocks that no column of a box around the vertices is in are left out.
    lattice, domain = box_domain((30, 20, height), walls=True, solid=rng.random((30, 20)) < 0.2)
    x = rng.uniform([*centre, 0.1], [*np.add(centre, 5), height - 0.1], (60, 3))
    near, stencil = blocks(lattice), stencil_at(x, domain, kernel)
    surround(domain, stencil, near)
    held = (stencil.column[:, :, None] + stencil.level[:, None]) // int(BLOCK)
    assert near[held.astype(int)].all()
    assert 0 < near.mean() < 0.5
    field = np.zeros(3 * lattice.stride)
    spread(rng.normal(size=x.shape), stencil, field)
    assert np.count_nonzero(field) > 60
    clear(field, near)
    assert not field.any()


@pytest.mark.parametrize("broken", [np.nan, np.inf, -np.inf, 1e300, 40.0])
@pytest.mark.parametrize("which", [0, slice(None)])
def test_every_block_is_near_a_membrane_that_is_not_bounded(rng, broken, which):
    lattice, domain = box_domain((30, 20, 17))
    x = rng.uniform(6, 9, (40, 3))
    x[which, 1] = broken
    if broken == 40.0:
        x[-1, 1] = 8.0
    near, stencil = blocks(lattice), stencil_at(x, domain, "compact")
    surround(domain, stencil, near)
    assert near.all()
