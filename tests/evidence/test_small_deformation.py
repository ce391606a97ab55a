"""The first-order theory of a sphere's shape: published coefficients, and limits that must hold."""

import numpy as np
import pytest

from dldsim.config.sections import Stiffness
from dldsim.evidence import small_deformation as theory
from dldsim.experiments.outline import circularity
from dldsim.solver.membrane import shear_modulus

TINY = 1e-4
"""Stress times radius over G at which the second order has no say."""


def membrane(ks=10.0, kal=0.0, kag=0.0):
    return Stiffness(
        ks_uN_per_m=ks, kb_pN_um=0, kal_uN_per_m=kal, kag_uN_per_m=kag, kv_Pa=0, kvisc_nN_s_per_m=0
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
    w = theory.sphere_in_paraboloid(membrane(), TINY * shear_modulus(10))
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


def test_roundness_of_a_bullet():
    w = 0.02
    angle = np.arange(360) * 2 * np.pi / 360
    radii = 1 + w * (3 * np.cos(angle) + 5 * np.cos(3 * angle)) / 8
    round_ = 1 - circularity(np.ones(360))
    assert 1 - circularity(radii) - round_ == pytest.approx(theory.bullet_roundness(w), rel=0.02)
