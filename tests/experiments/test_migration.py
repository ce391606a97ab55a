"""Crossings of rows, and modes."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dldsim.experiments.migration import mode_of, row_crossings


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
