"""Where a surrogate interpolates: the hull of the arrays that it learnt from, shape by shape."""

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from dldsim.analysis.features import CellInFlow, cells_of, described, ratios_of

DOMAIN_TOLERANCE = 0.02
"""How far outside what was learnt from still counts as inside, in units of its range."""
FLAT = 1e-6
"""Relative differences below it are rounding."""


class Domain:
    """Arrays, capillary numbers and channel heights learnt from, for cells of one shape.

    ``geometries`` (n, 3) holds (P_r/R, P_g/R, N_p); ``capillary_number`` and
    ``vertical_confinement`` (2R/height) least and largest value.
    """

    def __init__(
        self,
        geometries,
        capillary_number: tuple[float, float],
        vertical_confinement: tuple[float, float],
    ):
        self.geometries = np.asarray(geometries, float)
        self.capillary_number = tuple(capillary_number)
        self.vertical_confinement = tuple(vertical_confinement)

    @classmethod
    def of(cls, data: pd.DataFrame) -> "Domain":
        """The domain of learnable outcomes of one shape."""
        capillary, vertical = data["capillary_number"], cells_of(data).vertical_confinement
        return cls(
            np.unique(ratios_of(data), axis=0),
            (float(capillary.min()), float(capillary.max())),
            (float(vertical.min()), float(vertical.max())),
        )

    def state(self) -> dict[str, Any]:
        """All numbers of a domain, the keyword arguments that make it again."""
        return {
            "geometries": self.geometries.tolist(),
            "capillary_number": list(self.capillary_number),
            "vertical_confinement": list(self.vertical_confinement),
        }

    @cached_property
    def _facets(self) -> tuple[np.ndarray, np.ndarray]:
        """Normals (n, 3) and offsets (n,) of the facets of the hull of the geometries.

        `normal · point + offset` is the distance beyond a facet, largest component in units of the
        ranges. Geometries that lie in a plane or on a line have facets on both of its sides;
        parameters that never varied take no part.
        """
        from scipy.spatial import ConvexHull

        centre, span = self.geometries.mean(axis=0), np.ptp(self.geometries, axis=0)
        scale = np.where(self._fixed, np.inf, span)
        points = ((self.geometries - centre) / scale)[:, ~self._fixed]
        _, sizes, axes = np.linalg.svd(points, full_matrices=True)
        rank = int((sizes > FLAT).sum())
        along, across = axes[:rank], axes[rank:]
        inner = points @ along.T
        if rank > 1:
            hull = np.unique(ConvexHull(inner).equations.round(12), axis=0)
            normals, offsets = hull[:, :-1] @ along, hull[:, -1]
        else:
            normals = np.vstack([along, -along])
            offsets = np.concatenate([-inner.max(axis=0), inner.min(axis=0)])
        normals = np.vstack([normals, across, -across])
        offsets = np.append(offsets, np.zeros(2 * len(across)))
        length = np.abs(normals).sum(axis=1)
        full = np.zeros((len(normals), 3))
        full[:, ~self._fixed] = normals / length[:, None] / span[~self._fixed]
        return full, offsets / length - full @ centre

    @cached_property
    def _fixed(self) -> np.ndarray:
        """Which parameters never varied, (3,)."""
        most = np.abs(self.geometries).max(axis=0)
        return np.ptp(self.geometries, axis=0) < FLAT * most

    def distance_outside(self, pillar_radius_um, gap_um, periodicity, cell: CellInFlow):
        """How far arrays lie outside the hull of the geometries, shape (n,); 0 inside.

        In units of the range of (P_r/R, P_g/R, N_p), largest component, from the facet that is
        exceeded most. The hull tells what ranges do not: outcomes with gap = radius + 10 µm fill a
        plane, not a box. A parameter that never varied allows no distance at all: then infinity.
        """
        place = pillar_radius_um, gap_um, periodicity, cell.radius_um
        r, g, n, radius = np.broadcast_arrays(*(np.atleast_1d(np.asarray(v, float)) for v in place))
        points = np.column_stack([r / radius, g / radius, n])
        normals, offsets = self._facets
        beyond = (points @ normals.T + offsets).max(axis=1, initial=0.0)
        known = self.geometries[0, self._fixed]
        other = np.abs(points[:, self._fixed] - known) > FLAT * np.abs(known)
        return np.where(other.any(axis=1), np.inf, beyond)

    def holds(self, cell: CellInFlow) -> np.ndarray:
        """Whether capillary number and channel height were learnt, shape (n,)."""
        inside = True
        for value, (low, high) in (
            (np.log(cell.capillary_number), np.log(self.capillary_number)),
            (cell.vertical_confinement, self.vertical_confinement),
        ):
            slack = DOMAIN_TOLERANCE * (high - low) + FLAT
            inside = inside & (np.asarray(value) >= low - slack) & (value <= high + slack)
        return np.atleast_1d(inside)

    @property
    def height_to_radius(self) -> tuple[float, float]:
        """Least and largest channel height / R; infinite without top and bottom."""
        low, high = self.vertical_confinement
        return tuple(2 / v if v > 0 else np.inf for v in (high, low))

    @property
    def words(self) -> str:
        """Capillary numbers and heights, to be read."""
        heights = self.height_to_radius
        channel = "no top or bottom" if np.isinf(heights[0]) else f"height/R {described(heights)}"
        return f"Ca {described(self.capillary_number)}, {channel}"


def domains_of(data: pd.DataFrame) -> dict[str, Domain]:
    """The domain of each shape in learnable outcomes."""
    return {str(shape): Domain.of(part) for shape, part in data.groupby("cell_shape")}


def from_state(state: Mapping[str, Mapping[str, Any]]) -> dict[str, Domain]:
    """Domains by shape, from their numbers."""
    return {shape: Domain(**numbers) for shape, numbers in state.items()}


NAMES = {"biconcave": "biconcave discs", "sphere": "spheres", "ellipsoid": "ellipsoids"}


def learnt(state: Mapping[str, Mapping[str, Any]]) -> str:
    """Shapes with their capillary numbers and channel heights, in words."""
    known = from_state(state)
    return "; ".join(f"{NAMES[shape]} ({known[shape].words})" for shape in sorted(known))
