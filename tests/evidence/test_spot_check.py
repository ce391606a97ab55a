"""The spot check: who is drawn, what is made finer, what it says."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dldsim.evidence import spot_check
from dldsim.tables.registry import COLUMNS

NAMES = [f"r08.0_g{g}.0_n10_s{s}" for g in range(12, 22) for s in "135"]


@given(st.integers(1, 400), st.integers(0, 9))
def test_a_twentieth_is_drawn_and_at_least_one(count, seed):
    names = [f"n{i}" for i in range(count)]
    drawn = spot_check.sample(names, seed)
    assert len(drawn) == max(1, math.ceil(count / 20)) == len(set(drawn))
    assert set(drawn) <= set(names)
    assert drawn == spot_check.sample(list(reversed(names)), seed)


def test_every_outcome_can_be_drawn():
    assert {n for seed in range(300) for n in spot_check.sample(NAMES, seed)} == set(NAMES)


@given(st.lists(st.sampled_from([i / 10 for i in range(11)]), min_size=1, max_size=5, unique=True))
def test_the_check_releases_elsewhere(places):
    others = spot_check.other_releases(places)
    assert others and not set(others) & set(places)
    assert all(0 <= place <= 1 for place in others)


def test_the_check_is_finer_and_longer():
    settings = {
        "numerics": {"spacing_um": 1.25, "reynolds_max": 0.15, "kernel": "compact"},
        "run_control": {
            "max_rows": 50,
            "outcome_rows_max": 150,
            "orbit_tolerance": 0.03,
            "release_gap_fractions": [0.5, 0.2, 0.8],
            "records_per_row": 20,
        },
    }
    found = spot_check.check_sections(settings)
    assert found["numerics"] == {"spacing_um": 0.625, "reynolds_max": 0.075, "kernel": "compact"}
    control = found["run_control"]
    assert control["release_gap_fractions"] == [0.35, 0.65]
    rows = [control[key] for key in ("min_rows", "max_rows", "outcome_rows_max")]
    assert rows == [200, 200, 400] and control["orbit_tolerance"] == 0.03
    assert control["records_per_row"] == 20
    begun = spot_check.release_sections(settings)
    assert found["coarser"] == {"numerics": settings["numerics"], **begun}
    assert begun["run_control"] == settings["run_control"] | {
        "release_gap_fractions": [0.35, 0.65],
        "outcome_rows_max": 100,
    }


def row(angle=5.0, sigma=0.2, **changes):
    return {
        "outcome_id": NAMES[0],
        "pillar_radius_um": 8.0,
        "gap_um": 12.0,
        "periodicity": 10,
        "stiffness_set": "1",
        "mode": "bump",
        "status": "decided",
        "start": "settled",
        "migration_angle_deg": angle,
        "sigma_num_deg": sigma,
        "sigma_num_basis": "modelled: far",
        "spacing_um": 1.2,
        "wall_time_s": 36.0,
        "rows_total": 24,
    } | changes


def test_the_cost_is_that_of_as_many_finer_rows():
    """1.5 s a row, 2 outcomes × 2 releases × 200 rows, 64 times as dear."""
    sentence = spot_check.cost_sentence([row(), row()], 2)
    assert f"about {1.5 * 800 * 64 / 3600:.3g} hours" in sentence
    assert "none with a wall time" in spot_check.cost_sentence([row(wall_time_s=None)], 2)


@pytest.mark.parametrize(
    ("campaign", "check", "word"),
    [
        (row(), row(5.3), "holds: 1.5 σ_num"),
        (row(), row(4.5), "changes: 2.5 σ_num"),
        (row(sigma=None, sigma_num_basis="not studied: x"), row(), "cannot be told: not studied"),
        (row(), row(None, status="stuck"), "cannot be told: the check is stuck"),
    ],
)
def test_a_verdict_in_units_of_sigma(campaign, check, word):
    found = spot_check.check_row(campaign, check)
    assert found["verdict"].startswith(word)
    assert set(found) == {c.name for c in COLUMNS["spot_check"]}


@pytest.mark.parametrize(("changed", "holds"), [(0, True), (1, True), (2, False)])
def test_one_in_twenty_may_change(changed, holds):
    rows = [spot_check.check_row(row(), row(9.0 if i < changed else 5.1)) for i in range(20)]
    sentence = spot_check.closing_sentence(rows)
    assert sentence.startswith(f"Spot check: {changed} of 20 outcomes")
    assert sentence.endswith("holds." if holds else "does not hold.")


def test_a_check_that_tells_nothing_does_not_hold():
    rows = [spot_check.check_row(row(), row(None, status="unstable"))]
    assert "does not hold. Of 1 it cannot be told." in spot_check.closing_sentence(rows)
