"""What a surrogate, and the outcomes behind it, say of the motion of a population in an array."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from dldsim.analysis.conformal import spread_of
from dldsim.analysis.domain import NAMES
from dldsim.analysis.features import CellInFlow, share_of
from dldsim.analysis.surrogate import Surrogate
from dldsim.config.sections import Geometry
from dldsim.design.outlets import MODES, Cells, Predictor
from dldsim.design.populations import Population
from dldsim.experiments.migration import BUMP_FROM, ZIGZAG_TO
from dldsim.vocabulary import DECIDED

FEWEST = 5
"""Outcomes of a mode from which its lags are taken; of fewer, those of all modes are."""
LEVELS = np.linspace(0, 0.99, 100)
NUMERICAL_GAP = 0.05
"""Relative standard deviation of the gap at which a mode changes: the transition distance of the
reference study was off by σ_d = 0.05 and 0.1 row shifts on its two sides, and falls by 0.6 and 2
for a unit of ln P_g there. Four critical gaps moved by up to 3.6 % with half the lag and by up to
1.4 % on finer lattices (docs/reference.md). What the contact's reach does to them is not in it."""
SAME = 1e-4
"""Relative difference of lengths and Ca that counts as none."""
BEYOND = 1e3
"""Stands for an infinite error, which reaches every share."""


class History(NamedTuple):
    """What settled outcomes show beside their angles.

    ``lags``: by mode, how far cells fall behind in the first array period, in pitches, rising;
    ``coexisting``: share of the outcomes between the modes in which motions coexist. ``notes``:
    what is not known.
    """

    lags: dict[str, np.ndarray]
    coexisting: float
    notes: tuple[str, ...] = ()


def history_of(outcomes: pd.DataFrame, shape: str) -> History:
    """History of the cells of one shape, or of all where there are too few.

    A cell that takes a share f of the bump displacement in the first N_p rows, from mid-gap, and b
    once it has settled, falls behind by (b − f) λ. What it still loses between the first period and
    the row in which it settles is not counted: in the runs of the preset `quick` 0.03 to 0.08 λ in
    the mean of those that bump, and nothing for others.
    """
    done = outcomes[outcomes["status"].isin(DECIDED) & outcomes["migration_angle_deg"].notna()]
    own = done[done["cell_shape"] == shape]
    notes = []
    if len(own) < FEWEST:
        notes.append(f"few outcomes of shape {shape}: transients are those of all shapes")
        own = done
    rows = own["periodicity"].to_numpy(float)
    settled = share_of(own["migration_angle_deg"].to_numpy(float), rows)
    lag = settled - share_of(own["source_angle_deg"].to_numpy(float), rows)
    between = (settled > ZIGZAG_TO) & (settled < BUMP_FROM)
    mode = np.select([settled >= BUMP_FROM, between], ["bump", "mixed"], "zigzag")
    coexist = own["status"].to_numpy() == "coexisting"
    known = np.isfinite(lag) & ~coexist
    if not known.any():
        notes.append("no outcome says how far cells fall behind before they settle: taken as none")
    pooled = np.sort(lag[known]) if known.any() else np.zeros(1)
    lags = {}
    for name in MODES:
        found = np.sort(lag[known & (mode == name)])
        lags[name] = found if len(found) >= FEWEST else pooled
    mixed = coexist[between]
    return History(lags, float(mixed.mean()) if len(mixed) else 0.0, tuple(notes))


UNKNOWN = History({mode: np.zeros(1) for mode in MODES}, 0.0, ("transients are not known",))
"""Where there are no outcomes to learn transients from."""


def simulated_in(
    outcomes: pd.DataFrame, geometry: Geometry, population: Population
) -> dict[str, Any] | None:
    """The row of `outcomes` with an angle of the population's mean cell in this very array, at its
    Ca, height and shape; None where there is none."""
    wanted = {
        **geometry.model_dump(),
        "cell_radius_um": population.radius_um,
        "height_um": population.flow.height_um,
        "capillary_number": population.capillary_number,
    }
    same = (outcomes["cell_shape"] == population.shape) & outcomes["migration_angle_deg"].notna()
    for name, value in wanted.items():
        same &= np.isclose(outcomes[name].astype(float), value, rtol=SAME, atol=0)
    found = outcomes[same]
    if found.empty:
        return None
    row = found.iloc[0]
    return {name: None if value is None or value != value else value for name, value in row.items()}


class Motion(NamedTuple):
    """``inside``: whether cells (C,) are within what was learnt; ``beyond``: what those outside are
    beyond of, ``basis``: what the motion rests on, in words."""

    predictor: Predictor
    inside: Callable[[Cells], np.ndarray]
    basis: str
    beyond: str


def motion_of(
    model: Surrogate,
    population: Population,
    geometry: Geometry,
    history: History,
    simulated: Mapping[str, Any] | None = None,
) -> Motion:
    """The motion of a population in an array, or in arrays of this periodicity nearly as large.

    The error of the prediction is drawn from its conformal scores; of cells outside of what was
    learnt nothing is known, and it is as large as the range of shares. ``simulated``: a row of
    `outcomes` of the population's mean cell in this array. What the prediction is off by is then
    known, in units of the scale of its error, and is taken for all cells of the population; drawn
    is only where in its interval the settled motion lies.
    """
    rows, shape = geometry.periodicity, population.shape
    height = population.flow.height_um

    def in_flow(radius, ks) -> CellInFlow:
        return CellInFlow(shape, radius, height, population.capillary(ks))

    def share(pillar_radius, gap, radius, ks) -> np.ndarray:
        return model.share(pillar_radius, gap, rows, in_flow(radius, ks))

    def inside(cells: Cells) -> np.ndarray:
        place = geometry.pillar_radius_um, geometry.gap_um, rows
        return model.inside_domain(*place, in_flow(cells.radius_um, cells.ks_uN_per_m))

    limits = tuple(model.card["conformal"]["range"])
    place = np.array([geometry.pillar_radius_um]), np.array([geometry.gap_um])
    mean = np.array([population.radius_um]), np.array([population.stiffness.ks_uN_per_m])
    predicted = float(share(*place, *mean)[0])
    learnt: Callable[[Cells], np.ndarray] | None = None
    if simulated is None or simulated.get("migration_angle_deg") is None:
        learnt = inside
        scores = model.card["conformal"]["scores"].get(shape, [])
        off = _conformal(scores, predicted, limits)
        coexisting, basis = history.coexisting, "predicted"
    else:
        off = _known(predicted, simulated, limits)
        coexisting = float(simulated["status"] == "coexisting")
        basis = f"simulated in this array: {simulated['status']}"
    numerical = gap_error(model)
    unknown = () if numerical else ("numerical error not studied",)
    notes = "; ".join([basis, *unknown, *history.notes])
    predictor = Predictor(share, off, numerical, limits, history.lags, coexisting, learnt)
    beyond = (
        height_not_learnt(model, population) or "array, radius or Ca outside of what was learnt"
    )
    return Motion(predictor, inside, notes, beyond)


def height_not_learnt(model: Surrogate, population: Population) -> str | None:
    """That the channel height over radius of a cell type was not learnt, in words; None if it was.

    Of a shape that was not learnt at all nothing is said.
    """
    domain = model.domains.get(population.shape)
    if domain is None or domain.holds(population.cell_at(domain.capillary_number[0]))[0]:
        return None
    height = population.flow.height_um / population.radius_um
    return (
        f"height/R {height:.3g} of cell type {population.number} was not learnt "
        f"({NAMES[population.shape]}: {domain.words})"
    )


def gap_error(model: Surrogate) -> float:
    """Relative standard deviation of a critical gap by the numerics; 0 where they were not studied.

    NUMERICAL_GAP is that of the numerics of the reference study, which alone give σ_num.
    """
    return NUMERICAL_GAP if model.card["numerical_uncertainty"]["share_by_mode"] else 0.0


def _conformal(
    scores: Sequence[Sequence[float]], predicted: float, limits: tuple[float, float]
) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Shares with the error at a signed level of the conformal interval.

    Where the share of the mean cell, ``predicted``, leaves no room for an error on the side that
    was drawn, and the other side does, the error is on the other side: there it was seen.
    """
    factors = error_factors(scores)
    up, down = limits[1] - predicted, predicted - limits[0]

    def off(share: np.ndarray, deviate: np.ndarray) -> np.ndarray:
        factor = np.interp(np.abs(deviate), LEVELS, factors)
        error = factor * spread_of(predicted)
        room, other = np.where(deviate > 0, up, down), np.where(deviate > 0, down, up)
        turned = (error > room) & (error <= other)
        sign = np.where(turned, -1, 1) * np.sign(deviate)
        return np.clip(share + sign * factor * spread_of(share), *limits)

    return off


def error_factors(scores: Sequence[Sequence[float]]) -> np.ndarray:
    """`conformal_factor` of the scores of each geometry at all of LEVELS."""
    if not scores:
        return np.full(len(LEVELS), BEYOND)
    sizes = np.array([len(s) for s in scores])
    values = np.concatenate([np.asarray(s, float) for s in scores])
    order = np.argsort(values)
    reached = np.cumsum(np.repeat(1 / sizes, sizes)[order]) / (len(scores) + 1)
    at = np.searchsorted(reached, LEVELS - 1e-12)
    return np.append(values[order], BEYOND)[at]


def _known(
    predicted: float, simulated: Mapping[str, Any], limits: tuple[float, float]
) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Shares moved as the simulated one differs from that predicted, anywhere in its interval."""
    rows = simulated["periodicity"]
    ends = [
        share_of(simulated["migration_angle_deg"] if angle is None else angle, rows)
        for angle in (simulated["angle_low_deg"], simulated["angle_high_deg"])
    ]

    def off(share: np.ndarray, deviate: np.ndarray) -> np.ndarray:
        wanted = ends[0] + (ends[1] - ends[0]) * (deviate + 1) / 2
        score = (wanted - predicted) / spread_of(predicted)
        return np.clip(share + score * spread_of(share), *limits)

    return off
