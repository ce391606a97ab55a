"""Sobol indices of anybody's table, by a surrogate that is fitted to it."""

import numpy as np
import pandas as pd

from dldsim.analysis.anova_rows import share_of_bump, usable
from dldsim.analysis.benchmark import groups_of, tune
from dldsim.analysis.domain import DOMAIN_TOLERANCE, domains_of
from dldsim.analysis.features import (
    ANGLE,
    CELL,
    INDEX,
    INPUTS,
    SHAPES,
    CellInFlow,
    features,
    inputs_and_angles,
    learnable,
)
from dldsim.analysis.regressors import ON_INDEX, SURROGATE, make_regressors
from dldsim.analysis.sensitivity import indices, sobol
from dldsim.analysis.surrogate import fit
from dldsim.errors import DldsimError
from dldsim.tables.user_values import as_numbers, check_plausible
from dldsim.vocabulary import GEOMETRY

WHERE = "Sobol indices"
LEARNT = 500
"""Arrays of a table that a surrogate is fitted to at most."""


def sobol_of_table(frame: pd.DataFrame, seed: int) -> tuple[pd.DataFrame, list[str]]:
    """Sobol indices of anybody's table with the columns that `anova` needs, and notes.

    A surrogate is fitted first, to what `table_learnt` makes of the rows: with the capillary number
    as the input where the table tells it for each, else with the deformation index.

    Raises DldsimError as `table_learnt` and `surrogate.fit` do, and if the surrogate does not vary.
    """
    means, notes = table_learnt(frame, seed)
    if means["capillary_number"].nunique() > 1:
        return sobol(fit(means, seed), means, seed), notes
    notes.append("capillary_number: not told for each row, the deformation index stands for it")
    data = learnable(means)
    x, y = inputs_and_angles(data, by_index=True)
    prototype, grid, _ = make_regressors(seed)[SURROGATE + ON_INDEX]
    model, _ = tune(prototype, grid, x, y, groups_of(data, "geometry"), seed)
    model.fit(x, y)
    known = domains_of(data)
    low, high = data[INDEX].min(), data[INDEX].max()

    def predict(radius, gap, rows, cell: CellInFlow) -> np.ndarray:
        return model.predict(features(radius, gap, rows, cell, cell.capillary_number))

    def inside(radius, gap, rows, cell: CellInFlow) -> np.ndarray:
        index, shape = cell.capillary_number, np.asarray(cell.shape, str)
        held = (index >= low) & (index <= high)
        near = [
            (shape == name) & (own.distance_outside(radius, gap, rows, cell) <= DOMAIN_TOLERANCE)
            for name, own in known.items()
        ]
        return held & np.any(near, axis=0)

    return indices(data, [*CELL[:-1], INDEX], predict, inside, seed), notes


def table_learnt(frame: pd.DataFrame, seed: int) -> tuple[pd.DataFrame, list[str]]:
    """What a surrogate learns of anybody's table, and notes: the rows that `anova` uses.

    The surrogate knows angles between zigzag and full bump, while the indices of an angle do not
    depend on its unit or sign, so that it is given angles scaled and turned to reach from there to
    there: the largest becomes full bump. Rows of the same inputs are averaged, and of many rows
    those of LEARNT arrays are taken, drawn at random. Where the table tells no cell radius, half of
    the mean gap is assumed: a common radius cancels in every feature but for constants. Likewise
    cells are discs without top and bottom where it tells no shape and no height, and their
    capillary number is 1 where it does not tell that of every row.

    Raises DldsimError as `usable` does, for values that a column cannot hold, and where velocities
    differ without a capillary number.
    """
    data, places, notes = usable(frame, seed)
    notes = [f"{term}: {note}" for term, note in notes]
    typical = np.exp(np.log(data["gap_um"]).mean()) / 2
    data = data.assign(
        status="decided",
        cell_shape=_told(frame, "cell_shape", places, SHAPES[0]),
        **{
            name: _numbers(frame, name, places, other)
            for name, other in (
                ("cell_radius_um", typical),
                ("height_um", 0.0),
                ("capillary_number", 1.0),
            )
        },
    )
    if data["capillary_number"].isna().any():
        data["capillary_number"] = 1.0
    if data["capillary_number"].nunique() == 1 and "mean_velocity_mm_s" in frame:
        velocities = frame["mean_velocity_mm_s"].iloc[places].nunique()
        if velocities > 1:
            raise DldsimError(
                f"{WHERE}: the rows differ in mean_velocity_mm_s and none tells its "
                "capillary_number, in which a surrogate learns the velocity.",
                key="capillary_number",
                allowed="a number for each row",
                remedy="Add the column, μU/k_s, or give one table for each velocity.",
            )
    unusable = data[["cell_shape", "cell_radius_um", "height_um"]].isna().any(axis=1)
    if unusable.any():
        notes.append(
            f"rows: {int(unusable.sum())} of {len(data)} rows left out: no cell_radius_um, "
            "height_um or cell_shape"
        )
        data = data[~unusable]
    share = share_of_bump(data)
    scale = np.abs(share).max()
    if scale > 0:
        data[ANGLE] *= (-1 if share.mean() < 0 else 1) / scale
    if share.mean() < 0:
        notes.append(f"{ANGLE}: counted against the row shift, turned for the surrogate")
    same = [*INPUTS, INDEX]
    means = data.groupby(same, as_index=False).agg({ANGLE: "mean", "status": "first"})
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
    return means, notes


def _told(frame: pd.DataFrame, name: str, places: np.ndarray, otherwise) -> np.ndarray:
    """A column of a table at these rows, null where it tells nothing; `otherwise` without any."""
    if name not in frame or frame[name].isna().all():
        return np.full(len(places), otherwise)
    given = frame[name].iloc[places].astype(object)
    return given.where(given.notna(), None).to_numpy()


def _numbers(frame: pd.DataFrame, name: str, places: np.ndarray, otherwise: float) -> np.ndarray:
    """The same of a column of numbers, checked."""
    if name not in frame or frame[name].isna().all():
        return np.full(len(places), otherwise)
    values = as_numbers(frame[name].reset_index(drop=True), WHERE)
    check_plausible(values, WHERE)
    return values.to_numpy()[places]
