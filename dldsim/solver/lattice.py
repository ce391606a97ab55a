"""Fluid columns of a scene: which nodes there are, and from where populations stream to them.

Everything here is in lattice units (spacing, time step and reference density are one). Nodes sit
at half-integer positions; a scene is prismatic, that is, constant along z, so that the lattice is
a list of fluid columns of ``nz`` nodes each. Bounce-back, shifted periodicity, plates, a plane of
symmetry and moving walls are all in the sources of the streaming table that is made here.
"""

from dataclasses import dataclass

import numpy as np

from dldsim.errors import DldsimError
from dldsim.solver.d3q19 import MIRRORED, OPPOSITE, VELOCITIES, WEIGHTS
from dldsim.solver.streaming import BLOCK, LONG, Arrival, Streaming, compress


@dataclass(frozen=True)
class Lattice:
    """Fluid columns of a prismatic scene.

    ``column`` (nx, ny) int32: index of the fluid column, -1 in solid. ``row_shift``: nodes by which
    the image of the domain at x + nx is displaced along y. ``walls``: no-slip plates at z = 0 and
    z = height, otherwise periodic along z. ``nz``: layers of nodes, all of the ``height`` or, below
    a plane of symmetry, half of them. ``stride``: elements from one row of populations to the
    next.
    """

    nx: int
    ny: int
    nz: int
    height: int
    row_shift: int
    walls: bool
    column: np.ndarray
    stride: int
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
    stride = row_length(len(ix) * nz)
    z = np.arange(nz)
    own = np.arange(len(ix))[:, None] * nz + z
    arrivals = []
    for q, (cx, cy, cz) in enumerate(VELOCITIES):
        source_column = column[neighbour((nx, ny), row_shift, ix, iy, -cx, -cy)]
        bounced = source_column < 0
        zs = z - cz
        opposite = OPPOSITE[q] * stride + own
        twin = np.zeros(own.shape, bool)
        moving = np.zeros(own.shape)
        run = q * stride + source_column[:, None] * nz + zs
        if walls:
            layer = held(zs, nz, height)
            inside = (layer >= 0) & (layer < nz)
            row = np.where(layer == zs, q, MIRRORED[q]) * stride
            element = np.where(inside, row + source_column[:, None] * nz + layer, opposite)
            # What comes down to a node on the mirror also goes up from below it.
            twin[:] = inside & (layer == z + cz) & (layer != zs)
            for plate, velocity in zip((0, nz - 1), wall_velocities, strict=True):
                if not inside[plate]:
                    moving[:, plate] = 6 * WEIGHTS[q] * cx * velocity
        else:
            element = q * stride + source_column[:, None] * nz + zs % nz
        element[bounced] = opposite[bounced]
        run[bounced] = opposite[bounced]
        twin[bounced] = False
        behind_element = np.full(own.shape, -1)
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
            behind_element = np.where(reachable, row + behind[:, None] * nz + zb, -1)
        values = element, run, twin, moving, behind_element, np.repeat(weight, nz)
        arrivals.append(Arrival(*(v.ravel() for v in values)))
    streaming = compress(arrivals, stride, dtype)
    return Lattice(nx, ny, nz, height, row_shift, walls, column, stride, streaming)


def row_length(nodes: int) -> int:
    """Elements of a row of populations or vectors: whole blocks, and room for copies beyond."""
    return -(-nodes // int(BLOCK)) * int(BLOCK) + int(LONG)
