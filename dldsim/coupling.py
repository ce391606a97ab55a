"""Immersed-boundary coupling between membrane vertices and lattice, and contact with solids.

Lattice units. Vertices (V, 3) are unwrapped; the domain repeats along y, along x with a row shift,
and along z unless there are walls. Nodes in solids hold no fluid: their velocity is zero, and a
force spread to them goes to the solid.
"""

from typing import NamedTuple

import numpy as np

from dldsim._numba import jit
from dldsim.geometry import pillar_distance


class Domain(NamedTuple):
    """Where lattice nodes are; see :class:`dldsim.lattice.Lattice`."""

    nx: int
    ny: int
    nz: int
    row_shift: int
    walls: bool
    column: np.ndarray


class Stencil(NamedTuple):
    """Nodes around each vertex, index (V, 3, N) uint64, and their weights (V, 3, N).

    Each component of a vector has its own nodes: along its own axis the kernel is ``own``, along
    the others ``across``. ``first`` (3, 2) and ``axis_weight`` (3, 2, 4): work space.
    """

    index: np.ndarray
    weight: np.ndarray
    own: int
    across: int
    first: np.ndarray
    axis_weight: np.ndarray


LINEAR, TRAPEZOID, ROMA, PESKIN = range(4)
POINTS = 2, 3, 3, 4
KERNELS = {
    "compact": (TRAPEZOID, LINEAR),
    "linear": (LINEAR, LINEAR),
    "3-point": (ROMA, ROMA),
    "4-point": (PESKIN, PESKIN),
}
EVEN_ODD = "compact", "4-point"
"""Kernels that neither feed nor see staggered momentum.

Along the axis of each component their weights on even and on odd nodes are the same, one half
(Peskin 2002, section 6).
"""


def make_stencil(vertices: int, kernel: str) -> Stencil:
    """Work space for one of KERNELS."""
    own, across = KERNELS[kernel]
    shape = vertices, 3, POINTS[own] * POINTS[across] ** 2
    return Stencil(
        np.zeros(shape, np.uint64), np.zeros(shape), own, across, np.zeros((3, 2), np.int64),
        np.zeros((3, 2, 4)),
    )  # fmt: skip


@jit
def kernel_weights(p, kind, weight):
    """First node and number of nodes of a kernel along one axis; fills their weights.

    ``p``: position in nodes. LINEAR: hat of half width one. TRAPEZOID: the mean of two hats half a
    node to either side, the narrowest kernel that meets the even-odd condition and keeps the first
    moment. ROMA: Roma, Peskin & Berger (1999), eq. 22. PESKIN: Peskin (2002), eq. 6.27.
    """
    if kind == LINEAR:
        first = np.floor(p)
        weight[0] = 1.0 - (p - first)
        weight[1] = p - first
        return np.int64(first), 2
    if kind == PESKIN:
        first = np.floor(p) - 1.0
        for n in range(4):
            r = abs(p - first - n)
            if r < 1.0:
                weight[n] = (3.0 - 2.0 * r + np.sqrt(1.0 + 4.0 * r - 4.0 * r * r)) / 8.0
            else:
                root = -7.0 + 12.0 * r - 4.0 * r * r
                weight[n] = (5.0 - 2.0 * r - np.sqrt(max(root, 0.0))) / 8.0
        return np.int64(first), 4
    first = np.floor(p + 0.5) - 1.0
    t = p - first - 1.0
    if kind == TRAPEZOID:
        weight[0] = 0.25 - 0.5 * t
        weight[1] = 0.5
        weight[2] = 0.25 + 0.5 * t
    else:
        for n in range(3):
            r = abs(t + 1.0 - n)
            if r < 0.5:
                weight[n] = (1.0 + np.sqrt(1.0 - 3.0 * r * r)) / 3.0
            else:
                root = 1.0 - 3.0 * (1.0 - r) * (1.0 - r)
                weight[n] = (5.0 - 3.0 * r - np.sqrt(max(root, 0.0))) / 6.0
    return np.int64(first), 3


@jit
def locate(x, domain, stencil):
    """Fill the stencil of every vertex."""
    nx, ny, nz = domain.nx, domain.ny, domain.nz
    first, weight = stencil.first, stencil.axis_weight
    points = np.zeros(2, np.int64)
    for v in range(x.shape[0]):
        for d in range(3):  # node i sits at i + 1/2
            first[d, 0], points[0] = kernel_weights(x[v, d] - 0.5, stencil.across, weight[d, 0])
            first[d, 1], points[1] = kernel_weights(x[v, d] - 0.5, stencil.own, weight[d, 1])
        for d in range(3):
            kx, ky, kz = np.int64(d == 0), np.int64(d == 1), np.int64(d == 2)
            n = 0
            for a in range(points[kx]):
                ix = first[0, kx] + a
                wraps = ix // nx
                jx = ix - wraps * nx
                for b in range(points[ky]):
                    jy = (first[1, ky] + b - wraps * domain.row_shift) % ny
                    column = domain.column[jx, jy]
                    wxy = weight[0, kx, a] * weight[1, ky, b]
                    for c in range(points[kz]):
                        jz = first[2, kz] + c
                        if not domain.walls:
                            jz %= nz
                        if column < 0 or jz < 0 or jz >= nz:
                            stencil.index[v, d, n] = 0
                            stencil.weight[v, d, n] = 0.0
                        else:
                            stencil.index[v, d, n] = column * nz + jz
                            stencil.weight[v, d, n] = wxy * weight[2, kz, c]
                        n += 1


@jit
def spread(force, stencil, field):
    """Add the vertex forces (V, 3) to the force density ``field`` (3 * stride,)."""
    stride = np.uint64(len(field)) // np.uint64(3)
    for v in range(force.shape[0]):
        for d in range(3):
            for n in range(stencil.index.shape[2]):
                i = stencil.index[v, d, n] + np.uint64(d) * stride
                field[i] += stencil.weight[v, d, n] * force[v, d]


@jit
def interpolate(velocity, force, ahead, stencil, vertex_velocity):
    """Velocity (V, 3) of the fluid at the vertices, ``ahead`` steps after the present.

    ``velocity``, ``force`` (3 * stride,): fields of velocity and force density. The force changes
    the momentum by itself in one step.
    """
    stride = np.uint64(len(velocity)) // np.uint64(3)
    for v in range(vertex_velocity.shape[0]):
        for d in range(3):
            u = 0.0
            for n in range(stencil.index.shape[2]):
                i = stencil.index[v, d, n] + np.uint64(d) * stride
                u += stencil.weight[v, d, n] * (velocity[i] + ahead * force[i])
            vertex_velocity[v, d] = u


class Contact(NamedTuple):
    """Soft repulsion V(r) = a r⁻ⁿ per vertex, its force shifted to vanish at the range.

    ``strength`` (V,): a for every vertex, scaled with the area that it stands for. Below ``core``
    the force goes on linearly: an explicit step bears no steeper one. ``pillars``,
    ``plates``, ``channel``: which surfaces exist. ``profile`` (2, K): x and half width of the
    channel between ``channel`` walls mirrored about y = ``centre``, periodic over ``length``.
    """

    strength: np.ndarray
    exponent: float
    reach: float
    core: float
    pillars: bool
    pitch: float
    row_shift: float
    radius: float
    plates: bool
    height: float
    channel: bool
    profile: np.ndarray
    centre: float
    length: float


@jit
def _push(r, strength, contact):
    """Magnitude of the repulsion at distance r; linear below the core."""
    n = contact.exponent
    far = max(r, contact.core)
    push = strength * n * (far ** (-n - 1.0) - contact.reach ** (-n - 1.0))
    return push + strength * n * (n + 1.0) * far ** (-n - 2.0) * (far - r)


@jit
def channel_distance(x, y, contact):
    """Distance from the nearer side wall of the channel and the unit vector away from it."""
    xp = x - contact.length * np.floor(x / contact.length)
    side = 1.0 if y < contact.centre else -1.0
    h = abs(y - contact.centre)
    profile = contact.profile
    best, ux, uy = 1e30, 0.0, 0.0
    inside = True
    for k in range(profile.shape[1] - 1):
        ax, ah = profile[0, k], profile[1, k]
        dx, dh = profile[0, k + 1] - ax, profile[1, k + 1] - ah
        t = ((xp - ax) * dx + (h - ah) * dh) / (dx * dx + dh * dh)
        t = min(max(t, 0.0), 1.0)
        px, ph = xp - ax - t * dx, h - ah - t * dh
        d = np.sqrt(px * px + ph * ph)
        if d < best:
            best = d
            inside = px * dh - ph * dx > 0.0
            norm = max(d, 1e-12)
            ux, uy = px / norm, ph / norm
    if not inside:
        best, ux, uy = -best, -ux, -uy
    return best, ux, -side * uy


@jit
def contact_forces(x, contact, force):
    """Add the repulsion from pillars, plates and channel walls to ``force`` (V, 3)."""
    for v in range(x.shape[0]):
        a = contact.strength[v]
        if contact.pillars:
            r, ux, uy = pillar_distance(
                x[v, 0], x[v, 1], contact.pitch, contact.row_shift, contact.radius
            )
            if r < contact.reach:
                push = _push(r, a, contact)
                force[v, 0] += push * ux
                force[v, 1] += push * uy
        if contact.channel:
            r, ux, uy = channel_distance(x[v, 0], x[v, 1], contact)
            if r < contact.reach:
                push = _push(r, a, contact)
                force[v, 0] += push * ux
                force[v, 1] += push * uy
        if contact.plates:
            if x[v, 2] < contact.reach:
                force[v, 2] += _push(x[v, 2], a, contact)
            if contact.height - x[v, 2] < contact.reach:
                force[v, 2] -= _push(contact.height - x[v, 2], a, contact)


@jit
def clearance(x, contact):
    """Smallest distance of any vertex from any surface, with sign."""
    least = 1e30
    for v in range(x.shape[0]):
        if contact.pillars:
            r, _, _ = pillar_distance(
                x[v, 0], x[v, 1], contact.pitch, contact.row_shift, contact.radius
            )
            least = min(least, r)
        if contact.channel:
            r, _, _ = channel_distance(x[v, 0], x[v, 1], contact)
            least = min(least, r)
        if contact.plates:
            least = min(least, x[v, 2], contact.height - x[v, 2])
    return least
