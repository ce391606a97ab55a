"""What is seen of a cell, against shapes whose answers are known, and what counts as trouble."""

import re

import numpy as np
import pytest

from dldsim.solver.membrane import make_membrane, make_scratch
from dldsim.solver.membrane_forces import measure_faces
from dldsim.solver.mesh import make_shape
from dldsim.solver.observe import Sample, centroid, deformation_index, fastest, inverted_faces


def sample_at(x, step, **values):
    """A sound sample with its centre at x, but for the values given."""
    rest = {
        "velocity": np.zeros(3),
        "extent": np.ones(3),
        "volume_ratio": 1.0,
        "area_ratio": 1.0,
        "clearance": 1.0,
        "speed_max": 0.01,
        "mean_velocity": np.zeros(2),
    }
    return Sample(**{"step": step, "centre": np.array([x, 0.3, 0.0]), **rest, **values})


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"speed_max": np.nan}, "not finite"),
        ({"volume_ratio": np.inf}, "not finite"),
        ({"centre": np.array([0, np.nan, 0])}, "not finite"),
        ({"speed_max": 0.36}, "speed 0.36 exceeds 0.35"),
        ({"clearance": -1.1}, "1.1 nodes inside a solid"),
        ({"volume_ratio": 0.79}, "volume drifted by -21%"),
        ({"area_ratio": 1.51}, "area drifted by [+]51%"),
        ({"inverted": 0.06}, "6% of the membrane's faces are inverted"),
    ],
)
def test_what_counts_as_trouble(values, reason):
    assert re.search(reason, sample_at(0.0, 0, **values).trouble() or "")


def test_what_does_not():
    edge = {"speed_max": 0.34, "clearance": -0.9, "volume_ratio": 1.19, "area_ratio": 0.51}
    assert sample_at(0.0, 0).trouble() is None
    assert sample_at(0.0, 0, inverted=0.049, **edge).trouble() is None


def test_the_centroid_is_that_of_the_volume_not_of_the_vertices():
    x, faces = make_shape("sphere", 3.0, 6)
    centre = np.zeros(3)
    x += [5.0, -2.0, 1.0]
    centroid(x, faces, centre)
    np.testing.assert_allclose(centre, [5.0, -2.0, 1.0], atol=1e-12)
    # Half a ball, its flat side through the centre: 3/8 of the radius, less the mesh's facets.
    half = np.where(x[:, :1] > 5.0, x, [5.0, 0.0, 0.0] + x * [0.0, 1.0, 1.0])
    centroid(half, faces, centre)
    assert centre[0] - 5.0 == pytest.approx(3 / 8 * 3.0, rel=0.05)
    assert half[:, 0].mean() - 5.0 < 0.9 * (centre[0] - 5.0)


def test_the_fastest_node_is_found_and_nothing_beyond_the_fluid():
    velocity = np.zeros(3 * 8)
    velocity[[2, 10, 18]] = 0.1, 0.2, 0.2  # of node 2
    velocity[7] = 9.0  # no fluid
    assert fastest(velocity, 7) == pytest.approx(0.3)
    velocity[11] = np.nan
    assert np.isnan(fastest(velocity, 7))


def test_a_face_is_inverted_that_is_turned_against_all_its_neighbours():
    x, faces = make_shape("sphere", 3.0, 5)
    membrane = make_membrane(x, faces)
    scratch = make_scratch(membrane)
    measure_faces(x, scratch)
    assert inverted_faces(scratch.normals, membrane) == 0
    for normal in scratch.normals:
        normal[7] *= -1
    assert inverted_faces(scratch.normals, membrane) == 1
    # Two that are turned together stand with each other: a fold.
    pair = membrane.edge_faces[membrane.face_edges[7, 0]]
    for normal in scratch.normals:
        normal[pair.sum() - 7] *= -1
    assert inverted_faces(scratch.normals, membrane) == 0


def test_deformation_index_does_not_care_which_axis_is_longer():
    for extents in ((4.0, 2.0), (2.0, 4.0)):
        assert deformation_index(*extents) == (pytest.approx(1 / 3), 4.0, 2.0)
