"""A straight rectangular channel through which a cell is carried until its shape is steady.

The flow is along x, the picture is taken along z, as in real-time deformability cytometry (Otto et
al. 2015, Nat. Methods 12:199). The domain repeats along the flow.
"""

from functools import partial

import numpy as np

from dldsim.config.assay_sections import ChannelAssay
from dldsim.config.feasibility import check_fits
from dldsim.config.sections import Cell, Flow, Numerics, Stiffness
from dldsim.experiments.constriction import Channel, scene_in, steady_start
from dldsim.experiments.outcome_files import Measured
from dldsim.experiments.passage import box_index, carry_until_steady, radius_steps, refined_step
from dldsim.experiments.runner import Progress, again_if_unstable
from dldsim.solver.flow import Fluid
from dldsim.solver.lattice import make_lattice
from dldsim.solver.scene import CellInFlow

TRAVEL = 4.0
"""Travel of the mean flow, in radii of the cell, over which a steady shape must not change."""
SAMPLES_PER_RADIUS = 4


def make_channel(assay: ChannelAssay, numerics: Numerics) -> Channel:
    """Lay the channel on a lattice that divides its width into an even number of nodes.

    Raises DldsimError for a lattice without fluid.
    """
    width = 2 * max(1, round(assay.width_um / assay.spacing_um / 2))
    spacing = assay.width_um / width
    height, length = round(assay.height_um / spacing), round(assay.period_um / spacing)
    solid = np.zeros((length, width + 1), bool)
    solid[:, 0] = True
    lattice = make_lattice(
        solid, height, walls=True, half=numerics.half_scene, dtype=np.dtype(numerics.precision)
    )
    profile = np.array([[0.0, length], [width / 2, width / 2]])
    return Channel(spacing, width, width, height, (0.0, float(length)), profile, lattice)


def simulate_channel(
    stiffness: Stiffness,
    assay: ChannelAssay,
    cell: Cell,
    flow: Flow,
    numerics: Numerics,
    *,
    offset_um: float = 0.0,
    run_id: str,
    progress: Progress = None,
) -> Measured:
    """Carry one cell along the channel and measure its shape once that is steady.

    The cell starts at mid-height, ``offset_um`` off the axis across the picture. A shape is steady
    when neither index changes by more than ``assay.steady_change`` over a travel of the mean flow
    of TRAVEL radii; a cell that has not become so within ``assay.travel_max_um`` has no index.

    Raises DldsimError for a cell that does not fit, and for a run that takes too long.
    """
    check_fits(assay, cell, offset_um)
    attempt = partial(
        _simulate, stiffness, assay, cell, flow, numerics, offset_um, run_id, progress
    )
    return again_if_unstable(attempt, numerics, progress)


def _simulate(stiffness, assay, cell, flow, numerics, offset_um, run_id, progress, shorter):
    """One attempt; ``shorter``: time step asked of it over that which is used."""
    scene = channel_scene(stiffness, assay, cell, flow, numerics, offset_um, shorter, progress)
    steps = radius_steps(scene)
    return carry_until_steady(
        scene,
        stiffness,
        run_id,
        box_index,
        chunk=2 * max(1, round(steps / SAMPLES_PER_RADIUS / 2)),
        window=round(TRAVEL * SAMPLES_PER_RADIUS),
        limit=assay.travel_max_um / cell.radius_um * steps,
        tolerance=assay.steady_change,
        swings=False,
        progress=progress,
    )


def channel_scene(
    stiffness: Stiffness,
    assay: ChannelAssay,
    cell: Cell,
    flow: Flow,
    numerics: Numerics,
    offset_um: float = 0.0,
    shorter: float = 1.0,
    progress: Progress = None,
) -> CellInFlow:
    """A cell at rest in the steady flow of the channel, at mid-height. ``shorter``: time step asked
    of it over that which is used.

    Raises DldsimError for a run that takes too long.
    """
    channel = make_channel(assay, numerics)
    spacing = channel.spacing_um
    flow = flow.model_copy(update={"mean_velocity_mm_s": assay.mean_velocity_mm_s})
    fluid = Fluid.of(channel.lattice, numerics)
    place = channel.length / 2, channel.centre + offset_um / spacing, channel.height / 2
    numerics = refined_step(
        lambda given: scene_in(channel, fluid, flow, cell, stiffness, given),
        place,
        numerics,
        shorter,
        assay.travel_max_um / spacing,
        progress,
    )
    mobility = steady_start(fluid, channel, numerics.velocity_lu, progress)
    scene = scene_in(channel, fluid, flow, cell, stiffness, numerics, mobility)
    scene.place(place)
    return scene
