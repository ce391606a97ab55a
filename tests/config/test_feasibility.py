"""What no lattice and no cell can do is refused before anything runs."""

import math
from pathlib import Path

import pytest
import yaml

from dldsim.config.feasibility import (
    check_array,
    check_gap,
    check_images,
    check_passable,
    check_release,
    smallest_passable_um,
)
from dldsim.config.presets import resolve
from dldsim.config.sections import Cell, Constriction, Flow, Geometry, Numerics
from dldsim.errors import DldsimError

ROOT = Path(__file__).parents[2]
RAW = yaml.safe_load((ROOT / "config.yaml").read_text(encoding="utf-8"))


def test_gap_must_exceed_radius_and_safety_distance():
    check_gap(Geometry(pillar_radius_um=10, gap_um=12.1, periodicity=6), 2)
    with pytest.raises(DldsimError, match=r"12 µm"):
        check_gap(Geometry(pillar_radius_um=10, gap_um=12, periodicity=6), 2)


def test_smallest_passable_tube():
    """The classic 2.7 µm of a red cell, a little less with the area reserve; slimmer than rest."""
    assert 2.3 < smallest_passable_um(Cell(radius_um=3.91)) < 2.9
    assert 9 < smallest_passable_um(Cell(shape="sphere", radius_um=7.5)) < 15
    sphere = smallest_passable_um(Cell(shape="sphere"))
    round_ellipsoid = smallest_passable_um(Cell(shape="ellipsoid", aspect_ratio=1.0))
    assert round_ellipsoid == pytest.approx(sphere)
    geometry = Geometry(pillar_radius_um=2, gap_um=20, periodicity=4)
    with pytest.raises(DldsimError, match="height_um"):
        check_passable(geometry, Cell(), height_um=4)


def test_a_cell_must_not_reach_its_own_image():
    """One pitch of 12 µm apart it would; half of the lanes aside it does not."""
    geometry = Geometry(pillar_radius_um=1, gap_um=10, periodicity=10)
    one = Numerics(rows=1, lanes=1)
    check_images(geometry, Cell(radius_um=5.9), one)
    with pytest.raises(DldsimError, match="12 µm apart in a domain of 1 × 1 pillars") as caught:
        check_images(geometry, Cell(radius_um=6), one)
    assert caught.value.key == "numerics.lanes" and caught.value.remedy
    # (1, 1.1 − 2) and (1, 1.1) pitches; two lanes without stagger have (1, 0.1).
    nearest = 12 * math.hypot(1, 0.9)
    check_images(geometry, Cell(radius_um=nearest / 2 - 0.01), Numerics())
    for numerics, radius in ((Numerics(), nearest / 2 + 0.01), (Numerics(images="aligned"), 6.1)):
        with pytest.raises(DldsimError):
            check_images(geometry, Cell(radius_um=radius), numerics)


CHANNEL = {"kind": "channel", "velocity_mm_s": 1.0}
SLIT = {"kind": "constriction", "velocity_mm_s": 1.0}


@pytest.mark.parametrize(
    ("overrides", "key"),
    [
        ({"numerics": {"rows": 100}}, "numerics.rows"),
        ({"flow": {"height_um": 0}}, "flow.height_um"),
        ({"run_control": {"max_rows": 9}}, "run_control.max_rows"),
        ({"run_control": {"outcome_rows_max": 9}}, "run_control.outcome_rows_max"),
        ({"sweep": {"periodicity": [41]}}, "run_control.max_rows"),
        ({"numerics": {"spacing_um": 100}}, "gap_um"),
        ({"numerics": {"spacing_um": 0.05}}, "numerics.spacing_um"),
        ({"constriction": {"throat_width_um": 40}}, "constriction.throat_width_um"),
        ({"constriction": {"throat_width_um": 0.5}}, "constriction.throat_width_um"),
        ({"constriction": {"throat_width_um": 1.9}}, "constriction.throat_width_um"),
        ({"constriction": {"height_um": 3}}, "constriction.height_um"),
        ({"constriction": {"spacing_um": 8}}, "constriction.throat_width_um"),
        ({"constriction": {"spacing_um": 0.02}}, "constriction.spacing_um"),
        ({"constriction": {"release_positions_um": [0, 12]}}, "constriction.release_positions_um"),
        ({"assays": {"c": {**CHANNEL, "width_um": 15}}}, "assays.c.width_um"),
        ({"assays": {"c": {**CHANNEL, "offsets_um": [3]}}}, "assays.c.width_um"),
        ({"assays": {"c": {**CHANNEL, "height_um": 15}}}, "assays.c.height_um"),
        ({"assays": {"c": {**CHANNEL, "spacing_um": 0.02}}}, "assays.c.spacing_um"),
        ({"assays": {"c": {**CHANNEL, "velocity_mm_s": 100}}}, "assays.c.velocity_mm_s"),
        ({"assays": {"gauge": {"stress_Pa": 1000}}}, "assays.gauge.stress_Pa"),
        ({"assays": {"c": SLIT | {"channel": {"height_um": 3}}}}, "assays.c.channel.height_um"),
        ({"assays": {"gauge": {"radius_factors": [0.95, 0.95]}}}, "assays.gauge.radius_factors"),
        ({"assays": {"gauge": {"radius_factors": [1.0]}}}, "assays.gauge.radius_factors"),
        ({"assays": {"gauge": {"other_axes": ["z"]}}}, "assays.gauge.other_axes"),
        ({"assays": {"c": {**CHANNEL, "offsets_um": [0.5, 0.5]}}}, "assays.c.offsets_um"),
        ({"constriction": {"approach_length_um": 14}}, "constriction.approach_length_um"),
    ],
)
def test_what_no_lattice_can_carry_is_refused(overrides, key):
    with pytest.raises(DldsimError) as caught:
        resolve(RAW, overrides)
    assert caught.value.key == key, str(caught.value)
    assert caught.value.allowed and caught.value.remedy


def test_the_height_may_be_too_low_for_the_lattice():
    geometry = Geometry(pillar_radius_um=6, gap_um=18, periodicity=8)
    with pytest.raises(DldsimError) as caught:
        check_array(geometry, Flow(height_um=3), Numerics())
    assert caught.value.key == "height_um"
    check_array(geometry, Flow(height_um=0), Numerics())


@pytest.mark.parametrize("position", [-0.1, -5, 11.1, float("nan")])
def test_a_cell_is_released_in_the_straight_approach(position):
    check_release(0, Constriction(), Cell())
    check_release(11, Constriction(), Cell())
    with pytest.raises(DldsimError, match="allowed 0 to 11") as caught:
        check_release(position, Constriction(), Cell())
    assert caught.value.key == "constriction.release_positions_um"
