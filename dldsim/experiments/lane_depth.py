"""How deep the bump lane is that a cell has settled in.

A cell at rest in the lane sees its place of rest of the row map, and nothing else: what would let
it fall lies nearer to the pillar. So it is put there, as it is, and goes on for a row: where its
lateral step is above one row shift it comes back. Each offset begins from the same state of cell
and fluid. The largest step of those that come back, less one, is the transition distance.
"""

import copy
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dldsim.experiments.migration import Migration
from dldsim.experiments.runner import Progress
from dldsim.solver.scene import CellInFlow

FARTHEST = 0.8
"""Largest offset, in row shifts: a cell that comes back from there is far from the transition."""
PROBES = 5
"""Offsets tried at most: the largest from which a cell comes back is then known to 0.05."""
FALLEN = 0.5
"""Row shifts below its start from which a cell does not come back: the next pillar lifts those."""
PATIENCE = 4.0
"""Rows that the mean flow passes while a cell crosses one, at most."""
LOOKS = 2
"""Offsets without a way back after which a lane is too shallow for one who only asks for depth."""


class Probe(NamedTuple):
    """Lateral ``step`` of one row, in row shifts, from ``offset`` row shifts nearer to the pillar;
    None where the cell does not fit, falls, breaks or does not get through. ``steps``: time steps.
    """

    offset: float
    step: float | None
    steps: int

    @property
    def comes_back(self) -> bool:
        return self.step is not None and self.step > 1


def probe_lane(
    scene: CellInFlow,
    pitch: float,
    row_shift: float,
    row_steps: float,
    chunk: int,
    progress: Progress = None,
    hopeful: bool = True,
) -> list[Probe]:
    """Offsets tried from the present state of a ``scene``, which stays as it is.

    Begins with FARTHEST. Where the cell does not come back, the interval between the smallest such
    offset and the largest from which it does is halved, PROBES - 1 times. ``pitch``, ``row_shift``:
    nodes; ``row_steps``: time steps in which the mean flow passes a row; ``chunk``: even number of
    them between two looks. Not ``hopeful``: LOOKS offsets without a way back are enough.
    """
    found: list[Probe] = []
    holds, fails, offset = 0.0, FARTHEST, FARTHEST
    while len(found) < PROBES and holds < FARTHEST:
        found.append(_one_row(scene, offset, pitch, row_shift, PATIENCE * row_steps, chunk))
        back = found[-1].comes_back
        if progress:
            progress(
                f"bump lane: {offset:.2f} row shifts nearer to the pillar the cell "
                + ("comes back" if back else "does not come back")
            )
        holds, fails = (offset, fails) if back else (holds, offset)
        offset = (holds + fails) / 2
        if not hopeful and len(found) == LOOKS and holds == 0:
            break
    return found


def _one_row(
    scene: CellInFlow, offset: float, pitch: float, row_shift: float, patience: float, chunk: int
) -> Probe:
    moved = copy.deepcopy(scene)
    moved.shift([0.0, -offset * row_shift, 0.0])
    sample, steps = moved.sample(), 0
    if sample.clearance <= 0:
        return Probe(offset, None, 0)
    path = [sample.centre[:2]]
    while path[-1][0] < path[0][0] + pitch:
        moved.advance(chunk)
        sample, steps = moved.sample(), moved.steps - scene.steps
        path.append(sample.centre[:2])
        fallen = path[-1][1] < path[0][1] - FALLEN * row_shift
        if sample.trouble() or fallen or steps > patience:
            return Probe(offset, None, steps)
    x, y = np.transpose(path)
    step = float(np.interp(x[0] + pitch, np.maximum.accumulate(x), y) - y[0])
    return Probe(offset, step / row_shift, steps)


def with_depth(migration: Migration, steps: Sequence[float]) -> Migration:
    """A motion in the bump lane with the row map's peak beside other ``steps`` on it."""
    peak = max([migration.row_map_peak, *steps])
    return replace(migration, row_map_peak=peak, transition_distance=peak - 1)
