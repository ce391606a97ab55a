"""Streaming in place, as tables of copies, and the kernels that follow them.

Populations are stored as deviations from the fluid at rest,
``f[q * stride + column * nz + k]``, which keeps single precision safe. Steps come in pairs (AA
pattern: Bailey et al., Int. Conf. Parallel Processing 2009, 550). An even step takes what arrives
at a node from where it lies, and puts what leaves into the same places, opposite for opposite. So
what arrives in an odd step lies at the node, in the rows of the opposite directions, and what
leaves goes to its own row. Every element is written where it was read, and once per step.

For every node and direction the tables name the element that arrives in an even step, whether by
propagation, bounce-back, periodicity or row shift. Runs of consecutive elements are copied as a
whole to a small buffer, in which the collision runs without branches, and back; elements that break
a run (at channel walls) are copied one by one.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dldsim.solver.d3q19 import MIRRORED, OPPOSITE
from dldsim.solver.jit import LANES, copy_masked, jit, restrict

BLOCK = np.uint64(128)
"""Nodes that are collided together; what a block reads and writes fits the first-level cache."""
PIECE = np.uint64(LANES)
LONG = np.uint64(32)
"""Elements that are copied at once: loops of constant length need no remainder and no branch."""

ONE = np.uint64(1)


class Streaming(NamedTuple):
    """Copies of an even step, by block, and what is added to populations before a step.

    ``*_start``: first entry of each block, one entry more than there are blocks; ``*_place``: in
    the populations; ``*_at``: in the buffer, in the row of the direction that leaves.
    ``part_*``, ``whole_*``: runs of PIECE and LONG elements. A part begins a run or breaks off
    within it; its elements whose bit of ``part_mask`` is not set are others'. Parts come first and
    in order, since in the buffer they may cover where another is written later.
    ``in_*``, ``out_*``: single elements, on the way in and out.
    ``twin_*``: elements that arrive twice at a node on a mirror; in an odd step ``twin_place`` is
    filled from ``twin_other``.
    ``push_*``: what a moving wall adds in each step. ``blend_*``: to ``blend_place`` the weighted
    difference of two elements, ``more`` and ``less``, is added (interpolated bounce-back).
    """

    part_start: np.ndarray
    part_place: np.ndarray
    part_at: np.ndarray
    part_mask: np.ndarray
    whole_start: np.ndarray
    whole_place: np.ndarray
    whole_at: np.ndarray
    in_start: np.ndarray
    in_place: np.ndarray
    in_at: np.ndarray
    out_start: np.ndarray
    out_place: np.ndarray
    out_at: np.ndarray
    twin_start: np.ndarray
    twin_place: np.ndarray
    twin_other: np.ndarray
    push_place: np.ndarray
    push_addend: np.ndarray
    blend_place: np.ndarray
    blend_weight: np.ndarray
    blend_even_more: np.ndarray
    blend_even_less: np.ndarray
    blend_odd_more: np.ndarray
    blend_odd_less: np.ndarray


class Arrival(NamedTuple):
    """What arrives at all nodes (n,) in one direction, as elements of the populations.

    ``element``: where it comes from; ``run``: the same if columns went on for ever. ``twin``:
    whether the element arrives in the mirrored direction too. ``moving``: what a moving wall adds.
    ``behind``: element of which interpolation adds ``weight`` times, less what leaves the node in
    this direction, or -1.
    """

    element: np.ndarray
    run: np.ndarray
    twin: np.ndarray
    moving: np.ndarray
    behind: np.ndarray
    weight: np.ndarray


def compress(arrivals: Sequence[Arrival], stride: int, dtype) -> Streaming:
    """Turn element-wise sources into runs, single elements, blends and pushes, sorted by block."""
    nodes, block = len(arrivals[0].element), int(BLOCK)
    node = np.arange(nodes)
    # Where an even step leaves what goes in each direction; of twins one is in nobody's place.
    left = np.array(
        [
            np.where(arrivals[p].twin, q * stride + node, arrivals[p].element)
            for q, p in enumerate(OPPOSITE)
        ]
    )
    part, whole, taken, put, twin, push, blend = [], [], [], [], [], [], []
    for q, p in enumerate(OPPOSITE):
        arrival, at = arrivals[p], q * block + node % block
        own = arrival.run == arrival.element
        pieces, full, masks = _pieces(arrival.run, own)
        part.append((pieces // block, arrival.run[pieces], at[pieces], masks))
        whole.append((full // block, arrival.run[full], at[full]))
        odd = np.flatnonzero(~own)
        taken.append((odd // block, arrival.element[odd], at[odd]))
        put.append((odd // block, left[q, odd], at[odd]))
        odd = np.flatnonzero(arrival.twin)
        other = OPPOSITE[MIRRORED[p]]
        twin.append((odd // block, q * stride + odd, other * stride + odd))
        odd = np.flatnonzero(arrival.moving)
        push.append((arrival.element[odd], arrival.moving[odd]))
        odd = np.flatnonzero(arrival.behind >= 0)
        more, less = arrival.behind[odd], p * stride + odd
        later = (left[e // stride, e % stride] for e in (more, less))
        blend.append((arrival.element[odd], arrival.weight[odd], more, less, *later))

    def by_block(entries):
        columns = _joined(entries)
        order = np.argsort(columns[0], kind="stable")
        start = np.searchsorted(columns[0][order], np.arange(-(-nodes // block) + 1))
        return [start] + [c[order] for c in columns[1:]]

    tables = [c for kind in (part, whole, taken, put, twin) for c in by_block(kind)]
    tables += _joined(push) + _joined(blend)
    return Streaming(*(c.astype(dtype if c.dtype.kind == "f" else np.uint32) for c in tables))


def _joined(entries) -> list[np.ndarray]:
    """Columns of the entries of all directions."""
    return [np.concatenate(c) for c in zip(*entries, strict=True)]


def _pieces(run, own) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First nodes of PIECE elements and of LONG ones that copy what is consecutive in ``run``.

    With the masks of the former: which elements are the nodes' ``own``, as all of the latter are.
    """
    nodes, node = len(run), np.arange(len(run))
    start = np.flatnonzero((node % int(BLOCK) == 0) | (np.diff(run, prepend=-2) != 1))
    first, length = _cut(start, np.diff(np.append(start, nodes)), int(LONG))
    owned = np.concatenate([[0], np.cumsum(own)])
    full = owned[first + length] - owned[first] == int(LONG)
    pieces, length = _cut(first[~full], length[~full], int(PIECE))
    k = np.arange(int(PIECE))
    inside = own[np.minimum(pieces[:, None] + k, nodes - 1)] & (k < length[:, None])
    masks = inside @ (1 << k)
    return pieces[masks > 0], first[full], masks[masks > 0]


def _cut(start, length, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Starts and lengths of pieces of at most ``size`` of runs."""
    count = -(-length // size)
    rank = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    first = np.repeat(start, count) + size * rank
    return first, np.minimum(size, np.repeat(start + length, count) - first)


@restrict
def _take_runs(block, f, s, buf):
    """Fill the buffer (19 rows of BLOCK) but for single elements."""
    for e in range(s.part_start[block], s.part_start[block + ONE]):
        a, b = np.uint64(s.part_place[e]), np.uint64(s.part_at[e])
        for i in range(PIECE):
            buf[b + i] = f[a + i]
    for e in range(s.whole_start[block], s.whole_start[block + ONE]):
        a, b = np.uint64(s.whole_place[e]), np.uint64(s.whole_at[e])
        for i in range(LONG):
            buf[b + i] = f[a + i]


@jit
def take(block, f, s, buf):
    """Fill the buffer with what arrives in one block in an even step, by the direction opposite."""
    _take_runs(block, f, s, buf)
    for e in range(s.in_start[block], s.in_start[block + ONE]):
        buf[s.in_at[e]] = f[s.in_place[e]]


@jit
def take_back(block, f, s, buf):
    """Fill the buffer with what has left one block in an even step."""
    _take_runs(block, f, s, buf)
    for e in range(s.out_start[block], s.out_start[block + ONE]):
        buf[s.out_at[e]] = f[s.out_place[e]]


@restrict
def put(block, buf, s, f):
    """Write what leaves one block in an even step to where it arrives."""
    for e in range(s.part_start[block], s.part_start[block + ONE]):
        a, b = np.uint64(s.part_place[e]), np.uint64(s.part_at[e])
        copy_masked(f, a, buf, b, s.part_mask[e])
    for e in range(s.whole_start[block], s.whole_start[block + ONE]):
        a, b = np.uint64(s.whole_place[e]), np.uint64(s.whole_at[e])
        for i in range(LONG):
            f[a + i] = buf[b + i]
    for e in range(s.out_start[block], s.out_start[block + ONE]):
        f[s.out_place[e]] = buf[s.out_at[e]]


@jit
def double(block, f, s):
    """Copy what arrives twice in one block in an odd step."""
    for e in range(s.twin_start[block], s.twin_start[block + ONE]):
        f[s.twin_place[e]] = f[s.twin_other[e]]


@jit
def meet_walls(odd, f, s):
    """Add to what comes back from walls what their motion and the interpolation ask for."""
    for e in range(len(s.push_place)):
        f[s.push_place[e]] += s.push_addend[e]
    more = s.blend_odd_more if odd else s.blend_even_more
    less = s.blend_odd_less if odd else s.blend_even_less
    for e in range(len(s.blend_place)):
        f[s.blend_place[e]] += s.blend_weight[e] * (f[more[e]] - f[less[e]])
