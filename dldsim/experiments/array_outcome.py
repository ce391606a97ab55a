"""One outcome: as many runs from different places as it takes to know what a cell does that enters
anywhere.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from dldsim.config.identifiers import run_id as release_id
from dldsim.config.sections import Cell, CellShape, Flow, Geometry, Numerics, RunControl, Stiffness
from dldsim.errors import NoRoom
from dldsim.experiments.array_run import (
    RunResult,
    came_from,
    known_of,
    migration_of,
    simulate_run,
    told_of,
)
from dldsim.experiments.migration import Migration
from dldsim.experiments.recording import Record
from dldsim.experiments.releases import far, next_release, outcome_of, taken_together
from dldsim.experiments.runner import Progress
from dldsim.experiments.settled import SettledCell
from dldsim.solver.flow import EmptyFlow, solve_empty_array
from dldsim.solver.scene import CellInFlow
from dldsim.vocabulary import COEXISTING, GONE_ON, RELEASED, SETTLED


@dataclass(frozen=True)
class OutcomeResult:
    """``row``: one row of `outcomes`; ``runs``: by place of release, in the order of use.

    ``start``: "release", "settled", or both. ``settled``: cells by place of release whose motion
    has settled.
    """

    row: dict
    runs: dict[float, RunResult]
    start: str = RELEASED
    settled: dict[float, SettledCell] = field(default_factory=dict)

    def rows(self) -> list[dict]:
        """Rows of `runs`."""
        return [run.row for run in self.runs.values()]

    def trajectory(self) -> dict[str, np.ndarray]:
        """Columns of `trajectory`, one release after the other."""
        paths = [run.trajectory for run in self.runs.values()]
        return {name: np.concatenate([path[name] for path in paths]) for name in paths[0]}


def simulate_outcome(
    geometry: Geometry,
    stiffness: Stiffness,
    cell: CellShape,
    flow: Flow,
    numerics: Numerics,
    control: RunControl,
    *,
    outcome_id: str,
    stiffness_set: str,
    empty_flow: EmptyFlow | None = None,
    finished: Mapping[float, RunResult] = MappingProxyType({}),
    starts: Mapping[float, SettledCell] = MappingProxyType({}),
    keep: Callable[[float, RunResult], None] | None = None,
    observe: Callable[[CellInFlow, Record], None] | None = None,
    progress: Progress = None,
) -> OutcomeResult:
    """Release the cell at as many of ``control.release_gap_fractions`` as it takes.

    Which place comes next, and when enough is known, `releases.next_release` says, to which the
    passes of all releases count together (`releases.taken_together`). If
    ``control.outcome_rows_max`` rows are spent before, the outcome is undecided, with the bounds of
    what was seen. No cell enters where it does not fit: such a place is left out, and the reason of
    the outcome names it.

    ``starts``: settled cells of a coarser simulation by place of release. Where they show one
    motion, far from the transition (`SettledCell.goes_on`), the first goes on here instead of a
    release, and stands for all places if its motion `stays`; otherwise the cell is released from
    the others, too. Where they show several, it is released from the first place of each.

    ``finished``: releases of this outcome that were simulated before, with the same settings.
    ``keep`` is called with place and result of each release when it is done; ``observe`` as in
    `simulate_run`. Raises DldsimError where that does, NoRoom if the cell fits at no place.
    """
    places, narrow = list(control.release_gap_fractions), []
    runs = {place: finished[place] for place in places if place in finished}
    migrations = {place: migration_of(run.row) for place, run in runs.items()}
    first = first_of_motion({place: starts[place] for place in places if place in starts})
    leading = [place for place, other in first.items() if place == other]
    gone_on = [place for place in leading if starts[place].goes_on] if len(leading) == 1 else []
    stands: dict[float, float] = {}

    def together() -> dict[float, Migration]:
        own = taken_together(migrations, geometry.pitch_um, geometry.periodicity, control)
        return own | {place: own[other] for place, other in stands.items()}

    def next_place() -> float | None:
        unseen = [place for place in leading if place in places and place not in runs]
        return unseen[0] if unseen else next_release(together(), places, geometry.periodicity)

    while (place := next_place()) is not None:
        other = first.get(place, place)
        gone = other != place and other in gone_on and other in runs
        if gone and stays(together()[other], starts[other]):
            stands[place] = other
            continue
        left = control.outcome_rows_max - sum(run.row["rows_completed"] for run in runs.values())
        if runs and left < geometry.periodicity:
            break
        start = starts[place] if place in gone_on else None
        if empty_flow is None:
            empty_flow = solve_empty_array(geometry, flow, numerics, progress)
        if progress:
            how = f" goes on with {came_from(start)}" if start else ""
            progress(f"release at {place:g} of the gap{how}")
        try:
            runs[place] = simulate_run(
                geometry,
                stiffness,
                Cell(**cell.model_dump() | {"release_gap_fraction": place}),
                flow,
                numerics,
                rows_of(control, place, left, 0 if start else geometry.periodicity),
                run_id=release_id(outcome_id, place),
                outcome_id=outcome_id,
                stiffness_set=stiffness_set,
                empty_flow=empty_flow,
                others=list(migrations.values()),
                start=start,
                observe=observe,
                progress=progress,
            )
        except NoRoom as error:
            places.remove(place)
            narrow.append(place)
            if not places:
                raise
            if progress:
                progress(f"left out: {error}")
            continue
        migrations[place] = migration_of(runs[place].row)
        if keep:
            keep(place, runs[place])
    row = known_of(outcome_id, geometry, stiffness, stiffness_set, cell, flow, numerics)
    found = together()
    row |= sum_up(found, [run.row for run in runs.values()], geometry.periodicity)
    if place is not None:
        if row["status"] != COEXISTING:
            row["status"] = "undecided"
        row["stop_reason"] = (
            f"{row['rows_total']} of outcome_rows_max = {control.outcome_rows_max} rows spent "
            f"before a release at {place:g} of the gap; {row['stop_reason']}"
        )
    if narrow:
        row["stop_reason"] += "; does not fit at " + ", ".join(f"{p:g}" for p in narrow)
    for place in runs:
        if place in gone_on:
            row["stop_reason"] += f"; {place:g} went on with {came_from(starts[place])}"
        if others := [f"{p:g}" for p, standing in stands.items() if standing == place]:
            row["stop_reason"] += f"; {place:g} stands for {', '.join(others)} as there"
    begun = {GONE_ON if place in gone_on else RELEASED for place in runs}
    settled = {
        place: told_of(cell, one)
        for place, one in found.items()
        if one.status in SETTLED and (cell := runs[stands.get(place, place)].cell)
    }
    return OutcomeResult(row, runs, ", ".join(sorted(begun)), settled)


def rows_of(control: RunControl, place: float, left: int, period: int) -> RunControl:
    """Run control of a run with ``left`` rows: the source's has its first ``period`` whole."""
    most = min(control.max_rows, left)
    least = period if place == MID_GAP else 0
    return control.model_copy(
        update={"max_rows": most, "min_rows": min(max(control.min_rows, least), most)}
    )


def first_of_motion(starts: Mapping[float, SettledCell]) -> dict[float, float]:
    """Of each place the first whose settled cell moves alike, in the order of use."""
    return {
        place: next(other for other, that in starts.items() if that.same_motion(cell))
        for place, cell in starts.items()
    }


def stays(migration: Migration, start: SettledCell) -> bool:
    """Whether a motion has settled where no scatter of the row map would change it: far from the
    transition on this lattice and on the coarser one, and on the same side."""
    here, there = migration.transition_distance, start.transition_distance
    settled = migration.status in SETTLED and far(here) and far(there)
    return settled and (here > 0) == (there > 0)


OUTCOME = (
    "mode",
    "migration_angle_deg",
    "angle_low_deg",
    "angle_high_deg",
    "angle_spread_deg",
    "share_bump",
    "share_mixed",
    "share_zigzag",
    "share_none",
    "coexisting",
    "settled_row",
    "transition_distance",
)
"""Members of an Outcome that are columns of `outcomes` by the same name."""
MID_GAP = 0.5
"""Where the source releases its cells."""


def sum_up(
    migrations: Mapping[float, Migration], rows: Iterable[Mapping], periodicity: int
) -> dict:
    """Columns of `outcomes` that follow from its releases and their rows of `runs`."""
    rows = list(rows)
    outcome = outcome_of(migrations, periodicity)
    source = migrations.get(MID_GAP)
    return {
        "status": outcome.status,
        "stop_reason": outcome.reason,
        **{name: getattr(outcome, name) for name in OUTCOME},
        "releases": len(rows),
        "source_angle_deg": source and source.first_period_angle_deg,
        "rows_total": sum(row["rows_completed"] for row in rows),
        "steps": sum(row["steps"] for row in rows),
        "wall_time_s": sum(row["wall_time_s"] for row in rows),
        "capillary_number": rows[0]["capillary_number"],
        "spacing_um": rows[0]["spacing_um"],
        "lag_number": max(row["lag_number"] for row in rows),
        "left_out": rows[0]["left_out"],
    }
