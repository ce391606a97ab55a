"""Streaming as a table of copies, and the kernels that follow it.

Populations are stored as deviations from the fluid at rest,
``f[q * stride + column * nz + k]``, which keeps single precision safe. For every node and direction
the table names the element of the populations after collision that arrives there, whether by
propagation, bounce-back, periodicity or row shift. Runs of consecutive elements are copied as a
whole into a small buffer, in which the collision runs without branches; elements that break a run
(at channel walls) are patched one by one.
"""

from typing import NamedTuple

import numpy as np

from dldsim.solver.jit import restrict

BLOCK = np.uint64(128)
"""Nodes that are collided together; what a block reads and writes fits the first-level cache."""
PIECE = np.uint64(16)
LONG = np.uint64(32)
"""Elements that are copied at once: loops of constant length need no remainder and no branch."""

ONE = np.uint64(1)


class Streaming(NamedTuple):
    """Where each population of the next step comes from; arrays are grouped by block.

    ``*_start``: first entry of each block, one entry more than there are blocks; ``*_source``: in
    the populations; ``*_target``: in the buffer. ``aside_*``: copies of PIECE elements into the
    last row of the populations, from where blocks read them, in order.
    ``short_*``, ``long_*``: copies of PIECE and LONG elements. Short ones come first and in order,
    since they may go on beyond the end of a run, where another is written later.
    ``patch_*``: single elements; ``blend_*``: elements to which the weighted difference of two
    sources is added (interpolated bounce-back); ``push_*``: what a moving wall adds.
    """

    aside_source: np.ndarray
    aside_target: np.ndarray
    short_start: np.ndarray
    short_source: np.ndarray
    short_target: np.ndarray
    long_start: np.ndarray
    long_source: np.ndarray
    long_target: np.ndarray
    patch_start: np.ndarray
    patch_source: np.ndarray
    patch_target: np.ndarray
    blend_start: np.ndarray
    blend_source: np.ndarray
    blend_less: np.ndarray
    blend_target: np.ndarray
    blend_weight: np.ndarray
    push_start: np.ndarray
    push_target: np.ndarray
    push_addend: np.ndarray


def compress(runs, exacts, blends, aside, nodes, dtype) -> Streaming:
    """Turn element-wise sources into pieces, patches, blends and pushes, sorted by block.

    Per direction: ``runs`` source if columns went on for ever, ``exacts`` (source, addend of a
    moving wall), ``blends`` (source behind or -1, own source, weight) of the interpolation added.
    ``aside``: sources of what is set aside.
    """
    block = int(BLOCK)
    node = np.arange(nodes)
    short, long, patch, blend, push = [], [], [], [], []
    for q in range(19):
        target = q * block + node % block
        first = (node % block == 0) | (np.diff(runs[q], prepend=-2) != 1)
        start = np.nonzero(first)[0]
        length = np.diff(np.append(start, nodes))
        whole = length // int(LONG)
        rest = -(-(length % int(LONG)) // int(PIECE))
        for pieces, size, begin, count in (
            (long, int(LONG), start, whole),
            (short, int(PIECE), start + whole * int(LONG), rest),
        ):
            rank = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
            at = np.repeat(begin, count) + size * rank
            pieces.append((at // block, runs[q][at], target[at]))

        exact, moving = exacts[q]
        odd = runs[q] != exact
        patch.append((node[odd] // block, exact[odd], target[odd]))
        odd = moving != 0
        push.append((node[odd] // block, target[odd], moving[odd]))
        behind, own, weight = blends[q]
        odd = behind >= 0
        blend.append((node[odd] // block, behind[odd], own[odd], target[odd], weight[odd]))

    blocks = -(-nodes // block)

    def by_block(entries):
        columns = [np.concatenate(c) for c in zip(*entries, strict=True)]
        order = np.argsort(columns[0], kind="stable")
        start = np.searchsorted(columns[0][order], np.arange(blocks + 1))
        columns = [start] + [c[order] for c in columns[1:]]
        return [c.astype(dtype if c.dtype.kind == "f" else np.uint32) for c in columns]

    source = np.concatenate(aside)
    start = np.nonzero(np.diff(source, prepend=-2) != 1)[0]
    count = -(-np.diff(np.append(start, len(source))) // int(PIECE))
    rank = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    target = np.repeat(start, count) + int(PIECE) * rank
    source = np.repeat(source[start], count) + int(PIECE) * rank
    kinds = short, long, patch, blend, push
    return Streaming(
        source.astype(np.uint32),
        target.astype(np.uint32),
        *(column for entries in kinds for column in by_block(entries)),
    )


@restrict
def gather(block, f, s, buf):
    """Fill the buffer (19 rows of BLOCK) with the populations that arrive in one block."""
    for e in range(s.short_start[block], s.short_start[block + ONE]):
        a, b = np.uint64(s.short_source[e]), np.uint64(s.short_target[e])
        for i in range(PIECE):
            buf[b + i] = f[a + i]
    for e in range(s.long_start[block], s.long_start[block + ONE]):
        a, b = np.uint64(s.long_source[e]), np.uint64(s.long_target[e])
        for i in range(LONG):
            buf[b + i] = f[a + i]
    for e in range(s.patch_start[block], s.patch_start[block + ONE]):
        buf[s.patch_target[e]] = f[s.patch_source[e]]
    for e in range(s.push_start[block], s.push_start[block + ONE]):
        buf[s.push_target[e]] += s.push_addend[e]
    for e in range(s.blend_start[block], s.blend_start[block + ONE]):
        more = s.blend_weight[e] * (f[s.blend_source[e]] - f[s.blend_less[e]])
        buf[s.blend_target[e]] += more


@restrict
def set_aside(f, last_row, s):
    """Copy what crosses the end of the domain, before it is overwritten."""
    for e in range(len(s.aside_source)):
        a, b = np.uint64(s.aside_source[e]), np.uint64(s.aside_target[e])
        for i in range(PIECE):
            last_row[b + i] = f[a + i]


@restrict
def put(buf, first, f_new):
    """Write the populations of the buffer to ``f_new`` from node ``first`` on."""
    stride = np.uint64(len(f_new)) // np.uint64(20)
    for q in range(np.uint64(19)):
        a, b = q * stride + first, q * BLOCK
        for i in range(BLOCK):
            f_new[a + i] = buf[b + i]
