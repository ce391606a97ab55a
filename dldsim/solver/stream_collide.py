"""One time step of the fluid, block by block, in place: see :mod:`dldsim.solver.streaming`."""

from typing import NamedTuple

import numpy as np

from dldsim.solver.collide import CollisionParameters, collide
from dldsim.solver.jit import jit
from dldsim.solver.streaming import BLOCK, ONE, Streaming, double, meet_walls, put, take, take_back


class Scheme(NamedTuple):
    """How one fluid goes on: see :class:`Streaming` and `collide`.

    ``buf`` (26 * BLOCK,): work space, its last rows zero.
    """

    streaming: Streaming
    parameters: CollisionParameters
    inertia: bool
    buf: np.ndarray


class FluidState(NamedTuple):
    """Arrays of one fluid and how it goes on; see `stream_collide`."""

    f: np.ndarray
    force: np.ndarray
    velocity: np.ndarray
    near: np.ndarray
    scheme: Scheme


@jit
def _components(field):
    """The rows of a vector field, as arrays of their own."""
    n = len(field) // 3
    return field[:n], field[n : 2 * n], field[2 * n :]


@jit
def _rows(f):
    """The rows of populations, as arrays of their own."""
    n = len(f) // 19
    return (
        f[:n],
        f[n : 2 * n],
        f[2 * n : 3 * n],
        f[3 * n : 4 * n],
        f[4 * n : 5 * n],
        f[5 * n : 6 * n],
        f[6 * n : 7 * n],
        f[7 * n : 8 * n],
        f[8 * n : 9 * n],
        f[9 * n : 10 * n],
        f[10 * n : 11 * n],
        f[11 * n : 12 * n],
        f[12 * n : 13 * n],
        f[13 * n : 14 * n],
        f[14 * n : 15 * n],
        f[15 * n : 16 * n],
        f[16 * n : 17 * n],
        f[17 * n : 18 * n],
        f[18 * n :],
    )


@jit
def stream_collide(step, f, force, velocity, near, scheme):
    """Time step number ``step`` of the populations ``f`` (19 * stride,).

    Before an even step and after an odd one every population is in its own row, as it left its
    node. ``force``, ``velocity`` (3 * stride,): force density beside the uniform one, and the
    velocity that belongs to the state between streaming and collision; either may be empty: no
    force, and velocity not asked for. ``near`` (blocks,): 1 where they are not, 0 where there is no
    force and velocity stays as it was; empty: 1 everywhere.
    """
    streaming, parameters, inertia, buf = scheme
    spare = np.uint64(20) * BLOCK
    nothing = _components(buf[spare + np.uint64(3) * BLOCK :])
    anywhere = _components(buf[spare : spare + np.uint64(3) * BLOCK])
    odd = step % 2 == 1
    meet_walls(odd, f, streaming)
    blocks = np.uint64(len(streaming.part_start)) - ONE
    rows = _rows(f if odd else buf[: np.uint64(19) * BLOCK])
    start = np.uint64(0)
    while start < blocks:
        here = len(near) == 0 or near[start] != 0
        stop = start + ONE
        while stop < blocks and (len(near) == 0 or (near[stop] != 0) == here):
            stop += ONE
        forced = np.uint64(here and len(force) > 0)
        asked = np.uint64(here and len(velocity) > 0)
        forces = _components(force) if forced else nothing
        velocities = _components(velocity) if asked else anywhere
        for block in range(start, stop):
            first = block * BLOCK
            if odd:
                double(block, f, streaming)
            else:
                take(block, f, streaming, buf)
            collide(
                rows,
                first * np.uint64(odd),
                forces,
                first * forced,
                velocities,
                first * asked,
                parameters,
                inertia,
            )
            if not odd:
                put(block, buf, streaming, f)
        start = stop


@jit
def damp_staggered_momentum(f, before, scheme):
    """Replace the state by its mean with the one a step before.

    ``f`` is that after an odd step, ``before`` that before it, both (19 * stride,). D3Q19
    conserves, up to a sign that alternates in time, the momentum along an axis weighted with
    alternating signs along that axis (eigenvalue -1 at wave number π, whatever the collision; cf.
    McNamara & Zanetti 1988). Forces that change from step to step feed it, nothing damps it, and
    in thousands of steps it drowns the flow. The mean removes it and delays the fluid by half a
    step, so call it now and then, not every step.
    """
    half, buf = scheme.parameters.half, scheme.buf
    stride = np.uint64(len(f)) // np.uint64(19)
    for block in range(np.uint64(len(scheme.streaming.part_start)) - ONE):
        take_back(block, before, scheme.streaming, buf)
        for q in range(np.uint64(19)):
            a, b = q * stride + block * BLOCK, q * BLOCK
            for i in range(BLOCK):
                f[a + i] = half * (f[a + i] + buf[b + i])
