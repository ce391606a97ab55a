"""What the surrogate says about its inputs: Sobol indices, partial dependence, fabrication risk.

Everything here is a property of the fitted surrogate, not of the simulation itself; each table says
what share of the points asked for lies inside the domain in which the surrogate interpolates.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from dldsim.analysis.features import (
    CELL,
    INPUTS,
    CellInFlow,
    angle_of,
    cells_of,
    learnable,
    share_of,
)
from dldsim.analysis.robustness import axes_of
from dldsim.analysis.surrogate import Surrogate
from dldsim.errors import DldsimError
from dldsim.experiments.migration import BUMP_FROM, ZIGZAG_TO
from dldsim.tables.registry import TABLES
from dldsim.vocabulary import GEOMETRY

Asked = Callable[..., np.ndarray]
SOBOL_POINTS = 1024
BOOTSTRAP = 200
CONFIDENCE = 0.95
MAP_STEPS = 15
PAIRS = (
    ("periodicity", "gap_um"),
    ("periodicity", "pillar_radius_um"),
    ("pillar_radius_um", "gap_um"),
    ("capillary_number", "gap_um"),
)
"""Pairs of the maps; the first two are the source paper's."""
DRAWS = 400
MOVED_DEG = 0.5
"""A change of the angle by more than this counts as moved."""
MODES = ("zigzag", "mixed", "bump")


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
    """Sobol indices of the predicted angle, a table of kind `sobol`; see `indices`."""
    return indices(learnable(outcomes), CELL, surrogate.predict, surrogate.inside_domain, seed)


def indices(
    data: pd.DataFrame, cell: Sequence[str], predict: Asked, inside: Asked, seed: int
) -> pd.DataFrame:
    """Sobol indices of a predicted angle over the inputs that vary in `data`.

    ``cell``: columns of what moves, in the order of `CellInFlow`; ``predict`` and ``inside`` are
    asked with (P_r, P_g, N_p, cell). Inputs are independent and uniform between the least and
    largest values of the outcomes, Ca in its logarithm, N_p over whole numbers, shapes each as
    often; parameters that determine each other in them (gap = radius + 10 µm) are one input, and
    the others follow from the first by interpolation between outcomes. First order: the share of
    the variance due to an input alone; total order: with all interactions it takes part in. Over a
    Sobol sequence, with bootstrap intervals of level CONFIDENCE.

    Raises DldsimError if the prediction does not vary.
    """
    from scipy.stats import qmc

    factors = axes_of(data) + [[name] for name in cell if data[name].nunique() > 1]
    fixed = {name: data[name].iloc[0] for name in [*GEOMETRY, *cell]}

    def at(unit: np.ndarray) -> tuple:
        """Inputs at points (number of factors, n) of the unit cube."""
        values = {name: np.full(unit.shape[1], value) for name, value in fixed.items()}
        for factor, u in zip(factors, unit, strict=True):
            lead = factor[0]
            values[lead] = _spread_out(data[lead], u)
            values |= _followers(data, factor, lead, values[lead])
        return *(values[n] for n in GEOMETRY), CellInFlow(*(values[n] for n in cell))

    count = len(factors)
    design = qmc.Sobol(2 * count, rng=np.random.default_rng(seed)).random(SOBOL_POINTS).T
    first, second = design[:count], design[count:]
    mixed = [np.where(np.arange(count)[:, None] == i, second, first) for i in range(count)]
    values = np.array([predict(*at(unit)) for unit in (first, second, *mixed)])
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
    table = {"factor": [" & ".join(factor) for factor in factors]}
    for i, (name, value) in enumerate(zip(("first", "total"), _indices(values), strict=True)):
        table |= {
            f"{name}_order": value,
            f"{name}_order_low": low[i],
            f"{name}_order_high": high[i],
        }
    share = float(np.mean(inside(*at(first))))
    return pd.DataFrame(table).assign(points=SOBOL_POINTS, inside_share=share)


def _spread_out(values: pd.Series, unit: np.ndarray) -> np.ndarray:
    """Values of an input over its range, at places 0 to 1."""
    if values.name == "cell_shape":
        names = np.unique(values)
        return names[np.minimum((unit * len(names)).astype(int), len(names) - 1)]
    low, high = values.min(), values.max()
    if values.name == "periodicity":
        return np.minimum(np.floor(low + unit * (high - low + 1)), high)
    if values.name == "capillary_number":
        return low * (high / low) ** unit
    return low + unit * (high - low)


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
        grids = [_steps(data[name]) for name in pair]
        first, second = (v.ravel() for v in np.meshgrid(*grids, indexing="ij"))
        moved = {*pair, *(name for factor in tied.values() for name in factor)}
        others = distinct.drop(columns=list(moved)).drop_duplicates()
        frame = pd.concat([others] * len(first), ignore_index=True)
        for name, values in zip(pair, (first, second), strict=True):
            frame[name] = values = np.repeat(values, len(others))
            for other, follows in _followers(data, tied.get(name, []), name, values).items():
                frame[other] = follows
        at = *(frame[name].to_numpy() for name in GEOMETRY), cells_of(frame)
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
    if not parts:  # one factor alone varies
        return pd.DataFrame(columns=TABLES["partial_dependence"].names)
    return pd.concat(parts, ignore_index=True)


def _steps(values: pd.Series) -> np.ndarray:
    if values.name == "periodicity":
        return np.arange(values.min(), values.max() + 1)
    return _spread_out(values, np.linspace(0, 1, MAP_STEPS))


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
    keys = [*GEOMETRY, "stiffness_set", "capillary_number", "cell_radius_um"]
    rows, cells = data["periodicity"].to_numpy(), cells_of(data)
    nominal = surrogate.share(data["pillar_radius_um"], data["gap_um"], rows, cells)
    parts = []
    for error in errors_um:
        size = error * draw
        radius = np.maximum(data["pillar_radius_um"].to_numpy()[:, None] + size, 1e-3)
        gap = np.maximum(data["gap_um"].to_numpy()[:, None] - 2 * size, 1e-3)
        share = surrogate.share(*_each(radius, gap, rows, cells)).reshape(len(data), -1)
        angle, centre = angle_of(share, rows[:, None]), angle_of(nominal, rows)[:, None]
        part = slice(0, len(draw) // 8)
        inside = surrogate.inside_domain(*_each(radius[:, part], gap[:, part], rows, cells))
        inside = inside.reshape(len(data), -1)
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


def _each(radius: np.ndarray, gap: np.ndarray, rows: np.ndarray, cells: CellInFlow) -> tuple:
    """Arguments of a prediction for every size (outcomes, sizes) of the arrays of outcomes."""
    count = radius.shape[1]
    repeated = CellInFlow(*(np.repeat(values, count) for values in cells))
    return radius.ravel(), gap.ravel(), np.repeat(rows, count), repeated
