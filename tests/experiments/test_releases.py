"""Releases taken together: passes of all, lane of another, outcome, next place."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from dldsim.experiments.migration import Migration
from dldsim.experiments.passes import CONFIDENCE
from dldsim.experiments.releases import flux_shares, next_release, outcome_of, taken_together
from dldsim.vocabulary import SETTLED
from tests.experiments.test_settling import (
    CONTROL,
    PITCH,
    SHIFT,
    N,
    analyse,
    angle_of_mean,
    circle,
    path_of,
)


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
    far, near = one(distance=0.4), one(distance=0.2)
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
