"""Features of outcomes by hand, and what can be learnt from."""

import numpy as np
import pytest

from dldsim.analysis import features
from dldsim.analysis.features import FEATURES, INDEX_SCALE, CellInFlow
from dldsim.errors import DldsimError
from tests.analysis.made_outcomes import cell, make_outcomes


def named(*at, **more):
    return dict(zip(FEATURES, features.features(*at, **more)[0], strict=True))


def test_features_by_hand():
    x = named(5, 20, 10, CellInFlow("sphere", 7.5, 30.0, 0.1))
    assert np.exp(x["log_size_over_critical_diameter"]) == pytest.approx(15 / (28 * 0.1**0.48))
    assert np.exp(x["log_confinement"]) == pytest.approx(0.75)
    assert np.exp(x["log_periodicity"]) == pytest.approx(10)
    assert np.exp(x["log_pillar_radius_over_cell_radius"]) == pytest.approx(2 / 3)
    assert np.exp(x["log_gap_over_pillar_diameter"]) == pytest.approx(2)
    assert np.exp(x["log_capillary_number"]) == pytest.approx(0.1)
    assert x["vertical_confinement"] == pytest.approx(0.5)
    assert features.SHAPES[int(x["shape"])] == "sphere"
    assert x["bump_angle_deg"] == pytest.approx(5.7106, abs=1e-4)


def test_the_sources_form_has_the_index_in_place_of_ca():
    by_ca, by_index = named(5, 20, 10, cell(0.1)), named(5, 20, 10, cell(0.1), index=0.6)
    differing = [name for name in FEATURES if by_ca[name] != by_index[name]]
    assert differing == ["log_capillary_number"]
    assert by_index["log_capillary_number"] == pytest.approx(0.6 / INDEX_SCALE)


def test_ratios_and_ca_are_all_that_counts():
    small = features.features(6, 18, 6, CellInFlow("biconcave", 7.5, 20.0, 0.1))
    large = features.features(12, 36, 6, CellInFlow("biconcave", 15.0, 40.0, 0.1))
    assert np.allclose(small, large)


def test_without_top_and_bottom_nothing_confines():
    assert named(5, 20, 10, cell(height_um=0.0))["vertical_confinement"] == 0


def test_arguments_are_broadcast():
    both = CellInFlow(np.array(["sphere", "biconcave"]), 7.5, 20.0, 0.1)
    x = features.features(6, 18, 6, both)
    assert x.shape == (2, len(FEATURES)) and x[:, FEATURES.index("shape")].tolist() == [1, 0]
    assert len(features.features([6, 7, 8], 18, 6, cell())) == 3


def test_share_and_angle_are_inverse():
    assert features.share_of(np.degrees(np.arctan(1 / 6)), 6) == pytest.approx(1)
    angle = np.array([-0.1, 0.0, 2.0, 9.0])
    assert features.angle_of(features.share_of(angle, 6), 6) == pytest.approx(angle)


@pytest.mark.parametrize(
    ("at", "words"),
    [
        ((6, -1, 6, cell()), "gap_um must be positive"),
        ((6, np.nan, 6, cell()), "gap_um must be a finite"),
        ((6, 18, 6, cell(0.0)), "capillary_number must be positive"),
        ((6, 18, 6, cell(height_um=-1)), "height_um must be 0 or more"),
        ((6, 18, 6, cell(shape="cube")), "no cell shape 'cube'"),
    ],
)
def test_impossible_inputs_are_refused(at, words):
    with pytest.raises(DldsimError, match=words):
        features.features(*at)


def test_mixed_conditions_are_learnable():
    outcomes = make_outcomes()
    mixed = outcomes.assign(
        height_um=20.0 + np.arange(81) % 3,
        cell_shape=np.where(np.arange(81) % 2, "sphere", "biconcave"),
        mean_velocity_mm_s=np.arange(81),
    )
    assert len(features.learnable(mixed)) == 81


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda t: t.drop(columns="cell_radius_um"), "cell_radius_um"),
        (lambda t: t.assign(capillary_number=np.nan), "81 without capillary_number"),
        (lambda t: t.assign(migration_angle_deg=2.0), "different angles"),
        (lambda t: t.iloc[:0], "0 of 0 outcomes"),
    ],
)
def test_unusable_tables_are_refused(spoil, words):
    with pytest.raises(DldsimError, match=words):
        features.learnable(spoil(make_outcomes()))
