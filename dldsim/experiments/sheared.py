"""A cell with the campaign's membrane in simple shear between moving plates, as an assay.

The plates move along x, the picture is taken along z, the velocity gradient, as the laser of an
ektacytometer looks (Hardeman et al. 2007, Handbook of Hemorheology and Hemodynamics, p. 242).
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from dldsim.config.assay_sections import ShearAssay
from dldsim.config.sections import Cell, Flow, Numerics, Stiffness
from dldsim.experiments.outcome_files import Measured
from dldsim.experiments.passage import (
    carry_until_steady,
    elongation_index,
    radius_steps,
    refined_step,
)
from dldsim.experiments.runner import Progress, again_if_unstable
from dldsim.experiments.shear import start_shear
from dldsim.solver.flow import Fluid
from dldsim.solver.lattice import make_lattice
from dldsim.solver.membrane import Moduli
from dldsim.solver.scene import CellInFlow
from dldsim.solver.units import Units

BOX = 6.5, 6.0, 8.0
"""Length, width and height of the box over the radius: see `shear.capsule_in_shear`."""
SAMPLES_PER_STRAIN = 5


def simulate_shear(
    stiffness: Stiffness,
    assay: ShearAssay,
    cell: Cell,
    flow: Flow,
    numerics: Numerics,
    *,
    run_id: str,
    progress: Progress = None,
) -> Measured:
    """Shear one cell at a given stress until its elongation, averaged over a window, is steady.

    The cell sits midway between the plates. The velocity in Ca = μU/k_s is that of the shear over a
    radius, U = γ̇R. Raises DldsimError for a run that takes too long.
    """
    attempt = partial(_simulate, stiffness, assay, cell, flow, numerics, run_id, progress)
    return again_if_unstable(attempt, numerics, progress)


def _simulate(stiffness, assay, cell, flow, numerics, run_id, progress, shorter) -> Measured:
    """One attempt; ``shorter``: time step asked of it over that which is used."""
    scene = sheared_scene(stiffness, assay, cell, flow, numerics, shorter, progress)
    steps = radius_steps(scene)
    return carry_until_steady(
        scene,
        stiffness,
        run_id,
        elongation_index,
        chunk=2 * max(1, round(steps / SAMPLES_PER_STRAIN / 2)),
        window=round(assay.strain_window * SAMPLES_PER_STRAIN),
        limit=assay.strain_max * steps,
        tolerance=assay.steady_change,
        swings=True,
        progress=progress,
    )


def sheared_scene(
    stiffness: Stiffness | Callable[[Units], Moduli],
    assay: ShearAssay,
    cell: Cell,
    flow: Flow,
    numerics: Numerics,
    shorter: float = 1.0,
    progress: Progress = None,
) -> CellInFlow:
    """A cell at rest midway between the plates, in steady shear; the velocity of its units is that
    over a radius, so that `passage.radius_steps` are a strain of 1. ``shorter``: time step asked of
    it over that which is used.

    Raises DldsimError for a run that takes too long.
    """
    radius = assay.nodes_per_radius
    rate_per_ms = assay.stress_Pa / flow.viscosity_mPa_s
    flow = flow.model_copy(update={"mean_velocity_mm_s": rate_per_ms * cell.radius_um})
    nx, ny, nz = (round(radii * radius) for radii in BOX)

    def make_scene(numerics: Numerics) -> CellInFlow:
        rate = numerics.velocity_lu / radius
        plates = -rate * nz / 2, rate * nz / 2
        lattice = make_lattice(
            np.zeros((nx, ny), bool),
            nz,
            walls=True,
            wall_velocities=plates,
            dtype=np.dtype(numerics.precision),
        )
        fluid = Fluid.of(lattice, numerics)
        start_shear(fluid, rate)
        units = Units.of(cell.radius_um / radius, flow, numerics)
        return CellInFlow(fluid, units, cell, stiffness, numerics, {})

    place = nx / 2, ny / 2, nz / 2
    travel = assay.strain_max * radius
    scene = make_scene(refined_step(make_scene, place, numerics, shorter, travel, progress))
    scene.place(place)
    return scene
