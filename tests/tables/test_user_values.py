"""Values of users' tables: numbers, names, what a column can hold."""

import datetime

import numpy as np
import pandas as pd
import pytest

from dldsim.errors import DldsimError
from dldsim.tables.user_values import as_key, as_keys, as_numbers, check_plausible, need


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ([True, False], ["True", "true or false", "1 more rows"]),
        ([1.0, True], ["true or false"]),
        ([1.0, "7.5 um"], ["row 2", "'7.5 um' is no number"]),
        ([datetime.date(2026, 5, 4), 1.0], ["2026-05-04", "no number"]),
        ([[1.0], 1.0], ["no number"]),
        ([1 + 2j, 1.0], ["no number"]),
    ],
)
def test_what_is_no_number_is_refused(values, words):
    with pytest.raises(DldsimError) as error:
        as_numbers(pd.Series(values, name="gap_um"), "here")
    assert all(word in str(error.value) for word in ("here, column gap_um", *words)), error.value


@pytest.mark.parametrize(
    ("given", "key"),
    [
        (1, "1"),
        (1.0, "1"),
        ("1.0", "1"),
        (" 1 ", "1"),
        (np.int8(3), "3"),
        (np.float32(3), "3"),
        ("soft", "soft"),
        ("1.5", "1.5"),
        ("01", "01"),
        (None, None),
        (float("nan"), None),
        ("", None),
    ],
)
def test_a_key_is_the_same_text_from_every_type(given, key):
    assert as_key(given) == key
    assert as_keys(pd.Series([given, "x"], dtype=object)).tolist() == [key, "x"]


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("pillar_radius_um", -5, ["-5", "0.1 to 1000"]),
        ("pillar_radius_um", 4e-6, ["In m it would be 4 µm", "1e+06"]),
        ("gap_um", 0.018, ["In mm it would be 18 µm"]),
        ("periodicity", 0, ["0", "whole numbers from 2"]),
        ("periodicity", 4.5, ["4.5", "whole numbers"]),
        ("deformation_index", 7, ["7", "0 to 1"]),
        ("migration_angle_deg", 9999, ["9999", "-90 to 90"]),
    ],
)
def test_what_a_column_cannot_hold_is_refused(name, value, words):
    check_plausible(pd.Series([np.nan, np.inf], name=name, dtype=float), "here")
    with pytest.raises(DldsimError) as error:
        check_plausible(pd.Series([np.nan, value], name=name, dtype=float), "here")
    assert all(word in str(error.value) for word in ("row 2", *words)), error.value


def test_missing_columns_are_told_with_those_like_them():
    frame = pd.DataFrame(columns=["pillar_radius_m", "gap_umm", "x"])
    with pytest.raises(DldsimError) as error:
        need(frame, ["pillar_radius_um", "gap_um", "periodicity"], "here")
    text = str(error.value)
    assert "lacks pillar_radius_um, gap_um, periodicity" in text
    assert "Found: pillar_radius_m, gap_umm, x" in text
    assert "Is pillar_radius_m meant by pillar_radius_um? Rename it and mind the unit." in text
    assert "Is gap_umm meant by gap_um?" in text
