"""Time loop of one cell in one fluid, compiled from event to event.

Order of a step: membrane and contact forces, spreading, streaming and collision, interpolation,
motion. Fluid velocity and vertex positions belong to the same instant, half the force included.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dldsim.config.sections import Cell, Numerics, Stiffness
from dldsim.errors import DldsimError
from dldsim.solver.flow import Fluid
from dldsim.solver.immersed_boundary import (
    EVEN_ODD,
    Contact,
    clearance,
    contact_forces,
    interpolate,
    interpolate_both,
    locate,
    make_domain,
    make_stencil,
)
from dldsim.solver.jit import jit
from dldsim.solver.lattice import damp_staggered_momentum, stream_collide
from dldsim.solver.membrane import (
    Energies,
    Membrane,
    Moduli,
    Scratch,
    elastic_forces,
    energies,
    make_membrane,
    make_scratch,
    measure_faces,
    vertex_areas,
    vertex_normals,
)
from dldsim.solver.mesh import area, frequency_for_edge, make_shape
from dldsim.solver.mirror import NO_MIRROR, half_of, reflect, spread_both
from dldsim.solver.units import Units

REFERENCE_VERTEX_AREA_UM2 = 490.27 / 1962
"""Membrane area per vertex of the source mesh: friction, mass and contact are given for it."""
CONTACT_STRENGTH = 1e-4  # nN µm^2.2, per vertex of the source mesh
CONTACT_EXPONENT = 1.2
CONTACT_STIFFEST = 1.0
"""Largest slope of the repulsion, lattice units: at most a quarter of what a leapfrog step bears
on one vertex, whose kernel has at most half its weight squared on the nodes of a component."""
STABLE_GAIN = 0.6
"""Of dashpots or drag in one step, after the running mean: 0.7 held, 1.4 diverged."""
LINGERING = 0.1
"""The same part at most for kernels that feed staggered momentum, which answers every step."""
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
ITERATIONS = 50
STRAIN = 1e-5
"""Displacement, in nodes, of the differences that stand for a stiffness."""
CONTROL_INTERVAL = 20  # steps between corrections of the body force
DAMPING_INTERVAL = 100  # steps between dampings of staggered momentum, each half a step of delay
CONTROL_TIME = 600.0  # steps in which a deviation of the mean velocity is corrected


class Drive(NamedTuple):
    """Control of the body force: f += gain · (target - mean velocity), x and y.

    ``gain`` (2, 2); ``target`` (2,); ``nodes`` of fluid and ``volume`` of the box; ``middle``:
    nodes of a column whose last one is on a mirror and counts half, 0 if there is none.
    """

    gain: np.ndarray
    target: np.ndarray
    nodes: int
    volume: float
    middle: int


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


@jit
def mean_velocity(velocity, drive, mean):
    """Mean velocity along x and y over the whole box."""
    stride = len(velocity) // 3
    for d in range(2):
        total = 0.0
        for i in range(drive.nodes):
            total += velocity[d * stride + i]
        if drive.middle:
            for i in range(drive.middle - 1, drive.nodes, drive.middle):
                total -= 0.5 * velocity[d * stride + i]
        mean[d] = total / drive.volume


@jit
def control_force(velocity, drive, parameters, mean):
    """Correct the body force (parameters 4 and 5) towards the target mean velocity."""
    mean_velocity(velocity, drive, mean)
    for d in range(2):
        for e in range(2):
            parameters[4 + d] += drive.gain[d, e] * (drive.target[e] - mean[e])


@jit
def advance_no_slip(
    start,
    steps,
    f,
    f_new,
    force,
    velocity,
    streaming,
    parameters,
    inertia,
    buf,
    body,
    membrane,
    moduli,
    scratch,
    mirror,
    stencil,
    domain,
    contact,
    drive,
    mean,
    before,
    blend,
    slip,
):
    """An even number of steps, from the even step ``start``, with vertices moving with the fluid
    (Peskin 2002).

    Leapfrog: a vertex moves with the velocity half a step ahead, which holds the whole force of
    the step. With that of the present, half the force, every elastic mode would grow by ω²/4 per
    step but for viscosity. Of a force that lasts, this lead would be a slip through the fluid, and
    its running mean is left out. Through the fluid the vertices move by ``slip`` (2, V) times the
    parts of the lasting force along the membrane and across it: MEMBRANE_SLIP over ν and a vertex's
    area, which takes energy out of any motion. ``before``: room for populations, of which staggered
    momentum is damped now and then. Dashpots act on a running mean of the velocity, of which each
    step replaces the part ``blend``.
    """
    for step in range(steps):
        reflect(body.x, body.v, body.smooth, mirror)
        elastic_forces(body.x, body.smooth, membrane, moduli, scratch, body.force)
        contact_forces(body.x, contact, body.force)
        locate(body.x, domain, stencil)
        force[:] = 0.0
        spread_both(body.force, stencil, domain, mirror, force)
        damping = (start + step) % DAMPING_INTERVAL == DAMPING_INTERVAL - 1
        if damping:
            before[:] = f_new
        if step % 2 == 0:
            stream_collide(f, f_new, force, velocity, streaming, parameters, inertia, buf)
        else:
            stream_collide(f_new, f, force, velocity, streaming, parameters, inertia, buf)
        interpolate_both(velocity, force, stencil, body.v, body.kick)
        if (start + step) % NORMAL_INTERVAL == 0:
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
                slides = slip[0, i] * (body.lasting[i, d] - across) + slip[1, i] * across
                body.v[i, d] += 0.5 * (body.kick[i, d] - body.lead[i, d]) + slides
                body.x[i, d] += body.v[i, d]
                body.smooth[i, d] += blend * (body.v[i, d] - body.smooth[i, d])
        if (start + step) % CONTROL_INTERVAL == CONTROL_INTERVAL - 1:
            control_force(velocity, drive, parameters, mean)
        if damping:
            damp_staggered_momentum(f, before, parameters[11])


@jit
def advance_dissipative(
    start,
    steps,
    f,
    f_new,
    force,
    velocity,
    streaming,
    parameters,
    inertia,
    buf,
    body,
    membrane,
    moduli,
    scratch,
    mirror,
    stencil,
    domain,
    contact,
    drive,
    mean,
    before,
    friction,
    mass,
    blend,
):
    """An even number of steps, from the even step ``start``, with vertices of given mass dragged by
    the fluid.

    Velocity Verlet; each vertex feels -γ(v - u) and the fluid the opposite (Ahlrichs & Dünweg
    1999), with a running mean of u of which each step replaces the part ``blend``. ``body.force``
    carries the force of the previous step.
    """
    for step in range(steps):
        for i in range(body.force.shape[0]):
            for d in range(3):
                body.v[i, d] += body.force[i, d] / (2.0 * mass)
                body.x[i, d] += body.v[i, d]
        reflect(body.x, body.v, body.smooth, mirror)
        elastic_forces(body.x, body.v, membrane, moduli, scratch, body.force)
        contact_forces(body.x, contact, body.force)
        locate(body.x, domain, stencil)
        interpolate(velocity, force, 0.0, stencil, body.drag)
        for i in range(body.force.shape[0]):
            for d in range(3):
                body.smooth[i, d] += blend * (body.drag[i, d] - body.smooth[i, d])
                body.drag[i, d] = friction * (body.v[i, d] - body.smooth[i, d])
                body.force[i, d] -= body.drag[i, d]
                body.v[i, d] += body.force[i, d] / (2.0 * mass)
        force[:] = 0.0
        spread_both(body.drag, stencil, domain, mirror, force)
        damping = (start + step) % DAMPING_INTERVAL == DAMPING_INTERVAL - 1
        if damping:
            before[:] = f_new
        if step % 2 == 0:
            stream_collide(f, f_new, force, velocity, streaming, parameters, inertia, buf)
        else:
            stream_collide(f_new, f, force, velocity, streaming, parameters, inertia, buf)
        if (start + step) % CONTROL_INTERVAL == CONTROL_INTERVAL - 1:
            control_force(velocity, drive, parameters, mean)
        if damping:
            damp_staggered_momentum(f, before, parameters[11])


@jit
def fastest(velocity, nodes):
    """Largest speed on the fluid nodes; NaN if any velocity is not finite."""
    stride = len(velocity) // 3
    most = 0.0
    for i in range(nodes):
        u, v, w = velocity[i], velocity[stride + i], velocity[2 * stride + i]
        speed2 = u * u + v * v + w * w
        if not speed2 < 1e30:
            return np.nan
        most = max(most, speed2)
    return np.sqrt(most)


@jit
def centroid(x, faces, centre):
    """Centroid of the enclosed volume."""
    total = 0.0
    centre[:] = 0.0
    for n in range(faces.shape[0]):
        a, b, c = faces[n, 0], faces[n, 1], faces[n, 2]
        ax, ay, az = x[a, 0] - x[0, 0], x[a, 1] - x[0, 1], x[a, 2] - x[0, 2]
        bx, by, bz = x[b, 0] - x[0, 0], x[b, 1] - x[0, 1], x[b, 2] - x[0, 2]
        cx, cy, cz = x[c, 0] - x[0, 0], x[c, 1] - x[0, 1], x[c, 2] - x[0, 2]
        part = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
        total += part
        centre[0] += part * (ax + bx + cx)
        centre[1] += part * (ay + by + cy)
        centre[2] += part * (az + bz + cz)
    for d in range(3):
        centre[d] = x[0, d] + centre[d] / (4.0 * total)


@jit
def inverted_faces(normals, membrane):
    """Number of faces whose normal points against those of all three neighbours."""
    count = 0
    nx, ny, nz = normals
    for f in range(len(nx)):
        against = 0
        for k in range(3):
            pair = membrane.edge_faces[membrane.face_edges[f, k]]
            g = pair[0] + pair[1] - f
            against += nx[f] * nx[g] + ny[f] * ny[g] + nz[f] * nz[g] < 0
        count += against == 3
    return count


def deformation_index(extent_x, extent_y):
    """DI = (a - b)/(a + b) of the bounding box of the profile seen along z, and a, b."""
    a, b = np.maximum(extent_x, extent_y), np.minimum(extent_x, extent_y)
    return (a - b) / (a + b), a, b


def largest_gain(scene: "CellInFlow", push) -> float:
    """Largest eigenvalue of W A, by power iteration, a few per cent too low.

    ``push(mode, force)`` fills the forces (V, 3) that vertex displacements or velocities (V, 3)
    cause, −A mode; W = J Jᵀ is the velocity that unit forces, spread to the fluid (Jᵀ), give back
    to the vertices (J) within the step. Half a scene has symmetric modes only.
    """
    x, stencil = scene.body.x, scene.stencil
    locate(x, scene.domain, stencil)
    mode = np.random.default_rng(0).normal(size=scene.positions().shape)
    share, still = 1.0, x.copy()
    if scene.half:
        mode, share = scene.half.fold(mode), scene.half.share
    force, answer = np.zeros_like(scene.body.force), np.zeros_like(scene.body.force)
    count = len(force)
    density, nothing = np.zeros_like(scene.fluid.force), np.zeros_like(scene.fluid.force)
    gain = 0.0
    for _ in range(ITERATIONS):
        mode *= STRAIN / np.linalg.norm(mode)
        push(mode, force)
        density[:] = 0
        spread_both(force, stencil, scene.domain, scene.mirror, density)
        interpolate(density, nothing, 0.0, stencil, answer)
        # Rayleigh quotient in the norm of A, in which W A is self-adjoint.
        work = np.vdot(share * force, mode[:count])
        gain = -np.vdot(share * force, answer) / work if work else 0.0
        mode[:count] = answer
        reflect(still, mode, mode, scene.mirror)
    return float(gain)


def velocity_blend(scene: "CellInFlow") -> float:
    """Part of the running mean of vertex velocities that each step replaces.

    Dashpots (no-slip) or drag (dissipative) answer the velocity of the step before. Where that
    changes the velocity by up to ``gain`` times itself within a step, the mean is that of the next
    whole number of steps above gain/0.6; from twice that on it was seen to diverge.
    """
    body = scene.body
    if scene.numerics.coupling == "dissipative":

        def push(mode, force):
            force[:] = -scene.friction * mode[: len(force)]
    elif scene.moduli.kvisc:
        alone = Moduli(0.0, 0.0, 0.0, 0.0, 0.0, scene.moduli.kvisc)

        def push(mode, force):
            elastic_forces(body.x, mode, scene.membrane, alone, scene.scratch, force)
    else:
        return 1.0
    largest = 1.0 if scene.numerics.kernel in EVEN_ODD else LINGERING
    return min(largest, 1 / math.ceil(largest_gain(scene, push) / STABLE_GAIN))


def volume_stiffness(kv: float, area: float, volume: float, viscosity: float) -> float:
    """Volume constant k_v that the explicit step can carry, lattice units.

    The volume oscillates against the fluid in the kernel, a layer about one node thick, with
    ω² = k_v A/V; leapfrog needs ω² < 4, and a fluid that is compressible itself (bulk modulus 1/3)
    less. Inside an impermeable membrane the fluid already keeps the volume: k_v only answers
    numerical leakage, whose size each run records, and is limited to ω² = 2, and to 40 ν where
    little viscosity damps (held: 4 at τ = 0.8 to 2, 2 at τ = 0.6; diverged: 8 and 4).
    """
    return min(kv, min(2.0, 40 * viscosity) * volume / area)


def vertex_mass(friction: float, moduli: Moduli) -> float:
    """Vertex mass of the dissipative coupling, lattice units; numerical, without a physical role.

    The source's ratio of relaxation time to time step, m/(γΔt) = 1/0.156, would make the membrane
    sluggish at the larger steps used here. The mass is the smallest that meets the explicit limits
    γΔt/m < 2, 9 k_visc Δt/m < 2 and k < 4m/(6Δt²), each by a factor of two.
    """
    stiffest = max(moduli.ks + moduli.kal, moduli.kb)
    return max(2 * friction, 9 * moduli.kvisc, 3 * stiffest)


@dataclass(frozen=True)
class Sample:
    """What is recorded of a cell at one instant; lattice units.

    ``inverted``: share of the faces that are turned against all three neighbours.
    """

    step: int
    centre: np.ndarray
    velocity: np.ndarray
    extent: np.ndarray
    volume_ratio: float
    area_ratio: float
    clearance: float
    speed_max: float
    mean_velocity: np.ndarray
    inverted: float = 0.0

    def trouble(self) -> str | None:
        """Why the run has left its safe range, or None."""
        if not np.isfinite([*self.centre, self.speed_max, self.volume_ratio]).all():
            return "a value is not finite"
        if self.speed_max > 0.35:
            return f"fluid speed {self.speed_max:.2f} exceeds 0.35 (lattice units)"
        if self.clearance < -1:
            return f"a vertex is {-self.clearance:.1f} nodes inside a solid"
        if abs(self.volume_ratio - 1) > 0.2:
            return f"cell volume drifted by {self.volume_ratio - 1:+.0%}"
        if abs(self.area_ratio - 1) > 0.5:
            return f"cell area drifted by {self.area_ratio - 1:+.0%}"
        if self.inverted > 0.05:
            return f"{self.inverted:.0%} of the membrane's faces are inverted"
        return None


class CellInFlow:
    """A cell in a fluid: owns the arrays of both and advances them together."""

    def __init__(
        self,
        fluid: Fluid,
        units: Units,
        cell: Cell,
        stiffness: Stiffness,
        numerics: Numerics,
        contact_surfaces: dict,
        mobility: np.ndarray,
        target: np.ndarray,
    ):
        """``contact_surfaces``: fields of :class:`dldsim.solver.immersed_boundary.Contact` that
        name surfaces; ``mobility`` (2, 2) and ``target`` (2,): mean velocity per force, and wanted,
        lattice units.
        """
        self.fluid, self.units, self.numerics = fluid, units, numerics
        spacing = units.spacing_um
        radius = cell.radius_um / spacing
        shape = {"aspect_ratio": cell.aspect_ratio} if cell.shape == "ellipsoid" else {}
        self._make = lambda n: make_shape(cell.shape, radius, n, axis=cell.axis, **shape)
        probe = area(*self._make(8))
        vertices, faces = self._make(frequency_for_edge(probe, numerics.edge_to_spacing))
        self.membrane = make_membrane(vertices, faces)
        self.scratch = make_scratch(self.membrane)
        self.half, self.mirror = None, NO_MIRROR
        v = computed = len(vertices)
        if fluid.lattice.half:
            self.half = half_of(vertices, self.membrane, self.scratch)
            self.membrane, self.scratch = self.half.membrane, self.half.scratch
            self.mirror = self.half.mirror
            vertices, computed = vertices[self.half.vertex], len(self.half.share)
        self.stiffness = stiffness
        self.moduli = self.moduli_in(units)
        self.radius_um = cell.radius_um
        lattice = fluid.lattice
        self.body = Body(
            vertices.copy(),
            *(np.zeros_like(vertices) for _ in range(2)),
            *(np.zeros((computed, 3)) for _ in range(5)),
            np.zeros_like(vertices),
        )
        self.stencil = make_stencil(computed, numerics.kernel, fluid.dtype)
        self.domain = make_domain(lattice, fluid.dtype)
        # Friction, mass and contact belong to a patch of membrane, whatever the mesh.
        self.density = self.membrane.rest_area * spacing**2 / v / REFERENCE_VERTEX_AREA_UM2
        n = CONTACT_EXPONENT
        strength = units.force(CONTACT_STRENGTH) * spacing ** -(n + 1) * self.density
        reach = max(numerics.contact_range_um / spacing, 1e-9)
        core = (strength * n * (n + 1) / CONTACT_STIFFEST) ** (1 / (n + 2))
        no_surface = {
            "pillars": False,
            "pitch": 1.0,
            "row_shift": 0.0,
            "radius": 0.0,
            "plates": False,
            "height": 0.0,
            "channel": False,
            "profile": np.zeros((2, 1)),
            "centre": 0.0,
            "length": 1.0,
        }
        self.contact = Contact(
            strength=np.full(len(vertices), strength),
            exponent=CONTACT_EXPONENT,
            reach=reach,
            core=min(core, reach),
            **{**no_surface, **contact_surfaces},
        )
        gain = np.linalg.inv(mobility) * (CONTROL_INTERVAL / CONTROL_TIME)
        self.drive = Drive(
            gain,
            np.asarray(target, float),
            lattice.nodes,
            float(lattice.volume),
            lattice.nz * lattice.split,
        )
        self._mean = np.zeros(2)
        self._before = np.zeros_like(fluid.f)
        self.friction = units.friction(numerics.friction_nN_s_per_m) * self.density
        along, across = MEMBRANE_SLIP[numerics.kernel]
        areas = vertex_areas(self.membrane)[:computed] * units.viscosity_lu
        self.slip = np.stack([along / areas, across / areas])
        self.mass = vertex_mass(self.friction, self.moduli)
        self._centre = np.zeros(3)
        self.steps = 0

    @property
    def vertices(self) -> int:
        """Number of vertices that are computed."""
        return len(self.body.force)

    @property
    def surface(self) -> tuple[Membrane, Scratch]:
        """The whole membrane, whose vertices are at `positions`, and work space for it."""
        if self.half:
            return self.half.whole, self.half.whole_scratch
        return self.membrane, self.scratch

    def positions(self) -> np.ndarray:
        """Positions (V, 3) of the vertices of the whole membrane."""
        return self.half.unfold(self.body.x, self.mirror.height) if self.half else self.body.x

    def moduli_in(self, units: Units) -> Moduli:
        """Membrane coefficients in lattice units; k_v as far as the explicit step carries it."""
        moduli = units.stiffness(self.stiffness)
        kv = volume_stiffness(
            moduli["kv"], self.membrane.rest_area, self.membrane.rest_volume, units.viscosity_lu
        )
        return Moduli(**(moduli | {"kv": kv}))

    def place(self, centre) -> None:
        """Move the resting cell to ``centre`` (3,), where it takes the velocity of the fluid.

        Raises DldsimError for a place off the mirror, if there is one.
        """
        body, lattice = self.body, self.fluid.lattice
        body.x[:] += np.asarray(centre) - self._centroid()
        if self.half:
            if centre[2] != lattice.height / 2:
                raise DldsimError(
                    f"A cell at a height of {centre[2]:g} nodes has no half: allowed is "
                    f"{lattice.height / 2:g}, half the channel's. Set numerics.half_scene: false."
                )
            self.mirror = self.mirror._replace(height=float(centre[2]))
            reflect(body.x, body.v, body.smooth, self.mirror)
        locate(body.x, self.domain, self.stencil)
        interpolate(self.fluid.velocity, self.fluid.force, 0.0, self.stencil, body.v)
        reflect(body.x, body.v, body.smooth, self.mirror)
        body.smooth[:] = body.v
        self.blend = velocity_blend(self)

    def advance(self, steps: int) -> None:
        """Advance by an even number of steps."""
        fluid = self.fluid
        state = (
            fluid.f,
            fluid.f_new,
            fluid.force,
            fluid.velocity,
            fluid.lattice.streaming,
            fluid.parameters,
            fluid.inertia,
            fluid.buffer,
            self.body,
            self.membrane,
            self.moduli,
            self.scratch,
            self.mirror,
            self.stencil,
            self.domain,
            self.contact,
            self.drive,
            self._mean,
            self._before,
        )
        if self.numerics.coupling == "no-slip":
            advance_no_slip(self.steps, steps, *state, self.blend, self.slip)
        else:
            advance_dissipative(self.steps, steps, *state, self.friction, self.mass, self.blend)
        self.steps += steps

    def _centroid(self) -> np.ndarray:
        centroid(self.positions(), self.surface[0].faces, self._centre)
        return self._centre.copy()

    def sample(self) -> Sample:
        """Record the present state."""
        x, velocity = self.positions(), self.body.v
        if self.half:
            velocity = self.half.unfold(velocity)
        membrane, scratch = self.surface
        size, volume = measure_faces(x, scratch)
        mean_velocity(self.fluid.velocity, self.drive, self._mean)
        return Sample(
            self.steps,
            self._centroid(),
            velocity.mean(axis=0),
            np.ptp(x, axis=0),
            volume / membrane.rest_volume,
            size / membrane.rest_area,
            clearance(x, self.contact),
            float(fastest(self.fluid.velocity, self.fluid.lattice.nodes)),
            self._mean.copy(),
            inverted_faces(scratch.normals, membrane) / len(membrane.faces),
        )

    def energies(self) -> Energies:
        """Elastic energy of each term, lattice units."""
        membrane, scratch = self.surface
        return energies(self.positions(), membrane, self.moduli, scratch)
