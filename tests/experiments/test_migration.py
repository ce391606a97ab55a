"""Rows, settled motions and outcomes of synthetic row maps and of one simulated path."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, ttest_ind

from dldsim.config.sections import RunControl
from dldsim.experiments.migration import (
    CONFIDENCE,
    SETTLED,
    Migration,
    Passes,
    alike,
    analyse_path,
    chance_beyond,
    flux_shares,
    mode_of,
    next_release,
    outcome_of,
    row_crossings,
    taken_together,
)

PITCH, N = 30.0, 10
SHIFT = PITCH / N
CONTROL = RunControl()


def path_of(steps, start=0.0):
    """Lateral positions from steps in row shifts."""
    return start + SHIFT * np.concatenate([[0.0], np.cumsum(steps)])


def analyse(lateral, control=CONTROL):
    return analyse_path(lateral, PITCH, N, control)


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


def circle(peak, depth, start, rows, rng=None, noise=0.0):
    """Steps of a row map m = peak − depth (1 − cos 2π(z − z₀)/N)/2 with scatter, z₀ = 0."""
    z, steps = start, []
    for _ in range(rows):
        m = peak - depth * (1 - math.cos(2 * math.pi * z / N)) / 2
        m += noise * rng.standard_normal() if noise else 0.0
        steps.append(m)
        z += m - 1
    return np.array(steps)


def first_decided(steps, control=CONTROL):
    """Rows and Migration at which a run of these steps stops; the last one if it does not."""
    lateral = path_of(steps)
    for rows in range(1, len(steps) + 1):
        result = analyse(lateral[: rows + 1], control)
        if result.status in SETTLED:
            break
    return rows, result


def angle_of_mean(mean):
    return math.degrees(math.atan(mean / N))


def test_a_path_that_ends_before_the_first_plane_has_no_step():
    found = analyse(np.array([]))
    assert (found.status, len(found.lateral_steps)) == ("undecided", 0)


# --------------------------------------------------------------------------------- with a bump lane


@pytest.mark.parametrize("start", np.linspace(-N, 0, 7))
def test_a_lane_is_reached_from_everywhere(start):
    rows, result = first_decided(circle(1.3, 1.5, start, 80))
    assert (result.status, result.mode, result.capture_chance) == ("converged", "bump", 0.0)
    assert rows < 35
    assert result.angle_low_deg <= angle_of_mean(1) <= result.angle_high_deg
    assert result.settled_row < rows


def test_first_period_is_that_of_the_release():
    steps = circle(1.3, 1.5, -1.0, 40)
    assert analyse(path_of(steps)).first_period_angle_deg == pytest.approx(
        angle_of_mean(steps[:N].mean())
    )


def test_an_alternating_lane_is_a_lane():
    _, result = first_decided([0.4, 0.9, *[1.1, 0.9, 1.05, 0.95] * 10])
    assert (result.status, result.mode, result.orbit_rows) == ("converged", "bump", 1)


def test_a_swinging_lane_needs_swings():
    """A tumbling cell in the lane: away and back every 6.3 rows, never twice alike."""
    rows, rng = np.arange(80), np.random.default_rng(8)
    z = rng.uniform(0.3, 0.5, 80) * np.abs(np.sin(np.pi * rows / 6.3))
    steps = np.concatenate([[0.4, 0.5, 0.9], 1 + np.diff(z)])
    stopped, result = first_decided(steps)
    assert (result.status, result.mode) == ("stationary", "bump")
    assert stopped >= 3 * 6.3
    assert result.angle_low_deg <= angle_of_mean(1) <= result.angle_high_deg
    # Dips that go deeper from swing to swing may leave the lane.
    deeper = np.concatenate([[0.4, 0.5, 0.9], 1 + np.diff(z * (1 + 0.05 * rows) * -1)])
    assert analyse(path_of(deeper[:40])).status == "undecided"


# ------------------------------------------------------------------------------ without a bump lane


@pytest.mark.parametrize("peak", [0.2, 0.5, 0.8, 0.9])
@pytest.mark.parametrize("start", [0.0, -3.3, -7.7])
def test_passes_have_the_rotation_number_of_the_map(peak, start):
    """Reference: 20,000 rows of the same map."""
    rows, result = first_decided(circle(peak, peak + 0.9, start, 300))
    true = angle_of_mean(circle(peak, peak + 0.9, start, 20_000).mean())
    assert result.status in ("periodic", "stationary")
    assert result.angle_low_deg - 1e-3 <= true <= result.angle_high_deg + 1e-3
    assert result.capture_chance <= CONTROL.capture_chance_max
    assert -1 < result.transition_distance < 0
    assert result.transition_distance == pytest.approx(peak - 1, abs=0.06)


@pytest.mark.parametrize("below", [0.001, 0.003, 0.01])
def test_a_map_that_barely_has_no_lane_is_never_a_lane(below):
    """The cell lingers for π/√(below · curvature) rows at the peak, then falls."""
    steps = circle(1 - below, 1.5, -0.5, 400)
    assert steps.min() < 0.5  # it falls
    lateral = path_of(steps)
    found = [analyse(lateral[: rows + 1]) for rows in range(1, len(steps) + 1)]
    assert "converged" not in {one.status for one in found}
    open_ones = [one for one in found if one.status == "undecided" and one.mode != "none"]
    assert all(one.angle_high_deg >= angle_of_mean(1) - 1e-9 for one in open_ones)


@pytest.mark.parametrize("above", [0.01, 0.03])
def test_a_map_that_barely_has_a_lane_is_not_called_anything_else(above):
    lateral = path_of(circle(1 + above, 1.5, -0.5, 100))
    found = [analyse(lateral[: rows + 1]) for rows in range(1, 101)]
    assert {one.status for one in found} <= {"undecided", "converged"}


def test_late_capture_is_not_an_orbit_before():
    """A simulated cell that fell twice through a lane and was caught at the third peak."""
    data = json.loads((Path(__file__).parents[1] / "data" / "late_capture.json").read_text("utf-8"))
    steps, n = data["steps"], data["periodicity"]
    lateral = np.concatenate([[0.0], np.cumsum(steps)]) / n
    found = [analyse_path(lateral[: k + 1], 1.0, n, CONTROL) for k in range(1, len(steps) + 1)]
    first = next(k for k, one in enumerate(found) if one.status in SETTLED)
    caught = 41  # from the row map by eye: no fall through a lane after this row
    assert first > caught
    assert {one.mode for one in found[first:]} == {"bump"}
    bump = math.degrees(math.atan(1 / n))
    assert all(
        one.angle_high_deg >= bump for one in found[:first] if one.migration_angle_deg is not None
    )


def test_scatter_about_a_low_peak_leaves_the_mean_in_its_interval():
    """Of 40 noisy runs, intervals of 95 % miss the mean of 20,000 rows no more often than the
    binomial law allows at 1 in 1000."""
    true = angle_of_mean(circle(0.5, 1.5, 0.0, 20_000, np.random.default_rng(0), 0.05).mean())
    missed, decided = 0, 0
    for seed in range(40):
        steps = circle(0.5, 1.5, 0.0, 120, np.random.default_rng(seed + 1), 0.05)
        _, result = first_decided(steps)
        decided += result.status in SETTLED
        missed += not result.angle_low_deg <= true <= result.angle_high_deg
    assert decided > 30
    assert missed <= binom.ppf(0.999, 40, 1 - CONFIDENCE)


def test_peaks_that_scatter_about_one_exclude_nothing():
    rng = np.random.default_rng(3)
    zigzag = np.concatenate([[0.3] * 5 + [peak, 0.3, -3.2] for peak in rng.normal(0.95, 0.1, 6)])
    result = analyse(path_of(zigzag))
    assert result.status == "undecided"
    assert result.capture_chance > CONTROL.capture_chance_max
    assert result.angle_high_deg >= angle_of_mean(1)


def test_chance_is_that_of_the_predictive_distribution():
    """Monte Carlo: how often the next of n + 1 normal numbers exceeds mean + k sd of the first."""
    rng = np.random.default_rng(5)
    sample = rng.normal(size=(200_000, 5))
    score = (sample[:, 4] - sample[:, :4].mean(1)) / sample[:, :4].std(1, ddof=1)
    values = np.array([0.1, 0.2, 0.35, 0.4])
    for limit in (0.5, 0.8):
        expected = (score >= (limit - values.mean()) / values.std(ddof=1)).mean()
        assert chance_beyond(values, limit, 0.0) == pytest.approx(expected, rel=0.05)


# ------------------------------------------------------------------- passes of several releases


def releases(peak, rows, seed, noise=0.06):
    """Three paths over one map, from three places."""
    found = {}
    for place, start in {0.2: -1.0, 0.5: -4.0, 0.8: -8.0}.items():
        rng = np.random.default_rng([seed, int(10 * place)])
        found[place] = analyse(path_of(circle(peak, 1.5, start, rows, rng, noise)))
    return found


def test_passes_of_all_releases_count_together():
    """What three releases of 35 rows cannot tell alone they tell together, and the mean of 20,000
    rows is missed no more often than the binomial law allows at 1 in 1000."""
    true = angle_of_mean(circle(0.5, 1.5, 0.0, 20_000, np.random.default_rng(0), 0.06).mean())
    alone = settled = missed = count = 0
    for seed in range(0, 90, 3):
        found = releases(0.5, 35, seed)
        together = taken_together(found, PITCH, N, CONTROL)
        alone += sum(one.status in SETTLED for one in found.values())
        for one in together.values():
            if one.status in SETTLED:
                settled += 1
                missed += not one.angle_low_deg <= true <= one.angle_high_deg
        count += len(found)
    assert settled > max(1.5 * alone, 0.6 * count)
    assert missed <= binom.ppf(0.999, settled, 1 - CONFIDENCE)


def test_together_as_near_the_transition_as_alone_nothing_is_excluded():
    for seed in range(0, 30, 3):
        together = taken_together(releases(0.9, 35, seed, 0.1), PITCH, N, CONTROL)
        for one in together.values():
            assert one.status == "undecided" or one.mode == "bump" or one.orbit_rows


def test_passes_that_the_lane_has_ended_tell_nothing_of_the_others():
    found = releases(0.5, 35, 0)
    caught = analyse(path_of([*circle(0.5, 1.5, -1.0, 30), 0.6, 0.9, 1.1, *[1.0] * 12]))
    assert caught.status == "converged"
    place = next(at for at, one in found.items() if one.status == "undecided")
    both = taken_together({place: found[place], 0.9: caught}, PITCH, N, CONTROL)
    assert both[place].status == "undecided"


def test_passes_of_other_lengths_are_unlike():
    """Reference: a t test of two samples, whose square F is."""

    def of(*rows):
        starts = np.concatenate([[0.0], np.cumsum(rows)])
        return Passes(starts, np.zeros(len(starts)), np.full(len(rows), 0.5))

    slow, fast, slower = (11.0, 12.5, 11.5), (13.6, 14.5, 13.9), (11.4, 12.9, 12.2)
    for pair, expected in (((slow, fast), False), ((slow, slower), True)):
        assert alike([of(*rows) for rows in pair]) == expected == (ttest_ind(*pair).pvalue > 0.05)
    assert alike([of(12.0, 12.0), of(12.0)])
    assert not alike([of(12.0, 12.0), of(13.0, 13.0)])


# ------------------------------------------------------------------- lane of another release


def swinging_to(place, start, rows=36, seed=0, drift=0.0):
    """A path from ``start`` to a lane about ``place``, in row shifts, that it never repeats."""
    k = np.arange(rows + 1)
    z = place + (start - place) * 0.6**k
    z[1:] += 0.2 * np.random.default_rng(seed).uniform(-1, 1, rows)
    return SHIFT * (z + k * (1 - drift))


def test_a_lane_that_holds_one_release_holds_another():
    orbit = 1 + np.concatenate([3 * 0.5 ** np.arange(6), np.tile([0.0, 0.2, -0.2], 8)])
    rests = analyse(SHIFT * (orbit + np.arange(len(orbit))))
    swings = analyse(swinging_to(1.0, 2.4))
    assert (rests.status, swings.status) == ("periodic", "undecided")
    together = taken_together({0.5: rests, 0.2: swings}, PITCH, N, CONTROL)[0.2]
    assert (together.status, together.mode) == ("stationary", "bump")
    assert together.angle_low_deg < angle_of_mean(1) < together.angle_high_deg
    # One lane further on is the same place; half a lane further, or a path that drifts, is not.
    for path, same in (
        (swinging_to(1.0 + N, 2.4 + N), True),
        (swinging_to(1.5, 2.4), False),
        (swinging_to(1.0, 2.4, drift=0.02), False),
    ):
        found = {0.5: rests, 0.2: analyse(path)}
        status = taken_together(found, PITCH, N, CONTROL)[0.2].status
        assert (status == "stationary") == same


# ------------------------------------------------------------------------------- orbits


def test_an_orbit_falls_through_whole_lanes():
    orbit = [0.4, 0.3, 0.35, 0.3, 0.45, 0.6, 0.2, 0.4, 0.5, 0.55, 0.5, -2.55]
    assert sum(orbit) == pytest.approx(len(orbit) - N)
    rows, result = first_decided([0.7, 0.1, *orbit * 4])
    assert (result.status, result.orbit_rows) == ("periodic", 12)
    assert rows <= 2 + 2 * 12
    assert result.migration_angle_deg == pytest.approx(angle_of_mean(1 - N / 12))
    assert result.transition_distance == pytest.approx(-0.4)


@pytest.mark.parametrize(("first", "status"), [(2.0, "undecided"), (0.6, "periodic")])
def test_returns_that_halve_are_believed_within_the_scatter_of_the_map(first, status):
    """The displacement from an orbit shrinks to 0.4 of it from orbit to orbit.

    Largest last return: 0.4² · 0.6 of the first, 0.19 or 0.06 row shifts (scatter of the map: 0.1).
    """
    orbit = np.array([0.4, 0.3, 0.35, 0.3, 0.45, 0.9, 0.2, 0.4, 0.5, 0.55, 0.5, -2.85])
    framed_orbit = np.concatenate([[0.0], np.cumsum(np.tile(orbit - 1, 4))])
    displaced = framed_orbit + first * 0.4 ** (np.arange(49) / 12)
    result = analyse(path_of(1 + np.diff(displaced)))
    assert result.status == status


def test_returns_within_a_quarter_that_do_not_tighten_are_no_orbit():
    orbit = np.array([0.4, 0.3, 0.35, 0.3, 0.45, 0.9, 0.2, 0.4, 0.5, 0.55, 0.5, -2.85])
    off = 0.2 * np.random.default_rng(6).uniform(-1, 1, 12)
    steps = np.concatenate([orbit, orbit + off - off.mean(), orbit])
    assert analyse(path_of(steps)).status == "undecided"


def test_a_path_shorter_than_a_period_has_no_angle():
    result = analyse(path_of([1.0] * (N - 1)))
    assert (result.status, result.mode, result.orbit_rows) == ("undecided", "none", 0)
    assert result.migration_angle_deg is None
    assert result.first_period_angle_deg is None
    assert len(result.lateral_steps) == N - 1


@given(st.lists(st.floats(-3, 1.5), min_size=N, max_size=40))
def test_every_path_has_an_angle_within_its_bounds(steps):
    result = analyse(path_of(steps))
    assert result.angle_low_deg <= result.migration_angle_deg <= result.angle_high_deg


@pytest.mark.parametrize(
    ("share", "mode"),
    [
        (1.05, "bump"),
        (0.91, "bump"),
        (0.89, "mixed"),
        (0.11, "mixed"),
        (0.09, "zigzag"),
        (-0.3, "zigzag"),
    ],
)
def test_modes(share, mode):
    assert mode_of(math.degrees(math.atan(share * 0.1)), 0.1) == mode


# ------------------------------------------------------------------------------- several releases


def one(mode="bump", status="converged", distance=0.2, half=0.1):
    share = {"bump": 1.0, "mixed": 0.5, "zigzag": 0.0, "none": None}[mode]
    if share is None:
        return Migration(status, "as made up")
    angle = angle_of_mean(share)
    return Migration(
        status,
        "as made up",
        mode,
        angle,
        angle - half,
        angle + half,
        angle,
        1,
        None if status == "undecided" else 9,
        1 + distance,
        distance,
        0.0,
    )


@given(st.lists(st.integers(0, 1000), min_size=1, max_size=5, unique=True))
def test_flux_shares_integrate_the_profile(places):
    """Reference: each of 200,000 cells, spread by flux, goes to the nearest place."""
    places = [place / 1000 for place in places]
    f = (np.arange(200_000) + 0.5) / 200_000
    nearest = np.abs(f[:, None] - places).argmin(axis=1)
    weights = 6 * f * (1 - f) / len(f)
    expected = np.bincount(nearest, weights, minlength=len(places))
    np.testing.assert_allclose(flux_shares(places), expected, atol=2e-5)


def test_releases_that_agree_are_decided():
    outcome = outcome_of({0.5: one(), 0.2: one(distance=0.15)}, N)
    assert (outcome.status, outcome.mode, outcome.coexisting) == ("decided", "bump", False)
    assert (outcome.share_bump, outcome.angle_spread_deg) == (1.0, 0.0)
    assert (outcome.transition_distance, outcome.settled_row, outcome.releases) == (0.15, 9, 2)


def test_releases_that_end_in_different_motions_coexist():
    outcome = outcome_of({0.5: one(), 0.2: one("zigzag", distance=-0.4), 0.8: one()}, N)
    weight = flux_shares([0.2, 0.5, 0.8])
    assert (outcome.status, outcome.coexisting) == ("coexisting", True)
    assert outcome.share_zigzag == pytest.approx(weight[0])
    assert outcome.migration_angle_deg == pytest.approx((1 - weight[0]) * angle_of_mean(1))
    assert outcome.angle_spread_deg == pytest.approx(angle_of_mean(1))


@pytest.mark.parametrize(
    ("other", "status", "share_none"),
    [
        (one("mixed", "undecided"), "undecided", 0),
        (one("none", "undecided"), "undecided", 0.5),
        (one("none", "stuck"), "coexisting", 0.5),
        (one("none", "unstable"), "undecided", 0.5),
        (one("none", "failed"), "undecided", 0.5),
    ],
)
def test_one_release_that_is_not_settled(other, status, share_none):
    outcome = outcome_of({0.2: one(), 0.8: other}, N)
    assert (outcome.status, outcome.share_none) == (status, pytest.approx(share_none))
    assert outcome.settled_row is None
    assert outcome_of({0.2: other}, N).status == other.status


def test_next_release():
    places = (0.5, 0.2, 0.8)
    far, near = one(), one(distance=0.02)
    assert next_release({}, places, N) == 0.5
    assert next_release({0.5: far}, places, N) == 0.2
    assert next_release({0.5: far, 0.2: far}, places, N) is None
    below = {0.5: one("zigzag", distance=-0.4), 0.2: one("zigzag", distance=-0.5)}
    assert next_release(below, places, N) is None
    for second in (
        near,
        one("zigzag", distance=-0.4),
        one("zigzag", distance=-0.2),
        one("mixed", "undecided"),
        one("none", "stuck"),
    ):
        assert next_release({0.5: far, 0.2: second}, places, N) == 0.8
        assert next_release({0.5: far, 0.2: second, 0.8: far}, places, N) is None
    assert next_release({0.5: far}, (0.5,), N) is None
