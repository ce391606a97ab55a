"""Permutation tests of the terms of a linear model."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from dldsim.analysis.design_matrix import ANGLE, NUMERIC, Term, basis, label, width
from dldsim.vocabulary import GEOMETRY

PERMUTATIONS = 999
FEWEST = 99
"""With fewer permutations a p-value says nothing worth the time."""
VALUES = 3e7
PRODUCTS = 2e10
"""Permuted values, and their products with design columns, that a model may cost at most."""
LEAST_COMPLETE = 0.8
"""Share of the rows that geometries with all stiffness sets must hold for a permutation test."""


def permutation(
    data: pd.DataFrame, terms: Sequence[Term], seed: int
) -> tuple[dict[Term, float], list[str]]:
    """p-value of each term by permutation of residuals (Freedman & Lane 1983), and notes.

    The residuals of the model without the term (and without what contains it) are permuted and put
    back on its fit. Rows of one geometry share most of their lack of fit, hence what is permuted
    are whole geometries, with all their stiffness sets; for the deformation index or ln Ca alone,
    the sets within each geometry, each with its repeats. Only geometries with all sets, each in the
    same number of rows, take part. The notes say why there is none, or why there are fewer
    permutations than PERMUTATIONS: they are as many as VALUES and PRODUCTS allow.
    """
    sets = data["stiffness_set"].nunique()
    group = data.groupby(GEOMETRY).ngroup()
    rows = data.groupby([group, "stiffness_set"]).size()
    by_group = rows.groupby(level=0)
    full_groups = by_group.size()[(by_group.size() == sets) & (by_group.nunique() == 1)].index
    if full_groups.empty:
        return {}, [f"no p by permutation: no geometry has all {sets} cells equally often"]
    sizes = by_group.first()[full_groups]
    repeats = int(sizes.mode().iloc[0])
    complete = group.isin(sizes[sizes == repeats].index)
    work = data[complete].assign(group=group[complete])
    work = work.sort_values(["group", "stiffness_set"], kind="stable").reset_index(drop=True)
    block = sets * repeats
    count = len(work) // block
    if count < 5:
        return {}, [
            f"no p by permutation: {count} geometries have all {sets} cells equally often, "
            "at least 5 are needed"
        ]
    if len(work) < LEAST_COMPLETE * len(data):
        return {}, [
            f"no p by permutation: geometries with all {sets} cells, {repeats} times each, "
            f"hold {len(work)} of {len(data)} rows, at least {LEAST_COMPLETE:.0%} are "
            "needed"
        ]
    cells = work.groupby(["group", "stiffness_set"], as_index=False, sort=True)
    for number in (n for n in NUMERIC if (n,) in terms):
        if (cells[number].nunique()[number] > 1).any():
            return {}, [f"no p by permutation: {number} differs among repeats of a cell"]
    # repeats move with their cell, so that their scatter stays what it is, and their mean counts
    scatter = float((cells[ANGLE].var(ddof=0)[ANGLE] * repeats).sum())
    work = cells.first().assign(**{ANGLE: cells[ANGLE].mean()[ANGLE] * repeats**0.5})
    cost = len(work) * (1 + width(work, terms)) * len(terms)
    draws = int(min(PERMUTATIONS, VALUES / len(work), PRODUCTS / cost))
    if draws < FEWEST:
        return {}, [
            f"no p by permutation: {len(work)} cells allow {draws} permutations in the "
            f"time that there is, at least {FEWEST} are needed"
        ]
    notes = []
    if draws < PERMUTATIONS:
        notes = [
            f"p by permutation: {draws} permutations instead of {PERMUTATIONS}, to bound the "
            f"time for {len(work)} cells; the least p is {1 / (1 + draws):.2g}"
        ]
    full = basis(work, terms)
    if full.shape[1] >= len(work) and not scatter:
        return {}, ["no p by permutation: the rows of complete geometries determine the model"]
    y = work[ANGLE].to_numpy()
    rng = np.random.default_rng(seed)
    whole = np.argsort(rng.random((draws, count)), axis=1)
    within = np.argsort(rng.random((draws, count, sets)), axis=2)
    blocks = (whole[:, :, None] * sets + np.arange(sets)).reshape(draws, -1)
    swaps = (np.arange(count)[:, None] * sets + within).reshape(draws, -1)
    found = {}
    for term in terms:
        alone = len(term) == 1 and term[0] in NUMERIC
        if alone and sets < 2:
            notes.append(f"{label(term)}: no p by permutation with one cell per geometry")
            continue
        kept = [t for t in terms if not set(term) <= set(t)]
        less = basis(work, kept)
        beside = basis(work, [*kept, term])  # Type II: what contains the term is left out of both
        rest = y - less @ (less.T @ y)
        sample = np.vstack([rest, rest[swaps if alone else blocks]]).T
        ratio = _ratio(sample, less, beside, full, scatter)
        found[term] = float((1 + (ratio[1:] >= ratio[0] * (1 - 1e-9)).sum()) / (1 + draws))
    return found, notes


def _ratio(
    sample: np.ndarray, less: np.ndarray, beside: np.ndarray, full: np.ndarray, scatter: float
) -> np.ndarray:
    """What a term explains of each column over what the model leaves of it.

    Columns are residuals, permuted or not, of the model without the term. Its fit, on which they
    would be put back, lies in the span of all of these bases and changes neither.
    """

    def explained(columns: np.ndarray) -> np.ndarray:
        return ((columns.T @ sample) ** 2).sum(axis=0)

    rest = (sample**2).sum(axis=0) - explained(full) + scatter
    return (explained(beside) - explained(less)) / np.maximum(rest, 1e-300)
