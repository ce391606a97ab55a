"""Collision: two relaxation times, the force after Guo et al. (2002)."""

from typing import NamedTuple

import numpy as np

from dldsim.solver.d3q19 import WEIGHTS
from dldsim.solver.jit import restrict
from dldsim.solver.streaming import BLOCK

MAGIC_PARAMETER = 3 / 16
"""Puts the wall of half-way bounce-back mid-link at any viscosity (Ginzburg et al. 2008)."""
_ROW = [np.uint64(q) * BLOCK for q in range(19)]
(
    _R1,
    _R2,
    _R3,
    _R4,
    _R5,
    _R6,
    _R7,
    _R8,
    _R9,
    _R10,
    _R11,
    _R12,
    _R13,
    _R14,
    _R15,
    _R16,
    _R17,
    _R18,
) = _ROW[1:]


@restrict
def collide(buf, force, velocity, at, to, parameters, inertia):
    """Collide BLOCK nodes in the buffer: two relaxation times, force after Guo et al. (2002).

    ``buf``: 19 rows of populations, replaced by those after collision. ``force``, 3 rows from
    ``at`` on: force density beside the uniform one; ``velocity``, 3 rows from ``to`` on: filled,
    half the force included. Velocity is momentum over the reference density, as in He & Luo
    (1997), so that a steady flow is solenoidal whatever its pressure. Without ``inertia`` the
    equilibrium is linear, which gives the unsteady Stokes equations; with it, Navier-Stokes.
    Written out over the stencil so that the compiler turns it into straight vector code; the tests
    hold its loop form.
    """
    omega_plus, omega_minus = parameters.omega_plus, parameters.omega_minus
    force_plus, force_minus = parameters.force_plus, parameters.force_minus
    body_force = parameters.body_force
    bodyx, bodyy, bodyz = body_force[0], body_force[1], body_force[2]
    w0, w1, w2 = parameters.w0, parameters.w1, parameters.w2
    zero, half, three, nine = parameters.zero, parameters.half, parameters.three, parameters.nine
    forcex, forcey, forcez = force
    ux, uy, uz = velocity
    for i in range(BLOCK):
        f0 = buf[i]
        f1 = buf[i + _R1]
        f2 = buf[i + _R2]
        f3 = buf[i + _R3]
        f4 = buf[i + _R4]
        f5 = buf[i + _R5]
        f6 = buf[i + _R6]
        f7 = buf[i + _R7]
        f8 = buf[i + _R8]
        f9 = buf[i + _R9]
        f10 = buf[i + _R10]
        f11 = buf[i + _R11]
        f12 = buf[i + _R12]
        f13 = buf[i + _R13]
        f14 = buf[i + _R14]
        f15 = buf[i + _R15]
        f16 = buf[i + _R16]
        f17 = buf[i + _R17]
        f18 = buf[i + _R18]
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
        buf[i] = f0 - omega_plus * f0 + w0 * e
        even = half * omega_plus * (f1 + f2) - w1 * e
        if inertia:
            even -= nine * w1 * jx * hx
        odd = half * omega_minus * (f1 - f2) - three * w1 * gx
        buf[i + _R1] = f1 - even - odd
        buf[i + _R2] = f2 - even + odd
        even = half * omega_plus * (f3 + f4) - w1 * e
        if inertia:
            even -= nine * w1 * jy * hy
        odd = half * omega_minus * (f3 - f4) - three * w1 * gy
        buf[i + _R3] = f3 - even - odd
        buf[i + _R4] = f4 - even + odd
        even = half * omega_plus * (f5 + f6) - w1 * e
        if inertia:
            even -= nine * w1 * jz * hz
        odd = half * omega_minus * (f5 - f6) - three * w1 * gz
        buf[i + _R5] = f5 - even - odd
        buf[i + _R6] = f6 - even + odd
        even = half * omega_plus * (f7 + f8) - w2 * e
        if inertia:
            even -= nine * w2 * (jx + jy) * (hx + hy)
        odd = half * omega_minus * (f7 - f8) - three * w2 * (gx + gy)
        buf[i + _R7] = f7 - even - odd
        buf[i + _R8] = f8 - even + odd
        even = half * omega_plus * (f9 + f10) - w2 * e
        if inertia:
            even -= nine * w2 * (jx - jy) * (hx - hy)
        odd = half * omega_minus * (f9 - f10) - three * w2 * (gx - gy)
        buf[i + _R9] = f9 - even - odd
        buf[i + _R10] = f10 - even + odd
        even = half * omega_plus * (f11 + f12) - w2 * e
        if inertia:
            even -= nine * w2 * (jx + jz) * (hx + hz)
        odd = half * omega_minus * (f11 - f12) - three * w2 * (gx + gz)
        buf[i + _R11] = f11 - even - odd
        buf[i + _R12] = f12 - even + odd
        even = half * omega_plus * (f13 + f14) - w2 * e
        if inertia:
            even -= nine * w2 * (jx - jz) * (hx - hz)
        odd = half * omega_minus * (f13 - f14) - three * w2 * (gx - gz)
        buf[i + _R13] = f13 - even - odd
        buf[i + _R14] = f14 - even + odd
        even = half * omega_plus * (f15 + f16) - w2 * e
        if inertia:
            even -= nine * w2 * (jy + jz) * (hy + hz)
        odd = half * omega_minus * (f15 - f16) - three * w2 * (gy + gz)
        buf[i + _R15] = f15 - even - odd
        buf[i + _R16] = f16 - even + odd
        even = half * omega_plus * (f17 + f18) - w2 * e
        if inertia:
            even -= nine * w2 * (jy - jz) * (hy - hz)
        odd = half * omega_minus * (f17 - f18) - three * w2 * (gy - gz)
        buf[i + _R17] = f17 - even - odd
        buf[i + _R18] = f18 - even + odd
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
