"""Laws of a capsule in simple shear."""

import numpy as np
import pytest
from scipy.sparse.linalg import LinearOperator, minres

from dldsim.errors import DldsimError
from dldsim.evidence.validation_capsule import SMALL_DEFORMATION
from dldsim.experiments import shear
from dldsim.solver import membrane as mb
from dldsim.solver import membrane_forces, mesh
from dldsim.solver.flow import Fluid
from dldsim.solver.lattice import make_lattice

LAWS = list(SMALL_DEFORMATION)


def test_the_start_is_the_steady_flow():
    rate, nz, tau = 0.003, 10, 1.25
    plates = -rate * nz / 2, rate * nz / 2
    solid = np.zeros((3, 2), bool)
    lattice = make_lattice(solid, nz, walls=True, wall_velocities=plates, dtype=np.float64)
    fluid = Fluid(lattice, tau, "trt", False, np.dtype(np.float64))
    shear.start_shear(fluid, rate)
    fluid.advance(50)
    u = fluid.velocity_field()
    expected = rate * (np.arange(nz) + 0.5 - nz / 2)
    np.testing.assert_allclose(u[0], np.tile(expected, (6, 1)), atol=1e-14)
    np.testing.assert_allclose(u[1:], 0, atol=1e-15)


def test_inertia_ellipse_finds_axes_and_inclination():
    x, faces = mesh.icosphere(5)
    angle = np.radians(32)
    turn = np.array(
        [[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]]
    )
    round_axis, _, _ = shear.inertia_ellipse(x, faces)
    a, b, inclination = shear.inertia_ellipse(x @ np.diag([3.0, 2, 1]) @ turn.T + 40, faces)
    assert 0.98 < round_axis < 1
    np.testing.assert_allclose([a, b], [3 * round_axis, round_axis], rtol=1e-10)
    assert inclination == pytest.approx(32, abs=1e-8)


@pytest.mark.parametrize("law", LAWS)
def test_small_deformation_is_that_of_linear_elasticity(law):
    # A sphere that hardly deforms feels the traction 5 μ E·n of a strain E on a rigid sphere
    # (Barthes-Biesel & Rallison 1981); its radial displacement is 2 D/(γ̇/2) times n·E·n.
    x, faces = mesh.icosphere(8)
    membrane = mb.make_membrane(x, faces)
    moduli, scratch = shear.moduli_of(law, 1.0, 0.0), mb.make_scratch(membrane)

    def forces(y):
        out = np.empty_like(y)
        membrane_forces.elastic_forces(y, np.zeros_like(y), membrane, moduli, scratch, out)
        return out

    def stiffness(u):
        u = 1e-5 * u.reshape(x.shape)
        return (forces(x - u) - forces(x + u)).ravel() / 2e-5

    patch = np.bincount(faces.ravel(), np.repeat(membrane.rest_areas / 3, 3))
    strain = np.zeros((3, 3))
    strain[0, 2] = strain[2, 0] = 0.5
    pull = 5 * patch[:, None] * (x @ strain)
    # Without bending some wrinkles cost next to nothing; hold every vertex a little.
    operator = LinearOperator((x.size, x.size), matvec=lambda u: stiffness(u) + 1e-6 * u)
    u, failed = minres(operator, pull.ravel(), rtol=1e-6, maxiter=3000)
    assert not failed
    radial, shape = np.sum(u.reshape(x.shape) * x, axis=1), x[:, 0] * x[:, 2]
    deformation = np.sum(patch * radial * shape) / np.sum(patch * shape**2) / 2
    assert deformation == pytest.approx(SMALL_DEFORMATION[law], rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "deformation", "inclination"),
    [("neo-Hookean", 0.3865, 25.4), ("Skalak", 0.3348, 27.97)],
)
def test_deformation_in_shear_is_that_of_the_boundary_integral(law, deformation, inclination):
    bending = 0.01 if law == "neo-Hookean" else 0.0
    run = shear.capsule_in_shear(law, 0.3, bending=bending)
    assert run.taylor_deformation == pytest.approx(deformation, rel=0.02)
    assert run.inclination_deg == pytest.approx(inclination, abs=1)
    assert abs(run.drift) < 0.002
    assert run.volume_ratio == pytest.approx(1, abs=1e-3)
    assert run.history[-1, 0] == pytest.approx(5.7, abs=0.1)
    assert run.nodes == 39 * 36 * 48


def test_deformation_does_not_depend_on_the_reynolds_number_of_a_linear_fluid():
    slow, fast = (
        shear.capsule_in_shear("neo-Hookean", 0.15, radius=4, reynolds_number=re)
        for re in (0.25, 0.5)
    )
    assert slow.steps > 1.5 * fast.steps
    assert fast.taylor_deformation == pytest.approx(slow.taylor_deformation, rel=5e-3)


def test_deformation_does_not_depend_on_the_relaxation_time():
    # With half a step's lead on a lasting force it is lower by 4 % and more at the larger one.
    thin, thick = (
        shear.capsule_in_shear("neo-Hookean", 0.3, radius=4, relaxation_time=tau)
        for tau in (1.25, 3.0)
    )
    assert thick.taylor_deformation == pytest.approx(thin.taylor_deformation, rel=0.01)


def test_bad_input_is_refused(monkeypatch):
    with pytest.raises(DldsimError, match=r"'rubber' is unknown; use neo-Hookean, Skalak"):
        shear.capsule_in_shear("rubber", 0.3)
    monkeypatch.setattr(shear, "frequency_limit", lambda *_: 40.0)
    with pytest.raises(DldsimError, match="Ca 0.01: .* at step .*; lower reynolds_number"):
        shear.capsule_in_shear("Skalak", 0.01, radius=3, reynolds_number=20, duration=20)
