"""Flow through the array without a cell: permeability tensor, tilt, and the start of every run.

With the linear (Stokes) equilibrium two solutions, driven along x and along y, span all others;
the drive that gives the wanted mean velocity is their combination, and so are its populations.
With inertia the drive is corrected until the mean velocity is met.
"""

import json
import math
import time
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dldsim import PHYSICS_VERSION
from dldsim.config.sections import Flow, Geometry, Numerics
from dldsim.errors import DldsimError
from dldsim.files import atomic_path, why_not_read
from dldsim.laws import viscosity
from dldsim.solver.collide import collision_parameters
from dldsim.solver.jit import aligned_zeros, jit
from dldsim.solver.lattice import Lattice, row_length
from dldsim.solver.pillars import ArrayLattice, make_array
from dldsim.solver.stream_collide import FluidState, Scheme, stream_collide
from dldsim.solver.streaming import BLOCK

STEADY_TOLERANCE = {"float32": 2e-6, "float64": 1e-9}
"""Relative change of the mean velocity per viscous time across the gap that counts as steady."""
MAX_STEPS = 200_000


@jit
def advance_fluid(steps, fluid):
    """An even number of time steps under the uniform force alone; velocity of the last one."""
    nothing = fluid.velocity[:0]
    for step in range(steps):
        asked = fluid.velocity if step == steps - 1 else nothing
        stream_collide(step, fluid.f, nothing, asked, fluid.near[:0], fluid.scheme)


@dataclass
class Fluid:
    """Populations and fields of one scene; arrays as in :mod:`dldsim.solver.lattice`.

    ``near``: blocks outside of which ``force`` is zero.
    """

    lattice: Lattice
    relaxation_time: float
    collision: str
    inertia: bool
    dtype: np.dtype

    def __post_init__(self):
        n = self.lattice.stride
        self.f = aligned_zeros(19 * n, self.dtype)
        self.force = aligned_zeros(3 * n, self.dtype)
        self.velocity = aligned_zeros(3 * n, self.dtype)
        self.near = np.ones(len(self.lattice.streaming.part_start) - 1, np.uint8)
        self.buffer = aligned_zeros(26 * int(BLOCK), self.dtype)
        self.steps = 0
        self.set_body_force((0.0, 0.0, 0.0))

    @classmethod
    def of(cls, lattice: Lattice, numerics: Numerics) -> "Fluid":
        return cls(
            lattice,
            numerics.relaxation_time,
            numerics.collision,
            numerics.inertia == "navier-stokes",
            np.dtype(numerics.precision),
        )

    def set_body_force(self, force) -> None:
        """Uniform force density (3,) in lattice units."""
        self.body_force = np.asarray(force, float)
        self.parameters = collision_parameters(
            self.relaxation_time, self.collision, self.body_force, self.dtype
        )

    @property
    def scheme(self) -> Scheme:
        return Scheme(self.lattice.streaming, self.parameters, self.inertia, self.buffer)

    @property
    def state(self) -> FluidState:
        """What the kernels work on."""
        return FluidState(self.f, self.force, self.velocity, self.near, self.scheme)

    def advance(self, steps: int) -> None:
        """Advance by an even number of steps."""
        advance_fluid(steps, self.state)
        self.steps += steps

    def velocity_field(self) -> np.ndarray:
        """Velocity (3, columns, nz), below the mirror if there is one."""
        lattice = self.lattice
        u = self.velocity.reshape(3, lattice.stride)[:, : lattice.nodes]
        return u.reshape(3, lattice.columns, lattice.nz)

    def mean_velocity(self) -> np.ndarray:
        """Velocity averaged over the whole box, solid included (3,)."""
        lattice, u = self.lattice, self.velocity_field()
        total = u.sum(axis=(1, 2), dtype=np.float64)
        if lattice.split:
            total -= 0.5 * u[:, :, -1].sum(axis=1, dtype=np.float64)
        if lattice.half:
            total[2] = 0.0  # the other half moves the other way
        return total / lattice.volume


def advance_to_steady(fluid: Fluid, length: float, progress=None) -> None:
    """Advance until the mean velocity is steady; ``length``: diffusion length in nodes.

    Raises DldsimError if the flow does not settle or is not finite.
    """
    chunk = 2 * max(25, int(length**2 / viscosity(fluid.relaxation_time) / 8))
    tolerance = STEADY_TOLERANCE[fluid.dtype.name]
    before, told = np.zeros(3), time.perf_counter()
    while fluid.steps < MAX_STEPS:
        fluid.advance(chunk)
        mean = fluid.mean_velocity()
        if not np.isfinite(mean).all():
            raise DldsimError(
                f"The flow without a cell is not finite at step {fluid.steps}.",
                key="numerics.relaxation_time",
                value=fluid.relaxation_time,
                remedy="Raise numerics.relaxation_time or lower numerics.velocity_lu.",
            )
        change = np.abs(mean - before).max()
        if progress and time.perf_counter() - told > 1:
            told = time.perf_counter()
            progress(
                f"flow without a cell: step {fluid.steps:,}, mean velocity still changes by "
                f"{change / np.abs(mean).max():.1e} in {chunk} steps"
            )
        if change <= tolerance * np.abs(mean).max():
            return
        before = mean
    raise DldsimError(
        f"The flow without a cell is not steady after {MAX_STEPS} steps.",
        key="numerics.relaxation_time",
        value=fluid.relaxation_time,
        remedy="Raise numerics.relaxation_time or coarsen numerics.spacing_um.",
    )


@dataclass
class EmptyFlow:
    """Steady flow through an array without a cell.

    ``mobility`` (2, 2): mean velocity per force density in lattice units, (x, y);
    ``body_force`` (2,); ``populations``: start state of the runs (19 * stride,).
    """

    geometry: Geometry
    flow: Flow
    numerics: Numerics
    mobility: np.ndarray
    body_force: np.ndarray
    mean_velocity: np.ndarray
    populations: np.ndarray
    spacing_um: float
    pitch: int
    nodes: int
    steps: int
    wall_time_s: float

    def summary(self) -> dict:
        """Permeability tensor over λ², tilt, lateral flux, drag, cost (one row of `flows`)."""
        nu = viscosity(self.numerics.relaxation_time)
        k = self.mobility * nu / self.pitch**2
        ux, uy = self.mean_velocity
        return {
            "pillar_radius_um": self.geometry.pillar_radius_um,
            "gap_um": self.geometry.gap_um,
            "periodicity": self.geometry.periodicity,
            "pitch_um": self.geometry.pitch_um,
            "height_um": self.flow.height_um,
            "drive": self.flow.drive,
            "permeability_over_pitch2": float(k[0, 0]),
            "permeability_xx_over_pitch2": float(k[0, 0]),
            "permeability_xy_over_pitch2": float(k[0, 1]),
            "permeability_yx_over_pitch2": float(k[1, 0]),
            "permeability_yy_over_pitch2": float(k[1, 1]),
            "tilt_deg": math.degrees(math.atan2(k[1, 0], k[0, 0])),
            "force_ratio_y_over_x": float(self.body_force[1] / self.body_force[0]),
            "lateral_flux_ratio": float(uy / ux),
            "drag_over_mu_U": float(self.body_force[0] * self.pitch**2 / (nu * ux)),
            "spacing_um": self.spacing_um,
            "nodes": self.nodes,
            "steps": self.steps,
            "wall_time_s": self.wall_time_s,
            "mlups": self.nodes * self.steps / self.wall_time_s / 1e6,
            "status": "steady",
        }

    def slower(self, factor: float) -> "EmptyFlow":
        """The same flow at a velocity in lattice units smaller by ``factor``; Stokes flow only."""
        numerics = self.numerics.model_copy(
            update={"velocity_lu": self.numerics.velocity_lu / factor}
        )
        return replace(
            self,
            numerics=numerics,
            body_force=self.body_force / factor,
            mean_velocity=self.mean_velocity / factor,
            populations=self.populations / self.populations.dtype.type(factor),
        )

    def save(self, path: Path) -> None:
        """Write atomically as .npz."""
        meta = {
            "physics_version": PHYSICS_VERSION,
            **{n: getattr(self, n).model_dump() for n in ("geometry", "flow", "numerics")},
            **{n: getattr(self, n) for n in ("spacing_um", "pitch", "nodes", "steps")},
            "wall_time_s": self.wall_time_s,
        }
        with atomic_path(path) as part, part.open("wb") as stream:
            np.savez(
                stream,
                meta=json.dumps(meta),
                mobility=self.mobility,
                body_force=self.body_force,
                mean_velocity=self.mean_velocity,
                populations=self.populations,
            )

    @classmethod
    def load(cls, path: Path) -> "EmptyFlow":
        """Read what :meth:`save` wrote; DldsimError if truncated, foreign or of other physics."""
        path = Path(path)
        try:
            with np.load(path) as data:
                arrays = {n: data[n] for n in data.files if n != "meta"}
                meta = json.loads(str(data["meta"]))
        except (OSError, TypeError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            damaged = (
                f"{path} is not a flow file of dldsim or is damaged ({error}). Delete it "
                "and run snakemake again."
            )
            raise DldsimError(why_not_read(path, error) or damaged, key=str(path)) from error
        other = ""
        if meta.pop("physics_version", None) != PHYSICS_VERSION:
            other = "another physics version"
        elif arrays["populations"].size != 19 * row_length(meta["nodes"]):
            other = "a version that keeps populations in another order"
        if other:
            raise DldsimError(
                f"{path} was made by {other}.",
                key=str(path),
                remedy="Move it away and run snakemake again.",
            )
        sections = {
            "geometry": Geometry(**meta.pop("geometry")),
            "flow": Flow(**meta.pop("flow")),
            "numerics": Numerics(**meta.pop("numerics")),
        }
        return cls(**sections, **meta, **arrays)


def solve_empty_array(
    geometry: Geometry,
    flow: Flow,
    numerics: Numerics,
    progress: Callable[[str], None] | None = None,
) -> EmptyFlow:
    """Steady flow with mean velocity ``numerics.velocity_lu`` along x (lattice units).

    Drive "no-lateral-flux": the force that leaves no mean velocity along y; "axial": force along x.
    Raises DldsimError if the geometry does not fit the lattice or the flow does not settle.
    """
    start = time.perf_counter()
    array = make_array(geometry, flow, numerics)
    length = (
        min(array.pitch - 2 * array.radius, array.height)
        if array.lattice.walls
        else (array.pitch - array.radius)
    )
    solutions = []
    scale = numerics.velocity_lu * viscosity(numerics.relaxation_time) / length**2
    for axis in range(2):
        fluid = Fluid.of(array.lattice, numerics)
        fluid.inertia = False
        fluid.set_body_force(np.eye(3)[axis] * scale)
        advance_to_steady(fluid, length, progress)
        solutions.append(fluid)
    mobility = np.stack([s.mean_velocity()[:2] / scale for s in solutions], axis=1)
    force = drive_force(mobility, numerics.velocity_lu, flow.drive)
    fluid = solutions[0]
    fluid.f *= force[0] / scale
    fluid.f += (force[1] / scale) * solutions[1].f
    fluid.velocity *= force[0] / scale
    fluid.velocity += (force[1] / scale) * solutions[1].velocity
    fluid.steps += solutions[1].steps
    if numerics.inertia == "navier-stokes":
        force = _correct_drive(fluid, mobility, force, flow, numerics, length, progress)
    return EmptyFlow(
        geometry,
        flow,
        numerics,
        mobility,
        force,
        fluid.mean_velocity()[:2],
        fluid.f,
        array.spacing_um,
        array.pitch,
        array.lattice.nodes,
        fluid.steps,
        time.perf_counter() - start,
    )


def drive_force(mobility: np.ndarray, velocity: float, drive: str) -> np.ndarray:
    """Force density (2,) for mean velocity ``velocity`` along x under the given drive."""
    if drive == "axial":
        return np.array([velocity / mobility[0, 0], 0.0])
    return np.linalg.solve(mobility, [velocity, 0.0])


def _correct_drive(fluid, mobility, force, flow, numerics, length, progress) -> np.ndarray:
    """Newton corrections of the drive for a fluid with inertia."""
    fluid.inertia = True
    for _ in range(6):
        fluid.set_body_force([*force, 0.0])
        fluid.steps, before = 0, fluid.steps
        advance_to_steady(fluid, length, progress)
        fluid.steps += before
        error = numerics.velocity_lu * np.array([1.0, 0.0]) - fluid.mean_velocity()[:2]
        if flow.drive == "axial":
            error[1] = 0.0
        if np.abs(error).max() < 1e-5 * numerics.velocity_lu:
            return force
        if flow.drive == "axial":
            force = force + np.array([error[0] / mobility[0, 0], 0.0])
        else:
            force = force + np.linalg.solve(mobility, error)
    raise DldsimError(
        "The drive for the wanted mean velocity was not found in 6 corrections.",
        key="numerics.velocity_lu",
        value=numerics.velocity_lu,
        remedy="Lower numerics.velocity_lu or use numerics.inertia: stokes.",
    )


def array_of(empty_flow: EmptyFlow) -> ArrayLattice:
    """The lattice on which an empty flow was solved."""
    return make_array(empty_flow.geometry, empty_flow.flow, empty_flow.numerics)
