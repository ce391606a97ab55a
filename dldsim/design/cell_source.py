"""Where the cells of a population come from: its mean and scatter, or cells that were measured."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from dldsim.analysis.calibration import remedy_for_cell
from dldsim.config.design_sections import DesignRequest
from dldsim.design.deformability import default_assay, index_range, ks_of_index, radius_range
from dldsim.design.draws import Scatter, check_scatter
from dldsim.design.measured_cells import INDEX, Measured
from dldsim.design.populations import Population
from dldsim.errors import DldsimError

RADII, CURVE = 5, 33
"""Radii, and indices for each, at which the calibration is inverted."""
BEYOND_MAX = 0.2
"""Share of measured cells whose index or radius may lie beyond the calibration; they are taken at
its edge."""


class CellSource(NamedTuple):
    """Cells of one population.

    ``radius``: its scatter; ``ks_cv``: coefficient of variation of k_s, lognormal; without it k_s
    scatters as the population's interval says, one standard deviation of ln k_s to each side.
    ``measured``: cells whose radii, and spring constants ``measured_ks`` where they are known, take
    the place of the scatter.
    """

    population: Population
    radius: Scatter
    ks_cv: float | None = None
    measured: Measured | None = None
    measured_ks: np.ndarray | None = None
    notes: tuple[str, ...] = ()

    def draw(self, first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Radii [µm] and spring constants [µN/m] (n,) at two levels, 0 to 1."""
        if self.measured is None:
            return self.radius.quantile(first), self._stiffness(second)
        place = self.measured.place(first)
        radius = self.measured.radius_um[place]
        if self.measured_ks is None:
            return radius, self._stiffness(second)
        return radius, self.measured_ks[place]

    def _stiffness(self, level: np.ndarray) -> np.ndarray:
        from scipy.stats import norm

        ks = self.population.stiffness.ks_uN_per_m
        if self.ks_cv is not None:
            return Scatter(ks, self.ks_cv * ks, "lognormal").quantile(level)
        deviate = norm.ppf(np.clip(level, 1e-9, 1 - 1e-9))
        down, up = np.log(ks / self.population.ks_low), np.log(self.population.ks_high / ks)
        return ks * np.exp(np.where(deviate < 0, down, up) * deviate)

    def squeezed_um(self, radius_um: np.ndarray, ks_uN_per_m: np.ndarray) -> np.ndarray:
        """Narrowest width that cells are trusted to take, in proportion to their radii."""
        return self.population.width_um / self.population.radius_um * radius_um

    @property
    def width_99_um(self) -> float:
        """Narrowest width that all but one cell in a hundred are trusted to take."""
        return float(self.squeezed_um(np.array(self.radius_99_um), np.array(0.0)))

    @property
    def radius_99_um(self) -> float:
        """Radius that one cell in a hundred exceeds."""
        if self.measured is not None:
            return float(np.quantile(self.measured.radius_um, 0.99))
        return float(self.radius.quantile(np.array(0.99)))


def make_sources(
    request: DesignRequest,
    populations: Sequence[Population],
    calibration: pd.DataFrame | None = None,
    measured: tuple[Measured | None, Measured | None] = (None, None),
) -> tuple[CellSource, CellSource]:
    """Both cell types with their scatter; measured cells where they are given.

    Raises DldsimError for a scatter that makes radii negative, where cells were not measured, and
    for measured cells that the calibration does not reach.
    """
    found = []
    for i, (population, cells) in enumerate(zip(populations, measured, strict=True), start=1):
        cv = getattr(request, f"radius_cv_{i}")
        std = getattr(request, f"radius_std_{i}_um") or 0.0
        key = f"radius_std_{i}_um" if cv is None else f"radius_cv_{i}"
        std = std if cv is None else cv * population.radius_um
        radius = Scatter(population.radius_um, std, request.radius_distribution)
        if cells is None:
            check_scatter(radius, key, "µm")
        ks: np.ndarray | None = None
        notes: tuple[str, ...] = ()
        if cells is not None:
            ks, notes = _stiffness_of(cells, population.shape, request.assay, calibration)
        found.append(
            CellSource(population, radius, getattr(request, f"ks_cv_{i}"), cells, ks, notes)
        )
    return found[0], found[1]


def _stiffness_of(
    cells: Measured, shape: str, assay: str | None, calibration: pd.DataFrame | None
) -> tuple[np.ndarray | None, tuple[str, ...]]:
    """Spring constants of measured cells, None where only radii were measured, and notes.

    Each cell has the k_s of its index at its radius, or at the calibrated radius next to it: the
    calibration is inverted at RADII radii and CURVE indices, between which ln k_s is linear.
    """
    notes = tuple(f"{cells.source}: {note}" for note in cells.notes)
    if cells.deformation_index is None:
        return cells.ks_uN_per_m, notes
    index = cells.deformation_index
    least, most = radius_range(shape, calibration, assay)
    radius = np.clip(cells.radius_um, least, most)
    off_radius = radius != cells.radius_um
    nodes = np.unique(np.linspace(radius.min(), radius.max(), RADII))
    ranges = np.array([index_range(shape, float(r), calibration, assay) for r in nodes])
    low, high = (np.interp(radius, nodes, ends) for ends in ranges.T)
    off_index = (index < low) | (index > high)
    beyond = float((off_radius | off_index).mean())
    if beyond > BEYOND_MAX:
        allowed = f"{low.min():.4g} to {high.max():.4g}"
        radii = f"radii of {least:g} to {most:g} µm, " if off_radius.any() else ""
        raise DldsimError(
            f"{cells.source}: {beyond:.0%} of the measured cells are outside the calibration, "
            f"{radii}indices of {allowed} for cells of these radii.",
            key=(INDEX, cells.source),
            value=beyond,
            allowed=f"{radii}{allowed}, for at least {1 - BEYOND_MAX:.0%} of the cells",
            remedy=_measure(cells, shape, assay, calibration, off_radius)
            if off_radius.mean() > off_index.mean()
            else "Name the assay by which they were measured, or another sample.",
        )
    for what, off in (("indices", off_index), ("radii", off_radius)):
        if off.any():
            notes += (
                f"{cells.source}: {off.mean():.1%} of the {what} are beyond the calibration and "
                "taken at its edge",
            )
    curves = []
    for node, ends in zip(nodes, ranges, strict=True):
        first, last = np.clip([index.min(), index.max()], ends[0], ends[1])
        grid = np.linspace(first, last, CURVE)
        found = [
            ks_of_index(
                float(i),
                shape,
                float(node),
                calibration,
                0.0,
                assay,
                keys=(INDEX, "shape", "radius_um"),
            )
            for i in grid
        ]
        curves.append(np.interp(index, grid, np.log([one["ks_uN_per_m"] for one in found])))
    place = np.interp(radius, nodes, np.arange(len(nodes)))
    below = np.minimum(place.astype(int), max(len(nodes) - 2, 0))
    above = np.minimum(below + 1, len(nodes) - 1)
    part, at = place - below, np.arange(len(index))
    table = np.array(curves)
    return np.exp((1 - part) * table[below, at] + part * table[above, at]), notes


def _measure(
    cells: Measured,
    shape: str,
    assay: str | None,
    calibration: pd.DataFrame | None,
    off: np.ndarray,
) -> str:
    """How to measure an assay at the radii of cells that it is not calibrated for."""
    ends = np.unique([cells.radius_um[off].min(), cells.radius_um[off].max()])
    return remedy_for_cell(assay or default_assay(calibration), shape, *map(float, ends))
