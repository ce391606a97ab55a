"""What periodic images of an obstacle do to the flow that it meets, and how that is taken out."""

import numpy as np
import pytest

from dldsim.config.sections import Flow, Geometry, Numerics
from dldsim.solver.flow import Fluid, advance_to_steady, solve_empty_array
from dldsim.solver.images import images_share
from dldsim.solver.lattice import make_lattice, neighbour
from dldsim.solver.pillars import offset_from_pillar

PITCH, SHIFT, RADIUS = 20, 4, 5.0
WANTED = np.array([1.0, 0.0])


def responses(rows, lanes, staggered, obstacle):
    """Mean velocity of a plane array, per unit force along x and along y (2, 2), and what passes a
    disc between two pillars (2, 2): axial flux through its lane, and lateral flux on the pitch
    behind it; of the lattice that the images form, both vectors to images (2, 2)."""
    shape = rows * PITCH, lanes * PITCH
    row_shift = rows * SHIFT + staggered * lanes // 2 * PITCH
    x, y = np.meshgrid(*(np.arange(n) + 0.5 for n in shape), indexing="ij")
    dx, dy = offset_from_pillar(x, y, PITCH, SHIFT)
    across = (y - PITCH + shape[1] / 2) % shape[1] - shape[1] / 2
    solid = (dx**2 + dy**2 < RADIUS**2) | ((x - PITCH / 2) ** 2 + across**2 < obstacle**2)
    lattice = make_lattice(solid, 1, walls=False, row_shift=row_shift, dtype=np.float64)
    half = np.arange(PITCH // 2, 3 * PITCH // 2)
    lane = lattice.column[neighbour(shape, row_shift, 0 * half + PITCH // 2, half, 0, 0)]
    behind = lattice.column[neighbour(shape, row_shift, half, 0 * half + PITCH, 0, 0)]
    means, fluxes = [], []
    for force in 1e-6 * np.eye(3)[:2]:
        fluid = Fluid(lattice, 1.0, "trt", False, np.dtype(float))
        fluid.set_body_force(force)
        advance_to_steady(fluid, PITCH - RADIUS)
        means.append(fluid.mean_velocity()[:2] / 1e-6)
        u = fluid.velocity_field()[..., 0]
        passing = [np.where(c >= 0, u[d, c], 0.0).sum() for d, c in enumerate((lane, behind))]
        fluxes.append(np.array(passing) / PITCH / 1e-6)
    return np.stack(means, axis=1), np.stack(fluxes, axis=1), ((shape[0], row_shift), (0, shape[1]))


def fluxes(empty, *scene):
    """Axial and lateral flux, over that wanted, with the mean flux held; the force held; without
    half of what the cells do to the mean flow; without the images' part of it. ``empty`` is the
    array's own mean velocity per force."""
    mean, flux, lattice = responses(*scene)
    share = images_share(*lattice, empty)
    met = mean, empty, (mean + empty) / 2, share @ mean + (np.eye(2) - share) @ empty
    return [flux @ np.linalg.solve(m, WANTED) for m in met]


@pytest.fixture(scope="module")
def empty():
    return responses(1, 1, False, 0.0)[0]


@pytest.mark.slow
@pytest.mark.parametrize("obstacle", [3.0, 4.5])
def test_few_pillars_tell_the_flux_past_one_obstacle_in_an_endless_array(empty, obstacle):
    """With the mean flux held all of it must pass the obstacle where every lane has one, instead of
    a twelfth and less. In a large domain flux held and force held enclose the truth."""
    flux_held, force_held, *_, alone = fluxes(empty, 8, 8, False, obstacle)
    assert flux_held[0] == pytest.approx(force_held[0], rel=0.05)
    assert force_held[0] < alone[0] < flux_held[0] < 1 / 12
    assert fluxes(empty, 2, 1, False, obstacle)[0][0] == pytest.approx(1.0, rel=1e-3)
    for domain, error in (((1, 2, True), 0.015), ((2, 2, False), 0.01), ((2, 4, True), 0.01)):
        assert fluxes(empty, *domain, obstacle)[-1][0] == pytest.approx(alone[0], rel=error)
    for domain in ((2, 1, False), (1, 3, False), (3, 2, False)):  # far from a square lattice
        assert fluxes(empty, *domain, obstacle)[-1][0] == pytest.approx(alone[0], rel=0.07)
    assert abs(fluxes(empty, 1, 2, True, obstacle)[0][0] / alone[0] - 1) > 0.5
    # Of a lattice whose rows are shifted half of what cells do turns the flow.
    for domain, error in (((2, 4, True), 0.05), ((1, 2, True), 0.6)):
        *_, half, dilute = fluxes(empty, *domain, obstacle)
        assert dilute[1] == pytest.approx(alone[1], rel=error)
        assert abs(dilute[1] - alone[1]) < 0.6 * abs(half[1] - alone[1])


@pytest.mark.parametrize("across", [(0, 1), (0, 2), (0, 0.7)])
@pytest.mark.parametrize("along", [(1, 0), (1, 0.25), (1, 1), (1, 1.2), (2, 0.5)])
def test_the_share_of_the_images_is_the_field_of_their_dipoles(along, across):
    """Half, as in the middle of a disc of a medium of dipoles, and what those within it add. Its
    edge is faint, so that no image enters at once."""
    count = np.arange(-200, 201)
    images = np.stack(np.meshgrid(count, count), axis=-1).reshape(-1, 2)
    images = images @ np.array([along, across], float)
    square = np.einsum("ni,ni->n", images, images)
    images, square = images[square > 0], square[square > 0]
    weight = np.exp(-square / 40**2) / (2 * np.pi * square**2)
    fields = 2 * np.einsum("n,ni,nj->ij", weight, images, images)
    fields -= np.eye(2) * (weight * square).sum()
    known = np.eye(2) / 2 + along[0] * across[1] * fields
    np.testing.assert_allclose(images_share(along, across, 3.0 * np.eye(2)), known, atol=3e-4)
    # A medium that lets twice as much pass along x is one whose lengths along x are shorter.
    along, mobility = (along[0] * np.sqrt(2), along[1]), np.diag([2.0, 1.0])
    stretched = images_share(along, across, mobility)
    np.testing.assert_allclose(np.diag(stretched), np.diag(known), atol=3e-4)
    root = np.sqrt(2)
    off = [stretched[0, 1] / root, stretched[1, 0] * root]
    np.testing.assert_allclose(off, known[0, 1], atol=3e-4)


@pytest.mark.parametrize(("rows", "lanes"), [(1, 2), (2, 2), (2, 4)])
def test_a_staggered_domain_has_the_flow_of_the_array(rows, lanes):
    geometry = Geometry(pillar_radius_um=5.0, gap_um=10.0, periodicity=5)
    exact = {"spacing_um": 1.0, "precision": "float64", "half_scene": False}
    one = solve_empty_array(geometry, Flow(height_um=0), Numerics(**exact, rows=1, lanes=1))
    numerics = Numerics(**exact, rows=rows, lanes=lanes, images="dilute")
    assert numerics.staggered == (lanes == 2 * rows)
    more = solve_empty_array(geometry, Flow(height_um=0), numerics)
    np.testing.assert_allclose(more.mobility, one.mobility, rtol=1e-6, atol=1e-9)
