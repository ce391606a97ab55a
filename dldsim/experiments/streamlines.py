"""What a point-like follower of the flow through an empty array does: a bound for particles."""

import numpy as np

from dldsim.solver.d3q19 import VELOCITIES
from dldsim.solver.flow import EmptyFlow, array_of
from dldsim.solver.lattice import neighbour
from dldsim.solver.pillars import ArrayLattice

STEP = 0.25
"""Length of a step along a streamline, nodes."""
STARTS = 33
"""Streamlines that are followed at once; the bracket shrinks by one less each time."""
ROUNDS = 3
GHOSTS = 1.5
"""How deep in a pillar nodes take part in interpolation, nodes."""
GHOST_ROUNDS = 4
"""What is outside lies in part between nodes inside: so often are they set."""


def critical_follower(flow: EmptyFlow, height: float = 0.5) -> float | None:
    """Critical diameter over gap of a point-like follower; None if all zigzag.

    ``height``: over that of the channel, 0 to 1, where the follower stays; 0.5 is midway.

    Twice the distance from a pillar, in the gap beside it, of the streamline that ends at the next
    pillar: what is nearer zigzags, what is further out bumps. In the plane it is twice the width of
    the first lane (Inglis et al. 2006, Lab Chip 6:655); in a channel of finite height the profile
    across the gap is blunter at mid-height, and the lane narrower.
    """
    array = array_of(flow)
    velocity = _layer(flow, array, height)
    low, high = 0.0, array.pitch - 2 * array.radius
    for _ in range(ROUNDS):
        starts = np.linspace(low, high, STARTS)
        above = _passes_above(starts, velocity, array)
        if not above.any():
            return None
        first = int(np.argmax(above))
        low, high = starts[max(first - 1, 0)], starts[first]
    return float((low + high) / (array.pitch - 2 * array.radius))


def _layer(flow: EmptyFlow, array: ArrayLattice, height: float) -> np.ndarray:
    """Velocity along x and y at a height on 3 × 4 pitches (2, 3 pitch, 4 pitch), from a pitch below
    the origin on.

    Nodes in pillars have the opposite of what is as far outside, so that it vanishes on the surface
    and not at the nodes.
    """
    lattice, pitch = array.lattice, array.pitch
    f = flow.populations.reshape(19, -1)[:, : lattice.nodes]
    u = (VELOCITIES.T @ f)[:2] - np.asarray(flow.body_force)[:2, None] / 2
    u = u.reshape(2, -1, lattice.nz)
    z = min(max(min(height, 1 - height) * array.height - 0.5, 0.0), lattice.nz - 1.0)
    below, above = int(z), min(int(z) + 1, lattice.nz - 1)
    layer = (1 + below - z) * u[:, :, below] + (z - below) * u[:, :, above]
    ix, iy = np.indices((3 * pitch, 4 * pitch)).reshape(2, -1) - pitch
    column = lattice.column[neighbour((lattice.nx, lattice.ny), lattice.row_shift, ix, iy, 0, 0)]
    u = np.where(column >= 0, layer[:, column], 0.0).reshape(2, 3 * pitch, 4 * pitch)
    row = np.floor(ix / pitch)
    x = ix + 0.5 - (row + 0.5) * pitch  # from the centre of the nearest pillar
    y = iy + 0.5 - pitch / 2 - row * array.row_shift
    y -= np.round(y / pitch) * pitch
    distance = np.hypot(x, y)
    ghost = np.flatnonzero((column < 0) & (distance > max(array.radius - GHOSTS, 0)))
    beyond = 2 * (array.radius / distance[ghost] - 1)
    at = np.array([ix, iy])[:, ghost] + pitch + beyond * np.array([x, y])[:, ghost]
    for _ in range(GHOST_ROUNDS):
        outside = _at(at, u)
        u.reshape(2, -1)[:, ghost] = -outside
    return u


def _at(place: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Velocity (2, n) at places (2, n) in nodes of the field, linear between them."""
    from scipy.ndimage import map_coordinates

    return np.array([map_coordinates(part, place, order=1, mode="nearest") for part in velocity])


def _passes_above(distances, velocity, array: ArrayLattice) -> np.ndarray:
    """Whether streamlines that start at these distances (n,), nodes, from the first pillar, in the
    gap above it, pass above the pillar of the next row. What begins or ends at rest does not."""
    pitch = array.pitch
    x = np.full(len(distances), pitch / 2)
    y = pitch / 2 + array.radius + distances
    last = 1.5 * pitch

    def direction(x, y):
        u = _at(np.array([x, y]) + pitch - 0.5, velocity)  # node i sits at i + 1/2
        return u / np.maximum(np.hypot(*u), np.finfo(float).tiny)

    for _ in range(int(4 * pitch / STEP)):
        dx, dy = direction(x, y)
        dx, dy = direction(x + STEP / 2 * dx, y + STEP / 2 * dy)
        going = x < last
        if not going.any():
            break
        x, y = x + STEP * dx * going, y + STEP * dy * going
    return (x >= last) & (y > pitch / 2 + array.row_shift)
