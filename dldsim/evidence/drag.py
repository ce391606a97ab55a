"""A sphere of membrane vertices under uniform traction in a simple-cubic array: how large it acts.

In Stokes flow a sphere with a uniform force per area moves through a fluid of the same viscosity
inside and outside as a whole, like a solid sphere: the traction on a translating sphere is uniform.
Its vertices here bear the forces of their areas, which are spread to the fluid as a membrane's are;
a uniform body force balances them. Once the flow is steady, the velocities of the vertices relative
to the mean flow say what the kernels do to a membrane, apart from any elasticity: how far they lag
along the membrane and across it (`time_loop.MEMBRANE_SLIP`), and with the slip that offsets it,
which solid sphere moves as fast.
"""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from dldsim.evidence.reference import read_reference
from dldsim.laws import viscosity
from dldsim.solver.flow import Fluid
from dldsim.solver.immersed_boundary import (
    interpolate_both,
    locate,
    make_domain,
    make_stencil,
    spread,
)
from dldsim.solver.jit import jit
from dldsim.solver.lattice import make_lattice
from dldsim.solver.membrane import make_membrane, vertex_areas
from dldsim.solver.mesh import frequency_for_edge, icosphere
from dldsim.solver.stream_collide import stream_collide
from dldsim.solver.time_loop import MEMBRANE_SLIP

BOX = 8
"""Width of the box over the radius. The images make the traction that moves the sphere as a whole
slightly uneven, which changes the lag by 0.006 nodes from a box of 6 radii to one of 8."""
DIFFUSION_TIMES = 1.0
"""Duration in (L/2)²/ν; the slowest mode of the box decays by π² in the exponent."""


class Lag(NamedTuple):
    """``radius``: that of the solid sphere that moves as fast, in nodes; ``along``, ``across``:
    velocity that vertices lack along the membrane and across it over t/ν, t the traction's part,
    slip left out; ``uneven``: root mean square of what these two leave of the velocities, over the
    sphere's."""

    radius: float
    along: float
    across: float
    uneven: float


def drag_over_radius(radius: float) -> float:
    """K a/L of F = 6π μ a K U, for a simple-cubic array of spheres of ``radius`` a, both over the
    width L of the cell; U is the superficial velocity.

    Spline through the table of Zick & Homsy (1982), 1/K over the cube root of the solid fraction.
    """
    table = read_reference("zick_homsy_1982")
    root = [0.0, *(row["solid_fraction"] ** (1 / 3) for row in table)]
    mobility = CubicSpline(root, [1.0, *(1 / row["drag_factor_K"] for row in table)])
    return float(radius / mobility((4 * np.pi / 3) ** (1 / 3) * radius))


@jit
def push_steadily(steps, push, fluid, stencil, vertex_velocity, kick):
    """An even number of steps of a fluid under the vertex forces ``push`` (V, 3).

    Fills the velocity and the force density (V, 3) that the vertices then find.
    """
    fluid.force[:] = 0.0
    spread(push, stencil, fluid.force)
    for step in range(steps):
        stream_collide(step, fluid.f, fluid.force, fluid.velocity, fluid.near[:0], fluid.scheme)
    interpolate_both(fluid.velocity, fluid.force, stencil, vertex_velocity, kick)


def lag_under_traction(
    radius: float,
    *,
    kernel: str = "compact",
    relaxation_time: float = 3.0,
    edge_to_spacing: float = 1.0,
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
    box: float = BOX,
) -> Lag:
    """A sphere of ``radius`` in nodes under uniform traction along x.

    ``offset`` of the centre from a corner of nodes, in nodes; ``box``: its width in radii.
    """
    width, nu = round(box * radius), viscosity(relaxation_time)
    lattice = make_lattice(np.zeros((width, width), bool), width, walls=False, dtype=np.float64)
    fluid = Fluid(lattice, relaxation_time, "trt", False, np.dtype("float64"))
    total = 1e-3  # any: the fluid is linear
    fluid.set_body_force((-total / width**3, 0.0, 0.0))
    normal, faces = icosphere(frequency_for_edge(4 * np.pi * radius**2, edge_to_spacing))
    membrane = make_membrane(radius * normal, faces)
    area = vertex_areas(membrane)
    share = area / area.sum()
    stencil = make_stencil(len(normal), kernel)
    locate(radius * normal + (width // 2 + np.asarray(offset)), make_domain(lattice), stencil)
    push, vertex_velocity, kick = (np.zeros_like(normal) for _ in range(3))
    push[:, 0] = total * share
    steps = 2 * round(DIFFUSION_TIMES * width**2 / nu / 8)
    push_steadily(steps, push, fluid.state, stencil, vertex_velocity, kick)
    vertex_velocity -= fluid.mean_velocity()
    drag = total / (6 * np.pi * nu * width)  # a K/L times the velocity
    expected = np.array([drag / drag_over_radius(radius / width), 0.0, 0.0])

    def parts(vectors):
        across = (vectors * normal).sum(axis=1, keepdims=True) * normal
        return vectors - across, across

    tractions = parts(push / area[:, None] / nu)
    lags = [
        -float(np.vdot(share[:, None] * missing, part) / np.vdot(share[:, None] * part, part))
        for missing, part in zip(parts(vertex_velocity - expected), tractions, strict=True)
    ]
    left = vertex_velocity - expected + sum(c * t for c, t in zip(lags, tractions, strict=True))
    slip = sum(c * t for c, t in zip(MEMBRANE_SLIP[kernel], tractions, strict=True))
    moves = float(share @ (vertex_velocity + slip)[:, 0])
    acts = width * brentq(lambda a: drag_over_radius(a) - drag / moves, 1e-3, 0.49)
    return Lag(acts, *lags, float(np.sqrt(share @ (left**2).sum(axis=1))) / expected[0])


def hydrodynamic_radius(radius: float, **settings) -> float:
    """Radius in nodes of the solid sphere that moves as fast as one of vertices with their slip;
    settings of `lag_under_traction`."""
    return lag_under_traction(radius, **settings).radius
