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
    """Nodes around each vertex, index (V, P³) uint64, and their weights (V, P³)."""

    index: np.ndarray
    weight: np.ndarray


def make_stencil(vertices: int, points: int) -> Stencil:
    """Work space for a kernel ``points`` nodes wide."""
    return Stencil(
        np.zeros((vertices, points**3), np.uint64), np.zeros((vertices, points**3), np.float64)
    )


@jit
def kernel_weights(offset, points, weight):
    """Weights of the nodes first … first + points - 1 of a kernel along one axis.

    ``offset``: distance of the vertex from the first node. 2 points: linear; 3: Roma, Peskin &
    Berger (1999), eq. 22; 4: Peskin (2002), eq. 6.27.
    """
    for p in range(points):
        r = abs(offset - p)
        if points == 2:
            weight[p] = 1.0 - r
        elif points == 3:
            if r < 0.5:
                weight[p] = (1.0 + np.sqrt(1.0 - 3.0 * r * r)) / 3.0
            else:
                root = 1.0 - 3.0 * (1.0 - r) * (1.0 - r)
                weight[p] = (5.0 - 3.0 * r - np.sqrt(max(root, 0.0))) / 6.0
        elif r < 1.0:
            weight[p] = (3.0 - 2.0 * r + np.sqrt(1.0 + 4.0 * r - 4.0 * r * r)) / 8.0
        else:
            root = -7.0 + 12.0 * r - 4.0 * r * r
            weight[p] = (5.0 - 2.0 * r - np.sqrt(max(root, 0.0))) / 8.0


@jit
def locate(x, domain, points, weights, stencil):
    """Fill the stencil of every vertex; ``weights`` (3, points) is work space."""
    nx, ny, nz = domain.nx, domain.ny, domain.nz
    for v in range(x.shape[0]):
        # First node of the kernel along each axis; node i sits at i + 1/2.
        shift = 0.0 if points == 3 else 0.5 * points - 1.0
        px, py, pz = x[v, 0] - 0.5, x[v, 1] - 0.5, x[v, 2] - 0.5
        if points == 3:
            bx, by, bz = np.floor(px + 0.5) - 1, np.floor(py + 0.5) - 1, np.floor(pz + 0.5) - 1
        else:
            bx, by, bz = np.floor(px) - shift, np.floor(py) - shift, np.floor(pz) - shift
        kernel_weights(px - bx, points, weights[0])
        kernel_weights(py - by, points, weights[1])
        kernel_weights(pz - bz, points, weights[2])
        ix, iy, iz = np.int64(bx), np.int64(by), np.int64(bz)
        n = 0
        for a in range(points):
            wraps = (ix + a) // nx
            jx = ix + a - wraps * nx
            for b in range(points):
                jy = (iy + b - wraps * domain.row_shift) % ny
                column = domain.column[jx, jy]
                wxy = weights[0, a] * weights[1, b]
                for c in range(points):
                    jz = iz + c
                    if not domain.walls:
                        jz %= nz
                    if column < 0 or jz < 0 or jz >= nz:
                        stencil.index[v, n] = 0
                        stencil.weight[v, n] = 0.0
                    else:
                        stencil.index[v, n] = column * nz + jz
                        stencil.weight[v, n] = wxy * weights[2, c]
                    n += 1


@jit
def spread(force, stencil, field):
    """Add the vertex forces (V, 3) to the force density ``field`` (3 * stride,)."""
    stride = np.uint64(len(field)) // np.uint64(3)
    for v in range(force.shape[0]):
        fx, fy, fz = force[v, 0], force[v, 1], force[v, 2]
        for n in range(stencil.index.shape[1]):
            i, w = stencil.index[v, n], stencil.weight[v, n]
            field[i] += w * fx
            field[i + stride] += w * fy
            field[i + stride + stride] += w * fz


@jit
def interpolate(field, stencil, velocity):
    """Velocity (V, 3) of the fluid at the vertices from ``field`` (3 * stride,)."""
    stride = np.uint64(len(field)) // np.uint64(3)
    for v in range(velocity.shape[0]):
        ux = uy = uz = 0.0
        for n in range(stencil.index.shape[1]):
            i, w = stencil.index[v, n], stencil.weight[v, n]
            ux += w * field[i]
            uy += w * field[i + stride]
            uz += w * field[i + stride + stride]
        velocity[v, 0] = ux
        velocity[v, 1] = uy
        velocity[v, 2] = uz


class Contact(NamedTuple):
    """Soft repulsion V(r) = a r⁻ⁿ per vertex, its force shifted to vanish at the range.

    ``strength`` (V,): a for every vertex, scaled with the area that it stands for. ``pillars``,
    ``plates``, ``channel``: which surfaces exist. ``profile`` (2, K): x and half width of the
    channel between ``channel`` walls mirrored about y = ``centre``, periodic over ``length``.
    """

    strength: np.ndarray
    exponent: float
    reach: float
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


CLOSEST = 0.05
"""Distance, in units of the range, below which the repulsion no longer grows."""


@jit
def _push(r, strength, contact):
    """Magnitude of the repulsion at distance r."""
    n = contact.exponent
    near = max(r, CLOSEST * contact.reach)
    return strength * n * (near ** (-n - 1.0) - contact.reach ** (-n - 1.0))


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
