"""Laws of the meshes: counts, closure, orientation, shape."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dldsim.errors import DldsimError
from dldsim.solver import mesh


def edge_lengths(vertices, faces):
    a, b = mesh.make_topology(faces).edges.T
    return np.linalg.norm(vertices[a] - vertices[b], axis=1)


@pytest.mark.parametrize("n", [1, 2, 3, 5, 8, 14])
def test_icosphere_counts_and_orientation(n):
    vertices, faces = mesh.icosphere(n)
    topology = mesh.make_topology(faces)
    assert vertices.shape == (10 * n * n + 2, 3)
    assert faces.shape == (2 * len(vertices) - 4, 3) and faces.dtype == np.int32
    assert topology.edges.shape == (3 * len(vertices) - 6, 2)
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 1, rtol=1e-15)
    centres = vertices[faces].mean(axis=1)
    assert np.all(np.sum(centres * mesh.area_vectors(vertices, faces), axis=1) > 0)


def test_icosphere_edges_are_nearly_equal():
    vertices, faces = mesh.icosphere(14)
    lengths = edge_lengths(vertices, faces)
    assert lengths.min() > 0.91 * lengths.mean() and lengths.max() < 1.09 * lengths.mean()


def test_icosphere_converges_to_the_sphere():
    deficit = [1 - mesh.volume(*mesh.icosphere(n)) / (4 / 3 * np.pi) for n in (7, 14)]
    assert deficit[0] / deficit[1] == pytest.approx(4, rel=0.02)


def test_icosphere_is_reproducible():
    first, second = mesh.icosphere(6), mesh.icosphere(6)
    assert all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))


def test_icosphere_has_the_mirror_planes_of_the_coordinates():
    vertices, _ = mesh.icosphere(5)
    known = {tuple(p) for p in np.round(vertices, 9) + 0.0}
    for mirror in np.array([[-1, 1, 1], [1, -1, 1], [1, 1, -1]]):
        assert {tuple(p) for p in np.round(vertices * mirror, 9) + 0.0} == known


def test_topology_joins_edges_and_faces_consistently():
    _, faces = mesh.icosphere(4)
    topology = mesh.make_topology(faces)
    assert np.all(topology.edges[:, 0] < topology.edges[:, 1])
    for e, (a, b) in enumerate(topology.edges):
        for start, end, f in zip((a, b), (b, a), topology.edge_faces[e], strict=True):
            k = list(faces[f]).index(start)
            assert faces[f, k - 2] == end
            assert topology.face_edges[f, k - 1] == e


@pytest.mark.parametrize("shape", ["biconcave", "sphere", "ellipsoid"])
@pytest.mark.parametrize("axis", "xyz")
def test_shapes_have_the_radius_and_axis_asked_for(shape, axis):
    vertices, faces = mesh.make_shape(shape, 7.5, 8, 0.6, axis)
    along = "xyz".index(axis)
    radial = np.linalg.norm(np.delete(vertices, along, axis=1), axis=1)
    assert radial.max() == pytest.approx(7.5, rel=1e-12)
    half = {"biconcave": 0.32809 * 7.5, "sphere": 7.5, "ellipsoid": 4.5}[shape]
    assert vertices[:, along].max() == pytest.approx(half, rel=2e-3)
    np.testing.assert_allclose(vertices.mean(axis=0), 0, atol=1e-13)
    assert mesh.volume(vertices, faces) > 0


def test_biconcave_vertices_lie_on_the_evans_fung_profile():
    vertices, faces = mesh.make_shape("biconcave", 3.91, 40)
    r2 = (vertices[:, 0] ** 2 + vertices[:, 1] ** 2) / 3.91**2
    profile = 3.91 / 2 * np.sqrt(np.clip(1 - r2, 0, 1))
    profile *= 0.207161 + 2.002558 * r2 - 1.122762 * r2**2
    np.testing.assert_allclose(np.abs(vertices[:, 2]), profile, atol=1e-7)
    # published for R = 3.91 µm: 94.1 µm³, 134.1 µm²; the inscribed mesh is 0.1 % smaller
    assert mesh.volume(vertices, faces) == pytest.approx(94.1, rel=0.003)
    assert mesh.area(vertices, faces) == pytest.approx(134.1, rel=0.002)


def test_biconcave_mesh_is_even():
    lengths = edge_lengths(*mesh.make_shape("biconcave", 7.5, 12))
    assert lengths.min() > 0.84 * lengths.mean() and lengths.std() < 0.1 * lengths.mean()


@given(st.integers(3, 25), st.sampled_from(["biconcave", "sphere", "ellipsoid"]))
@settings(max_examples=15, deadline=None)
def test_frequency_for_edge_inverts_the_mean_edge(n, shape):
    vertices, faces = mesh.make_shape(shape, 2.0, n, 0.6)
    mean = edge_lengths(vertices, faces).mean()
    assert mesh.frequency_for_edge(mesh.area(vertices, faces), mean) == n


def test_frequency_for_edge_takes_the_nearer_edge():
    assert mesh.frequency_for_edge(5 * 3**0.5, 0.76) == 1
    assert mesh.frequency_for_edge(5 * 3**0.5, 0.74) == 2
    assert mesh.frequency_for_edge(5 * 3**0.5, 100) == 1


def broken(kind):
    _, faces = mesh.icosphere(2)
    if kind == "hole":
        return faces[1:]
    if kind == "flipped face":
        faces[0] = faces[0, ::-1]
    if kind == "doubled":
        return np.vstack([faces, faces])
    if kind == "two spheres":
        return np.vstack([faces, faces + 42])
    if kind == "unused vertex":
        return faces + 1
    if kind == "collapsed face":
        faces[0, 1] = faces[0, 0]
    if kind == "quadrilaterals":
        return np.zeros((4, 4), dtype=int)
    return faces


@pytest.mark.parametrize(
    "kind",
    [
        "hole",
        "flipped face",
        "doubled",
        "two spheres",
        "unused vertex",
        "collapsed face",
        "quadrilaterals",
    ],
)
def test_surfaces_that_are_not_one_sphere_are_refused(kind):
    with pytest.raises(DldsimError):
        mesh.make_topology(broken(kind))


@pytest.mark.parametrize(
    "arguments",
    [
        ("cube", 1, 4),
        ("sphere", 0, 4),
        ("sphere", 1, 0),
        ("sphere", 1, 2.5),
        ("ellipsoid", 1, 4, -0.5),
        ("sphere", 1, 4, 1.0, "w"),
    ],
)
def test_impossible_shapes_are_refused(arguments):
    with pytest.raises(DldsimError):
        mesh.make_shape(*arguments)


def test_frequency_for_edge_refuses_sizes_that_are_not_positive():
    with pytest.raises(DldsimError):
        mesh.frequency_for_edge(10.0, 0.0)


# -------------------------------------------------------------------------------- another mesh


def rolled(n, angle):
    """A red cell whose membrane has moved along its contour by an angle, about y."""
    sphere, _ = mesh.icosphere(n)
    turn = np.array(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    )
    return mesh.revolve(sphere @ turn.T, [0.5 * c for c in mesh.EVANS_FUNG])


def at_rest(n):
    return mesh.make_shape("biconcave", 1.0, n)[0]


@given(st.lists(st.floats(-2, 2), min_size=12, max_size=12))
@settings(max_examples=10)
def test_affine_maps_of_the_shape_at_rest_are_resampled_exactly(numbers):
    shift, matrix = np.array(numbers[:3]), np.reshape(numbers[3:], (3, 3))
    found = mesh.resample(at_rest(5) @ matrix + shift, at_rest, 8)
    np.testing.assert_allclose(found, at_rest(8) @ matrix + shift, atol=1e-9)


def test_a_mesh_of_the_same_frequency_is_the_same():
    shape = rolled(6, 0.8)
    np.testing.assert_allclose(mesh.resample(shape, at_rest, 6), shape, atol=1e-9)


@pytest.mark.parametrize("angle", [0.3, np.pi / 2])
def test_a_membrane_that_has_moved_along_the_contour_is_resampled_smoothly(angle):
    errors = [
        np.abs(mesh.resample(rolled(n, angle), at_rest, 13) - rolled(13, angle)).max()
        for n in (5, 7, 10)
    ]
    assert errors[0] < 0.05 and errors[2] < errors[0] / 4
    _, faces = mesh.icosphere(13)
    resampled = mesh.resample(rolled(7, angle), at_rest, 13)
    assert mesh.volume(resampled, faces) == pytest.approx(
        mesh.volume(rolled(13, angle), faces), rel=3e-3
    )
    found, wanted = (edge_lengths(v, faces) for v in (resampled, rolled(13, angle)))
    assert np.abs(found / wanted - 1).max() < 0.1
