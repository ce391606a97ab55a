"""A cell in a fluid: mesh, moduli, contact and coupling of one scene, advanced together."""

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from dldsim.config.sections import CellShape, Numerics, Stiffness
from dldsim.errors import DldsimError
from dldsim.solver.contact import Contact, clearance
from dldsim.solver.flow import Fluid
from dldsim.solver.immersed_boundary import EVEN_ODD, interpolate, locate, make_domain, make_stencil
from dldsim.solver.membrane import (
    Energies,
    Membrane,
    Moduli,
    Scratch,
    energies,
    make_membrane,
    make_scratch,
    vertex_areas,
)
from dldsim.solver.membrane_forces import elastic_forces, measure_faces
from dldsim.solver.mesh import area, frequency_for_edge, make_shape
from dldsim.solver.mirror import NO_MIRROR, half_of, reflect, spread_both
from dldsim.solver.observe import Sample, centroid, fastest, inverted_faces
from dldsim.solver.time_loop import (
    MEMBRANE_SLIP,
    Body,
    Coupling,
    Drag,
    Drive,
    Elasticity,
    NoSlip,
    advance_dissipative,
    advance_no_slip,
    make_drive,
    mean_velocity,
)
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
ITERATIONS = 50
LARGEST_ASYMMETRY = 0.01
"""Of a shape that half a scene takes over, nodes."""
STRAIN = 1e-5
"""Displacement, in nodes, of the differences that stand for a stiffness."""


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
    everywhere = np.ones_like(scene.fluid.near)
    gain = 0.0
    for _ in range(ITERATIONS):
        mode *= STRAIN / np.linalg.norm(mode)
        push(mode, force)
        density[:] = 0
        spread_both(force, stencil, scene.domain, scene.mirror, everywhere, density)
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
    9 k_visc Δt/m < 2 and k < 4m/(6Δt²) by a factor of two, and γΔt/m < 2 by four.
    """
    stiffest = max(moduli.ks + moduli.kal, moduli.kb)
    return max(2 * friction, 9 * moduli.kvisc, 3 * stiffest)


def shape_at_rest(cell: CellShape, radius: float) -> Callable[[int], tuple[np.ndarray, np.ndarray]]:
    """Vertices and faces of a cell of largest ``radius`` by mesh frequency (`mesh.make_shape`)."""
    shape = {"aspect_ratio": cell.aspect_ratio} if cell.shape == "ellipsoid" else {}
    return partial(make_shape, cell.shape, radius, axis=cell.axis, **shape)


class CellInFlow:
    """A cell in a fluid: owns the arrays of both and advances them together."""

    def __init__(
        self,
        fluid: Fluid,
        units: Units,
        cell: CellShape,
        stiffness: Stiffness | Moduli | Callable[[Units], Moduli],
        numerics: Numerics,
        surfaces: Mapping[str, Any],
        drive: Drive | None = None,
    ):
        """``stiffness``: or `Moduli`, in lattice units, or what makes them of the units;
        ``surfaces``: fields of :class:`dldsim.solver.contact.Contact` that name surfaces; without a
        ``drive``
        (`time_loop.make_drive`) the body force stays as it is.
        """
        self.fluid, self.units, self.numerics = fluid, units, numerics
        spacing = units.spacing_um
        make = shape_at_rest(cell, cell.radius_um / spacing)
        probe = area(*make(8))
        vertices, faces = make(frequency_for_edge(probe, numerics.edge_to_spacing))
        self.membrane = make_membrane(vertices, faces)
        self.scratch = make_scratch(self.membrane)
        self.half, self.mirror = None, NO_MIRROR
        v = computed = len(vertices)
        if fluid.lattice.half:
            self.half = half_of(vertices, self.membrane, self.scratch)
            self.membrane, self.scratch = self.half.membrane, self.half.scratch
            self.mirror = self.half.mirror
            vertices, computed = vertices[self.half.vertex], len(self.half.share)
        if isinstance(stiffness, Stiffness):
            stiffness = Moduli(**units.stiffness(stiffness))
        elif not isinstance(stiffness, Moduli):
            stiffness = stiffness(units)
        self.moduli = stiffness._replace(
            kv=volume_stiffness(
                stiffness.kv, self.membrane.rest_area, self.membrane.rest_volume, units.viscosity_lu
            ),
            isotropic=numerics.area_forces == "gradient",
        )
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
        if core > reach:  # linear throughout, and no stiffer than a step bears
            strength = CONTACT_STIFFEST * reach ** (n + 2) / (n * (n + 1))
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
            **{**no_surface, **surfaces},
        )
        self.drive = drive or make_drive(lattice)
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
                    f"{lattice.height / 2:g}, half the channel's.",
                    key="numerics.half_scene",
                    value=True,
                    remedy="Set numerics.half_scene: false.",
                )
            self.mirror = self.mirror._replace(height=float(centre[2]))
        self._follow()
        self.blend = velocity_blend(self)

    def deform(self, positions: np.ndarray) -> None:
        """Move the vertices of the whole membrane, which has been placed, to ``positions`` (V, 3).

        Numbers chosen for the cell at rest stay. Raises DldsimError for a shape that is not
        symmetric about the mirror, if there is one.
        """
        self.body.x[:] = positions[self.half.vertex] if self.half else positions
        if self.half:
            apart = float(np.abs(self.positions() - positions).max())
            if apart > LARGEST_ASYMMETRY:
                raise DldsimError(
                    "The shape is not symmetric about mid-height: a vertex is "
                    f"{apart:.2g} nodes from the image of its partner.",
                    key="numerics.half_scene",
                    value=True,
                    remedy="Set numerics.half_scene: false.",
                )
        self._follow()

    def shift(self, displacement) -> None:
        """Move the cell as it is by ``displacement`` (3,), where it takes the fluid's velocity."""
        self.body.x[:] += np.asarray(displacement)
        self._follow()

    def _follow(self) -> None:
        """Give the vertices the velocity of the fluid where they are."""
        body = self.body
        reflect(body.x, body.v, body.smooth, self.mirror)
        locate(body.x, self.domain, self.stencil)
        interpolate(self.fluid.velocity, self.fluid.force, 0.0, self.stencil, body.v)
        reflect(body.x, body.v, body.smooth, self.mirror)
        body.smooth[:] = body.v

    def advance(self, steps: int) -> None:
        """Advance by an even number of steps."""
        scene = (
            self.steps,
            steps,
            self.fluid.state,
            self._before,
            self.body,
            Elasticity(self.membrane, self.moduli, self.scratch),
            Coupling(self.mirror, self.domain, self.stencil, self.contact),
            self.drive,
        )
        if self.numerics.coupling == "no-slip":
            advance_no_slip(*scene, NoSlip(self.blend, self.slip))
        else:
            advance_dissipative(*scene, Drag(self.blend, self.friction, self.mass))
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
        mean_velocity(self.fluid.velocity, self.drive)
        return Sample(
            self.steps,
            self._centroid(),
            velocity.mean(axis=0),
            np.ptp(x, axis=0),
            volume / membrane.rest_volume,
            size / membrane.rest_area,
            clearance(x, self.contact),
            float(fastest(self.fluid.velocity, self.fluid.lattice.nodes)),
            self.drive.mean.copy(),
            inverted_faces(scratch.normals, membrane) / len(membrane.faces),
        )

    def energies(self) -> Energies:
        """Elastic energy of each term, lattice units."""
        membrane, scratch = self.surface
        return energies(self.positions(), membrane, self.moduli, scratch)
