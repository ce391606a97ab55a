"""Contact with solids: distances, and a force that is the gradient of its potential."""

import numpy as np
import pytest

from dldsim.config.sections import Constriction, Numerics
from dldsim.experiments.constriction import make_channel
from dldsim.solver.contact import Contact, channel_distance, clearance, contact_forces
from dldsim.solver.pillars import pillar_distance


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def make_contact(vertices, **surfaces):
    values = {
        "strength": np.full(vertices, 0.3),
        "exponent": 1.2,
        "reach": 0.8,
        "core": 0.04,
        "pillars": False,
        "pitch": 12.0,
        "row_shift": 3.0,
        "radius": 4.0,
        "plates": False,
        "height": 8.0,
        "channel": False,
        "profile": np.zeros((2, 1)),
        "centre": 0.0,
        "length": 1.0,
    }
    return Contact(**{**values, **surfaces})


@pytest.fixture(scope="module")
def channel():
    made = make_channel(Constriction(spacing_um=1.0), Numerics())
    return {
        "channel": True,
        "profile": made.profile,
        "centre": made.centre,
        "length": float(made.length),
    }


def pillar_centres(contact):
    i, j = np.indices((9, 13)) - np.array([4, 6])[:, None, None]
    x = (i + 0.5) * contact.pitch
    return np.stack([x, i * contact.row_shift + (j + 0.5) * contact.pitch], axis=-1).reshape(-1, 2)


def test_pillar_distance_is_that_of_the_nearest_pillar(rng):
    contact = make_contact(1, pillars=True)
    centres = pillar_centres(contact)
    points = rng.uniform(-24, 24, (2000, 2))
    distances = np.linalg.norm(points[:, None] - centres, axis=2)
    exact = distances.min(axis=1) - contact.radius
    near = exact < 0.5 * contact.pitch - contact.radius  # half the gap: further out, rows compete
    assert near.sum() > 1000 and (exact < 0).sum() > 100
    for point, distance, nearest in zip(
        points[near], exact[near], centres[distances.argmin(axis=1)][near], strict=True
    ):
        r, ux, uy = pillar_distance(*point, 12.0, 3.0, 4.0)
        assert r == pytest.approx(distance, abs=1e-12)
        away = (point - nearest) / np.linalg.norm(point - nearest)
        np.testing.assert_allclose((ux, uy), away, atol=1e-12)
    assert pillar_distance(6.0, 6.0, 12.0, 3.0, 4.0)[0] == -4.0


def test_channel_distance_is_that_of_the_nearest_wall(rng, channel):
    contact = make_contact(1, **channel)
    x, half = contact.profile
    fine = np.concatenate([np.linspace(a, b, 4001) for a, b in zip(x[:-1], x[1:], strict=True)])
    wall = np.stack([fine, np.interp(fine, x, half)], axis=1)
    wall = np.concatenate([wall + (k * contact.length, 0) for k in (-1, 0, 1)])
    wall = np.concatenate([wall, wall * (1, -1)]) + (0, contact.centre)
    points = rng.uniform([-5, -1], [contact.length + 5, 2 * contact.centre + 1], (120, 2))
    for point in points:
        exact = np.linalg.norm(wall - point, axis=1).min()
        inside = abs(point[1] - contact.centre) < np.interp(point[0] % contact.length, x, half)
        r, ux, uy = channel_distance(*point, contact)
        # Wall points are 0.01 apart.
        assert r == pytest.approx(exact if inside else -exact, abs=6e-3)
        assert np.hypot(ux, uy) == pytest.approx(1, abs=1e-9)
        # Along the unit vector the distance grows one to one, into the fluid.
        ahead = channel_distance(point[0] + 1e-5 * ux, point[1] + 1e-5 * uy, contact)[0]
        assert ahead - r == pytest.approx(1e-5, rel=1e-3)


def potential(r, contact):
    """Integral of the force from distance r to the reach."""
    a, n, reach = contact.strength[0], contact.exponent, contact.reach
    return a * (r**-n - reach**-n) + a * n * reach ** (-n - 1) * (r - reach)


SCENES = {
    "pillar": ({"pillars": True}, lambda c, p: pillar_distance(p[0], p[1], 12.0, 3.0, 4.0)[0]),
    "floor": ({"plates": True}, lambda c, p: p[2]),
    "ceiling": ({"plates": True}, lambda c, p: 8.0 - p[2]),
    "channel": (None, lambda c, p: channel_distance(p[0], p[1], c)[0]),
}


@pytest.mark.parametrize("scene", SCENES)
def test_contact_force_is_minus_the_gradient_of_its_potential(rng, scene, channel):
    surfaces, distance = SCENES[scene]
    contact = make_contact(1, **(channel if surfaces is None else surfaces))
    found = 0
    top = [contact.length, 2 * contact.centre, 4] if scene == "channel" else [24, 24, 8]
    for point in rng.uniform([0, 0, 0], top, (6000, 3)):
        r = distance(contact, point)
        if not contact.core + 1e-3 < r < contact.reach:
            continue
        found += 1
        force = np.zeros((1, 3))
        contact_forces(point[None], contact, force)
        h = 1e-5 * r
        gradient = [
            potential(distance(contact, point + e), contact)
            - potential(distance(contact, point - e), contact)
            for e in h * np.eye(3)
        ]
        # Central differences: h²/r² = 1e-10 against rounding of 1e-16/1e-5.
        size = np.linalg.norm(force)
        np.testing.assert_allclose(force[0], -np.array(gradient) / (2 * h), atol=1e-6 * size + 1e-8)
    assert found > 50


def test_contact_vanishes_beyond_its_reach_and_stays_finite_at_the_surface():
    contact = make_contact(1, pillars=True, plates=True)
    force = np.zeros((1, 3))
    contact_forces(np.array([[6.0, 6.0 + 4.0 + 0.8001, 4.0]]), contact, force)
    assert not force.any()
    assert clearance(np.array([[6.0, 10.5, 4.0]]), contact) == pytest.approx(0.5)
    assert clearance(np.array([[6.0, 10.5, 7.8]]), contact) == pytest.approx(0.2)
    pushes = []
    for r in (0.7, 0.4, 0.1, contact.core, 0.01, 0.0, -0.5):
        force[:] = 0
        contact_forces(np.array([[6.0, 6.0 + 4.0 + r, 4.0]]), contact, force)
        assert force[0, 0] == pytest.approx(0, abs=1e-12)
        assert force[0, 2] == 0
        pushes.append(force[0, 1])
    assert np.all(np.diff([0, *pushes]) > 0)  # outward and growing
    # Below the core in proportion to the distance, with the slope that it has there.
    n, a = contact.exponent, contact.strength[0]
    slope = a * n * (n + 1) * contact.core ** (-n - 2)
    assert pushes[4] - pushes[3] == pytest.approx(slope * (contact.core - 0.01), rel=1e-9)
    assert pushes[6] - pushes[5] == pytest.approx(slope * 0.5, rel=1e-9)
