"""Tables come back as they went in, or are refused with file, column and remedy."""

import json
import math

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dldsim import PHYSICS_VERSION
from dldsim.errors import DldsimError
from dldsim.tables import parquet, registry
from dldsim.tables.parquet import describe, read_columns, read_rows, read_table, write_table
from dldsim.tables.registry import COLUMNS

ABOUT = {"config_hash": "0123456789abcdef", "seed": 7}
finite = st.floats(allow_nan=False, allow_infinity=False)
VALUES = {
    "string": st.text(max_size=8),
    "int64": st.integers(-(2**63), 2**63 - 1),
    "double": finite,
    "bool": st.booleans(),
    "list<element: double>": st.lists(finite, max_size=4),
    "list<item: double>": st.lists(finite, max_size=4),
    "list<item: string>": st.lists(st.text(max_size=8), max_size=4),
}


def rows_of(kind):
    """Strategy: rows of a table, null where allowed."""
    columns = {}
    for column in COLUMNS[kind]:
        value = VALUES[str(column.type)]
        columns[column.name] = st.none() | value if column.nullable else value
    return st.lists(st.fixed_dictionaries(columns), max_size=4)


def example(kind="calibration_correlations", **changes):
    row = {"assay": "a", "variable_a": "ks", "variable_b": "kal", "pearson_r": 0.5, "n": 4}
    return [row | changes] if kind == "calibration_correlations" else []


@pytest.fixture
def path(tmp_path):
    return tmp_path / "sub" / "table.parquet"


@pytest.mark.parametrize("kind", COLUMNS)
@settings(max_examples=10, deadline=None)
@given(data=st.data())
def test_rows_come_back(kind, data, tmp_path_factory):
    rows = data.draw(rows_of(kind))
    path = tmp_path_factory.mktemp("t") / "table.parquet"
    write_table(kind, rows, path, ABOUT)
    assert read_rows(kind, path) == rows
    frame = read_table(kind, path)
    assert list(frame) == [c.name for c in COLUMNS[kind]] and len(frame) == len(rows)


@pytest.mark.parametrize("kind", COLUMNS)
def test_every_column_has_a_meaning(kind):
    for column in COLUMNS[kind]:
        assert column.description
        assert column.unit or column.type in (pa.string(), pa.bool_(), pa.list_(pa.string()))
    names = [c.name for c in COLUMNS[kind]]
    assert len(set(names)) == len(names)


def test_dict_list_and_frame_give_the_same(path):
    rows = example() + example(pearson_r=None, n=5)
    columns = {name: [row[name] for row in rows] for name in reversed(rows[0])}
    for data in (rows, columns, pd.DataFrame(rows), pd.DataFrame(rows).set_index("n", drop=False)):
        write_table("calibration_correlations", data, path, ABOUT)
        assert read_rows("calibration_correlations", path) == rows


def test_numpy_columns_are_taken(path):
    data = {
        "assay": ["x", "x"],
        "variable_a": np.array(["a", "b"]),
        "variable_b": ["c", "d"],
        "pearson_r": np.array([0.1, 0.2], np.float32),
        "n": np.array([1.0, 2.0]),
    }
    write_table("calibration_correlations", data, path, ABOUT)
    assert [row["n"] for row in read_rows("calibration_correlations", path)] == [1, 2]


@pytest.mark.parametrize(
    ("data", "parts"),
    [
        (example(pearson_r=math.nan), ["pearson_r", "row 0", "nan", "null"]),
        (example() + example(pearson_r=math.inf), ["pearson_r", "row 1", "inf"]),
        (pd.DataFrame(example(pearson_r=math.inf)), ["pearson_r", "inf"]),
        (example(n=None), ["column n", "row 0", "must have a value"]),
        (example(n=1.5), ["column n", "int64"]),
        (example(pearson_r="high"), ["pearson_r", "double"]),
        (example(extra=1), ["unknown extra"]),
        ([{"variable_a": "x"}], ["missing assay, variable_b, pearson_r, n"]),
        (
            {key: [value] for key, value in example()[0].items()} | {"variable_a": ["a", "b"]},
            ["unequal"],
        ),
    ],
)
def test_bad_data_is_refused(data, parts, path):
    with pytest.raises(DldsimError) as caught:
        write_table("calibration_correlations", data, path, ABOUT)
    assert all(part in str(caught.value) for part in parts), str(caught.value)
    assert not path.exists()


def test_not_finite_inside_a_list_is_refused(path):
    blank = {c.name: 0 for c in COLUMNS["runs"]}
    for name in (c.name for c in COLUMNS["runs"] if c.type == pa.string()):
        blank[name] = ""
    rows = [blank | {"lateral_steps_um": [1.0]}, blank | {"lateral_steps_um": [0.0, math.nan]}]
    with pytest.raises(DldsimError, match="lateral_steps_um, row 1"):
        write_table("runs", rows, path, ABOUT)


def test_unknown_kind(path):
    with pytest.raises(DldsimError, match="Unknown kind"):
        write_table("run", [], path, ABOUT)


def test_failed_write_leaves_the_old_table(path, monkeypatch):
    write_table("calibration_correlations", example(), path, ABOUT)

    def fail(table, part, **options):
        part.write_bytes(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(parquet.pq, "write_table", fail)
    with pytest.raises(KeyboardInterrupt):
        write_table("calibration_correlations", example(n=9), path, ABOUT)
    assert read_rows("calibration_correlations", path) == example()
    assert [p.name for p in path.parent.iterdir()] == [path.name]


def test_absent_truncated_and_foreign_files_are_refused(path, tmp_path):
    with pytest.raises(DldsimError, match="does not exist.*snakemake -j2 runs"):
        read_columns("runs", path)
    write_table("calibration_correlations", example(), path, ABOUT)
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(DldsimError, match="truncated.*Delete it"):
        read_columns("calibration_correlations", path)
    text = tmp_path / "text.parquet"
    text.write_text("run_id\n")
    with pytest.raises(DldsimError, match="(not a readable|no) Parquet"):
        describe(text)
    foreign = tmp_path / "foreign.parquet"
    pq.write_table(pa.table({"run_id": ["a"]}), foreign)
    with pytest.raises(DldsimError, match="not written by dldsim"):
        read_table("runs", foreign)


def test_damaged_pages_are_refused(path):
    rows = [row for n in range(500) for row in example(n=n, pearson_r=n / 500)]
    write_table("calibration_correlations", rows, path, ABOUT)
    content = bytearray(path.read_bytes())
    content[4:400] = bytes(396)
    path.write_bytes(content)
    with pytest.raises(DldsimError, match="Delete it"):
        read_columns("calibration_correlations", path)


@pytest.mark.parametrize("record", [b"{}", b"[]", b"null", b"{"])
def test_damaged_metadata_are_refused(path, record):
    path.parent.mkdir(parents=True)
    table = pa.table({"x": [1.0]}).replace_schema_metadata({parquet.METADATA_KEY: record})
    pq.write_table(table, path)
    with pytest.raises(DldsimError, match="metadata are damaged"):
        describe(path)


def test_other_kind_physics_and_columns_are_refused(path, monkeypatch):
    write_table("calibration_correlations", example(), path, ABOUT)
    with pytest.raises(DldsimError, match="kind calibration_correlations, not runs"):
        read_columns("runs", path)
    monkeypatch.setattr(parquet, "PHYSICS_VERSION", PHYSICS_VERSION + 1)
    with pytest.raises(DldsimError, match="physics version.*--forceall"):
        read_columns("calibration_correlations", path)
    monkeypatch.undo()
    shorter = {"calibration_correlations": COLUMNS["calibration_correlations"][:-1]}
    monkeypatch.setattr(registry, "COLUMNS", shorter)
    with pytest.raises(DldsimError, match=r"other columns .*\(n\)"):
        read_columns("calibration_correlations", path)


def test_description_tells_units_and_origin(path):
    write_table("calibration_correlations", example(), path, ABOUT)
    about = describe(path)
    assert (about["kind"], about["rows"]) == ("calibration_correlations", 1)
    assert about["provenance"]["seed"] == 7
    assert about["provenance"]["physics_version"] == PHYSICS_VERSION
    assert [c["name"] for c in about["columns"]] == [
        "assay",
        "variable_a",
        "variable_b",
        "pearson_r",
        "n",
    ]
    assert all(c["description"] for c in about["columns"])


def test_concatenation_keeps_order_and_rows(tmp_path):
    parts = [tmp_path / f"{i}.parquet" for i in range(3)]
    for i, part in enumerate(parts):
        write_table("calibration_correlations", example(n=i) * i, part, ABOUT)
    whole = tmp_path / "whole.parquet"
    parquet.concatenate("calibration_correlations", parts, whole, ABOUT)
    assert [row["n"] for row in read_rows("calibration_correlations", whole)] == [1, 2, 2]
    assert len(parquet.read_many("calibration_correlations", parts)) == 3
    parquet.concatenate("calibration_correlations", [], whole, ABOUT)
    assert read_rows("calibration_correlations", whole) == []


def test_csv_twin_holds_the_same(path):
    rows = example() + example(pearson_r=None)
    write_table("calibration_correlations", rows, path, ABOUT)
    csv = parquet.write_csv("calibration_correlations", path)
    frame = pd.read_csv(csv)
    assert csv == path.with_suffix(".csv")
    assert list(frame) == list(rows[0]) and frame.pearson_r.isna().tolist() == [False, True]


def test_csv_twin_writes_lists_as_json(path):
    blank = {c.name: 0 for c in COLUMNS["runs"]}
    blank |= {c.name: "" for c in COLUMNS["runs"] if c.type == pa.string()}
    lists = {"lateral_steps_um": [1.5, -2.0], "incurable": ["μU is too large"]}
    lists |= {"probe_offsets": [0.8], "probe_steps": []}
    write_table("runs", [blank | lists], path, ABOUT)
    frame = pd.read_csv(parquet.write_csv("runs", path))
    assert json.loads(frame.lateral_steps_um[0]) == [1.5, -2.0]
    assert frame.incurable[0] == '["μU is too large"]'
