"""Collision: two relaxation times, the force after Guo et al. (2002)."""

from typing import NamedTuple

import numpy as np

from dldsim.solver.d3q19 import WEIGHTS
from dldsim.solver.jit import inlined
from dldsim.solver.streaming import BLOCK

MAGIC_PARAMETER = 3 / 16
"""Puts the wall of half-way bounce-back mid-link at any viscosity (Ginzburg et al. 2008)."""


@inlined
def collide(rows, first, force, at, velocity, to, parameters, inertia):
    """Collide BLOCK nodes: two relaxation times, force after Guo et al. (2002).

    ``rows``, 19 from ``first`` on: what arrives, in the row of the opposite direction, replaced by
    what leaves, each in its own. ``force``, 3 rows from ``at`` on: force density beside the uniform
    one; ``velocity``, 3 rows from ``to`` on: filled, half the force included. Velocity is momentum
    over the reference density, as in He & Luo (1997), so that a steady flow is solenoidal whatever
    its pressure. Without ``inertia`` the equilibrium is linear, which gives the unsteady Stokes
    equations; with it, Navier-Stokes. Written out over the stencil so that the compiler turns it
    into straight vector code; the tests hold its loop form.
    """
    omega_plus, omega_minus = parameters.omega_plus, parameters.omega_minus
    force_plus, force_minus = parameters.force_plus, parameters.force_minus
    body_force = parameters.body_force
    bodyx, bodyy, bodyz = body_force[0], body_force[1], body_force[2]
    w0, w1, w2 = parameters.w0, parameters.w1, parameters.w2
    zero, half, three, nine = parameters.zero, parameters.half, parameters.three, parameters.nine
    forcex, forcey, forcez = force
    ux, uy, uz = velocity
    r0, r1, r2, r3, r4, r5, r6, r7, r8, r9, r10, r11, r12, r13, r14, r15, r16, r17, r18 = rows
    for i in range(BLOCK):
        f0 = r0[first + i]
        f1 = r2[first + i]
        f2 = r1[first + i]
        f3 = r4[first + i]
        f4 = r3[first + i]
        f5 = r6[first + i]
        f6 = r5[first + i]
        f7 = r8[first + i]
        f8 = r7[first + i]
        f9 = r10[first + i]
        f10 = r9[first + i]
        f11 = r12[first + i]
        f12 = r11[first + i]
        f13 = r14[first + i]
        f14 = r13[first + i]
        f15 = r16[first + i]
        f16 = r15[first + i]
        f17 = r18[first + i]
        f18 = r17[first + i]
        rho = (
            f0
            + f1
            + f2
            + f3
            + f4
            + f5
            + f6
            + f7
            + f8
            + f9
            + f10
            + f11
            + f12
            + f13
            + f14
            + f15
            + f16
            + f17
            + f18
        )
        Fx = forcex[at + i] + bodyx
        jx = f1 + f7 + f9 + f11 + f13 - f2 - f8 - f10 - f12 - f14 + half * Fx
        gx = omega_minus * jx + force_minus * Fx
        Fy = forcey[at + i] + bodyy
        jy = f3 + f7 + f10 + f15 + f17 - f4 - f8 - f9 - f16 - f18 + half * Fy
        gy = omega_minus * jy + force_minus * Fy
        Fz = forcez[at + i] + bodyz
        jz = f5 + f11 + f14 + f15 + f18 - f6 - f12 - f13 - f16 - f17 + half * Fz
        gz = omega_minus * jz + force_minus * Fz
        if inertia:
            hx = half * omega_plus * jx + force_plus * Fx
            hy = half * omega_plus * jy + force_plus * Fy
            hz = half * omega_plus * jz + force_plus * Fz
            uh = three * (jx * hx + jy * hy + jz * hz)
        else:
            hx = zero
            hy = zero
            hz = zero
            uh = zero
        e = omega_plus * rho - uh
        r0[first + i] = f0 - omega_plus * f0 + w0 * e
        even = half * omega_plus * (f1 + f2) - w1 * e
        if inertia:
            even -= nine * w1 * jx * hx
        odd = half * omega_minus * (f1 - f2) - three * w1 * gx
        r1[first + i] = f1 - even - odd
        r2[first + i] = f2 - even + odd
        even = half * omega_plus * (f3 + f4) - w1 * e
        if inertia:
            even -= nine * w1 * jy * hy
        odd = half * omega_minus * (f3 - f4) - three * w1 * gy
        r3[first + i] = f3 - even - odd
        r4[first + i] = f4 - even + odd
        even = half * omega_plus * (f5 + f6) - w1 * e
        if inertia:
            even -= nine * w1 * jz * hz
        odd = half * omega_minus * (f5 - f6) - three * w1 * gz
        r5[first + i] = f5 - even - odd
        r6[first + i] = f6 - even + odd
        even = half * omega_plus * (f7 + f8) - w2 * e
        if inertia:
            even -= nine * w2 * (jx + jy) * (hx + hy)
        odd = half * omega_minus * (f7 - f8) - three * w2 * (gx + gy)
        r7[first + i] = f7 - even - odd
        r8[first + i] = f8 - even + odd
        even = half * omega_plus * (f9 + f10) - w2 * e
        if inertia:
            even -= nine * w2 * (jx - jy) * (hx - hy)
        odd = half * omega_minus * (f9 - f10) - three * w2 * (gx - gy)
        r9[first + i] = f9 - even - odd
        r10[first + i] = f10 - even + odd
        even = half * omega_plus * (f11 + f12) - w2 * e
        if inertia:
            even -= nine * w2 * (jx + jz) * (hx + hz)
        odd = half * omega_minus * (f11 - f12) - three * w2 * (gx + gz)
        r11[first + i] = f11 - even - odd
        r12[first + i] = f12 - even + odd
        even = half * omega_plus * (f13 + f14) - w2 * e
        if inertia:
            even -= nine * w2 * (jx - jz) * (hx - hz)
        odd = half * omega_minus * (f13 - f14) - three * w2 * (gx - gz)
        r13[first + i] = f13 - even - odd
        r14[first + i] = f14 - even + odd
        even = half * omega_plus * (f15 + f16) - w2 * e
        if inertia:
            even -= nine * w2 * (jy + jz) * (hy + hz)
        odd = half * omega_minus * (f15 - f16) - three * w2 * (gy + gz)
        r15[first + i] = f15 - even - odd
        r16[first + i] = f16 - even + odd
        even = half * omega_plus * (f17 + f18) - w2 * e
        if inertia:
            even -= nine * w2 * (jy - jz) * (hy - hz)
        odd = half * omega_minus * (f17 - f18) - three * w2 * (gy - gz)
        r17[first + i] = f17 - even - odd
        r18[first + i] = f18 - even + odd
        ux[to + i] = jx
        uy[to + i] = jy
        uz[to + i] = jz


class CollisionParameters(NamedTuple):
    """Constants of the collision, in the precision of the populations: a literal would be double.

    ``omega_plus``, ``omega_minus``: rates of the even and the odd part of the populations;
    ``force_plus``, ``force_minus``: 1 - ω/2, by which the force goes with them; ``body_force``
    (3,): uniform force density, which a drive corrects in place; ``w0``, ``w1``, ``w2``: weights
    of rest, along an axis and across.
    """

    omega_plus: np.floating
    omega_minus: np.floating
    force_plus: np.floating
    force_minus: np.floating
    body_force: np.ndarray
    w0: np.floating
    w1: np.floating
    w2: np.floating
    zero: np.floating
    half: np.floating
    three: np.floating
    nine: np.floating


def collision_parameters(
    relaxation_time: float, collision: str, body_force, dtype=np.float32
) -> CollisionParameters:
    """Constants of the collision in the precision ``dtype`` of the populations.

    ``collision``: "trt" (second rate from the magic parameter) or "bgk" (both rates equal).
    ``body_force`` (3,): uniform force density.
    """
    one = np.dtype(dtype).type
    omega_plus = 1 / relaxation_time
    if collision == "trt":
        omega_minus = 1 / (0.5 + MAGIC_PARAMETER / (relaxation_time - 0.5))
    else:
        omega_minus = omega_plus
    return CollisionParameters(
        one(omega_plus),
        one(omega_minus),
        one(1 - omega_plus / 2),
        one(1 - omega_minus / 2),
        np.array(body_force, dtype),
        *map(one, WEIGHTS[[0, 1, 7]]),
        *map(one, (0, 0.5, 3, 9)),
    )
