"""What periodic images of an obstacle do to the flow that it meets, and how that is taken out."""

import numpy as np
import pytest

from dldsim.config.sections import Flow, Geometry, Numerics
from dldsim.errors import DldsimError
from dldsim.solver.flow import Fluid, advance_to_steady, solve_empty_array
from dldsim.solver.lattice import make_lattice
from dldsim.solver.pillars import offset_from_pillar

PITCH, SHIFT, RADIUS = 20, 2, 5.0
WANTED = np.array([1.0, 0.0])


def responses(rows, lanes, staggered, obstacle):
    """Mean velocity and axial flux through the lane of a disc between two pillars of a plane array,
    per unit force along x and along y: (2, 2), (2,)."""
    shape = rows * PITCH, lanes * PITCH
    x, y = np.meshgrid(*(np.arange(n) + 0.5 for n in shape), indexing="ij")
    dx, dy = offset_from_pillar(x, y, PITCH, SHIFT)
    across = (y - PITCH + shape[1] / 2) % shape[1] - shape[1] / 2
    solid = (dx**2 + dy**2 < RADIUS**2) | ((x - PITCH / 2) ** 2 + across**2 < obstacle**2)
    lattice = make_lattice(
        solid,
        1,
        walls=False,
        row_shift=rows * SHIFT + staggered * lanes // 2 * PITCH,
        dtype=np.float64,
    )
    column = lattice.column[PITCH // 2, np.arange(PITCH // 2, 3 * PITCH // 2) % shape[1]]
    means, fluxes = [], []
    for force in 1e-6 * np.eye(3)[:2]:
        fluid = Fluid(lattice, 1.0, "trt", False, np.dtype(float))
        fluid.set_body_force(force)
        advance_to_steady(fluid, PITCH - RADIUS)
        means.append(fluid.mean_velocity()[:2] / 1e-6)
        axial = np.where(column >= 0, fluid.velocity_field()[0, column, 0], 0.0)
        fluxes.append(axial.sum() / PITCH / 1e-6)
    return np.stack(means, axis=1), np.array(fluxes)


@pytest.fixture(scope="module")
def empty():
    return responses(1, 1, False, 0.0)[0]


@pytest.mark.parametrize("obstacle", [3.0, 4.5])
def test_two_pillars_tell_the_flux_past_one_obstacle_in_an_endless_array(empty, obstacle):
    """With the mean flux held all of it must pass the obstacle where every lane has one, instead of
    a twelfth and less. In a large domain flux held and force held enclose the truth."""

    def held_and_free(rows, lanes, staggered):
        mean, flux = responses(rows, lanes, staggered, obstacle)
        forces = [np.linalg.solve(m, WANTED) for m in (mean, empty, (mean + empty) / 2)]
        return [float(flux @ force) for force in forces]

    flux_held, force_held, _ = held_and_free(8, 8, False)
    assert flux_held == pytest.approx(force_held, rel=0.05)
    alone = (flux_held + force_held) / 2
    assert alone < 1 / 12
    assert held_and_free(2, 1, False)[0] == pytest.approx(1.0, rel=1e-3)
    for domain in ((1, 2, True), (2, 2, False), (2, 4, True)):
        dilute = held_and_free(*domain)[2]
        assert dilute == pytest.approx(alone, rel=0.01)
    assert abs(held_and_free(1, 2, True)[0] / alone - 1) > 0.5


@pytest.mark.parametrize(("rows", "lanes"), [(1, 2), (2, 2), (2, 4)])
def test_a_staggered_domain_has_the_flow_of_the_array(rows, lanes):
    geometry = Geometry(pillar_radius_um=5.0, gap_um=10.0, periodicity=5)
    exact = {"spacing_um": 1.0, "precision": "float64", "half_scene": False}
    one = solve_empty_array(geometry, Flow(height_um=0), Numerics(**exact, rows=1, lanes=1))
    numerics = Numerics(**exact, rows=rows, lanes=lanes, images="dilute")
    assert numerics.staggered == (lanes == 2 * rows)
    more = solve_empty_array(geometry, Flow(height_um=0), numerics)
    np.testing.assert_allclose(more.mobility, one.mobility, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("domain", [{"rows": 2, "lanes": 1}, {"rows": 1, "lanes": 3}])
def test_images_that_form_no_square_are_not_taken_out(domain):
    from dldsim.config.explain import validate

    with pytest.raises(DldsimError, match="images: dilute with lanes = rows or 2 rows"):
        validate(Numerics, {"images": "dilute", **domain})
