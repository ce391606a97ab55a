"""The factor of conformal intervals, and the coverage that it gives."""

import numpy as np
import pytest

from dldsim.analysis import conformal


def test_conformal_factor_by_hand():
    """Three geometries and the unknown one weigh a quarter each."""
    scores = [[0.1, 0.2], [0.3], [0.4]]
    assert conformal.conformal_factor(scores, 0.25) == 0.2
    assert conformal.conformal_factor(scores, 0.5) == 0.3
    assert conformal.conformal_factor(scores, 0.75) == 0.4
    assert conformal.conformal_factor(scores, 0.76) == np.inf


@pytest.mark.parametrize("level", [0.5, 0.8, 0.9])
def test_conformal_coverage_on_clustered_noise(level):
    """Geometries with a common error: pooling all rows as if independent would cover too little."""
    rng = np.random.default_rng(2)

    def geometry():
        return np.abs(rng.normal() + 0.3 * rng.normal(size=4))

    covered = []
    for _ in range(400):
        factor = conformal.conformal_factor([geometry() for _ in range(30)], level)
        covered.append((geometry() <= factor).mean())
    assert level - 0.03 < np.mean(covered) < level + 0.06
