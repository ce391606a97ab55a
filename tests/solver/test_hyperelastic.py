"""Laws of the neo-Hookean and Skalak membranes."""

import numpy as np
import pytest

from dldsim.solver import membrane as mb
from dldsim.solver import membrane_forces, mesh

ZERO = mb.Moduli(*[0.0] * 6)
LAWS = {
    "neo-Hookean": ZERO._replace(neo_hookean=1.3),
    "Skalak": ZERO._replace(skalak=0.8, skalak_c=2.5),
}
TRIANGLE = np.array([[0.0, 0, 0], [1.1, 0, 0], [0.4, 0.9, 0]])
"""One face is enough for the laws of a plane sheet."""


@pytest.fixture(params=list(LAWS))
def moduli(request):
    return LAWS[request.param]


def density(l1, l2, moduli):
    """Energy per rest area of the principal stretches, as the laws are printed."""
    gs, c = moduli.skalak, moduli.skalak_c
    i1, i2 = l1**2 + l2**2 - 2, (l1 * l2) ** 2 - 1
    neo_hookean = moduli.neo_hookean / 2 * (l1**2 + l2**2 + 1 / (l1 * l2) ** 2 - 3)
    return neo_hookean + gs / 4 * (i1**2 + 2 * i1 - 2 * i2 + c * i2**2)


def stretches(rest, now):
    """Principal stretches of a triangle (3, 3) from its gradient between local frames."""

    def frame(corners):
        p, q = corners[1] - corners[0], corners[2] - corners[0]
        along = p / np.linalg.norm(p)
        across = q - (q @ along) * along
        across /= np.linalg.norm(across)
        return np.array([[p @ along, q @ along], [p @ across, q @ across]])

    return np.linalg.svd(frame(now) @ np.linalg.inv(frame(rest)), compute_uv=False)


def naive_energy(x, x0, faces, moduli):
    areas = np.linalg.norm(mesh.area_vectors(x0, faces), axis=1)
    return sum(
        a * density(*stretches(x0[f], x[f]), moduli) for a, f in zip(areas, faces, strict=True)
    )


def sheet(corners):
    """A membrane of one triangle, as far as the in-plane laws need it."""
    lengths = np.linalg.norm(np.roll(corners, 1, axis=0) - np.roll(corners, -1, axis=0), axis=1)
    faces, edges = np.array([[0, 1, 2]], np.int32), np.zeros((3, 2), np.int32)
    return mb.Membrane(
        faces,
        edges,
        edges,
        np.array([[0, 1, 2]], np.int32),
        lengths,
        np.zeros(3),
        np.ones(1),
        1.0,
        1.0,
    )


def forces(x, membrane, moduli):
    force = np.full_like(x, np.nan)
    membrane_forces.elastic_forces(
        x, np.zeros_like(x), membrane, moduli, mb.make_scratch(membrane), force
    )
    return force


def random_state(seed, frequency=2):
    rng = np.random.default_rng(seed)
    x0, faces = mesh.make_shape("biconcave", 2.0, frequency)
    x = x0 @ (np.eye(3) + rng.uniform(-0.2, 0.2, (3, 3))) + 0.08 * rng.normal(size=x0.shape)
    return rng, x0, mb.make_membrane(x0, faces), x


@pytest.mark.parametrize("seed", [1, 2])
def test_energy_and_forces_equal_their_naive_twins(moduli, seed):
    _, x0, membrane, x = random_state(seed, 1)
    expected = naive_energy(x, x0, membrane.faces, moduli)
    assert mb.energies(x, membrane, moduli).stretching == pytest.approx(expected, rel=1e-12)
    step, gradient = 1e-5, np.empty_like(x)
    for i in np.ndindex(x.shape):
        at = []
        for sign in (1, -1):
            y = x.copy()
            y[i] += sign * step
            at.append(naive_energy(y, x0, membrane.faces, moduli))
        gradient[i] = (at[0] - at[1]) / (2 * step)
    got = forces(x, membrane, moduli)
    np.testing.assert_allclose(got, -gradient, rtol=0, atol=1e-8 * np.abs(got).max())


@pytest.mark.parametrize("seed", [1, 2])
def test_no_net_force_and_no_net_torque(moduli, seed):
    _, _, membrane, x = random_state(seed, 4)
    force = forces(x, membrane, moduli)
    scale = np.abs(force).sum()
    np.testing.assert_allclose(force.sum(axis=0), 0, atol=1e-13 * scale)
    np.testing.assert_allclose(np.cross(x, force).sum(axis=0), 0, atol=1e-12 * scale)


def test_forces_turn_and_travel_with_the_membrane(moduli):
    rng, _, membrane, x = random_state(3)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    force = forces(x, membrane, moduli)
    moved = forces(x @ turn.T + rng.normal(size=3), membrane, moduli)
    np.testing.assert_allclose(moved, force @ turn.T, rtol=0, atol=1e-12 * np.abs(force).max())


def test_no_force_at_rest_or_after_rigid_motion(moduli):
    rng, x0, membrane, _ = random_state(4, 5)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    moved = x0 @ turn.T + 7
    assert np.abs(forces(moved, membrane, moduli)).max() < 1e-13
    assert mb.energies(moved, membrane, moduli).stretching == pytest.approx(0, abs=1e-13)


def tension(l1, l2, moduli, angle=0.6):
    """Principal tensions (Cauchy, per deformed length) of a triangle under l1 along `angle`.

    A constant-stress triangle acts on its corners like the sheet on the midlines: the virial
    −Σ x ⊗ f is its tension times its area.
    """
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    x = TRIANGLE @ (turn @ np.diag([l1, l2, 1]) @ turn.T)
    area = np.linalg.norm(np.cross(x[1] - x[0], x[2] - x[0])) / 2
    stress = turn.T @ (-x.T @ forces(x, sheet(TRIANGLE), moduli) / area) @ turn
    np.testing.assert_allclose(stress - np.diag(np.diag(stress)), 0, atol=1e-13)
    return np.diag(stress)[:2]


@pytest.mark.parametrize("stretch", [0.7, 0.999, 1.2, 1.8])
def test_isotropic_tension(stretch):
    gs, neo_hookean = 1.3, LAWS["neo-Hookean"]
    expected = gs * (1 - stretch**-6)
    np.testing.assert_allclose(tension(stretch, stretch, neo_hookean), expected, rtol=1e-11)
    gs, c = 0.8, 2.5
    expected = gs * ((stretch**2 - 1) + c * stretch**2 * (stretch**4 - 1))
    np.testing.assert_allclose(tension(stretch, stretch, LAWS["Skalak"]), expected, rtol=1e-11)


@pytest.mark.parametrize("stretch", [0.8, 1.1, 1.6])
def test_uniaxial_tension(stretch):
    # Transverse stretch without transverse tension: λ₂ = λ₁^-½ (neo-Hookean), and
    # λ₂² = (1 + C λ₁²)/(1 + C λ₁⁴) (Skalak).
    along, across = tension(stretch, stretch**-0.5, LAWS["neo-Hookean"])
    assert along == pytest.approx(1.3 / stretch**0.5 * (stretch**2 - 1 / stretch), rel=1e-11)
    assert across == pytest.approx(0, abs=1e-13)
    gs, c = 0.8, 2.5
    narrow = ((1 + c * stretch**2) / (1 + c * stretch**4)) ** 0.5
    along, across = tension(stretch, narrow, LAWS["Skalak"])
    i2 = (stretch * narrow) ** 2 - 1
    expected = gs * (stretch / narrow * (stretch**2 - 1) + c * stretch * narrow * i2)
    assert along == pytest.approx(expected, rel=1e-11)
    assert across == pytest.approx(0, abs=1e-13)


def test_moduli_of_small_strain(moduli):
    gs = moduli.neo_hookean + moduli.skalak
    area_modulus = 3 * gs if moduli.neo_hookean else (1 + 2 * moduli.skalak_c) * gs
    eps = 1e-5
    assert tension(1 + eps, 1 + eps, moduli)[0] == pytest.approx(2 * eps * area_modulus, rel=1e-3)
    along, across = tension(1 + eps, 1 - eps, moduli)
    assert along - across == pytest.approx(4 * eps * gs, rel=1e-3)
