"""One run: one cell through one array from one place of release, until its motion has settled.

One outcome: as many runs from different places as it takes to know what a cell does that enters
anywhere.
"""

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType

import numpy as np

from dldsim.config.identifiers import run_id as release_id
from dldsim.config.limits import check_time
from dldsim.config.sections import (
    CELL_NUMERICS,
    Cell,
    CellShape,
    Flow,
    Geometry,
    Numerics,
    RunControl,
    Stiffness,
)
from dldsim.errors import DldsimError, NoRoom
from dldsim.experiments.migration import (
    Migration,
    analyse_path,
    next_release,
    outcome_of,
    row_crossings,
    taken_together,
)
from dldsim.experiments.recording import Record
from dldsim.experiments.runner import Patience, Progress, Stop, advance_until, again_if_unstable
from dldsim.solver.flow import EmptyFlow, Fluid, solve_empty_array
from dldsim.solver.observe import Sample, deformation_index
from dldsim.solver.pillars import ArrayLattice, make_array
from dldsim.solver.scene import CellInFlow
from dldsim.solver.time_loop import make_drive
from dldsim.solver.time_step import (
    bottleneck,
    describe,
    incurable,
    lag_number,
    margins,
    refined,
    refinement,
)
from dldsim.solver.units import Units
from dldsim.tables.numerics import columns_of
from dldsim.vocabulary import SETTLED, STUCK, UNSTABLE

STUCK_ADVANCE, STUCK_ROWS = 0.1, 3.0
"""A cell is stuck if it crosses less than this part of a row while the mean flow passes so many."""
RELEASE_CLEARANCE = 0.5
"""Least distance, in nodes, between membrane and solids at release."""


@dataclass(frozen=True)
class RunResult:
    """``row``: one row of `runs`; ``trajectory``: columns of `trajectory`."""

    row: dict
    trajectory: dict


def simulate_run(
    geometry: Geometry,
    stiffness: Stiffness,
    cell: Cell,
    flow: Flow,
    numerics: Numerics,
    control: RunControl,
    *,
    run_id: str,
    outcome_id: str | None = None,
    stiffness_set: str,
    empty_flow: EmptyFlow | None = None,
    others: Sequence[Migration] = (),
    observe: Callable[[CellInFlow, Record], None] | None = None,
    progress: Progress = None,
) -> RunResult:
    """Carry one cell through the array until its motion settles or ``control.max_rows`` are done.

    ``outcome_id``: the outcome that the run belongs to; by default itself. ``others``: other
    releases of it, in µm, whose passes count where they are alike (`migration.analyse_path`).

    ``observe`` is called after every sample that is recorded, with the scene as it is then, and
    with another record where the run began anew with a shorter time step.
    A cell that clogs or a run that leaves its stable range is a result with a status. Raises
    DldsimError for a geometry that does not fit the lattice or a cell that does not fit its place.
    """
    attempt = partial(
        _simulate,
        geometry,
        stiffness,
        cell,
        flow,
        numerics,
        control,
        run_id,
        outcome_id or run_id,
        stiffness_set,
        empty_flow,
        others,
        observe,
        progress,
    )
    return again_if_unstable(attempt, numerics, progress)


def _simulate(
    geometry,
    stiffness,
    cell,
    flow,
    numerics,
    control,
    run_id,
    outcome_id,
    stiffness_set,
    empty_flow,
    others,
    observe,
    progress,
    shorter,
) -> RunResult:
    """One attempt; ``shorter``: time step asked of it over that which is used."""
    start = time.perf_counter()
    wanted = numerics
    if flow.height_um == 0:
        raise DldsimError(
            "height_um = 0 is the two-dimensional limit of the empty flow; a cell needs a channel "
            "height, at least its own size.",
            key="flow.height_um",
            value=0,
            allowed="> 0",
        )
    if empty_flow is None:
        empty_flow = solve_empty_array(geometry, flow, numerics, progress)
    _check_flow(empty_flow, geometry, flow, numerics)
    array = make_array(geometry, flow, numerics)
    scene = make_scene(array, empty_flow, stiffness, cell, flow, numerics)
    asked = margins(scene)
    factor, shortened = refinement(asked, numerics) * shorter, ""
    if factor > 1:
        numerics = refined(numerics, factor)
        if numerics.inertia == "stokes":
            empty_flow = empty_flow.slower(factor)
        else:
            empty_flow = solve_empty_array(geometry, flow, numerics, progress)
        scene = make_scene(array, empty_flow, stiffness, cell, flow, numerics)
        shortened = f"time step shortened by {factor:.3g}: {bottleneck(asked)}"
        if progress and shorter == 1:
            progress(shortened)
    if progress:
        for sentence in incurable(scene):
            progress(f"this run may fail: {sentence}")
    units = scene.units
    record = Record(run_id, units, np.array([array.pitch, array.pitch, array.height]) / 2)
    row_steps = array.pitch / numerics.velocity_lu
    if shorter == 1:
        check_time(array.lattice.nodes, control.max_rows * row_steps, shortened)
    chunk = 2 * max(1, round(row_steps / control.records_per_row / 2))
    path = Path(pitch=float(array.pitch))

    def analyse() -> Migration:
        return analyse_path(
            path.crossings() * array.spacing_um,
            geometry.pitch_um,
            geometry.periodicity,
            control,
            others,
        )

    def watch(sample: Sample) -> Stop | None:
        record.add(sample, scene.energies())
        if observe:
            observe(scene, record)
        if not path.add(sample):
            return None
        found = analyse()
        settled = found.status in SETTLED and path.rows >= control.min_rows
        over = path.rows >= control.max_rows
        return Stop(found.status, found.reason) if settled or over else None

    def where(sample: Sample) -> tuple[str, float]:
        x = sample.centre[0]
        words = f"cell at x = {x * array.spacing_um:.1f} µm"
        rows = f"{path.rows} of at most {control.max_rows} rows"
        return f"{words}, {rows}", x / array.pitch / control.max_rows

    loop = time.perf_counter()
    stop = advance_until(
        scene, chunk, watch, patience=row_patience(array, numerics), progress=progress, where=where
    )
    wall = time.perf_counter() - loop
    migration = analyse()
    if stop.status in (STUCK, UNSTABLE):
        migration = broken_off(*stop, migration.lateral_steps)
    row = {
        "run_id": run_id,
        **known_of(outcome_id, geometry, stiffness, stiffness_set, cell, flow, wanted),
        "release_gap_fraction": cell.release_gap_fraction,
        "status": stop.status,
        "stop_reason": stop.reason,
        **{name: getattr(migration, name) for name in MIGRATION},
        "rows_completed": path.rows,
        "lateral_steps_um": migration.lateral_steps.tolist(),
        **cost_and_quality(scene, record, wall),
        "pitch_nodes": array.pitch,
        "row_shift_nodes": array.row_shift,
        "height_on_lattice_um": array.height_um,
        "velocity_lu": numerics.velocity_lu,
        **describe(asked, factor),
        "begun_anew": shorter > 1,
        "incurable": incurable(scene),
        "kv_wanted_lu": units.pressure(stiffness.kv_Pa),
        "kv_used_lu": scene.moduli.kv,
        "velocity_blend": scene.blend,
        "start_up_s": round(loop - start, 3),
        "lag_number": lag_number(scene),
        "capillary_number": units.capillary_number(stiffness.ks_uN_per_m),
        "left_out": left_out(array, geometry, stiffness, numerics),
    }
    return RunResult(row, record.trajectory())


MIGRATION = (
    "mode",
    "migration_angle_deg",
    "angle_low_deg",
    "angle_high_deg",
    "first_period_angle_deg",
    "orbit_rows",
    "settled_row",
    "row_map_peak",
    "transition_distance",
    "capture_chance",
)
"""Members of a Migration that are columns of `runs` by the same name."""


def broken_off(status: str, reason: str, lateral_steps: np.ndarray) -> Migration:
    """Migration of a run that is stuck, unstable or failed: none."""
    return Migration(
        **dict.fromkeys(MIGRATION)
        | {
            "status": status,
            "reason": reason,
            "mode": "none",
            "orbit_rows": 0,
            "lateral_steps": lateral_steps,
        }
    )


def migration_of(row: Mapping) -> Migration:
    """The Migration that a row of `runs` was made from, in µm; its path starts at the height in the
    gap, which differs from that on the lattice by the same for all releases."""
    return Migration(
        row["status"],
        row["stop_reason"],
        **{name: row[name] for name in MIGRATION},
        lateral_steps=np.array(row["lateral_steps_um"]),
        lateral_start=row["release_gap_fraction"] * row["gap_um"],
    )


def known_of(
    outcome_id: str,
    geometry: Geometry,
    stiffness: Stiffness,
    stiffness_set: str,
    cell: CellShape,
    flow: Flow,
    numerics: Numerics,
) -> dict:
    """Columns that `runs` and `outcomes` share and that need no simulation."""
    return {
        "outcome_id": outcome_id,
        "pillar_radius_um": geometry.pillar_radius_um,
        "gap_um": geometry.gap_um,
        "pitch_um": geometry.pitch_um,
        "periodicity": geometry.periodicity,
        "row_shift_fraction": geometry.row_shift_fraction,
        "stiffness_set": stiffness_set,
        "cell_shape": cell.shape,
        "cell_radius_um": cell.radius_um,
        "height_um": flow.height_um,
        **stiffness.model_dump(),
        "mean_velocity_mm_s": flow.mean_velocity_mm_s,
        "release_axis": cell.axis,
        "bump_angle_deg": math.degrees(math.atan(geometry.row_shift_fraction)),
        "confinement": 2 * cell.radius_um / geometry.gap_um,
        **columns_of(numerics),
    }


@dataclass(frozen=True)
class OutcomeResult:
    """``row``: one row of `outcomes`; ``runs``: by place of release, in the order of use."""

    row: dict
    runs: dict[float, RunResult]

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
    keep: Callable[[float, RunResult], None] | None = None,
    observe: Callable[[CellInFlow, Record], None] | None = None,
    progress: Progress = None,
) -> OutcomeResult:
    """Release the cell at as many of ``control.release_gap_fractions`` as it takes.

    Which place comes next, and when enough is known, `migration.next_release` says, to which the
    passes of all releases count together (`migration.taken_together`). If
    ``control.outcome_rows_max`` rows are spent before, the outcome is undecided, with the bounds of
    what was seen. No cell enters where it does not fit: such a place is left out, and the reason of
    the outcome names it.

    ``finished``: releases of this outcome that were simulated before, with the same settings.
    ``keep`` is called with place and result of each release when it is done; ``observe`` as in
    `simulate_run`. Raises DldsimError where that does, NoRoom if the cell fits at no place.
    """
    places, narrow = list(control.release_gap_fractions), []
    runs = {place: finished[place] for place in places if place in finished}
    migrations = {place: migration_of(run.row) for place, run in runs.items()}

    def together() -> dict[float, Migration]:
        return taken_together(migrations, geometry.pitch_um, geometry.periodicity, control)

    while (place := next_release(together(), places, geometry.periodicity)) is not None:
        left = control.outcome_rows_max - sum(run.row["rows_completed"] for run in runs.values())
        if runs and left < geometry.periodicity:
            break
        if empty_flow is None:
            empty_flow = solve_empty_array(geometry, flow, numerics, progress)
        if progress:
            progress(f"release at {place:g} of the gap")
        try:
            runs[place] = simulate_run(
                geometry,
                stiffness,
                Cell(**cell.model_dump() | {"release_gap_fraction": place}),
                flow,
                numerics,
                control.model_copy(update={"max_rows": min(control.max_rows, left)}),
                run_id=release_id(outcome_id, place),
                outcome_id=outcome_id,
                stiffness_set=stiffness_set,
                empty_flow=empty_flow,
                others=list(migrations.values()),
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
    row |= sum_up(together(), [run.row for run in runs.values()], geometry.periodicity)
    if place is not None:
        row["status"] = "undecided"
        row["stop_reason"] = (
            f"{row['rows_total']} of outcome_rows_max = {control.outcome_rows_max} rows spent "
            f"before a release at {place:g} of the gap; {row['stop_reason']}"
        )
    if narrow:
        row["stop_reason"] += "; does not fit at " + ", ".join(f"{p:g}" for p in narrow)
    return OutcomeResult(row, runs)


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
    "releases",
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
        "source_angle_deg": source and source.first_period_angle_deg,
        "rows_total": sum(row["rows_completed"] for row in rows),
        "steps": sum(row["steps"] for row in rows),
        "wall_time_s": sum(row["wall_time_s"] for row in rows),
        "capillary_number": rows[0]["capillary_number"],
        "spacing_um": rows[0]["spacing_um"],
        "lag_number": max(row["lag_number"] for row in rows),
        "left_out": rows[0]["left_out"],
    }


def cost_and_quality(scene: CellInFlow, record: Record, wall_time_s: float) -> dict:
    """Columns of `runs` about cost, conservation and numbers of the run."""
    nodes = scene.fluid.lattice.nodes
    mean = record.column("mean_velocity")[1:]
    flux = mean[:, 1].mean() / mean[:, 0].mean() if len(mean) else 0.0
    clearance = float(record.column("clearance").min()) * record.units.spacing_um
    index, _, _ = deformation_index(*record.extents_um().T[:2])
    return {
        "steps": scene.steps,
        "nodes": nodes,
        "vertices": scene.vertices,
        "spacing_um": record.units.spacing_um,
        "time_step_us": record.units.time_step_us,
        "wall_time_s": wall_time_s,
        "ms_per_step": wall_time_s / scene.steps * 1e3,
        "mlups": nodes * scene.steps / wall_time_s / 1e6,
        "reynolds_number": record.units.reynolds_number(scene.radius_um),
        "mach_max": float(record.column("speed_max").max()) * math.sqrt(3),
        "lateral_flux_ratio": float(flux),
        "volume_drift_max": float(np.abs(record.column("volume_ratio") - 1).max()),
        "area_drift_max": float(np.abs(record.column("area_ratio") - 1).max()),
        "inverted_faces_max": float(record.column("inverted").max()),
        "min_clearance_um": clearance,
        "mean_deformation_index": float(index.mean()),
    }


def _check_flow(empty_flow: EmptyFlow, geometry: Geometry, flow: Flow, numerics: Numerics) -> None:
    """Refuse an empty flow that was solved for anything else than this run's array and drive."""
    wanted = {
        **geometry.model_dump(),
        **flow.model_dump(),
        **numerics.model_dump(exclude=CELL_NUMERICS),
    }
    solved = {
        **empty_flow.geometry.model_dump(),
        **empty_flow.flow.model_dump(),
        **empty_flow.numerics.model_dump(),
    }
    other = [f"{k} = {solved[k]} (run: {v})" for k, v in wanted.items() if solved[k] != v]
    if other:
        raise DldsimError(
            f"The flow without a cell was solved with {', '.join(other)}. Solve it anew for this "
            "run, or leave it out."
        )


def make_scene(
    array: ArrayLattice,
    empty_flow: EmptyFlow,
    stiffness: Stiffness,
    cell: Cell,
    flow: Flow,
    numerics: Numerics,
    *,
    driven: bool = True,
) -> CellInFlow:
    """A cell at its place of release, midway between rows, in the flow of the empty array.

    ``driven``: whether the body force is corrected towards the wanted mean velocity. Raises NoRoom
    if the cell would overlap a pillar or a wall.
    """
    units = Units.of(array.spacing_um, flow, numerics)
    fluid = Fluid.of(array.lattice, numerics)
    fluid.f[:] = empty_flow.populations
    fluid.set_body_force([*empty_flow.body_force, 0.0])
    fluid.advance(2)
    mobility = empty_flow.mobility
    if flow.drive == "axial":
        mobility = np.diag([mobility[0, 0], np.inf])
    scene = CellInFlow(
        fluid,
        units,
        cell,
        stiffness,
        numerics,
        {
            "pillars": True,
            "pitch": float(array.pitch),
            "row_shift": float(array.row_shift),
            "radius": array.radius,
            "plates": True,
            "height": float(array.height),
        },
        make_drive(array.lattice, mobility, (numerics.velocity_lu, 0.0)) if driven else None,
    )
    gap = array.pitch - 2 * array.radius
    # Midway between rows -1 and 0 the gap is displaced by half a row shift.
    middle = array.pitch / 2 - array.row_shift / 2
    lateral = middle + array.radius + cell.release_gap_fraction * gap
    scene.place([0.0, lateral, array.height / 2])
    free = scene.sample().clearance
    if free < RELEASE_CLEARANCE:
        raise NoRoom(
            f"The {cell.shape} of radius {cell.radius_um:g} µm (axis {cell.axis}) does not fit at "
            f"its release: clearance {free * array.spacing_um:.2f} µm, needed "
            f"{RELEASE_CLEARANCE * array.spacing_um:.2f} µm.",
            key="cell.release_gap_fraction",
            value=cell.release_gap_fraction,
            allowed="where the cell fits",
            remedy="Change cell.release_gap_fraction or cell.axis, or raise flow.height_um "
            f"(now {flow.height_um:g}).",
        )
    return scene


class Path:
    """Row crossings of a path while it grows; lattice units, first plane at x = 0."""

    def __init__(self, pitch: float):
        self.pitch = pitch
        self.x, self.y = [], []
        self.rows = 0

    def add(self, sample: Sample) -> bool:
        """Go on to a sample; says whether that completes a row."""
        self.x.append(sample.centre[0])
        self.y.append(sample.centre[1])
        before, self.rows = self.rows, max(self.rows, int(self.x[-1] // self.pitch))
        return self.rows > before

    def crossings(self) -> np.ndarray:
        return row_crossings(np.array(self.x), np.array(self.y), 0.0, self.pitch)


def row_patience(array: ArrayLattice, numerics: Numerics) -> Patience:
    """How long a cell may rest between the pillars."""
    return Patience(STUCK_ADVANCE * array.pitch, STUCK_ROWS * array.pitch / numerics.velocity_lu)


def left_out(
    array: ArrayLattice, geometry: Geometry, stiffness: Stiffness, numerics: Numerics
) -> str:
    """What this scene does without, and what that saves."""
    lattice = array.lattice
    items = [f"solid nodes ({1 - lattice.nodes / lattice.cells:.0%} of the box)"]
    if lattice.half:
        items.append("half of the height (mirror plane)")
    if numerics.rows < geometry.periodicity:
        items.append(
            f"{geometry.periodicity - numerics.rows} of {geometry.periodicity} rows "
            "(shifted periodicity)"
        )
    if numerics.inertia == "stokes":
        items.append("convective inertia")
    zero = [name for name, value in stiffness.model_dump().items() if value == 0]
    if zero:
        items.append("membrane terms of zero modulus: " + ", ".join(zero))
    items.append("viscosity field (inside and outside alike)")
    return "; ".join(items)
