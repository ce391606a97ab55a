"""Depth of the bump lane: which offsets are tried, and that it tells how far the transition is."""

import numpy as np
import pytest

from dldsim.config.sections import Cell, Geometry, RunControl
from dldsim.experiments import lane_depth
from dldsim.experiments.array_run import migration_of, simulate_run
from dldsim.experiments.lane_depth import FARTHEST, LOOKS, Probe, probe_lane, with_depth
from dldsim.experiments.migration import Migration
from dldsim.experiments.settling import LANE_ROWS, MAP_SCATTER
from dldsim.solver.observe import Sample
from tests.experiments.test_settled import COARSE, FLOW, SET_1


def tried(monkeypatch, one_row, **hopeful):
    """Probes in a lane that answers to an offset as ``one_row`` does."""
    monkeypatch.setattr(lane_depth, "_one_row", lambda scene, offset, *rest: one_row(offset))
    return probe_lane(None, 20.0, 5.0, 100.0, 2, **hopeful)


@pytest.mark.parametrize("edge", [0.0, 0.03, 0.07, 0.32, 0.5, 0.61, 0.79, 0.9])
def test_the_edge_of_the_lane_is_found_to_a_twentieth(monkeypatch, edge):
    probes = tried(monkeypatch, lambda z: Probe(z, 1 + 0.9 * z if z <= edge else None, steps=100))
    back = [probe.offset for probe in probes if probe.comes_back]
    assert probes[0].offset == FARTHEST and len(probes) <= 5
    assert 0 <= min(edge, FARTHEST) - max(back, default=0.0) <= 0.05 + 1e-9
    assert len(probes) == 1 or edge < FARTHEST  # the first is enough in a deep lane


def test_a_step_below_one_row_shift_is_no_way_back(monkeypatch):
    probes = tried(monkeypatch, lambda z: Probe(z, 1.2 if z < 0.25 else 0.9, 100))
    assert [probe.offset for probe in probes if probe.comes_back] == pytest.approx([0.2])


@pytest.mark.parametrize(
    ("edge", "slope", "looks"), [(0.9, 0.1, 1), (0.5, 1.0, 5), (0.5, 0.01, 5), (0.3, 2.0, LOOKS)]
)
def test_a_lane_that_lets_go_at_two_places_is_given_up(monkeypatch, edge, slope, looks):
    def answer(z):
        return Probe(z, 1 + slope * z if z <= edge else None, steps=100)

    assert len(tried(monkeypatch, answer, hopeful=False)) == looks
    assert len(tried(monkeypatch, answer)) == (1 if edge > FARTHEST else 5)


def test_depth_is_the_largest_step_seen():
    rests = Migration("converged", "rests", "bump", row_map_peak=1.01, transition_distance=0.01)
    assert with_depth(rests, []).transition_distance == pytest.approx(0.01)
    assert with_depth(rests, [1.3, -2.0]).transition_distance == pytest.approx(0.3)
    assert with_depth(rests, [1.3, -2.0]).row_map_peak == 1.3
    assert with_depth(rests, [-2.0]).row_map_peak == 1.01


@pytest.mark.parametrize(
    ("status", "mode", "lane"),
    [
        ("converged", "bump", True),
        ("stationary", "bump", True),
        ("undecided", "bump", False),
        ("periodic", "mixed", False),
        ("stuck", "none", False),
    ],
)
def test_only_what_has_settled_there_is_in_the_lane(status, mode, lane):
    assert Migration(status, "", mode).in_bump_lane == lane


# ------------------------------------------------------------------------------------- simulated


def sphere(gap, **options):
    return simulate_run(
        Geometry(pillar_radius_um=4, gap_um=gap, periodicity=6),
        SET_1,
        Cell(radius_um=4.0, shape="sphere"),
        FLOW,
        COARSE,
        RunControl(max_rows=20),
        run_id="r",
        stiffness_set="1",
        **options,
    ).row


def test_a_scene_stays_as_it_is_while_it_is_probed(monkeypatch):
    """The cell that a run leaves, and its last sample, are from before; probes cost steps."""
    seen = []

    def looking(scene, *about, **hopeful):
        before = scene.body.x.copy(), scene.fluid.f.copy(), scene.steps
        found = lane_probes(scene, *about, **hopeful)
        for mine, other in zip(before, (scene.body.x, scene.fluid.f, scene.steps), strict=True):
            np.testing.assert_array_equal(mine, other)
        seen.append((scene.steps, found))
        return found

    def counted(*given):
        return sum(probe.steps for _, probes in given for probe in probes)

    lane_probes = probe_lane
    monkeypatch.setattr("dldsim.experiments.array_run.probe_lane", looking)
    row = sphere(12.0)
    early, (steps, probes) = seen  # tried in vain as soon as it may be in the lane
    back = [probe for probe in probes if probe.comes_back]
    assert row["status"] == "converged" and 0 < len(back) < len(probes) == 5
    assert early[0] < steps and len(early[1]) == LOOKS
    assert row["probe_steps"] == [probe.step for probe in back]
    assert row["probe_offsets"] == [probe.offset for probe in back]
    assert row["steps"] == steps + counted(early, (steps, probes))
    assert row["transition_distance"] == pytest.approx(max(row["probe_steps"]) - 1)
    # What another release has found out is not tried again.
    again = sphere(12.0, others=[migration_of(row)])
    assert len(seen) == 2 and again["probe_steps"] == []
    assert again["transition_distance"] == pytest.approx(row["transition_distance"])
    # Nor where nobody asks.
    alone = sphere(12.0, probe=False)
    assert len(seen) == 2 and alone["transition_distance"] is None
    assert alone["steps"] == again["steps"] == steps


def test_a_cell_that_breaks_while_it_is_probed_does_not_come_back(monkeypatch):
    probing = []

    def looking(*about, **hopeful):
        probing.append(True)
        found = probe_lane(*about, **hopeful)
        probing.clear()
        return found

    monkeypatch.setattr("dldsim.experiments.array_run.probe_lane", looking)
    monkeypatch.setattr(Sample, "trouble", lambda sample: "broken" if probing else None)
    row = sphere(12.0)
    assert (row["status"], row["probe_steps"]) == ("converged", [])
    assert abs(row["transition_distance"]) < 0.05  # what the path itself shows


@pytest.mark.slow
def test_a_deep_lane_needs_no_rows_of_rest():
    """What is found after a few rows in a deep lane is what a cell that rests there shows."""
    short, long = sphere(9.0), sphere(9.0, probe=False)
    assert (short["mode"], long["mode"]) == ("bump", "bump")
    assert short["settled_row"] == long["settled_row"]
    assert short["rows_completed"] == short["settled_row"] + LANE_ROWS
    assert short["transition_distance"] >= MAP_SCATTER[1]
    assert long["rows_completed"] >= long["settled_row"] + 8
    assert short["angle_low_deg"] <= long["migration_angle_deg"] <= short["angle_high_deg"]
    assert short["migration_angle_deg"] == long["migration_angle_deg"]
    shown = short["lateral_steps_um"]
    assert shown == long["lateral_steps_um"][: len(shown)]


@pytest.mark.slow
def test_the_depth_vanishes_where_the_mode_changes():
    """Depths at two gaps, on a line, vanish at one between the last that bumps and the first that
    does not: the distance is one from the transition, and not of the motion alone."""
    near, nearer, beyond = (sphere(gap) for gap in (12.0, 14.0, 15.0))
    assert (near["mode"], nearer["mode"], beyond["mode"]) == ("bump", "bump", "zigzag")
    first, second = near["transition_distance"], nearer["transition_distance"]
    assert 0.3 > first > second > 0 > beyond["transition_distance"]
    assert 14.0 < 12.0 + 2.0 * first / (first - second) < 15.0
