"""Contact of membrane vertices with solids: the push off pillars, plates and channel walls.

Lattice units; vertices (V, 3) are unwrapped.
"""

from typing import NamedTuple

import numpy as np

from dldsim.solver.jit import jit
from dldsim.solver.pillars import pillar_distance


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
    """Add the repulsion from pillars, plates and channel walls to ``force`` (V, 3), for at least
    as many positions."""
    for v in range(force.shape[0]):
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
