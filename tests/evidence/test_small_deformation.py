"""The first-order theory of a sphere's shape: published coefficients, and limits that must hold."""

import numpy as np
import pytest

from dldsim.config.sections import Stiffness
from dldsim.evidence import small_deformation as theory
from dldsim.solver import membrane as mb
from dldsim.solver.membrane import shear_modulus
from dldsim.solver.mesh import icosphere

TINY = 1e-4
"""Stress times radius over G at which the second order has no say."""


def membrane(ks=10.0, kb=0.0, kal=0.0, kag=0.0):
    return Stiffness(
        ks_uN_per_m=ks, kb_pN_um=kb, kal_uN_per_m=kal, kag_uN_per_m=kag, kv_Pa=0, kvisc_nN_s_per_m=0
    )


@pytest.mark.parametrize("kal, ratio", [(0.0, 35 / 16), (3**0.5 / 2 * 10, 25 / 12)])
def test_coefficient_of_simple_shear(kal, ratio):
    """35/16 for springs (K = 2 G), 25/12 where the area term makes K = 3 G, as of neo-Hookean and
    Skalak membranes (Barthès-Biesel & Rallison 1981)."""
    ca = TINY
    found, _ = theory.sphere_in_shear(membrane(kal=kal), ca * shear_modulus(10), 1.0)
    assert found / ca == pytest.approx(ratio, rel=1e-6)


def test_inclination_at_first_order():
    """Boundary integral, K = 3 G, Ca 0.0375 and a little bending: 40.9°, 4.1° from 45°."""
    stiff = membrane(kal=3**0.5 / 2 * 10)
    _, angle = theory.sphere_in_shear(stiff, 0.0375 * shear_modulus(10), 1.0)
    assert 45 - angle == pytest.approx(4.1, rel=0.08)


def test_coefficient_of_a_paraboloid():
    w = theory.sphere_in_paraboloid(membrane(), TINY * shear_modulus(10), 1.0)
    assert w / TINY == pytest.approx(7 / 8 * 2.5, rel=1e-6)


def test_tractions_of_a_paraboloid():
    """f_n = 7/2, f_t = 7/6 and no force: the surface values of the flow around a solid sphere.

    The disturbance of degree 3 is A times the flow of the pressure r⁻⁴ P₃ and B times ∇(r⁻⁴ P₃);
    with no slip it cancels the ambient (2/5, 2/15) of u = −ρ², and the tractions are −p and the
    normal derivative of the velocity.
    """
    a, b = np.linalg.solve([[2 / 5, -4], [-1 / 30, 1]], [-2 / 5, -2 / 15])
    assert -a == pytest.approx(7 / 2)
    assert 4 / 15 + a / 10 - 5 * b == pytest.approx(7 / 6)


def test_global_area_term_counts_at_large_deformation_only():
    free, held = membrane(kal=20), membrane(kal=20, kag=500)
    small, large = (ca * shear_modulus(10) for ca in (TINY, 0.1))
    assert theory.sphere_in_shear(held, small, 1.0)[0] == pytest.approx(
        theory.sphere_in_shear(free, small, 1.0)[0], rel=1e-3
    )
    assert (
        theory.sphere_in_shear(held, large, 1.0)[0]
        < 0.7 * theory.sphere_in_shear(free, large, 1.0)[0]
    )


def test_hinges_and_springs_by_the_energy_of_a_mesh():
    """Second differences of the energies of an icosphere along (w, v) of P₂ and P₃."""
    x, faces = icosphere(16)
    sphere = mb.make_membrane(x, faces)
    only = {"ks": membrane().model_copy(update={"kb_pN_um": 0.0}), "kb": membrane(ks=0.0, kb=1.0)}
    for degree, tolerance in ((2, 0.05), (3, 0.05)):
        order = degree * (degree + 1)
        for term, stiffness in only.items():
            matrix = theory.elasticity(degree, theory.moduli(stiffness, 1.0), 0.0)
            coefficients = {
                "ks": stiffness.ks_uN_per_m if term == "ks" else 0.0,
                "kb": stiffness.kb_pN_um if term == "kb" else 0.0,
            }
            given = mb.Moduli(**coefficients, kal=0.0, kag=0.0, kv=0.0, kvisc=0.0)
            for w, v in ((1.0, 0.0), (0.0, 1.0), (1.0, 0.4)):
                shape = np.array([w, v])
                expected = shape @ (matrix * [[1], [order]]) @ shape / 2 * sphere.rest_area
                energy = sum(mb.energies(x + STEP * harmonic(x, degree, w, v), sphere, given))
                mean_square = 1 / (2 * degree + 1)
                assert energy / STEP**2 == pytest.approx(expected * mean_square, rel=tolerance)


STEP = 1e-4


def harmonic(x, degree, w, v):
    """Displacement w P_l n + v ∇P_l of the unit sphere (V, 3), about x."""
    along = x[:, :1]
    value, slope = {
        2: ((3 * along**2 - 1) / 2, 3 * along),
        3: ((5 * along**3 - 3 * along) / 2, (15 * along**2 - 3) / 2),
    }[degree]
    return w * value * x + v * slope * (np.array([1.0, 0, 0]) - along * x)
