"""Tables of users: CSV and Parquet of any origin, read wherever they can mean one thing only.

Separator, decimal comma, encoding, a column of row numbers, blanks and capitals in the header and
dictionaries are read and told in notes; what can be read in two ways, or as nothing, is refused
with what was found and what to do. Keys such as the name of a stiffness set are text on every way.
"""

import io
import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from dldsim import PHYSICS_VERSION
from dldsim.errors import DldsimError
from dldsim.tables.parquet import METADATA_KEY
from dldsim.tables.user_csv import bare_name, read_csv
from dldsim.tables.user_values import COLUMN_TYPES, KEYS, MISSING, as_keys, as_number

OTHER_FORMATS = {
    b"PK\x03\x04": "a ZIP archive or an Excel workbook",
    b"\xd0\xcf\x11\xe0": "an Excel workbook",
    b"\x1f\x8b": "a gzip archive",
    b"ARROW1": "an Arrow (Feather) file",
    b"\x89HDF": "an HDF5 file",
    b"(\xb5/\xfd": "a Zstandard archive",
    b"BZh": "a bzip2 archive",
}
NUMBERS = {n for n, types in COLUMN_TYPES.items() if types <= {pa.float64(), pa.int64()}}
"""Columns of numbers, of any kind of table."""
_WORDS = {n for n, types in COLUMN_TYPES.items() if pa.string() in types} - set(KEYS)
"""Columns of text, in which "none" is a word."""
_COMMA = r"[+-]?(\d+(,\d*)?|,\d+)([eE][+-]?\d+)?"
_THOUSANDS = r"[+-]?[1-9]\d{0,2}(,\d{3})+"


class UserTable(NamedTuple):
    """A table, what had to be found out to read it, and its metadata if this package wrote it."""

    frame: pd.DataFrame
    notes: list[str]
    about: dict[str, Any]


def read_user_table(source: Path | bytes, where: str | None = None) -> UserTable:
    """A table in a file, or its bytes.

    Columns of numbers that hold nothing else are numbers, KEYS are text, null is null; all else is
    left as it is, for `as_numbers` to complain of. Raises DldsimError if it cannot be read, can be
    read in two ways, or was written by another physics version of this package.
    """
    where = where or str(source)
    content = source if isinstance(source, bytes) else _bytes(Path(source))
    if not content.strip(b"\x00 \t\r\n"):
        raise DldsimError(f"{where} is empty. A table has a line of column names and rows below.")
    if content[:4] == b"PAR1":
        return _parquet(content, where)
    for start, what in OTHER_FORMATS.items():
        if content.startswith(start):
            raise DldsimError(f"{where} is {what}. Save the table as CSV or Parquet.")
    table, header, separator, notes = read_csv(content, where)
    table = table.set_axis(_names(header, notes), axis=1)
    return _finished(table, notes, {}, where, separator)


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError as error:
        raise DldsimError(f"{path} does not exist. Check the path.") from error
    except OSError as error:
        raise DldsimError(
            f"{path} cannot be read: {error.strerror}. Name a CSV or Parquet file."
        ) from error


def _names(header: list[str], notes: list[str]) -> list[str]:
    """Names of columns: bare, and as this package spells them."""
    known = {name.lower(): name for name in COLUMN_TYPES if "_" in name or len(name) > 6}
    names = []
    for given in header:
        bare = bare_name(given)
        name = bare if bare in COLUMN_TYPES else known.get(bare.lower(), bare)
        if name in COLUMN_TYPES and name != given:
            notes.append(f"column {given!r} is read as {name}")
        names.append(name)
    return names


# ----------------------------------------------------------------------------------------- Parquet


def _parquet(content: bytes, where: str) -> UserTable:
    try:
        file = pq.ParquetFile(io.BytesIO(content))
        about = json.loads((file.schema_arrow.metadata or {}).get(METADATA_KEY, b"{}"))
        if not isinstance(about, dict):
            raise ValueError("its dldsim metadata are damaged")
        table = file.read()
        columns: dict[int, pd.Series] = {}
        notes: list[str] = []
        names = _names(table.column_names, notes)
        for i, field in enumerate(table.schema):
            column = table.column(i)
            if pa.types.is_dictionary(field.type):
                column = column.cast(field.type.value_type)
                notes.append(f"column {names[i]} is a dictionary (factor); its values are taken")
            if pa.types.is_decimal(column.type):
                column = column.cast(pa.float64())
            columns[i] = column.to_pandas()
    except (pa.ArrowException, OSError, ValueError) as error:
        raise DldsimError(
            f"{where} is not a readable Parquet file: "
            f"{' '.join(str(error).split())[:200]}. Write the table again."
        ) from error
    version = about.get("physics_version", PHYSICS_VERSION)
    if version != PHYSICS_VERSION:
        raise DldsimError(
            f"{where} was made by physics version {version}; this is version {PHYSICS_VERSION}, "
            "whose trajectories and angles differ. Make the campaign anew: snakemake -j2 all."
        )
    frame = pd.DataFrame(columns).set_axis(names, axis=1)
    return _finished(frame, notes, about, where, None)


# ------------------------------------------------------------------------------------- both of them


def _finished(
    frame: pd.DataFrame,
    notes: list[str],
    about: Mapping[str, Any],
    where: str,
    separator: str | None,
) -> UserTable:
    """Nameless columns and empty rows left out, numbers and keys in their types."""
    nameless = [
        not name or bool(re.fullmatch(r"Unnamed: \d+(_level_\d+)?|__index_level_\d+__", name))
        for name in frame.columns
    ]
    if (
        len(frame.columns)
        and frame.columns[0] not in COLUMN_TYPES
        and _are_row_numbers(frame.iloc[:, 0])
    ):
        nameless[0] = True
    if any(nameless):
        notes.append(
            f"{sum(nameless)} column without a name (row numbers) left out"
            if sum(nameless) == 1
            else f"{sum(nameless)} columns without names left out"
        )
        frame = frame.loc[:, [not n for n in nameless]]
    doubled = frame.columns[frame.columns.duplicated()]
    if len(doubled):
        raise DldsimError(f"{where}: column {doubled[0]} is there more than once. Leave one.")
    columns = {}
    for name in frame.columns:
        values = frame[name]
        if values.dtype == object or pd.api.types.is_string_dtype(values.dtype):
            values = _cleaned(
                values.astype(object).where(values.notna(), None), () if name in _WORDS else MISSING
            )
        columns[name] = as_keys(values) if name in KEYS else values
    if separator is not None:
        empty = np.logical_and.reduce([v.isna() for v in columns.values()] or [False])
        if np.any(empty):
            notes.append(f"{int(empty.sum())} empty rows left out")
            columns = {n: v[~empty].reset_index(drop=True) for n, v in columns.items()}
    numbers = [n for n in columns if n in NUMBERS]
    texts = {n: columns[n] for n in numbers if columns[n].dtype == object}
    parsed = {n: _parsed(v) for n, v in texts.items()}
    commas = [n for n, v in parsed.items() if v is None and _all_match(texts[n], _COMMA)]
    if commas:
        _check_commas(texts, parsed, commas, separator, where)
        notes.append(f"decimal commas in {', '.join(commas)}")
        parsed |= {n: _parsed(texts[n].str.replace(",", ".", regex=False)) for n in commas}
    columns |= {n: v for n, v in parsed.items() if v is not None}
    return UserTable(pd.DataFrame(columns), notes, dict(about))


def _are_row_numbers(values: pd.Series) -> bool:
    """Whether these are 0, 1, 2, … or 1, 2, 3, …"""
    if pd.api.types.is_bool_dtype(values.dtype) or not len(values):
        return False
    found = pd.to_numeric(values, errors="coerce")
    return bool((found == np.arange(len(found)) + (found.iloc[0] == 1)).all())


def _cleaned(values: pd.Series, missing: Iterable[str]) -> pd.Series:
    """Texts without blanks around them, None for empty ones and those in `missing`."""
    if not all(isinstance(v, str) or v is None for v in values):
        return values
    codes, unique = pd.factorize(values, use_na_sentinel=True)
    clean = [
        text if text and text.lower() not in missing else None
        for text in (v.replace("\N{NO-BREAK SPACE}", " ").strip() for v in unique)
    ]
    return pd.Series(np.array([*clean, None], dtype=object)[codes], values.index, dtype=object)


def _parsed(values: pd.Series) -> pd.Series | None:
    """Floats, if all of these texts are numbers."""
    if values.isna().all():
        return values.astype("float64")
    if not all(isinstance(v, str) for v in values.dropna().unique()):
        return None
    found = values.map(as_number, na_action="ignore").astype("float64")
    return found if (found.notna() | values.isna()).all() else None


def _all_match(values: pd.Series, pattern: str) -> bool:
    known = values.dropna()
    return all(isinstance(v, str) and re.fullmatch(pattern, v) for v in known.unique())


def _check_commas(
    texts: Mapping, parsed: Mapping, commas: list[str], separator: str | None, where: str
) -> None:
    """Raise DldsimError if a comma may as well separate thousands."""
    point = next(
        (
            (n, v)
            for n in texts
            if parsed[n] is not None
            for v in texts[n].dropna().unique()
            if "." in v
        ),
        None,
    )
    comma = next((commas[0], v) for v in texts[commas[0]].dropna().unique() if "," in v)
    sure = separator not in (",", None) or any(
        "," in v and not re.fullmatch(_THOUSANDS, v)
        for n in commas
        for v in texts[n].dropna().unique()
    )
    if point or not sure:
        other = f", and {point[1]!r} in {point[0]}" if point else ""
        raise DldsimError(
            f"{where}: {comma[1]!r} in column {comma[0]}{other}. A comma may be a decimal sign or "
            "separate thousands. Write numbers with a decimal point and without thousands "
            "separators."
        )
