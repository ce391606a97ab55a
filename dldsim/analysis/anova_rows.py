"""Rows that an analysis of variance uses, what it leaves out, and what to doubt in them."""

import numpy as np
import pandas as pd

from dldsim.analysis.design_matrix import ANGLE, DEFORMATION
from dldsim.errors import DldsimError
from dldsim.tables.user_values import as_keys, as_numbers, check_plausible, need
from dldsim.vocabulary import GEOMETRY

NEEDED = [*GEOMETRY, DEFORMATION, ANGLE]
CONDITIONS = ["cell_radius_um", "cell_shape", "height_um", "mean_velocity_mm_s"]
"""What else changes the angle, and is no factor here."""
WHERE = "Analysis of variance"

ROWS_MOST = 200_000
LEVELS_MOST = 60
"""Rows, and levels of a factor, that an analysis takes: they bound its time and memory."""
BUMP_SEEN = 0.1
"""If no angle exceeds this share of full bump, they may be given in radians."""


def usable(
    frame: pd.DataFrame, seed: int = 1
) -> tuple[pd.DataFrame, np.ndarray, list[tuple[str, str]]]:
    """Rows with all numbers, their places in the table, and notes (term, text) on the others."""
    need(frame, NEEDED, WHERE)
    data = pd.DataFrame({n: as_numbers(frame[n].reset_index(drop=True), WHERE) for n in NEEDED})
    if len(frame) and data[DEFORMATION].isna().all():
        raise DldsimError(
            f"{WHERE}: deformation_index is null in all rows. Join the table with the calibration "
            "first (the campaign's gather rule does), or fill the column with the deformation "
            "index of each cell."
        )
    for name in NEEDED:
        check_plausible(data[name], WHERE)
    reasons = pd.Series(None, data.index, dtype=object)
    for name in NEEDED:
        reasons[reasons.isna() & data[name].isna()] = f"no {name}"
        reasons[reasons.isna() & np.isinf(data[name])] = f"infinite {name}"
    notes = []
    sets = (
        as_keys(frame["stiffness_set"].reset_index(drop=True))
        if "stiffness_set" in frame
        else pd.Series(None, data.index, dtype=object)
    )
    if sets.isna().all():
        notes.append(
            (
                "stiffness_set",
                "none in the table: rows of one deformation_index count as one cell type",
            )
        )
        sets = data[DEFORMATION].map("{:.12g}".format)
    reasons[reasons.isna() & sets.isna()] = "no stiffness_set"
    data["stiffness_set"] = sets
    counts = reasons.value_counts(sort=False)
    notes += [
        (
            "rows",
            f"{count} of {len(data)} rows left out: {reason}"
            + _statuses(frame, (reasons == reason).to_numpy()),
        )
        for reason, count in counts.items()
    ]
    if reasons.notna().all():
        causes = "".join(f" ({count}: {reason})" for reason, count in counts.items())
        raise DldsimError(
            f"{WHERE}: none of the {len(frame)} rows has all of "
            f"{', '.join(NEEDED)}.{causes} Fill the columns."
        )
    places = np.flatnonzero(reasons.isna())
    _refuse_doubled(frame, places)
    if len(places) > ROWS_MOST:
        drawn = data.iloc[np.random.default_rng(seed).permutation(places)]
        repeat = drawn.groupby([*GEOMETRY, DEFORMATION, "stiffness_set"]).cumcount()
        each = max(1, ROWS_MOST // int((repeat == 0).sum()))  # of each cell equally many
        kept = np.sort(drawn.index[repeat < each][:ROWS_MOST])
        notes.append(
            (
                "rows",
                f"{len(places) - len(kept)} of {len(data)} rows left out: at most "
                f"{ROWS_MOST} are analysed, {each} of each array and cell, drawn at random "
                f"(seed {seed}) to bound the time",
            )
        )
        places = kept
    data = data.iloc[places].reset_index(drop=True)
    crowded = [n for n in GEOMETRY if data[n].nunique() > LEVELS_MOST]
    if crowded:
        raise DldsimError(
            f"{WHERE}: {crowded[0]} has {data[crowded[0]].nunique()} different values; each is a "
            f"level of its own, and at most {LEVELS_MOST} are taken. Round the column, or bin it."
        )
    return data, places, notes


def _statuses(frame: pd.DataFrame, rows: np.ndarray) -> str:
    """Statuses of these rows with their counts, if the table tells them."""
    if "status" not in frame:
        return ""
    counts = frame["status"].reset_index(drop=True)[rows].value_counts()
    return f" ({', '.join(f'status {name}: {count}' for name, count in counts.items())})" * bool(
        len(counts)
    )


def _refuse_doubled(frame: pd.DataFrame, places: np.ndarray) -> None:
    """Raise DldsimError if rows are equal in all columns."""
    rows = frame.iloc[places]
    try:
        doubled = rows.duplicated(keep=False).to_numpy()
    except TypeError:  # lists
        rows = rows.astype(str)
        doubled = rows.duplicated(keep=False).to_numpy()
    if doubled.any():
        first = rows[doubled].iloc[0]
        same = places[np.flatnonzero((rows.astype(str) == first.astype(str)).all(axis=1))][:2] + 1
        again = int(rows.duplicated().sum())
        raise DldsimError(
            f"{WHERE}: rows {same[0]} and {same[-1]} below the header are equal in all columns "
            f"({again} rows repeat others). A row that is counted twice makes effects look surer "
            "than they are: leave one of each. If they are repeated measurements that agree, add a "
            "column that tells them apart, such as replicate."
        )


def conditions(frame: pd.DataFrame) -> list[tuple[str, str]]:
    return [
        (
            name,
            f"{frame[name].nunique()} different values in the table; the models do not know "
            "it, so that its effect is in the residual or in what goes along with it",
        )
        for name in CONDITIONS
        if name in frame and frame[name].nunique() > 1
    ]


def share_of_bump(data: pd.DataFrame) -> pd.Series:
    """Angles over that of full bump."""
    return data[ANGLE] / np.degrees(np.arctan(1 / data["periodicity"]))


def doubts_of_unit(data: pd.DataFrame) -> list[str]:
    """What speaks against degrees, counted along the row shift; F and p do not depend on it."""
    share = share_of_bump(data)
    low, high, most = share.min(), share.max(), share.abs().max()
    said = (
        f"the angles reach from {data[ANGLE].min():.3g}° to {data[ANGLE].max():.3g}°, "
        f"{low:.2g} to {high:.2g} of full bump: "
    )
    unit = "; sums of squares are in the square of the column's unit, F and p do not depend on it"
    if most > 1.5:
        return [f"{said}no array moves cells so far; look at the unit, and at single rows{unit}"]
    if low < -0.5:
        return [f"{said}against the row shift; look at the sign{unit}"]
    if most <= BUMP_SEEN and BUMP_SEEN < np.degrees(most) <= 1.5:
        return [f"{said}if the column holds radians, multiply it by 57.2958{unit}"]
    return []
