"""What commands write: summaries to read, texts for any terminal, files that were tried first."""

import codecs
import contextlib
import json
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from dldsim.errors import DldsimError


def check_writable(path: Path, option: str) -> None:
    """Refuse a file that cannot be written, before anything is calculated for it.

    It is tried under the name that it has while it is being written, the longest; nothing stays.
    """
    if path.is_dir() or not path.name:
        raise DldsimError(
            f"{option} {path}: it is a folder. Nothing was calculated.",
            key=option,
            value=str(path),
            allowed="a file",
            remedy="Name a file in it.",
        )
    made = [folder for folder in path.parents if not folder.exists()]
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.touch(exist_ok=False)
        part.unlink()
    except OSError as error:
        raise DldsimError(
            f"{option} {path}: cannot be written: {error.strerror}. Nothing was calculated. Name "
            "another place, or make room there."
        ) from None
    finally:
        for folder in made:
            with contextlib.suppress(OSError):
                folder.rmdir()


SPELLED = {
    "µ": "u",
    "μ": "u",
    "°": " deg",
    "±": "+/-",
    "≥": ">=",
    "≤": "<=",
    "≠": "!=",
    "−": "-",
    "–": "-",
    "·": "*",
    "×": "x",
    "√": "sqrt",
    "∞": "inf",
    "²": "^2",
    "³": "^3",
    "₁": "1",
    "₂": "2",
    "→": "->",
    "…": "...",
    "’": "'",
    "“": '"',
    "”": '"',
    "Δ": "Delta",
    "α": "alpha",
    "γ": "gamma",
    "ε": "epsilon",
    "η": "eta",
    "θ": "theta",
    "κ": "kappa",
    "λ": "lambda",
    "ν": "nu",
    "π": "pi",
    "σ": "sigma",
    "τ": "tau",
    "ω": "omega",
}
"""What stands for characters that a terminal does not have."""


def spell_out(error: UnicodeError) -> tuple[str, int]:
    """Handler of encoding errors: the characters of SPELLED in ASCII, others as "?"."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(SPELLED.get(c, "?") for c in error.object[error.start : error.end]), error.end


def make_printable(*streams: Any) -> None:
    """Let texts be written to streams of any encoding, such as those of old terminals."""
    codecs.register_error("dldsim-spelled", spell_out)
    for stream in streams:
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="dldsim-spelled")


class Display:
    """Context that shows sentences on standard error, one over the other on a terminal."""

    def __enter__(self) -> Callable[[str], None]:
        self.terminal, self.open = sys.stderr.isatty(), False
        return self.show

    def show(self, sentence: str) -> None:
        sys.stderr.write(f"\r\x1b[K{sentence}" if self.terminal else f"{sentence}\n")
        sys.stderr.flush()
        self.open = self.terminal

    def __exit__(self, *exception) -> None:
        if self.open:
            sys.stderr.write("\n")


def plain_value(value: Any) -> Any:
    """NumPy values as Python's."""
    return value.tolist()


def listing(summary: Mapping[str, Any]) -> list[str]:
    width = max(map(len, summary))
    return [f"{key:{width}}  {_short(value)}" for key, value in summary.items()]


def _short(value: Any) -> str:
    if value is None:
        return "not measured"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        return ", ".join(map(_short, value)) or "none"
    return str(value)


def in_columns(columns: Mapping[str, Sequence[str]]) -> list[str]:
    """Headings and cells in columns as wide as their widest entry, without empty columns."""
    columns = {heading: cells for heading, cells in columns.items() if any(cells)}
    widths = [max(map(len, (heading, *cells))) for heading, cells in columns.items()]
    rows = [columns, *zip(*columns.values(), strict=True)]
    return ["  ".join(f"{c:{w}}" for c, w in zip(r, widths, strict=True)).rstrip() for r in rows]


def optional(value: float | None, form: str) -> str:
    return "–" if value is None else format(value, form)


def records(frame) -> list[dict]:
    return json.loads(frame.to_json(orient="records", double_precision=15))


def frame_lines(frame) -> list[str]:
    """A table without its notes, and each different note below."""
    notes: dict[str, list[str]] = {}
    if "note" in frame:
        for _, row in frame[frame["note"] != ""].iterrows():
            notes.setdefault(row["note"], []).append(row["term"])
    numbers = frame.drop(columns="note", errors="ignore")
    lines = numbers.to_string(index=False, na_rep="", float_format="{:.4g}".format).splitlines()
    return lines + [
        f"note on {', '.join(dict.fromkeys(terms))}: {note}" for note, terms in notes.items()
    ]
