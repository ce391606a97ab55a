"""One request on one surrogate: predictions, objective, constraints, and refusals."""

from functools import cached_property
from math import sqrt
from typing import Any

import numpy as np

from dldsim.analysis.surrogate import Surrogate
from dldsim.config.design_sections import DesignRequest
from dldsim.design.chip import Chip
from dldsim.errors import DldsimError
from dldsim.vocabulary import GEOMETRY

CELL_TYPES = tuple(f"{key}_{i}" for i in "12" for key in ("deformation_index", "stiffness_set")) + (
    "radius_1_um",
    "radius_2_um",
)
"""Settings that name the two cell types."""
EXCEEDED_BY = 0.9
"""Share of the Monte Carlo draws whose separation is larger than the robust one."""
COVERAGE = 0.9
"""Of the prediction intervals."""
NORMAL_HALF_WIDTH = 1.6449
"""Half-width of a normal distribution's interval of that coverage, in standard deviations."""
DECIMALS = 2
"""Of the lengths of a candidate, in µm: finer than any mask."""
TINY = 1e-9
"""Turns the strict P_g > P_r + d_safety into a constraint that may be zero [µm]."""
NONE_BETTER = 1e3
"""Stands for an infinite violation, which samplers cannot compare."""


class Task:
    """One request on one surrogate: predictions for both cell types over arrays of geometries."""

    def __init__(self, surrogate: Surrogate, request: DesignRequest, chip: Chip, seed: int):
        self.surrogate, self.request, self.chip, self.seed = surrogate, request, chip, seed
        self.cells = [
            (getattr(request, f"deformation_index_{i}"), getattr(request, f"radius_{i}_um"))
            for i in (1, 2)
        ]
        self.spreads = [getattr(request, f"deformation_index_std_{i}") or 0.0 for i in (1, 2)]
        self.radii = {radius for _, radius in self.cells}

    def angles(self, radius, gap, periodicity) -> tuple[np.ndarray, np.ndarray]:
        """Predicted angles [deg] of both cell types."""
        return tuple(self.surrogate.predict(radius, gap, periodicity, *cell) for cell in self.cells)

    def inside(self, radius, gap, periodicity) -> np.ndarray:
        """Whether the surrogate interpolates for each cell type, (2, n)."""
        return np.array(
            [self.surrogate.inside_domain(radius, gap, periodicity, *cell) for cell in self.cells]
        )

    def half_widths(self, radius, gap, periodicity) -> tuple[np.ndarray, np.ndarray]:
        """Half-widths [deg] of both prediction intervals, the wider side of each."""
        found = []
        for cell in self.cells:
            angle = self.surrogate.predict(radius, gap, periodicity, *cell)
            low, high = self.surrogate.predict_interval(radius, gap, periodicity, *cell)
            found.append(np.maximum(high - angle, angle - low))
        return tuple(found)

    @cached_property
    def draws(self) -> np.ndarray:
        """Quasi-random numbers (6, draws): offsets of P_r and P_g in tolerances, normal deviates of
        both deformation indices and of both prediction errors."""
        from scipy.stats import norm, qmc

        count = self.request.draws
        sequence = qmc.Sobol(6, rng=np.random.default_rng(self.seed))
        points = sequence.random_base2((count - 1).bit_length())[:count].T
        return np.vstack([2 * points[:2] - 1, norm.ppf(np.clip(points[2:], 1e-6, 1 - 1e-6))])

    def drawn(self, radius, gap, periodicity) -> np.ndarray:
        """Angles (2, n, draws) [deg] of n geometries with the spread of the cells, the fabrication
        tolerance, and the error of the prediction, as if normal and independent.

        Deformation indices drawn beyond the training data are taken at its edge.
        """
        off_radius, off_gap, *normal = self.draws
        radius, gap, periodicity = (
            np.asarray(v, float)[:, None] for v in (radius, gap, periodicity)
        )
        errors = self.half_widths(radius[:, 0], gap[:, 0], periodicity[:, 0])
        radius = np.maximum(radius + self.request.tolerance_um * off_radius, 1e-3)
        gap = np.maximum(gap + self.request.tolerance_um * off_gap, 1e-3)
        periodicity = np.broadcast_to(periodicity, radius.shape)
        angles = []
        for k, (index, cell) in enumerate(self.cells):
            drawn = np.clip(
                index + self.spreads[k] * normal[k], *self.surrogate.deformation_index_range
            )
            drawn = np.broadcast_to(drawn, radius.shape)
            angle = self.surrogate.predict(
                radius.ravel(), gap.ravel(), periodicity.ravel(), drawn.ravel(), cell
            ).reshape(radius.shape)
            angles.append(angle + errors[k][:, None] / NORMAL_HALF_WIDTH * normal[2 + k])
        return np.stack(angles)

    def robust(self, radius, gap, periodicity) -> tuple[np.ndarray, np.ndarray]:
        """Separation [deg] that EXCEEDED_BY of the draws exceed, the two cell types in the order
        for which that is larger, negative where the order is open; and what a search maximises.

        That is the same above zero. Below, where an array without any separation and without any
        uncertainty would be best, it is a share of the range that the draws span: least negative
        where the order is most certain.
        """
        first, second = self.drawn(radius, gap, periodicity)
        low, high = np.quantile(second - first, [1 - EXCEEDED_BY, EXCEEDED_BY], axis=1)
        robust = np.maximum(low, -high)
        return robust, np.where(robust > 0, robust, robust / np.maximum(high - low, TINY))

    def values(self, radius, gap, periodicity) -> dict[str, np.ndarray]:
        """Both angles, their separation [deg], and what is maximised (`value`)."""
        first, second = self.angles(radius, gap, periodicity)
        separation = np.abs(second - first)
        value = separation
        if self.request.objective == "robust":
            value = self.robust(radius, gap, periodicity)[1]
        return {
            "angle_1_deg": first,
            "angle_2_deg": second,
            "separation_deg": separation,
            "value": value,
        }

    def length_mm(self, angle_1_deg, angle_2_deg) -> np.ndarray:
        """Array length that parts the cell types by the wanted distance; infinite for none."""
        slopes = np.tan(np.radians(angle_2_deg)) - np.tan(np.radians(angle_1_deg))
        with np.errstate(divide="ignore"):
            return self.request.lateral_separation_um / np.abs(slopes) / 1e3

    def pressure_kPa(self, radius, gap, periodicity, length_mm) -> np.ndarray:
        assert self.chip.resistance is not None  # `check` and callers see to it
        drag = self.chip.resistance.drag_over_mu_U(radius, gap, periodicity)
        return self.chip.pressure_kPa(drag, 2 * np.asarray(radius) + gap, length_mm)

    def limits(self, radius, gap, periodicity) -> dict[str, np.ndarray]:
        """All constraints; above zero is violated. See `violations`."""
        found = violations(self.request, self.chip, radius, gap)
        most = self.request.pressure_max_kPa
        if most is not None:
            length = self.length_mm(*self.angles(radius, gap, periodicity))
            excess = self.pressure_kPa(radius, gap, periodicity, length) / most - 1
            found["pressure drop must stay below its limit"] = np.minimum(excess, NONE_BETTER)
        return found

    def outside(self, radius: float, gap: float, periodicity: int) -> float:
        """Distance outside the training geometries, of the cell type for which it is larger."""
        return max(
            self.surrogate.distance_outside(radius, gap, periodicity, cell) for cell in self.radii
        )

    def may_be_inside(self, radius, gap, periodicity) -> np.ndarray:
        """False where `outside` surely exceeds DOMAIN_TOLERANCE, (n,)."""
        return np.all(
            [self.surrogate.may_be_inside(radius, gap, periodicity, cell) for cell in self.radii],
            axis=0,
        )

    def grid(self, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """All combinations of so many P_r and P_g within the bounds with every N_p, (n,) each."""
        low, high = self.request.periodicity
        lengths = (
            np.unique(np.linspace(*bounds, steps).round(DECIMALS))
            for bounds in (self.request.pillar_radius_um, self.request.gap_um)
        )
        axes = (*lengths, np.arange(low, high + 1))
        return tuple(v.ravel() for v in np.meshgrid(*axes, indexing="ij"))


def squeezed_width_um(radius_um: float, deformation_index: float) -> float:
    """Narrowest width that a cell has been seen to take [µm].

    In the calibration's throat a cell of deformation index DI = (a − b)/(a + b) has axes a and b.
    If its projected area stays that of a disc of radius R, ab = (2R)², so that
    b = 2R √((1 − DI)/(1 + DI)). A gap narrower than b would need a larger deformation than the one
    measured; an undeformable cell needs 2R.
    """
    return 2 * radius_um * sqrt((1 - deformation_index) / (1 + deformation_index))


def violations(request: DesignRequest, chip: Chip, pillar_radius_um, gap_um) -> dict[str, Any]:
    """Geometric constraints; above zero is violated, by so many µm (aspect ratio: by so much)."""
    first, second = request.deformation_index_1, request.deformation_index_2
    assert first is not None and second is not None  # those of the stiffness sets are filled in
    width = max(
        squeezed_width_um(request.radius_1_um, first),
        squeezed_width_um(request.radius_2_um, second),
    )
    return {
        "gap must exceed pillar radius + safety distance": pillar_radius_um
        + chip.safety_distance_um
        + TINY
        - gap_um,
        "gap must pass the squeezed cells": width - gap_um,
        "pillars must not be too slender": chip.flow.height_um / (2 * pillar_radius_um)
        - request.pillar_aspect_ratio_max,
    }


def check(task: Task) -> None:
    """Refuse what cannot be answered. Raises DldsimError that names key and allowed range."""
    request, chip = task.request, task.chip
    low, high = task.surrogate.deformation_index_range
    name = f"design request {request.name}"
    for i, (index, _) in enumerate(task.cells, start=1):
        if index is None or not low <= index <= high:
            key, allowed = f"deformation_index_{i}", f"{low:.4g} to {high:.4g}"
            raise DldsimError(
                f"{name}: {key} = {index} is outside the training data of the surrogate, "
                f"{allowed}.",
                key=key,
                value=index,
                allowed=allowed,
                remedy="Choose one inside, or a campaign that reaches it.",
            )
    if task.cells[0] == task.cells[1]:
        index, radius = task.cells[0]
        raise DldsimError(
            f"{name}: both cell types have deformation index {index:g} and radius {radius:g} µm; "
            "no array separates equals.",
            key=CELL_TYPES,
            value=index,
            allowed="different cell types",
            remedy="Change one of them.",
        )
    # the widest gap beside the thinnest pillar that is not too slender meets every constraint if
    # anything does
    slender = chip.flow.height_um / (2 * request.pillar_aspect_ratio_max)
    thinnest = min(max(request.pillar_radius_um[0], slender), request.pillar_radius_um[1])
    widest = request.gap_um[1]
    broken = {
        text: value
        for text, value in violations(request, chip, thinnest, widest).items()
        if value > 0
    }
    if broken:
        texts = "; ".join(f"{text} (by {value:.3g})" for text, value in broken.items())
        raise DldsimError(
            f"{name}: no geometry within the bounds is feasible. Even at pillar_radius_um = "
            f"{thinnest:g} and gap_um = {widest:g}: {texts}.",
            key=("gap_um", "pillar_radius_um"),
            value=(request.gap_um, request.pillar_radius_um),
            allowed="bounds that hold a feasible geometry",
            remedy="Raise the upper bound of gap_um or widen the bounds of pillar_radius_um.",
        )
    if request.pressure_max_kPa is not None and chip.resistance is None:
        raise DldsimError(
            f"{name}: pressure_max_kPa = {request.pressure_max_kPa:g} needs the flows without a "
            "cell of the campaign (flows.parquet) to know the pressure drop, and "
            f"{chip.no_resistance}.",
            key="pressure_max_kPa",
            value=request.pressure_max_kPa,
            allowed="none, without these flows",
            remedy="Leave the limit out.",
        )


def fixed(request: DesignRequest) -> set[str]:
    """Parameters whose bounds leave one value."""
    return {name for name in GEOMETRY if np.ptp(getattr(request, name)) == 0}
