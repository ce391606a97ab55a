"""Streamlines of the empty array, as a point-like follower takes them."""

import pytest

from dldsim.config.sections import Flow, Geometry, Numerics
from dldsim.evidence.reference import read_reference
from dldsim.experiments.streamlines import critical_follower
from dldsim.solver.flow import solve_empty_array

GAP_UM = 20.0


def flow_of(periodicity, height_um=0.0, nodes=40, **numerics):
    geometry = Geometry(pillar_radius_um=GAP_UM / 2, gap_um=GAP_UM, periodicity=periodicity)
    flow = Flow(mean_velocity_mm_s=1.0, height_um=height_um)
    spacing = geometry.pitch_um / nodes
    chosen = Numerics(spacing_um=spacing, velocity_lu=0.003, **numerics)
    return solve_empty_array(geometry, flow, chosen)


def follower(*array, **numerics):
    return critical_follower(flow_of(*array, **numerics))


@pytest.mark.parametrize("periodicity", [4, 10])
def test_in_the_plane_it_is_twice_the_first_lane(periodicity):
    [known] = [
        row["critical_diameter_over_gap_streamline"]
        for row in read_reference("first_lane_width_2d")
        if row["radius_over_pitch"] == 0.25 and row["periodicity"] == periodicity
    ]
    assert follower(periodicity) == pytest.approx(known, rel=0.01)


def test_a_streamline_that_begins_at_rest_passes_nothing():
    """On the pillar, where the first node in the gap is solid."""
    geometry = Geometry(pillar_radius_um=12.5, gap_um=15.0, periodicity=8)
    flow = Flow(mean_velocity_mm_s=1.0, height_um=0.0)
    found = solve_empty_array(geometry, flow, Numerics(spacing_um=1.0, velocity_lu=0.003))
    assert critical_follower(found) == pytest.approx(0.43, abs=0.02)


@pytest.mark.filterwarnings("error")
def test_a_pillar_of_a_node_in_radius_has_one_at_its_centre():
    geometry = Geometry(pillar_radius_um=1.0, gap_um=13.0, periodicity=5)
    flow = Flow(mean_velocity_mm_s=1.0, height_um=0.0)
    found = solve_empty_array(geometry, flow, Numerics(spacing_um=1.0, velocity_lu=0.003))
    assert 0.2 < critical_follower(found) < 0.7


def test_it_is_smaller_in_a_lower_channel_and_its_own_in_half_a_scene():
    deep, low = follower(10), follower(10, GAP_UM)
    assert low == pytest.approx(0.91 * deep, rel=0.01)
    whole = follower(10, GAP_UM, half_scene=False)
    assert whole == pytest.approx(low, rel=2e-3)


def test_the_lane_widens_towards_top_and_bottom():
    half, whole = (flow_of(10, GAP_UM, half_scene=chosen) for chosen in (True, False))
    at = {height: critical_follower(half, height) for height in (0.1, 0.25, 0.5)}
    assert 1.1 * at[0.5] < at[0.1] and 1.03 * at[0.5] < at[0.25] < 1.07 * at[0.5]
    for height, diameter in at.items():
        for mirrored in (height, 1 - height):
            assert critical_follower(whole, mirrored) == pytest.approx(diameter, rel=0.01)
