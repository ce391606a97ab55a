"""When a shape counts as steady, and what is read off it."""

import numpy as np
import pytest

from dldsim.experiments.passage import box_index, change_of, elongation_index


def test_a_steady_shape_stays_within_the_window():
    values = np.array([[1.0, 0.0], [0.5, 0.0], [0.3, 0.2], [0.3, 0.21], [0.31, 0.21]])
    assert change_of(values, 5, swings=False) is None
    assert change_of(values, 2, swings=False) == pytest.approx(0.01)
    assert change_of(values, 3, swings=False) == pytest.approx(0.21)  # 1 − circularity


def test_a_swinging_shape_is_judged_by_means():
    """A whole period in each window: no change; half of one: all of it."""
    swing = np.sin(np.arange(40) * 2 * np.pi / 10)[:, None]
    assert change_of(swing, 10, swings=True) == pytest.approx(0, abs=1e-12)
    assert change_of(swing, 5, swings=True) == pytest.approx(2 * abs(swing[-5:].mean()))
    assert change_of(swing[:19], 10, swings=True) is None


def test_indices_of_extents():
    assert box_index(3.0, 1.0) == box_index(1.0, 3.0) == 0.5
    assert elongation_index(1.0, 3.0) == -0.5
