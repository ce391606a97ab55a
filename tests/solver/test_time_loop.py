"""The drive of a scene: towards its target, and none where none is asked for."""

import numpy as np
import pytest

from dldsim.solver.time_loop import CONTROL_INTERVAL, CONTROL_TIME, make_drive
from tests.solver.test_scene import make_cell

MOBILITY = np.array([[50.0, 0.0], [10.0, 40.0]])
TARGET = (0.02, -0.01)


def body_force(scene):
    return scene.fluid.parameters.body_force.copy()


def test_without_a_drive_the_body_force_stays():
    scene = make_cell()
    scene.fluid.set_body_force((1e-6, 2e-6, 0.0))
    scene.advance(2 * CONTROL_INTERVAL)
    assert np.array_equal(body_force(scene), [1e-6, 2e-6, 0.0])


@pytest.mark.parametrize("coupling", ["no-slip", "dissipative"])
def test_the_body_force_is_corrected_by_what_the_mean_velocity_lacks(coupling):
    scene = make_cell(coupling)
    scene.drive = make_drive(scene.fluid.lattice, MOBILITY, TARGET)
    scene.advance(CONTROL_INTERVAL - 2)
    assert not body_force(scene).any()
    scene.advance(2)
    # At rest all of the target is lacking.
    share = CONTROL_INTERVAL / CONTROL_TIME
    expected = share * np.linalg.solve(MOBILITY, TARGET)
    np.testing.assert_allclose(body_force(scene), [*expected, 0.0], rtol=1e-9)
