"""Laws of the coupling between membrane and fluid, and of the contact with solids."""

import numpy as np
import pytest

from dldsim.config.sections import Cell, Constriction, Flow, Numerics, Stiffness
from dldsim.experiments.constriction import make_channel
from dldsim.solver.d3q19 import VELOCITIES, WEIGHTS
from dldsim.solver.flow import Fluid
from dldsim.solver.immersed_boundary import (
    EVEN_ODD,
    KERNELS,
    LINEAR,
    PESKIN,
    POINTS,
    ROMA,
    TRAPEZOID,
    Contact,
    channel_distance,
    clearance,
    contact_forces,
    interpolate,
    interpolate_both,
    kernel_weights,
    locate,
    make_domain,
    make_stencil,
    spread,
)
from dldsim.solver.lattice import make_lattice
from dldsim.solver.pillars import pillar_distance
from dldsim.solver.scene import CellInFlow
from dldsim.solver.time_loop import DAMPING_INTERVAL
from dldsim.solver.units import Units
from tests.solver import naive

COUPLINGS = ["no-slip", "dissipative"]
SET_1 = Stiffness(
    ks_uN_per_m=5.1,
    kb_pN_um=0.043,
    kal_uN_per_m=10.2,
    kag_uN_per_m=500,
    kv_Pa=900,
    kvisc_nN_s_per_m=1.5,
)


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


def nodes_of(array, lattice):
    """View (components, columns, nz) of a flat array of populations or vectors."""
    field = array.reshape(-1, lattice.stride)[:, : lattice.nodes]
    return field.reshape(-1, lattice.columns, lattice.nz)


def node_positions(lattice):
    ix, iy = np.nonzero(lattice.column >= 0)
    x, z = np.broadcast_arrays(ix[:, None] + 0.5, np.arange(lattice.nz) + 0.5)
    return np.stack([x, np.broadcast_to(iy[:, None] + 0.5, x.shape), z])


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


# ------------------------------------------------------------------ a cell in a box


def make_cell(
    coupling="no-slip",
    precision="float64",
    shape="sphere",
    radius_um=5.0,
    axis="y",
    box=(20, 20, 20),
    walls=False,
    place=None,
    **numerics,
):
    """A cell in a box without drive: 4 nodes in radius, a step that needs no shortening."""
    numerics = {"coupling": coupling, "precision": precision, "relaxation_time": 1.25} | numerics
    numerics = Numerics(**numerics)
    lattice = make_lattice(np.zeros(box[:2], bool), box[2], walls=walls, dtype=np.dtype(precision))
    scene = CellInFlow(
        Fluid.of(lattice, numerics),
        Units.of(numerics.spacing_um, Flow(), numerics),
        Cell(shape=shape, radius_um=radius_um, axis=axis),
        SET_1,
        numerics,
        {"plates": True, "height": float(box[2])} if walls else {},
    )
    scene.place(np.array(box) / 2 + 0.3 if place is None else place)
    return scene


def set_flow(scene, velocity):
    """Start from a flow (3, columns, nz), the vertices at rest in it."""
    fluid = scene.fluid
    nodes_of(fluid.f, fluid.lattice)[:19] = (
        3 * WEIGHTS[:, None, None] * np.tensordot(VELOCITIES, velocity, (1, 0))
    )
    nodes_of(fluid.velocity, fluid.lattice)[:] = velocity


def momentum(scene, populations):
    """Of fluid and vertices; these still lack half of the kick of their last force."""
    f = nodes_of(populations, scene.fluid.lattice)[:19].astype(float)
    total = VELOCITIES.T @ f.sum(axis=(1, 2))
    if scene.numerics.coupling == "dissipative":
        total += scene.mass * scene.body.v.sum(axis=0) + scene.body.force.sum(axis=0) / 2
    return total


@pytest.mark.parametrize("coupling", COUPLINGS)
@pytest.mark.parametrize("kernel", KERNELS)
def test_every_step_conserves_momentum(coupling, kernel):
    # A stretched cell that relaxes, in a flow. A momentum of order 100 rounds to 1e-14 in each sum.
    # (The damping of the staggered mode, not reached here, takes half a step's exchange.)
    scene = make_cell(coupling, kernel=kernel)
    x = node_positions(scene.fluid.lattice)
    k = 2 * np.pi / 20
    set_flow(scene, 0.01 * np.sin(k * x[[1, 2, 0]]) + np.array([0.01, 0, 0])[:, None, None])
    scene.body.x[:, 0] += 0.2 * (scene.body.x[:, 0] - 10.3)
    for _ in range(10):
        before = momentum(scene, scene.fluid.f)
        scene.advance(2)
        after = momentum(scene, scene.fluid.f)
        np.testing.assert_allclose(after, before, rtol=0, atol=1e-11)
    assert np.abs(scene.body.force).max() > 1e-4  # which would not pass unnoticed


def test_no_slip_coupling_conserves_momentum_over_a_long_run():
    # Membrane forces cancel, so that not even the damping of the staggered mode takes momentum.
    scene = make_cell()
    scene.body.x[:, 0] += 0.2 * (scene.body.x[:, 0] - 10.3)
    scene.advance(400)
    np.testing.assert_allclose(momentum(scene, scene.fluid.f), 0, atol=1e-10)


def staggered_momentum(scene):
    """Mean momentum along each axis, with alternating signs along that axis."""
    f = nodes_of(scene.fluid.f, scene.fluid.lattice)[:19]
    x = node_positions(scene.fluid.lattice)
    return (np.tensordot(VELOCITIES.T, f, 1) * np.cos(np.pi * (x - 0.5))).mean(axis=(1, 2))


@pytest.mark.parametrize("coupling", COUPLINGS)
def test_staggered_momentum_is_damped_where_the_kernel_feeds_it(coupling):
    # The mode that no collision reaches (see test_lattice): what the resting cell sees of it stirs
    # the rest of the fluid a little.
    scene = make_cell(coupling, kernel="linear", velocity_lu=0.0125)
    sign = (-1.0) ** np.arange(20)
    set_flow(scene, np.array([0, 0, 0.01])[:, None, None] * np.ones((3, 400, 1)) * sign)
    scene.advance(DAMPING_INTERVAL)
    assert np.abs(staggered_momentum(scene)).max() < 1e-3 * 0.01


@pytest.mark.parametrize("coupling", COUPLINGS)
@pytest.mark.parametrize("kernel", KERNELS)
def test_even_odd_kernels_do_not_feed_staggered_momentum(coupling, kernel):
    scene = make_cell(coupling, kernel=kernel)
    scene.body.x[:, 0] += 0.2 * (scene.body.x[:, 0] - 10.3)
    scene.advance(20)
    fed = np.abs(staggered_momentum(scene)).max()
    assert (fed < 1e-15) == (kernel in EVEN_ODD)
    assert fed < 1e-15 or fed > 1e-9


@pytest.mark.parametrize("kernel, steps", [("compact", 400), ("linear", 100)])
def test_a_stiff_membrane_holds_where_the_kernel_leaves_staggered_momentum_alone(kernel, steps):
    # Springs and local area of 1.5 in lattice units: five times what the linear kernel bears.
    scene = make_cell(kernel=kernel)
    scene.moduli = scene.moduli._replace(ks=0.5, kal=1.0)
    scene.body.x[:, 0] += 0.05 * (scene.body.x[:, 0] - 10.3)
    scene.advance(steps)
    assert (scene.sample().trouble() is None) == (kernel == "compact")


@pytest.mark.parametrize("shape", ["sphere", "biconcave"])
@pytest.mark.parametrize("coupling", COUPLINGS)
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_cell_in_a_quiescent_fluid_stays_at_rest(coupling, shape, precision):
    # The rest state carries only forces of rounding, 1e-16 of moduli of order one; deviations from
    # rest in single precision are as small.
    scene = make_cell(coupling, precision, shape, radius_um=7.5, walls=True)
    start = scene.body.x.copy()
    scene.advance(200)
    np.testing.assert_allclose(scene.body.x, start, rtol=0, atol=1e-12)
    assert np.abs(scene.body.v).max() < 1e-14
    assert np.abs(scene.fluid.velocity_field()).max() < 1e-14


@pytest.mark.parametrize("coupling", COUPLINGS)
@pytest.mark.parametrize("inertia", ["stokes", "navier-stokes"])
def test_a_cell_moves_undeformed_with_a_uniform_flow(coupling, inertia):
    scene = make_cell(coupling, shape="biconcave", inertia=inertia)
    velocity = np.array([0.02, -0.01, 0.005])
    set_flow(scene, np.tile(velocity[:, None, None], (1, 400, 20)))
    scene.body.v[:] = scene.body.smooth[:] = velocity
    start = scene.body.x.copy()
    scene.advance(1000)  # once around the box along x
    np.testing.assert_allclose(
        scene.body.x - start, np.tile(1000 * velocity, (len(start), 1)), rtol=0, atol=1e-9
    )


@pytest.mark.parametrize("coupling", COUPLINGS)
def test_axes_are_alike(coupling):
    # The same scene with x → y → z → x: only the order of sums differs.
    box, place = np.array([18, 16, 20]), np.array([8.0, 9.3, 10.1])
    ends = []
    for shift, axis in ((0, "x"), (1, "y"), (2, "z")):
        scene = make_cell(
            coupling,
            shape="biconcave",
            axis=axis,
            box=tuple(np.roll(box, shift).tolist()),
            place=np.roll(place, shift),
        )
        x = np.roll(node_positions(scene.fluid.lattice), -shift, axis=0)
        k = (2 * np.pi / box)[:, None, None]
        flow = 0.02 * np.sin(k * x)[[1, 2, 0]] * np.array([1, 0.5, -0.7])[:, None, None]
        set_flow(scene, np.roll(flow, shift, axis=0))
        scene.advance(100)
        ends.append(np.roll(scene.body.x, -shift, axis=1))
    assert np.abs(ends[0].mean(axis=0) - place).max() > 0.1
    np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(ends[2], ends[0], rtol=0, atol=1e-9)


def test_friction_belongs_to_the_membrane_and_not_to_its_mesh():
    fine, coarse = (make_cell("dissipative", edge_to_spacing=e) for e in (0.5, 1.0))
    assert fine.vertices > 3 * coarse.vertices
    # Meshes inscribed in the sphere differ by (edge/radius)²/8 = 1 % in area.
    assert fine.friction * fine.vertices == pytest.approx(
        coarse.friction * coarse.vertices, rel=0.015
    )
    assert fine.contact.strength.sum() == pytest.approx(coarse.contact.strength.sum(), rel=0.015)


# ------------------------------------------------------------------ contact


def make_contact(vertices, **surfaces):
    values = {
        "strength": np.full(vertices, 0.3),
        "exponent": 1.2,
        "reach": 0.8,
        "core": 0.04,
        "pillars": False,
        "pitch": 12.0,
        "row_shift": 3.0,
        "radius": 4.0,
        "plates": False,
        "height": 8.0,
        "channel": False,
        "profile": np.zeros((2, 1)),
        "centre": 0.0,
        "length": 1.0,
    }
    return Contact(**{**values, **surfaces})


@pytest.fixture(scope="module")
def channel():
    made = make_channel(Constriction(spacing_um=1.0), Numerics())
    return {
        "channel": True,
        "profile": made.profile,
        "centre": made.centre,
        "length": float(made.length),
    }


def pillar_centres(contact):
    i, j = np.indices((9, 13)) - np.array([4, 6])[:, None, None]
    x = (i + 0.5) * contact.pitch
    return np.stack([x, i * contact.row_shift + (j + 0.5) * contact.pitch], axis=-1).reshape(-1, 2)


def test_pillar_distance_is_that_of_the_nearest_pillar(rng):
    contact = make_contact(1, pillars=True)
    centres = pillar_centres(contact)
    points = rng.uniform(-24, 24, (2000, 2))
    distances = np.linalg.norm(points[:, None] - centres, axis=2)
    exact = distances.min(axis=1) - contact.radius
    near = exact < 0.5 * contact.pitch - contact.radius  # half the gap: further out, rows compete
    assert near.sum() > 1000 and (exact < 0).sum() > 100
    for point, distance, nearest in zip(
        points[near], exact[near], centres[distances.argmin(axis=1)][near], strict=True
    ):
        r, ux, uy = pillar_distance(*point, 12.0, 3.0, 4.0)
        assert r == pytest.approx(distance, abs=1e-12)
        away = (point - nearest) / np.linalg.norm(point - nearest)
        np.testing.assert_allclose((ux, uy), away, atol=1e-12)
    assert pillar_distance(6.0, 6.0, 12.0, 3.0, 4.0)[0] == -4.0


def test_channel_distance_is_that_of_the_nearest_wall(rng, channel):
    contact = make_contact(1, **channel)
    x, half = contact.profile
    fine = np.concatenate([np.linspace(a, b, 4001) for a, b in zip(x[:-1], x[1:], strict=True)])
    wall = np.stack([fine, np.interp(fine, x, half)], axis=1)
    wall = np.concatenate([wall + (k * contact.length, 0) for k in (-1, 0, 1)])
    wall = np.concatenate([wall, wall * (1, -1)]) + (0, contact.centre)
    points = rng.uniform([-5, -1], [contact.length + 5, 2 * contact.centre + 1], (120, 2))
    for point in points:
        exact = np.linalg.norm(wall - point, axis=1).min()
        inside = abs(point[1] - contact.centre) < np.interp(point[0] % contact.length, x, half)
        r, ux, uy = channel_distance(*point, contact)
        # Wall points are 0.01 apart.
        assert r == pytest.approx(exact if inside else -exact, abs=6e-3)
        assert np.hypot(ux, uy) == pytest.approx(1, abs=1e-9)
        # Along the unit vector the distance grows one to one, into the fluid.
        ahead = channel_distance(point[0] + 1e-5 * ux, point[1] + 1e-5 * uy, contact)[0]
        assert ahead - r == pytest.approx(1e-5, rel=1e-3)


def potential(r, contact):
    """Integral of the force from distance r to the reach."""
    a, n, reach = contact.strength[0], contact.exponent, contact.reach
    return a * (r**-n - reach**-n) + a * n * reach ** (-n - 1) * (r - reach)


SCENES = {
    "pillar": ({"pillars": True}, lambda c, p: pillar_distance(p[0], p[1], 12.0, 3.0, 4.0)[0]),
    "floor": ({"plates": True}, lambda c, p: p[2]),
    "ceiling": ({"plates": True}, lambda c, p: 8.0 - p[2]),
    "channel": (None, lambda c, p: channel_distance(p[0], p[1], c)[0]),
}


@pytest.mark.parametrize("scene", SCENES)
def test_contact_force_is_minus_the_gradient_of_its_potential(rng, scene, channel):
    surfaces, distance = SCENES[scene]
    contact = make_contact(1, **(channel if surfaces is None else surfaces))
    found = 0
    top = [contact.length, 2 * contact.centre, 4] if scene == "channel" else [24, 24, 8]
    for point in rng.uniform([0, 0, 0], top, (6000, 3)):
        r = distance(contact, point)
        if not contact.core + 1e-3 < r < contact.reach:
            continue
        found += 1
        force = np.zeros((1, 3))
        contact_forces(point[None], contact, force)
        h = 1e-5 * r
        gradient = [
            potential(distance(contact, point + e), contact)
            - potential(distance(contact, point - e), contact)
            for e in h * np.eye(3)
        ]
        # Central differences: h²/r² = 1e-10 against rounding of 1e-16/1e-5.
        size = np.linalg.norm(force)
        np.testing.assert_allclose(force[0], -np.array(gradient) / (2 * h), atol=1e-6 * size + 1e-8)
    assert found > 50


def test_contact_vanishes_beyond_its_reach_and_stays_finite_at_the_surface():
    contact = make_contact(1, pillars=True, plates=True)
    force = np.zeros((1, 3))
    contact_forces(np.array([[6.0, 6.0 + 4.0 + 0.8001, 4.0]]), contact, force)
    assert not force.any()
    assert clearance(np.array([[6.0, 10.5, 4.0]]), contact) == pytest.approx(0.5)
    assert clearance(np.array([[6.0, 10.5, 7.8]]), contact) == pytest.approx(0.2)
    pushes = []
    for r in (0.7, 0.4, 0.1, contact.core, 0.01, 0.0, -0.5):
        force[:] = 0
        contact_forces(np.array([[6.0, 6.0 + 4.0 + r, 4.0]]), contact, force)
        assert force[0, 0] == pytest.approx(0, abs=1e-12)
        assert force[0, 2] == 0
        pushes.append(force[0, 1])
    assert np.all(np.diff([0, *pushes]) > 0)  # outward and growing
    # Below the core in proportion to the distance, with the slope that it has there.
    n, a = contact.exponent, contact.strength[0]
    slope = a * n * (n + 1) * contact.core ** (-n - 2)
    assert pushes[4] - pushes[3] == pytest.approx(slope * (contact.core - 0.01), rel=1e-9)
    assert pushes[6] - pushes[5] == pytest.approx(slope * 0.5, rel=1e-9)
