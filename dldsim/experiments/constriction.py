"""The slit in which the source measures the deformation index of a cell, as an assay.

A straight channel between plates narrows to a slit throat and widens again, periodic along the
flow. The flow is from left to right along x, the throat narrow along y, the picture taken along z.
"""

import time
from dataclasses import dataclass
from functools import partial

import numpy as np

from dldsim.config.feasibility import check_channel, check_release
from dldsim.config.sections import Cell, Constriction, Flow, Numerics, Stiffness
from dldsim.errors import NoRoom
from dldsim.experiments.outcome_files import Measured
from dldsim.experiments.passage import box_index, measured, refined_step, sight
from dldsim.experiments.recording import Record
from dldsim.experiments.runner import Progress, Stop, advance_until, again_if_unstable
from dldsim.laws import even_throat, viscosity
from dldsim.solver.flow import Fluid, advance_to_steady
from dldsim.solver.lattice import Lattice, make_lattice
from dldsim.solver.observe import Sample
from dldsim.solver.scene import CellInFlow
from dldsim.solver.time_loop import make_drive
from dldsim.solver.units import Units
from dldsim.vocabulary import STUCK

SAMPLES_PER_THROAT = 40
PATIENCE = 6.0
"""Transits at the mean velocity of the throat after which a cell counts as stuck."""


@dataclass(frozen=True)
class Channel:
    """The channel on the lattice, lengths in nodes. Walls at y = 1 and y = 1 + width.

    ``throat``: x where the throat begins and ends. ``profile`` (2, 6): x and half width.
    """

    spacing_um: float
    width: int
    throat_width: int
    height: int
    throat: tuple[float, float]
    profile: np.ndarray
    lattice: Lattice

    @property
    def centre(self) -> float:
        return 1 + self.width / 2

    @property
    def length(self) -> int:
        return self.lattice.nx


def make_channel(channel: Constriction, numerics: Numerics) -> Channel:
    """Lay the channel on a lattice that divides the throat into an even number of nodes.

    Raises DldsimError as `feasibility.check_channel` does.
    """
    check_channel(channel, numerics)
    spacing, throat_width = even_throat(channel.throat_width_um, channel.spacing_um)
    width = 2 * round(channel.width_um / spacing / 2)
    height = round(channel.height_um / spacing)
    approach = channel.approach_length_um / spacing
    taper = channel.taper_length_um / spacing
    throat = channel.throat_length_um / spacing
    nx = round(2 * (approach + taper) + throat)
    x = np.array([0, approach, approach + taper, approach + taper + throat, 0, nx], float)
    x[4] = x[3] + taper
    half = np.array([width, width, throat_width, throat_width, width, width]) / 2
    at = np.interp(np.arange(nx) + 0.5, x, half)
    y = np.arange(width + 1) + 0.5 - (1 + width / 2)
    solid = np.abs(y)[None, :] > at[:, None]
    lattice = make_lattice(
        solid, height, walls=True, half=numerics.half_scene, dtype=np.dtype(numerics.precision)
    )
    return Channel(spacing, width, throat_width, height, (x[2], x[3]), np.stack([x, half]), lattice)


def scene_in(
    channel: Channel,
    fluid: Fluid,
    flow: Flow,
    cell: Cell,
    stiffness: Stiffness,
    numerics: Numerics,
    mobility: float = 1.0,
) -> CellInFlow:
    """A cell in a channel whose mean velocity at the narrowest is the flow's.

    ``mobility``: mean velocity of the box per force density, see `steady_start`.
    """
    target = numerics.velocity_lu * channel.throat_width / channel.lattice.ny
    return CellInFlow(
        fluid,
        Units.of(channel.spacing_um, flow, numerics),
        cell,
        stiffness,
        numerics,
        {
            "plates": True,
            "height": float(channel.height),
            "channel": True,
            "profile": channel.profile,
            "centre": channel.centre,
            "length": float(channel.length),
        },
        make_drive(channel.lattice, mobility * np.eye(2), (target, 0.0), axial=True),
    )


def simulate_constriction(
    stiffness: Stiffness,
    velocity_mm_s: float,
    channel: Constriction,
    cell: Cell,
    flow: Flow,
    numerics: Numerics,
    *,
    release_position_um: float,
    offset_um: float = 0.0,
    run_id: str,
    progress: Progress = None,
) -> Measured:
    """Carry one cell through the throat and measure its deformation index there.

    ``velocity_mm_s``: mean of the wide channel; ``numerics.velocity_lu`` is that of the throat,
    where it is largest. The cell starts at mid-height in the straight approach, ``offset_um`` off
    the axis, foremost with its rim at the taper; ``release_position_um`` is counted backwards from
    there. A cell that clogs or a run that leaves its stable range is a result with a status.
    """
    attempt = partial(
        _simulate,
        stiffness,
        velocity_mm_s,
        channel,
        cell,
        flow,
        numerics,
        release_position_um,
        offset_um,
        run_id,
        progress,
    )
    return again_if_unstable(attempt, numerics, progress)


def _simulate(
    stiffness,
    velocity_mm_s,
    channel,
    cell,
    flow,
    numerics,
    release_position_um,
    offset_um,
    run_id,
    progress,
    shorter,
) -> Measured:
    """One attempt; ``shorter``: time step asked of it over that which is used."""
    check_release(release_position_um, channel, cell)
    laid = make_channel(channel, numerics)
    narrowing = laid.width / laid.throat_width
    cell = cell.model_copy(update={"axis": channel.axis})
    flow = flow.model_copy(update={"mean_velocity_mm_s": velocity_mm_s * narrowing})
    fluid, spacing = Fluid.of(laid.lattice, numerics), laid.spacing_um
    begin, end = laid.throat
    travel = PATIENCE * (end - begin + narrowing * begin)
    numerics = refined_step(
        lambda given: scene_in(laid, fluid, flow, cell, stiffness, given),
        np.array([0.0, laid.centre, laid.height / 2]),
        numerics,
        shorter,
        travel,
        progress,
    )
    limit = travel / numerics.velocity_lu
    mobility = steady_start(fluid, laid, numerics.velocity_lu, progress)
    scene = scene_in(laid, fluid, flow, cell, stiffness, numerics, mobility)
    first = laid.profile[0, 1] - cell.radius_um / spacing
    release = first - release_position_um / spacing
    scene.place([release, laid.centre + offset_um / spacing, laid.height / 2])
    if scene.sample().clearance < 0.5:
        raise NoRoom(
            f"The {cell.shape} of radius {cell.radius_um:g} µm does not fit the channel of "
            f"{channel.width_um:g} × {channel.height_um:g} µm.",
            key="cell.radius_um",
            value=cell.radius_um,
            allowed="less than the channel is wide and high",
            remedy="Lower cell.radius_um, or widen or raise the channel.",
        )
    middle, sights = (begin + end) / 2, []
    record = Record(run_id, scene.units, np.array([middle, laid.centre, laid.height / 2]))
    chunk = 2 * max(1, round((end - begin) / numerics.velocity_lu / SAMPLES_PER_THROAT / 2))
    out = end + cell.radius_um / spacing

    def watch(sample: Sample) -> Stop | None:
        record.add(sample, None)
        sights.append(sight(scene))
        if sample.step > limit:
            return Stop(STUCK, f"the cell has not passed the throat in {sample.step} steps")
        left = sample.centre[0] >= out
        return Stop("converged", "the cell has left the throat") if left else None

    def where(sample: Sample) -> tuple[str, float]:
        x = sample.centre[0]
        words = f"cell {(x - begin) * spacing:+.1f} µm from the throat"
        return words, (x - release) / (out - release)

    scene.advance(0)  # kernels are compiled or loaded before the clock runs
    loop, processor = time.perf_counter(), time.thread_time()
    stop = advance_until(scene, chunk, watch, progress=progress, where=where)
    times = time.perf_counter() - loop, time.thread_time() - processor
    x = record.column("centre")[:, 0]
    return measured(
        scene,
        record,
        sights,
        box_index,
        times,
        stop,
        lambda values: np.interp(middle, x, values),
        capillary_number=scene.units.capillary_number(stiffness.ks_uN_per_m, velocity_mm_s),
    )


def steady_start(fluid: Fluid, channel: Channel, velocity: float, progress: Progress) -> float:
    """Bring the fluid to the steady flow of the wanted mean ``velocity`` at the narrowest, lattice
    units; returns the mean velocity of the box per force density."""
    target = velocity * channel.throat_width / channel.lattice.ny
    scale = target * viscosity(fluid.relaxation_time) / channel.throat_width**2
    fluid.set_body_force((scale, 0.0, 0.0))
    inertia, fluid.inertia = fluid.inertia, False
    advance_to_steady(fluid, channel.width / 2, progress)
    mobility = fluid.mean_velocity()[0] / scale
    fluid.f *= target / mobility / scale
    fluid.velocity *= target / mobility / scale
    fluid.set_body_force((target / mobility, 0.0, 0.0))
    fluid.inertia = inertia
    return float(mobility)
