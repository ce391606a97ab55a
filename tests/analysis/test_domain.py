"""Where a surrogate interpolates: hull of arrays, ranges of Ca and height."""

import json
from itertools import product

import numpy as np
import pytest

from dldsim.analysis import domain
from dldsim.analysis.domain import DOMAIN_TOLERANCE, Domain
from tests.analysis.made_outcomes import cell, make_outcomes, make_survey


@pytest.fixture(scope="module")
def box():
    """P_r 5 to 10, P_g 14 to 22, N_p 4 to 10, in radii of 7.5 µm."""
    return Domain.of(make_outcomes())


def test_inside_and_on_the_hull_the_distance_is_zero(box):
    corners = np.array(list(product((5.0, 10.0), (14.0, 22.0), (4, 10))))
    middle = corners.mean(axis=0)
    points = np.vstack([middle, corners, (corners + middle) / 2])
    assert box.distance_outside(*points.T, cell()) == pytest.approx(0, abs=1e-9)


def test_distance_is_in_units_of_the_ranges(box):
    far = box.distance_outside([12.5, 7, 10.1], [18, 26, 18], [6, 6, 6], cell())
    assert far == pytest.approx([0.5, 0.5, 0.02])
    # the same array is another one to a smaller cell
    assert box.distance_outside(10, 22, 6, cell(radius_um=5.0))[0] > 0.5


def test_distance_is_that_of_the_facet_exceeded_most():
    """An octahedron: beyond a face by s, the largest component of the way back is s/3."""
    centre, half = np.array([2.0, 3.0, 8.0]), np.array([0.5, 0.5, 4.0])
    tips = centre + np.vstack([np.diag(half), -np.diag(half)])
    octahedron = Domain(tips, (0.1, 0.2), (0.5, 0.6))
    [found] = octahedron.distance_outside(*(7.5 * tips[0][:2] + 0.75), 8.0, cell())
    beyond = 0.1 / 1.0 + 0.1 / 1.0  # P_r/R and P_g/R 0.1 further out, of ranges of 1
    assert found == pytest.approx(beyond / 3)


def test_tied_gap_and_radius_fill_a_plane_and_not_a_box():
    outcomes = make_outcomes(gaps=(15.0, 17.5, 20.0))
    tied = Domain.of(outcomes[outcomes["gap_um"] == outcomes["pillar_radius_um"] + 10])
    assert tied.distance_outside(6, 16, 5, cell())[0] == pytest.approx(0, abs=1e-9)
    assert tied.distance_outside(5.5, 19.5, 5, cell())[0] > 0.3


def test_what_never_varied_allows_no_distance():
    fixed = Domain.of(make_outcomes(gaps=(18.0,)))
    assert fixed.distance_outside(6, [18, 19], 5, cell()).tolist() == [0, np.inf]
    point = Domain.of(make_outcomes(radii=(5.0,), gaps=(18.0,), rows=(6,)))
    assert point.distance_outside(5, 18, [6, 7], cell()).tolist() == [0, np.inf]
    line = Domain.of(make_outcomes(radii=(5.0,), gaps=(18.0,)))
    assert line.distance_outside(5, 18, [4, 7, 16], cell()) == pytest.approx([0, 0, 1])


def test_ca_and_height_have_ranges(box):
    assert box.holds(cell([0.0368, 0.0369, 0.1, 0.147, 0.2])).tolist() == [1, 1, 1, 1, 0]
    assert box.holds(cell(height_um=20.0))[0] and not box.holds(cell(height_um=21.0))[0]
    # height/R counts, not the height
    assert box.holds(cell(radius_um=15.0, height_um=40.0))[0]
    assert not box.holds(cell(height_um=0.0))[0]


def test_ranges_are_told_in_words(box):
    assert box.words == "Ca 0.0369 to 0.147, height/R 2.67"
    flat = Domain(box.geometries, box.capillary_number, (0.0, 0.0))
    assert flat.words.endswith("no top or bottom")
    survey = make_survey()
    text = domain.learnt({k: v.state() for k, v in domain.domains_of(survey).items()})
    assert text.startswith("biconcave discs (Ca 0.02") and "; spheres (Ca 0.01" in text


def test_numbers_make_a_domain_again():
    known = domain.domains_of(make_survey())
    text = json.dumps({shape: own.state() for shape, own in known.items()})
    again = domain.from_state(json.loads(text))
    rng = np.random.default_rng(1)
    at = rng.uniform(3, 14, 50), rng.uniform(8, 25, 50), rng.integers(3, 16, 50), cell()
    for shape, own in known.items():
        found = own.distance_outside(*at)
        assert np.array_equal(found, again[shape].distance_outside(*at))
        assert 0 < (found <= DOMAIN_TOLERANCE).sum() < 50
