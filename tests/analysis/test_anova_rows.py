"""Which rows of a table are analysed, and what is said of the others."""

import numpy as np
import pandas as pd
import pytest

from dldsim.analysis.anova import anova
from dldsim.errors import DldsimError
from tests.analysis.made_factorial import factorial, noisy, pick


def test_rows_without_angle_are_counted():
    frame = factorial(noisy(r=1))
    frame.loc[[3, 5], "migration_angle_deg"] = np.nan
    row = pick(anova(frame), "main_effects", "rows")
    assert "2 of 81" in row["note"]
    assert pick(anova(frame), "main_effects", "residual")["df"] == 79 - 8


def test_every_row_that_is_left_out_is_counted_once():
    frame = factorial(noisy(r=1)).assign(status="decided")
    frame.loc[[3, 5], "migration_angle_deg"] = np.nan
    frame.loc[5, "status"] = "stuck"
    frame.loc[5, "gap_um"] = np.nan
    frame.loc[7, "migration_angle_deg"] = np.inf
    frame.loc[[9, 10, 11], "stiffness_set"] = [None, np.nan, ""]
    table = anova(frame)
    rows = table[(table["model"] == "hierarchical") & (table["term"] == "rows")]["note"].tolist()
    assert sorted(rows) == [
        "1 of 81 rows left out: infinite migration_angle_deg (status decided: 1)",
        "1 of 81 rows left out: no gap_um (status stuck: 1)",
        "1 of 81 rows left out: no migration_angle_deg (status decided: 1)",
        "3 of 81 rows left out: no stiffness_set (status decided: 3)",
    ]
    assert pick(table, "main_effects", "residual")["df"] == 75 - 8
    few = [f"row {n}" for n in anova(frame.sample(frac=1, random_state=1))["note"] if "rows" in n]
    assert len(few) == 3 * 4  # whatever the index of the frame


def test_rows_beyond_the_bound_are_counted(monkeypatch):
    monkeypatch.setattr("dldsim.analysis.anova_rows.ROWS_MOST", 60)
    frame = factorial(noisy(r=1))
    table = anova(frame)
    assert "21 of 81 rows left out: at most 60" in pick(table, "main_effects", "rows")["note"]
    assert pick(table, "main_effects", "residual")["df"] == 60 - 8
    monkeypatch.setattr(
        "dldsim.analysis.anova_rows.ROWS_MOST", 170
    )  # two of each cell stay balanced
    table = anova(
        pd.concat(
            [
                frame.assign(
                    replicate=i, migration_angle_deg=lambda t, i=i: t["migration_angle_deg"] + i
                )
                for i in range(3)
            ]
        )
    )
    assert "81 of 243 rows left out: at most 170" in pick(table, "main_effects", "rows")["note"]
    assert pick(table, "main_effects", "pillar_radius_um")["p_permutation"] <= 0.01


def test_many_levels_are_refused():
    frame = factorial(noisy(r=1)).assign(gap_um=np.linspace(10, 20, 81))
    with pytest.raises(DldsimError, match="gap_um has 81 different values.*bin it"):
        anova(frame)


def test_rows_that_are_there_twice_are_refused_but_repeats_are_not():
    frame = factorial(noisy(seed=1, r=1))
    with pytest.raises(DldsimError, match="rows 1 and 82 below the header.*replicate"):
        anova(pd.concat([frame, frame[:1]]))
    again = pd.concat(
        [
            frame.assign(
                replicate=i, migration_angle_deg=lambda t, i=i: t["migration_angle_deg"] + 0.01 * i
            )
            for i in range(3)
        ]
    )
    table = anova(again)
    note = pick(table, "hierarchical", "residual")["note"]
    assert "162 degrees of freedom" in note and "simulation" not in note
    scatter = float(note.partition("squares ")[2].split()[0])
    assert scatter == pytest.approx(81 * 2 * 0.01**2, rel=1e-3)


def test_measured_angles_need_no_stiffness_set():
    frame = factorial(noisy(seed=3, r=0.5))
    table = anova(frame.drop(columns="stiffness_set"))
    same = anova(frame)
    assert pick(table, "hierarchical", "pillar_radius_um").equals(
        pick(same, "hierarchical", "pillar_radius_um")
    )
    assert "deformation_index" in pick(table, "hierarchical", "stiffness_set")["note"]


@pytest.mark.parametrize(
    ("angle", "word"),
    [
        (lambda f: -f, "against the row shift"),
        (lambda f: np.radians(f), "radians"),
        (lambda f: 3 * f, "no array moves cells so far"),
        (lambda f: f, None),
    ],
)
def test_a_doubtful_unit_is_said(angle, word):
    draw = np.random.default_rng(2)
    frame = factorial(lambda r, g, n, d: np.degrees(np.arctan(1 / n)) * draw.choice([0.02, 1]))
    notes = anova(frame.assign(migration_angle_deg=angle(frame["migration_angle_deg"])))
    notes = notes[notes["term"] == "migration_angle_deg"]["note"]
    assert notes.str.contains(word).all() and len(notes) == 3 if word else notes.empty


def test_other_conditions_in_the_table_are_said():
    frame = factorial(noisy(r=1)).assign(height_um=np.where(np.arange(81) % 2, 20.0, 30.0))
    assert "2 different values" in pick(anova(frame), "main_effects", "height_um")["note"]


@pytest.mark.parametrize("type_", ["category", "Float64", object, "string", "float32"])
def test_types_of_columns_do_not_matter(type_):
    frame = factorial(noisy(seed=1, r=1)).astype({"gap_um": float}).round(6)
    for name in ("gap_um", "periodicity", "stiffness_set"):
        if name != "stiffness_set" or type_ not in ("Float64", "float32"):
            frame[name] = frame[name].astype(type_)
    expected = anova(factorial(noisy(seed=1, r=1)).round(6))
    pd.testing.assert_frame_equal(anova(frame), expected)


@pytest.mark.parametrize(
    "spoil, words",
    [
        (lambda f: f.drop(columns=["gap_um", "periodicity"]), ["lacks gap_um, periodicity"]),
        (lambda f: f.assign(deformation_index=np.nan), ["deformation_index", "calibration"]),
        (lambda f: f.assign(migration_angle_deg=np.nan), ["migration_angle_deg"]),
        (lambda f: f.assign(migration_angle_deg=3.0), ["no variance"]),
        (lambda f: f.assign(gap_um="wide"), ["gap_um", "'wide' is no number"]),
        (lambda f: f.iloc[:0], ["none of the 0 rows"]),
        (lambda f: f.assign(pillar_radius_um=-5), ["pillar_radius_um", "-5", "0.1 to 1000"]),
        (lambda f: f.assign(gap_um=f["gap_um"] * 1e-6), ["gap_um", "In m it would be 1"]),
        (lambda f: f.assign(periodicity=4.5), ["periodicity", "4.5", "whole numbers"]),
        (lambda f: f.assign(deformation_index=7), ["deformation_index", "7", "0 to 1"]),
        (lambda f: f.assign(migration_angle_deg=9999), ["9999", "-90 to 90"]),
        (lambda f: f.assign(gap_um=f["gap_um"] > 18), ["gap_um", "true or false"]),
    ],
)
def test_unusable_tables_are_refused(spoil, words):
    with pytest.raises(DldsimError) as error:
        anova(spoil(factorial(noisy())))
    assert all(word in str(error.value) for word in words)
