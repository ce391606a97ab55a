"""Identifiers are their own inverse."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dldsim.config import identifiers
from dldsim.config.sections import Geometry
from dldsim.errors import DldsimError

lengths = st.integers(1, 999_999).map(lambda n: n / 1000)
geometries = st.builds(
    Geometry, pillar_radius_um=lengths, gap_um=lengths, periodicity=st.integers(2, 100)
)
names = st.from_regex(r"[A-Za-z0-9-]+", fullmatch=True)
places = st.integers(0, 1000).map(lambda n: n / 1000)


@given(geometries, names, places)
def test_ids_are_their_own_inverse(geometry, name, place):
    pair = identifiers.Pair(geometry, name)
    outcome = identifiers.outcome_id(pair)
    assert identifiers.parse_outcome(outcome) == pair
    assert identifiers.parse_run(identifiers.run_id(outcome, place)) == (outcome, place)
    assert identifiers.parse_geometry(identifiers.geometry_id(geometry)) == geometry


@given(
    names,
    st.sampled_from(["biconcave", "sphere", "ellipsoid"]),
    st.integers(100, 100_000).map(lambda n: n / 1000),
    names,
)
def test_point_id_is_its_own_inverse(assay, shape, radius, membrane):
    point = identifiers.Point(assay, shape, radius, membrane)
    assert identifiers.parse_point(identifiers.point_id(point)) == point


@pytest.mark.parametrize("radius", [7.50001, 1 / 3])
def test_no_point_of_more_decimals_than_an_id_carries(radius):
    with pytest.raises(DldsimError, match="three decimals"):
        identifiers.point_id(identifiers.Point("gauge", "sphere", radius, "1"))


def test_ids_look_as_documented():
    pair = identifiers.Pair(Geometry(pillar_radius_um=6, gap_um=18, periodicity=8), "3")
    assert identifiers.outcome_id(pair) == "r06.0_g18.0_n08_s3"
    assert (
        identifiers.point_id(identifiers.Point("gauge", "sphere", 7.5, "3")) == "gauge_sphere-7.5_3"
    )
    assert identifiers.run_id("r06.0_g18.0_n08_s3", 0.5) == "r06.0_g18.0_n08_s3_y0.50"
    assert identifiers.run_id("r06.0_g18.0_n08_s3", 0.125) == "r06.0_g18.0_n08_s3_y0.125"


@given(st.lists(st.integers(1, 999).map(lambda n: n / 10), min_size=2, max_size=9))
def test_ids_sort_like_numbers(radii):
    def text(radius):
        return identifiers.geometry_id(Geometry(pillar_radius_um=radius, gap_um=20, periodicity=4))

    assert [text(r) for r in sorted(radii)] == sorted(text(r) for r in radii)


@pytest.mark.parametrize(
    "text", ["", "r6.0_g18.0_n08_s3", "r06.00_g18.0_n08_s3", "r06.0_g18.0_n08", "r06.0_g18.0_n08_s"]
)
def test_other_texts_are_no_ids(text):
    with pytest.raises(DldsimError, match="identifier"):
        identifiers.parse_outcome(text)
    with pytest.raises(DldsimError, match="identifier"):
        identifiers.parse_run(f"{text}_y0.50")


@pytest.mark.parametrize("place", ["", "_y", "_y0.5", "_y0.500", "_y1.50", "_y0.1234", "_y-0.50"])
def test_other_places_are_no_run_ids(place):
    with pytest.raises(DldsimError, match="identifier"):
        identifiers.parse_run(f"r06.0_g18.0_n08_s3{place}")


def test_id_refuses_what_it_cannot_carry():
    with pytest.raises(DldsimError, match="three decimals"):
        identifiers.geometry_id(Geometry(pillar_radius_um=6.0001, gap_um=18, periodicity=8))
    geometry = Geometry(pillar_radius_um=6, gap_um=18, periodicity=8)
    with pytest.raises(DldsimError, match="letters, digits"):
        identifiers.outcome_id(identifiers.Pair(geometry, "a/b"))
    for place in (0.1234, -0.1, 1.01):
        with pytest.raises(DldsimError, match="three decimals"):
            identifiers.run_id("r06.0_g18.0_n08_s3", place)
