"""When a design counts as separating: from all releases, and at a finer setting as well."""

import math

import pytest

from dldsim.config.sections import Geometry, Numerics
from dldsim.design.verdict import _notes, design_verdict, parts, separated
from dldsim.laws import whole_shift_spacing
from dldsim.solver.pillars import next_finer


def pair(
    first,
    second,
    spread=0.1,
    status="decided",
    spacing_um=1.1,
    lag=0.15,
    mode_open=False,
    modes=("zigzag", "bump"),
):
    return [
        {
            "migration_angle_deg": angle,
            "mode_open": mode_open,
            "mode": mode,
            "angle_spread_deg": spread,
            "status": status,
            "angle_low_deg": angle and angle - 0.2,
            "angle_high_deg": angle and angle + 0.2,
            "stop_reason": "why",
            "spacing_um": spacing_um,
            "lag_number": lag,
            "rows_in_domain": 2,
            "lanes_in_domain": 2,
        }
        for angle, mode in zip((first, second), modes, strict=True)
    ]


def verdict(found, sigma, finer):
    first, second = (row["migration_angle_deg"] for row in found)
    difference = {
        "simulated_deg": second - first,
        "sigma_num_deg": sigma,
        "predicted_deg": 2.0,
        "verdict": "predicted so",
        "note": "",
    }
    return design_verdict(difference, found, finer, separated(found, sigma, finer))


def test_parting_needs_two_sigma_and_more_than_the_releases_spread():
    assert parts(pair(1.0, 3.0), 0.5) is True
    assert parts(pair(1.0, 3.0), 1.1) is False
    assert parts(pair(1.0, 3.0, spread=1.1), 0.5) is False
    assert parts(pair(1.0, 3.0), None) is None


@pytest.mark.parametrize("status", ["coexisting", "stuck", "failed"])
def test_only_decided_outcomes_part(status):
    assert parts(pair(1.0, 3.0, status=status), 0.1) is False


def test_of_undecided_outcomes_the_bounds_decide():
    # Their σ_num spans the modes and says nothing.
    assert parts(pair(1.0, 3.0, status="undecided"), 5.0) is True
    assert parts(pair(1.0, 1.3, status="undecided"), 5.0) is None
    assert separated(pair(1.0, 1.3, status="undecided"), 5.0, None) is None
    assert separated(pair(1.0, 3.0), 0.5, pair(1.0, 1.3, status="undecided")) is None
    words = verdict(pair(1.0, 1.3, status="undecided"), 5.0, None)
    assert words.startswith("open, 0.30°: cell type 1 is undecided and cell type 2 is undecided")


def test_bounds_of_an_undecided_outcome_are_no_bounds_of_its_releases():
    """They are means over the flux: releases may lie where the other cell type goes."""
    assert parts(pair(1.0, 3.0, spread=1.1, status="undecided"), 5.0) is None


def test_notes_say_whose_they_are():
    assert _notes(["", ""]) == "" and _notes(["does not fit"] * 2) == "does not fit"
    assert _notes(["", "undecided: why"]) == "cell type 2: undecided: why"
    assert _notes(["a", "b"]) == "cell type 1: a; cell type 2: b"


def test_no_angle_parts_nothing():
    assert parts(pair(1.0, None), 0.1) is False


def test_separating_needs_the_finer_setting_in_the_same_order():
    found = pair(1.0, 5.0)
    assert separated(found, 0.5, pair(0.9, 5.2)) is True
    assert separated(found, 0.5, pair(5.2, 5.3)) is False
    assert separated(found, 0.5, pair(5.2, 0.9)) is False
    assert separated(found, 0.5, None) is None
    assert separated(pair(1.0, 1.1), 0.5, None) is False
    # The same modes at a finer setting settle what σ_num leaves open, not what it denies.
    assert parts(pair(2.25, 1.75), 0.3) is False
    assert separated(pair(1.0, 3.0), 0.3, pair(2.25, 1.75)) is False
    assert separated(pair(1.0, 3.0), 0.3, pair(2.0, 2.3)) is False
    near = pair(1.0, 3.0, mode_open=True)
    assert separated(near, 2.0, pair(2.0, 2.3)) is True
    assert separated(near, 2.0, pair(2.3, 2.0)) is False


def test_a_finer_setting_settles_a_mode_that_is_open_by_sigma_num():
    near = pair(1.0, 7.1, mode_open=True)
    assert parts(near, 3.6) is None and separated(near, 3.6, None) is None
    assert verdict(near, 3.6, None).startswith(
        "open, 6.10°: near a transition, σ_num 3.60° reaches another mode"
    )
    assert separated(near, 3.6, pair(0.9, 7.1)) is True
    assert verdict(near, 3.6, pair(0.9, 7.1)).startswith("separates by 6.10 ± 3.60°")
    # Not one that is undecided itself, of another mode, of another order, or within the spread.
    assert separated(near, 3.6, pair(0.9, 7.1, status="undecided")) is None
    assert separated(near, 3.6, pair(0.9, 7.1, modes=("zigzag", "mixed"))) is None
    assert separated(near, 0.5, pair(7.1, 0.9, modes=("zigzag", "mixed"))) is False
    assert separated(near, 3.6, pair(0.9, 7.1, status="coexisting")) is False
    # What is open at the campaign's setting does not separate if the finer one denies it.
    open_ = pair(1.0, 1.3, status="undecided")
    assert separated(open_, 5.0, pair(7.1, 7.1, spread=0.0, modes=("bump", "bump"))) is False
    assert separated(pair(1.0, 1.3, status="undecided"), 5.0, pair(0.9, 7.1)) is None
    assert separated(near, 3.6, pair(0.9, 7.1, spread=4.0)) is False
    # Far from any transition σ_num is what it is.
    assert separated(pair(1.0, 3.0), 1.1, pair(1.0, 3.0)) is False


def test_the_verdict_says_which_settings_agreed():
    finer = pair(0.9, 5.2, spacing_um=0.85, lag=0.07)
    words = verdict(pair(1.0, 5.0), 0.5, finer)
    assert words.startswith(
        "separates by 4.00 ± 0.50°, 4.30° at spacing 0.85 µm, Re 0.07 and 2 × 2 pillars"
    )
    assert verdict(pair(1.0, 5.0), 0.5, None).startswith(
        "separates by 4.00 ± 0.50° at this setting; not confirmed at a finer one"
    )
    finer = pair(5.2, 5.3, spacing_um=0.85, lag=0.07)
    assert verdict(pair(1.0, 5.0), 0.5, finer).startswith("does not separate: 4.00° but 0.10°")
    assert "spread of the releases" in verdict(pair(1.0, 3.0, spread=1.1), 0.5, None)
    assert "cell type 1 is coexisting" in verdict(pair(1.0, 3.0, status="coexisting"), 0.5, None)


@pytest.mark.parametrize(("radius", "gap", "periodicity"), [(8, 18, 10), (5, 12, 4), (7, 14, 12)])
def test_the_finer_lattice_is_the_next_one_at_half_the_reynolds_number(radius, gap, periodicity):
    geometry = Geometry(pillar_radius_um=radius, gap_um=gap, periodicity=periodicity)
    coarse = Numerics()
    spacing, nodes = whole_shift_spacing(geometry, coarse.spacing_um)
    fine = next_finer(geometry, coarse)
    finer, more = whole_shift_spacing(geometry, fine.spacing_um)
    assert more == nodes + 1 and math.isclose(finer * more, spacing * nodes)
    assert fine.reynolds_max == coarse.reynolds_max / 2
    assert Numerics(**fine.model_dump()) == fine
    assert (fine.rows, fine.lanes, fine.images) == (2, 2, "dilute")
    wide = next_finer(geometry, coarse.model_copy(update={"rows": 2, "lanes": 4}))
    assert (wide.rows, wide.lanes) == (2, 4)
