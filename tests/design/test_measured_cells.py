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
