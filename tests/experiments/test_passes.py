"""What lengths and peaks of passes say."""

import numpy as np
import pytest
from scipy.stats import ttest_ind

from dldsim.experiments.migration import Migration
from dldsim.experiments.passes import Passes, alike, chance_beyond, falling, find_passes


def test_chance_is_that_of_the_predictive_distribution():
    """Monte Carlo: how often the next of n + 1 normal numbers exceeds mean + k sd of the first."""
    rng = np.random.default_rng(5)
    sample = rng.normal(size=(200_000, 5))
    score = (sample[:, 4] - sample[:, :4].mean(1)) / sample[:, :4].std(1, ddof=1)
    values = np.array([0.1, 0.2, 0.35, 0.4])
    for limit in (0.5, 0.8):
        expected = (score >= (limit - values.mean()) / values.std(ddof=1)).mean()
        assert chance_beyond(values, limit, 0.0) == pytest.approx(expected, rel=0.05)


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


def test_a_cell_may_fall_through_two_lanes_in_a_row():
    m = np.array([1.0, 0.9, 0.5, -6.6, 0.9, 0.5, 0.4, -0.8])
    passes = find_passes(m, 3)
    assert len(passes) >= 2
    assert np.isfinite(passes.start_errors).all() and np.isfinite(passes.peaks).all()


@pytest.mark.parametrize(
    ("status", "mode", "known"),
    [
        ("stationary", "mixed", True),
        ("undecided", "mixed", True),
        ("converged", "bump", False),
        ("stationary", "bump", False),  # swings there
        ("periodic", "bump", False),
    ],
)
def test_passes_before_a_capture_tell_nothing_of_how_often_the_lane_catches(status, mode, known):
    m = np.tile([0.8, 0.7, 0.5, -2.0, 0.6], 5)
    steps = m / 4  # of a pitch of 1 and N_p 4
    other = Migration(status, "", mode, lateral_steps=steps, lateral_start=0.0)
    assert bool(falling([other], 1.0, 4)) is known
