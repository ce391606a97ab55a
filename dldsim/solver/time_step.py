"""What the explicit step of a scene can carry, known before it runs, and the step that suits it.

Leapfrog moves a vertex with the momentum that its force has just changed. An elastic mode then has
ω² = λ(W K), with the stiffness K of the membrane and what a force gives back to the vertices within
the step, W (see `scene.largest_gain`); undamped leapfrog bears ω² < 4. A fluid that is itself
an explicit, compressible oscillator bears less, and how much depends on its viscosity: THRESHOLDS,
measured. Every margin here is in proportion to the velocity in lattice units, that is, to the time
step.
"""

from typing import NamedTuple

import numpy as np

from dldsim.config.sections import Numerics
from dldsim.laws import LARGEST_TENSION, area_modulus
from dldsim.solver.immersed_boundary import EVEN_ODD
from dldsim.solver.membrane_forces import elastic_forces
from dldsim.solver.scene import CellInFlow, largest_gain

THRESHOLDS = {0.52: 0.26, 0.55: 0.39, 0.65: 0.8, 0.8: 1.44, 1.25: 2.0, 2.0: 1.78, 3.0: 1.34}
"""Largest ω² that held at a relaxation time, even-odd kernels: see `stability_sweep`."""
SAFETY = 1 / 3
"""Share of the threshold that counts as safe: a deformed network of springs was seen up to 1.4
times as stiff as at rest, and stiff spheres pressed against a pillar diverged at 0.45. At a
relaxation time of 3 runs of set 5 held at 0.5, and three of four diverged at 0.65."""
BENDING_GROWTH = 5.0
"""Factor on k_b in the prediction: hinges of triangles that a deformation has flattened are stiffer
by the square of the height lost; factors of 2 to 4 were seen, rarely 10."""
FEEDING = 0.05
"""The same share for kernels that feed staggered momentum, whose modes grow at any ω²."""
LARGEST_LAG = 0.1
"""Of the running mean on which dashpots act, in times in which the cell moves by its radius."""
LARGEST_SPEED = 0.2
"""Of the fluid at release; a cell in a gap has been seen to raise it by 1.7."""


STIFFEST_HINGE = 5.0
"""k_b over (k_s + k_α) edge²: hinges stiffer than that fold triangles up rather than bend."""


class Margins(NamedTuple):
    """What a scene asks of its time step as a share of what is safe: up to 1 is safe.

    ``elastic``: ω² of the stiffest mode. ``mass``: dissipative coupling, vertex mass that the
    springs ask for over that which friction does. ``lag``: of the dashpots. ``speed``: of the
    fluid. ``inertia``: time in which the fluid relaxes over that in which the cell moves.
    """

    elastic: float
    mass: float
    lag: float
    speed: float
    inertia: float


def elastic_frequency(scene: CellInFlow) -> float:
    """ω² of the stiffest elastic mode, hinges stiffened, lattice units.

    The volume term, a single mode, has its own limit (`scene.volume_stiffness`).
    """
    x = scene.body.x
    moduli = scene.moduli._replace(kb=BENDING_GROWTH * scene.moduli.kb, kv=0.0, kvisc=0.0)
    still, behind = np.zeros_like(x), np.zeros_like(scene.body.force)

    def push(mode, force):
        elastic_forces(x + mode, still, scene.membrane, moduli, scene.scratch, force)
        elastic_forces(x - mode, still, scene.membrane, moduli, scene.scratch, behind)
        force -= behind
        force /= 2

    return largest_gain(scene, push)


def frequency_limit(relaxation_time: float, kernel: str) -> float:
    """ω² that counts as safe; below the lowest relaxation time studied in proportion to τ − 1/2."""
    studied = [*THRESHOLDS]
    threshold = np.interp(relaxation_time, studied, [*THRESHOLDS.values()])
    threshold *= min(1, (relaxation_time - 0.5) / (studied[0] - 0.5))
    return float(threshold * (SAFETY if kernel in EVEN_ODD else FEEDING))


def relaxation_length(scene: CellInFlow) -> float:
    """Length in nodes over which the fluid relaxes slowest, as L²/ν: the cell's radius, or that of
    the slowest mode between the walls, 1/L² = π² (1/height² + 1/width²), if longer.

    The width is the pitch of the pillars or the width of the channel.
    """
    contact = scene.contact
    radius = scene.radius_um / scene.units.spacing_um
    width = contact.pitch if contact.pillars else 2 * contact.profile[1].max()
    curvature = (1 / width**2 if width else 0.0) + (
        1 / contact.height**2 if contact.plates else 0.0
    )
    return max(radius, 1 / (np.pi * np.sqrt(curvature))) if curvature else radius


def lag_number(scene: CellInFlow) -> float:
    """Twice the relaxation time of the fluid, L²/ν, over the time in which the cell moves by its
    radius, R/U: the numerical Reynolds number U 2R/ν where the cell is the largest length.

    What is left of inertia with a linear equilibrium is the fluid's lag behind the cell. In the
    device, at a Reynolds number of some thousandths, there is none.
    """
    units = scene.units
    radius = scene.radius_um / units.spacing_um
    length = relaxation_length(scene)
    return 2 * units.velocity_lu * length**2 / (units.viscosity_lu * radius)


def margins(scene: CellInFlow) -> Margins:
    """Of a scene as it is released."""
    numerics = scene.numerics
    velocity, radius = numerics.velocity_lu, scene.radius_um / scene.units.spacing_um
    if numerics.coupling == "no-slip":
        elastic = elastic_frequency(scene) / frequency_limit(
            numerics.relaxation_time, numerics.kernel
        )
        mass = 0.0
        lag = velocity / radius / scene.blend / LARGEST_LAG if scene.moduli.kvisc else 0.0
    else:
        elastic = 0.0  # the vertex mass is chosen for it
        stiffest = max(scene.moduli.ks + scene.moduli.kal, scene.moduli.kb)
        mass = 3 * stiffest / (2 * scene.friction)
        lag = velocity / radius / scene.blend / LARGEST_LAG
    speed = scene.sample().speed_max / LARGEST_SPEED
    inertia = lag_number(scene) / numerics.reynolds_max
    return Margins(elastic, mass, lag, speed, inertia)


def refinement(given: Margins, numerics: Numerics) -> float:
    """Factor by which the time step is made shorter: 1 where that given is safe or insisted on."""
    return max(1.0, *given) if numerics.time_step == "automatic" else 1.0


def refined(numerics: Numerics, factor: float) -> Numerics:
    """Numerics with a shorter time step, by way of the velocity in lattice units."""
    return numerics.model_copy(update={"velocity_lu": numerics.velocity_lu / factor})


def bottleneck(given: Margins) -> str:
    """What asks most of the time step, in words."""
    words = {
        "elastic": "the membrane is too stiff for the step given",
        "mass": "springs would make the vertices too heavy",
        "lag": "the membrane's viscosity would act too late",
        "speed": "the fluid would be too fast",
        "inertia": "the fluid would lag behind the cell",
    }
    return words[max(words, key=lambda name: getattr(given, name))]


def incurable(scene: CellInFlow) -> list[str]:
    """What no time step cures, as sentences; empty for a sound scene."""
    moduli, units = scene.moduli, scene.units
    found = []
    if moduli.kv == 0:
        found.append("without a volume term (k_v = 0) nothing answers what leaks through")
    edge = scene.surface[0].rest_lengths.mean()
    springs = moduli.ks + moduli.kal
    if moduli.kb > STIFFEST_HINGE * springs * edge**2:
        found.append("hinges are much stiffer than springs: k_b is too large for k_s and k_α")
    stretch = area_modulus(moduli.ks, moduli.kal, moduli.kag)
    if units.viscosity_lu * units.velocity_lu > LARGEST_TENSION * stretch:
        found.append("the flow stretches the membrane's area: μU is too large for K + k_ag/2")
    return found


def step_record(given: Margins, factor: float) -> dict:
    """For the record of a run: what its time step was asked for, and the factor that answered."""
    shares = {f"margin_{name}": round(value, 4) for name, value in given._asdict().items()}
    return {**shares, "time_step_refinement": round(factor, 4)}
