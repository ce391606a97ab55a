"""Laws of the draws: moments, cut at zero, flux through the inlet."""

import numpy as np
import pytest

from dldsim.design.draws import (
    Scatter,
    Stream,
    check_scatter,
    draw_cells,
    draw_devices,
    flux_beside,
    sobol,
)
from dldsim.errors import DldsimError

LEVELS = (np.arange(20000) + 0.5) / 20000


@pytest.mark.parametrize("distribution", ["normal", "lognormal"])
def test_scatter_has_its_moments(distribution):
    drawn = Scatter(7.5, 0.9, distribution).quantile(LEVELS)
    assert drawn.mean() == pytest.approx(7.5, rel=1e-4)
    assert drawn.std() == pytest.approx(0.9, rel=2e-3)
    assert drawn.min() > 0 and (np.diff(drawn) > 0).all()


def test_no_scatter_is_one_value():
    assert set(Scatter(7.5).quantile(LEVELS)) == {7.5}


def test_a_negative_radius_is_never_drawn_and_many_are_refused():
    assert Scatter(3.0, 1.0).quantile(LEVELS).min() > 0
    check_scatter(Scatter(3.0, 0.9), "radius_std_1_um", "µm")
    check_scatter(Scatter(3.0, 3.0, "lognormal"), "radius_std_1_um", "µm")
    with pytest.raises(DldsimError, match=r"radius_std_1_um: 1.5 µm .* 2.3% .* allowed 0 to 0.97"):
        check_scatter(Scatter(3.0, 1.5), "radius_std_1_um", "µm")


def test_devices_are_even_within_the_tolerance():
    drawn = draw_devices(256, 0.5, seed=1)
    for off in (drawn.off_radius_um, drawn.off_gap_um):
        assert abs(off).max() <= 0.5 and off.std() == pytest.approx(0.5 / 3**0.5, rel=0.02)
    assert drawn.deviate.shape == drawn.numerical.shape == (2, 256)
    assert drawn.numerical.std() == pytest.approx(1.0, rel=0.03)
    again = draw_devices(256, 0.5, seed=1)
    assert all((a == b).all() for a, b in zip(drawn, again, strict=True))


def test_sobol_gives_as_many_as_asked():
    assert sobol(100, 3, seed=2).shape == (3, 100) and sobol(1, 3, seed=2).shape == (3, 1)


def test_flux_beside_a_wall():
    """Half of it in half of the width; a deep duct is parabolic, a flat one even."""
    assert flux_beside(np.array([30.0]), 60.0, 20.0)[0] == pytest.approx(0.5)
    assert flux_beside(np.array([0.0]), 60.0, 20.0)[0] == pytest.approx(0.0, abs=1e-12)
    t = 0.2
    parabola = 3 * t**2 - 2 * t**3
    assert flux_beside(np.array([12.0]), 60.0, 600.0)[0] == pytest.approx(parabola, rel=0.02)
    assert flux_beside(np.array([12.0]), 60.0, 0.01)[0] == pytest.approx(t, rel=1e-3)


def test_flux_is_the_integral_of_the_duct_velocity():
    width, height = 60.0, 20.0
    z, y = (np.linspace(-s / 2, s / 2, n) for s, n in ((height, 201), (width, 601)))
    velocity = np.zeros((len(y), len(z)))
    for n in range(1, 60, 2):
        a = n * np.pi / height
        across = 1 - np.cosh(a * y) / np.cosh(a * width / 2)
        velocity += (-1) ** ((n - 1) // 2) / n**3 * across[:, None] * np.cos(a * z)
    profile = np.trapezoid(velocity, z, axis=1)
    beside = np.trapezoid(profile[:76], y[:76]) / np.trapezoid(profile, y)
    assert flux_beside(np.array([7.5]), width, height)[0] == pytest.approx(beside, rel=1e-3)


def test_entry_keeps_cells_off_the_walls_of_their_inlet():
    stream = Stream(400.0, 60.0, 20.0)
    radius = np.array([7.0, 7.0, 7.0])
    low, middle, high = stream.places(radius, np.array([0.0, 0.5, 1.0]))
    assert middle == pytest.approx(400) and low + high == pytest.approx(800)
    share = flux_beside(np.array([7.0]), 60.0, 20.0)[0]
    assert low == pytest.approx(370 + 60 * share) and 370 < low < 377
    with pytest.raises(DldsimError, match=r"sample_width_um = 60 µm: cells of up to 60 µm"):
        stream.places(np.array([30.0]), np.array([0.5]))


def test_cells_are_drawn_from_their_population():
    radii = Scatter(7.0, 0.5)

    def population(a, b):
        return radii.quantile(a), 10 + b

    drawn = draw_cells(512, population, lambda r, k: 2 * r, Stream(400.0, 60.0, 20.0), seed=3)
    assert drawn.radius_um.mean() == pytest.approx(7.0, abs=0.01)
    np.testing.assert_allclose(drawn.squeezed_um, 2 * drawn.radius_um)
    assert abs(np.corrcoef(drawn.radius_um, drawn.start_um)[0, 1]) < 0.02
    assert 0 <= drawn.luck.min() and drawn.luck.max() <= 1
