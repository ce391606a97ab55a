"""First order of a sphere with a network membrane in Stokes flow: what its steady shape must be.

A displacement a (w Y n + v ∇Y), with a surface harmonic Y of degree l on the unit sphere and
L = l(l + 1), strains the membrane by the dilation (2w − Lv) Y. With the shear modulus G and the
area modulus K of its tension K tr(ε) 1 + 2G dev(ε), and the uniform tension σ of a global area
term, the membrane bears the tractions f_n Y n + f_t ∇Y if

    f_n a = 2K (2w − Lv) + (L − 2) σ w
    f_t a = −K (2w − Lv) + (L − 2) (G + σ) v

The network's G = √3/4 k_s and K = 2G + k_α/2. Its hinges add 3κ/(2a²) [L² (w − v)²/9 + L (L − 2)
(2v − 4w/3)²/8] ⟨Y²⟩ to the energy, κ = √3/2 k_b: between equilateral faces the angle of an edge
changes by the curvature across it less a third of that along it, and with the strain of both faces.
The global term resists no harmonic at first order;
at second order the area grows by ΔS/S₀ = (L − 2)/2 w² ⟨Y²⟩ at constant volume, and
σ = k_ag/2 ΔS/S₀, which need not be small beside G since k_ag is not. (σ stands beside G as well,
because the term pulls vertices towards centroids, in a strained face by σ (1 + 2 dev(ε)).)

At first order the membrane is at rest but for a rotation as a whole, so that the tractions are
those on a solid sphere, whatever the viscosity inside: 5 μE·n in a strain rate E, Y = n·E·n, f_n =
5μ, f_t = 5μ/2; with σ = 0, r − a = a w Y has w = 5/4 (μa/G) (3 + G/K) and the Taylor deformation
of simple shear is 5/8 (3 + G/K) Ca (Barthès-Biesel & Rallison, J. Fluid Mech. 113 (1981) 251). In
u = −k ρ² along the axis, ρ the distance from it, a sphere that no force holds has, besides
displacements of degree 1, which do not change its shape, Y = P₃ (1 in front), f_n = 7/2 μka and
f_t = 7/6 μka, from Lamb's solution: w = 7/8 (μka²/G) (2 + G/K).
"""

import math
from typing import NamedTuple

import numpy as np

from dldsim.config.sections import Stiffness
from dldsim.solver.membrane import bending_modulus, shear_modulus

ALIKE = np.array([[12.5, -15.0], [-2.5, 10.0]])
"""Tractions, over μ, that velocities a (w Y n + v ∇Y) of degree 2 cost in fluids of one viscosity
inside and outside, from Lamb's solutions of both."""


class Moduli(NamedTuple):
    """G and K of springs and local area term, κ/a² of the hinges; µN/m."""

    shear: float
    area: float
    bending: float


def moduli(stiffness: Stiffness, radius_um: float) -> Moduli:
    shear = shear_modulus(stiffness.ks_uN_per_m)
    bending = bending_modulus(stiffness.kb_pN_um) / radius_um**2
    return Moduli(shear, 2 * shear + stiffness.kal_uN_per_m / 2, bending)


def elasticity(degree: int, given: Moduli, tension: float) -> np.ndarray:
    """Matrix (2, 2) from (w, v) to the tractions (f_n, f_t) a, f_t the derivative over v by L."""
    order, area = degree * (degree + 1), given.area
    spare = order - 2
    stretched = np.array(
        [
            [4 * area + spare * tension, -2 * area * order],
            [-2 * area, area * order + spare * (given.shear + tension)],
        ]
    )
    bent = np.array(
        [
            [order * (order + 2 * spare) / 9, -order * (order + 3 * spare) / 9],
            [-(order + 3 * spare) / 9, order / 9 + spare / 2],
        ]
    )
    return stretched + 3 * given.bending * bent


def displaced(
    degree: int, tractions, mean_square: float, given: Moduli, kag: float, volume: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """(w, v) under ``tractions`` (f_n, f_t) a [µN/m], and the `elasticity` at its tension.

    ``mean_square``: ⟨Y²⟩ over the sphere; ``kag`` [µN/m]; ``volume``: over that at rest, which
    takes two thirds of what it lacks from the area. The tension is found by bisection: more of it
    displaces less, and gives less area.
    """
    spare = degree * (degree + 1) - 2

    def at(tension: float) -> tuple[np.ndarray, np.ndarray]:
        matrix = elasticity(degree, given, tension)
        return np.linalg.solve(matrix, tractions), matrix

    def answer(tension: float) -> float:
        growth = spare / 2 * at(tension)[0][0] ** 2 * mean_square + 2 / 3 * (volume - 1)
        return kag / 2 * max(growth, 0.0)

    low, high = 0.0, answer(0.0)
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if answer(middle) > middle else (low, middle)
    return at((low + high) / 2)


def sphere_in_shear(
    stiffness: Stiffness, stress_Pa: float, radius_um: float, volume: float = 1.0
) -> tuple[float, float]:
    """Taylor deformation and inclination [deg] of a sphere in simple shear, one viscosity.

    Y = n_x n_z, whose ends are ±1/2. The membrane treads: seen from it the strain turns at γ̇/2, a
    harmonic of degree 2 at γ̇. What the fluids take for the velocities γ̇ (w, v) displaces the
    membrane in quadrature, so that it lags by φ, that displacement over w, and the longer axis lies
    at 45° − φ/2.
    """
    load = stress_Pa * radius_um  # Pa µm = µN/m; γ̇ goes with μ
    given, kag = moduli(stiffness, radius_um), stiffness.kag_uN_per_m
    shape, matrix = displaced(2, load * np.array([5, 2.5]), 1 / 15, given, kag, volume)
    lag = np.linalg.solve(matrix, load * ALIKE @ shape)[0] / shape[0]
    return shape[0] / 2, 45 - math.degrees(lag) / 2


def sphere_in_paraboloid(
    stiffness: Stiffness, load: float, radius_um: float, volume: float = 1.0
) -> float:
    """w of the harmonic P₃ of a sphere on the axis of u = −k ρ²; ``load``: μka² [µN/m]."""
    given, kag = moduli(stiffness, radius_um), stiffness.kag_uN_per_m
    shape, _ = displaced(3, load * np.array([7 / 2, 7 / 6]), 1 / 7, given, kag, volume)
    return float(shape[0])
