"""Tables of users as text: encoding, separator, the line of the header, and fields."""

import csv
import io
import math
import re

import pandas as pd
import pyarrow as pa
import pyarrow.csv

from dldsim.errors import DldsimError
from dldsim.tables.user_values import COLUMN_TYPES, MISSING, as_number

SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"}
HEADER_LINES = 20
"""The header is looked for among so many lines."""
DECIMALS = r"\d+([eE][+-]?\d+)?"


def read_csv(content: bytes, where: str) -> tuple[pd.DataFrame, list[str], str, list[str]]:
    """Fields as text, names of columns as they are written, separator, and notes on both.

    Raises DldsimError for what is no text, and for rows of another length than the header.
    """
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
    header, body, fields = _widths(header, body, separator, where)
    table = _fields(body, fields, len(header), where)
    return table, header, separator, notes


def _widths(header: list[str], body: str, separator: str, where: str) -> tuple[list[str], str, str]:
    """Header, rows and the separator of these, where rows are longer than the header: by row
    numbers, by an empty field at the end, or by decimal commas that look like separators.

    Raises DldsimError where they can be read in two ways, and for other lengths.
    """
    rows = _rows("\n".join(body.split("\n", 50)[:50]), separator) or [header]
    if separator == "," and (len(rows[0]) > len(header) or len(header) == 1 and "," in body):
        found = _decimal_commas(len(header), body, where)
        if found is not None:
            return header, found, ";"
    first = rows[0]
    if len(first) == len(header) + 1:
        if all(row[-1].strip() == "" for row in rows):
            return [*header, ""], body, separator
        names = [row[0].strip() for row in rows]
        if not (_quoted(body) or _counted(names) or not any(map(_is_number, names))):
            raise DldsimError(
                f"{where}: the header has {len(header)} columns, the first row {len(first)}, and "
                f"the first field, such as {first[0]!r}, is no row number. Name every column."
            )
        return ["", *header], body, separator
    if len(first) != len(header):
        raise DldsimError(
            f"{where}: the header has {len(header)} columns, the first row {len(first)} (separated "
            f"by {SEPARATORS.get(separator, repr(separator))}). Make them agree; quote fields that "
            "hold the separator, and write numbers with a decimal point."
        )
    return header, body, separator


def _rows(body: str, separator: str) -> list[list[str]]:
    reader = csv.reader(io.StringIO(body), delimiter=separator)
    return [row for row in reader if any(cell.strip() for cell in row)]


def _decimal_commas(width: int, body: str, where: str) -> str | None:
    """Rows of so many columns with their fields between semicolons, where commas are decimal signs
    as well as separators and that is the only way to read them; None where they separate fields.

    Raises DldsimError if the first field may be a row number as well, or a name without a column.
    """
    rows = [[cell.strip() for cell in row] for row in _rows(body, ",")]
    if all(row[-1] == "" for row in rows):
        return None
    longest = max(map(len, rows), default=0)
    if width == 1:
        if longest != 2 or not all(
            len(row) == 1 and (row[0].lower() in MISSING or _joined(row[0], "0")) or _joined(*row)
            for row in rows
        ):
            return None
        merged = [[",".join(row)] for row in rows]
    elif longest == 2 * width and all(_all_joined(row, width) for row in rows):
        merged = [[",".join(row[i : i + 2]) for i in range(0, len(row), 2)] for row in rows]
    elif longest == width + 1 and any(
        all(len(row) == longest and _joined(*row[j : j + 2]) for row in rows) for j in range(width)
    ):
        merged = []
    else:
        return None
    numbered = longest == width + 1 and all(len(row) == longest for row in rows)
    if numbered and _quoted(body):
        return None
    if not merged or numbered and _counted([row[0] for row in rows]):
        raise DldsimError(
            f"{where}: the rows have {longest} fields, such as {','.join(rows[0])!r}, and the "
            f"header {width}. The first may have no name, or a comma may be a decimal sign. Name "
            "every column, and write numbers with a decimal point or fields apart by semicolons."
        )
    return "\n".join(";".join(row) for row in merged) + "\n"


def _quoted(body: str) -> bool:
    """Whether the first field is quoted, as R writes names of rows."""
    return body.lstrip()[:1] in ('"', "'")


def _counted(names: list[str]) -> bool:
    """Whether these are 0, 1, 2, … or 1, 2, 3, …"""
    return names[0] in ("0", "1") and names == [
        str(i) for i in range(int(names[0]), int(names[0]) + len(names))
    ]


def _is_number(text: str) -> bool:
    return not math.isnan(as_number(text)) or bool(re.fullmatch(r"\d+,\d+", text))


def _all_joined(row: list[str], width: int) -> bool:
    return len(row) == 2 * width and all(_joined(*row[i : i + 2]) for i in range(0, len(row), 2))


def _joined(whole: str, part: str = "") -> bool:
    """Whether these are what a decimal comma parts a number into."""
    return bool(re.fullmatch(r"[+\N{MINUS SIGN}-]?\d+", whole) and re.fullmatch(DECIMALS, part))


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
    known = {name.lower() for name in COLUMN_TYPES}
    best: tuple[tuple[int, int], int, str, list[str]] | None = None
    for i, line in enumerate(lines):
        if not line.strip():
            continue
        for mark in separator or SEPARATORS:
            names = next(csv.reader([line], delimiter=mark), [])
            count = sum(bare_name(name).lower() in known for name in names)
            rank = (count, len(names) if best is None or best[1] == i else 0)
            if best is None or rank > best[0]:
                best = rank, i, mark, names
    return best[1:] if best else (0, separator or ",", [])


def bare_name(name: str) -> str:
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
