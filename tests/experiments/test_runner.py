"""The loop of every experiment, on a scene that moves as it is told."""

from types import SimpleNamespace

import numpy as np
import pytest

from dldsim.config.sections import Numerics
from dldsim.experiments import runner
from dldsim.experiments.runner import Patience, Stop, advance_until, again_if_unstable
from tests.solver.test_observe import sample_at

ENOUGH = Stop("converged", "told so")


class Scene:
    """Moves by 2 nodes in each of so many chunks of 10 steps, then rests; ``faults``: what is wrong
    with the sample from a step on."""

    fluid = SimpleNamespace(lattice=SimpleNamespace(nodes=5_000_000))
    units = SimpleNamespace(spacing_um=0.5, velocity_lu=0.4)

    def __init__(self, moves=100, faults=None):
        self.steps, self.moves, self.faults = 0, moves, faults or {}

    def advance(self, steps):
        self.steps += steps

    def sample(self):
        faults = {}
        for step, values in self.faults.items():
            faults |= values if self.steps >= step else {}
        return sample_at(2.0 * min(self.steps // 10, self.moves), self.steps, **faults)


def watched(scene, stop=lambda sample: None, **options):
    """How the run ends, and the steps that were seen."""
    seen = []

    def watch(sample):
        seen.append(sample.step)
        return stop(sample)

    return advance_until(scene, 10, watch, **options), seen


def test_every_sample_is_seen_the_start_included_until_it_is_enough():
    stop, seen = watched(Scene(), lambda sample: ENOUGH if sample.step >= 30 else None)
    assert stop == ENOUGH and seen == [0, 10, 20, 30]


def test_a_scene_that_is_where_it_should_be_does_not_advance():
    scene = Scene()
    assert watched(scene, lambda sample: ENOUGH) == (ENOUGH, [0])
    assert scene.steps == 0


def test_what_has_left_its_safe_range_is_not_seen():
    faults = {30: {"speed_max": np.nan}}
    stop, seen = watched(Scene(faults=faults), lambda s: ENOUGH if s.step >= 30 else None)
    assert seen == [0, 10, 20] and stop.status == "unstable"
    assert stop.reason == f"a value is not finite at step 30; {runner.CURES}"
    assert watched(Scene(faults=faults), cures="rest")[0].reason.endswith("at step 30; rest")


def test_a_cell_is_stuck_when_its_headway_takes_longer_than_the_patience():
    # At rest from step 40 on, at x = 8; the mark of 3 nodes is set at steps 20 and 40.
    stop, seen = watched(Scene(moves=4), patience=Patience(3.0, 50))
    assert stop.status == "stuck" and seen[-1] == 100
    assert (
        stop.reason == "the cell moved less than 1.5 µm while the mean flow moved 10 µm (step 100)"
    )
    # Steps of 2 nodes are headway enough if they come to 3 in time.
    moving = watched(
        Scene(), lambda s: ENOUGH if s.step > 300 else None, patience=Patience(3.0, 20)
    )
    assert moving[0] == ENOUGH


def test_progress_is_a_sentence_and_at_most_one_a_second(monkeypatch):
    clock = iter(np.arange(0.0, 100.0, 0.4))
    monkeypatch.setattr(runner.time, "perf_counter", lambda: next(clock))
    said = []
    options = {"progress": said.append, "where": lambda s: (f"x = {s.centre[0]:g}", s.step / 100)}
    watched(Scene(), lambda s: ENOUGH if s.step == 100 else None, **options)
    # The clock is read at the begin and once a chunk: at 1.2, 2.4 and 3.6 s.
    assert said == [
        "step 30, 125 MLUPS, x = 6, about 3 s left",
        "step 60, 125 MLUPS, x = 12, about 2 s left",
        "step 90, 125 MLUPS, x = 18, about 0 s left",
    ]


# ------------------------------------------------------------------ begun anew


@pytest.mark.parametrize(
    ("time_step", "statuses", "factors"),
    [
        ("automatic", ["converged"], [1]),
        ("automatic", ["unstable", "stuck"], [1, 2]),
        ("automatic", ["unstable", "unstable"], [1, 2]),
        ("as-given", ["unstable"], [1]),
    ],
)
def test_an_unstable_run_begins_anew_once(time_step, statuses, factors):
    asked, left = [], iter(statuses)

    def attempt(factor):
        asked.append(factor)
        return SimpleNamespace(row={"status": next(left), "stop_reason": "too fast"})

    result = again_if_unstable(attempt, Numerics(time_step=time_step), None)
    assert asked == factors and result.row["status"] == statuses[-1]
