"""Searches for critical gaps: their plan, their steps, their results."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dldsim.config.study_sections import CriticalGap
from dldsim.evidence import critical_gaps
from dldsim.evidence.critical_gaps import REYNOLDS, SPACING, SPHERE, Search, Start
from dldsim.evidence.reference_study import CAMPAIGN
from dldsim.laws import whole_shift_spacing

BRACKET = (15.0, 21.0)
SEARCH = Search(8.0, 10, "1")


def point(gap, distance, side=None):
    side = side if side is not None else (1 if distance > 0 else -1)
    return {"gap_um": gap, "transition_distance": distance, "side": side}


def search(distance, start=None, bracket=BRACKET, known=True):
    """Points of a search on a made-up distance over the gap, to its end."""
    points = []
    while (gap := critical_gaps.next_gap(points, bracket, start)) is not None:
        d = distance(gap)
        points.append(point(gap, d if known else None, 1 if d > 0 else -1))
        assert len(points) < 40
    return points


def test_search_identifiers_are_their_own_inverse(config):
    import re

    for one in critical_gaps.searches(config):
        text = critical_gaps.search_id(one)
        assert critical_gaps.parse_search(text) == one
        assert re.fullmatch(critical_gaps.SEARCH_PATTERN, text)


def test_each_transition_is_searched_at_each_value_once(config):
    found = [s for s in critical_gaps.searches(config) if s[:3] == SEARCH[:3]]
    assert [(s.knob, s.rank) for s in found] == [
        (CAMPAIGN, 0),
        (SPACING, 1),
        (SPACING, 2),
        (REYNOLDS, 0),
        (REYNOLDS, 2),
    ]
    spheres = [s for s in critical_gaps.searches(config) if s.stiffness_set == SPHERE]
    assert {s.periodicity for s in spheres} == {5, 10, 16}


def test_one_setting_at_a_time(config):
    own = critical_gaps.search_settings(SEARCH, config)
    assert own["numerics"] == config.numerics.model_dump(mode="json")
    finer = critical_gaps.search_settings(SEARCH._replace(knob=SPACING, rank=2), config)
    assert finer == own | {"numerics": own["numerics"] | {"spacing_um": 0.63}}


def test_a_bracket_has_the_smaller_gap_first():
    with pytest.raises(ValueError, match="smaller gap"):
        CriticalGap(pillar_radius_um=8, periodicity=10, stiffness_set="1", bracket_um=(20, 15))


def test_spheres_are_searched_about_the_law(config):
    """D_c = 1.4 G ε^0.48 at each of the gaps' arrays lies inside the bracket, P_r = G/2."""
    for gap in critical_gaps.transitions(config.reference):
        if gap.stiffness_set != SPHERE:
            continue
        expected = (
            2 * config.reference.critical_diameters.radius_um / (1.4 * gap.periodicity**-0.48)
        )
        assert gap.bracket_um[0] < expected < gap.bracket_um[1]
        assert gap.pillar_radius_um == pytest.approx(expected / 2, abs=0.05)


@given(st.floats(15, 21), st.sampled_from([1.25, 0.9, 0.63]))
def test_nodes_per_row_shift_are_held_within_a_search(gap, spacing):
    """The spacing then stays in proportion to the pitch, which it does not by itself."""
    settings = {"bracket_um": BRACKET, "numerics": {"spacing_um": spacing, "kernel": "compact"}}
    array = critical_gaps._array(SEARCH, gap)
    numerics = critical_gaps.held_numerics(SEARCH, gap, settings)
    actual, nodes = whole_shift_spacing(array, numerics["spacing_um"])
    middle, wanted = whole_shift_spacing(critical_gaps._array(SEARCH, 18.0), spacing)
    assert nodes == wanted and numerics["kernel"] == "compact"
    assert actual / array.pitch_um == pytest.approx(middle / 34.0)


def test_every_spacing_of_the_default_plan_is_another_lattice(config):
    """Nodes per row shift in the middle of each bracket rise from spacing to spacing."""
    for gap in critical_gaps.transitions(config.reference):
        array = critical_gaps._array(
            Search(gap.pillar_radius_um, gap.periodicity, gap.stiffness_set),
            sum(gap.bracket_um) / 2,
        )
        nodes = [whole_shift_spacing(array, h)[1] for h in config.reference.spacings_um]
        assert nodes[0] < nodes[1] < nodes[2]


def test_nodes_would_change_within_the_bracket_if_they_were_not_held():
    nodes = {
        whole_shift_spacing(critical_gaps._array(SEARCH, g), 0.63)[1] for g in (15.0, 18.0, 21.0)
    }
    assert len(nodes) > 1


# ----------------------------------------------------------------------------------------- search

SHAPES = {
    "line": lambda g, root: 0.1 * (root - g),
    "saturating": lambda g, root: 0.3 * math.tanh((root - g) / 0.7),
    "steep at the root": lambda g, root: math.copysign(abs(root - g) ** 0.3, root - g),
    "flat at the root": lambda g, root: (root - g) ** 3,
    "lopsided": lambda g, root: 0.02 * (root - g) if g < root else 2.0 * (root - g),
    "jump": lambda g, root: 0.05 if g < root else -0.6,
}


@pytest.mark.parametrize("shape", SHAPES)
@given(root=st.floats(15.05, 20.9))
def test_a_search_closes_its_bracket_over_the_root(shape, root):
    points = search(lambda g: SHAPES[shape](g, root))
    low, high = critical_gaps.ends(points)
    assert low["gap_um"] <= root <= high["gap_um"]
    assert critical_gaps.closed(low, high)
    assert high["gap_um"] - low["gap_um"] <= critical_gaps.TOLERANCE * high["gap_um"]


@pytest.mark.parametrize("shape", SHAPES)
def test_a_search_takes_at_most_one_point_more_than_bisection(shape):
    """Two ends, six halvings from 6 µm to below 1 % of 15 µm, and one; four on a line."""
    counts = [
        len(search(lambda g, r=root: SHAPES[shape](g, r)))
        for root in (15.1, 15.3, 16.2, 17.5, 18.9, 20.2, 20.8)
    ]
    assert max(counts) <= 2 + 6 + 1 <= critical_gaps.POINTS
    if shape == "line":
        assert max(counts) == 4


def test_a_start_saves_the_ends_of_the_bracket():
    """Four points or fewer where another search has come within a tenth of a bracket."""
    root = 18.2
    cold = search(lambda g: SHAPES["saturating"](g, root))
    warm = search(lambda g: SHAPES["saturating"](g, root), Start(17.8, -0.3 / 0.7))
    assert len(warm) <= 4 < len(cold)
    low, high = critical_gaps.ends(warm)
    assert low["gap_um"] <= root <= high["gap_um"] and critical_gaps.closed(low, high)


@given(st.floats(15.05, 20.9), st.floats(15.0, 21.0), st.sampled_from([None, -0.1, -3.0]))
def test_a_start_anywhere_finds_the_root(root, start, slope):
    points = search(lambda g: SHAPES["saturating"](g, root), Start(round(start, 3), slope))
    low, high = critical_gaps.ends(points)
    assert low["gap_um"] <= root <= high["gap_um"] and critical_gaps.closed(low, high)
    assert all(BRACKET[0] <= p["gap_um"] <= BRACKET[1] for p in points)


def test_without_distances_a_search_bisects():
    points = search(lambda g: 17.1 - g, known=False)
    assert [p["gap_um"] for p in points[:4]] == [15.0, 21.0, 18.0, 16.5]


@pytest.mark.parametrize(("root", "gaps"), [(30.0, [15.0, 21.0]), (10.0, [15.0])])
def test_a_bracket_without_transition_ends_the_search(root, gaps):
    assert [p["gap_um"] for p in search(lambda g: root - g)] == gaps


def test_an_unknown_side_ends_the_search():
    assert critical_gaps.next_gap([point(15.0, None, 0)], BRACKET) is None


def outcome(distance=None, mode="none", status="decided"):
    return {
        "transition_distance": distance,
        "mode": mode,
        "status": status,
        "spacing_um": 1.15,
        "migration_angle_deg": 5.0,
        "lag_number": 0.14,
        "releases": 2,
        "wall_time_s": 30.0,
    }


@pytest.mark.parametrize(
    ("row", "side"),
    [
        (outcome(0.1, "mixed"), -1),
        (outcome(None, "bump"), 1),
        (outcome(-0.1, "zigzag"), -1),
        (outcome(0.1, "mixed", "undecided"), 1),
        (outcome(-0.1, "bump", "coexisting"), -1),
        (outcome(None, "bump", "undecided"), 1),
        (outcome(None, "mixed", "undecided"), -1),
        (outcome(None, "none", "stuck"), 0),
        (outcome(0.1, "none", "undecided"), 0),
    ],
)
def test_the_side_is_told_by_the_mode_once_decided_else_by_the_distance(row, side):
    assert critical_gaps.side_of(row) == side


def found(simulate, one=SEARCH, config=None, start=None):
    """Points and row of a search on a made-up simulation."""
    settings = critical_gaps.search_settings(one, config)
    points = []
    for _ in range(critical_gaps.POINTS):
        points = critical_gaps.advance(one, points, settings, simulate, start)
    return points, critical_gaps.result(one, points, settings)


def test_a_search_interpolates_its_critical_gap(config):
    """A distance that is a line in the gap is met exactly; spacing and height are those there."""

    def simulate(array, numerics):
        spacing, _ = whole_shift_spacing(array, numerics["spacing_um"])
        distance = 0.1 * (17.43 - array.gap_um)
        return outcome(distance, "bump" if distance > 0 else "zigzag") | {"spacing_um": spacing}

    points, row = found(simulate, config=config)
    assert row["critical_gap_um"] == pytest.approx(17.43)
    assert row["low_um"] < 17.43 < row["high_um"] and row["note"] == ""
    assert row["spacing_um"] == pytest.approx((16 + 17.43) / 10 / 3)
    # The last jobs had nothing left to do.
    assert row["points"] == len(points) < critical_gaps.POINTS
    assert row["runs"] == 2 * len(points) and row["wall_time_s"] == 30.0 * len(points)
    again = critical_gaps.advance(
        SEARCH, points, critical_gaps.search_settings(SEARCH, config), simulate
    )
    assert again == points


def test_a_distance_at_odds_with_its_side_is_not_interpolated():
    low, high = point(17.0, -0.01, 1), point(17.1, -0.2)
    assert critical_gaps._root(low, high) == pytest.approx(17.05)
    assert critical_gaps.start_from([point(17.0, -0.3, 1), high]).slope is None


def test_outcomes_that_are_not_decided_are_counted(config):
    def simulate(array, _):
        return outcome(0.1 * (17.43 - array.gap_um), "mixed", "undecided")

    points, row = found(simulate, config=config)
    assert row["critical_gap_um"] == pytest.approx(17.43)
    assert row["note"] == f"{len(points)} of {len(points)} outcomes are not decided"


def test_a_search_that_breaks_says_where(config):
    def simulate(array, _):
        broken = array.gap_um > 18
        return outcome(None, status="unstable") if broken else outcome(0.1, "bump")

    _, row = found(simulate, config=config)
    assert row["critical_gap_um"] is None and "21 µm the outcome is unstable" in row["note"]


def test_a_bracket_without_transition_is_said(config):
    _, row = found(lambda *_: outcome(0.2, "bump"), config=config)
    assert row["critical_gap_um"] is None and "all of the gaps 15, 21 µm bump" in row["note"]


def test_another_search_starts_where_one_ended(config):
    points = [point(17.0, 0.05), point(17.4, -0.15)]
    start = critical_gaps.start_from(points)
    assert start.gap_um == pytest.approx(17.1) and start.slope == pytest.approx(-0.5)
    assert critical_gaps.start_from([point(17.0, 0.05)]) is None
