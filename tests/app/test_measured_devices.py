"""Angles measured on fabricated devices are learnt from like simulated ones."""

import numpy as np
import pytest

from dldsim.analysis import surrogate
from dldsim.design.measured_devices import with_measurements
from dldsim.errors import DldsimError
from dldsim.tables.parquet import read_table


def measured(**changes):
    given = {
        "pillar_radius_um": 7.2,
        "gap_um": 15.5,
        "periodicity": 6,
        "deformation_index": 0.65,
        "cell_radius_um": 7.5,
        "height_um": 20.0,
        "mean_velocity_mm_s": 0.5,
        "migration_angle_deg": 9.0,
    } | changes
    return {key: value for key, value in given.items() if value is not None}


@pytest.fixture(scope="module")
def tables(campaign):
    return [read_table(kind, campaign / f"{kind}.parquet") for kind in ("outcomes", "calibration")]


def test_any_velocity_height_and_shape_is_learnt_from(tables):
    outcomes, calibration = tables
    given = [
        measured(),
        measured(mean_velocity_mm_s=2.0, height_um=33.0),
        measured(deformation_index=None, ks_uN_per_m=30.0, cell_shape="sphere"),
    ]
    both = with_measurements(outcomes, given, calibration)
    assert len(both) == len(outcomes) + 3
    slow, fast, bead = both.iloc[-3:].to_dict("records")
    # index 0.65 is that of set 2, k_s 10 µN/m; the campaign's viscosity is 1.5 mPa·s
    assert slow["capillary_number"] == pytest.approx(1.5 * 0.5 / 10)
    assert fast["capillary_number"] == pytest.approx(4 * slow["capillary_number"])
    assert (fast["height_um"], slow["cell_shape"]) == (33.0, "biconcave")
    assert bead["capillary_number"] == pytest.approx(0.025) and bead["cell_shape"] == "sphere"
    assert np.isnan(bead["deformation_index"]) and bead["status"] == "measured"
    assert surrogate.fit(both, 1).card["data"]["used"] == len(outcomes) + 3


@pytest.mark.parametrize(
    ("changes", "words", "key"),
    [
        ({"migration_angle_deg": 30.0}, "Full bump motion", "measurements.0.migration_angle_deg"),
        ({"height_um": None}, "Measurement 1 lacks height_um", "measurements.0.height_um"),
        ({"deformation_index": None}, "exactly one of", "measurements.0.deformation_index"),
        ({"ks_uN_per_m": 5.0}, "exactly one of", "measurements.0.deformation_index"),
        ({"gap_um": 1.0}, "squeezed biconcave cell", "measurements.0.gap_um"),
        ({"height_um": 1.0}, "squeezed biconcave cell", "measurements.0.height_um"),
        ({"mean_velocity_mm_s": 500.0}, "Ca = μU/k_s", "measurements.0.mean_velocity_mm_s"),
        ({"deformation_index": 0.3}, "calibrated range", "measurements.0.deformation_index"),
        ({"cell_shape": "sphere"}, "for biconcave, not sphere", "measurements.0.cell_shape"),
    ],
)
def test_measurements_that_say_too_little_or_too_much_are_refused(tables, changes, words, key):
    outcomes, calibration = tables
    with pytest.raises(DldsimError, match=words) as caught:
        with_measurements(outcomes, [measured(**changes)], calibration)
    assert caught.value.key == key


def test_an_index_needs_a_calibration(tables):
    with pytest.raises(DldsimError, match="needs a calibration"):
        with_measurements(tables[0], [measured()])
