"""Parquet tables with unit, meaning and provenance in the file: reading and writing.

A table is written whole or not at all, holds no NaN (null means "not measured"), and is refused on
reading if it is truncated, foreign, of another kind, or of another physics version.
"""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet as pq

from dldsim import PHYSICS_VERSION, __version__
from dldsim.errors import DldsimError
from dldsim.files import atomic_path, why_not_read
from dldsim.tables.registry import rule_of, schema

METADATA_KEY = b"dldsim"


def write_table(kind: str, data: Any, path: Path, provenance: Mapping[str, Any]) -> None:
    """Write a table whole or not at all.

    `data` is a dict of columns, a list of row dicts, or a pandas DataFrame (whose NaN is null).
    `provenance` goes into the file's metadata beside the versions: `config_hash`, `seed`, …
    Raises DldsimError naming the column for a missing, extra, mistyped or not finite one.
    """
    target = schema(kind)
    columns = _as_columns(kind, data, target.names)
    arrays = [_array(kind, field, columns[field.name]) for field in target]
    lengths = {field.name: len(array) for field, array in zip(target, arrays, strict=True)}
    if len(set(lengths.values())) > 1:
        raise DldsimError(
            f"table {kind}: columns of unequal length: {lengths}.",
            key=list(lengths),
            allowed="one length",
        )
    table = pa.table(arrays, schema=_stamped(kind, target, provenance))
    with atomic_path(path) as part:
        pq.write_table(table, part, compression="zstd")


def concatenate(
    kind: str, sources: Iterable[Path], path: Path, provenance: Mapping[str, Any]
) -> None:
    """Join tables of one kind into one, in order, one row group per non-empty source."""
    target = _stamped(kind, schema(kind), provenance)
    with atomic_path(path) as part, pq.ParquetWriter(part, target, compression="zstd") as writer:
        for source in sources:
            table = read_columns(kind, source)
            if table.num_rows:
                writer.write_table(table.replace_schema_metadata(target.metadata))


def read_columns(kind: str, path: Path) -> pa.Table:
    """A checked table as Arrow columns.

    Raises DldsimError if the file is absent, truncated, foreign, of another kind or another
    physics version.
    """
    metadata = _provenance(path, kind)
    if metadata["kind"] != kind:
        raise DldsimError(
            f"{path} holds a table of kind {metadata['kind']}, not {kind}.",
            key=str(path),
            value=metadata["kind"],
            allowed=kind,
        )
    if metadata["physics_version"] != PHYSICS_VERSION:
        raise DldsimError(
            f"{path} was made by physics version {metadata['physics_version']} (dldsim "
            f"{metadata['dldsim_version']}); this is version {PHYSICS_VERSION} (dldsim "
            f"{__version__}), whose results differ.",
            key=str(path),
            value=metadata["physics_version"],
            allowed=str(PHYSICS_VERSION),
            remedy="Move results/ away, or make everything anew with "
            "`snakemake -j2 all --forceall`.",
        )
    try:
        table = pq.ParquetFile(path).read()
    except (pa.ArrowInvalid, OSError) as error:
        raise _unreadable(path, error, kind) from error
    if not table.schema.equals(schema(kind)):
        differing = set(table.schema.names) ^ set(schema(kind).names)
        raise DldsimError(
            f"{path} has other columns than a table of kind {kind} in dldsim {__version__} "
            f"({', '.join(sorted(differing)) or 'types or order differ'}); it was made by dldsim "
            f"{metadata['dldsim_version']}.",
            key=sorted(differing) or str(path),
            allowed=", ".join(schema(kind).names),
            remedy=f"Move it away and run `snakemake -j2 {rule_of(kind)}`.",
        )
    return table


def read_table(kind: str, path: Path):
    """A checked table as a pandas DataFrame; see `read_columns`."""
    return read_columns(kind, path).to_pandas()


def read_many(kind: str, paths: Iterable[Path]):
    """Checked tables of one kind, one below the other, as a pandas DataFrame."""
    return pa.concat_tables(
        [schema(kind).empty_table(), *(read_columns(kind, p) for p in paths)],
        promote_options="default",
    ).to_pandas()


def read_rows(kind: str, path: Path) -> list[dict]:
    """A checked table as a list of row dicts; see `read_columns`."""
    return read_columns(kind, path).to_pylist()


def write_csv(kind: str, path: Path) -> Path:
    """Write a table's CSV twin beside it, lists as JSON; returns its path."""
    table = read_columns(kind, path)
    for i, field in enumerate(table.schema):
        if pa.types.is_list(field.type):
            texts = [
                None if v is None else json.dumps(v, ensure_ascii=False)
                for v in table[i].to_pylist()
            ]
            table = table.set_column(i, field.name, pa.array(texts, pa.string()))
    csv = Path(path).with_suffix(".csv")
    with atomic_path(csv) as part:
        pyarrow.csv.write_csv(table, part)
    return csv


def describe(path: Path) -> dict:
    """Kind, provenance, rows and columns (name, type, unit, description) of any dldsim table."""
    metadata = _provenance(path)
    file = pq.ParquetFile(path)
    columns = [
        {
            "name": field.name,
            "type": str(field.type),
            "nullable": field.nullable,
            "unit": (field.metadata or {}).get(b"unit", b"").decode(),
            "description": (field.metadata or {}).get(b"description", b"").decode(),
        }
        for field in file.schema_arrow
    ]
    kind = metadata.pop("kind")
    return {
        "file": str(path),
        "kind": kind,
        "rows": file.metadata.num_rows,
        "columns": columns,
        "provenance": metadata,
    }


def _stamped(kind: str, target: pa.Schema, provenance: Mapping[str, Any]) -> pa.Schema:
    record = {"kind": kind, "dldsim_version": __version__, "physics_version": PHYSICS_VERSION}
    text = json.dumps(record | dict(provenance), ensure_ascii=False, sort_keys=True)
    return target.with_metadata({METADATA_KEY: text.encode()})


def _unreadable(path: Path, error: Exception, kind: str | None = None) -> DldsimError:
    """Damaged; no Parquet file at all; or good but out of reach, no reason to delete it."""
    if Path(path).is_dir():
        return DldsimError(
            f"{path} is a folder.", key=str(path), remedy="Name a table in it, a .parquet file."
        )
    if reason := why_not_read(path, error):
        return DldsimError(reason, key=str(path))
    if kind is None and not _begins_as_parquet(path):
        return DldsimError(
            f"{path} is no Parquet file.",
            key=str(path),
            remedy="Name the .parquet file of a table of dldsim; it lies beside its CSV twin.",
        )
    return DldsimError(
        f"{path} is not a readable Parquet file: truncated, or of another format.",
        key=str(path),
        remedy=f"Delete it and run `snakemake -j2 {rule_of(kind)}`, which makes it anew.",
    )


def _begins_as_parquet(path: Path) -> bool:
    with Path(path).open("rb") as file:
        return file.read(4) == b"PAR1"


def _provenance(path: Path, kind: str | None = None) -> dict:
    try:
        metadata = pq.ParquetFile(path).schema_arrow.metadata or {}
    except FileNotFoundError as error:
        raise DldsimError(
            f"{path} does not exist.",
            key=str(path),
            remedy=f"Check the path, or make it with `snakemake -j2 {rule_of(kind)}`.",
        ) from error
    except (pa.ArrowInvalid, OSError) as error:
        raise _unreadable(path, error, kind) from error
    if METADATA_KEY not in metadata:
        raise DldsimError(
            f"{path} was not written by dldsim: it carries no dldsim metadata.",
            key=str(path),
            remedy="Move it out of the results folder, or check the path.",
        )
    try:
        found = json.loads(metadata[METADATA_KEY])
    except ValueError:
        found = None
    if not isinstance(found, dict) or not {"kind", "physics_version"} <= found.keys():
        raise DldsimError(
            f"{path}: its dldsim metadata are damaged.",
            key=str(path),
            remedy=f"Make it anew with `snakemake -j2 {rule_of(kind)}`.",
        )
    return found


def _as_columns(kind: str, data: Any, names: Sequence[str]) -> dict[str, Any]:
    if isinstance(data, list):
        given = dict.fromkeys(name for row in data for name in row) if data else names
        columns = {name: [row.get(name) for row in data] for name in given}
        absent = {name for row in data for name in names if name not in row}
    elif isinstance(data, Mapping):
        columns, absent = dict(data), set()
    else:  # DataFrame
        columns, absent = {name: data[name] for name in data.columns}, set()
    absent |= set(names) - set(columns)
    extra = [str(name) for name in columns if name not in names]
    if absent or extra:
        parts = [
            f"missing {', '.join(n for n in names if n in absent)}" if absent else "",
            f"unknown {', '.join(extra)}" if extra else "",
        ]
        raise DldsimError(
            f"table {kind}: columns {' and '.join(filter(None, parts))}.",
            key=[*(n for n in names if n in absent), *extra],
            allowed=", ".join(names),
        )
    return columns


def _array(kind: str, field: pa.Field, values: Any) -> pa.Array:
    """One checked Arrow column."""
    where = f"table {kind}, column {field.name}"
    is_series = hasattr(values, "to_numpy")
    try:
        array = pa.array(values, from_pandas=is_series)
        if isinstance(array, pa.ChunkedArray):
            array = array.combine_chunks()
        array = array.cast(field.type)
    except (pa.ArrowException, TypeError, ValueError) as error:
        raise DldsimError(
            f"{where}: cannot be held as {field.type}: {error}",
            key=field.name,
            allowed=str(field.type),
        ) from error
    flat = array.flatten() if pa.types.is_list(field.type) else array
    if pa.types.is_floating(flat.type):
        bad = pc.indices_nonzero(pc.fill_null(pc.invert(pc.is_finite(flat)), False))
        if len(bad):
            row = bad[0].as_py()
            if flat is not array:
                row = pc.list_parent_indices(array)[row].as_py()
            value = array[row].as_py()
            value = value if isinstance(value, list) or math.isnan(value) else f"{value}"
            raise DldsimError(
                f"{where}, row {row}: {value} is not finite.",
                key=field.name,
                value=value,
                allowed="finite numbers",
                remedy="Use null for a value that was not measured.",
            )
    nulls = array.null_count if not field.nullable else 0
    nulls += flat.null_count if flat is not array else 0
    if nulls:
        row = np.flatnonzero(array.is_null().to_numpy(zero_copy_only=False))
        raise DldsimError(
            f"{where}{f', row {row[0]}' if row.size else ''}: null in a column that must have a "
            "value.",
            key=field.name,
            allowed="a value in every row",
        )
    return array
