"""Laws of the membrane forces, and ESPResSo's object-in-fluid code as reference."""

import csv
import json

import numpy as np
import pytest

from dldsim import laws
from dldsim.errors import DldsimError
from dldsim.evidence.reference import FOLDER
from dldsim.solver import membrane as mb
from dldsim.solver import membrane_forces, mesh
from tests.solver import naive_membrane as naive

REFERENCE = FOLDER / "membrane_forces"
PARAMETERS = {"ks": 0.0051, "kb": 4.3e-5, "kal": 0.0102, "kag": 0.5, "kv": 0.9, "kvisc": 1.5}
TERMS = list(PARAMETERS)
ELASTIC = TERMS[:-1]
ZERO = mb.Moduli(*[0.0] * 6)


def only(term, value=1.0):
    return ZERO._replace(**{term: value})


def forces(x, v, membrane, moduli):
    force = np.full_like(x, np.nan)
    membrane_forces.elastic_forces(x, v, membrane, moduli, mb.make_scratch(membrane), force)
    return force


def random_state(seed, frequency=3, noise=0.08, shape="biconcave"):
    """Rest shape, a membrane of it, and deformed positions and velocities."""
    rng = np.random.default_rng(seed)
    x0, faces = mesh.make_shape(shape, 2.0, frequency, 0.6)
    stretch = np.eye(3) + rng.uniform(-0.15, 0.15, (3, 3))
    x = x0 @ stretch + noise * rng.normal(size=x0.shape)
    return x0, mb.make_membrane(x0, faces), x, rng.normal(size=x0.shape)


def random_rotation(rng):
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q * np.linalg.det(q)


@pytest.fixture(scope="module")
def reference_membrane():
    nodes = np.loadtxt(REFERENCE / "rbc642nodes.dat")
    inward = np.loadtxt(REFERENCE / "rbc642triangles.dat", dtype=int)
    return nodes, mb.make_membrane(nodes, inward[:, ::-1])


def test_rest_state_of_the_reference_mesh(reference_membrane):
    _, membrane = reference_membrane
    assert membrane.rest_area == pytest.approx(490.2722, abs=5e-5)
    assert membrane.rest_volume == pytest.approx(658.3274, abs=5e-5)


@pytest.mark.parametrize("term", [*TERMS, "all"])
def test_forces_equal_those_of_espresso(term, reference_membrane):
    _, membrane = reference_membrane
    table = np.loadtxt(REFERENCE / f"force_rbc642_{term}.csv", delimiter=",", skiprows=1)
    x, v, expected = (np.ascontiguousarray(table[:, k : k + 3]) for k in (0, 3, 6))
    moduli = mb.Moduli(**PARAMETERS) if term == "all" else only(term, PARAMETERS[term])
    if term == "kvisc":
        moduli = moduli._replace(ks=2e-10)
    got = forces(x, v, membrane, moduli)
    np.testing.assert_allclose(got, expected, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("seed", [1, 2])
def test_kernels_equal_their_naive_twins(seed):
    x0, membrane, x, v = random_state(seed)
    twins = [
        (ZERO._replace(ks=1.3, kvisc=0.7), naive.edge_forces(x, v, x0, membrane.faces, 1.3, 0.7)),
        (
            ZERO._replace(kal=1.1, kag=0.8, kv=0.6),
            naive.face_forces(x, x0, membrane.faces, 1.1, 0.8, 0.6),
        ),
    ]
    for moduli, expected in twins:
        np.testing.assert_allclose(forces(x, v, membrane, moduli), expected, rtol=0, atol=1e-11)
    expected = naive.bending_forces(x, x0, membrane.faces, 0.9)
    got = forces(x, v, membrane, only("kb", 0.9))
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("seed", [1, 2])
def test_angles_equal_those_of_the_naive_twin(seed):
    x0, membrane, x, _ = random_state(seed, noise=0.3)
    angles = mb.make_membrane(x, membrane.faces).rest_angles
    corners = naive.neighbours(membrane.faces)
    expected = [naive.dihedral(*x[[a, b, *corners[a, b]]]) for a, b in membrane.edges.tolist()]
    assert np.abs(expected).max() > 2
    np.testing.assert_allclose(angles, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    "angle", [0, 1e-9, -1e-5, 0.3, -1.2, np.pi / 2, -2.4, 3.1, -3.14, np.pi - 1e-7, 1e-7 - np.pi]
)
def test_angle_is_accurate_over_the_whole_circle(angle):
    a, b, c = [0.0, 0, 0], [0.0, 2, 0], [-1.5, 0.7, 0]
    d = [1.2 * np.cos(angle), 0.3, -1.2 * np.sin(angle)]
    x, faces = np.array([a, b, c, d]), np.array([[0, 1, 2], [1, 0, 3]], dtype=np.int32)
    edges, edge_faces = np.array([[0, 1]], np.int32), np.array([[0, 1]], np.int32)
    scratch = mb.make_scratch(mesh.Topology(faces, edges, edge_faces, 0 * faces))
    membrane_forces.measure_faces(x, scratch)
    membrane_forces.measure_edges(x, scratch)
    assert scratch.angles[0] == pytest.approx(angle, rel=5e-15, abs=1e-15)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(
    ("term", "energy"),
    [
        ("ks", "stretching"),
        ("kb", "bending"),
        ("kv", "volume"),
        ("kal", "local_area"),
        ("kag", "global_area"),
    ],
)
def test_force_is_minus_the_gradient_of_the_energy(term, energy, seed):
    """That of the area terms where they are isotropic."""
    _, membrane, x, v = random_state(seed, frequency=2)
    moduli = only(term)._replace(isotropic=term in ("kal", "kag"))
    step, gradient = 1e-5, np.empty_like(x)
    for i in np.ndindex(x.shape):
        at = []
        for sign in (1, -1):
            y = x.copy()
            y[i] += sign * step
            at.append(getattr(mb.energies(y, membrane, moduli), energy))
        gradient[i] = (at[0] - at[1]) / (2 * step)
    got = forces(x, v, membrane, moduli)
    np.testing.assert_allclose(got, -gradient, rtol=0, atol=1e-7 * np.abs(got).max())


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(("term", "energy"), [("kal", "local_area"), ("kag", "global_area")])
def test_work_of_area_forces_under_dilation_is_their_energy(term, energy, seed):
    _, membrane, x, v = random_state(seed)
    step, at = 1e-5, []
    for sign in (1, -1):
        at.append(getattr(mb.energies((1 + sign * step) * x, membrane, only(term)), energy))
    work = np.sum(x * forces(x, v, membrane, only(term)))
    assert work == pytest.approx(-(at[0] - at[1]) / (2 * step), rel=1e-7)


@pytest.mark.parametrize("term", TERMS)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_no_net_force_and_no_net_torque(term, seed):
    _, membrane, x, v = random_state(seed, frequency=4)
    x += 50
    force = forces(x, v, membrane, only(term))
    scale = np.abs(force).sum()
    assert scale > 0
    np.testing.assert_allclose(force.sum(axis=0), 0, atol=1e-13 * scale)
    np.testing.assert_allclose(np.cross(x - 50, force).sum(axis=0), 0, atol=1e-12 * scale)


@pytest.mark.parametrize("term", TERMS)
def test_forces_turn_and_travel_with_the_membrane(term):
    rng = np.random.default_rng(5)
    _, membrane, x, v = random_state(5)
    turn, shift = random_rotation(rng), rng.normal(size=3)
    force = forces(x, v, membrane, only(term))
    moved = forces(x @ turn.T + shift, v @ turn.T, membrane, only(term))
    np.testing.assert_allclose(moved, force @ turn.T, rtol=0, atol=1e-12 * np.abs(force).max())


@pytest.mark.parametrize("height", [1e-2, 1e-4, 1e-8, -1e-4])
def test_bending_of_a_vanishing_face_is_bounded(height):
    """A vertex that crosses the opposite side turns the face over within one step."""
    x, faces = mesh.make_shape("sphere", 1.0, 2)
    membrane = mb.make_membrane(x, faces)
    a, b, c = faces[0]
    middle, inwards = (x[b] + x[c]) / 2, x[a] - (x[b] + x[c]) / 2
    side = np.linalg.norm(x[c] - x[b])
    x[a] = middle + height * inwards
    force = forces(x, np.zeros_like(x), membrane, only("kb"))
    # At most six faces of at least the height that is let go pull at a vertex, by angles up to 2π.
    assert np.abs(force).max() < 6 * 2 * np.pi / (membrane_forces.VANISHING * np.sqrt(3) / 2 * side)
    np.testing.assert_allclose(force.sum(axis=0), 0, atol=1e-12)
    np.testing.assert_allclose(np.cross(x, force).sum(axis=0), 0, atol=1e-12)


def test_energies_do_not_change_under_rigid_motion():
    rng = np.random.default_rng(6)
    _, membrane, x, _ = random_state(6)
    moduli = mb.Moduli(*[1.0] * 6)
    moved = x @ random_rotation(rng).T + rng.normal(size=3)
    np.testing.assert_allclose(
        mb.energies(moved, membrane, moduli), mb.energies(x, membrane, moduli), rtol=1e-11
    )


@pytest.mark.parametrize("shape", ["biconcave", "sphere", "ellipsoid"])
def test_no_force_and_no_energy_at_rest(shape):
    x0, membrane, _, _ = random_state(0, frequency=5, shape=shape)
    moduli = mb.Moduli(*[1.0] * 6)
    assert np.abs(forces(x0, np.zeros_like(x0), membrane, moduli)).max() < 1e-13
    np.testing.assert_allclose(mb.energies(x0, membrane, moduli), 0, atol=1e-12)


def test_rigid_motion_is_not_damped():
    _, membrane, x, _ = random_state(7)
    v = np.array([0.3, -0.2, 0.9]) + np.cross([1.0, 2.0, -0.5], x)
    assert np.abs(forces(x, v, membrane, only("kvisc"))).max() < 1e-14


def test_viscous_forces_dissipate():
    _, membrane, x, v = random_state(8)
    assert np.sum(v * forces(x, v, membrane, only("kvisc"))) < 0


def test_terms_add_up():
    _, membrane, x, v = random_state(9)
    total = sum(forces(x, v, membrane, only(term, value)) for term, value in PARAMETERS.items())
    got = forces(x, v, membrane, mb.Moduli(**PARAMETERS))
    np.testing.assert_allclose(got, total, rtol=0, atol=1e-14 * np.abs(total).max())


def test_zero_moduli_give_zero_force():
    _, membrane, x, v = random_state(10)
    assert not forces(x, v, membrane, ZERO).any()


def sphere_energy(strain, moduli):
    """Energy of a unit sphere under the small linear deformation 1 + strain, over strain²."""
    x0, faces = mesh.icosphere(16)
    membrane = mb.make_membrane(x0, faces)
    return sum(mb.energies(x0 + x0 @ strain, membrane, moduli)), membrane.rest_area


@pytest.mark.parametrize("term", ["ks", "kal", "kag"])
def test_area_modulus_is_that_of_the_network(term):
    energy, area = sphere_energy(1e-4 * np.eye(3), only(term))
    moduli = {"ks": 0.0, "kal": 0.0, "kag": 0.0, term: 1.0}
    assert energy == pytest.approx(laws.area_modulus(**moduli) / 2 * 2e-4**2 * area, rel=0.01)


def test_shear_modulus_is_that_of_the_network():
    """A sphere under diag(ε, −ε, 0) with W = K/2 (tr e)² + G |dev e|² in its tangent planes.

    Over the sphere the means are ⟨(tr e)²⟩ = 4/15 ε² and ⟨e:e⟩ = 14/15 ε².
    """
    eps = 1e-4
    energy, area = sphere_energy(eps * np.diag([1.0, -1.0, 0.0]), only("ks"))
    trace2, square = 4 / 15 * eps**2, 14 / 15 * eps**2
    expected = laws.area_modulus(1.0, 0, 0) / 2 * trace2
    expected += mb.shear_modulus(1.0) * (square - trace2 / 2)
    assert energy == pytest.approx(expected * area, rel=0.01)


@pytest.mark.parametrize("isotropic", [False, True])
@pytest.mark.parametrize("term", ["kal", "kag"])
def test_area_terms_pull_along_the_stretch(term, isotropic):
    """The tension of a face stretched to λ₁, λ₂ is 2σ λ²/(λ₁² + λ₂²) along each, σ the mean.

    That resists shear with σ, beside the springs' G. Where it is isotropic, as a fluid membrane's,
    it is σ along both.
    """
    x0, faces = mesh.icosphere(1)  # all faces are equilateral
    membrane = mb.make_membrane(x0, faces)
    x = x0 @ np.diag([1.6, 0.8, 1.0])
    scratch = mb.make_scratch(membrane)
    moduli = only(term)._replace(isotropic=isotropic)
    membrane_forces.elastic_forces(x, 0 * x, membrane, moduli, scratch, np.empty_like(x))
    growth = mesh.area(x, faces) / membrane.rest_area - 1
    for f, corners in enumerate(faces):
        force = np.stack([row[3 * f : 3 * f + 3] for row in scratch.corners], axis=1)
        a, b, c = x[corners]
        area = np.linalg.norm(np.cross(b - a, c - a)) / 2
        sides, rest = (
            np.stack([y[1] - y[0], y[2] - y[0]], axis=1) for y in (x[corners], x0[corners])
        )
        squares = np.linalg.svd(sides @ np.linalg.pinv(rest))[1][:2] ** 2
        mean = (area - membrane.rest_areas[f]) / area / 2 if term == "kal" else growth / 2
        tension = np.linalg.eigvalsh(-(x[corners] - a).T @ force / area)
        tension = sorted(tension, key=abs)[1:]
        expected = [mean, mean] if isotropic else sorted(2 * mean * squares / squares.sum())
        assert sorted(tension) == pytest.approx(expected)


def test_bending_modulus_is_that_of_the_network_on_a_cylinder():
    n = 100
    edge = 2 * np.sin(np.pi / n)
    pitch = np.sqrt(edge**2 - (2 * np.sin(np.pi / n / 2)) ** 2)

    def point(row, column):
        phase = 2 * np.pi / n * (column + row / 2)
        return np.array([np.cos(phase), np.sin(phase), pitch * row])

    ring = (point(0, 0), point(0, 1), point(1, 0), point(-1, 1))
    right = (point(0, 0), point(1, 0), point(1, -1), point(0, 1))
    left = (point(0, 0), point(1, -1), point(0, -1), point(1, 0))
    energy = 0.5 * sum(naive.dihedral(*hinge) ** 2 for hinge in (ring, right, left))
    area = 3**0.5 / 2 * edge**2
    assert energy == pytest.approx(mb.bending_modulus(1.0) / 2 * area, rel=0.002)


def test_bending_energy_of_a_sphere_with_flat_rest_angles():
    x, faces = mesh.icosphere(16)
    membrane = mb.make_membrane(x, faces)
    flat = membrane._replace(rest_angles=np.zeros_like(membrane.rest_angles))
    assert mb.energies(x, flat, only("kb")).bending == pytest.approx(4 * np.pi / 3**0.5, rel=0.04)


def relax(x0, membrane, moduli, pull):
    """Damped motion from rest to the equilibrium under the forces `pull` (V, 3)."""
    x, v, force = x0.copy(), np.zeros_like(x0), np.empty_like(x0)
    scratch = mb.make_scratch(membrane)
    for _ in range(2800):
        membrane_forces.elastic_forces(x, v, membrane, moduli, scratch, force)
        v = 0.99 * (v + force + pull)
        x += v
    assert np.abs(force + pull).max() < 1e-8
    return x


@pytest.mark.parametrize("row", [1, 4])
def test_static_stretching_equals_that_of_espresso(row, reference_membrane):
    with (REFERENCE / "stretching.csv").open() as lines:
        expected = {
            key: float(value) for key, value in list(csv.DictReader(lines))[row].items() if value
        }
    patches = json.loads((REFERENCE / "stretching_patches.json").read_text())
    x0, membrane = reference_membrane
    pull = np.zeros_like(x0)
    pull[patches["hi"], 0] = expected["F_nN"] / len(patches["hi"])
    pull[patches["lo"], 0] = -expected["F_nN"] / len(patches["lo"])
    x = relax(x0, membrane, mb.Moduli(**(PARAMETERS | {"kvisc": 0.0})), pull)
    extents = [expected[key] for key in ("axial", "transverse", "thickness")]
    np.testing.assert_allclose(np.ptp(x, axis=0), extents, rtol=1e-5)
    area, volume = mesh.area(x, membrane.faces), mesh.volume(x, membrane.faces)
    assert area / membrane.rest_area == pytest.approx(expected["A_rel"], abs=1e-7)
    assert volume / membrane.rest_volume == pytest.approx(expected["V_rel"], abs=1e-7)


def test_inward_faces_are_refused():
    x, faces = mesh.icosphere(2)
    with pytest.raises(DldsimError, match="inward"):
        mb.make_membrane(x, faces[:, ::-1])
