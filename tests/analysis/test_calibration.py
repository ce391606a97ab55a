"""Laws of a calibration in use: an inverse that inverts, and says what it cannot know."""

import numpy as np
import pandas as pd
import pytest

from dldsim.analysis.calibration import join_deformation_index, stiffness_for, with_library
from dldsim.analysis.passages import calibrate
from dldsim.errors import DldsimError
from tests.analysis.test_passages import SETS, assay_runs, table_assay


def curves(*args, default="gauge", **kwargs):
    return calibrate(assay_runs(*args, **kwargs), default)


def test_join_takes_the_index_of_the_set():
    calibration = curves()
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
    with pytest.raises(DldsimError, match="several indices"):
        join_deformation_index(runs, pd.concat([calibration, calibration]))


@pytest.mark.parametrize("sets", [[2, 1], [2.0, 1.0], ["2.0", "1"], [" 2", "1 "]])
def test_join_does_not_mind_the_type_of_a_key(sets):
    calibration = curves()
    joined = join_deformation_index(pd.DataFrame({"stiffness_set": sets}), calibration)
    assert joined["deformation_index"].tolist() == pytest.approx([0.6, 0.5])
    back = calibration.iloc[:2].assign(stiffness_set=[sets[1], sets[0]])
    joined = join_deformation_index(pd.DataFrame({"stiffness_set": ["2", "1"]}), back)
    assert joined["deformation_index"].tolist() == pytest.approx([0.6, 0.5])


def test_join_refuses_what_has_no_set():
    calibration = curves()
    for nothing in (None, float("nan"), ""):
        with pytest.raises(DldsimError, match="none named"):
            join_deformation_index(pd.DataFrame({"stiffness_set": ["1", nothing]}), calibration)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"deformation_index": 7.0}, "per cent"),
        ({"ks_uN_per_m": -1.0}, "-1"),
        ({"ks_uN_per_m": "5 uN"}, "no number"),
        ({"ks_uN_per_m": 5e-6}, "units of their columns"),
        ({"kb_pN_um": None}, "empty beside an index"),
        ({"deformation_index_std": -0.1}, "scatter of the index of -0.1"),
        ({"deformation_index_std": 2.0}, "per cent"),
        ({"cell_radius_um": None}, "cell_radius_um is empty"),
        ({"group": "G1"}, "two rows with an index"),
        ({"default": "maybe"}, "neither true nor false"),
        ({"velocity_mm_s": True}, "true or false"),
    ],
)
def test_inverse_refuses_a_table_of_nonsense(change, words):
    with pytest.raises(DldsimError, match=words):
        stiffness_for(0.55, curves().assign(**change))


def test_a_table_without_rows_is_none():
    with pytest.raises(DldsimError, match="no rows"):
        stiffness_for(0.55, curves().iloc[:0])


def test_words_say_which_assay_is_the_default_one():
    """As a CSV file has them; the other assay stands first."""
    known = curves()
    other = known.assign(assay="other", deformation_index=known["deformation_index"] + 0.01)
    both = pd.concat([other.assign(default="False"), known.assign(default="True")])
    assert stiffness_for(0.55, both)["assay"] == known["assay"].iloc[0]


@pytest.mark.parametrize("centres", [(0.5, 0.6, 0.7), (0.8, 0.55, 0.3)])
def test_inverse_inverts(centres):
    calibration = curves(centres)
    for _, group in calibration.iterrows():
        found = stiffness_for(group["deformation_index"], calibration)
        assert found["ks_uN_per_m"] == pytest.approx(group["ks_uN_per_m"])
        assert found["velocity_mm_s"] == pytest.approx(group["velocity_mm_s"])
        assert found["shear_stress_Pa"] is None
    middle = stiffness_for((centres[0] + centres[1]) / 2, calibration)
    assert middle["ks_uN_per_m"] == pytest.approx(7.5) and middle["between"] == ("G1", "G2")
    assert middle["kb_pN_um"] == pytest.approx(0.1)


def test_inverse_refuses_what_it_cannot_know():
    calibration = curves((0.5, 0.7, 0.6), offsets=(0.0,))
    assert stiffness_for(0.55, calibration)["ks_uN_per_m"] == pytest.approx(6.25)
    with pytest.raises(DldsimError, match="2 stiffnesses"):
        stiffness_for(0.65, calibration)
    for outside in (0.49, 0.71):
        with pytest.raises(DldsimError, match="0.5 to 0.7 of assay gauge"):
            stiffness_for(outside, calibration)
    with pytest.raises(DldsimError, match="two different"):
        stiffness_for(0.5, calibration.head(1))


def test_interval_of_the_inverse_by_hand():
    """DI rises by 0.1 per 5 µN/m: ± 0.02 is ± 1 µN/m; the scatter over positions adds to it."""
    exact = curves(offsets=(0.0,))
    found = stiffness_for(0.55, exact, error=0.02)
    assert found["ks_uN_per_m"] == pytest.approx(7.5)
    assert found["ks_uN_per_m_low"] == pytest.approx(6.5, abs=0.03)
    assert found["ks_uN_per_m_high"] == pytest.approx(8.5, abs=0.03)
    assert not found["truncated"]
    both = stiffness_for(0.55, curves(), error=0.015)  # √(0.015² + 0.02²)
    assert both["ks_uN_per_m_high"] == pytest.approx(8.75, abs=0.03)
    wide = stiffness_for(0.51, exact, error=0.05)
    assert wide["truncated"] and wide["ks_uN_per_m_low"] == pytest.approx(5.0)
    with pytest.raises(DldsimError, match="0 or more"):
        stiffness_for(0.55, exact, error=-0.1)


def test_a_dent_within_the_error_is_no_ambiguity():
    """0.60, 0.61, 0.605, 0.70: three stiffnesses have 0.607, but ± 0.01 covers all between."""
    dented = curves((0.60, 0.61, 0.605, 0.70), offsets=(0.0,))
    with pytest.raises(DldsimError, match="3 stiffnesses"):
        stiffness_for(0.607, dented)
    found = stiffness_for(0.607, dented, error=0.01)
    assert found["ks_uN_per_m_low"] < 8.5 and found["ks_uN_per_m_high"] > 15
    assert 8.5 < found["ks_uN_per_m"] < 15.2 and found["between"] == ("G1", "G4")


def test_an_index_in_another_form_is_named():
    calibration = curves()
    for index, error, words in (
        (55, 0.0, "per cent, give 0.55"),
        (float("nan"), 0.0, "no deformation index"),
        (0.55, 2.0, "per cent, give 0.02"),
        (0.55, -0.01, "0 or more"),
        (0.02, 0.55, "may be swapped: 0.55 ± 0.02"),
    ):
        with pytest.raises(DldsimError, match=words):
            stiffness_for(index, calibration, error)


def test_assays_stand_side_by_side():
    """At one velocity the index falls, at the groups' own it rises: neither hides the other."""
    other = assay_runs((0.8, 0.6, 0.5)).assign(assay="other", stiffness_set="")
    table = calibrate(pd.concat([assay_runs(), other], ignore_index=True), "gauge")
    runs = pd.DataFrame({"stiffness_set": ["1", "2"]})
    joined = join_deformation_index(runs, table)
    assert joined["deformation_index"].tolist() == pytest.approx([0.5, 0.6])
    assert stiffness_for(0.65, table)["ks_uN_per_m"] == pytest.approx(12.5)
    found = stiffness_for(0.65, table, assay="other")
    assert found["ks_uN_per_m"] == pytest.approx(8.75) and found["assay"] == "other"
    with pytest.raises(DldsimError, match="no assay 'gouge'. Did you mean gauge"):
        stiffness_for(0.65, table, assay="gouge")
    with pytest.raises(DldsimError, match=r"another assay .* other \(0.5 to 0.8\); .* velocity"):
        stiffness_for(0.75, table)
    with pytest.raises(DldsimError, match="no default"):
        join_deformation_index(runs, table.assign(default=False))


@pytest.mark.parametrize(
    ("centres", "index", "advice"),
    [
        ((0.7, 0.6, 0.5), 0.4, "higher velocity, for a cell stiffer"),
        ((0.7, 0.6, 0.5), 0.8, "lower velocity, for a cell softer"),
        ((0.5, 0.6, 0.7), 0.4, "lower velocity, for a cell softer"),
        ((0.5, 0.6, 0.7), 0.8, "higher velocity, for a cell stiffer"),
    ],
)
def test_an_index_outside_is_refused_with_the_way_to_measure_it(centres, index, advice):
    with pytest.raises(DldsimError, match=advice) as caught:
        stiffness_for(index, curves(centres))
    assert caught.value.allowed == "0.5 to 0.7"


def test_the_cell_counts():
    """Index at radius 6 and 8; half-way between, half of the change."""
    small, large = (
        assay_runs(centres).assign(cell_radius_um=radius)
        for centres, radius in (((0.5, 0.6, 0.7), 6.0), ((0.6, 0.7, 0.8), 8.0))
    )
    sphere = assay_runs((0.1, 0.2, 0.3)).assign(cell_shape="sphere")
    table = calibrate(pd.concat([small, large, sphere]), "gauge")
    at = {"shape": "biconcave", "radius_um": 7.0}
    assert stiffness_for(0.65, table, **at)["ks_uN_per_m"] == pytest.approx(10)
    assert stiffness_for(0.65, table, **at | {"radius_um": 6})["ks_uN_per_m"] == pytest.approx(12.5)
    found = stiffness_for(0.15, table, shape="sphere")
    assert found["cell_shape"] == "sphere" and found["cell_radius_um"] == 7.5
    for change, words in (
        ({"radius_um": 9.0}, "6 to 8 µm, not 9 µm. .*calibrate --assay gauge"),
        ({"radius_um": None}, "name the radius"),
        ({"shape": None}, "name the shape"),
        ({"shape": "ellipsoid"}, "biconcave, sphere, not ellipsoid"),
    ):
        with pytest.raises(DldsimError, match=words):
            stiffness_for(0.65, table, **at | change)
    with pytest.raises(DldsimError, match="several indices"):
        join_deformation_index(pd.DataFrame({"stiffness_set": ["1"]}), table)
    outcomes = pd.DataFrame(
        {"stiffness_set": "1", "cell_shape": "biconcave", "cell_radius_um": [8.0, 6.0, 7.0]}
    )
    joined = join_deformation_index(outcomes, table)["deformation_index"]
    assert joined[:2].tolist() == pytest.approx([0.6, 0.5]) and np.isnan(joined[2])


def test_published_pairs_hold_for_any_cell_and_say_what_they_are():
    table = calibrate(assay_runs(), "gauge", {"printed": (table_assay(), SETS)})
    for cell in ({}, {"shape": "sphere", "radius_um": 3.0}):
        found = stiffness_for(0.45, table, assay="printed", **cell)
        assert found["ks_uN_per_m"] == pytest.approx(7.5)
        assert found["label"] == "read elsewhere" and found["velocity_mm_s"] is None


def test_a_library_adds_cells_and_replaces_none():
    own, other = curves(), curves((0.4, 0.5, 0.6))
    both = with_library([own, pd.concat([other, other.assign(cell_radius_um=9.0)])])
    assert len(both) == 6
    assert stiffness_for(0.55, both, radius_um=7.5)["ks_uN_per_m"] == pytest.approx(7.5)
    assert stiffness_for(0.55, both, radius_um=9.0)["ks_uN_per_m"] == pytest.approx(12.5)
