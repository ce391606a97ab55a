"""Values in tables of users: names as text, numbers, what a column can hold, columns by kind."""

import difflib
import json
import math
import re
from collections.abc import Iterable
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from dldsim.errors import DldsimError
from dldsim.tables.column import Column
from dldsim.tables.registry import COLUMNS

PLAUSIBLE = {
    "pillar_radius_um": (0.1, 1000),
    "gap_um": (0.1, 1000),
    "periodicity": (2, 100),
    "cell_radius_um": (0.1, 100),
    "radius_um": (0.1, 100),
    "deformation_index": (0, 1),
    "capillary_number": (1e-12, 1e6),
    "migration_angle_deg": (-90, 90),
    "mean_velocity_mm_s": (1e-6, 1e4),
    "velocity_mm_s": (1e-6, 1e4),
    "height_um": (0, 1e4),
    **dict.fromkeys(("ks_uN_per_m", "kb_pN_um", "kal_uN_per_m", "kag_uN_per_m", "kv_Pa"), (0, 1e9)),
}
"""Least and largest value that a column can have."""
WHOLE = ("periodicity",)
KEYS = ("stiffness_set", "group", "outcome_id", "run_id")
"""Columns whose values name something."""
MISSING = ("na", "n/a", "nan", "null", "none", "#n/a", "<na>")
"""What stands for nothing in columns that are no text, beside an empty field."""
COLUMN_TYPES: dict[str, set] = {}
"""Types that a column has in tables of this package, by name."""
for _columns in COLUMNS.values():
    for _column in _columns:
        COLUMN_TYPES.setdefault(_column.name, set()).add(_column.type)
_LENGTHS = {"m": 1e6, "mm": 1e3, "nm": 1e-3}


def as_key(value: Any) -> str | None:
    """A name as text, whatever type it came as: 1, 1.0 and "1.0" are "1"; null is None."""
    if is_null(value):
        return None
    if isinstance(value, float | np.floating) and float(value).is_integer():
        value = int(value)
    text = str(value).strip()
    return re.sub(r"^([+-]?\d+)\.0*$", r"\1", text) or None


def as_keys(values: pd.Series) -> pd.Series:
    """`as_key` of each value, as objects."""
    values = values.astype(object)
    codes, unique = pd.factorize(values, use_na_sentinel=True)
    names = np.array([*map(as_key, unique), None], dtype=object)
    return pd.Series(names[codes], values.index, dtype=object)


def as_numbers(values: pd.Series, where: str) -> pd.Series:
    """Numbers as floats, NaN for null. Raises DldsimError for text, true or false, and dates."""
    if isinstance(values.dtype, pd.CategoricalDtype):
        values = values.astype(values.cat.categories.dtype)
    if pd.api.types.is_bool_dtype(values.dtype):
        bad = values.notna()
    elif pd.api.types.is_numeric_dtype(values.dtype) and not pd.api.types.is_complex_dtype(values):
        return values.astype("float64")
    else:
        found = values.astype(object).map(as_number, na_action="ignore")
        bad = values.notna() & found.isna()
        bad[bad] = ~values[bad].map(_is_missing).astype(bool)
        if not bad.any():
            return found.astype("float64")
    value, row = values[bad].iloc[0], int(np.flatnonzero(bad)[0])
    more = f", and so in {int(bad.sum()) - 1} more rows" if bad.sum() > 1 else ""
    kind = "true or false" if str(value).lower() in ("true", "false") else "no number"
    raise DldsimError(
        f"{where}, column {values.name}, row {row + 1} below the header: "
        f"{str(value)[:60]!r} is {kind}{more}. Write numbers alone, in the unit of "
        "the column's name, and leave empty what was not measured."
    )


def as_number(value: Any) -> float:
    if isinstance(value, bool | np.bool_):
        return math.nan
    try:
        return float(
            value.replace("\N{MINUS SIGN}", "-").replace("_", "x")
            if isinstance(value, str)
            else value
        )
    except (TypeError, ValueError):
        return math.nan


def _is_missing(value: Any) -> bool:
    if isinstance(value, str):
        return value.strip().lower() in ("", *MISSING)
    return is_null(value)


def need(frame: pd.DataFrame, names: Iterable[str], where: str) -> None:
    """Raise DldsimError for columns that are missing, with those that look like them."""
    missing = [name for name in names if name not in frame]
    if not missing:
        return
    hints = []
    for name in missing:
        stem = name.rsplit("_", 1)[0]
        close = [c for c in map(str, frame.columns) if c.lower().startswith(stem)] or (
            difflib.get_close_matches(name, map(str, frame.columns), n=1, cutoff=0.75)
        )
        hints += (
            [
                f"Is {close[0]} meant by {name}? Rename it"
                + (" and mind the unit." if close[0].lower().startswith(stem) else ".")
            ]
            if close
            else []
        )
    found = ", ".join(map(str, frame.columns[:20])) + (", …" if len(frame.columns) > 20 else "")
    raise DldsimError(
        f"{where}: the table lacks {', '.join(missing)}. Needed columns: "
        f"{', '.join(names)}. Found: {found or 'none'}. {' '.join(hints)}".rstrip()
    )


def check_plausible(values: pd.Series, where: str) -> None:
    """Refuse numbers that a column cannot hold, null and infinite ones aside.

    Raises DldsimError with column, row, value, range, and the unit that they may have.
    """
    name = values.name
    low, high = PLAUSIBLE[name]
    known = values[np.isfinite(values)]
    bad = (known < low) | (known > high)
    allowed = f"{low:g} to {high:g}"
    if name in WHOLE:
        bad |= known != np.round(known)
        allowed = f"whole numbers from {low:g} to {high:g}"
    if not bad.any():
        return
    first = known[bad].index[0]
    row, value = first + 1, known[first]
    hint = "Correct the table, or leave out what was not measured."
    if name.endswith("_um"):
        middle = float(known.median())
        hint = next(
            (
                f"In {unit} it would be {value * factor:.4g} µm: multiply the column by {factor:g}."
                for unit, factor in _LENGTHS.items()
                if 1 <= middle * factor <= 200
            ),
            hint,
        )
    raise DldsimError(
        f"{where}, column {name}, row {row} below the header: {value:g}; allowed "
        f"{allowed} (rows outside: {int(bad.sum())}). {hint}"
    )


def as_columns(kind: str, frame: pd.DataFrame, where: str) -> dict[str, Any]:
    """The columns of a table of this package, in its types, from a user's table of that kind.

    Raises DldsimError for missing, unknown and mistyped columns.
    """
    wanted = {c.name: c for c in COLUMNS[kind]}
    missing = [n for n in wanted if n not in frame]
    unknown = [str(n) for n in frame if n not in wanted]
    if missing or unknown:
        faults = [
            f"missing {', '.join(missing)}" * bool(missing),
            f"unknown {', '.join(unknown)}" * bool(unknown),
        ]
        likely = max(COLUMNS, key=lambda k: len({c.name for c in COLUMNS[k]} & set(frame.columns)))
        hint = f" Most of its columns are those of a table of kind {likely}." * (likely != kind)
        raise DldsimError(
            f"{where}: columns {' and '.join(filter(None, faults))}.{hint} Upload "
            f"the table {kind} that a campaign of this version wrote."
        )
    return {name: _as_type(frame[name], column, where) for name, column in wanted.items()}


def _as_type(values: pd.Series, column: Column, where: str) -> Any:
    if pa.types.is_floating(column.type):
        return as_numbers(values, where)
    if pa.types.is_integer(column.type):
        numbers = as_numbers(values, where)
        odd = numbers.notna() & ~(numbers == np.round(numbers))
        if odd.any():
            raise DldsimError(
                f"{where}, column {values.name}, row {np.flatnonzero(odd)[0] + 1} "
                f"below the header: {numbers[odd].iloc[0]:g} is no whole number."
            )
        return numbers.astype("Int64")
    items = [None if is_null(v) else v for v in values]
    if pa.types.is_boolean(column.type):
        return as_flags(values, where)
    if pa.types.is_list(column.type):
        try:
            return [json.loads(v) if isinstance(v, str) else v for v in items]
        except ValueError as error:
            raise DldsimError(
                f"{where}, column {values.name}: a list is written like [1.5, 2], "
                f"not {str(error)[:60]}."
            ) from error
    if values.name in KEYS:
        items = as_keys(values).tolist()
    elif not all(isinstance(v, str) or v is None for v in items):
        bad = next(v for v in items if not isinstance(v, str) and v is not None)
        raise DldsimError(f"{where}, column {values.name}: {str(bad)[:60]!r} is no text.")
    return items if column.nullable else ["" if v is None else v for v in items]


def as_flags(values: pd.Series, where: str) -> list[bool | None]:
    """True and false of what may be words or numbers, None for null. Raises DldsimError."""
    items = [None if is_null(v) else v for v in values]
    flags = [_FLAGS.get(str(v).lower()) for v in items]
    bad = [v for v, flag in zip(items, flags, strict=True) if v is not None and flag is None]
    if bad:
        raise DldsimError(
            f"{where}, column {values.name}: {str(bad[0])[:60]!r} is neither true nor false.",
            key=str(values.name),
            value=str(bad[0])[:60],
            allowed="true or false",
        )
    return flags


_FLAGS = {"true": True, "false": False, "1": True, "0": False, "1.0": True, "0.0": False}


def is_null(value: Any) -> bool:
    return value is None or value is pd.NA or (isinstance(value, float) and math.isnan(value))
