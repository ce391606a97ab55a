"""Search for the array that separates two cell types best, on the surrogate.

Nothing here is simulated: a candidate is the surrogate's prediction, with the surrogate's error.
:mod:`dldsim.design.rounds` makes designs of candidates.
"""

import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from time import perf_counter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd

from dldsim.analysis.domain import DOMAIN_TOLERANCE
from dldsim.analysis.surrogate import Surrogate
from dldsim.config.design_sections import DesignRequest
from dldsim.errors import DldsimError

if TYPE_CHECKING:
    import optuna
from dldsim.design.candidates import make_candidates
from dldsim.design.cell_source import CellSource
from dldsim.design.chip import Chip
from dldsim.design.motion import UNKNOWN, History
from dldsim.design.neighbourhood import slices, tolerances
from dldsim.design.outlet_task import OutletTask
from dldsim.design.populations import Population, rows_of
from dldsim.design.task import DECIMALS, NONE_BETTER, Task, check, mend
from dldsim.vocabulary import GEOMETRY

Each = Callable[[Mapping[str, Any]], None]
"""Told of every trial of a search as soon as it is done; what it raises ends the search."""
REGRET_REPEATS = 3
REGRET_POINTS = 16
"""Numbers of evaluations at which a search is looked at."""
GRID_STEPS = (3, 5, 9, 17, 33)
"""Values of P_r and of P_g in the exhaustive searches; N_p takes all."""


class Found(NamedTuple):
    """Tables of one search: `design_populations`, `designs`, `design_trials`, `design_tolerances`,
    `design_importance`, `design_slices`."""

    populations: pd.DataFrame
    designs: pd.DataFrame
    trials: pd.DataFrame
    tolerances: pd.DataFrame
    importance: pd.DataFrame
    slices: pd.DataFrame


def search(
    surrogate: Surrogate,
    request: DesignRequest,
    populations: Sequence[Population],
    chip: Chip,
    seed: int,
    each: Each | None = None,
    sources: Sequence[CellSource] | None = None,
    history: Sequence[History] = (UNKNOWN, UNKNOWN),
    outlets: OutletTask | None = None,
) -> Found:
    """Ranked candidates and all trials of one request; ``populations``: its cell types, ``chip``:
    at its flow, ``sources``, ``history`` and ``outlets`` as of `Task`.

    Maximised is the request's objective over continuous P_r and P_g (to 10 nm) and whole N_p, by
    multivariate TPE or over a grid. Geometry that violates a constraint is recorded, not evaluated
    and never ranked. Leaving the training geometries (in ratios to either cell radius) counts as a
    violation for the sampler, which so looks inside first; such a trial is still evaluated,
    flagged, and ranked behind those inside. Equal values are ordered by their worst case.

    With the objective purity-recovery the array is as long as device, footprint and pressure allow,
    and what it parts is asked of the Monte Carlo of :mod:`dldsim.design.outlets`; candidates in
    which a mode is open are ranked behind the others.

    Candidates are distinct: another N_p, or more than `tolerance_um` apart in P_r or P_g. The
    tolerance columns are the least and largest separation with P_r and P_g off by up to
    ± tolerance_um, negative where the order of the two cells is reversed. `uncertainty_deg` is the
    half-width of the separation's prediction interval: those of the two angles, as if their errors
    were independent. They were measured on simulated angles and hold the scatter of numerical
    errors. Candidates whose values differ by less than their combined σ_num share a rank. Where
    σ_num is not known it is null, and the order is that of the predictions alone.

    ``each`` is told of every trial of the estimator: its row of `design_trials`, `outside` and
    `time_s`. A grid has no trials in turn.

    Raises DldsimError for a shape or a capillary number that was not learnt, two equal cell types,
    no feasible geometry, or a pressure limit without a table of flows.
    """
    task = Task(surrogate, request, populations, chip, seed, sources, history, outlets)
    check(task)
    if request.sampler == "grid":
        trials, importance = _try_grid(task)
    else:
        import optuna

        study, trials = _try(
            task,
            optuna.samplers.TPESampler(
                n_startup_trials=request.startup_trials, multivariate=True, seed=seed
            ),
            each,
        )
        importance = _importance(study)
    feasible = trials[trials["feasible"]]
    if feasible.empty:
        broken = _broken(trials)
        keys, how = mend(broken, request)
        raise DldsimError(
            f"design request {request.name}: none of {len(trials)} trials is feasible "
            f"({', '.join(broken)}).",
            key=[*keys, "trials"],
            value=tuple(getattr(request, key) for key in [*keys, "trials"]),
            allowed="bounds and trials that meet a feasible geometry",
            remedy=f"{how} Or raise trials.",
        )
    designs = make_candidates(task, feasible)
    return Found(
        pd.DataFrame(rows_of(populations, request.name)),
        designs,
        trials.drop(columns=["outside", "time_s"]),
        tolerances(task, designs),
        importance.assign(request=request.name),
        slices(task, designs.iloc[0]),
    )


def _broken(trials: pd.DataFrame) -> list[str]:
    """The constraints that all trials violate; where there are none, all that one does, the most
    frequent first."""
    counts = Counter(text for reason in trials["reason"] for text in reason.split("; "))
    always = [text for text, count in counts.items() if count == len(trials)]
    return always or [text for text, _ in counts.most_common()]


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
        radius, gap = (
            _within(trial.suggest_float(name, *bounds), bounds)
            for name, bounds in (
                ("pillar_radius_um", request.pillar_radius_um),
                ("gap_um", request.gap_um),
            )
        )
        place = radius, gap, trial.suggest_int("periodicity", *request.periodicity)
        at = [np.array([v]) for v in place]
        limits = {name: float(np.squeeze(v)) for name, v in task.limits(*at).items()}
        broken = [name for name, value in limits.items() if value > 0]
        outside = float(task.outside(*at)[0])
        for name, value in limits.items():
            trial.set_constraint(name, value)
        trial.set_constraint("training geometries", min(outside, NONE_BETTER) - DOMAIN_TOLERANCE)
        values = dict.fromkeys(VALUES, np.nan)
        if not broken:
            values = {name: float(v[0]) for name, v in task.values(*at).items()}
        rows.append(
            {
                "request": request.name,
                "trial": trial.number,
                **dict(zip(GEOMETRY, place, strict=True)),
                **values,
                "feasible": not broken,
                "reason": "; ".join(broken),
                "outside": outside,
                "time_s": perf_counter() - start,
            }
        )
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
    """Every point of the request's grid as a trial, and the importance of its axes."""
    start = perf_counter()
    place = task.grid(task.request.grid_steps)
    limits = task.limits(*place)
    count = len(place[0])
    broken = np.array([np.broadcast_to(v, count) > 0 for v in limits.values()])
    feasible = ~broken.any(axis=0)
    values = {name: np.full(count, np.nan) for name in VALUES}
    if feasible.any():
        for name, found in task.values(*(v[feasible] for v in place)).items():
            values[name][feasible] = found
    outside = task.outside(*place)
    names = np.array(list(limits))
    trials = pd.DataFrame(
        {
            "request": task.request.name,
            "trial": np.arange(count),
            **dict(zip(GEOMETRY, place, strict=True)),
            **values,
            "feasible": feasible,
            "reason": ["; ".join(names[column]) for column in broken.T],
            "outside": outside,
            "time_s": perf_counter() - start,
        }
    )
    return trials, grid_importance(trials[feasible & (outside <= DOMAIN_TOLERANCE)])


def grid_importance(trials: pd.DataFrame) -> pd.DataFrame:
    """Share of the variance over a grid that the means over each parameter's values have."""
    total = trials["value"].var(ddof=0)
    shares = []
    for name in GEOMETRY:
        means = trials.groupby(name)["value"].transform("mean")
        shares.append(means.var(ddof=0) / total if total > 0 else np.nan)
    return pd.DataFrame(
        {
            "parameter": GEOMETRY,
            "importance": shares,
            "evaluator": "share of the variance over the grid, main effect",
        }
    )


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
    return pd.DataFrame(
        {
            "parameter": GEOMETRY,
            "importance": [known[n] for n in GEOMETRY],
            "evaluator": "PED-ANOVA, best tenth of the trials",
        }
    )


def regret(
    surrogate: Surrogate,
    request: DesignRequest,
    populations: Sequence[Population],
    chip: Chip,
    seed: int,
) -> pd.DataFrame:
    """What TPE, random and exhaustive search miss of the largest separation; `search_regret`.

    Whatever the request's objective, it is |Δθ| as predicted. A trial counts if it is feasible and
    inside the training geometries. The largest separation is that which any search found, the
    finest grid included: the true one may be larger by what falls between its points. TPE and
    random search of one repeat begin with the same random trials.
    """
    import optuna

    request = request.model_copy(update={"objective": "separation"})
    task = Task(surrogate, request, populations, chip, seed)
    check(task)
    samplers = {
        "tpe": lambda seed: optuna.samplers.TPESampler(
            n_startup_trials=request.startup_trials, multivariate=True, seed=seed
        ),
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
                {
                    "method": method,
                    "repeat": repeat,
                    "evaluations": int(n),
                    "best_deg": best.iloc[n - 1],
                    "time_s": trials["time_s"].iloc[n - 1],
                }
                for n in looks
            ]
    for steps in GRID_STEPS:
        start = perf_counter()
        evaluations, best = _exhaust(task, steps)
        rows.append(
            {
                "method": "grid",
                "repeat": 0,
                "evaluations": evaluations,
                "best_deg": best,
                "time_s": perf_counter() - start,
            }
        )
    table = pd.DataFrame(rows)
    return table.assign(
        request=request.name, regret_deg=table["best_deg"].max() - table["best_deg"]
    )


def _exhaust(task: Task, steps: int) -> tuple[int, float]:
    """Points of a grid, and the largest separation [deg] among those that count; 0 for none."""
    place = task.grid(steps)
    good = np.all(
        [np.broadcast_to(v, len(place[0])) <= 0 for v in task.limits(*place).values()], axis=0
    )
    good &= task.outside(*place) <= DOMAIN_TOLERANCE
    first, second = task.angles(*place)
    separation = np.where(good, np.abs(second - first), 0.0)
    return len(good), float(separation.max())
