"""What the surrogate says about its inputs: Sobol indices, partial dependence, fabrication risk.

Everything here is a property of the fitted surrogate, not of the simulation itself; each table says
what share of the points asked for lies inside the domain in which the surrogate interpolates.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from dldsim.analysis.anova import share_of_bump, usable
from dldsim.analysis.regressors import ANGLE, CONDITIONS, INPUTS, angle_of, learnable, share_of
from dldsim.analysis.robustness import axes_of
from dldsim.analysis.surrogate import Surrogate, fit
from dldsim.errors import DldsimError
from dldsim.experiments.migration import BUMP_FROM, ZIGZAG_TO
from dldsim.tables.user_table import as_numbers, check_plausible
from dldsim.vocabulary import GEOMETRY

DEFORMATION = "deformation_index"
SOBOL_POINTS = 1024
BOOTSTRAP = 200
CONFIDENCE = 0.95
MAP_STEPS = 15
PAIRS = (
    ("periodicity", "gap_um"),
    ("periodicity", "pillar_radius_um"),
    ("pillar_radius_um", "gap_um"),
    ("deformation_index", "gap_um"),
)
"""Pairs of the maps; the first two are the source paper's."""
DRAWS = 400
MOVED_DEG = 0.5
"""A change of the angle by more than this counts as moved."""
MODES = ("zigzag", "mixed", "bump")
WHERE = "Sobol indices"
LEARNT = 500
"""Arrays of a user's table that a surrogate is fitted to at most."""


def modes_of(share) -> np.ndarray:
    """Index into MODES after the share of the bump displacement."""
    return np.digitize(share, [ZIGZAG_TO, BUMP_FROM])


def examine(
    surrogate: Surrogate, outcomes: pd.DataFrame, settings: Mapping[str, Any], seed: int
) -> dict[str, pd.DataFrame]:
    """All tables of this module by kind; `settings`: section `fabrication` of the configuration."""
    return {
        "sobol": sobol(surrogate, outcomes, seed),
        "partial_dependence": partial_dependence(surrogate, outcomes),
        "fabrication": fabrication(
            surrogate, outcomes, settings["radius_errors_um"], seed, settings["moved_deg"]
        ),
    }


def sobol(surrogate: Surrogate, outcomes: pd.DataFrame, seed: int) -> pd.DataFrame:
    """Sobol indices of the predicted angle, a table of kind `sobol`.

    Inputs are independent and uniform between the least and largest values of the outcomes (N_p
    over whole numbers); parameters that determine each other in them (gap = radius + 10 µm) are one
    input, and the others follow from the first by interpolation between outcomes. First order: the
    share of the variance due to an input alone; total order: with all interactions it takes part
    in. Over a Sobol sequence, with bootstrap intervals of level CONFIDENCE.
    """
    from scipy.stats import qmc

    data = learnable(outcomes)
    cell = float(data["cell_radius_um"].iloc[0])
    factors = axes_of(data) + ([[DEFORMATION]] if data[DEFORMATION].nunique() > 1 else [])
    fixed = {name: float(data[name].iloc[0]) for name in [*GEOMETRY, DEFORMATION]}

    def values_of(unit: np.ndarray) -> dict[str, np.ndarray]:
        """Inputs at points (number of factors, n) of the unit cube."""
        values = {name: np.full(unit.shape[1], value) for name, value in fixed.items()}
        for factor, u in zip(factors, unit, strict=True):
            lead = factor[0]
            low, high = data[lead].min(), data[lead].max()
            if lead == "periodicity":
                values[lead] = np.minimum(np.floor(low + u * (high - low + 1)), high)
            else:
                values[lead] = low + u * (high - low)
            values |= _followers(data, factor, lead, values[lead])
        return values

    def angle(unit: np.ndarray) -> np.ndarray:
        values = values_of(np.atleast_2d(unit))
        return surrogate.predict(*(values[n] for n in [*GEOMETRY, DEFORMATION]), cell)

    count = len(factors)
    design = qmc.Sobol(2 * count, rng=np.random.default_rng(seed)).random(SOBOL_POINTS).T
    first, second = design[:count], design[count:]
    mixed = [np.where(np.arange(count)[:, None] == i, second, first) for i in range(count)]
    values = np.array([angle(unit) for unit in (first, second, *mixed)])
    if not factors or np.ptp(values) < 1e-9:
        raise DldsimError(
            "Sobol indices: the surrogate predicts the same angle everywhere; there "
            "is no variance to share out. Widen the sweep."
        )
    values -= values[:2].mean()
    draws = np.random.default_rng(seed).integers(0, SOBOL_POINTS, (BOOTSTRAP, SOBOL_POINTS))
    sampled = np.array([_indices(values[:, rows]) for rows in draws])  # (draws, order, factor)
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(sampled, [tail, 1 - tail], axis=0)
    inside = surrogate.inside_domain(
        *(values_of(first)[n] for n in [*GEOMETRY, DEFORMATION]), cell
    ).mean()
    table = {"factor": [" & ".join(factor) for factor in factors]}
    for i, (name, value) in enumerate(zip(("first", "total"), _indices(values), strict=True)):
        table |= {
            f"{name}_order": value,
            f"{name}_order_low": low[i],
            f"{name}_order_high": high[i],
        }
    return pd.DataFrame(table).assign(points=SOBOL_POINTS, inside_share=float(inside))


def _followers(data: pd.DataFrame, factor: list[str], lead: str, values) -> dict[str, np.ndarray]:
    """Values of the parameters that the outcomes tie to `lead`, by interpolation between them."""
    known = data.drop_duplicates(lead).sort_values(lead)
    return {name: np.interp(values, known[lead], known[name]) for name in factor if name != lead}


def _indices(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First and total order from values at A, B and A with each column of B, (2 + factors, n).

    Saltelli et al. (2010), doi:10.1016/j.cpc.2009.09.018, table 2, rows (b) and (f). The values are
    centred.
    """
    a, b, mixed = values[0], values[1], values[2:]
    variance = values[:2].var()
    return (
        (b * (mixed - a)).mean(axis=1) / variance,
        ((a - mixed) ** 2).mean(axis=1) / (2 * variance),
    )


def sobol_of_table(frame: pd.DataFrame, seed: int) -> tuple[pd.DataFrame, list[str]]:
    """Sobol indices of anybody's table with the columns that `anova` needs, and notes.

    A surrogate is fitted first, to the rows that `anova` uses. It knows angles between zigzag and
    full bump, while the indices of an angle do not depend on its unit or sign, so that it is given
    angles scaled and turned to reach from there to there: the largest becomes full bump. Rows of
    the same inputs are averaged, and of many rows those of LEARNT arrays are taken, drawn at
    random. Where the table tells no cell radius, half of the mean gap is assumed: a common radius
    cancels in every feature but for constants.

    Raises DldsimError as `usable` and `surrogate.fit` do, and if the surrogate does not vary.
    """
    data, places, notes = usable(frame, seed)
    notes = [f"{term}: {note}" for term, note in notes]
    data = data.assign(cell_radius_um=np.exp(np.log(data["gap_um"]).mean()) / 2, status="decided")
    if "cell_radius_um" in frame and frame["cell_radius_um"].notna().any():
        radius = as_numbers(frame["cell_radius_um"].reset_index(drop=True), WHERE)
        check_plausible(radius, WHERE)
        data["cell_radius_um"] = radius.to_numpy()[places]
    for name in CONDITIONS:
        if name in frame:
            given = frame[name].iloc[places].astype(object)
            data[name] = given.where(given.notna(), None).to_numpy()
    unusable = ~np.isfinite(data["cell_radius_um"])
    if unusable.any():
        notes.append(f"rows: {int(unusable.sum())} of {len(data)} rows left out: no cell_radius_um")
        data = data[~unusable]
    share = share_of_bump(data)
    scale = np.abs(share).max()
    if scale > 0:
        data[ANGLE] *= (-1 if share.mean() < 0 else 1) / scale
    if share.mean() < 0:
        notes.append(f"{ANGLE}: counted against the row shift, turned for the surrogate")
    same = [*INPUTS, *(name for name in CONDITIONS if name in data)]
    means = data.groupby(same, as_index=False, dropna=False).agg({ANGLE: "mean", "status": "first"})
    if len(means) < len(data):
        notes.append(
            f"rows: {len(data)} rows are repeats of {len(means)}; the surrogate learns "
            "from their means"
        )
    arrays = means[GEOMETRY].drop_duplicates()
    if len(arrays) > LEARNT:
        kept = arrays.sample(LEARNT, random_state=np.random.default_rng(seed))
        notes.append(
            f"arrays: {len(arrays) - LEARNT} of {len(arrays)} left out: the surrogate "
            f"learns from {LEARNT}, drawn at random (seed {seed}) to bound the time"
        )
        means = means.merge(kept, on=GEOMETRY)
    means["outcome_id"] = [f"row{i:06d}" for i in range(len(means))]
    return sobol(fit(means, seed), means, seed), notes


def partial_dependence(surrogate: Surrogate, outcomes: pd.DataFrame) -> pd.DataFrame:
    """Predicted angle over pairs of inputs, a table of kind `partial_dependence`.

    At each point of a grid the two inputs are set and the others taken from every run in turn; the
    mean is over those combinations that lie inside the domain, null where none does (an average
    over arrays that were never near the data would say nothing). Parameters that determine each
    other in the outcomes are set together.
    """
    data = learnable(outcomes)
    distinct = data[INPUTS].drop_duplicates()
    axes = axes_of(data)
    parts = []
    for pair in PAIRS:
        tied = {name: factor for factor in axes for name in factor if name in pair}
        if (data[list(pair)].nunique() < 2).any() or tied.get(pair[0]) is tied.get(pair[1]):
            continue
        grids = [_steps(data[name], name == "periodicity") for name in pair]
        first, second = (v.ravel() for v in np.meshgrid(*grids, indexing="ij"))
        moved = {*pair, *(name for factor in tied.values() for name in factor)}
        others = distinct.drop(columns=list(moved)).drop_duplicates()
        frame = pd.concat([others] * len(first), ignore_index=True)
        for name, values in zip(pair, (first, second), strict=True):
            frame[name] = values = np.repeat(values, len(others))
            for other, follows in _followers(data, tied.get(name, []), name, values).items():
                frame[other] = follows
        at = [frame[name] for name in INPUTS]
        inside = surrogate.inside_domain(*at).reshape(len(first), -1)
        angle = surrogate.predict(*at).reshape(len(first), -1)
        share = share_of(angle, frame["periodicity"].to_numpy().reshape(angle.shape))
        parts.append(
            pd.DataFrame(
                {
                    "x_name": pair[0],
                    "y_name": pair[1],
                    "x": first,
                    "y": second,
                    "angle_deg": _mean_where(angle, inside),
                    "share": _mean_where(share, inside),
                    "inside_share": inside.mean(axis=1),
                }
            )
        )
    return pd.concat(parts, ignore_index=True)


def _steps(values: pd.Series, whole: bool) -> np.ndarray:
    low, high = values.min(), values.max()
    return np.arange(low, high + 1) if whole else np.linspace(low, high, MAP_STEPS)


def _mean_where(values: np.ndarray, good: np.ndarray) -> np.ndarray:
    count = good.sum(axis=1)
    total = np.where(good, values, 0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def fabrication(
    surrogate: Surrogate,
    outcomes: pd.DataFrame,
    errors_um: Sequence[float],
    seed: int,
    moved_deg: float = MOVED_DEG,
) -> pd.DataFrame:
    """What an error of the pillar radius does to every run's array, a table of kind `fabrication`.

    The mask fixes the pitch; pillars come out too thick or too thin, all alike, by δ ~ N(0, error),
    so that P_r becomes P_r + δ and P_g becomes P_g − 2δ. By Monte Carlo on the surrogate, with the
    same δ for all arrays. Modes are those of the surrogate, at nominal size and with the error;
    `simulated_mode` stands beside so that one sees where the surrogate is wrong to begin with.
    """
    data = learnable(outcomes)
    draw = np.random.default_rng(seed).standard_normal(DRAWS)
    draw = np.concatenate([draw, -draw])
    keys = [*GEOMETRY, "stiffness_set", DEFORMATION, "cell_radius_um"]
    nominal = surrogate.share(*(data[name] for name in INPUTS))
    parts = []
    for error in errors_um:
        size = error * draw
        radius = np.maximum(data["pillar_radius_um"].to_numpy()[:, None] + size, 1e-3)
        gap = np.maximum(data["gap_um"].to_numpy()[:, None] - 2 * size, 1e-3)
        at = [radius.ravel(), gap.ravel()]
        at += [np.repeat(data[name].to_numpy(), len(draw)) for name in INPUTS[2:]]
        share = surrogate.share(*at).reshape(len(data), -1)
        rows = data["periodicity"].to_numpy()[:, None]
        angle, centre = angle_of(share, rows), angle_of(nominal[:, None], rows)
        quarter = slice(0, len(draw) // 8)
        inside = surrogate.inside_domain(
            radius[:, quarter].ravel(),
            gap[:, quarter].ravel(),
            *(np.repeat(data[name].to_numpy(), len(draw) // 8) for name in INPUTS[2:]),
        ).reshape(len(data), -1)
        parts.append(
            data[keys].assign(
                radius_error_um=float(error),
                moved_limit_deg=float(moved_deg),
                predicted_angle_deg=centre[:, 0],
                predicted_mode=np.array(MODES)[modes_of(nominal)],
                simulated_mode=data["mode"].to_numpy() if "mode" in data else "",
                mode_change_probability=(modes_of(share) != modes_of(nominal)[:, None]).mean(
                    axis=1
                ),
                moved_probability=(np.abs(angle - centre) > moved_deg).mean(axis=1),
                angle_std_deg=angle.std(axis=1),
                inside_share=inside.mean(axis=1),
            )
        )
    return pd.concat(parts, ignore_index=True)
