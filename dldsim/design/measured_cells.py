"""Measured cells of a population, from a user's table: radii, and what tells their stiffness."""

import difflib
import re
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from dldsim.config.design_sections import SPRING_LEAST, SPRING_MOST
from dldsim.errors import DldsimError
from dldsim.tables.user_table import read_user_table
from dldsim.tables.user_values import as_numbers, check_plausible, need

RADIUS, INDEX, STIFFNESS = "radius_um", "deformation_index", "ks_uN_per_m"
FEWEST = 2
UNUSED = "not used: "
"""Beginning of the note on columns that say nothing."""


class Measured(NamedTuple):
    """Cells of one population in the order of their radii, (n,) each; index and spring constant
    are None where they were not measured. ``notes``: what had to be found out to read them."""

    source: str
    radius_um: np.ndarray
    deformation_index: np.ndarray | None
    ks_uN_per_m: np.ndarray | None
    notes: list[str]

    @property
    def unused(self) -> str:
        """The note on columns that say nothing, "" without any."""
        return next((note for note in self.notes if note.startswith(UNUSED)), "")

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
    values = {name: column[known] for name, column in columns.items()}
    notes = [*notes, *_not_used(frame)]
    _check_swapped(values, where)
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
    _check_springs(values, where)
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


MOST_NAMED = 20
"""Columns that are not used, and are named."""
ALIASES = {
    RADIUS: ("radius", "r", "cell_radius_um", "cell_radius", "size_um"),
    INDEX: ("di", "deformability", "deformation", "def_index", "index"),
    STIFFNESS: ("ks", "k_s", "stiffness", "spring_constant", "ks_n_per_m", "ks_mn_per_m"),
}
"""Names that users give to columns, besides misspelt ones."""


def _not_used(frame: pd.DataFrame) -> list[str]:
    """A note on columns that say nothing here, with the name that may be meant."""
    unused = [str(name) for name in frame if name not in ALIASES]
    if not unused:
        return []
    hints = []
    for name in unused[:MOST_NAMED]:
        plain = re.sub(r"[\s.-]+", "_", name.lower()).partition("_[")[0].partition("_(")[0]
        meant = next((known for known, others in ALIASES.items() if plain in others), None)
        close = difflib.get_close_matches(plain, [k.lower() for k in ALIASES], n=1, cutoff=0.75)
        meant = meant or next((known for known in ALIASES if known.lower() in close), None)
        told = {INDEX, STIFFNESS} & set(frame) if meant != RADIUS else {RADIUS}
        if meant is not None and not told:
            hints.append(f"; is {meant} meant by {name}? Rename it, and mind the unit")
    columns = "column" if len(unused) == 1 else "columns"
    named = ", ".join(unused[:MOST_NAMED]) + ", …" * (len(unused) > MOST_NAMED)
    return [f"{UNUSED}{columns} {named}{''.join(hints)}"]


def _check_swapped(values: Mapping[str, pd.Series], where: str) -> None:
    """Refuse radii and indices in each other's column."""
    if INDEX not in values or not len(values[INDEX]):
        return
    radius, index = values[RADIUS].median(), values[INDEX].median()
    if 0 <= radius < 1 < index:
        raise DldsimError(
            f"{where}: {RADIUS} is {radius:.3g} and {INDEX} {index:.3g} in the middle; these look "
            "like each other's values.",
            key=(RADIUS, INDEX),
            value=(float(radius), float(index)),
            allowed="radii in µm, indices from 0 to 1",
            remedy="Swap the names of the two columns.",
        )


def _check_springs(values: Mapping[str, pd.Series], where: str) -> None:
    """Refuse spring constants that no cell has, with the unit that they may be in."""
    if STIFFNESS not in values:
        return
    column = values[STIFFNESS]
    bad = column[(column < SPRING_LEAST) | (column > SPRING_MOST)]
    if not len(bad):
        return
    middle = float(column.median())
    hint = next(
        (
            f"In {unit} it would be {factor * middle:.3g} µN/m: multiply the column by {factor:g}."
            for unit, factor in (("N/m", 1e6), ("mN/m", 1e3), ("pN/m", 1e-6))
            if 1 <= factor * middle <= 1000
        ),
        "Correct the table, or leave empty what was not measured.",
    )
    raise DldsimError(
        f"{where}, column {STIFFNESS}, row {bad.index[0] + 1} of the cells: {bad.iloc[0]:g} µN/m; "
        f"allowed {SPRING_LEAST:g} to {SPRING_MOST:g} (cells outside: {len(bad)}).",
        key=STIFFNESS,
        value=float(bad.iloc[0]),
        allowed=f"{SPRING_LEAST:g} to {SPRING_MOST:g} µN/m",
        remedy=hint,
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
