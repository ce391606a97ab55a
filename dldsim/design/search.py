"""Search for the array that separates two cell types best, on the surrogate.

Nothing here is simulated: a candidate is the surrogate's prediction, with the surrogate's error.
:mod:`dldsim.design.verification` makes designs of candidates.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from math import hypot, sqrt
from time import perf_counter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd

from dldsim.analysis.surrogate import DOMAIN_TOLERANCE, Surrogate
from dldsim.config.design_sections import DesignRequest, Device
from dldsim.config.sections import Flow
from dldsim.errors import DldsimError
from dldsim.experiments.migration import mode_of
from dldsim.tables.registry import TABLES
from dldsim.vocabulary import GEOMETRY

if TYPE_CHECKING:
    import optuna

Each = Callable[[Mapping[str, Any]], None]
"""Told of every trial of a search as soon as it is done; what it raises ends the search."""
CELL_TYPES = tuple(f"{key}_{i}" for i in "12" for key in ("deformation_index", "stiffness_set")
                   ) + ("radius_1_um", "radius_2_um")  # fmt: skip
"""Settings that name the two cell types."""
TOLERANCE_STEPS = 5
"""Values of P_r and of P_g across the tolerance, ends and middle included."""
SMALLEST_DIRECTION = 1e-4
"""Of the fit of the resistance, over the largest singular value."""
EXCEEDED_BY = 0.9
"""Share of the Monte Carlo draws whose separation is larger than the robust one."""
COVERAGE = 0.9
"""Of the prediction intervals."""
NORMAL_HALF_WIDTH = 1.6449
"""Half-width of a normal distribution's interval of that coverage, in standard deviations."""
DECIMALS = 2
"""Of the lengths of a candidate, in µm: finer than any mask."""
REGRET_REPEATS = 3
REGRET_POINTS = 16
"""Numbers of evaluations at which a search is looked at."""
GRID_STEPS = (3, 5, 9, 17, 33)
"""Values of P_r and of P_g in the exhaustive searches; N_p takes all."""
GRID_CHECKED = 300
"""Best points of a grid whose exact distance from the training geometries is looked up."""
TRANSITION_POINTS = 2048
"""Random arrays among which those near a mode transition are chosen."""
TRANSITION_SHARE = 0.25
"""An array is near one where tan θ · N_p of a cell type is this close to a half."""
SLICE_STEPS = 33
"""Values of P_r and of P_g in the slices through the best candidate."""
TINY = 1e-9
"""Turns the strict P_g > P_r + d_safety into a constraint that may be zero [µm]."""
NONE_BETTER = 1e3
"""Stands for an infinite violation, which samplers cannot compare."""


class Resistance:
    """Drag of a pillar / (μU) over geometry, from a table of `flows` of one channel height.

    Its logarithm is a quadratic of log(P_g/λ) and log(λ) and linear in ε, fitted by least squares.
    Directions of the terms in which the arrays hardly differ, such as those off the line of arrays
    whose P_r and P_g go together, take no part in it, and ``basis`` says so.
    ``error``: root mean square of the relative error where each array is left out in turn.
    Raises DldsimError for too few flows, or several heights or drives.
    """

    def __init__(self, flows: pd.DataFrame):
        table = flows.dropna(subset=["drag_over_mu_U"])
        for name in ("height_um", "drive"):
            if table[name].nunique() > 1:
                raise DldsimError(f"The table of flows mixes several values of {name}.")
        x = self._terms(*(table[name].to_numpy(float) for name in GEOMETRY))
        y = np.log(table["drag_over_mu_U"].to_numpy(float))
        if len(y) < 4:
            raise DldsimError(f"{len(y)} flows are too few to interpolate the pressure drop from.")
        self.height_um = float(table["height_um"].iloc[0])
        self.coefficients, _, rank, _ = np.linalg.lstsq(x, y, rcond=SMALLEST_DIRECTION)
        leverage = np.einsum("ij,ji->i", x, np.linalg.pinv(x, rcond=SMALLEST_DIRECTION))
        known = leverage < 1 - 1e-9  # the others decide their own value
        left_out = (y - x @ self.coefficients)[known] / (1 - leverage[known])
        self.error = float(np.sqrt(np.mean(np.expm1(left_out) ** 2))) if known.any() else np.nan
        error = "not known" if np.isnan(self.error) else f"{self.error:.1%}"
        self.basis = f"interpolated from {len(y)} flows without a cell (error {error})"
        if rank < x.shape[1]:
            self.basis += ", whose P_r, P_g and N_p do not all vary on their own: larger elsewhere"

    @staticmethod
    def _terms(radius, gap, periodicity) -> np.ndarray:
        pitch = 2 * np.asarray(radius) + gap
        a, b = np.log(gap / pitch), np.log(pitch)
        return np.column_stack([np.ones_like(a), a, b, a * a, a * b, b * b, 1 / periodicity])

    def drag_over_mu_U(self, radius, gap, periodicity) -> np.ndarray:
        """Drag per length of pillar / (μU), shape (n,)."""
        columns = np.broadcast_arrays(*(np.atleast_1d(np.asarray(v, float))
                                        for v in (radius, gap, periodicity)))
        return np.exp(self._terms(*columns) @ self.coefficients)


class Chip(NamedTuple):
    """What surrounds an array: the channel and its flow, the device, and what limits the search."""

    flow: Flow
    device: Device = Device()
    safety_distance_um: float = 2.0
    resistance: Resistance | None = None

    def pressure_kPa(self, drag_over_mu_U, pitch_um, length_mm):
        """Pressure drop over a length of array at the flow's mean velocity.

        A force density f = drag_over_mu_U · μU/λ² along x drives the mean velocity U, without
        lateral flux; over a length L it is the pressure f·L.
        """
        speed = self.flow.viscosity_mPa_s * self.flow.mean_velocity_mm_s
        return np.asarray(drag_over_mu_U) * speed * length_mm / np.square(pitch_um)

    @property
    def throughput_uL_per_h(self) -> float:
        """Flow through the whole width of the device's array."""
        velocity, width = self.flow.mean_velocity_mm_s, self.device.array_width_mm
        return 3.6 * velocity * width * self.flow.height_um


class Found(NamedTuple):
    """Tables of one search: `designs`, `design_trials`, `design_tolerances`, `design_importance`,
    `design_slices`."""

    designs: pd.DataFrame
    trials: pd.DataFrame
    tolerances: pd.DataFrame
    importance: pd.DataFrame
    slices: pd.DataFrame


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
        radius, gap, periodicity = (np.asarray(v, float)[:, None]
                                    for v in (radius, gap, periodicity))
        errors = self.half_widths(radius[:, 0], gap[:, 0], periodicity[:, 0])
        radius = np.maximum(radius + self.request.tolerance_um * off_radius, 1e-3)
        gap = np.maximum(gap + self.request.tolerance_um * off_gap, 1e-3)
        periodicity = np.broadcast_to(periodicity, radius.shape)
        angles = []
        for k, (index, cell) in enumerate(self.cells):
            drawn = np.clip(index + self.spreads[k] * normal[k],
                            *self.surrogate.deformation_index_range)
            drawn = np.broadcast_to(drawn, radius.shape)
            angle = self.surrogate.predict(*(v.ravel() for v in (radius, gap, periodicity, drawn)),
                                           cell).reshape(radius.shape)
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
        return {"angle_1_deg": first, "angle_2_deg": second, "separation_deg": separation,
                "value": value}

    def length_mm(self, angle_1_deg, angle_2_deg) -> np.ndarray:
        """Array length that parts the cell types by the wanted distance; infinite for none."""
        slopes = np.tan(np.radians(angle_2_deg)) - np.tan(np.radians(angle_1_deg))
        with np.errstate(divide="ignore"):
            return self.request.lateral_separation_um / np.abs(slopes) / 1e3

    def pressure_kPa(self, radius, gap, periodicity, length_mm) -> np.ndarray:
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
        return max(self.surrogate.distance_outside(radius, gap, periodicity, cell)
                   for cell in self.radii)

    def may_be_inside(self, radius, gap, periodicity) -> np.ndarray:
        """False where `outside` surely exceeds DOMAIN_TOLERANCE, (n,)."""
        return np.all([self.surrogate.may_be_inside(radius, gap, periodicity, cell)
                       for cell in self.radii], axis=0)

    def grid(self, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """All combinations of so many P_r and P_g within the bounds with every N_p, (n,) each."""
        low, high = self.request.periodicity
        axes = (np.linspace(*self.request.pillar_radius_um, steps).round(DECIMALS),
                np.linspace(*self.request.gap_um, steps).round(DECIMALS), np.arange(low, high + 1))
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
    width = max(
        squeezed_width_um(request.radius_1_um, request.deformation_index_1),
        squeezed_width_um(request.radius_2_um, request.deformation_index_2),
    )
    return {
        "gap must exceed pillar radius + safety distance":
            pillar_radius_um + chip.safety_distance_um + TINY - gap_um,
        "gap must pass the squeezed cells": width - gap_um,
        "pillars must not be too slender":
            chip.flow.height_um / (2 * pillar_radius_um) - request.pillar_aspect_ratio_max,
    }


def search(surrogate: Surrogate, request: DesignRequest, chip: Chip, seed: int,
           each: Each | None = None) -> Found:
    """Ranked candidates and all trials of one request.

    Maximised is the request's objective over continuous P_r and P_g (to 10 nm) and whole N_p, by
    multivariate TPE or over a grid. Geometry that violates a constraint is recorded, not evaluated
    and never ranked. Leaving the training geometries (in ratios to either cell radius) counts as a
    violation for the sampler, which so looks inside first; such a trial is still evaluated,
    flagged, and ranked behind those inside. Equal values are ordered by their worst case.

    Candidates are distinct: another N_p, or more than `tolerance_um` apart in P_r or P_g. The
    tolerance columns are the least and largest separation with P_r and P_g off by up to
    ± tolerance_um, negative where the order of the two cells is reversed. `uncertainty_deg` is the
    half-width of the separation's prediction interval: those of the two angles, as if their errors
    were independent. They were measured on simulated angles and hold the scatter of numerical
    errors. Candidates whose values differ by less than their combined σ_num share a rank. Where
    σ_num is not known it is null, and the order is that of the predictions alone.

    ``each`` is told of every trial of the estimator: its row of `design_trials`, `outside` and
    `time_s`. A grid has no trials in turn.

    Raises DldsimError for a deformation index outside the training data, two equal cell types,
    no feasible geometry, or a pressure limit without a table of flows.
    """
    task = Task(surrogate, request, chip, seed)
    check(task)
    if request.sampler == "grid":
        trials, importance = _try_grid(task)
    else:
        import optuna

        study, trials = _try(task, optuna.samplers.TPESampler(
            n_startup_trials=request.startup_trials, multivariate=True, seed=seed), each)
        importance = _importance(study)
    feasible = trials[trials["feasible"]]
    if feasible.empty:
        raise DldsimError(
            f"design request {request.name}: none of {len(trials)} trials is feasible "
            f"({', '.join(sorted(set(trials['reason'])))}).",
            key=("gap_um", "pillar_radius_um", "trials"),
            value=(request.gap_um, request.pillar_radius_um, request.trials),
            allowed="bounds and trials that meet a feasible geometry",
            remedy="Widen gap_um upwards or pillar_radius_um downwards, or raise trials.",
        )
    designs = _designs(task, feasible)
    return Found(
        designs, trials.drop(columns=["outside", "time_s"]), tolerances(task, designs),
        importance.assign(request=request.name), slices(task, designs.iloc[0]),
    )


def _try(
    task: Task, sampler: "optuna.samplers.BaseSampler", each: Each | None = None
) -> tuple["optuna.Study", pd.DataFrame]:
    """The request's trials as a sampler chooses them.

    Columns of `design_trials`, and `outside` and `time_s`.
    """
    import optuna

    request = task.request
    rows: list[dict[str, Any]] = []
    start = perf_counter()

    def objective(trial: optuna.Trial) -> float:
        place = [
            _within(trial.suggest_float(name, *bounds), bounds)
            for name, bounds in (("pillar_radius_um", request.pillar_radius_um),
                                 ("gap_um", request.gap_um))
        ]  # fmt: skip
        place.append(trial.suggest_int("periodicity", *request.periodicity))
        at = [np.array([v]) for v in place]
        limits = {name: float(np.squeeze(v)) for name, v in task.limits(*at).items()}
        broken = [name for name, value in limits.items() if value > 0]
        outside = task.outside(*place)
        for name, value in limits.items():
            trial.set_constraint(name, value)
        trial.set_constraint("training geometries", min(outside, NONE_BETTER) - DOMAIN_TOLERANCE)
        values = dict.fromkeys(VALUES, np.nan)
        if not broken:
            values = {name: float(v[0]) for name, v in task.values(*at).items()}
        rows.append({
            "request": request.name, "trial": trial.number,
            **dict(zip(GEOMETRY, place, strict=True)), **values,
            "feasible": not broken, "reason": "; ".join(broken), "outside": outside,
            "time_s": perf_counter() - start,
        })
        if each is not None:
            each(rows[-1])
        if broken:
            raise optuna.TrialPruned
        return values["value"]

    verbosity = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    try:
        study = optuna.create_study(direction="maximize", sampler=sampler)
        study.optimize(objective, n_trials=request.trials)
    finally:
        optuna.logging.set_verbosity(verbosity)
    return study, pd.DataFrame(rows)


VALUES = ("angle_1_deg", "angle_2_deg", "separation_deg", "value")


def _within(value: float, bounds: Sequence[float]) -> float:
    """The value to DECIMALS, or the bound that it would leave."""
    return min(max(round(value, DECIMALS), bounds[0]), bounds[1])


def _try_grid(task: Task) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Every point of the request's grid as a trial, and the importance of its axes.

    The exact distance from the training geometries is looked up for the best points only; the
    others count as outside.
    """
    start = perf_counter()
    place = task.grid(task.request.grid_steps)
    limits = task.limits(*place)
    broken = np.array([np.broadcast_to(v, len(place[0])) > 0 for v in limits.values()])
    feasible = ~broken.any(axis=0)
    values = {name: np.full(len(feasible), np.nan) for name in VALUES}
    if feasible.any():
        for name, found in task.values(*(v[feasible] for v in place)).items():
            values[name][feasible] = found
    maybe = feasible & task.may_be_inside(*place)
    outside = np.full(len(feasible), np.inf)
    order = np.argsort(-np.where(maybe, values["value"], -np.inf), kind="stable")
    for i in order[: min(GRID_CHECKED, int(maybe.sum()))]:
        outside[i] = task.outside(*(v[i].item() for v in place))
    names = np.array(list(limits))
    trials = pd.DataFrame({
        "request": task.request.name, "trial": np.arange(len(feasible)),
        **dict(zip(GEOMETRY, place, strict=True)), **values, "feasible": feasible,
        "reason": ["; ".join(names[column]) for column in broken.T],
        "outside": outside, "time_s": perf_counter() - start,
    })
    return trials, grid_importance(trials[maybe])


def grid_importance(trials: pd.DataFrame) -> pd.DataFrame:
    """Share of the variance over a grid that the means over each parameter's values have."""
    total = trials["value"].var(ddof=0)
    shares = []
    for name in GEOMETRY:
        means = trials.groupby(name)["value"].transform("mean")
        shares.append(means.var(ddof=0) / total if total > 0 else np.nan)
    return pd.DataFrame({"parameter": GEOMETRY, "importance": shares,
                         "evaluator": "share of the variance over the grid, main effect"})


def _importance(study: "optuna.Study") -> pd.DataFrame:
    """Importance of the parameters for being among the best tenth of the trials.

    Not known where too many trials are equally good to tell a best tenth apart.
    """
    from optuna.importance import PedAnovaImportanceEvaluator, get_param_importances

    known = dict.fromkeys(GEOMETRY, np.nan)
    values = {t.value for t in study.trials if t.value is not None}
    with warnings.catch_warnings(record=True) as equal:
        warnings.simplefilter("always")
        if len(values) > 1:
            found = get_param_importances(study, evaluator=PedAnovaImportanceEvaluator())
            known = known if equal else known | found
    return pd.DataFrame({"parameter": GEOMETRY, "importance": [known[n] for n in GEOMETRY],
                         "evaluator": "PED-ANOVA, best tenth of the trials"})


def regret(surrogate: Surrogate, request: DesignRequest, chip: Chip, seed: int) -> pd.DataFrame:
    """What TPE, random and exhaustive search miss of the largest separation; `search_regret`.

    Whatever the request's objective, it is |Δθ| as predicted. A trial counts if it is feasible and
    inside the training geometries. The largest separation is that which any search found, the
    finest grid included: the true one may be larger by what falls between its points. TPE and
    random search of one repeat begin with the same random trials.
    """
    import optuna

    request = request.model_copy(update={"objective": "separation"})
    task = Task(surrogate, request, chip, seed)
    check(task)
    samplers = {
        "tpe": lambda seed: optuna.samplers.TPESampler(
            n_startup_trials=request.startup_trials, multivariate=True, seed=seed),
        "random": lambda seed: optuna.samplers.RandomSampler(seed=seed),
    }
    looks = np.unique(np.geomspace(1, request.trials, REGRET_POINTS).round().astype(int))
    rows = []
    for method, make in samplers.items():
        for repeat in range(REGRET_REPEATS):
            _, trials = _try(task, make(seed + repeat))
            counts = trials["feasible"] & (trials["outside"] <= DOMAIN_TOLERANCE)
            best = trials["separation_deg"].where(counts, 0.0).cummax()
            rows += [
                {"method": method, "repeat": repeat, "evaluations": int(n),
                 "best_deg": best.iloc[n - 1], "time_s": trials["time_s"].iloc[n - 1]}
                for n in looks
            ]  # fmt: skip
    for steps in GRID_STEPS:
        start = perf_counter()
        evaluations, best = _exhaust(task, steps)
        rows.append({"method": "grid", "repeat": 0, "evaluations": evaluations, "best_deg": best,
                     "time_s": perf_counter() - start})
    table = pd.DataFrame(rows)
    return table.assign(request=request.name,
                        regret_deg=table["best_deg"].max() - table["best_deg"])


def _exhaust(task: Task, steps: int) -> tuple[int, float]:
    """Points of a grid, and the largest separation [deg] among those that count; 0 for none."""
    place = task.grid(steps)
    good = np.all([np.broadcast_to(v, len(place[0])) <= 0 for v in task.limits(*place).values()],
                  axis=0)
    good &= task.may_be_inside(*place)
    first, second = task.angles(*place)
    separation = np.where(good, np.abs(second - first), -1.0)
    for i in np.argsort(-separation, kind="stable")[: int(good.sum())]:
        if task.outside(*(v[i].item() for v in place)) <= DOMAIN_TOLERANCE:
            return len(good), float(separation[i])
    return len(good), 0.0


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
                f"{allowed}.", key=key, value=index, allowed=allowed,
                remedy="Choose one inside, or simulate stiffness sets beyond it.",
            )  # fmt: skip
    if task.cells[0] == task.cells[1]:
        index, radius = task.cells[0]
        raise DldsimError(
            f"{name}: both cell types have deformation index {index:g} and radius {radius:g} µm; "
            "no array separates equals.", key=CELL_TYPES, value=index,
            allowed="different cell types", remedy="Change one of them.",
        )  # fmt: skip
    # the widest gap beside the thinnest pillar that is not too slender meets every constraint if
    # anything does
    slender = chip.flow.height_um / (2 * request.pillar_aspect_ratio_max)
    thinnest = min(max(request.pillar_radius_um[0], slender), request.pillar_radius_um[1])
    widest = request.gap_um[1]
    broken = {text: value for text, value in
              violations(request, chip, thinnest, widest).items() if value > 0}
    if broken:
        texts = "; ".join(f"{text} (by {value:.3g})" for text, value in broken.items())
        raise DldsimError(
            f"{name}: no geometry within the bounds is feasible. Even at pillar_radius_um = "
            f"{thinnest:g} and gap_um = {widest:g}: {texts}.",
            key=("gap_um", "pillar_radius_um"), value=(request.gap_um, request.pillar_radius_um),
            allowed="bounds that hold a feasible geometry",
            remedy="Raise the upper bound of gap_um or widen the bounds of pillar_radius_um.",
        )
    if request.pressure_max_kPa is not None and chip.resistance is None:
        raise DldsimError(
            f"{name}: pressure_max_kPa needs the flows without a cell of the campaign "
            "(flows.parquet) to know the pressure drop.", key="pressure_max_kPa",
            value=request.pressure_max_kPa, allowed="none, without these flows",
            remedy="Make them with `snakemake -j2 flows`, or leave the limit out.",
        )  # fmt: skip


def _designs(task: Task, feasible: pd.DataFrame) -> pd.DataFrame:
    """The best distinct candidates with tolerance, uncertainty and verdict."""
    request, chip, surrogate = task.request, task.chip, task.surrogate
    table = feasible.assign(inside_training_domain=feasible["outside"] <= DOMAIN_TOLERANCE)
    if len(table) > GRID_CHECKED:
        table = table.nlargest(GRID_CHECKED, ["inside_training_domain", "value"], keep="all")
    place = [table[name].to_numpy() for name in GEOMETRY]
    least, largest = _over_tolerance(task, table)
    sigma = [surrogate.sigma_num_deg(table[f"angle_{i}_deg"], place[2]) for i in (1, 2)]
    known = all(part is not None for part in sigma)
    table = table.assign(
        separation_tolerance_min_deg=least, separation_tolerance_max_deg=largest,
        sigma_num_deg=np.hypot(*sigma) if known else np.nan,
        uncertainty_deg=np.hypot(*task.half_widths(*place)),
    ).sort_values(
        ["inside_training_domain", "value", "separation_tolerance_min_deg", "trial"],
        ascending=[False, False, False, True],
    )
    chosen: list[pd.Series] = []
    for _, row in table.iterrows():
        if len(chosen) == request.candidates:
            break
        if all(distinct(request, row, c) for c in chosen):
            chosen.append(row)
    designs = pd.DataFrame(chosen).astype({"periodicity": int, "inside_training_domain": bool})
    designs["design"] = range(1, len(designs) + 1)
    designs["rank"] = ranks = ranks_of(designs, "value")
    place = [designs[name].to_numpy() for name in GEOMETRY]
    angles = [designs[f"angle_{i}_deg"].to_numpy(float) for i in (1, 2)]
    modes = [[mode_of(a, 1 / n) for a, n in zip(angle, place[2], strict=True)] for angle in angles]
    drawn = task.drawn(*place)
    shift = np.array([
        [[mode_of(a, 1 / n) for a in row] != np.full(len(row), mode)
         for row, n, mode in zip(angle, place[2], mode, strict=True)]
        for angle, mode in zip(drawn, modes, strict=True)
    ])
    length = task.length_mm(*angles)
    pressure = np.full(len(designs), np.nan)
    if chip.resistance is not None:
        pressure = task.pressure_kPa(*place, length)
    designs = designs.assign(
        objective=request.objective, mode_1=modes[0], mode_2=modes[1],
        robust_separation_deg=task.robust(*place)[0],
        mode_change_probability=shift.any(axis=0).mean(axis=1),
        length_mm=np.where(np.isfinite(length), length, np.nan),
        pressure_drop_kPa=np.where(np.isfinite(pressure), pressure, np.nan),
        pressure_basis="not known" if chip.resistance is None else chip.resistance.basis,
        throughput_uL_per_h=chip.throughput_uL_per_h,
        verdict=[verdict_of(row, ranks.count(row["rank"])) for _, row in designs.iterrows()],
    )
    return designs[TABLES["designs"].names].reset_index(drop=True)


def _over_tolerance(task: Task, table: pd.DataFrame) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest separation [deg] over ± tolerance, counted in the nominal order."""
    step = np.linspace(-1, 1, TOLERANCE_STEPS) * task.request.tolerance_um
    off_radius, off_gap = (v.ravel() for v in np.meshgrid(step, step))
    smallest = 1e-3  # a tolerance wider than the pillar must not make it vanish
    radius = np.maximum(table["pillar_radius_um"].to_numpy()[:, None] + off_radius, smallest)
    gap = np.maximum(table["gap_um"].to_numpy()[:, None] + off_gap, smallest)
    rows = np.repeat(table["periodicity"].to_numpy(), off_gap.size)
    first, second = task.angles(radius.ravel(), gap.ravel(), rows)
    order = np.where(table["angle_2_deg"] >= table["angle_1_deg"], 1.0, -1.0)[:, None]
    separation = order * (second - first).reshape(len(table), -1)
    return separation.min(axis=1), separation.max(axis=1)


def tolerances(task: Task, designs: pd.DataFrame) -> pd.DataFrame:
    """Angles, modes and separation of each candidate with one thing off; `design_tolerances`.

    `edge_um` moves every pillar edge outwards, as exposure does: the pitch, which the mask fixes,
    stays, so that P_r grows by as much and P_g shrinks by twice as much. The separation is counted
    in the order that the candidate has as wanted. `sensitivity_deg_per_unit` is the slope between
    the two offsets.
    """
    request = task.request
    low, high = task.surrogate.deformation_index_range
    rows = []
    for _, design in designs.iterrows():
        order = 1.0 if design["angle_2_deg"] >= design["angle_1_deg"] else -1.0
        for parameter, size in offsets_of(task):
            found = []
            for offset in (-size, size):
                radius, gap, periodicity = shifted(design, parameter, offset)
                angles = []
                for k, (index, cell) in enumerate(task.cells, start=1):
                    if parameter == f"deformation_index_{k}":
                        index = min(max(index + offset, low), high)
                    angles.append(float(task.surrogate.predict(
                        radius, gap, periodicity, index, cell)[0]))
                modes = [mode_of(a, 1 / periodicity) for a in angles]
                found.append({
                    "request": request.name, "design": design["design"], "parameter": parameter,
                    "offset": offset, "angle_1_deg": angles[0], "angle_2_deg": angles[1],
                    "separation_deg": order * (angles[1] - angles[0]),
                    "mode_1": modes[0], "mode_2": modes[1],
                })
            slope = (found[1]["separation_deg"] - found[0]["separation_deg"]) / (2 * size)
            rows += [{**row, "sensitivity_deg_per_unit": slope} for row in found]
    columns = ["request", "design", "parameter", "offset", "angle_1_deg", "angle_2_deg",
               "separation_deg", "mode_1", "mode_2", "sensitivity_deg_per_unit"]
    return pd.DataFrame(rows, columns=columns)


def slices(task: Task, design: Mapping[str, Any]) -> pd.DataFrame:
    """Predicted separation over two parameters, the third as in the best candidate.

    A table of kind `design_slices`, one slice for each pair; signed, angle 2 − angle 1.
    """
    request = task.request
    low, high = request.periodicity
    axes = {
        "pillar_radius_um": np.linspace(*request.pillar_radius_um, SLICE_STEPS),
        "gap_um": np.linspace(*request.gap_um, SLICE_STEPS),
        "periodicity": np.arange(low, high + 1),
    }
    found = []
    for x, y in (("pillar_radius_um", "gap_um"), ("periodicity", "gap_um"),
                 ("periodicity", "pillar_radius_um")):
        grid = np.meshgrid(axes[x], axes[y], indexing="ij")
        at = {name: np.full(grid[0].size, float(design[name])) for name in GEOMETRY}
        at |= {x: grid[0].ravel(), y: grid[1].ravel()}
        place = [at[name] for name in GEOMETRY]
        first, second = task.angles(*place)
        limits = task.limits(*place).values()
        found.append(pd.DataFrame({
            "request": request.name, "x_parameter": x, "y_parameter": y,
            "x": at[x].astype(float), "y": at[y].astype(float), "difference_deg": second - first,
            "feasible": np.all([np.broadcast_to(v, len(first)) <= 0 for v in limits], axis=0),
            "inside_training_domain": np.all(
                [task.surrogate.inside_domain(*place, *cell) for cell in task.cells], axis=0),
        }))
    return pd.concat(found, ignore_index=True)


def offsets_of(task: Task) -> list[tuple[str, float]]:
    """What may be off, and by how much; what cannot is left out."""
    width = task.request.tolerance_um
    sizes = [*((name, width) for name in ("pillar_radius_um", "gap_um", "edge_um")),
             *((f"deformation_index_{k}", s) for k, s in enumerate(task.spreads, start=1))]
    return [(name, size) for name, size in sizes if size > 0]


def shifted(design: Mapping[str, Any], parameter: str, offset: float) -> tuple[float, float, int]:
    """Geometry of a design with one thing off."""
    radius, gap = design["pillar_radius_um"], design["gap_um"]
    radius += offset if parameter in ("pillar_radius_um", "edge_um") else 0.0
    gap += {"gap_um": offset, "edge_um": -2 * offset}.get(parameter, 0.0)
    return max(radius, 1e-3), max(gap, 1e-3), int(design["periodicity"])


def distinct(request: DesignRequest, a: Mapping[str, Any], b: Mapping[str, Any]) -> bool:
    """Whether two geometries count as different."""
    apart = max(request.tolerance_um, TINY)
    return a["periodicity"] != b["periodicity"] or any(
        abs(a[name] - b[name]) > apart for name in ("pillar_radius_um", "gap_um")
    )


def ranks_of(designs: pd.DataFrame, value: str) -> list[int]:
    """Rank of each design, best first: 1 + number of designs before its class of equals.

    Equal to the first of its class: on the same side of the training domain, and apart by less than
    the combined σ_num of the two separations. Without σ_num every design has its own rank.
    """
    ranks: list[int] = []
    leader = None
    for place, (_, row) in enumerate(designs.iterrows()):
        equal = leader is not None and (
            row["inside_training_domain"] == leader["inside_training_domain"]
            and leader[value] - row[value] < hypot(leader["sigma_num_deg"], row["sigma_num_deg"])
        )
        if not equal:
            leader = row
        ranks.append(ranks[-1] if equal else place + 1)
    return ranks


def verdict_of(row: Mapping[str, Any], equals: int) -> str:
    """What a candidate's prediction is worth, in words."""
    if row["separation_deg"] <= row["uncertainty_deg"]:
        verdict = "not resolved: separation below uncertainty"
    elif row["separation_tolerance_min_deg"] <= row["uncertainty_deg"]:
        verdict = "not robust: resolved at nominal size, not over the tolerance"
    else:
        verdict = "resolved"
    if equals > 1:
        verdict += f"; one of {equals} not ranked against each other: closer than σ_num"
    if np.isnan(row["sigma_num_deg"]):
        verdict += "; numerical uncertainty not studied"
    if not row["inside_training_domain"]:
        verdict += "; extrapolated: outside the training geometries"
    return verdict


def transition_geometries(task: Task, known: pd.DataFrame, count: int) -> list[dict[str, Any]]:
    """Arrays where a simulation teaches most: near a mode transition, far from those simulated.

    Among random feasible arrays in the training domain, those in which a cell type is predicted
    half-way between bump and zigzag; of these, one after the other, the one farthest from all
    geometries known or chosen, in units of the bounds. Fewer, or none, where no array is near.
    """
    request = task.request
    rng = np.random.default_rng(task.seed)
    radius, gap = (rng.uniform(*bounds, TRANSITION_POINTS).round(DECIMALS)
                   for bounds in (request.pillar_radius_um, request.gap_um))
    low, high = request.periodicity
    place = radius, gap, rng.integers(low, high + 1, TRANSITION_POINTS)
    good = np.all([np.broadcast_to(v, TRANSITION_POINTS) <= 0
                   for v in violations(request, task.chip, radius, gap).values()], axis=0)
    good &= task.may_be_inside(*place)
    share = np.tan(np.radians(task.angles(*place))) * place[2]
    good &= np.abs(share - 0.5).min(axis=0) <= TRANSITION_SHARE
    points = np.column_stack(place)[good]
    scale = np.array([max(np.ptp(b), TINY) for b in
                      (request.pillar_radius_um, request.gap_um, request.periodicity)])
    seen = known[GEOMETRY].to_numpy(float)
    chosen: list[dict[str, Any]] = []
    while len(points) and len(chosen) < count:
        away = np.linalg.norm((points[:, None] - seen) / scale, axis=2).min(axis=1)
        best = points[away.argmax()]
        points = np.delete(points, away.argmax(), axis=0)
        if task.outside(float(best[0]), float(best[1]), int(best[2])) > DOMAIN_TOLERANCE:
            continue
        seen = np.vstack([seen, best])
        chosen.append({"pillar_radius_um": float(best[0]), "gap_um": float(best[1]),
                       "periodicity": int(best[2])})
    return chosen
