"""Constriction channel in which the deformation index of a cell is measured.

A straight channel between plates narrows to a slit throat and widens again, periodic along the
flow. The flow is from left to right along x, the throat narrow along y, the picture taken along z.
"""

import time
from dataclasses import dataclass

import numpy as np

from dldsim.config.feasibility import check_channel, check_release
from dldsim.config.limits import check_time
from dldsim.config.sections import Cell, Constriction, ConstrictionGroup, Flow, Numerics
from dldsim.errors import NoRoom
from dldsim.experiments.recording import Record
from dldsim.experiments.runner import Progress, Stop, advance_until, again_if_unstable
from dldsim.laws import even_throat, viscosity
from dldsim.solver.flow import Fluid, advance_to_steady
from dldsim.solver.lattice import Lattice, make_lattice
from dldsim.solver.observe import Sample, deformation_index
from dldsim.solver.scene import CellInFlow
from dldsim.solver.time_loop import make_drive
from dldsim.solver.time_step import bottleneck, margins, refined, refinement
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


@dataclass(frozen=True)
class ConstrictionResult:
    """``row``: one of `constriction_runs`; ``trajectory``: `constriction_trajectory` columns."""

    row: dict
    trajectory: dict


def simulate_constriction(
    group_name: str,
    group: ConstrictionGroup,
    channel: Constriction,
    cell: Cell,
    flow: Flow,
    numerics: Numerics,
    *,
    release_position_um: float,
    run_id: str,
    progress: Progress = None,
) -> ConstrictionResult:
    """Carry one cell through the throat and measure its deformation index there.

    The mean velocity of the wide channel is the group's; ``numerics.velocity_lu`` is that of the
    throat, where it is largest. The cell starts on the axis in the straight approach, foremost with
    its rim at the taper; ``release_position_um`` is counted backwards from there. A cell that clogs
    or a run that leaves its stable range is a result with a status.
    """

    def attempt(shorter: float) -> ConstrictionResult:
        return _simulate(
            group_name,
            group,
            channel,
            cell,
            flow,
            numerics,
            release_position_um,
            run_id,
            progress,
            shorter,
        )

    return again_if_unstable(attempt, numerics, progress)


def _simulate(
    group_name, group, channel, cell, flow, numerics, release_position_um, run_id, progress, shorter
) -> ConstrictionResult:
    """One attempt; ``shorter``: time step asked of it over that which is used."""
    check_release(release_position_um, channel, cell)
    scene_channel = make_channel(channel, numerics)
    narrowing = scene_channel.width / scene_channel.throat_width
    throat_velocity = group.velocity_mm_s * narrowing
    cell = cell.model_copy(update={"axis": channel.axis})
    flow = flow.model_copy(update={"mean_velocity_mm_s": throat_velocity})
    lattice, spacing = scene_channel.lattice, scene_channel.spacing_um
    fluid = Fluid.of(lattice, numerics)
    box_share = scene_channel.throat_width / lattice.ny

    def make_scene(numerics: Numerics, mobility: float = 1.0) -> CellInFlow:
        return CellInFlow(
            fluid,
            Units.of(spacing, flow, numerics),
            cell,
            group.stiffness,
            numerics,
            {
                "plates": True,
                "height": float(scene_channel.height),
                "channel": True,
                "profile": scene_channel.profile,
                "centre": scene_channel.centre,
                "length": float(scene_channel.length),
            },
            make_drive(
                lattice, np.diag([mobility, np.inf]), (numerics.velocity_lu * box_share, 0.0)
            ),
        )

    trial = make_scene(numerics)
    trial.place(np.array([0.0, scene_channel.centre, scene_channel.height / 2]))
    factor = refinement(margins(trial), numerics) * shorter
    numerics = refined(numerics, factor)
    shortened = ""
    if factor > 1:
        shortened = f"time step shortened by {factor:.3g}: {bottleneck(margins(trial))}"
    if shortened and progress and shorter == 1:
        progress(shortened)
    begin, end = scene_channel.throat
    limit = PATIENCE * (end - begin + narrowing * begin) / numerics.velocity_lu
    if shorter == 1:
        check_time(lattice.nodes, limit, shortened)
    mobility = _steady_start(fluid, scene_channel, numerics.velocity_lu * box_share, progress)
    scene = make_scene(numerics, mobility)
    units = scene.units
    first = scene_channel.profile[0, 1] - cell.radius_um / spacing
    release = first - release_position_um / spacing
    scene.place([release, scene_channel.centre, scene_channel.height / 2])
    if scene.sample().clearance < 0.5:
        raise NoRoom(
            f"The {cell.shape} of radius {cell.radius_um:g} µm does not fit the channel of "
            f"{channel.width_um:g} × {channel.height_um:g} µm.",
            key="cell.radius_um",
            value=cell.radius_um,
            allowed="less than the channel is wide and high",
            remedy="Lower cell.radius_um, or widen or raise the channel.",
        )
    record = Record(
        run_id, units, np.array([(begin + end) / 2, scene_channel.centre, scene_channel.height / 2])
    )
    chunk = 2 * max(1, round((end - begin) / numerics.velocity_lu / SAMPLES_PER_THROAT / 2))
    out = end + cell.radius_um / spacing

    def watch(sample: Sample) -> Stop | None:
        record.add(sample, None)
        if sample.step > limit:
            return Stop(STUCK, f"the cell has not passed the throat in {sample.step} steps")
        left = sample.centre[0] >= out
        return Stop("converged", "the cell has left the throat") if left else None

    def where(sample: Sample) -> tuple[str, float]:
        x = sample.centre[0]
        words = f"cell {(x - begin) * spacing:+.1f} µm from the throat"
        return words, (x - release) / (out - release)

    loop = time.perf_counter()
    stop = advance_until(scene, chunk, watch, progress=progress, where=where)
    wall = time.perf_counter() - loop
    return ConstrictionResult(
        {
            "run_id": run_id,
            "group": group_name,
            "stiffness_set": group.stiffness_set or "",
            **group.stiffness.model_dump(include={"ks_uN_per_m", "kb_pN_um", "kal_uN_per_m"}),
            "velocity_mm_s": group.velocity_mm_s,
            "design": "group-velocity",
            "release_position_um": release_position_um,
            "status": stop.status,
            "stop_reason": stop.reason,
            **_throat(record, begin, end, stop.status),
            "steps": scene.steps,
            "wall_time_s": wall,
            "mlups": lattice.nodes * scene.steps / wall / 1e6,
            "capillary_number": _group_capillary_number(units, group, narrowing),
            "volume_drift_max": float(np.abs(record.column("volume_ratio") - 1).max()),
            "area_drift_max": float(np.abs(record.column("area_ratio") - 1).max()),
        },
        _trajectory(record),
    )


def _group_capillary_number(units: Units, group: ConstrictionGroup, narrowing: float):
    """Ca = μv/k_s with the group's velocity v, that of the wide channel."""
    number = units.capillary_number(group.stiffness.ks_uN_per_m)
    return None if number is None else number / narrowing


def _steady_start(fluid: Fluid, channel: Channel, target: float, progress: Progress) -> float:
    """Bring the fluid to the steady flow of the wanted mean velocity; returns mobility."""
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


def _throat(record: Record, begin: float, end: float, status: str) -> dict:
    """Deformation in the throat; null for a cell that did not pass it."""
    names = ("deformation_index", "deformation_index_max", "throat_d_um", "throat_h_um")
    x = record.column("centre")[:, 0]
    if status != "converged":
        return dict.fromkeys(names)
    d, h, _ = record.extents_um().T
    index, _, _ = deformation_index(d, h)
    middle = (begin + end) / 2
    throat_d, throat_h = np.interp(middle, x, d), np.interp(middle, x, h)
    values = (deformation_index(throat_d, throat_h)[0], index.max(), throat_d, throat_h)
    return dict(zip(names, map(float, values), strict=True))


def _trajectory(record: Record) -> dict:
    """Columns of `constriction_trajectory`; x from the middle of the throat."""
    d, h, _ = record.extents_um().T
    return {
        **record.time_and_place(),
        "diameter_d_um": d,
        "diameter_h_um": h,
        "deformation_index": deformation_index(d, h)[0],
        "volume_ratio": record.column("volume_ratio"),
        "area_ratio": record.column("area_ratio"),
    }
