"""Numbers and words as the pages show them. Plain strings are escaped by the templates."""

import math
from collections.abc import Iterable

import numpy as np
import pandas as pd
from markupsafe import Markup, escape

SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
NOT_MEASURED = "–"

PILLAR_RADIUS = Markup("<i>P</i><sub>r</sub>")
GAP = Markup("<i>P</i><sub>g</sub>")
PERIODICITY = Markup("<i>N</i><sub>p</sub>")
ANGLE = Markup("θ<sub>m</sub>")
SIGMA = Markup("σ<sub>num</sub>")
SYMBOLS = {
    "pillar_radius_um": PILLAR_RADIUS,
    "gap_um": GAP,
    "periodicity": PERIODICITY,
    "deformation_index": "DI",
    "log_capillary_number": "ln Ca",
    "capillary_number": "Ca",
    "ks_1_uN_per_m": Markup("<i>k</i><sub>s</sub> of cell 1"),
    "ks_2_uN_per_m": Markup("<i>k</i><sub>s</sub> of cell 2"),
}


def number(value, digits: int = 3) -> str:
    """A number with so many significant digits; a dash for null; scientific when far from 1."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return NOT_MEASURED
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, int | np.integer):
        return f"{value:,}".replace(",", "\u202f").replace("-", "−")
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if -4 < exponent < 6:
        text = f"{value:,.{max(digits - 1 - exponent, 0)}f}".replace(",", "\u202f")
    else:
        mantissa = f"{value / 10**exponent:.{max(digits - 1, 0)}f}"
        text = f"{mantissa} × 10{str(exponent).translate(SUPERSCRIPT)}"
    return text.replace("-", "−")


def fixed(value, decimals: int = 2) -> str:
    """A number with so many decimals; a dash for null."""
    if value is None or not math.isfinite(value):
        return NOT_MEASURED
    return f"{value:.{decimals}f}".replace("-", "−")


def percent(value) -> str:
    """A share in per cent, two digits; a dash for null."""
    return NOT_MEASURED if pd.isna(value) else f"{number(100 * float(value), 2)} %"


def probability(value) -> str:
    """A p-value: two digits, scientific below 0.001."""
    if value is None or math.isnan(value):
        return NOT_MEASURED
    if value < 1e-300:
        return "< 10" + "-300".translate(SUPERSCRIPT)
    return number(float(value), 2) if value < 1e-3 else fixed(value, 3)


def duration(seconds: float) -> str:
    """Seconds, minutes or hours, whichever reads best."""
    if seconds < 120:
        return f"{number(float(seconds), 2)} s"
    if seconds < 7200:
        return f"{number(seconds / 60, 2)} min"
    return f"{number(seconds / 3600, 3)} h"


def text(value) -> str:
    """Any table value as a string; a dash for null or empty. Markup stays what it is."""
    if value is None or (isinstance(value, float) and math.isnan(value)) or value == "":
        return NOT_MEASURED
    return value if isinstance(value, str) else str(value)


def listing(items: Iterable[str]) -> str:
    """a, b and c; Markup if all of them are."""
    items = list(items)
    kind = Markup if items and all(isinstance(item, Markup) for item in items) else str
    return kind(" and ").join(filter(None, [kind(", ").join(items[:-1]), *items[-1:]]))


def counted(count: int, noun: str) -> str:
    """ "1 run", "3 runs"."""
    return f"{number(int(count))} {noun}{'' if count == 1 else 's'}"


def term(name: str) -> Markup:
    """Term of an analysis of variance, or a parameter, in the symbols of the text."""
    shown = escape(name)
    for column, symbol in (*SYMBOLS.items(), (":", " × ")):
        shown = shown.replace(column, symbol)
    return shown


# ------------------------------------------------------------------------------- columns of tables


def numbers(values: Iterable, digits: int = 3) -> list[str]:
    return [number(v, digits) for v in values]


def texts(values: Iterable) -> list[str]:
    return [text(v) for v in values]


def decimals(values: Iterable, count: int = 2) -> list[str]:
    return [fixed(v, count) for v in values]


def plus_minus(values: Iterable, errors: Iterable, count: int = 2) -> list[str]:
    """Values with their errors, where these are known."""
    return [
        fixed(v, count) + (f" ± {fixed(e, count)}" if pd.notna(e) else "")
        for v, e in zip(values, errors, strict=True)
    ]


def ranges(low: Iterable, high: Iterable, count: int = 2) -> list[str]:
    """Intervals; a dash where there is none."""
    return [
        f"{fixed(a, count)} to {fixed(b, count)}" if pd.notna(a) else NOT_MEASURED
        for a, b in zip(low, high, strict=True)
    ]


def array_columns(table: pd.DataFrame) -> dict[str, list[str]]:
    """Radius, gap and periodicity of the rows of a table."""
    return {
        Markup("{} [µm]").format(PILLAR_RADIUS): decimals(table["pillar_radius_um"]),
        Markup("{} [µm]").format(GAP): decimals(table["gap_um"]),
        PERIODICITY: numbers(table["periodicity"]),
    }


def records(table: pd.DataFrame) -> list[dict]:
    """Rows as dicts, null as None."""
    return table.astype(object).where(table.notna(), None).to_dict("records")
