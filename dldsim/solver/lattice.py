"""D3Q19 lattice-Boltzmann fluid on columns: collision, streaming, bounce-back, shifted periodicity.

Everything here is in lattice units (spacing, time step and reference density are one). Nodes sit
at half-integer positions; a scene is prismatic, that is, constant along z, so that the lattice is
a list of fluid columns of ``nz`` nodes each. Populations are stored as deviations from the fluid
at rest, ``f[q * stride + column * nz + k]``, which keeps single precision safe.

Streaming is a table. For every node and direction it names the element of the populations after
collision that arrives there, whether by propagation, bounce-back, periodicity or row shift. Runs
of consecutive elements are copied as a whole into a small buffer, in which the collision runs
without branches; elements that break a run (at channel walls) are patched one by one.

The populations of the next step overwrite those of this one (compressed grid, Pohl et al.,
Parallel Process. Lett. 13 (2003) 549): before and after are two windows on the same memory, apart
by as many nodes as a population travels in the list of nodes, and the list is walked forwards when
the new window lies before the old one, backwards on the way back. Half the memory and two thirds
of the traffic of two arrays. What crosses the end of the domain along x would come too late; it is
set aside before the step.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dldsim.errors import DldsimError
from dldsim.solver.jit import jit, restrict

# Opposite directions are neighbours: 1-2, 3-4, … 17-18.
VELOCITIES = np.array(
    [
        (0, 0, 0),
        (1, 0, 0),
        (-1, 0, 0),
        (0, 1, 0),
        (0, -1, 0),
        (0, 0, 1),
        (0, 0, -1),
        (1, 1, 0),
        (-1, -1, 0),
        (1, -1, 0),
        (-1, 1, 0),
        (1, 0, 1),
        (-1, 0, -1),
        (1, 0, -1),
        (-1, 0, 1),
        (0, 1, 1),
        (0, -1, -1),
        (0, 1, -1),
        (0, -1, 1),
    ]
)
WEIGHTS = np.array([1 / 3] + [1 / 18] * 6 + [1 / 36] * 12)
OPPOSITE = np.array([0] + [q + 1 if q % 2 else q - 1 for q in range(1, 19)])
MIRRORED = np.array([0, 1, 2, 3, 4, 6, 5, 7, 8, 9, 10, 13, 14, 11, 12, 17, 18, 15, 16])
"""Directions with the component along z reversed."""
MAGIC_PARAMETER = 3 / 16
"""Puts the wall of half-way bounce-back mid-link at any viscosity (Ginzburg et al. 2008)."""

BLOCK = np.uint64(128)
"""Nodes that are collided together; what a block reads and writes fits the first-level cache."""
PIECE = np.uint64(16)
LONG = np.uint64(32)
"""Elements that are copied at once: loops of constant length need no remainder and no branch."""

_ONE = np.uint64(1)


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


@dataclass(frozen=True)
class Lattice:
    """Fluid columns of a prismatic scene.

    ``column`` (nx, ny) int32: index of the fluid column, -1 in solid. ``row_shift``: nodes by which
    the image of the domain at x + nx is displaced along y. ``walls``: no-slip plates at z = 0 and
    z = height, otherwise periodic along z. ``nz``: layers of nodes, all of the ``height`` or, below
    a plane of symmetry, half of them. ``stride``: elements from one row of populations to the
    next; ``lead``: nodes between the windows before and after a step.
    """

    nx: int
    ny: int
    nz: int
    height: int
    row_shift: int
    walls: bool
    column: np.ndarray
    stride: int
    lead: int
    streaming: Streaming

    @property
    def columns(self) -> int:
        return int(self.column.max()) + 1

    @property
    def nodes(self) -> int:
        """Number of fluid nodes."""
        return self.columns * self.nz

    @property
    def cells(self) -> int:
        """Number of nodes of the whole box, solid ones included."""
        return self.nx * self.ny * self.nz

    @property
    def half(self) -> bool:
        """Whether there is a mirror at mid-height."""
        return self.nz < self.height

    @property
    def split(self) -> bool:
        """Whether the mirror passes through the last layer of nodes, not above it."""
        return self.half and self.height % 2 == 1

    @property
    def volume(self) -> float:
        """Of the box below the mirror, solid included, where a layer that it splits counts half."""
        return self.nx * self.ny * (self.nz - 0.5 * self.split)


def neighbour(lattice_shape, row_shift, ix, iy, cx, cy):
    """Column (ix, iy) + (cx, cy) under periodicity along y and shifted periodicity along x."""
    nx, ny = lattice_shape
    jx = ix + cx
    wraps = np.floor_divide(jx, nx)
    return jx - wraps * nx, np.mod(iy + cy - wraps * row_shift, ny)


def held(z: np.ndarray, nz: int, height: int) -> np.ndarray:
    """Layers that stand for those at z: beyond a mirror their images."""
    return np.where((z >= nz) & (nz < height), height - 1 - z, z)


def make_lattice(
    solid: np.ndarray,
    height: int,
    *,
    walls: bool,
    half: bool = False,
    row_shift: int = 0,
    link_fraction=None,
    wall_velocities=(0.0, 0.0),
    dtype=np.float32,
) -> Lattice:
    """Number the fluid columns and build the streaming table.

    ``solid`` (nx, ny) bool. ``half``: of the ``height`` between plates at rest only the lower half
    is kept, for flows symmetric about mid-height; at the mirror populations are reflected
    (specular reflection). ``link_fraction(ix, iy, cx, cy)``: distance of the surface from column
    centres along the link, in links (0 to 1), for interpolated bounce-back: the central linear
    scheme (CLI) of Ginzburg et al. (2008), whose wall does not move with viscosity. None gives
    half-way bounce-back, which CLI falls back to where the node behind is not fluid.
    ``wall_velocities``: velocity along x of the plates at z = 0 and z = height (Ladd 1994). Raises
    DldsimError if no fluid is left.
    """
    nx, ny = solid.shape
    nz = (height + 1) // 2 if half else height
    column = np.full((nx, ny), -1, np.int32)
    column[~solid] = np.arange(np.count_nonzero(~solid))
    ix, iy = np.nonzero(~solid)
    if not len(ix):
        raise DldsimError("The scene has no fluid: pillars or walls fill the whole lattice.")
    nodes = len(ix) * nz
    lead, stride = _windows(column, ix, iy, nz, row_shift)
    z = np.arange(nz)
    own = np.arange(len(ix))[:, None] * nz + z
    runs, exacts, blends, aside = [], [], [], []

    def set_aside(sources):
        """Elements of the last row that take the place of the sources."""
        start = 19 * stride + sum(map(len, aside))
        aside.append(sources.ravel())
        return start + np.arange(sources.size).reshape(sources.shape)

    for q, (cx, cy, cz) in enumerate(VELOCITIES):
        source_column = column[neighbour((nx, ny), row_shift, ix, iy, -cx, -cy)]
        bounced = source_column < 0
        zs = z - cz
        opposite = OPPOSITE[q] * stride + own
        if walls:
            layer = held(zs, nz, height)
            inside = (layer >= 0) & (layer < nz)
            row = np.where(layer == zs, q, MIRRORED[q]) * stride
            exact = np.where(inside, row + source_column[:, None] * nz + layer, opposite)
        else:
            exact = q * stride + source_column[:, None] * nz + zs % nz
        run = q * stride + source_column[:, None] * nz + zs  # as if every column went on forever
        moving = np.zeros(exact.shape)
        if walls:
            for plate, velocity in zip((0, nz - 1), wall_velocities, strict=True):
                if not inside[plate]:
                    moving[:, plate] = 6 * WEIGHTS[q] * cx * velocity
        across = (ix - cx < 0) | (ix - cx >= nx)
        wrapped = across[:, None] & (run != exact) & (exact != opposite)
        saved = set_aside(run[across])
        exact[wrapped] = set_aside(exact[wrapped])
        exact[across] = np.where(exact[across] == run[across], saved, exact[across])
        run[across] = saved
        exact[bounced] = opposite[bounced]
        run[bounced] = opposite[bounced]
        behind_element = np.full(run.shape, -1)
        weight = np.zeros(len(ix))
        if link_fraction is not None and bounced.any():
            fraction = link_fraction(ix[bounced], iy[bounced], -cx, -cy)
            weight[bounced] = (1 - 2 * fraction) / (1 + 2 * fraction)
            behind = column[neighbour((nx, ny), row_shift, ix, iy, cx, cy)]
            zb = z + cz
            reachable = (bounced & (behind >= 0))[:, None]
            row = OPPOSITE[q] * stride
            if walls:
                layer = held(zb, nz, height)
                reachable = reachable & (layer >= 0) & (layer < nz)
                row = np.where(layer == zb, OPPOSITE[q], MIRRORED[OPPOSITE[q]]) * stride
                zb = layer
            else:
                zb = zb % nz
            element = row + behind[:, None] * nz + zb
            behind_element = np.where(reachable, element, -1)
            across = ((ix + cx < 0) | (ix + cx >= nx))[:, None] & (behind_element >= 0)
            behind_element[across] = set_aside(behind_element[across])
        runs.append(run.ravel())
        exacts.append((exact.ravel(), moving.ravel()))
        blends.append((behind_element.ravel(), q * stride + own.ravel(), np.repeat(weight, nz)))
    streaming = _compress(runs, exacts, blends, aside, nodes, dtype)
    return Lattice(nx, ny, nz, height, row_shift, walls, column, stride, lead, streaming)


def _windows(column, ix, iy, nz, row_shift) -> tuple[int, int]:
    """How far apart the windows before and after a step are, and the length of a row."""
    nx, ny = column.shape
    farthest = crossing = 0
    for cx, cy in np.unique(VELOCITIES[:, :2], axis=0):
        source = column[neighbour((nx, ny), row_shift, ix, iy, -cx, -cy)]
        across = (ix - cx < 0) | (ix - cx >= nx)
        distance = np.where(across | (source < 0), 0, abs(source - column[ix, iy]))
        farthest = max(farthest, distance.max())
        crossing = max(crossing, np.count_nonzero(across))
    lead = _whole((farthest + 1) * nz, PIECE)
    # Five directions each way, their copies across the ends along z, and blends.
    room = max(_whole(len(ix) * nz, BLOCK) + lead, 3 * 10 * crossing * nz)
    return lead, _whole(room + int(LONG), PIECE)


def _whole(number: int, unit) -> int:
    """The number, raised to a multiple of the unit."""
    return -(-int(number) // int(unit)) * int(unit)


def _compress(runs, exacts, blends, aside, nodes, dtype) -> Streaming:
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
def _gather(block, f, s, buf):
    """Fill the buffer (19 rows of BLOCK) with the populations that arrive in one block."""
    for e in range(s.short_start[block], s.short_start[block + _ONE]):
        a, b = np.uint64(s.short_source[e]), np.uint64(s.short_target[e])
        for i in range(PIECE):
            buf[b + i] = f[a + i]
    for e in range(s.long_start[block], s.long_start[block + _ONE]):
        a, b = np.uint64(s.long_source[e]), np.uint64(s.long_target[e])
        for i in range(LONG):
            buf[b + i] = f[a + i]
    for e in range(s.patch_start[block], s.patch_start[block + _ONE]):
        buf[s.patch_target[e]] = f[s.patch_source[e]]
    for e in range(s.push_start[block], s.push_start[block + _ONE]):
        buf[s.push_target[e]] += s.push_addend[e]
    for e in range(s.blend_start[block], s.blend_start[block + _ONE]):
        more = s.blend_weight[e] * (f[s.blend_source[e]] - f[s.blend_less[e]])
        buf[s.blend_target[e]] += more


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
def _collide(buf, force, velocity, at, to, parameters, inertia):
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


class Scheme(NamedTuple):
    """How one fluid goes on: see :class:`Streaming` and `_collide`.

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


@restrict
def _set_aside(f, last_row, s):
    """Copy what crosses the end of the domain, before it is overwritten."""
    for e in range(len(s.aside_source)):
        a, b = np.uint64(s.aside_source[e]), np.uint64(s.aside_target[e])
        for i in range(PIECE):
            last_row[b + i] = f[a + i]


@restrict
def _put(buf, first, f_new):
    """Write the populations of the buffer to ``f_new`` from node ``first`` on."""
    stride = np.uint64(len(f_new)) // np.uint64(20)
    for q in range(np.uint64(19)):
        a, b = q * stride + first, q * BLOCK
        for i in range(BLOCK):
            f_new[a + i] = buf[b + i]


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
    _set_aside(f[:end], f[end:], streaming)
    blocks = np.uint64(len(streaming.patch_start)) - _ONE
    backwards = f.ctypes.data < f_new.ctypes.data
    for count in range(blocks):
        block = blocks - _ONE - count if backwards else count
        _gather(block, f, streaming, buf)
        first = block * BLOCK
        _collide(buf, forces, velocities, first * forced, first * asked, parameters, inertia)
        _put(buf, first, f_new)


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
