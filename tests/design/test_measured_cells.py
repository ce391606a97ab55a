"""Measured cells: read as they are meant, and refused with what to do."""

import numpy as np
import pytest

from dldsim.design.measured_cells import read_measured
from dldsim.errors import DldsimError


def read(text):
    return read_measured(text.encode(), "cells.csv")


def test_radii_alone():
    cells = read("radius_um\n7.5\n6.5\n7.0\n")
    np.testing.assert_allclose(cells.radius_um, [6.5, 7.0, 7.5])
    assert cells.deformation_index is cells.ks_uN_per_m is None and cells.notes == []


def test_a_cell_keeps_its_index():
    cells = read("deformation_index;radius_um\n0,7;7,5\n0,6;6,5\n")
    np.testing.assert_allclose(cells.radius_um, [6.5, 7.5])
    np.testing.assert_allclose(cells.deformation_index, [0.6, 0.7])
    assert cells.notes


def test_levels_take_every_cell_as_often():
    cells = read("radius_um,ks_uN_per_m\n1,10\n2,20\n3,30\n4,40\n")
    level = (np.arange(100) + 0.5) / 100
    assert np.bincount(cells.place(level)).tolist() == [25] * 4
    assert cells.place(np.array([0.0, 1.0])).tolist() == [0, 3]


def test_rows_without_a_value_are_left_out_and_told():
    cells = read("radius_um,ks_uN_per_m\n7,10\n8,\n9,12\n")
    assert len(cells.radius_um) == 2 and "1 rows without" in cells.notes[-1]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("radius_mm\n0.0075\n0.0065\n", "radius_mm meant by radius_um.*mind the unit"),
        ("diameter_um\n15\n13\n", "diameter_um, and no radius_um.*Halve"),
        ("radius_um\n0.0075\n0.0065\n", "0.0075; allowed 0.1 to 100.*In mm it would be 7"),
        ("radius_um\n7500\n6500\n", "In nm it would be 7"),
        ("radius_um\n-7\n6.5\n", "-7; allowed 0.1 to 100"),
        ("radius_um,deformation_index\n7,55\n6,65\n", "look like per cent.*Divide them by 100"),
        ("radius_um,deformation_index,ks_uN_per_m\n7,0.5,5\n6,0.6,6\n", "both.*Leave one out"),
        ("radius_um,ks_uN_per_m\n7,0\n6,6\n", "above 0"),
        ("radius_um\n7\n", "1 cells are no population"),
        ("radius_um\nlarge\nsmall\n", "'large' is no number"),
    ],
)
def test_what_cannot_be_meant_is_refused(text, message):
    with pytest.raises(DldsimError, match=message):
        read(text)


@pytest.mark.parametrize(
    ("header", "note"),
    [
        ("ks", "is ks_uN_per_m meant by ks?"),
        ("DI", "is deformation_index meant by DI?"),
        ("Deformation index", "is deformation_index meant by Deformation index?"),
        ("ks_uN_m", "is ks_uN_per_m meant by ks_uN_m?"),
        ("remark", "not used: column remark"),
    ],
)
def test_columns_that_are_not_used_are_told(header, note):
    cells = read_measured(f"radius_um,{header}\n6.0,0.1\n6.1,0.2\n".encode(), "a.csv")
    assert cells.deformation_index is None and cells.ks_uN_per_m is None
    assert note in cells.unused and cells.unused in cells.notes
    assert ("?" in cells.unused) == ("?" in note)


def test_values_in_each_others_column_are_refused():
    table = b"radius_um,deformation_index\n0.08,6.4\n0.09,6.6\n"
    with pytest.raises(DldsimError, match=r"radius_um is 0.085 .* Swap the names"):
        read_measured(table, "a.csv")


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (("1e-5", "1.1e-5"), "In N/m it would be 10.5 µN/m: multiply the column by 1e"),
        (("1e7", "1.2e7"), "In pN/m it would be 11 µN/m"),
        (("10", "1e-4"), r"row 2 of the cells: 0.0001 µN/m; allowed 0.001 to 1e\+06"),
    ],
)
def test_spring_constants_of_another_unit_are_refused_with_file_and_column(values, words):
    table = "radius_um,ks_uN_per_m\n" + "".join(f"6.4,{value}\n" for value in values)
    with pytest.raises(DldsimError, match=f"a.csv, column ks_uN_per_m, .*{words}"):
        read_measured(table.encode(), "a.csv")


def test_a_column_that_would_be_one_too_many_is_not_suggested():
    cells = read_measured(b"radius_um,deformation_index,ks\n6.0,0.1,5\n6.1,0.2,5\n", "a.csv")
    assert cells.unused == "not used: column ks"


def test_a_column_of_radii_by_another_name_is_suggested():
    with pytest.raises(DldsimError, match="Is Radius meant by radius_um"):
        read_measured(b"Radius,DI\n6.0,0.1\n6.1,0.2\n", "a.csv")
