"""Drag on a held sphere of membrane vertices in a simple-cubic array: its hydrodynamic radius.

The vertices stand still on a sphere. Each is held by a spring and a dashpot, whose forces are
spread to the fluid as a membrane's are, until what moves a vertex in a run vanishes: the velocity
of the fluid and the slip of a lasting force (`time_loop.advance_no_slip`). A uniform body force
drives the fluid, inside and outside, past the sphere and its images. The force on the sphere is
then that on the whole box, and with the mean velocity it says which solid sphere has this drag.
"""

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from dldsim.evidence.reference import read_reference
from dldsim.solver.flow import Fluid
from dldsim.solver.immersed_boundary import (
    EVEN_ODD,
    interpolate,
    locate,
    make_domain,
    make_stencil,
    spread,
)
from dldsim.solver.jit import jit
from dldsim.solver.lattice import make_lattice, stream_collide, viscosity
from dldsim.solver.mesh import frequency_for_edge, icosphere
from dldsim.solver.time_loop import MEMBRANE_SLIP

BOX = 4
"""Width of the box over the nominal radius."""
STEPS = 4000
"""From rest. What is left then is the motion of neighbouring vertices against each other, which the
kernel hardly sees; doubling the steps raises the radius by 0.01 nodes."""
SPRING, DASHPOT = 0.3, 0.7
"""Stiffness and damping per vertex, lattice units; a tenth for kernels that feed staggered
momentum."""


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
def hold(
    steps, spring, dashpot, slip, f, f_new, force, velocity, streaming, parameters, inertia, buf,
    stencil, push, moved, vertex_velocity,
):  # fmt: skip
    """An even number of steps of a fluid in which vertices are held.

    ``push`` (V, 3): force on the fluid; ``moved`` (V, 3): way that the vertices would have gone,
    of which ``slip`` times the force density is a part.
    """
    for step in range(steps):
        force[:] = 0.0
        spread(push, stencil, force)
        if step % 2 == 0:
            stream_collide(f, f_new, force, velocity, streaming, parameters, inertia, buf)
        else:
            stream_collide(f_new, f, force, velocity, streaming, parameters, inertia, buf)
        interpolate(velocity, force, slip, stencil, vertex_velocity)
        for i in range(push.shape[0]):
            for d in range(3):
                moved[i, d] += vertex_velocity[i, d]
                push[i, d] = -spring * moved[i, d] - dashpot * vertex_velocity[i, d]


def hydrodynamic_radius(
    radius: float,
    *,
    kernel: str = "compact",
    relaxation_time: float = 3.0,
    edge_to_spacing: float = 1.0,
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
    steps: int = STEPS,
) -> float:
    """Radius in nodes of the solid sphere with the drag of vertices on a sphere of ``radius``.

    ``offset`` of the centre from a corner of nodes, in nodes. The nominal radius is that of the
    vertices, not that of the volume which their faces enclose (0.02 nodes less at a mean edge of
    one node).
    """
    width, nu = round(BOX * radius), viscosity(relaxation_time)
    lattice = make_lattice(np.zeros((width, width), bool), width, walls=False, dtype=np.float64)
    fluid = Fluid(lattice, relaxation_time, "trt", False, np.dtype("float64"))
    body_force = 1e-6  # any: the fluid is linear
    fluid.set_body_force((body_force, 0.0, 0.0))
    vertices, _ = icosphere(frequency_for_edge(4 * np.pi * radius**2, edge_to_spacing))
    stencil = make_stencil(len(vertices), kernel)
    x = radius * vertices + (width // 2 + np.asarray(offset))
    locate(x, make_domain(lattice), stencil)
    push, moved, vertex_velocity = (np.zeros_like(x) for _ in range(3))
    soft = 1.0 if kernel in EVEN_ODD else 0.1
    hold(
        steps, soft * SPRING, soft * DASHPOT, MEMBRANE_SLIP / nu, fluid.f, fluid.f_new,
        fluid.force, fluid.velocity, lattice.streaming, fluid.parameters, False, fluid.buffer,
        stencil, push, moved, vertex_velocity,
    )  # fmt: skip
    drag = body_force * width**2 / (6 * np.pi * nu * fluid.mean_velocity()[0])
    return width * brentq(lambda a: drag_over_radius(a) - drag, 1e-3, 0.49)
