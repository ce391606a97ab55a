"""Whether files on disk were made with the settings of today, by what the files themselves say.

Snakemake's own records stay behind when results are copied, and can be switched off.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dldsim.config.provenance import flattened, settings_hash

SHOWN = 3
"""Differing settings that are named; further ones are counted."""
LENGTH = 40
"""Characters of a value that are shown."""


def difference(path: Path, settings: Mapping[str, Any]) -> str | None:
    """In which settings a file was made differently, or which columns it lacks, in words.

    None where it is as it would be made today; and for a file that does not exist or says nothing
    of its making.
    """
    made = _provenance(Path(path))
    if made is None:
        return None
    if lacking := _lacking(Path(path), made.get("kind")):
        return f"columns of an older version, without {', '.join(lacking)}"
    if made.get("config_hash") == settings_hash(settings):
        return None
    then = flattened(made.get("settings") or {})
    now = flattened(json.loads(json.dumps(settings, default=str)))
    absent = object()
    differing = [key for key in {**then, **now} if then.get(key, absent) != now.get(key, absent)]
    parts = [
        f"{key} = {_short(then.get(key))}, now {_short(now.get(key))}" for key in differing[:SHOWN]
    ]
    if len(differing) > SHOWN:
        parts.append(f"{len(differing) - SHOWN} more")
    return "; ".join(parts) or "settings under other names"


def _lacking(path: Path, kind: str | None) -> list[str]:
    """Columns of its kind that a table does not have."""
    from dldsim.tables.registry import COLUMNS

    if kind not in COLUMNS:
        return []
    import pyarrow.parquet as pq

    there = set(pq.read_schema(path).names)
    return [column.name for column in COLUMNS[kind] if column.name not in there]


def _short(value: Any) -> str:
    text = "nothing" if value is None else str(value)
    return text if len(text) <= LENGTH else f"{text[: LENGTH - 1]}…"


def _provenance(path: Path) -> Mapping[str, Any] | None:
    """What a table or the card of a surrogate says of its making. None if it says nothing."""
    try:
        if path.suffix == ".json":
            return json.loads(path.read_bytes()).get("provenance")
        if path.suffix == ".parquet" and path.exists():
            import pyarrow.parquet as pq

            from dldsim.tables.parquet import METADATA_KEY

            metadata = pq.read_metadata(path).metadata or {}
            return json.loads(metadata[METADATA_KEY])
    except (OSError, ValueError, KeyError, AttributeError):  # pyarrow's errors are of these kinds
        return None
    return None
