"""The outline of a cell and its circularity, against shapes that are known."""

import numpy as np
import pytest
from scipy.special import ellipe

from dldsim.experiments.outline import RAYS, circularity, outline
from dldsim.solver.membrane import make_membrane
from dldsim.solver.mesh import make_shape

ANGLES = np.arange(RAYS) * 2 * np.pi / RAYS


def ellipse(a, b):
    return a * b / np.hypot(b * np.cos(ANGLES), a * np.sin(ANGLES))


def test_circularity_of_circle_and_ellipse():
    assert circularity(np.full(RAYS, 3.0)) == pytest.approx(1, abs=5e-5)
    # P = 4 a E(e²), A = π a b.
    expected = 2 * np.pi * 2**0.5 / (4 * 2 * ellipe(1 - 0.25))
    assert circularity(ellipse(2.0, 1.0)) == pytest.approx(expected, abs=1e-4)


def test_circularity_does_not_fill_in_a_dent():
    dented = 1 + 0.2 * np.cos(2 * ANGLES) ** 8
    assert circularity(dented) < circularity(ellipse(1.2, 1.0)) - 0.01


@pytest.mark.parametrize("axis", "xyz")
def test_outline_of_a_disc_is_what_is_seen_along_z(axis):
    """Face on a circle, edge on the profile of Evans and Fung, 4.92 thick at its rim."""
    x, faces = make_shape("biconcave", 7.5, 14, axis=axis)
    radii = outline(x + [3.0, -2.0, 5.0], make_membrane(x, faces))
    if axis == "z":
        np.testing.assert_allclose(radii, 7.5, rtol=0.01)
        assert 1 - circularity(radii) < 0.002
    else:
        along = radii if axis == "y" else np.roll(radii, -RAYS // 4)
        assert along[0] == along.max() == pytest.approx(7.5, rel=0.01)
        box = 2 * np.max(radii * np.abs(np.sin(ANGLES) if axis == "y" else np.cos(ANGLES)))
        assert box == pytest.approx(0.6562 * 7.5, rel=0.02)


def test_outline_of_a_stretched_ball():
    x, faces = make_shape("sphere", 1.0, 14)
    radii = outline(x * [2.0, 1.0, 1.5], make_membrane(x, faces))
    np.testing.assert_allclose(radii, ellipse(2.0, 1.0), rtol=0.01)
