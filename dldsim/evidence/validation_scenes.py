"""What a scene does without: the same result without it, and what that saves."""

import statistics
import time
from collections.abc import Callable, Iterator

import numpy as np

from dldsim.config.sections import Cell, Flow, Geometry, Numerics, RunControl, Stiffness
from dldsim.evidence.validation import Comparison
from dldsim.experiments.array_run import simulate_run
from dldsim.experiments.array_scene import make_scene
from dldsim.solver.flow import Fluid, solve_empty_array
from dldsim.solver.membrane_forces import elastic_forces
from dldsim.solver.pillars import make_array, make_pillars
from dldsim.solver.scene import CellInFlow
from dldsim.solver.time_loop import DAMPING_INTERVAL
from dldsim.solver.units import Units

GEOMETRY = Geometry(pillar_radius_um=7, gap_um=16, periodicity=8)
MEMBRANE = Stiffness(
    ks_uN_per_m=15.24,
    kb_pN_um=0.25,
    kal_uN_per_m=30.0,
    kag_uN_per_m=500,
    kv_Pa=900,
    kvisc_nN_s_per_m=1.5,
)
NOTHING = 1e-30
"""A modulus that is computed with and adds nothing to any sum."""
REPEATS = 5
STEPS = 200
TIME = "time with it / without it"


def left_out() -> Iterator[Comparison]:
    """Each scene with and without what it does not need.

    Mark: what is left out adds zeros, so positions and populations are the same bit by bit but for
    the order of sums, 1e-12 in double precision; flows through one row or all rows of the period
    agree to what the iteration leaves, 1e-6. Times (shown, without mark) are medians of repetitions
    that alternate.
    """
    yield from _terms()
    yield from _cell()
    yield from _rows()
    yield from _height()
    yield from _inertia()
    yield from _solid()
    yield from _later_rows()


def alternate(first: Callable[[], None], second: Callable[[], None]) -> float:
    """Median processor time of ``first`` over that of ``second``, called in turns."""
    times: tuple[list, list] = ([], [])
    for _ in range(REPEATS):
        for call, record in zip((first, second), times, strict=True):
            start = time.process_time()
            call()
            record.append(time.process_time() - start)
    return statistics.median(times[0]) / statistics.median(times[1])


def _pair(name: str, error: float, mark: float, ratio: float, note: str) -> Iterator[Comparison]:
    """Rows of one thing left out: difference of the results, ratio of the times."""
    yield Comparison(
        "difference of the results", error, 0.0, mark, "relative", name, error=error, note=note
    )
    yield Comparison(TIME, ratio, 1.0, None, "1", name, note=note)


def _in_box(stiffness: Stiffness, inertia: str = "stokes") -> CellInFlow:
    """A cell of default size in a box that shears it, without solids."""
    numerics = Numerics(precision="float64", inertia=inertia)
    lattice = make_pillars(28, 0, 0.0, height=16)
    fluid = Fluid.of(lattice, numerics)
    scene = CellInFlow(fluid, Units.of(1.25, Flow(), numerics), Cell(), stiffness, numerics, {})
    scene.place((14.0, 14.0, 8.0))
    scene.body.x[:, 0] += 0.2 * (scene.body.x[:, 0] - 14.0)
    return scene


def _terms() -> Iterator[Comparison]:
    for key, name in (
        ("kb_pN_um", "bending"),
        ("kvisc_nN_s_per_m", "membrane viscosity"),
        ("kal_uN_per_m", "local area"),
    ):
        without = _in_box(MEMBRANE.model_copy(update={key: 0.0}))
        with_it = _in_box(MEMBRANE.model_copy(update={key: NOTHING}))
        for scene in (with_it, without):
            scene.advance(STEPS)
        error = np.abs(with_it.body.x - without.body.x).max() / 28
        ratio = alternate(_forces(with_it), _forces(without))
        yield from _pair(
            f"{name} of zero modulus", error, 1e-12, ratio, "time of the membrane alone"
        )


def _forces(scene: CellInFlow) -> Callable[[], None]:
    body = scene.body

    def call():
        for _ in range(STEPS):
            elastic_forces(
                body.x, body.smooth, scene.membrane, scene.moduli, scene.scratch, body.force
            )

    return call


def _cell() -> Iterator[Comparison]:
    """A fluid alone, and one with a membrane that does nothing to it."""
    numerics = Numerics(precision="float64")
    flow = solve_empty_array(GEOMETRY, Flow(), numerics)
    array = make_array(GEOMETRY, Flow(), numerics)
    idle = MEMBRANE.model_copy(update=dict.fromkeys(Stiffness.model_fields, 0.0))
    still = numerics.model_copy(update={"contact_range_um": 0.0})
    scene = make_scene(array, flow, idle, Cell(), Flow(), still, driven=False)
    alone = Fluid.of(array.lattice, numerics)
    alone.f[:] = flow.populations
    alone.set_body_force([*flow.body_force, 0.0])
    alone.advance(2)
    before_damping = DAMPING_INTERVAL - 2  # which the fluid alone does not have
    scene.advance(before_damping)
    alone.advance(before_damping)
    kept = [f.reshape(19, -1)[:, : array.lattice.nodes] for f in (scene.fluid.f, alone.f)]
    error = np.abs(kept[0] - kept[1]).max() / np.abs(kept[1]).max()
    ratio = alternate(lambda: scene.advance(STEPS), lambda: alone.advance(STEPS))
    yield from _pair("cell", error, 1e-12, ratio, "array with a membrane of no modulus")


def _rows() -> Iterator[Comparison]:
    """One row with shifted periodicity, and all rows of the period."""
    one = Numerics(precision="float64", rows=1, lanes=1, images="aligned")
    every = one.model_copy(update={"rows": GEOMETRY.periodicity})
    solved, times = [], []
    for numerics in (one, every):
        start = time.perf_counter()
        solved.append(solve_empty_array(GEOMETRY, Flow(), numerics))
        times.append(time.perf_counter() - start)
    error = np.abs(solved[1].mobility / solved[0].mobility - 1).max()
    note = f"{solved[0].nodes:,} nodes instead of {solved[1].nodes:,}; flow without a cell"
    yield from _pair("rows of the period but one", error, 1e-6, times[1] / times[0], note)


def _height() -> Iterator[Comparison]:
    """A scene without walls has one node along z."""
    shift, pitch, radius = 3, 24, 6.0
    fluids = []
    for height in (1, 16):
        lattice = make_pillars(pitch, shift, radius, height=height)
        fluid = Fluid(lattice, 1.25, "trt", False, np.dtype("float64"))
        fluid.set_body_force((1e-5, 0.0, 0.0))
        fluid.advance(600)
        fluids.append(fluid)
    flat, tall = fluids
    ratio = alternate(lambda: tall.advance(STEPS), lambda: flat.advance(STEPS))
    error = np.abs(
        tall.mean_velocity() / flat.mean_velocity()[0]
        - flat.mean_velocity() / flat.mean_velocity()[0]
    ).max()
    yield from _pair(
        "walls and height", error, 1e-12, ratio, "two-dimensional limit, 16 nodes high"
    )


def _inertia() -> Iterator[Comparison]:
    """The quadratic term of the equilibrium, in a flow too slow for it to matter."""
    lattice = make_pillars(24, 3, 6.0, height=16, walls=True)
    fluids = []
    for inertia in (False, True):
        fluid = Fluid(lattice, 1.25, "trt", inertia, np.dtype("float64"))
        fluid.set_body_force((1e-18, 0.0, 0.0))
        fluid.advance(200)
        fluids.append(fluid)
    linear, full = fluids
    ratio = alternate(lambda: full.advance(STEPS), lambda: linear.advance(STEPS))
    error = np.abs(full.velocity - linear.velocity).max() / np.abs(linear.velocity).max()
    yield from _pair("convective inertia", error, 1e-12, ratio, "flow without a cell")


def _solid() -> Iterator[Comparison]:
    """Nodes that pillars take from the box; they have no populations."""
    array = make_array(GEOMETRY, Flow(), Numerics())
    share = 1 - array.lattice.nodes / array.lattice.cells
    exact = np.pi * GEOMETRY.pillar_radius_um**2 / GEOMETRY.pitch_um**2
    yield Comparison(
        "share of nodes without populations",
        share,
        exact,
        None,
        "1",
        "solid nodes",
        note=f"{array.lattice.nodes:,} of {array.lattice.cells:,} nodes are kept",
    )


def _later_rows() -> Iterator[Comparison]:
    """Rows after the last one asked for: the path up to there does not know of them."""
    _, short, long = (  # the first one loads the kernels
        simulate_run(
            Geometry(pillar_radius_um=5, gap_um=12, periodicity=4),
            MEMBRANE,
            Cell(),
            Flow(),
            Numerics(),
            RunControl(max_rows=rows, min_rows=rows),
            run_id="x",
            stiffness_set="3",
            probe=False,
        ).row
        for rows in (3, 3, 6)
    )
    a, b = (np.array(run["lateral_steps_um"])[:3] for run in (short, long))
    ratio = long["wall_time_s"] / short["wall_time_s"]
    yield from _pair(
        "rows after the last one needed",
        np.abs(a - b).max(),
        1e-12,
        ratio,
        "lateral steps of three rows, run over three or six",
    )
