"""A capsule in simple shear between moving plates: the standard test of a cell in a fluid.

The capsule, a sphere at rest, sits midway between plates that move along x; the box repeats along x
and y. The fluid is linear (Stokes), so that the Reynolds number only shapes the transient and the
shear rate may be as high as the explicit step allows. Ca = μ γ̇ a / G_s with the surface shear
modulus G_s.
"""

import math
import time
from typing import Literal, NamedTuple

import numpy as np

from dldsim.config.sections import Cell, Numerics
from dldsim.errors import DldsimError
from dldsim.experiments.runner import Stop, advance_until
from dldsim.laws import viscosity
from dldsim.solver import membrane as mb
from dldsim.solver.d3q19 import VELOCITIES, WEIGHTS
from dldsim.solver.flow import Fluid
from dldsim.solver.lattice import make_lattice
from dldsim.solver.observe import Sample
from dldsim.solver.scene import CellInFlow
from dldsim.solver.time_step import elastic_frequency, frequency_limit
from dldsim.solver.units import Units
from dldsim.vocabulary import UNSTABLE

Law = Literal["neo-Hookean", "Skalak", "springs"]

CURES = "lower reynolds_number, or raise relaxation_time"
SAMPLES = 20
"""Per window; a window is a strain time 1/γ̇, or a third of a run shorter than three of them."""


class ShearRun(NamedTuple):
    """A capsule in shear.

    ``drift``: difference of the Taylor deformation between the two last windows, over which
    deformation and inclination are averaged; ``history`` (T, 3): γ̇t, Taylor deformation,
    inclination [deg].
    """

    taylor_deformation: float
    inclination_deg: float
    drift: float
    history: np.ndarray
    volume_ratio: float
    area_ratio: float
    surface_modulus_lu: float
    shear_rate_lu: float
    vertices: int
    nodes: int
    steps: int
    wall_time_s: float


def moduli_of(law: Law, shear_modulus: float, bending: float) -> mb.Moduli:
    """Coefficients of a membrane of surface shear modulus G_s and bending modulus κ (cylinder).

    Skalak's C is 1. Raises DldsimError for an unknown law.
    """
    name, value = {
        "neo-Hookean": ("neo_hookean", shear_modulus),
        "Skalak": ("skalak", shear_modulus),
        "springs": ("ks", shear_modulus / mb.shear_modulus(1.0)),
    }.get(law, (None, None))
    if name is None:
        raise DldsimError(
            f"Membrane law {law!r} is unknown; use neo-Hookean, Skalak or springs.",
            key="law",
            value=law,
            allowed="neo-Hookean, Skalak or springs",
        )
    none = mb.Moduli(ks=0.0, kb=0.0, kal=0.0, kag=0.0, kv=0.0, kvisc=0.0)
    return none._replace(kb=bending / mb.bending_modulus(1.0), **{name: value})


def start_shear(fluid: Fluid, shear_rate: float) -> None:
    """Populations of the steady flow u_x = γ̇ (z − height/2), exact on the lattice."""
    lattice, tau = fluid.lattice, fluid.relaxation_time
    z = np.arange(lattice.nz) + 0.5 - lattice.nz / 2
    populations = fluid.f.reshape(19, lattice.stride)
    for q, (cx, _, cz) in enumerate(VELOCITIES):
        column = 3 * WEIGHTS[q] * cx * shear_rate * (z - (tau - 1) * cz)
        populations[q, : lattice.nodes] = np.tile(column, lattice.columns)


def inertia_ellipse(x: np.ndarray, faces: np.ndarray) -> tuple[float, float, float]:
    """Larger and smaller half axis in the plane (x, z), and inclination of the larger one [deg].

    Of the ellipsoid with the second moments of the enclosed volume, V a²/5 on a half axis a.
    """
    corners = (x - x.mean(axis=0))[faces]
    volumes = np.linalg.det(corners) / 6
    total = volumes.sum()
    corners = corners - volumes @ corners.sum(axis=1) / (4 * total)
    volumes = np.linalg.det(corners) / 6
    points = np.concatenate([corners, corners.sum(axis=1, keepdims=True)], axis=1)[:, :, ::2]
    moments = np.einsum("f,fki,fkj->ij", volumes, points, points) / 20
    values, axes = np.linalg.eigh(5 * moments / total)
    inclination = math.degrees(math.atan2(axes[1, 1], axes[0, 1]))
    return math.sqrt(values[1]), math.sqrt(values[0]), (inclination + 90) % 180 - 90


def capsule_in_shear(
    law: Law,
    capillary_number: float,
    *,
    bending: float = 0.01,
    flat_rest_angles: bool = False,
    radius: int = 6,
    height: float = 8,
    length: float = 6.5,
    width: float = 6,
    kernel: str = "compact",
    edge_to_spacing: float = 1.0,
    relaxation_time: float = 1.25,
    reynolds_number: float = 0.5,
    duration: float | None = None,
    precision: Literal["float32", "float64"] = "float32",
) -> ShearRun:
    """A capsule from rest to its steady shape, viscosity the same inside and outside.

    ``bending``: κ/(G_s a²); its rest angles are those of the sphere or, if ``flat_rest_angles``,
    flat. ``radius`` in nodes; ``height``, ``length`` and ``width`` of the box in radii.
    ``reynolds_number``: largest γ̇ a²/ν, less where the membrane asks for a shorter step
    (:mod:`dldsim.solver.time_step`). ``duration`` in strain times, 3 + 9 Ca unless given: the
    relaxation of the shape takes a time in proportion to Ca/γ̇.

    Plates 8 radii apart raise the deformation by 2 %, the images along the flow lower it. At the
    default length the two cancel to 0.4 % at Ca 0.0375, 0.3 and 0.6, seen against a cube 16 radii
    wide; the inclination is 0.1 to 0.7° too small. Raises DldsimError for an unknown law or a run
    that leaves its safe range.
    """
    start = time.perf_counter()
    nu = viscosity(relaxation_time)
    numerics = Numerics(
        spacing_um=1,
        relaxation_time=relaxation_time,
        kernel=kernel,
        edge_to_spacing=edge_to_spacing,
        contact_range_um=0,
        precision=precision,
    )
    shape = tuple(round(radii * radius) for radii in (length, width, height))
    unit = moduli_of(law, 1.0, bending * radius**2)
    probe = _scene(shape, 0.0, radius, unit, flat_rest_angles, numerics)
    stiffest = frequency_limit(relaxation_time, kernel) / elastic_frequency(probe)
    shear_rate = min(reynolds_number / radius**2, stiffest * capillary_number / radius / nu**2) * nu
    modulus = nu * shear_rate * radius / capillary_number
    moduli = moduli_of(law, modulus, bending * modulus * radius**2)
    scene = _scene(shape, shear_rate, radius, moduli, flat_rest_angles, numerics)

    duration = duration or 3 + 9 * capillary_number
    window = min(1, duration / 3)
    history = []

    def watch(sample: Sample) -> Stop | None:
        a, b, inclination = inertia_ellipse(scene.body.x, scene.membrane.faces)
        history.append((sample.step * shear_rate, (a - b) / (a + b), inclination))
        over = history[-1][0] >= duration
        return Stop("converged", f"{duration:g} strain times are over") if over else None

    chunk = 2 * max(1, round(window / (2 * SAMPLES * shear_rate)))
    stop = advance_until(scene, chunk, watch, cures=CURES)
    if stop.status == UNSTABLE:
        raise DldsimError(f"{law} capsule at Ca {capillary_number:g}: {stop.reason}.")
    sample, history = scene.sample(), np.array(history[1:])  # without the start at rest
    before, last = (history[-n:, 1:][:SAMPLES].mean(axis=0) for n in (2 * SAMPLES, SAMPLES))
    return ShearRun(
        *((before + last) / 2),
        last[0] - before[0],
        history,
        sample.volume_ratio,
        sample.area_ratio,
        modulus,
        shear_rate,
        scene.vertices,
        scene.fluid.lattice.nodes,
        scene.steps,
        time.perf_counter() - start,
    )


def _scene(
    shape: tuple,
    shear_rate: float,
    radius: int,
    moduli: mb.Moduli,
    flat_rest_angles: bool,
    numerics: Numerics,
) -> CellInFlow:
    """A capsule at rest in the middle of a box of ``shape`` nodes, in steady shear."""
    nx, ny, nz = shape
    plates = -shear_rate * nz / 2, shear_rate * nz / 2
    lattice = make_lattice(
        np.zeros((nx, ny), bool), nz, walls=True, wall_velocities=plates, dtype=numerics.precision
    )
    fluid = Fluid.of(lattice, numerics)
    start_shear(fluid, shear_rate)
    scene = CellInFlow(
        fluid,
        Units(1.0, 1.0, 1.0, 1.0, viscosity(numerics.relaxation_time)),
        Cell(shape="sphere", radius_um=radius),
        moduli._replace(kv=math.inf),
        numerics,
        {},
    )
    if flat_rest_angles:
        rest = scene.membrane
        scene.membrane = rest._replace(rest_angles=np.zeros_like(rest.rest_angles))
    scene.place((nx / 2, ny / 2, nz / 2))
    return scene
