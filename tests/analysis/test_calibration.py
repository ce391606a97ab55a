"""Laws of the calibration: statistics by hand, and an inverse that inverts."""

import numpy as np
import pandas as pd
import pytest

from dldsim.analysis.calibration import (
    calibrate,
    correlations,
    join_deformation_index,
    stiffness_for,
)
from dldsim.errors import DldsimError


def constriction_runs(centres=(0.5, 0.6, 0.7), offsets=(-0.02, 0.0, 0.02)):
    """Groups G1, G2, … with k_s 5, 10, …, DI = centre + offset."""
    return pd.DataFrame(
        [
            {
                "design": "group-velocity",
                "group": f"G{i}",
                "stiffness_set": str(i) if i < 3 else "",
                "ks_uN_per_m": 5.0 * i,
                "kb_pN_um": 0.04 * i**2,
                "kal_uN_per_m": 10.0 * i,
                "velocity_mm_s": 1.0 + 0.5 * i,
                "deformation_index": centre + offset,
            }
            for i, centre in enumerate(centres, 1)
            for offset in offsets
        ]
    )


def test_group_statistics_by_hand():
    row = calibrate(constriction_runs()).set_index("group").loc["G1"]
    assert row["runs"] == 3
    assert row["deformation_index"] == pytest.approx(0.5)
    assert row["deformation_index_std"] == pytest.approx(0.02)
    assert row["deformation_index_min"] == pytest.approx(0.48)
    assert row["deformation_index_max"] == pytest.approx(0.52)
    assert row["coefficient_of_variation"] == pytest.approx(0.04)
    reach = 4.302653 * 0.02 / 3**0.5  # Student's t, 2 degrees of freedom
    assert row["deformation_index_low"] == pytest.approx(0.5 - reach)
    assert row["deformation_index_high"] == pytest.approx(0.5 + reach)


def test_designs_stand_side_by_side():
    """At one velocity the index falls, at the groups' own it rises: neither hides the other."""
    own = constriction_runs()
    fixed = constriction_runs((0.7, 0.6, 0.5)).assign(
        design="fixed-velocity", stiffness_set="", velocity_mm_s=2.0
    )
    both = pd.concat([fixed, own], ignore_index=True)
    table = calibrate(both)
    assert table["design"].tolist() == ["group-velocity"] * 3 + ["fixed-velocity"] * 3
    pd.testing.assert_frame_equal(table.head(3), calibrate(own))
    r = correlations(both).set_index(["design", "variable_a", "variable_b"])["pearson_r"]
    assert r["group-velocity", "deformation_index", "ks_uN_per_m"] > 0.9
    assert r["fixed-velocity", "deformation_index", "ks_uN_per_m"] < -0.9
    assert np.isnan(r["fixed-velocity", "deformation_index", "velocity_mm_s"])
    runs = pd.DataFrame({"stiffness_set": ["1", "2"]})
    assert join_deformation_index(runs, table)["deformation_index"].tolist() == pytest.approx(
        [0.5, 0.6]
    )
    assert stiffness_for(0.65, table)["ks_uN_per_m"] == pytest.approx(12.5)
    assert stiffness_for(0.65, table, design="fixed-velocity")["ks_uN_per_m"] == pytest.approx(7.5)
    with pytest.raises(DldsimError, match="no design 'other'"):
        stiffness_for(0.65, table, design="other")


def test_failed_runs_are_left_out_and_counted():
    runs = constriction_runs()
    runs.loc[[0, 3, 4, 6, 7, 8], "deformation_index"] = np.nan
    table = calibrate(runs).set_index("group")
    assert table["runs"].to_dict() == {"G1": 2, "G2": 1, "G3": 0}
    assert table.loc["G1", "deformation_index"] == pytest.approx(0.51)
    assert np.isnan(table.loc["G2", "deformation_index_std"])
    assert np.isnan(table.loc["G3", "deformation_index"])


def test_correlations_know_a_straight_line_and_a_constant():
    table = correlations(constriction_runs(offsets=(0.0,)))
    table = table.set_index(["variable_a", "variable_b"])
    assert len(table) == 10 and (table["n"] == 3).all()
    assert table.loc[("deformation_index", "ks_uN_per_m"), "pearson_r"] == pytest.approx(1)
    fixed = correlations(constriction_runs().assign(velocity_mm_s=1.0))
    constant = fixed[fixed["variable_b"] == "velocity_mm_s"]
    assert constant["pearson_r"].isna().all()


def test_join_takes_the_index_of_the_set():
    calibration = calibrate(constriction_runs())
    runs = pd.DataFrame(
        {
            "run_id": list("abc"),
            "stiffness_set": ["2", "1", "2"],
            "deformation_index": None,
            "deformation_index_std": None,
        }
    )
    joined = join_deformation_index(runs, calibration)
    assert joined["deformation_index"].tolist() == pytest.approx([0.6, 0.5, 0.6])
    assert joined["run_id"].tolist() == list("abc")
    with pytest.raises(DldsimError, match="set 9 .*calibrated: 1, 2"):
        join_deformation_index(runs.assign(stiffness_set="9"), calibration)
    with pytest.raises(DldsimError, match="several groups"):
        join_deformation_index(runs, pd.concat([calibration, calibration]))


@pytest.mark.parametrize("sets", [[2, 1], [2.0, 1.0], ["2.0", "1"], [" 2", "1 "]])
def test_join_does_not_mind_the_type_of_a_key(sets):
    calibration = calibrate(constriction_runs())
    joined = join_deformation_index(pd.DataFrame({"stiffness_set": sets}), calibration)
    assert joined["deformation_index"].tolist() == pytest.approx([0.6, 0.5])
    back = calibration.iloc[:2].assign(stiffness_set=[sets[1], sets[0]])
    joined = join_deformation_index(pd.DataFrame({"stiffness_set": ["2", "1"]}), back)
    assert joined["deformation_index"].tolist() == pytest.approx([0.6, 0.5])


def test_join_refuses_what_has_no_set():
    calibration = calibrate(constriction_runs())
    for nothing in (None, float("nan"), ""):
        with pytest.raises(DldsimError, match="none named"):
            join_deformation_index(pd.DataFrame({"stiffness_set": ["1", nothing]}), calibration)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"deformation_index": 7.0}, "0 to 1"),
        ({"ks_uN_per_m": -1.0}, "-1"),
        ({"ks_uN_per_m": "5 uN"}, "no number"),
        ({"velocity_mm_s": True}, "true or false"),
    ],
)
def test_inverse_refuses_a_table_of_nonsense(change, words):
    with pytest.raises(DldsimError, match=words):
        stiffness_for(0.55, calibrate(constriction_runs()).assign(**change))


@pytest.mark.parametrize("centres", [(0.5, 0.6, 0.7), (0.8, 0.55, 0.3)])
def test_inverse_inverts(centres):
    calibration = calibrate(constriction_runs(centres))
    for _, group in calibration.iterrows():
        found = stiffness_for(group["deformation_index"], calibration)
        assert found["ks_uN_per_m"] == pytest.approx(group["ks_uN_per_m"])
        assert found["velocity_mm_s"] == pytest.approx(group["velocity_mm_s"])
    middle = stiffness_for((centres[0] + centres[1]) / 2, calibration)
    assert middle["ks_uN_per_m"] == pytest.approx(7.5) and middle["between"] == ("G1", "G2")
    assert middle["kb_pN_um"] == pytest.approx(0.1)


def test_inverse_refuses_what_it_cannot_know():
    calibration = calibrate(constriction_runs((0.5, 0.7, 0.6), offsets=(0.0,)))
    assert stiffness_for(0.55, calibration)["ks_uN_per_m"] == pytest.approx(6.25)
    with pytest.raises(DldsimError, match="2 stiffnesses"):
        stiffness_for(0.65, calibration)
    for outside in (0.49, 0.71, float("nan")):
        with pytest.raises(DldsimError, match="0.5 to 0.7"):
            stiffness_for(outside, calibration)
    with pytest.raises(DldsimError, match="two different"):
        stiffness_for(0.5, calibration.head(1))


def test_interval_of_the_inverse_by_hand():
    """DI rises by 0.1 per 5 µN/m: ± 0.02 is ± 1 µN/m; the scatter over positions adds to it."""
    exact = calibrate(constriction_runs(offsets=(0.0,)))
    found = stiffness_for(0.55, exact, error=0.02)
    assert found["ks_uN_per_m"] == pytest.approx(7.5)
    assert found["ks_uN_per_m_low"] == pytest.approx(6.5, abs=0.03)
    assert found["ks_uN_per_m_high"] == pytest.approx(8.5, abs=0.03)
    assert not found["truncated"]
    both = stiffness_for(0.55, calibrate(constriction_runs()), error=0.015)  # √(0.015² + 0.02²)
    assert both["ks_uN_per_m_high"] == pytest.approx(8.75, abs=0.03)
    wide = stiffness_for(0.51, exact, error=0.05)
    assert wide["truncated"] and wide["ks_uN_per_m_low"] == pytest.approx(5.0)
    with pytest.raises(DldsimError, match="0 or more"):
        stiffness_for(0.55, exact, error=-0.1)


def test_a_dent_within_the_error_is_no_ambiguity():
    """0.60, 0.61, 0.605, 0.70: three stiffnesses have 0.607, but ± 0.01 covers all between."""
    dented = calibrate(constriction_runs((0.60, 0.61, 0.605, 0.70), offsets=(0.0,)))
    with pytest.raises(DldsimError, match="3 stiffnesses"):
        stiffness_for(0.607, dented)
    found = stiffness_for(0.607, dented, error=0.01)
    assert found["ks_uN_per_m_low"] < 8.5 and found["ks_uN_per_m_high"] > 15
    assert 8.5 < found["ks_uN_per_m"] < 15.2 and found["between"] == ("G1", "G4")


def test_unusable_tables_are_refused():
    runs = constriction_runs()
    with pytest.raises(DldsimError, match="group"):
        calibrate(runs.drop(columns="group"))
    with pytest.raises(DldsimError, match="empty"):
        calibrate(runs.iloc[:0])
    mixed = runs.assign(velocity_mm_s=np.arange(len(runs)))
    with pytest.raises(DldsimError, match="different velocity_mm_s"):
        calibrate(mixed)
