"""Rows, orbits, angles and modes of synthetic paths."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dldsim.config import RunControl
from dldsim.trajectory import analyse_path, angle_deg, find_orbit, mode_of, row_crossings

PITCH, N = 30.0, 10
SHIFT = PITCH / N
TOLERANCE = 0.03


def path_of(steps, start=0.0):
    """Lateral positions from steps in row shifts."""
    return start + SHIFT * np.concatenate([[0.0], np.cumsum(steps)])


def analyse(lateral):
    return analyse_path(lateral, PITCH, N, RunControl(orbit_tolerance=TOLERANCE))


def first_crossings(x, y, first, pitch):
    """Slow twin of row_crossings."""
    crossings, plane = [], first
    for i in range(len(x)):
        while x[i] >= plane:
            share = 1.0 if i == 0 else (plane - x[i - 1]) / (x[i] - x[i - 1])
            crossings.append(y[i] if i == 0 else y[i - 1] + share * (y[i] - y[i - 1]))
            plane = first + pitch * len(crossings)
    return crossings


def test_crossings_of_a_straight_path():
    x = np.linspace(0, 100, 21)
    np.testing.assert_allclose(row_crossings(x, 2 + 0.1 * x, 0.0, 30.0), [2, 5, 8, 11])


def test_each_plane_counts_at_its_first_crossing():
    t = np.linspace(0, 50, 400)
    x, y = t + 4 * np.sin(t), np.cos(0.3 * t)
    assert (np.diff(x) < 0).any()
    crossings = row_crossings(x, y, 0.0, 7.0)
    assert len(crossings) == int(x.max() // 7) + 1
    np.testing.assert_allclose(crossings, first_crossings(x, y, 0.0, 7.0))


def test_a_path_that_has_not_moved_has_one_crossing():
    assert row_crossings(np.array([0.0]), np.array([4.0]), 0.0, 30.0).tolist() == [4.0]


@given(
    st.lists(st.floats(-3, 10), min_size=1, max_size=30), st.floats(0.5, 20), st.integers(0, 2**32)
)
def test_crossings_equal_their_loop_form(steps, pitch, seed):
    x = np.concatenate([[0.0], np.cumsum(steps)])
    y = np.random.default_rng(seed).normal(size=len(x))
    np.testing.assert_allclose(
        row_crossings(x, y, 0.0, pitch), first_crossings(x, y, 0.0, pitch), atol=1e-6
    )


def test_angle_by_hand():
    lateral = np.array([0.0, 1.0, 3.0, 3.0])
    assert angle_deg(lateral, 2, 10.0) == pytest.approx(math.degrees(math.atan(2 / 20)))
    assert angle_deg(lateral, 2, 10.0, 2) == pytest.approx(math.degrees(math.atan(3 / 20)))


def test_bump_after_a_transient():
    # Steps of 1 - 0.6, 1 - 0.3, … row shifts: the first period falls short by 0.6 · 1.998.
    result = analyse(path_of(1 - 0.6 * 0.5 ** np.arange(30)))
    assert (result.status, result.mode, result.orbit_rows) == ("converged", "bump", 1)
    assert result.migration_angle_deg == pytest.approx(math.degrees(math.atan(1 / N)), rel=1e-3)
    short = math.degrees(math.atan((1 - 0.6 * (2 - 0.5**9) / N) / N))
    assert result.first_period_angle_deg == pytest.approx(short)
    assert result.angle_high_deg - result.angle_low_deg < 0.02
    assert result.lateral_steps[0] == pytest.approx(0.4 * SHIFT)


ZIGZAG = [1 / (N - 1)] * (N - 1) + [-1.0]
MIXED = [1.0] * 3 + [0.0] * N
"""Three bumps, then with the flow until the next lane: 13 rows carry 3 row shifts sideways."""


@pytest.mark.parametrize(
    ("steps", "rows", "angle", "mode"),
    [
        (ZIGZAG, N, 0.0, "zigzag"),
        ([0.0] * N, N, 0.0, "zigzag"),
        (MIXED, 13, 3 / 13 / N, "mixed"),
        ([1.2, 0.8], 1, 1 / N, "bump"),  # a wobble within a quarter of the row shift
        ([1.5, 0.5], 2, 1 / N, "bump"),
        # Half a row shift a row: after 2 N rows a lane lower among the same pillars.
        ([0.5], 2 * N, 0.5 / N, "mixed"),
    ],
)
def test_orbits(steps, rows, angle, mode):
    result = analyse(path_of((steps * 60)[:60], start=7.0))
    assert result.status == ("converged" if rows == 1 else "periodic")
    assert (result.orbit_rows, result.mode) == (rows, mode)
    assert result.migration_angle_deg == pytest.approx(math.degrees(math.atan(angle)), abs=1e-9)
    assert result.angle_high_deg == pytest.approx(result.angle_low_deg, abs=1e-9)


def test_an_orbit_is_found_wherever_the_path_stops():
    for rows in range(26, 60):
        assert find_orbit(path_of((MIXED * 5)[:rows]), PITCH, N, TOLERANCE).rows == 13


def test_slow_drift_is_not_an_orbit():
    result = analyse(path_of([1 - 0.05] * 60))
    assert (result.status, result.orbit_rows) == ("undecided", 0)
    assert result.migration_angle_deg == pytest.approx(math.degrees(math.atan(0.95 / N)))
    assert result.angle_high_deg >= math.degrees(math.atan(1 / N))


def test_drift_within_the_tolerance_is_the_uncertainty_of_an_orbit():
    result = analyse(path_of([1 - 0.02] * 40))
    assert (result.status, result.orbit_rows) == ("converged", 1)
    half = (result.angle_high_deg - result.angle_low_deg) / 2
    assert half == pytest.approx(math.degrees(math.atan(0.02 / N)))


def test_coincidences_are_not_orbits():
    wandering = list(np.random.default_rng(1).uniform(-3, 3, 30))
    # Five bumps in a row, half an array period, are not yet a steady motion.
    assert find_orbit(path_of(wandering + [1.0] * 5), PITCH, N, TOLERANCE) is None
    assert find_orbit(path_of(wandering + [1.0] * N), PITCH, N, TOLERANCE).rows == 1
    # An orbit of 15 rows is believed when all of them have come back, not one row before.
    once = list(np.random.default_rng(2).uniform(-3, 3, 14))
    once.append(15 - N - sum(once))
    assert find_orbit(path_of(wandering + once + once[:-2]), PITCH, N, TOLERANCE) is None
    assert find_orbit(path_of(wandering + once + once), PITCH, N, TOLERANCE).rows == 15


def test_a_change_of_motion_ends_an_orbit():
    bumps = [1.0] * 20
    assert find_orbit(path_of(bumps), PITCH, N, TOLERANCE).rows == 1
    assert find_orbit(path_of([*bumps, -1.0]), PITCH, N, TOLERANCE) is None


def test_a_path_shorter_than_a_period_has_no_angle():
    result = analyse(path_of([1.0] * (N - 1)))
    assert (result.status, result.mode, result.orbit_rows) == ("undecided", "none", 0)
    assert result.migration_angle_deg is None
    assert result.first_period_angle_deg is None
    assert len(result.lateral_steps) == N - 1


def test_an_unsettled_path_keeps_the_angle_of_its_second_half():
    steps = np.random.default_rng(4).uniform(-3, 3, 24)
    result = analyse(path_of(steps))
    angles = [
        math.degrees(math.atan(steps[k : k + n].sum() / n / N))
        for k, n in ((12, 12), (0, N))
    ]
    assert result.status == "undecided"
    assert result.migration_angle_deg == pytest.approx(angles[0])
    assert result.angle_low_deg <= angles[0] <= result.angle_high_deg
    assert result.first_period_angle_deg == pytest.approx(angles[1])


@pytest.mark.parametrize(
    ("share", "mode"),
    [(1.05, "bump"), (0.91, "bump"), (0.89, "mixed"), (0.11, "mixed"), (0.09, "zigzag"),
     (-0.3, "zigzag")],
)  # fmt: skip
def test_modes(share, mode):
    assert mode_of(math.degrees(math.atan(share * 0.1)), 0.1) == mode
