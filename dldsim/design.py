"""Search for the array that separates two cell types best, on the surrogate.

Nothing here is simulated: a design is the surrogate's prediction, with the surrogate's error.
"""

from collections.abc import Mapping
from math import hypot, sqrt
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from dldsim.errors import DldsimError
from dldsim.surrogate import DOMAIN_TOLERANCE, Surrogate

if TYPE_CHECKING:
    import optuna

    from dldsim.config import DesignRequest

GEOMETRY = ["pillar_radius_um", "gap_um", "periodicity"]
TOLERANCE_STEPS = 5
"""Values of P_r and of P_g across the tolerance, ends and middle included."""
REGRET_REPEATS = 3
REGRET_POINTS = 16
"""Numbers of evaluations at which a search is looked at."""
GRID_STEPS = (3, 5, 9, 17, 33)
"""Values of P_r and of P_g in the exhaustive searches; N_p takes all."""
TINY = 1e-9
"""Turns the strict P_g > P_r + d_safety into a constraint that may be zero [µm]."""


def squeezed_width_um(radius_um: float, deformation_index: float) -> float:
    """Narrowest width that a cell has been seen to take [µm].

    In the calibration's throat a cell of deformation index DI = (a − b)/(a + b) has axes a and b.
    If its projected area stays that of a disc of radius R, ab = (2R)², so that
    b = 2R √((1 − DI)/(1 + DI)). A gap narrower than b would need a larger deformation than the one
    measured; an undeformable cell needs 2R.
    """
    return 2 * radius_um * sqrt((1 - deformation_index) / (1 + deformation_index))


def violations(
    request: "DesignRequest", d_safety_um: float, pillar_radius_um: float, gap_um: float
) -> dict[str, float]:
    """Constraints of a geometry [µm]; above zero is violated, by so much."""
    width = max(
        squeezed_width_um(request.radius_1_um, request.deformation_index_1),
        squeezed_width_um(request.radius_2_um, request.deformation_index_2),
    )
    return {
        "gap must exceed pillar radius + safety distance":
            pillar_radius_um + d_safety_um + TINY - gap_um,
        "gap must pass the squeezed cells": width - gap_um,
    }


def search(
    surrogate: Surrogate, request: "DesignRequest", d_safety_um: float, seed: int
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Ranked designs and all trials of one request: tables of kinds `designs`, `design_trials`.

    Multivariate TPE maximises |θ_2 − θ_1| [deg] over continuous P_r and P_g and whole N_p. Geometry
    that violates a constraint is recorded, not evaluated and never ranked. Leaving the training
    geometries (in ratios to either cell radius) counts as a violation for the sampler, which so
    looks inside first; such a trial is still evaluated, flagged, and ranked behind those inside.
    Equal predictions, which are common with trees, are ordered by their worst case.

    Candidates are distinct: another N_p, or more than `tolerance_um` apart in P_r or P_g. The
    tolerance columns are the least and largest separation with P_r and P_g off by up to
    ± tolerance_um, negative where the order of the two cells is reversed. `uncertainty_deg` is
    √(2 RMSE² + σ_num²): the surrogate's cross-validated error by geometry and the numerical
    uncertainty of the separation, as if the errors of the two angles were independent. The scatter
    that numerical errors bring into the training angles is in both, which is on the safe side.
    Designs whose separations differ by less than their combined σ_num share a rank. Where σ_num is
    not known it is null, and the order is that of the predictions alone.

    Raises DldsimError for a deformation index outside the training data, two equal cell types, or
    no feasible geometry.
    """
    import optuna

    _check(surrogate, request, d_safety_um)
    sampler = optuna.samplers.TPESampler(
        n_startup_trials=request.startup_trials, multivariate=True, seed=seed
    )
    trials = _try(surrogate, request, d_safety_um, sampler)
    feasible = trials[trials["feasible"]]
    if feasible.empty:
        raise DldsimError(
            f"design request {request.name}: none of {len(trials)} trials is feasible "
            f"({', '.join(sorted(set(trials['reason'])))}). Widen gap_um upwards or "
            "pillar_radius_um downwards, or raise trials."
        )
    designs = _designs(surrogate, request, feasible)
    return designs, trials.drop(columns=["outside", "time_s"])


def _try(
    surrogate: Surrogate, request: "DesignRequest", d_safety_um: float,
    sampler: "optuna.samplers.BaseSampler",
) -> pd.DataFrame:
    """The request's trials as a sampler chooses them.

    Columns of `design_trials`, and `outside` and `time_s`.
    """
    import optuna

    rows: list[dict[str, Any]] = []
    start = perf_counter()

    def objective(trial: optuna.Trial) -> float:
        radius = trial.suggest_float("pillar_radius_um", *request.pillar_radius_um)
        gap = trial.suggest_float("gap_um", *request.gap_um)
        periodicity = trial.suggest_int("periodicity", *request.periodicity)
        row = dict(zip(GEOMETRY, (radius, gap, periodicity), strict=True))
        limits = violations(request, d_safety_um, radius, gap)
        broken = [name for name, value in limits.items() if value > 0]
        outside = _distance_outside(surrogate, request, row)
        for name, value in limits.items():
            trial.set_constraint(name, value)
        trial.set_constraint("training geometries", min(outside, 1e3) - DOMAIN_TOLERANCE)
        separation = np.nan if broken else abs(_difference(surrogate, request, row)[0])
        rows.append({"request": request.name, "trial": trial.number} | row | {
            "separation_deg": separation, "feasible": not broken, "reason": "; ".join(broken),
            "outside": outside, "time_s": perf_counter() - start,
        })
        if broken:
            raise optuna.TrialPruned
        return separation

    verbosity = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    try:
        study = optuna.create_study(direction="maximize", sampler=sampler)
        study.optimize(objective, n_trials=request.trials)
    finally:
        optuna.logging.set_verbosity(verbosity)
    return pd.DataFrame(rows)


def regret(
    surrogate: Surrogate, request: "DesignRequest", d_safety_um: float, seed: int
) -> pd.DataFrame:
    """What TPE, random and exhaustive search miss of the largest separation; `search_regret`.

    A trial counts if it is feasible and inside the training geometries. The largest separation is
    that which any search found, the finest grid included: the true one may be larger by what falls
    between its points. TPE and random search of one repeat begin with the same random trials.
    """
    import optuna

    _check(surrogate, request, d_safety_um)
    samplers = {
        "tpe": lambda seed: optuna.samplers.TPESampler(
            n_startup_trials=request.startup_trials, multivariate=True, seed=seed),
        "random": lambda seed: optuna.samplers.RandomSampler(seed=seed),
    }
    looks = np.unique(np.geomspace(1, request.trials, REGRET_POINTS).round().astype(int))
    rows = []
    for method, make in samplers.items():
        for repeat in range(REGRET_REPEATS):
            trials = _try(surrogate, request, d_safety_um, make(seed + repeat))
            counts = trials["feasible"] & (trials["outside"] <= DOMAIN_TOLERANCE)
            best = trials["separation_deg"].where(counts, 0.0).cummax()
            rows += [
                {"method": method, "repeat": repeat, "evaluations": int(n),
                 "best_deg": best.iloc[n - 1], "time_s": trials["time_s"].iloc[n - 1]}
                for n in looks
            ]  # fmt: skip
    for steps in GRID_STEPS:
        start = perf_counter()
        evaluations, best = _exhaust(surrogate, request, d_safety_um, steps)
        rows.append({"method": "grid", "repeat": 0, "evaluations": evaluations, "best_deg": best,
                     "time_s": perf_counter() - start})
    table = pd.DataFrame(rows)
    return table.assign(request=request.name,
                        regret_deg=table["best_deg"].max() - table["best_deg"])


def _exhaust(
    surrogate: Surrogate, request: "DesignRequest", d_safety_um: float, steps: int
) -> tuple[int, float]:
    """Points of a grid, and the largest separation [deg] among those that count; 0 for none."""
    low, high = request.periodicity
    axes = (np.linspace(*request.pillar_radius_um, steps), np.linspace(*request.gap_um, steps),
            np.arange(low, high + 1))
    radius, gap, rows = (v.ravel() for v in np.meshgrid(*axes, indexing="ij"))
    limits = [violations(request, d_safety_um, r, g)
              for r, g in zip(radius, gap, strict=True)]
    good = np.array([max(v.values()) <= 0 for v in limits])
    for cell in {request.radius_1_um, request.radius_2_um}:
        good &= surrogate.may_be_inside(radius, gap, rows, cell)
    first, second = _angles(surrogate, request, radius, gap, rows)
    separation = np.where(good, np.abs(second - first), -1.0)
    for i in np.argsort(-separation, kind="stable")[: int(good.sum())]:
        place = dict(zip(GEOMETRY, (radius[i], gap[i], int(rows[i])), strict=True))
        if _distance_outside(surrogate, request, place) <= DOMAIN_TOLERANCE:
            return len(rows), float(separation[i])
    return len(rows), 0.0


def _check(surrogate: Surrogate, request: "DesignRequest", d_safety_um: float) -> None:
    low, high = surrogate.deformation_index_range
    name = f"design request {request.name}"
    cells = []
    for i in (1, 2):
        index = getattr(request, f"deformation_index_{i}")
        if index is None or not low <= index <= high:
            raise DldsimError(
                f"{name}: deformation_index_{i} = {index} is outside the training data of the "
                f"surrogate, {low:.4g} to {high:.4g}. Choose one inside, or simulate stiffness "
                "sets beyond it."
            )
        cells.append((index, getattr(request, f"radius_{i}_um")))
    if cells[0] == cells[1]:
        raise DldsimError(
            f"{name}: both cell types have deformation index {cells[0][0]:g} and radius "
            f"{cells[0][1]:g} µm; no array separates equals. Change one of them."
        )
    # the widest gap beside the thinnest pillar meets every constraint if anything does
    thinnest, widest = request.pillar_radius_um[0], request.gap_um[1]
    broken = {name: value for name, value in
              violations(request, d_safety_um, thinnest, widest).items() if value > 0}
    if broken:
        texts = "; ".join(f"{text} (by {value:.3g} µm)" for text, value in broken.items())
        raise DldsimError(
            f"{name}: no geometry within the bounds is feasible. Even at pillar_radius_um = "
            f"{thinnest:g} and gap_um = {widest:g}: {texts}. Raise the upper bound of gap_um or "
            "lower that of pillar_radius_um."
        )


def _angles(
    surrogate: Surrogate, request: "DesignRequest", pillar_radius_um: Any, gap_um: Any,
    periodicity: Any,
) -> tuple[np.ndarray, np.ndarray]:
    """Predicted angles [deg] of both cell types."""
    geometry = pillar_radius_um, gap_um, periodicity
    return (
        surrogate.predict(*geometry, request.deformation_index_1, request.radius_1_um),
        surrogate.predict(*geometry, request.deformation_index_2, request.radius_2_um),
    )


def _difference(
    surrogate: Surrogate, request: "DesignRequest", geometry: Mapping[str, Any]
) -> np.ndarray:
    first, second = _angles(surrogate, request, *(geometry[name] for name in GEOMETRY))
    return second - first


def _distance_outside(
    surrogate: Surrogate, request: "DesignRequest", geometry: Mapping[str, Any]
) -> float:
    """Distance outside the training geometries, of the cell type for which it is larger."""
    place = [geometry[name] for name in GEOMETRY]
    radii = {request.radius_1_um, request.radius_2_um}
    return max(surrogate.distance_outside(*place, radius) for radius in radii)


def _designs(
    surrogate: Surrogate, request: "DesignRequest", feasible: pd.DataFrame
) -> pd.DataFrame:
    """The best distinct candidates with tolerance, uncertainty and verdict."""
    table = feasible.copy()
    table["inside_training_domain"] = table["outside"] <= DOMAIN_TOLERANCE
    first, second = _angles(surrogate, request, *(table[name] for name in GEOMETRY))
    table["angle_1_deg"], table["angle_2_deg"] = first, second
    least, largest = _over_tolerance(surrogate, request, table)
    table["separation_tolerance_min_deg"] = least
    table["separation_tolerance_max_deg"] = largest
    sigma = [surrogate.sigma_num_deg(angle, table["periodicity"]) for angle in (first, second)]
    known = all(part is not None for part in sigma)
    table["sigma_num_deg"] = np.hypot(*sigma) if known else np.nan
    table["uncertainty_deg"] = np.hypot(surrogate.rmse_deg * sqrt(2),
                                        table["sigma_num_deg"].fillna(0.0))
    table = table.sort_values(
        ["inside_training_domain", "separation_deg", "separation_tolerance_min_deg", "trial"],
        ascending=[False, False, False, True],
    )
    chosen: list[pd.Series] = []
    for _, row in table.iterrows():
        if len(chosen) < request.candidates and all(_distinct(request, row, c) for c in chosen):
            chosen.append(row)
    designs = pd.DataFrame(chosen)
    designs["rank"] = ranks = _ranks(designs)
    designs["verdict"] = [_verdict(row, ranks.count(row["rank"])) for _, row in designs.iterrows()]
    designs = designs.astype({"periodicity": int, "inside_training_domain": bool})
    columns = [
        "request", "rank", *GEOMETRY, "separation_deg", "angle_1_deg", "angle_2_deg",
        "separation_tolerance_min_deg", "separation_tolerance_max_deg", "sigma_num_deg",
        "uncertainty_deg", "verdict", "inside_training_domain",
    ]
    return designs[columns].reset_index(drop=True)


def _over_tolerance(
    surrogate: Surrogate, request: "DesignRequest", table: pd.DataFrame
) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest separation [deg] over ± tolerance, counted in the nominal order."""
    step = np.linspace(-1, 1, TOLERANCE_STEPS) * request.tolerance_um
    off_radius, off_gap = (v.ravel() for v in np.meshgrid(step, step))
    smallest = 1e-3  # a tolerance wider than the pillar must not make it vanish
    radius = np.maximum(table["pillar_radius_um"].to_numpy()[:, None] + off_radius, smallest)
    gap = np.maximum(table["gap_um"].to_numpy()[:, None] + off_gap, smallest)
    rows = np.repeat(table["periodicity"].to_numpy(), off_gap.size)
    first, second = _angles(surrogate, request, radius.ravel(), gap.ravel(), rows)
    order = np.where(table["angle_2_deg"] >= table["angle_1_deg"], 1.0, -1.0)[:, None]
    separation = order * (second - first).reshape(len(table), -1)
    return separation.min(axis=1), separation.max(axis=1)


def _distinct(request: "DesignRequest", a: pd.Series, b: pd.Series) -> bool:
    apart = max(request.tolerance_um, TINY)
    return a["periodicity"] != b["periodicity"] or any(
        abs(a[name] - b[name]) > apart for name in ("pillar_radius_um", "gap_um")
    )


def _ranks(designs: pd.DataFrame) -> list[int]:
    """Rank of each design, best first: 1 + number of designs before its class of equals.

    Equal to the first of its class: on the same side of the training domain, and apart by less than
    the combined σ_num of the two separations. Without σ_num every design has its own rank.
    """
    ranks: list[int] = []
    leader = None
    for place, (_, row) in enumerate(designs.iterrows()):
        equal = leader is not None and (
            row["inside_training_domain"] == leader["inside_training_domain"]
            and leader["separation_deg"] - row["separation_deg"]
            < hypot(leader["sigma_num_deg"], row["sigma_num_deg"])
        )
        if not equal:
            leader = row
        ranks.append(ranks[-1] if equal else place + 1)
    return ranks


def _verdict(row: pd.Series, equals: int) -> str:
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
