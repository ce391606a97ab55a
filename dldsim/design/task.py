"""One request on one surrogate: predictions, objective, constraints, and refusals."""

import math
from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from dldsim.analysis.domain import DOMAIN_TOLERANCE, NAMES
from dldsim.analysis.features import CellInFlow
from dldsim.analysis.surrogate import LEVEL, Surrogate
from dldsim.config.design_sections import DEFORMABILITIES, DesignRequest, is_given
from dldsim.config.feasibility import check_tolerance
from dldsim.design.cell_source import CellSource, make_sources
from dldsim.design.chip import Chip
from dldsim.design.draws import sobol
from dldsim.design.motion import UNKNOWN, History, height_not_learnt
from dldsim.design.outlet_task import NARROW, SHORT, OutletTask
from dldsim.design.outlet_task import OBJECTIVE as OUTLETS
from dldsim.design.populations import Population
from dldsim.errors import DldsimError
from dldsim.vocabulary import GEOMETRY

CELL_TYPES = tuple(
    key.format(i) for key in (*DEFORMABILITIES, "shape_{}", "radius_{}_um") for i in "12"
)
"""Settings that name the two cell types."""
DEFORMED = 5
"""Values of Ca over the interval of a cell type at which its interval of angles is looked up."""
EXCEEDED_BY = 0.9
"""Share of the Monte Carlo draws whose separation is larger than the robust one."""
COVERAGE = 0.9
"""Of the prediction intervals."""
NORMAL_HALF_WIDTH = 1.6449
"""Half-width of a normal distribution's interval of that coverage, in standard deviations."""
OUTLETS_CHECKED = 300
"""Arrays whose outlets are looked at, of a whole grid."""
DECIMALS = 2
"""Of the lengths of a candidate, in µm: finer than any mask."""
TINY = 1e-9
"""Turns the strict P_g > P_r + d_safety into a constraint that may be zero [µm]."""
NONE_BETTER = 1e3
"""Stands for an infinite violation, which samplers cannot compare."""
CLOSE = "gap must exceed pillar radius + safety distance"
TIGHT = "gap must pass the squeezed cells"
SLENDER = "pillars must not be too slender"
PRESSED = "pressure drop must stay below its limit"
MENDS = {
    CLOSE: (
        ("gap_um", "pillar_radius_um"),
        "raise the upper bound of gap_um or lower the lower one of pillar_radius_um",
    ),
    TIGHT: (("gap_um",), "raise the upper bound of gap_um"),
    SLENDER: (
        ("pillar_aspect_ratio_max", "pillar_radius_um"),
        "raise pillar_aspect_ratio_max or the upper bound of pillar_radius_um, or lower height_um",
    ),
    PRESSED: (
        ("pressure_max_kPa",),
        "raise pressure_max_kPa or the upper bound of gap_um, or lower velocity_mm_s",
    ),
    NARROW: (
        ("gap_um", "pillar_radius_um"),
        "widen device.array_width_mm or lower the lower bounds of gap_um and pillar_radius_um",
    ),
}
"""Settings that violate each constraint, and how to meet it."""


class Task:
    """One request on one surrogate: predictions for both cell types over arrays of geometries.

    ``sources``: where their cells come from, by default as the request says; ``history``: what
    outcomes say of their transients; ``outlets``: the same request at its outlets, where that has
    draws of its own. A gap must pass all but one cell in a hundred.
    """

    def __init__(
        self,
        surrogate: Surrogate,
        request: DesignRequest,
        populations: Sequence[Population],
        chip: Chip,
        seed: int,
        sources: Sequence[CellSource] | None = None,
        history: Sequence[History] = (UNKNOWN, UNKNOWN),
        outlets: OutletTask | None = None,
    ):
        self.surrogate, self.request, self.chip, self.seed = surrogate, request, chip, seed
        self.sources = make_sources(request, populations) if sources is None else sources
        self.populations = [
            p._replace(width_um=s.width_99_um)
            for p, s in zip(populations, self.sources, strict=True)
        ]
        self.cells = [population.cell for population in populations]
        self.outlets = outlets or OutletTask(surrogate, request, self.sources, history, chip, seed)

    def angles(self, radius, gap, periodicity) -> tuple[np.ndarray, np.ndarray]:
        """Predicted angles [deg] of both cell types."""
        first, second = (
            self.surrogate.predict(radius, gap, periodicity, cell) for cell in self.cells
        )
        return first, second

    def half_widths(self, radius, gap, periodicity) -> tuple[np.ndarray, np.ndarray]:
        """Half-widths [deg] of both prediction intervals, the wider side of each."""
        found = []
        for cell in self.cells:
            angle = self.surrogate.predict(radius, gap, periodicity, cell)
            low, high = self.surrogate.predict_interval(radius, gap, periodicity, cell)
            found.append(np.maximum(high - angle, angle - low))
        first, second = found
        return first, second

    def inside(self, radius, gap, periodicity) -> np.ndarray:
        """Whether the surrogate interpolates for each cell type, (2, n)."""
        return np.array(
            [self.surrogate.inside_domain(radius, gap, periodicity, cell) for cell in self.cells]
        )

    def intervals(self, radius, gap, periodicity) -> list[tuple[np.ndarray, np.ndarray]]:
        """`angle_interval` of both cell types."""
        return [
            angle_interval(self.surrogate, population, radius, gap, periodicity)
            for population in self.populations
        ]

    def known(self, k: int) -> tuple[float, float]:
        """Range of ln Ca that was learnt of a cell type's shape."""
        low, high = self.surrogate.domains[self.cells[k].shape].capillary_number
        return float(np.log(low)), float(np.log(high))

    @cached_property
    def draws(self) -> np.ndarray:
        """Quasi-random numbers (8, draws): offsets of P_r and P_g in tolerances, levels 0 to 1 of
        both stiffnesses, normal deviates of both prediction errors, levels of both radii."""
        from scipy.stats import norm

        points = sobol(self.request.angle_draws, 8, self.seed)
        normal = norm.ppf(np.clip(points[4:6], 1e-6, 1 - 1e-6))
        return np.vstack([2 * points[:2] - 1, points[2:4], normal, points[6:]])

    def drawn_cell(self, k: int) -> CellInFlow:
        """Cells of a type in the draws, (draws,); capillary numbers within what was learnt."""
        population = self.populations[k]
        radius, ks = self.sources[k].draw(self.draws[6 + k], self.draws[2 + k])
        capillary = np.clip(population.capillary(ks), *np.exp(self.known(k)))
        return population.cell_at(capillary)._replace(radius_um=radius)

    def drawn(self, radius, gap, periodicity) -> np.ndarray:
        """Angles (2, n, draws) [deg] of n geometries with the spread of the cells, the fabrication
        tolerance, and the error of the prediction, as if normal and independent.

        Capillary numbers drawn beyond the training data are taken at its edge.
        """
        off_radius, off_gap, *_ = self.draws
        normal = self.draws[4:6]
        radius, gap, periodicity = (
            np.asarray(v, float)[:, None] for v in (radius, gap, periodicity)
        )
        errors = self.half_widths(radius[:, 0], gap[:, 0], periodicity[:, 0])
        radius = radius + self.request.tolerance_um * off_radius
        gap = gap + self.request.tolerance_um * off_gap
        periodicity = np.broadcast_to(periodicity, radius.shape)
        angles = []
        for k in range(len(self.populations)):
            cell = self.drawn_cell(k)
            size, capillary = (
                np.broadcast_to(v, radius.shape).ravel()
                for v in (cell.radius_um, cell.capillary_number)
            )
            angle = self.surrogate.predict(
                radius.ravel(),
                gap.ravel(),
                periodicity.ravel(),
                cell._replace(radius_um=size, capillary_number=capillary),
            ).reshape(radius.shape)
            angles.append(angle + errors[k][:, None] / NORMAL_HALF_WIDTH * normal[k])
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
        """Both angles, their separation [deg], and what is maximised (`value`).

        Outlets take time: of many arrays those OUTLETS_CHECKED of the largest separation have a
        value.
        """
        first, second = self.angles(radius, gap, periodicity)
        separation = np.abs(second - first)
        value = separation
        if self.request.objective == "robust":
            value = self.robust(radius, gap, periodicity)[1]
        if self.request.objective == OUTLETS:
            value = np.full(len(separation), np.nan)
            best = np.argsort(-separation, kind="stable")[:OUTLETS_CHECKED]
            place = (np.asarray(v)[best] for v in (radius, gap, periodicity))
            value[best] = self.outlets.score(*place)
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
        found = violations(self.request, self.populations, self.chip, radius, gap)
        most = self.request.pressure_max_kPa
        if self.request.objective == OUTLETS:
            found |= self.outlets.limits(radius, gap, periodicity)
        elif most is not None:
            length = self.length_mm(*self.angles(radius, gap, periodicity))
            excess = self.pressure_kPa(radius, gap, periodicity, length) / most - 1
            found[PRESSED] = np.minimum(excess, NONE_BETTER)
        return found

    def outside(self, radius, gap, periodicity) -> np.ndarray:
        """Distance outside the training geometries, of the cell type for which it is larger."""
        return np.max(
            [self.surrogate.distance_outside(radius, gap, periodicity, c) for c in self.cells],
            axis=0,
        )

    def grid(self, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """All combinations of so many P_r and P_g within the bounds with every N_p, (n,) each."""
        low, high = self.request.periodicity
        lengths = (
            np.unique(np.linspace(*bounds, steps).round(DECIMALS).clip(*bounds))
            for bounds in (self.request.pillar_radius_um, self.request.gap_um)
        )
        axes = (*lengths, np.arange(low, high + 1))
        return tuple(v.ravel() for v in np.meshgrid(*axes, indexing="ij"))


def angle_interval(
    surrogate: Surrogate,
    population: Population,
    pillar_radius_um,
    gap_um,
    periodicity,
    level: float = LEVEL,
) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest angle [deg] of a cell type, (n,) each: the ends of its prediction intervals
    anywhere between the ends of its interval of Ca, as far as that was learnt."""
    low, high = (population.capillary(ks) for ks in (population.ks_high, population.ks_low))
    least, largest = surrogate.domains[population.shape].capillary_number
    found = [
        surrogate.predict_interval(
            pillar_radius_um, gap_um, periodicity, population.cell_at(capillary), level
        )
        for capillary in np.unique(np.clip(np.geomspace(low, high, DEFORMED), least, largest))
    ]
    lows, highs = zip(*found, strict=True)
    return np.min(lows, axis=0), np.max(highs, axis=0)


def violations(
    request: DesignRequest, populations: Sequence[Population], chip: Chip, pillar_radius_um, gap_um
) -> dict[str, Any]:
    """Geometric constraints; above zero is violated, by so many µm (aspect ratio: by so much)."""
    return {
        CLOSE: pillar_radius_um + chip.safety_distance_um + TINY - gap_um,
        TIGHT: max(p.width_um for p in populations) - gap_um,
        SLENDER: chip.flow.height_um / (2 * pillar_radius_um) - request.pillar_aspect_ratio_max,
    }


def extrapolated(task: Task) -> list[str]:
    """Cell types whose channel height over radius was not learnt, in words."""
    found = (height_not_learnt(task.surrogate, population) for population in task.populations)
    return [words for words in found if words is not None]


def check_cell(name: str, population: Population, surrogate: Surrogate) -> None:
    """Refuse a cell type of a shape or a capillary number that was not learnt.

    Raises DldsimError that names the field, and what was learnt.
    """
    shape, i = population.shape, population.number
    if shape not in surrogate.domains:
        known = ", ".join(sorted(surrogate.domains))
        raise DldsimError(
            f"{name}: {population.shape_key} = {shape} was not learnt (learnt: {known}).",
            key=population.shape_key,
            value=shape,
            allowed=known,
            remedy="Choose one of these."
            if surrogate.card["data"]["survey"] is not None
            else "Choose one of these, or learn from the survey (surrogate.survey: true).",
        )
    low, high = surrogate.domains[shape].capillary_number
    capillary, slack = population.capillary_number, (high / low) ** DOMAIN_TOLERANCE * (1 + 1e-6)
    least, most = low / slack, high * slack  # as much beyond as counts as inside
    if not least <= capillary <= most:
        ks, flow = population.stiffness.ks_uN_per_m, population.flow
        each = capillary / flow.mean_velocity_mm_s
        raise DldsimError(
            f"{name}: cell type {i} ({shape}, k_s {ks:.4g} µN/m) at {flow.mean_velocity_mm_s:g} "
            f"mm/s has Ca = μU/k_s = {capillary:.3g}; learnt of {NAMES[shape]}: {low:.3g} to "
            f"{high:.3g}.",
            key=(population.key, "velocity_mm_s"),
            value=capillary,
            allowed=f"Ca {inwards(least, up=True)} to {inwards(most)}",
            remedy="At this stiffness, velocities of "
            f"{inwards(least / each, up=True)} to {inwards(most / each)} mm/s are answered"
            + (", and rigid cells" if shape == "sphere" else "")
            + ".",
        )


def inwards(bound: float, up: bool = False) -> str:
    """A bound in three digits that does not lie beyond it."""
    shift = 10.0 ** (2 - math.floor(math.log10(bound)))
    rounded = (math.ceil if up else math.floor)(bound * shift) / shift
    return f"{rounded:.3g}"


def check_cells(
    name: str, request: DesignRequest, populations: Sequence[Population], surrogate: Surrogate
) -> None:
    """Refuse cell types that were not learnt, and equal ones. Raises DldsimError."""
    for population in populations:
        check_cell(name, population, surrogate)
    first, second = populations
    if first.cell == second.cell:
        raise DldsimError(
            f"{name}: both cell types are {NAMES[first.shape]} with k_s "
            f"{first.stiffness.ks_uN_per_m:.4g} µN/m and radius {first.radius_um:g} µm; no array "
            "separates equals.",
            key=[key for key in CELL_TYPES if is_given(getattr(request, key))],
            value=first.stiffness.ks_uN_per_m,
            allowed="different cell types",
            remedy="Change one of them.",
        )


def check(task: Task) -> None:
    """Refuse what cannot be answered. Raises DldsimError that names key and allowed range."""
    request, chip = task.request, task.chip
    name = f"design request {request.name}"
    check_cells(name, request, task.populations, task.surrogate)
    task.outlets.check()
    # the widest gap beside the thinnest pillar that is not too slender meets every constraint if
    # anything does
    slender = chip.flow.height_um / (2 * request.pillar_aspect_ratio_max)
    thinnest = min(max(request.pillar_radius_um[0], slender), request.pillar_radius_um[1])
    widest = request.gap_um[1]
    broken = {
        text: value
        for text, value in violations(request, task.populations, chip, thinnest, widest).items()
        if value > 0
    }
    if broken:
        texts = "; ".join(f"{text} (by {value:.3g})" for text, value in broken.items())
        raise DldsimError(
            f"{name}: no geometry within the bounds is feasible. Even at pillar_radius_um = "
            f"{thinnest:g} and gap_um = {widest:g}: {texts}.",
            key=(keys := mend(broken, request)[0]),
            value=tuple(getattr(request, key) for key in keys),
            allowed="bounds that hold a feasible geometry",
            remedy=mend(broken, request)[1],
        )
    low = chip.flow.height_um - request.height_tolerance_um
    width = max(population.width_um for population in task.populations)
    if low < width:
        raise DldsimError(
            f"{name}: with height_tolerance_um = {request.height_tolerance_um:g} the channel may "
            f"be {low:g} µm high, and the larger cell needs {width:.3g} µm.",
            key="height_tolerance_um",
            value=request.height_tolerance_um,
            allowed=f"{max(chip.flow.height_um - width, 0):.3g} µm or less",
            remedy="Lower it, or name a higher channel.",
        )
    check_tolerance(request.tolerance_um, request.pillar_radius_um[0], request.gap_um[0])
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


def mend(broken: Iterable[str], request: DesignRequest) -> tuple[list[str], str]:
    """The settings that these violated constraints come from, and a sentence on how to meet them.

    What shortens an array is its own length, the footprint and the pressure.
    """
    shortens = [
        name
        for name in ("footprint_max_mm2", "pressure_max_kPa")
        if getattr(request, name) is not None
    ]
    longer = " or ".join([*shortens, "device.array_length_mm"])
    short = (*shortens, "periodicity"), f"raise {longer}, or lower periodicity, gap_um or "
    mends = MENDS | {SHORT: (short[0], f"{short[1]}pillar_radius_um")}
    found = [mends[text] for text in dict.fromkeys(broken)]
    keys = list(dict.fromkeys(key for keys, _ in found for key in keys))
    sentence = "; ".join(how for _, how in found)
    return keys, f"{sentence[:1].upper()}{sentence[1:]}."


def fixed(request: DesignRequest) -> set[str]:
    """Parameters whose bounds leave one value."""
    return {name for name in GEOMETRY if np.ptp(getattr(request, name)) == 0}
