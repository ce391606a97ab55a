"""Measured cells of a population, from a user's table: radii, and what tells their stiffness."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from dldsim.errors import DldsimError
from dldsim.tables.user_table import read_user_table
from dldsim.tables.user_values import as_numbers, check_plausible, need

RADIUS, INDEX, STIFFNESS = "radius_um", "deformation_index", "ks_uN_per_m"
FEWEST = 2


class Measured(NamedTuple):
    """Cells of one population in the order of their radii, (n,) each; index and spring constant
    are None where they were not measured. ``notes``: what had to be found out to read them."""

    source: str
    radius_um: np.ndarray
    deformation_index: np.ndarray | None
    ks_uN_per_m: np.ndarray | None
    notes: list[str]

    def place(self, level: np.ndarray) -> np.ndarray:
        """Indices of cells at levels 0 to 1 of the radii."""
        return np.minimum((level * len(self.radius_um)).astype(int), len(self.radius_um) - 1)


def read_measured(source: Path | bytes, where: str | None = None) -> Measured:
    """Cells of a CSV or Parquet table: radius_um and, if it was measured, deformation_index or
    ks_uN_per_m, in which all values are positive.

    Rows that lack a value of these columns are left out, and a note says how many. Raises
    DldsimError for other units, missing columns, values that no cell has, and fewer than two cells.
    """
    where = where or str(source)
    frame, notes, _ = read_user_table(source, where)
    _check_diameter(frame, where)
    need(frame, [RADIUS], where)
    extra = [name for name in (INDEX, STIFFNESS) if name in frame]
    if len(extra) > 1:
        raise DldsimError(
            f"{where}: the table has both {INDEX} and {STIFFNESS}; which of them counts?",
            key=extra,
            allowed="one of them",
            remedy="Leave one out.",
        )
    columns = {name: as_numbers(frame[name], where) for name in [RADIUS, *extra]}
    known = ~pd.DataFrame(columns).isna().any(axis=1)
    if left_out := int((~known).sum()):
        notes = [*notes, f"{left_out} rows without {' or '.join(columns)} left out"]
    values = {name: column[known].reset_index(drop=True) for name, column in columns.items()}
    for column in values.values():
        _check_index(column, where)
        check_plausible(column, where)
    if (bad := [n for n in values if (values[n] <= 0).any() and n != INDEX]) or not all(
        np.isfinite(v).all() for v in values.values()
    ):
        name = bad[0] if bad else next(n for n, v in values.items() if not np.isfinite(v).all())
        raise DldsimError(
            f"{where}, column {name}: every cell has a value above 0, and none is infinite.",
            key=name,
            allowed="positive numbers",
            remedy="Leave empty what was not measured.",
        )
    if len(values[RADIUS]) < FEWEST:
        raise DldsimError(
            f"{where}: {len(values[RADIUS])} cells are no population.",
            key=RADIUS,
            value=len(values[RADIUS]),
            allowed=f"{FEWEST} cells or more",
            remedy="Give mean and standard deviation instead.",
        )
    order = np.argsort(values[RADIUS].to_numpy(), kind="stable")
    sorted_ = {name: column.to_numpy(float)[order] for name, column in values.items()}
    return Measured(where, sorted_[RADIUS], sorted_.get(INDEX), sorted_.get(STIFFNESS), notes)


def _check_diameter(frame: pd.DataFrame, where: str) -> None:
    if RADIUS not in frame and (named := [c for c in map(str, frame) if "diameter" in c.lower()]):
        raise DldsimError(
            f"{where}: the table has {named[0]}, and no {RADIUS}.",
            key=RADIUS,
            value=named[0],
            allowed=f"a column {RADIUS}",
            remedy="Halve the diameters, in µm, and name the column so.",
        )


def _check_index(column: pd.Series, where: str) -> None:
    if column.name == INDEX and len(column) and 1 < column.median() <= 100:
        raise DldsimError(
            f"{where}, column {INDEX}: {column.median():.3g} in the middle; allowed 0 to 1. These "
            "look like per cent.",
            key=INDEX,
            value=float(column.median()),
            allowed="0 to 1",
            remedy="Divide them by 100.",
        )
