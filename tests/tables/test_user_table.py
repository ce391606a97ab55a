"""Tables of users are read wherever they can mean one thing only, and refused elsewhere."""

import decimal
import io
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from dldsim.errors import DldsimError
from dldsim.tables.user_table import read_user_table
from dldsim.tables.user_values import as_numbers

DATA = Path(__file__).parents[1] / "data" / "user_tables"
HEADER = "pillar_radius_um,gap_um,periodicity,stiffness_set,deformation_index,migration_angle_deg"
PLAIN = f"{HEADER}\n4.0,12.0,4,1,0.6816,2.2989\n4.0,12.5,4,3,0.7034,-0.5\n"


def read(text, where="table.csv"):
    return read_user_table(text if isinstance(text, bytes) else text.encode(), where)


def same(text, *words):
    """The table is PLAIN, and what was found is said."""
    frame, notes, _ = read(text)
    pd.testing.assert_frame_equal(frame[HEADER.split(",")], read(PLAIN).frame)
    assert all(any(word in note for note in notes) for word in words), notes


def test_a_plain_table_needs_no_note():
    frame, notes, about = read(PLAIN)
    assert (notes, about) == ([], {})
    assert frame["stiffness_set"].tolist() == ["1", "3"]
    assert frame["migration_angle_deg"].tolist() == [2.2989, -0.5]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (PLAIN.replace(",", ";"), ["semicolons"]),
        (PLAIN.replace(",", "\t"), ["tabs"]),
        ("sep=;\n" + PLAIN.replace(",", ";"), ["semicolons"]),
        (
            PLAIN.replace(",", ";").replace(".", ","),
            ["semicolons", "decimal commas in pillar_radius"],
        ),
        ("\n".join('"' + line.replace(",", '","') + '"' for line in PLAIN.strip().split("\n")), []),
        (
            "\n".join(
                '"' + line.replace(",", '","').replace(".", ",") + '"'
                for line in PLAIN.strip().split("\n")
            ),
            ["decimal commas"],
        ),
        (PLAIN.replace("gap_um", "gap_um "), ["'gap_um ' is read as gap_um"]),
        (PLAIN.replace("gap_um", "\N{NO-BREAK SPACE}Gap_Um"), ["is read as gap_um"]),
        (PLAIN.replace("\n4.0", "\n7,4.0").replace("pillar", ",pillar", 1), ["without a name"]),
        (
            PLAIN.replace("\n4.0,12.0", "\n0,4.0,12.0")
            .replace("\n4.0,12.5", "\n1,4.0,12.5")
            .replace("pillar", "Unnamed: 0,pillar", 1),
            ["without a name"],
        ),
        (
            PLAIN.replace("\n4.0,12.0", "\n1,4.0,12.0")
            .replace("\n4.0,12.5", "\n2,4.0,12.5")
            .replace("pillar", "X,pillar", 1),
            ["row numbers"],
        ),
        (
            PLAIN.replace("\n4.0,12.0", '\n"a",4.0,12.0').replace("\n4.0,12.5", '\n"b",4.0,12.5'),
            ["row numbers"],
        ),  # R's write.table: one name fewer
        (PLAIN.replace("\n", ",\n"), ["without a name"]),
        (PLAIN.replace("2.2989\n", "2.2989,\n").replace("-0.5\n", "-0.5,\n"), ["without a name"]),
        (PLAIN.encode("utf-16"), ["UTF-16"]),
        (PLAIN.encode("utf-16-be"), ["UTF-16"]),
        (PLAIN.encode("utf-8-sig"), []),
        (PLAIN.replace("\n", "\r\n"), []),
        (PLAIN.replace("\n", "\r"), []),
        ("Export of 2026;;;;;\n\n" + PLAIN.replace(",", ";"), ["1 lines above the header"]),
        (PLAIN + ",,,,,\n\n,,,,,\n", ["2 empty rows"]),
        (PLAIN.replace("-0.5", "\N{MINUS SIGN}0.5"), []),
        (
            PLAIN.replace("set,", "set,note \xb5,")
            .replace(",1,", ",1,5 \xb5m,")
            .replace(",3,", ",3,x,")
            .encode("cp1252"),
            ["CP1252"],
        ),
        (PLAIN.replace(",1,", ",1.0,").replace(",3,", ",3.0,"), []),
    ],
)
def test_what_can_mean_one_thing_only_is_read(text, words):
    same(text, *words)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"", ["is empty", "column names"]),
        (b"PK\x03\x04 and so on", ["Excel workbook", "as CSV"]),
        (b"\x1f\x8b\x08 and so on", ["gzip", "as CSV"]),
        (b"PAR1 cut off", ["not a readable Parquet"]),
        (b"a,b\n1,2\n\x00\x00\x00\x00" + b"x" * 300, ["zero bytes"]),
        (PLAIN[:-20], ["row 2 below the header", "fields", "cut off"]),
        (PLAIN.replace("2.2989", "2.2989,7,8"), ["6 columns", "8"]),
        (PLAIN.replace("gap_um", "pillar_radius_um"), ["pillar_radius_um is there more than once"]),
        (PLAIN.replace(",", ";").replace("12.0", "1.012,0"), ["'1.012,0' is no number"]),
        (HEADER.replace(",", ";") + "\n4,0;12.5;4;1;0,68;2,2\n", ["'4,0'", "'12.5'", "thousands"]),
        (HEADER + '\n4,"1,200",4,1,0,2\n', ["'1,200'", "thousands"]),
    ],
)
def test_what_can_mean_two_things_is_refused(text, words):
    with pytest.raises(DldsimError) as error:
        frame = read(text).frame
        as_numbers(frame["gap_um"], "table.csv")
    assert all(word in str(error.value) for word in words), error.value


CELLS = "radius_um,deformation_index\n"


@pytest.mark.parametrize(
    ("text", "radii", "indices"),
    [
        ("radius_um\n6,4\n6,6\n6,5\n", [6.4, 6.6, 6.5], None),
        ("radius_um\n6,4\n7\n6,55\n", [6.4, 7, 6.55], None),
        ("radius_um\n7\n6,4\nNA\n6,5\n", [7, 6.4, 6.5], None),
        ("radius_um\n1,5\n3,5\n", [1.5, 3.5], None),
        ("radius_um\r\n6,4\r\n6,6\r\n", [6.4, 6.6], None),
        (CELLS + "6,4,0,08\n6,6,0,09\n", [6.4, 6.6], [0.08, 0.09]),
        ('radius_um\n"1",6\n"2",7\n', [6, 7], None),  # R's write.table
        ("radius_um\n1,6.4\n2,6.6\n", [6.4, 6.6], None),
        ("radius_um\na,6\nb,7\n", [6, 7], None),
        (CELLS + "1,6.4,0.08\n2,6.6,0.09\n", [6.4, 6.6], [0.08, 0.09]),
    ],
)
def test_decimal_commas_between_commas_are_told_from_row_numbers(text, radii, indices):
    frame, notes, _ = read(text)
    np.testing.assert_array_equal(frame["radius_um"], radii)
    assert indices is None or frame["deformation_index"].tolist() == indices
    assert any("decimal commas" in n or "row numbers" in n for n in notes)
    assert list(frame) == CELLS.strip().split(",")[: 1 if indices is None else 2]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("radius_um\n1,6\n2,7\n3,5\n", "decimal sign"),
        ("radius_um\n0,6\n1,7\n", "decimal sign"),
        (CELLS + "6,0,08\n7,0,09\n", "decimal sign"),
        ("cell,radius_um\na,6,4\nb,6,6\n", "decimal sign"),
        ("cell,radius_um\n1,6,4\n2,6,6\n", "decimal sign"),
        (CELLS + "6,4,0,08\n7,0,09\n", "decimal point"),
        (CELLS + "6,4,0\n6,6,1\n", "decimal sign"),
        ("radius_um\n6,400\n6,600\n", "separate thousands"),
        ("radius_um\n6.4,0.08\n6.6,0.09\n", "no row number"),
        ("radius_um\n6,0.08\n7,0.09\n", "no row number"),
        ("radius_um\n6,4\n6.5\n", "no row number"),
    ],
)
def test_what_may_be_either_is_refused(text, words):
    with pytest.raises(DldsimError, match=words):
        read(text)


@pytest.mark.parametrize(
    "name",
    [
        "anova_excel_semicolon_decimal_comma.csv",
        "ANOVA_EXPORT.CSV",
        "anova_header_trailing_space.csv",
        "anova_r_factors_dictionary.parquet",
    ],
)
def test_files_of_strangers_hold_one_table(name):
    frame = read_user_table(DATA / name).frame
    plain = read_user_table(DATA / "anova_negative_sign.csv").frame
    plain["migration_angle_deg"] *= -1
    pd.testing.assert_frame_equal(frame, plain)


def test_empty_cells_are_null_whatever_they_are_called():
    for word in ("", "NA", "NaN", "null", "#N/A", " "):
        frame = read(PLAIN.replace("2.2989", word).replace(",1,", f",{word},")).frame
        assert np.isnan(frame["migration_angle_deg"][0]) and frame["stiffness_set"][0] is None


def test_columns_of_parquet_come_in_many_types():
    buffer = io.BytesIO()
    pq.write_table(
        pa.table(
            {
                "pillar_radius_um": pa.array([decimal.Decimal("4.5"), None]),
                "gap_um": pa.array(["12", "14.5"]).dictionary_encode(),
                "periodicity": pa.array(["4", "5"]),
                "stiffness_set": pa.array([1.0, None]),
                "deformation_index": pa.array([1, 0], pa.uint8()),
                "migration_angle_deg": pa.array([1.5, float("inf")], pa.float32()),
                "__index_level_0__": pa.array([5, 6]),
            }
        ),
        buffer,
    )
    frame, notes, _ = read(buffer.getvalue(), "t.parquet")
    assert list(frame) == HEADER.split(",") and "dictionary" in notes[0]
    assert frame["stiffness_set"].tolist() == ["1", None]
    numbers = [as_numbers(frame[n], "t") for n in frame if n != "stiffness_set"]
    assert [n.dtype for n in numbers] == [np.float64] * 5
    assert np.isnan(numbers[0][1]) and numbers[1].tolist() == [12, 14.5]
