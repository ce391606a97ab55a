"""A cell in a fluid as a whole: momentum, rest, uniform flow, friction."""

import numpy as np
import pytest

from dldsim.config.sections import Cell, Flow, Numerics, Stiffness
from dldsim.solver.contact import contact_forces
from dldsim.solver.d3q19 import VELOCITIES, WEIGHTS
from dldsim.solver.flow import Fluid
from dldsim.solver.immersed_boundary import EVEN_ODD, KERNELS
from dldsim.solver.lattice import make_lattice
from dldsim.solver.scene import CONTACT_STIFFEST, CellInFlow
from dldsim.solver.time_loop import DAMPING_INTERVAL
from dldsim.solver.units import Units
from tests.solver.nodes import node_positions, nodes_of

COUPLINGS = ["no-slip", "dissipative"]
SET_1 = Stiffness(
    ks_uN_per_m=5.1,
    kb_pN_um=0.043,
    kal_uN_per_m=10.2,
    kag_uN_per_m=500,
    kv_Pa=900,
    kvisc_nN_s_per_m=1.5,
)


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
    fine, coarse = (
        make_cell("dissipative", edge_to_spacing=e, contact_range_um=0.5) for e in (0.5, 1.0)
    )
    assert fine.vertices > 3 * coarse.vertices
    # Meshes inscribed in the sphere differ by (edge/radius)²/8 = 1 % in area.
    assert fine.friction * fine.vertices == pytest.approx(
        coarse.friction * coarse.vertices, rel=0.015
    )
    assert fine.contact.strength.sum() == pytest.approx(coarse.contact.strength.sum(), rel=0.015)


@pytest.mark.parametrize("range_um", [0.0, 0.01, 0.1, 0.2, 0.5, 2.0])
def test_contact_is_never_stiffer_than_a_step_bears(range_um):
    scene = make_cell("no-slip", walls=True, contact_range_um=range_um)
    r = np.append(np.linspace(-0.3, 1.0, 131), scene.contact.reach)
    r.sort()
    x = np.stack([np.full(len(r), 10.0), np.full(len(r), 10.0), r], axis=1)
    contact = scene.contact._replace(strength=np.full(len(r), scene.contact.strength[0]))
    force = np.zeros_like(x)
    contact_forces(x, contact, force)
    slope = -np.diff(force[:, 2]) / np.diff(r)
    assert slope.max() == pytest.approx(CONTACT_STIFFEST, rel=1e-6)
    assert slope.min() > -1e-12
    assert force[r >= contact.reach, 2] == pytest.approx(0, abs=1e-12)
