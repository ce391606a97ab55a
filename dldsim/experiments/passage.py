"""One passage of one cell through an assay: what is seen on the way and written down."""

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from dldsim.config.limits import check_time
from dldsim.config.sections import Numerics, Stiffness
from dldsim.experiments.outcome_files import Measured
from dldsim.experiments.outline import circularity, outline
from dldsim.experiments.recording import Record
from dldsim.experiments.runner import Progress, Stop, advance_until
from dldsim.solver.observe import Sample, deformation_index
from dldsim.solver.scene import CellInFlow
from dldsim.solver.time_step import bottleneck, margins, refined, refinement


class Sight(NamedTuple):
    """The cell seen along z: extents along and across the flow [nodes], and 1 − circularity."""

    along: float
    across: float
    roundness: float


Index = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Index of the extents along and across the flow."""
PICKED = ("deformation_index", "circularity_index", "diameter_d_um", "diameter_h_um")
"""What a picture gives: the index, 1 − circularity, extents along and across the flow."""


def sight(scene: CellInFlow) -> Sight:
    """The cell as it is seen now."""
    x, (membrane, _) = scene.positions(), scene.surface
    along, across, _ = np.ptp(x, axis=0)
    return Sight(along, across, 1 - circularity(outline(x, membrane)))


def box_index(along, across):
    """(a − b)/(a + b), a the longer side of the box."""
    return deformation_index(along, across)[0]


def elongation_index(along, across):
    """(L − W)/(L + W), negative for a cell that is wider than long."""
    return (along - across) / (along + across)


def refined_step(
    make_scene: Callable[[Numerics], CellInFlow],
    place,
    numerics: Numerics,
    shorter: float,
    travel: float,
    progress: Progress,
) -> Numerics:
    """Numerics with the time step that a scene asks for when the cell is placed; ``shorter``: that
    much shorter still; ``travel``: of the mean flow at most [nodes].

    Raises DldsimError if that takes longer than allowed.
    """
    trial = make_scene(numerics)
    trial.place(place)
    asked = margins(trial)
    factor = refinement(asked, numerics) * shorter
    shortened = f"time step shortened by {factor:.3g}: {bottleneck(asked)}" if factor > 1 else ""
    numerics = refined(numerics, factor)
    if shorter == 1:
        if shortened and progress:
            progress(shortened)
        check_time(trial.fluid.lattice.nodes, travel / numerics.velocity_lu, shortened)
    return numerics


def radius_steps(scene: CellInFlow) -> float:
    """Time steps in which the velocity of the scene's units carries over a radius of the cell."""
    return scene.radius_um / scene.units.spacing_um / scene.units.velocity_lu


def carry_until_steady(
    scene: CellInFlow,
    stiffness: Stiffness,
    run_id: str,
    index: Index,
    *,
    chunk: int,
    window: int,
    limit: float,
    tolerance: float,
    swings: bool,
    progress: Progress,
) -> Measured:
    """Advance a placed cell until its shape is steady, for at most ``limit`` steps.

    Index and 1 − circularity are averaged over a ``window`` of samples that are ``chunk`` steps
    apart. Steady is a shape of which both stay within ``tolerance`` over the window; of one that
    ``swings``, the means over this window and the one before do. A cell that is not steady at the
    limit has neither.
    """
    record = Record(run_id, scene.units, scene.sample().centre)
    sights: list[Sight] = []
    change: float | None = None

    def watch(sample: Sample) -> Stop | None:
        nonlocal change
        record.add(sample, None)
        sights.append(sight(scene))
        change = change_of(pictured(sights, index), window, swings)
        if change is not None and change <= tolerance:
            return Stop("converged", "the shape is steady")
        if sample.step > limit:
            return Stop("undecided", f"the shape has not become steady in {sample.step} steps")
        return None

    def where(sample: Sample) -> tuple[str, float]:
        words = "the index changes" + ("" if change is None else f" by {change:.4f}")
        return words, sample.step / limit

    scene.advance(0)  # kernels are compiled or loaded before the clock runs
    loop, processor = time.perf_counter(), time.thread_time()
    stop = advance_until(scene, chunk, watch, progress=progress, where=where)
    return measured(
        scene,
        record,
        sights,
        index,
        (time.perf_counter() - loop, time.thread_time() - processor),
        stop,
        lambda values: values[-window:].mean(),
        change=change,
        capillary_number=scene.units.capillary_number(stiffness.ks_uN_per_m),
    )


def pictured(sights: Sequence[Sight], index: Index) -> np.ndarray:
    """Index and 1 − circularity (samples, 2) of what was seen."""
    along, across, roundness = np.array(sights).T
    return np.stack([index(along, across), roundness], axis=1)


def change_of(values: np.ndarray, window: int, swings: bool) -> float | None:
    """Largest change of any column (samples, K) over the last window, of a swinging one between the
    means of the last two; None for fewer samples."""
    if len(values) < (2 * window if swings else window + 1):
        return None
    if not swings:
        return float(np.ptp(values[-window - 1 :], axis=0).max())
    before, last = values[-2 * window : -window], values[-window:]
    return float(np.abs(last.mean(axis=0) - before.mean(axis=0)).max())


def measured(
    scene: CellInFlow,
    record: Record,
    sights: Sequence[Sight],
    index: Index,
    times_s: tuple[float, float],
    stop: Stop,
    at: Callable[[np.ndarray], float],
    *,
    change: float | None = None,
    capillary_number: float | None,
) -> Measured:
    """What is written down of a passage; ``times_s``: of clock and processor; ``at``: value
    of a column (samples,) where the shape is measured. Null for a cell that did not get there."""
    spacing = scene.units.spacing_um
    along, across, roundness = np.array(sights).T
    values = index(along, across), roundness, along * spacing, across * spacing
    picked: tuple = (None,) * 5
    if stop.status == "converged":
        d, h = float(at(values[2])), float(at(values[3]))
        picked = float(index(d, h)), float(at(roundness)), d, h, float(values[0].max())
    ratios = {name: record.column(name) for name in ("volume_ratio", "area_ratio")}
    row = {
        "status": stop.status,
        "stop_reason": stop.reason,
        **dict(zip((*PICKED, "deformation_index_max"), picked, strict=True)),
        "index_change": change,
        "steps": scene.steps,
        "wall_time_s": times_s[0],
        "processor_time_s": times_s[1],
        "mlups": scene.fluid.lattice.nodes * scene.steps / times_s[0] / 1e6,
        "capillary_number": capillary_number,
        "volume_drift_max": float(np.abs(ratios["volume_ratio"] - 1).max()),
        "area_drift_max": float(np.abs(ratios["area_ratio"] - 1).max()),
    }
    path = record.time_and_place() | dict(zip(PICKED, values, strict=True)) | ratios
    return Measured(row, path)
