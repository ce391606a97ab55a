"""Slow, obvious twins of the compiled lattice and coupling kernels."""

import itertools

import numpy as np

from dldsim.solver.d3q19 import VELOCITIES, WEIGHTS
from dldsim.solver.immersed_boundary import KERNELS, LINEAR, ROMA, TRAPEZOID


def opposite(q):
    return int(np.flatnonzero((VELOCITIES == -VELOCITIES[q]).all(axis=1))[0])


def wrap(ix, iy, nx, ny, row_shift):
    """The node of the domain of which (ix, iy) is an image."""
    while ix >= nx:
        ix, iy = ix - nx, iy - row_shift
    while ix < 0:
        ix, iy = ix + nx, iy + row_shift
    return ix, iy % ny


def collide(f, force, relaxation_time, collision, inertia):
    """Populations (19, n) and velocity (3, n) after collision, from those before; force (3, n).

    Two relaxation times with magic parameter 3/16 (Ginzburg et al. 2008) or BGK; force after Guo
    et al. (2002); u = j (He & Luo 1997) and, without inertia, no quadratic terms.
    """
    tau_minus = relaxation_time
    if collision == "trt":
        tau_minus = 0.5 + 3 / 16 / (relaxation_time - 0.5)
    u = VELOCITIES.T @ f + force / 2
    equilibrium, source = np.empty_like(f), np.empty_like(f)
    for q, (c, w) in enumerate(zip(VELOCITIES, WEIGHTS, strict=True)):
        cu, cF = c @ u, c @ force
        equilibrium[q] = w * (f.sum(axis=0) + 3 * cu)
        source[q] = w * 3 * cF
        if inertia:
            equilibrium[q] += w * (4.5 * cu**2 - 1.5 * (u * u).sum(axis=0))
            source[q] += w * (9 * cu * cF - 3 * (u * force).sum(axis=0))
    out = f.copy()
    for q in range(19):
        p = opposite(q)
        for sign, tau in ((1, relaxation_time), (-1, tau_minus)):
            away = (f - equilibrium)[[q, p]]
            push = source[[q, p]]
            out[q] -= (away[0] + sign * away[1]) / 2 / tau
            out[q] += (1 - 0.5 / tau) * (push[0] + sign * push[1]) / 2
    return out, u


def stream(f, column, nz, walls, row_shift, link_fraction=None):
    """Populations (19, columns, nz) that arrive from those after collision.

    Half-way bounce-back, or the central linear scheme (Ginzburg et al. 2008) with the wall at
    ``link_fraction`` of a link from the node, where the node behind is fluid.
    """
    nx, ny = column.shape
    out = np.empty_like(f)
    for ix, iy, k, q in itertools.product(range(nx), range(ny), range(nz), range(19)):
        own = column[ix, iy]
        if own < 0:
            continue
        cx, cy, cz = VELOCITIES[q]
        p = opposite(q)
        source = column[wrap(ix - cx, iy - cy, nx, ny, row_shift)]
        z = k - cz if walls else (k - cz) % nz
        if source >= 0 and 0 <= z < nz:
            out[q, own, k] = f[q, source, z]
            continue
        out[q, own, k] = f[p, own, k]
        if source >= 0 or link_fraction is None:
            continue  # a plate, or half-way
        behind = column[wrap(ix + cx, iy + cy, nx, ny, row_shift)]
        z = k + cz if walls else (k + cz) % nz
        if behind >= 0 and 0 <= z < nz:
            d = link_fraction(ix, iy, -cx, -cy)
            out[q, own, k] += (1 - 2 * d) / (1 + 2 * d) * (f[p, behind, z] - f[q, own, k])
    return out


def kernel(r, kind):
    """One-dimensional kernel: see dldsim.solver.immersed_boundary.kernel_weights."""
    r = abs(r)
    if kind == LINEAR:
        return max(1 - r, 0)
    if kind == TRAPEZOID:
        return (kernel(r - 0.5, LINEAR) + kernel(r + 0.5, LINEAR)) / 2
    if kind == ROMA:
        if r <= 0.5:
            return (1 + np.sqrt(1 - 3 * r**2)) / 3
        return (5 - 3 * r - np.sqrt(1 - 3 * (1 - r) ** 2)) / 6 if r < 1.5 else 0
    if r <= 1:
        return (3 - 2 * r + np.sqrt(1 + 4 * r - 4 * r**2)) / 8
    return (5 - 2 * r - np.sqrt(-7 + 12 * r - 4 * r**2)) / 8 if r < 2 else 0


def interpolate(field, position, name, column, walls, row_shift):
    """Vector at ``position`` (3,) of a field (3, columns, nz) that is zero in solids."""
    own_kind, across = KERNELS[name]
    nz = field.shape[-1]
    base = np.floor(position).astype(int)
    total = np.zeros(field.shape[:-2])
    for offset in itertools.product(range(-3, 4), repeat=3):
        node = base + offset
        own = column[wrap(node[0], node[1], *column.shape, row_shift)]
        z = node[2] if walls else node[2] % nz
        if own >= 0 and 0 <= z < nz:
            for d in range(3):
                kinds = [own_kind if axis == d else across for axis in range(3)]
                weights = map(kernel, position - node - 0.5, kinds)
                total[d] += np.prod(list(weights)) * field[d, own, z]
    return total
