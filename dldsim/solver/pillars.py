"""The array of pillars on the lattice: spacing, solid columns, distance to the next pillar.

Lattice coordinates of a domain: rows along x, lanes along y, pillar (row i, lane j) centred at
(i λ + λ/2, i s + j λ + λ/2) with the pitch λ and the row shift s in nodes.
"""

from dataclasses import dataclass

import numpy as np

from dldsim.config.feasibility import check_array
from dldsim.config.sections import Flow, Geometry, Numerics
from dldsim.laws import whole_shift_spacing
from dldsim.solver.jit import jit
from dldsim.solver.lattice import Lattice, make_lattice

ON_SURFACE = 0.015
"""Columns that are no farther from a pillar, in nodes, count as solid if links are interpolated:
they feed staggered momentum as soon as a membrane comes near. Of runs with columns at 0.005 and
0.006 nodes from a pillar nearly all blew up, with links of at least 0.017 too; with columns at
0.017 and beyond none did."""


@dataclass(frozen=True)
class ArrayLattice:
    """Discrete unit cell: ``rows`` × ``lanes`` pillars; lengths in nodes unless named otherwise.

    ``height`` is that of the channel; the lattice may hold its lower half only.
    """

    spacing_um: float
    pitch: int
    row_shift: int
    radius: float
    rows: int
    lanes: int
    height: int
    lattice: Lattice

    @property
    def height_um(self) -> float:
        """Height on the lattice [µm], a whole number of nodes; 0 in the 2D limit."""
        return self.height * self.spacing_um if self.lattice.walls else 0.0


def next_finer(geometry: Geometry, numerics: Numerics) -> Numerics:
    """Numerics on the next finer lattice that the row shift allows, at half the numerical Re, with
    images farther off: what holds there as well rests on none of the campaign's.
    """
    shift_um = geometry.pitch_um / geometry.periodicity
    _, nodes = whole_shift_spacing(geometry, numerics.spacing_um)
    return numerics.model_copy(
        update={
            "spacing_um": shift_um / (nodes + 1),
            "reynolds_max": numerics.reynolds_max / 2,
            "rows": max(2, numerics.rows),
            "lanes": max(2, numerics.lanes),
            "images": "dilute",
        }
    )


def make_array(geometry: Geometry, flow: Flow, numerics: Numerics) -> ArrayLattice:
    """Lay the unit cell of an array on the lattice.

    Raises DldsimError as `feasibility.check_array` does.
    """
    check_array(geometry, flow, numerics)
    spacing, shift = whole_shift_spacing(geometry, numerics.spacing_um)
    pitch = shift * geometry.periodicity
    radius = geometry.pillar_radius_um / spacing
    walls = flow.height_um > 0
    height = max(1, round(flow.height_um / spacing))
    lattice = make_pillars(
        pitch,
        shift,
        radius,
        numerics.rows,
        numerics.lanes,
        height,
        walls=walls,
        half=walls and numerics.half_scene,
        staggered=numerics.staggered,
        bounce_back=numerics.bounce_back,
        precision=numerics.precision,
    )
    return ArrayLattice(
        spacing, pitch, shift, radius, numerics.rows, numerics.lanes, height, lattice
    )


def make_pillars(
    pitch: int,
    shift: int,
    radius: float,
    rows: int = 1,
    lanes: int = 1,
    height: int = 1,
    *,
    walls: bool = False,
    half: bool = False,
    staggered: bool = False,
    bounce_back: str = "interpolated",
    precision: str = "float64",
) -> Lattice:
    """Lattice of ``rows`` × ``lanes`` pillars, lengths in nodes; ``shift`` 0 is a square array.

    ``staggered``: along x the domain repeats half of the lanes aside.
    """
    x, y = np.meshgrid(np.arange(rows * pitch) + 0.5, np.arange(lanes * pitch) + 0.5, indexing="ij")
    dx, dy = offset_from_pillar(x, y, pitch, shift)
    surface = ON_SURFACE if bounce_back == "interpolated" else 0.0
    solid = dx**2 + dy**2 < (radius + surface) ** 2

    def link_fraction(ix, iy, cx, cy):
        """Distance from a fluid column to the pillar surface along (cx, cy), in links."""
        # The pillar that is hit is the one whose column is the neighbour.
        ox, oy = offset_from_pillar(ix + 0.5 + cx, iy + 0.5 + cy, pitch, shift)
        px, py = ox - cx, oy - cy
        a, b, c = cx**2 + cy**2, px * cx + py * cy, px**2 + py**2 - radius**2
        root = np.sqrt(np.maximum(b**2 - a * c, 0))  # 0: past a column that is on the surface
        return np.minimum((-b - root) / a, 1)

    return make_lattice(
        solid,
        height,
        walls=walls,
        half=half,
        row_shift=rows * shift + staggered * (lanes // 2) * pitch,
        link_fraction=link_fraction if bounce_back == "interpolated" else None,
        dtype=np.dtype(precision),
    )


def offset_from_pillar(x, y, pitch, shift):
    """Vector from the centre of the nearest pillar of the row at x to the point (arrays)."""
    row = np.floor(x / pitch)
    dx = x - (row + 0.5) * pitch
    dy = y - row * shift - 0.5 * pitch
    return dx, dy - pitch * np.round(dy / pitch)


@jit
def pillar_distance(x, y, pitch, shift, radius):
    """Distance from the nearest pillar's surface and the unit vector away from it (scalars)."""
    row = np.floor(x / pitch)
    dx = x - (row + 0.5) * pitch
    dy = y - row * shift - 0.5 * pitch
    dy -= pitch * np.floor(dy / pitch + 0.5)
    r = np.sqrt(dx * dx + dy * dy)
    if r == 0:
        return -radius, 1.0, 0.0
    return r - radius, dx / r, dy / r
