"""The scene of an array run: a cell at its place of release, in the flow of the empty array."""

from dldsim.config.sections import CELL_NUMERICS, Cell, Flow, Geometry, Numerics, Stiffness
from dldsim.errors import DldsimError, NoRoom
from dldsim.experiments.settled import row_origin
from dldsim.solver.flow import EmptyFlow, Fluid
from dldsim.solver.pillars import ArrayLattice
from dldsim.solver.scene import CellInFlow
from dldsim.solver.time_loop import make_drive
from dldsim.solver.units import Units

RELEASE_CLEARANCE = 0.5
"""Least distance, in nodes, between membrane and solids at release."""


def check_flow(empty_flow: EmptyFlow, geometry: Geometry, flow: Flow, numerics: Numerics) -> None:
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
        make_drive(
            array.lattice,
            empty_flow.mobility,
            (numerics.velocity_lu, 0.0),
            axial=flow.drive == "axial",
            dilute=numerics.images == "dilute",
        )
        if driven
        else None,
    )
    gap = array.pitch - 2 * array.radius
    lateral = row_origin(array, 0)[1] + array.radius + cell.release_gap_fraction * gap
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
