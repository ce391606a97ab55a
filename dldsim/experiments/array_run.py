"""One run: one cell through one array from one place of release, until its motion has settled."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from dldsim.config.feasibility import check_images
from dldsim.config.limits import check_time
from dldsim.config.sections import Cell, CellShape, Flow, Geometry, Numerics, RunControl, Stiffness
from dldsim.errors import DldsimError
from dldsim.experiments.array_scene import check_flow, left_out, make_scene
from dldsim.experiments.lane_depth import Probe, probe_lane, with_depth
from dldsim.experiments.migration import Migration, row_crossings
from dldsim.experiments.recording import Record
from dldsim.experiments.releases import far
from dldsim.experiments.runner import Patience, Progress, Stop, advance_until, again_if_unstable
from dldsim.experiments.settled import SettledCell, row_origin, sections_of, settled_cell
from dldsim.experiments.settling import analyse_path, may_be_held
from dldsim.solver.flow import EmptyFlow, solve_empty_array
from dldsim.solver.observe import Sample, deformation_index
from dldsim.solver.pillars import ArrayLattice, make_array
from dldsim.solver.scene import CellInFlow
from dldsim.solver.time_step import (
    bottleneck,
    incurable,
    lag_number,
    margins,
    refined,
    refinement,
    step_record,
)
from dldsim.tables.numerics import columns_of
from dldsim.vocabulary import SETTLED, STUCK, UNSTABLE

STUCK_ADVANCE, STUCK_ROWS = 0.1, 3.0
"""A cell is stuck if it crosses less than this part of a row while the mean flow passes so many."""


@dataclass(frozen=True)
class RunResult:
    """``row``: one row of `runs`; ``trajectory``: columns of `trajectory`; ``cell``: as the run
    left it, None where it broke off."""

    row: dict
    trajectory: dict
    cell: SettledCell | None = None


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
    start: SettledCell | None = None,
    probe: bool = True,
    observe: Callable[[CellInFlow, Record], None] | None = None,
    progress: Progress = None,
) -> RunResult:
    """Carry one cell through the array until its motion settles or ``control.max_rows`` are done.

    ``outcome_id``: the outcome that the run belongs to; by default itself. ``others``: other
    releases of it, in µm, whose passes count where they are alike (`settling.analyse_path`).
    ``start``: the cell goes on from there, as on another lattice, not from its release; the time
    step is that of a release. Such a run has no first period, and its place of release is where its
    path begins. ``probe``: find out how deep the bump lane is that a cell has come to
    (`lane_depth`), and end there if that proves that it is held (`settling.held`); what ``others``
    have found out of a shallow lane is not tried again. Without, the transition distance in the
    lane is None, and the cell has to rest or to swing there.

    ``observe`` is called after every sample that is recorded, with the scene as it is then, and
    with another record where the run began anew with a shorter time step.
    A cell that clogs or a run that leaves its stable range is a result with a status. Raises
    DldsimError for a geometry that does not fit the lattice, a cell that does not fit its place, or
    a start of another cell, array or flow.
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
        start,
        probe,
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
    settled,
    probe,
    observe,
    progress,
    shorter,
) -> RunResult:
    """One attempt; ``shorter``: time step asked of it over that which is used."""
    start = time.perf_counter()
    wanted, sections = numerics, sections_of(geometry, stiffness, cell, flow)
    if settled:
        settled.check(sections)
    if flow.height_um == 0:
        raise DldsimError(
            "height_um = 0 is the two-dimensional limit of the empty flow; a cell needs a channel "
            "height, at least its own size.",
            key="flow.height_um",
            value=0,
            allowed="> 0",
        )
    check_images(geometry, cell, numerics)
    if empty_flow is None:
        empty_flow = solve_empty_array(geometry, flow, numerics, progress)
    check_flow(empty_flow, geometry, flow, numerics)
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
    path = Path(float(array.pitch), settled.enter(scene, array) if settled else None)
    probes: list[Probe] = []
    tried: list[Probe] = []
    shift = float(array.row_shift)
    look = partial(probe_lane, scene, float(array.pitch), shift, row_steps, chunk, progress)
    known = [other.row_map_peak for other in others if other.in_bump_lane]

    def analyse() -> Migration:
        return analyse_path(
            path.crossings() * array.spacing_um,
            geometry.pitch_um,
            geometry.periodicity,
            control,
            others,
            [(one.offset, one.step) for one in probes if one.comes_back],
        )

    def lane_is_to_be_tried() -> bool:
        """Once, and not where another release knows that it is shallow."""
        shallow = known and not far(max(known) - 1)
        if not probe or tried or shallow or path.rows < control.min_rows:
            return False
        return may_be_held(np.diff(path.crossings()) / shift, control)

    def watch(sample: Sample) -> Stop | None:
        record.add(sample, scene.energies())
        if observe:
            observe(scene, record)
        if not path.add(sample):
            return None
        found = analyse()
        if found.status not in SETTLED and lane_is_to_be_tried():
            tried.extend(look(hopeful=False))
            probes[:] = tried
            found = analyse()
            if found.status not in SETTLED:
                probes.clear()
        enough = found.status in SETTLED and path.rows >= control.min_rows
        over = path.rows >= control.max_rows
        return Stop(found.status, found.reason) if enough or over else None

    def where(sample: Sample) -> tuple[str, float]:
        x = sample.centre[0]
        words = f"cell at x = {x * array.spacing_um:.1f} µm"
        rows = f"{path.rows} of at most {control.max_rows} rows"
        return f"{words}, {rows}", x / array.pitch / control.max_rows

    scene.advance(0)  # kernels are compiled or loaded before the clock runs
    loop, processor = time.perf_counter(), time.thread_time()
    stop = advance_until(
        scene, chunk, watch, patience=row_patience(array, numerics), progress=progress, where=where
    )
    migration, back = analyse(), []
    if stop.status in (STUCK, UNSTABLE):
        migration, left = broken_off(*stop, migration.lateral_steps), None
    else:
        if migration.in_bump_lane and not probe:
            migration = replace(migration, transition_distance=None)
        elif migration.in_bump_lane:
            if not probes and not known:
                probes = look()
                tried.extend(probes)
            back = [one for one in probes if one.comes_back]
            migration = with_depth(migration, known + [one.step for one in back])
        before = np.array([path.x[-2], path.y[-2]])
        left = told_of(settled_cell(scene, array, path.rows, before, sections), migration)
    times = time.perf_counter() - loop, time.thread_time() - processor
    steps = scene.steps + sum(one.steps for one in tried)
    row = {
        "run_id": run_id,
        **known_of(outcome_id, geometry, stiffness, stiffness_set, cell, flow, wanted),
        "release_gap_fraction": cell.release_gap_fraction,
        "status": stop.status,
        "stop_reason": stop.reason,
        **{name: getattr(migration, name) for name in MIGRATION},
        "rows_completed": path.rows,
        "lateral_steps_um": migration.lateral_steps.tolist(),
        "probe_offsets": [one.offset for one in back],
        "probe_steps": [one.step for one in back],
        **cost_and_quality(scene, record, steps, *times),
        "pitch_nodes": array.pitch,
        "row_shift_nodes": array.row_shift,
        "height_on_lattice_um": array.height_um,
        "velocity_lu": numerics.velocity_lu,
        **step_record(asked, factor),
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
    if settled:
        floor = row_origin(array, 0)[1] + array.radius
        place = (path.crossings()[0] - floor) / (array.pitch - 2 * array.radius)
        row |= {
            "release_gap_fraction": float(place),
            "first_period_angle_deg": None,
            "stop_reason": f"{stop.reason}; begun with {came_from(settled)}",
        }
    return RunResult(row, record.trajectory(), left)


def told_of(cell: SettledCell, migration: Migration) -> SettledCell:
    """A cell with what is known of its motion."""
    known = {name: getattr(migration, name) for name in MOTION}
    return replace(cell, **known)


def came_from(cell: SettledCell) -> str:
    """Where a settled cell is from, in words."""
    return f"the settled cell of a spacing of {cell.spacing_um:.3g} µm"


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
MOTION = ("status", "angle_low_deg", "angle_high_deg", "transition_distance")
"""Those that a cell carries along."""


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
        "aspect_ratio": cell.aspect_ratio if cell.shape == "ellipsoid" else None,
        "release_axis": cell.axis,
        "drive": flow.drive,
        "bump_angle_deg": math.degrees(math.atan(geometry.row_shift_fraction)),
        "confinement": 2 * cell.radius_um / geometry.gap_um,
        **columns_of(numerics),
    }


def cost_and_quality(
    scene: CellInFlow, record: Record, steps: int, wall_time_s: float, processor_time_s: float
) -> dict:
    """Columns of `runs` about cost, conservation and numbers of the run; ``steps``: all taken."""
    nodes = scene.fluid.lattice.nodes
    mean = record.column("mean_velocity")[1:]
    flux = mean[:, 1].mean() / mean[:, 0].mean() if len(mean) else 0.0
    clearance = float(record.column("clearance").min()) * record.units.spacing_um
    index, _, _ = deformation_index(*record.extents_um().T[:2])
    return {
        "steps": steps,
        "nodes": nodes,
        "vertices": scene.vertices,
        "spacing_um": record.units.spacing_um,
        "time_step_us": record.units.time_step_us,
        "wall_time_s": wall_time_s,
        "processor_time_s": processor_time_s,
        "ms_per_step": wall_time_s / steps * 1e3,
        "mlups": nodes * steps / wall_time_s / 1e6,
        "reynolds_number": record.units.reynolds_number(scene.radius_um),
        "mach_max": float(record.column("speed_max").max()) * math.sqrt(3),
        "lateral_flux_ratio": float(flux),
        "volume_drift_max": float(np.abs(record.column("volume_ratio") - 1).max()),
        "area_drift_max": float(np.abs(record.column("area_ratio") - 1).max()),
        "inverted_faces_max": float(record.column("inverted").max()),
        "min_clearance_um": clearance,
        "mean_deformation_index": float(index.mean()),
    }


class Path:
    """Row crossings of a path while it grows; lattice units, first plane at x = 0.

    ``before``: a place ahead of that plane, for a path that begins behind it.
    """

    def __init__(self, pitch: float, before: Sequence[float] | None = None):
        self.pitch = pitch
        self.x, self.y = ([], []) if before is None else ([before[0]], [before[1]])
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
