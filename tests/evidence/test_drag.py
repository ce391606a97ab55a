"""The hydrodynamic radius of a held sphere."""

import numpy as np
import pytest

from dldsim.evidence.drag import drag_over_radius, hydrodynamic_radius
from dldsim.evidence.reference import read_reference


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


def test_surface_does_not_move_with_the_viscosity():
    thin, thick = (hydrodynamic_radius(4, relaxation_time=tau, steps=2000) for tau in (1.25, 3.0))
    assert thin == pytest.approx(thick, abs=0.05)
    assert 4 < thin < 4.5


def test_a_wider_kernel_makes_the_sphere_larger():
    compact, peskin = (hydrodynamic_radius(4, kernel=k, steps=2000) for k in ("compact", "4-point"))
    assert 0.1 < peskin - compact < 0.4
