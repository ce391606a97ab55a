"""Immersed-boundary coupling between membrane vertices and lattice: interpolation and spreading.

Lattice units. Vertices (V, 3) are unwrapped; the domain repeats along y, along x with a row shift,
and along z unless there are walls. Nodes in solids hold no fluid: their velocity is zero, and a
force spread to them goes to the solid.
"""

from typing import NamedTuple

import numpy as np

from dldsim.solver.jit import aligned_zeros, jit, restrict
from dldsim.solver.lattice import Lattice, held, neighbour
from dldsim.solver.streaming import BLOCK, ONE

FAR = 1 << 40
"""Beyond what a vertex can have moved, nodes."""
REACH = 4
"""Nodes of the widest kernel along one axis: how far the tables of a domain go beyond its ends."""


class Domain(NamedTuple):
    """Where lattice nodes are; see :class:`dldsim.solver.lattice.Lattice`.

    ``first`` ((nx + REACH) * width,): first node of a column, ``fluid``: whether it holds fluid, 1
    or 0; ``level`` (nz + 2 REACH): height of a node from REACH below the floor on, or of its image
    if it is beyond a mirror; ``between``: whether it is between plates, 1 or 0; ``upright``: the
    same for components along z, which a mirror reverses, 0 on it. ``width`` is ny + REACH;
    ``before`` (nx * ny + 1): nodes in the columns before the one at x * ny + y; ``split``: the
    mirror passes through the last layer.
    """

    nx: int
    ny: int
    nz: int
    row_shift: int
    walls: bool
    width: int
    first: np.ndarray
    fluid: np.ndarray
    level: np.ndarray
    between: np.ndarray
    upright: np.ndarray
    before: np.ndarray
    split: bool


def make_domain(lattice: Lattice, dtype=np.float64) -> Domain:
    """Tables of one scene; ``dtype``: precision of the fields."""
    nx, ny, nz = lattice.nx, lattice.ny, lattice.nz
    ix, iy = np.indices((nx + REACH, ny + REACH)).reshape(2, -1)
    column = lattice.column[neighbour((nx, ny), lattice.row_shift, ix, iy, 0, 0)]
    z = np.arange(-REACH, nz + REACH)
    layer = held(z, nz, lattice.height)
    between = (layer >= 0) & (layer < nz) | (not lattice.walls)
    sign = np.where(layer == z, 1.0, -1.0) * ~((z == nz - 1) & lattice.split)
    return Domain(
        nx,
        ny,
        nz,
        lattice.row_shift,
        lattice.walls,
        ny + REACH,
        (np.maximum(column, 0) * nz).astype(np.uint32),
        (column >= 0).astype(dtype),
        np.where(between, layer % nz, 0).astype(np.uint32),
        between.astype(dtype),
        (sign * between).astype(dtype),
        np.append(0, np.cumsum(lattice.column.ravel() >= 0) * nz).astype(np.uint32),
        lattice.split,
    )


class Stencil(NamedTuple):
    """Nodes around each vertex and their weights.

    Each component of a vector has its own nodes: along its own axis the kernel is ``own``, along
    the others ``across``; ``own_points``, ``across_points`` are as long as these kernels have
    points, which the compiler then knows. The nodes of a component are its columns times its
    levels: ``column``, ``column_weight`` (V, R), first node, for x, y and z in turn; ``level``,
    ``level_weight`` (V, Q), height above it, for x and y, then for z. Nodes in solids and beyond
    plates weigh nothing.

    Work space: ``axis_first`` (6, V) and ``axis_weight`` (6, 4, V) of the kernel across, then own,
    along x, y and z; ``place`` (5, V) in the tables of the domain: first column for x, y and z,
    first level for x and y, and for z.
    """

    column: np.ndarray
    column_weight: np.ndarray
    level: np.ndarray
    level_weight: np.ndarray
    own: int
    across: int
    own_points: tuple[int, ...]
    across_points: tuple[int, ...]
    axis_first: np.ndarray
    axis_weight: np.ndarray
    place: np.ndarray


LINEAR, TRAPEZOID, ROMA, PESKIN = range(4)
POINTS = 2, 3, 3, 4
KERNELS = {
    "compact": (TRAPEZOID, LINEAR),
    "linear": (LINEAR, LINEAR),
    "3-point": (ROMA, ROMA),
    "4-point": (PESKIN, PESKIN),
}
EVEN_ODD = "compact", "4-point"
"""Kernels that neither feed nor see staggered momentum, but for nodes that solids cut off.

Along the axis of each component their weights on even and on odd nodes are the same, one half
(Peskin 2002, section 6).
"""


def make_stencil(vertices: int, kernel: str, dtype=np.float64) -> Stencil:
    """Work space for one of KERNELS; ``dtype``: precision of the fields."""
    own, across = KERNELS[kernel]
    m, n = POINTS[own], POINTS[across]
    columns, levels = (vertices, 2 * m * n + n * n), (vertices, m + n)
    return Stencil(
        aligned_zeros(columns, np.uint32),
        aligned_zeros(columns, dtype),
        aligned_zeros(levels, np.uint32),
        aligned_zeros(levels, dtype),
        own,
        across,
        tuple(range(m)),
        tuple(range(n)),
        aligned_zeros((6, vertices)),
        aligned_zeros((6, 4, vertices), dtype),
        aligned_zeros((5, vertices), np.uint32),
    )


@restrict
def kernel_weights(x, axis, kind, k, first, weight):
    """First node of a kernel along an axis, and weights of its nodes, for every vertex.

    ``x`` (V, 3) positions; fills row k of ``first`` (…, V) and ``weight`` (…, 4, V). Node i sits
    at i + 1/2. LINEAR: hat of half width one. TRAPEZOID: the mean of two hats half a node to either
    side, the narrowest kernel that meets the even-odd condition and keeps the first moment. ROMA:
    Roma, Peskin & Berger (1999), eq. 22. PESKIN: Peskin (2002), eq. 6.27.
    """
    x = x.reshape(x.size)
    vertices = range(first.shape[1])
    if kind == LINEAR:
        for v in vertices:
            p = x[3 * v + axis] - 0.5
            first[k, v] = np.floor(p)
            t = p - np.floor(p)
            weight[k, 0, v] = 1.0 - t
            weight[k, 1, v] = t
    elif kind == TRAPEZOID:
        for v in vertices:
            p = x[3 * v + axis] - 0.5
            first[k, v] = np.floor(p + 0.5) - 1.0
            t = p - np.floor(p + 0.5)
            weight[k, 0, v] = 0.25 - 0.5 * t
            weight[k, 1, v] = 0.5
            weight[k, 2, v] = 0.25 + 0.5 * t
    elif kind == ROMA:
        for v in vertices:
            p = x[3 * v + axis] - 0.5
            first[k, v] = np.floor(p + 0.5) - 1.0
            t = p - np.floor(p + 0.5)
            inner = np.sqrt(1.0 - 3.0 * t * t)
            # Of the outer nodes at distance r = 1 ± t: (5 - 3 r - √(1 - 3 (1 - r)²))/6
            weight[k, 0, v] = (2.0 - 3.0 * t - inner) / 6.0
            weight[k, 1, v] = (1.0 + inner) / 3.0
            weight[k, 2, v] = (2.0 + 3.0 * t - inner) / 6.0
    else:
        for v in vertices:
            p = x[3 * v + axis] - 0.5
            first[k, v] = np.floor(p) - 1.0
            t = p - np.floor(p)
            # At distances t and 1 - t, and beyond them 1 + t and 2 - t, the root is the same.
            root = np.sqrt(1.0 + 4.0 * t - 4.0 * t * t)
            weight[k, 0, v] = (3.0 - 2.0 * t - root) / 8.0
            weight[k, 1, v] = (3.0 - 2.0 * t + root) / 8.0
            weight[k, 2, v] = (1.0 + 2.0 * t + root) / 8.0
            weight[k, 3, v] = (1.0 + 2.0 * t - root) / 8.0


@restrict
def _place(domain, stencil):
    """Bring the first nodes into the tables of the domain.

    Positions that are not finite end somewhere in them.
    """
    nx, ny, nz = np.float64(domain.nx), np.float64(domain.ny), np.float64(domain.nz)
    row_shift, width, walls = np.float64(domain.row_shift), np.float64(domain.width), domain.walls
    first, place = stencil.axis_first, stencil.place
    per_x, per_y, per_z = 1.0 / nx, 1.0 / ny, 1.0 / nz
    for v in range(place.shape[1]):
        # The nodes across are among those along the own axis, from the first or second on.
        ix, iy, iz = first[3, v], first[4, v], first[5, v]
        kx, ky, kz = first[0, v] - ix, first[1, v] - iy, first[2, v] - iz
        # Halfway between whole numbers rounding cannot take a node to the next period.
        wraps = np.floor((ix + 0.5) * per_x)
        ix -= wraps * nx
        iy -= wraps * row_shift
        iy -= np.floor((iy + 0.5) * per_y) * ny
        iz -= 0.0 if walls else np.floor((iz + 0.5) * per_z) * nz
        ix = ix if (ix >= 0.0) & (ix < nx) else 0.0
        iy = iy if (iy >= 0.0) & (iy < ny) else 0.0
        iz = REACH + (iz if (iz > -REACH) & (iz < nz) else np.float64(-REACH))
        kx, ky, kz = 1.0 * (kx == 1.0), 1.0 * (ky == 1.0), 1.0 * (kz == 1.0)
        place[0, v] = np.uint32(np.int64(ix * width + iy + ky))
        place[1, v] = np.uint32(np.int64((ix + kx) * width + iy))
        place[2, v] = np.uint32(np.int64((ix + kx) * width + iy + ky))
        place[3, v] = np.uint32(np.int64(iz + kz))
        place[4, v] = np.uint32(np.int64(iz))


@jit
def locate(x, domain, stencil):
    """Fill the stencil of every vertex."""
    for axis in range(3):
        for k, kind in ((axis, stencil.across), (axis + 3, stencil.own)):
            kernel_weights(x, axis, kind, k, stencil.axis_first, stencil.axis_weight)
    _place(domain, stencil)
    _multiply(domain, stencil)


@restrict
def _multiply(domain, stencil):
    """Columns and levels of every vertex, from the work space."""
    m, n = len(stencil.own_points), len(stencil.across_points)
    column, column_weight = stencil.column, stencil.column_weight
    level, level_weight = stencil.level, stencil.level_weight
    weight, place = stencil.axis_weight, stencil.place
    first, fluid, height = domain.first, domain.fluid, domain.level
    between, upright = domain.between, domain.upright
    width = np.uint64(domain.width)
    for v in range(column.shape[0]):
        r = 0
        for a in range(m):
            for b in range(n):
                i = place[0, v] + np.uint64(a) * width + np.uint64(b)
                column[v, r] = first[i]
                column_weight[v, r] = fluid[i] * weight[3, a, v] * weight[1, b, v]
                r += 1
        for a in range(n):
            for b in range(m):
                i = place[1, v] + np.uint64(a) * width + np.uint64(b)
                column[v, r] = first[i]
                column_weight[v, r] = fluid[i] * weight[0, a, v] * weight[4, b, v]
                r += 1
        for a in range(n):
            for b in range(n):
                i = place[2, v] + np.uint64(a) * width + np.uint64(b)
                column[v, r] = first[i]
                column_weight[v, r] = fluid[i] * weight[0, a, v] * weight[1, b, v]
                r += 1
        for q in range(n):
            i = place[3, v] + np.uint64(q)
            level[v, q] = height[i]
            level_weight[v, q] = between[i] * weight[2, q, v]
        for q in range(m):
            i = place[4, v] + np.uint64(q)
            level[v, n + q] = height[i]
            level_weight[v, n + q] = upright[i] * weight[5, q, v]


@restrict
def spread(force, stencil, field):
    """Add the vertex forces (V, 3) to the force density ``field`` (3 * stride,)."""
    stride = np.uint64(len(field)) // np.uint64(3)
    m, n = len(stencil.own_points), len(stencil.across_points)
    column, column_weight = stencil.column, stencil.column_weight
    level, level_weight = stencil.level, stencil.level_weight
    precision = column_weight.dtype.type
    for v in range(force.shape[0]):
        for d in range(2):
            f = precision(force[v, d])
            for r in range(d * m * n, (d + 1) * m * n):
                first, w = column[v, r] + np.uint64(d) * stride, column_weight[v, r] * f
                for q in range(n):
                    field[first + level[v, q]] += level_weight[v, q] * w
        f = precision(force[v, 2])
        for r in range(2 * m * n, 2 * m * n + n * n):
            first, w = column[v, r] + np.uint64(2) * stride, column_weight[v, r] * f
            for q in range(n, n + m):
                field[first + level[v, q]] += level_weight[v, q] * w


@restrict
def interpolate(velocity, force, ahead, stencil, vertex_velocity):
    """Velocity (V, 3) of the fluid at the vertices of the stencil, ``ahead`` steps after the
    present.

    ``velocity``, ``force`` (3 * stride,): fields of velocity and force density. The force changes
    the momentum by itself in one step.
    """
    stride = np.uint64(len(velocity)) // np.uint64(3)
    m, n = len(stencil.own_points), len(stencil.across_points)
    column, column_weight = stencil.column, stencil.column_weight
    level, level_weight = stencil.level, stencil.level_weight
    precision = column_weight.dtype.type
    ahead = precision(ahead)
    for v in range(column.shape[0]):
        for d in range(2):
            total = precision(0)
            for r in range(d * m * n, (d + 1) * m * n):
                first, w = column[v, r] + np.uint64(d) * stride, column_weight[v, r]
                for q in range(n):
                    i = first + level[v, q]
                    total += w * level_weight[v, q] * (velocity[i] + ahead * force[i])
            vertex_velocity[v, d] = total
        total = precision(0)
        for r in range(2 * m * n, 2 * m * n + n * n):
            first, w = column[v, r] + np.uint64(2) * stride, column_weight[v, r]
            for q in range(n, n + m):
                i = first + level[v, q]
                total += w * level_weight[v, q] * (velocity[i] + ahead * force[i])
        vertex_velocity[v, 2] = total


@restrict
def interpolate_both(velocity, force, stencil, vertex_velocity, vertex_force):
    """Velocity (V, 3) of the fluid and force density (V, 3) at the vertices of the stencil.

    The fields are those of `interpolate`, at the present.
    """
    stride = np.uint64(len(velocity)) // np.uint64(3)
    m, n = len(stencil.own_points), len(stencil.across_points)
    column, column_weight = stencil.column, stencil.column_weight
    level, level_weight = stencil.level, stencil.level_weight
    precision = column_weight.dtype.type
    for v in range(column.shape[0]):
        for d in range(2):
            speed, push = precision(0), precision(0)
            for r in range(d * m * n, (d + 1) * m * n):
                first, w = column[v, r] + np.uint64(d) * stride, column_weight[v, r]
                for q in range(n):
                    i, weight = first + level[v, q], w * level_weight[v, q]
                    speed += weight * velocity[i]
                    push += weight * force[i]
            vertex_velocity[v, d], vertex_force[v, d] = speed, push
        speed, push = precision(0), precision(0)
        for r in range(2 * m * n, 2 * m * n + n * n):
            first, w = column[v, r] + np.uint64(2) * stride, column_weight[v, r]
            for q in range(n, n + m):
                i, weight = first + level[v, q], w * level_weight[v, q]
                speed += weight * velocity[i]
                push += weight * force[i]
        vertex_velocity[v, 2], vertex_force[v, 2] = speed, push


@jit
def surround(domain, stencil, near):
    """Set ``near`` (blocks,) to 1 for blocks of fluid that hold nodes of the stencil, else to 0.

    Those of all columns in a box around the vertices, and of the column that stands for solid ones;
    all blocks where the box does not fit the domain.
    """
    x, y, points = stencil.axis_first[3], stencil.axis_first[4], len(stencil.own_points)
    left, right, bottom, top = FAR, -FAR, FAR, -FAR
    for v in range(len(x)):  # what is not finite is far away
        ix = np.int64(x[v] if abs(x[v]) < FAR else FAR)
        iy = np.int64(y[v] if abs(y[v]) < FAR else FAR)
        left, right = min(left, ix), max(right, ix)
        bottom, top = min(bottom, iy), max(top, iy)
    nx, ny, wide = domain.nx, domain.ny, top - bottom + points
    if max(right, top) == FAR or right - left + points > nx or wide > ny:
        near[:] = 1
        return
    near[:] = 0
    _mark(0, domain.nz, near)
    for ix in range(left, right + points):
        wraps = ix // nx
        row = (ix - wraps * nx) * ny
        first = (bottom - wraps * domain.row_shift) % ny
        beyond = max(first + wide - ny, 0)
        _mark(domain.before[row + first], domain.before[row + first + wide - beyond], near)
        _mark(domain.before[row], domain.before[row + beyond], near)


@jit
def _mark(start, stop, near):
    """Set the blocks of the nodes from ``start`` to before ``stop`` to 1."""
    if stop > start:
        for block in range(np.uint64(start) // BLOCK, (np.uint64(stop) - ONE) // BLOCK + ONE):
            near[block] = 1


@restrict
def clear(field, near):
    """Set the field (3 * stride,) to zero in the blocks that are near."""
    stride, zero = np.uint64(len(field)) // np.uint64(3), field.dtype.type(0)
    for block in range(np.uint64(len(near))):
        if near[block]:
            for d in range(np.uint64(3)):
                a = d * stride + block * BLOCK
                for i in range(BLOCK):
                    field[a + i] = zero


@jit
def add_images(field, domain, near):
    """Add what images beyond a mirror spread to a layer on it: as much as the vertices did.

    ``field`` is zero in the blocks that are not near.
    """
    if domain.split:
        stride, nz = np.uint64(len(field)) // np.uint64(3), np.uint64(domain.nz)
        nodes = np.uint64(domain.before[-1])
        for block in range(np.uint64(len(near))):
            if near[block]:
                start, stop = block * BLOCK, min((block + ONE) * BLOCK, nodes)
                for i in range(start + nz - ONE - start % nz, stop, nz):
                    for d in range(np.uint64(2)):
                        field[d * stride + i] += field[d * stride + i]
