"""A sphere of vertices under uniform traction."""

import numpy as np
import pytest

from dldsim.evidence.drag import drag_over_radius, lag_under_traction
from dldsim.evidence.reference import read_reference
from dldsim.solver.time_loop import MEMBRANE_SLIP

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("root", [0.15, 0.35, 0.4, 0.45])
def test_drag_of_a_simple_cubic_array_is_that_of_the_series(root):
    # Sangani & Acrivos 1982, Int. J. Multiphase Flow 8:343: 1/K in the cube root of φ.
    c = root
    mobility = 1 - 1.7601 * c + c**3 - 1.5593 * c**6 + 3.9799 * c**8 - 3.0734 * c**10
    radius = c / (4 * np.pi / 3) ** (1 / 3)
    assert drag_over_radius(radius) == pytest.approx(radius / mobility, rel=1e-3)


def test_drag_passes_through_the_table():
    for row in read_reference("zick_homsy_1982"):
        radius = (row["solid_fraction"] / (4 * np.pi / 3)) ** (1 / 3)
        assert drag_over_radius(radius) == pytest.approx(radius * row["drag_factor_K"])


@pytest.mark.parametrize("kernel", MEMBRANE_SLIP)
def test_slip_is_what_a_sphere_of_six_nodes_lags(kernel):
    lag = lag_under_traction(6, kernel=kernel)
    assert (lag.along, lag.across) == pytest.approx(MEMBRANE_SLIP[kernel], abs=0.003)
    assert lag.uneven < 0.015
    assert lag.radius == pytest.approx(6, abs=0.03)


@pytest.fixture(scope="module")
def usual():
    return lag_under_traction(4)


@pytest.mark.parametrize(
    "settings",
    [
        {"relaxation_time": 1.25},
        {"offset": (0.1, 0.3, 0.2)},
        {"edge_to_spacing": 0.7},
        {"edge_to_spacing": 1.4},
    ],
)
def test_lag_is_that_of_the_kernel_alone(settings, usual):
    lag = lag_under_traction(4, **settings)
    assert (lag.along, lag.across) == pytest.approx((usual.along, usual.across), abs=0.006)
    assert lag.radius == pytest.approx(4, abs=0.05)
