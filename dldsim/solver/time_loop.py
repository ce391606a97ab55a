"""Time loop of one cell in one fluid, compiled from event to event.

Order of a step: membrane and contact forces, spreading, streaming and collision, interpolation,
motion. Fluid velocity and vertex positions belong to the same instant, half the force included.
"""

from typing import NamedTuple

import numpy as np

from dldsim.solver.contact import Contact, contact_forces
from dldsim.solver.images import images_share
from dldsim.solver.immersed_boundary import (
    Domain,
    Stencil,
    clear,
    interpolate,
    interpolate_both,
    locate,
    surround,
)
from dldsim.solver.jit import jit
from dldsim.solver.lattice import Lattice
from dldsim.solver.membrane import Membrane, Moduli, Scratch
from dldsim.solver.membrane_forces import elastic_forces, vertex_normals
from dldsim.solver.mirror import Mirror, reflect, spread_both
from dldsim.solver.stream_collide import damp_staggered_momentum, stream_collide

MEMBRANE_SLIP = {
    "compact": (0.258, 0.044),
    "linear": (0.234, 0.036),
    "3-point": (0.298, 0.057),
    "4-point": (0.379, 0.09),
}
"""Velocity of a vertex through the fluid over t/ν, t the lasting force on it per area of membrane,
lattice units: along the membrane and across it, for each kernel.

Averaged by the kernel that spreads a force and again by the one that interpolates, the velocity of
a membrane lags behind that of a sharp one: along it, where the force bends the velocity profile, by
a constant part of t/ν; across it, where only the curvature of the flow counts, by a smaller one
that falls with the radius. The constants are those of a sphere of six nodes under uniform traction,
which in theory moves as a whole (`dldsim.evidence.drag`)."""
NORMAL_INTERVAL = 4  # steps between renewals of the vertices' normals
LASTING_BLEND = 0.05
"""Part of the running means of forces and force densities that each step replaces."""
CONTROL_INTERVAL = 20  # steps between corrections of the body force
DAMPING_INTERVAL = 100  # steps between dampings of staggered momentum, each half a step of delay
CONTROL_TIME = 600.0  # steps in which a deviation of the mean velocity is corrected


class Drive(NamedTuple):
    """Control of the body force: f += gain · (target - mean velocity), x and y.

    With a cell in every domain the mean velocity ⟨u⟩ is K f + δ: what the force f drives without
    cells, and what they do, δ. The flow that meets a cell is K f + L δ, with the images' part of δ
    (`images.images_share`). The rest of δ is the cell's own, and in an endless array is spread
    over it. So a cell alone has the wanted flow where L ⟨u⟩ + (1 - L) K f is the target.

    ``gain`` (2, 2), zero for a scene without a drive; ``held`` (2, 2): L where images are taken
    out, else 1; ``unhindered`` (2, 2): (1 - L) K, else zero; ``target`` (2,); ``nodes`` of fluid
    and ``volume`` of the box; ``middle``: nodes of a column whose last one is on a mirror and
    counts half, 0 if there is none; ``mean`` (2,): see `mean_velocity`.
    """

    gain: np.ndarray
    held: np.ndarray
    unhindered: np.ndarray
    target: np.ndarray
    nodes: int
    volume: float
    middle: int
    mean: np.ndarray


def make_drive(
    lattice: Lattice, mobility=None, target=(0.0, 0.0), *, axial: bool = False, dilute: bool = False
) -> Drive:
    """Control towards the mean velocity ``target`` (2,), lattice units.

    ``mobility`` K (2, 2): mean velocity per force density without a cell; None leaves the body
    force as it is. ``axial``: only its part along x is changed. ``dilute``: see `Drive`.
    """
    gain, held, unhindered = np.zeros((2, 2)), np.eye(2), np.zeros((2, 2))
    if mobility is not None:
        changed = np.diag([mobility[0, 0], np.inf]) if axial else mobility
        gain = np.linalg.inv(changed) * (CONTROL_INTERVAL / CONTROL_TIME)
        if dilute:
            along, across = (lattice.nx, lattice.row_shift), (0, lattice.ny)
            held = images_share(along, across, mobility)
            unhindered = (np.eye(2) - held) @ mobility
    return Drive(
        gain,
        held,
        unhindered,
        np.asarray(target, float),
        lattice.nodes,
        float(lattice.volume),
        lattice.nz * lattice.split,
        np.zeros(2),
    )


class Body(NamedTuple):
    """State of the membrane: position, velocity and force of the vertices (V, 3).

    ``smooth``: running mean of the velocity on which dashpots (no-slip) or drag act; no-slip:
    ``kick`` is the force density of the step at the vertices and ``lead`` its running mean,
    ``lasting`` that of the force; ``normal`` points outward, of any length. Of half a membrane
    ``x``, ``v``, ``smooth`` and ``normal`` hold images too, which `mirror.reflect` renews but in
    ``normal``, where they are not complete.
    """

    x: np.ndarray
    v: np.ndarray
    smooth: np.ndarray
    force: np.ndarray
    drag: np.ndarray
    kick: np.ndarray
    lead: np.ndarray
    lasting: np.ndarray
    normal: np.ndarray


class Elasticity(NamedTuple):
    """What the forces of a membrane follow from: see :mod:`dldsim.solver.membrane_forces`."""

    membrane: Membrane
    moduli: Moduli
    scratch: Scratch


class Coupling(NamedTuple):
    """Where a membrane meets its images, the nodes of the fluid, and solids."""

    mirror: Mirror
    domain: Domain
    stencil: Stencil
    contact: Contact


class NoSlip(NamedTuple):
    """``blend``: part of the running mean of vertex velocities that each step replaces; ``slip``
    (2, V): velocity through the fluid over the lasting force along the membrane and across it,
    MEMBRANE_SLIP over ν and a vertex's area."""

    blend: float
    slip: np.ndarray


class Drag(NamedTuple):
    """``blend``: part of the running mean of the fluid's velocity that each step replaces;
    ``friction`` and ``mass`` of a vertex."""

    blend: float
    friction: float
    mass: float


@jit
def mean_velocity(velocity, drive):
    """Fill ``drive.mean``: mean velocity along x and y over the whole box."""
    stride = len(velocity) // 3
    for d in range(2):
        total = 0.0
        for i in range(drive.nodes):
            total += velocity[d * stride + i]
        if drive.middle:
            for i in range(drive.middle - 1, drive.nodes, drive.middle):
                total -= 0.5 * velocity[d * stride + i]
        drive.mean[d] = total / drive.volume


@jit
def step_fluid(step, fluid, before, drive, everywhere):
    """Time step number ``step`` of the fluid under the force density of the membrane.

    The velocity is that of the step ``everywhere`` or, if need be only there, near the membrane.

    Now and then the body force is corrected towards the target of the drive, and staggered
    momentum is damped, for which ``before`` is room for populations.
    """
    damping = step % DAMPING_INTERVAL == DAMPING_INTERVAL - 1
    if damping:
        before[:] = fluid.f
    control = step % CONTROL_INTERVAL == CONTROL_INTERVAL - 1
    near = fluid.near[:0] if control or everywhere else fluid.near
    stream_collide(step, fluid.f, fluid.force, fluid.velocity, near, fluid.scheme)
    parameters = fluid.scheme.parameters
    if control:
        mean_velocity(fluid.velocity, drive)
        fx, fy = parameters.body_force[0], parameters.body_force[1]
        for e in range(2):
            met = drive.held[e, 0] * drive.mean[0] + drive.held[e, 1] * drive.mean[1]
            met += drive.unhindered[e, 0] * fx + drive.unhindered[e, 1] * fy
            for d in range(2):
                parameters.body_force[d] += drive.gain[d, e] * (drive.target[e] - met)
    if damping:
        damp_staggered_momentum(fluid.f, before, fluid.scheme)


@jit
def advance_no_slip(start, steps, fluid, before, body, elasticity, coupling, drive, motion):
    """An even number of steps, from the even step ``start``, with vertices moving with the fluid
    (Peskin 2002).

    Leapfrog: a vertex moves with the velocity half a step ahead, which holds the whole force of
    the step. With that of the present, half the force, every elastic mode would grow by ω²/4 per
    step but for viscosity. Of a force that lasts, this lead would be a slip through the fluid, and
    its running mean is left out. Through the fluid the vertices move by ``motion.slip`` times the
    parts of the lasting force along the membrane and across it, which takes energy out of any
    motion. Dashpots act on a running mean of the velocity (`NoSlip`).
    """
    membrane, moduli, scratch = elasticity
    mirror, domain, stencil, contact = coupling
    for step in range(start, start + steps):
        reflect(body.x, body.v, body.smooth, mirror)
        elastic_forces(body.x, body.smooth, membrane, moduli, scratch, body.force)
        contact_forces(body.x, contact, body.force)
        locate(body.x, domain, stencil)
        clear(fluid.force, fluid.near)
        surround(domain, stencil, fluid.near)
        spread_both(body.force, stencil, domain, mirror, fluid.near, fluid.force)
        step_fluid(step, fluid, before, drive, step == start + steps - 1)
        interpolate_both(fluid.velocity, fluid.force, stencil, body.v, body.kick)
        if step % NORMAL_INTERVAL == 0:
            vertex_normals(scratch, body.normal)
        for i in range(body.force.shape[0]):
            along, square = 0.0, 0.0
            for d in range(3):
                body.lead[i, d] += LASTING_BLEND * (body.kick[i, d] - body.lead[i, d])
                body.lasting[i, d] += LASTING_BLEND * (body.force[i, d] - body.lasting[i, d])
                along += body.normal[i, d] * body.lasting[i, d]
                square += body.normal[i, d] * body.normal[i, d]
            along /= square
            for d in range(3):
                across = along * body.normal[i, d]
                slides = motion.slip[0, i] * (body.lasting[i, d] - across)
                slides += motion.slip[1, i] * across
                body.v[i, d] += 0.5 * (body.kick[i, d] - body.lead[i, d]) + slides
                body.x[i, d] += body.v[i, d]
                body.smooth[i, d] += motion.blend * (body.v[i, d] - body.smooth[i, d])


@jit
def advance_dissipative(start, steps, fluid, before, body, elasticity, coupling, drive, motion):
    """An even number of steps, from the even step ``start``, with vertices of given mass dragged by
    the fluid.

    Velocity Verlet; each vertex feels -γ(v - u) and the fluid the opposite (Ahlrichs & Dünweg
    1999), with a running mean of u (`Drag`). ``body.force`` carries the force of the previous step.
    """
    membrane, moduli, scratch = elasticity
    mirror, domain, stencil, contact = coupling
    for step in range(start, start + steps):
        for i in range(body.force.shape[0]):
            for d in range(3):
                body.v[i, d] += body.force[i, d] / (2.0 * motion.mass)
                body.x[i, d] += body.v[i, d]
        reflect(body.x, body.v, body.smooth, mirror)
        elastic_forces(body.x, body.v, membrane, moduli, scratch, body.force)
        contact_forces(body.x, contact, body.force)
        locate(body.x, domain, stencil)
        interpolate(fluid.velocity, fluid.force, 0.0, stencil, body.drag)
        for i in range(body.force.shape[0]):
            for d in range(3):
                body.smooth[i, d] += motion.blend * (body.drag[i, d] - body.smooth[i, d])
                body.drag[i, d] = motion.friction * (body.v[i, d] - body.smooth[i, d])
                body.force[i, d] -= body.drag[i, d]
                body.v[i, d] += body.force[i, d] / (2.0 * motion.mass)
        clear(fluid.force, fluid.near)
        surround(domain, stencil, fluid.near)
        spread_both(body.drag, stencil, domain, mirror, fluid.near, fluid.force)
        # The next step asks for velocities where the vertices will then be.
        step_fluid(step, fluid, before, drive, True)
