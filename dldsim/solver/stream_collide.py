"""One time step of the fluid, block by block: gather, collide, put back.

The populations of the next step overwrite those of this one (compressed grid, Pohl et al.,
Parallel Process. Lett. 13 (2003) 549): before and after are two windows on the same memory, apart
by as many nodes as a population travels in the list of nodes, and the list is walked forwards when
the new window lies before the old one, backwards on the way back. Half the memory and two thirds
of the traffic of two arrays. What crosses the end of the domain along x would come too late; it is
set aside before the step.
"""

from typing import NamedTuple

import numpy as np

from dldsim.solver.collide import CollisionParameters, collide
from dldsim.solver.jit import jit
from dldsim.solver.streaming import BLOCK, ONE, Streaming, gather, put, set_aside


class Scheme(NamedTuple):
    """How one fluid goes on: see :class:`Streaming` and `collide`.

    ``buf`` (26 * BLOCK,): work space, its last rows zero.
    """

    streaming: Streaming
    parameters: CollisionParameters
    inertia: bool
    buf: np.ndarray


class FluidState(NamedTuple):
    """Arrays of one fluid and how it goes on; see `stream_collide`.

    Even steps go from ``f`` to ``f_new``, odd ones back.
    """

    f: np.ndarray
    f_new: np.ndarray
    force: np.ndarray
    velocity: np.ndarray
    scheme: Scheme


@jit
def _components(field):
    """The rows of a vector field, as arrays of their own."""
    n = len(field) // 3
    return field[:n], field[n : 2 * n], field[2 * n :]


@jit
def stream_collide(f, f_new, force, velocity, scheme):
    """One time step from populations ``f`` (after collision) to ``f_new``.

    ``f``, ``f_new`` (20 * stride,), of which the last stride is work space: windows on the same
    memory, `lead` elements apart, in which the step leaves nothing of ``f``; or two arrays.
    ``force``, ``velocity`` (3 * stride,): force density beside the uniform one, and the velocity
    that belongs to the state between streaming and collision; either may be empty: no force, and
    velocity not asked for.
    """
    streaming, parameters, inertia, buf = scheme
    spare = np.uint64(20) * BLOCK
    forced, asked = np.uint64(len(force) > 0), np.uint64(len(velocity) > 0)
    forces = _components(force if forced else buf[spare + np.uint64(3) * BLOCK :])
    velocities = _components(velocity if asked else buf[spare : spare + np.uint64(3) * BLOCK])
    end = 19 * (len(f) // 20)
    set_aside(f[:end], f[end:], streaming)
    blocks = np.uint64(len(streaming.patch_start)) - ONE
    backwards = f.ctypes.data < f_new.ctypes.data
    for count in range(blocks):
        block = blocks - ONE - count if backwards else count
        gather(block, f, streaming, buf)
        first = block * BLOCK
        collide(buf, forces, velocities, first * forced, first * asked, parameters, inertia)
        put(buf, first, f_new)


@jit
def damp_staggered_momentum(f, f_before, half):
    """Replace the state by its mean with the one a step before.

    D3Q19 conserves, up to a sign that alternates in time, the momentum along an axis weighted with
    alternating signs along that axis (eigenvalue -1 at wave number π, whatever the collision; cf.
    McNamara & Zanetti 1988). Forces that change from step to step feed it, nothing damps it, and
    in thousands of steps it drowns the flow. The mean removes it and delays the fluid by half a
    step, so call it now and then, not every step.
    """
    for i in range(len(f)):
        f[i] = half * (f[i] + f_before[i])
