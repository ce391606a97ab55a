"""Tables of users: CSV and Parquet of any origin, read wherever they can mean one thing only.

Separator, decimal comma, encoding, a column of row numbers, blanks and capitals in the header and
dictionaries are read and told in notes; what can be read in two ways, or as nothing, is refused
with what was found and what to do. Keys such as the name of a stiffness set are text on every way.
"""

import csv
import difflib
import io
import json
import math
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from dldsim import PHYSICS_VERSION
from dldsim.errors import DldsimError
from dldsim.tables.column import Column
from dldsim.tables.parquet import METADATA_KEY
from dldsim.tables.registry import COLUMNS

PLAUSIBLE = {
    "pillar_radius_um": (0.1, 1000),
    "gap_um": (0.1, 1000),
    "periodicity": (2, 100),
    "cell_radius_um": (0.1, 100),
    "radius_um": (0.1, 100),
    "deformation_index": (0, 1),
    "capillary_number": (0, 1e6),
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
SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"}
HEADER_LINES = 20
"""The header is looked for among so many lines."""
OTHER_FORMATS = {
    b"PK\x03\x04": "a ZIP archive or an Excel workbook",
    b"\xd0\xcf\x11\xe0": "an Excel workbook",
    b"\x1f\x8b": "a gzip archive",
    b"ARROW1": "an Arrow (Feather) file",
    b"\x89HDF": "an HDF5 file",
    b"(\xb5/\xfd": "a Zstandard archive",
    b"BZh": "a bzip2 archive",
}
_TYPES: dict[str, set] = {}
for _columns in COLUMNS.values():
    for _column in _columns:
        _TYPES.setdefault(_column.name, set()).add(_column.type)
NUMBERS = {n for n, types in _TYPES.items() if types <= {pa.float64(), pa.int64()}}
"""Columns of numbers, of any kind of table."""
_WORDS = {n for n, types in _TYPES.items() if pa.string() in types} - set(KEYS)
"""Columns of text, in which "none" is a word."""
_COMMA = r"[+-]?(\d+(,\d*)?|,\d+)([eE][+-]?\d+)?"
_THOUSANDS = r"[+-]?[1-9]\d{0,2}(,\d{3})+"
_LENGTHS = {"m": 1e6, "mm": 1e3, "nm": 1e-3}


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
    return _csv(content, where)


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError as error:
        raise DldsimError(f"{path} does not exist. Check the path.") from error
    except OSError as error:
        raise DldsimError(
            f"{path} cannot be read: {error.strerror}. Name a CSV or Parquet file."
        ) from error


# ------------------------------------------------------------------------------------------ values


def as_key(value: Any) -> str | None:
    """A name as text, whatever type it came as: 1, 1.0 and "1.0" are "1"; null is None."""
    if _is_null(value):
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
        found = values.astype(object).map(_number, na_action="ignore")
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


def _number(value: Any) -> float:
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
    return _is_null(value)


def need(frame: pd.DataFrame, names: Iterable[str], where: str) -> None:
    """Raise DldsimError for columns that are missing, with those that look like them."""
    missing = [name for name in names if name not in frame]
    if not missing:
        return
    hints = []
    for name in missing:
        stem = name.rsplit("_", 1)[0]
        close = [c for c in map(str, frame.columns) if c.startswith(stem)] or (
            difflib.get_close_matches(name, map(str, frame.columns), n=1, cutoff=0.75)
        )
        hints += (
            [
                f"Is {close[0]} meant by {name}? Rename it"
                + (" and mind the unit." if close[0].startswith(stem) else ".")
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
    row, value = values.index.get_loc(first) + 1, known[first]
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
    items = [None if _is_null(v) else v for v in values]
    if pa.types.is_boolean(column.type):
        flags = [_FLAGS.get(str(v).lower()) for v in items]
        bad = [v for v, flag in zip(items, flags, strict=True) if v is not None and flag is None]
        if bad:
            raise DldsimError(
                f"{where}, column {values.name}: {str(bad[0])[:60]!r} is neither true nor false."
            )
        return flags
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


_FLAGS = {"true": True, "false": False, "1": True, "0": False, "1.0": True, "0.0": False}


def _is_null(value: Any) -> bool:
    return value is None or value is pd.NA or (isinstance(value, float) and math.isnan(value))


# --------------------------------------------------------------------------------------------- CSV


def _csv(content: bytes, where: str) -> UserTable:
    text, notes = _decoded(content, where)
    lines = text.split("\n", HEADER_LINES + 1)[: HEADER_LINES + 1]
    separator = None
    if lines[0].lower().startswith("sep=") and len(lines[0].strip()) == 5:
        separator, text = lines[0].strip()[4], text.partition("\n")[2]
        lines = lines[1:]
    skipped, separator, header = _header(lines, separator)
    body = text.split("\n", skipped + 1)[skipped + 1] if text.count("\n") > skipped else ""
    if separator != ",":
        notes.append(f"fields are separated by {SEPARATORS.get(separator, repr(separator))}")
    if above := sum(bool(line.strip()) for line in lines[:skipped]):
        notes.append(f"{above} lines above the header left out")
    reader = csv.reader(io.StringIO("\n".join(body.split("\n", 50)[:50])), delimiter=separator)
    rows = [row for row in reader if any(cell.strip() for cell in row)] or [header]
    first = rows[0]
    if len(first) == len(header) + 1:
        ending = all(row[-1].strip() == "" for row in rows)
        header = [*header, ""] if ending else ["", *header]
    elif len(first) != len(header):
        raise DldsimError(
            f"{where}: the header has {len(header)} columns, the first row {len(first)} (separated "
            f"by {SEPARATORS.get(separator, repr(separator))}). Make them agree; quote fields that "
            "hold the separator."
        )
    table = _fields(body, separator, len(header), where)
    table = table.set_axis(_names(header, notes), axis=1)
    return _finished(table, notes, {}, where, separator)


def _decoded(content: bytes, where: str) -> tuple[str, list[str]]:
    """Text with plain line ends, and notes on its encoding."""
    marks = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16", b"\xef\xbb\xbf": "utf-8-sig"}
    encoding = next((name for mark, name in marks.items() if content.startswith(mark)), "utf-8")
    if encoding == "utf-8" and b"\x00" in content[:200]:
        encoding = "utf-16-le" if content[1:2] == b"\x00" else "utf-16-be"
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError:
        if encoding.startswith("utf-16"):
            raise DldsimError(
                f"{where} is neither text nor Parquet, though it begins like "
                "UTF-16. Save the table as CSV in UTF-8."
            ) from None
        encoding = "cp1252"
        text = content.decode(encoding, errors="replace")
    if "\x00" in text:
        raise DldsimError(
            f"{where} is neither text nor Parquet: it holds zero bytes. Save the "
            "table as CSV or Parquet."
        )
    plain = encoding in ("utf-8", "utf-8-sig") or text.isascii() and encoding == "cp1252"
    notes = [] if plain else [f"text is encoded as {encoding.upper()}"]
    return text.replace("\r\n", "\n").replace("\r", "\n"), notes


def _header(lines: list[str], separator: str | None) -> tuple[int, str, list[str]]:
    """Number of lines above the header, separator, and names: where most names are known."""
    known = {name.lower() for name in _TYPES}
    best: tuple[tuple[int, int], int, str, list[str]] | None = None
    for i, line in enumerate(lines):
        if not line.strip():
            continue
        for mark in separator or SEPARATORS:
            names = next(csv.reader([line], delimiter=mark), [])
            count = sum(_bare(name).lower() in known for name in names)
            rank = (count, len(names) if best is None or best[1] == i else 0)
            if best is None or rank > best[0]:
                best = rank, i, mark, names
    return best[1:] if best else (0, separator or ",", [])


def _bare(name: str) -> str:
    return name.replace("\N{NO-BREAK SPACE}", " ").strip().strip("\ufeff").strip("'\"").strip()


def _fields(body: str, separator: str, width: int, where: str) -> pd.DataFrame:
    """The rows as text."""
    names = [str(i) for i in range(width)]
    faults = []

    def remember(row):
        faults.append(row)
        return "error"

    if not body.strip():
        return pd.DataFrame({name: pd.Series(dtype=object) for name in names})
    try:
        table = pyarrow.csv.read_csv(
            io.BytesIO(body.encode("utf-8", "replace")),
            read_options=pyarrow.csv.ReadOptions(
                column_names=names, use_threads=False, block_size=1 << 24
            ),
            parse_options=pyarrow.csv.ParseOptions(
                delimiter=separator, newlines_in_values=True, invalid_row_handler=remember
            ),
            convert_options=pyarrow.csv.ConvertOptions(
                column_types=dict.fromkeys(names, pa.string()), strings_can_be_null=False
            ),
        )
    except pa.ArrowInvalid as error:
        if faults:
            row = faults[0]
            place = f"row {row.number} below the header" if row.number else "a row"
            raise DldsimError(
                f"{where}: {place} has {row.actual_columns} fields, the others "
                f"{row.expected_columns}: {row.text[:60]!r}. Was the file cut off? Repair that "
                "row."
            ) from error
        raise DldsimError(
            f"{where} is no readable CSV: {' '.join(str(error).split())[:200]}. "
            "Save the table again."
        ) from error
    return table.to_pandas().astype(object)


def _names(header: list[str], notes: list[str]) -> list[str]:
    """Names of columns: bare, and as this package spells them."""
    known = {name.lower(): name for name in _TYPES if "_" in name or len(name) > 6}
    names = []
    for given in header:
        bare = _bare(given)
        name = bare if bare in _TYPES else known.get(bare.lower(), bare)
        if name in _TYPES and name != given:
            notes.append(f"column {given!r} is read as {name}")
        names.append(name)
    return names


# ----------------------------------------------------------------------------------------- Parquet


def _parquet(content: bytes, where: str) -> UserTable:
    try:
        file = pq.ParquetFile(io.BytesIO(content))
        about = json.loads((file.schema_arrow.metadata or {}).get(METADATA_KEY, b"{}"))
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
    if len(frame.columns) and frame.columns[0] not in _TYPES and _are_row_numbers(frame.iloc[:, 0]):
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
    found = values.map(_number, na_action="ignore").astype("float64")
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
