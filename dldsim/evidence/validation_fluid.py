"""Validation cases of the fluid without a cell; see :mod:`dldsim.evidence.validation`.

Marks on pillars are those of a misplaced wall: half-way bounce-back takes every cut link as cut in
the middle, so its wall may be half a node off; interpolated bounce-back must be five times better.
"""

import math
from collections.abc import Iterator

import numpy as np
from scipy.interpolate import CubicSpline

from dldsim.config.sections import Flow, Geometry, Numerics
from dldsim.evidence.reference import read_reference
from dldsim.evidence.validation import Comparison
from dldsim.laws import viscosity
from dldsim.solver.d3q19 import VELOCITIES, WEIGHTS
from dldsim.solver.flow import EmptyFlow, Fluid, advance_to_steady, array_of, solve_empty_array
from dldsim.solver.lattice import Lattice, make_lattice
from dldsim.solver.pillars import make_pillars

RELAXATION_TIME = 3.0
"""Steady Stokes flow does not depend on it (case viscosity-independence): this one settles fast."""
WALL_ERROR = {"half-way": 0.5, "interpolated": 0.1}
"""Allowed displacement of a pillar's wall in nodes."""
SPACINGS_UM = (1.25, 0.625, 0.4167)
"""For a pitch of 30 µm: the default of the campaign, a half and a third of it."""
PITCH_UM = 30.0
PITCH = "nodes per pitch"
NEAREST = 0.25
"""Nodes nearer to a wall than this are left out of profiles; so small a step makes them wiggle."""


def steady(lattice: Lattice, relaxation_time: float, length: float, collision="trt") -> Fluid:
    """Steady Stokes flow under a unit force along x, in units of force / kinematic viscosity."""
    fluid = Fluid(lattice, relaxation_time, collision, False, np.dtype("float64"))
    force = 1e-6
    fluid.set_body_force((force, 0, 0))
    advance_to_steady(fluid, length)
    fluid.velocity *= viscosity(relaxation_time) / force
    return fluid


def plane_poiseuille() -> Iterator[Comparison]:
    """Mean velocity between plates, in units of g h²/μ, beside the parabola at the nodes.

    Marks: TRT with the magic parameter 3/16 is exact, so 1e-7, a hundred times the tolerance of the
    iteration. BGK slips, shown without a mark; the slip itself is known (Ginzburg & d'Humières
    2003, Phys. Rev. E 68:066614), u = g/(2μ) [z (h - z) + 4/3 (τ - 1/2)² - 1/4], and must be met to
    1e-6.
    """
    for height in (8, 16):
        lattice = make_lattice(np.zeros((2, 2), bool), height, walls=True, dtype=np.float64)
        exact = 1 / 12 + 1 / (24 * height**2)
        for collision in ("trt", "bgk"):
            for tau in (0.6, 1.25, 2.0):
                mean = steady(lattice, tau, height, collision).mean_velocity()[0] / height**2
                at = {
                    "resolution": height,
                    "resolution_of": "nodes between the plates",
                    "variant": f"{collision.upper()}, τ = {tau:g}",
                    "unit": "g h²/μ",
                }
                yield Comparison(
                    "mean velocity", mean, exact, 1e-7 if collision == "trt" else None, **at
                )
                if collision == "bgk":
                    slip = (4 / 3 * (tau - 0.5) ** 2 - 0.25) / (2 * height**2)
                    yield Comparison("slip velocity", mean - exact, slip, 1e-6, **at)


def duct_poiseuille() -> Iterator[Comparison]:
    """Mean and largest velocity in rectangular ducts.

    Mark: the walls are exact and the flow smooth, so the error is (1/h)² times a factor that the
    corners keep below 2: 2/h².
    """
    for row in read_reference("duct_poiseuille"):
        ratio = row["width_over_height"]
        if ratio not in (1, 3, 5):  # odd: a node in the middle
            continue
        for height in (9, 17, 33):
            solid = np.zeros((1, round(ratio * height) + 1), bool)
            solid[0, 0] = True
            lattice = make_lattice(solid, height, walls=True, dtype=np.float64)
            u = steady(lattice, RELAXATION_TIME, height).velocity_field()[0]
            at = {
                "parameter": ratio,
                "parameter_of": "width / height",
                "resolution": height,
                "resolution_of": "nodes over the height",
            }
            yield Comparison(
                "mean velocity",
                u.mean() / height**2,
                row["mean_velocity_over_G_h2_mu"],
                2 / height**2,
                "g h²/μ",
                **at,
            )
            yield Comparison(
                "largest / mean velocity",
                u.max() / u.mean(),
                row["umax_over_mean"],
                2 / height**2,
                **at,
            )


def taylor_green() -> Iterator[Comparison]:
    """Decay rate of a vortex, in units of 2νk², and its order.

    The velocity falls with the spacing (diffusive scaling), so that errors of compressibility are
    of second order too. Marks: an error below k² (spacing 1, wave number k = 2π/n), and an order of
    2 within 5 % between the two finest.
    """
    for inertia in (False, True):
        variant = "Navier-Stokes" if inertia else "Stokes"
        errors = []
        for n in (16, 32, 64):
            rate = _decay_rate(n, 1.25, inertia)
            errors.append(abs(rate - 1))
            yield Comparison(
                "decay rate",
                rate,
                1.0,
                (2 * np.pi / n) ** 2,
                "2νk²",
                variant,
                resolution=n,
                resolution_of="nodes per wavelength",
            )
        yield Comparison(
            "order of the decay rate", np.log2(errors[-2] / errors[-1]), 2.0, 0.05, variant=variant
        )


def _decay_rate(n: int, relaxation_time: float, inertia: bool) -> float:
    lattice = make_lattice(np.zeros((n, n), bool), 1, walls=False, dtype=np.float64)
    fluid = Fluid(lattice, relaxation_time, "trt", inertia, np.dtype("float64"))
    k = 2 * np.pi / n
    x, y = (k * (i.ravel() + 0.5) for i in np.indices((n, n)))
    vortex = 0.1 / n * np.stack([np.cos(x) * np.sin(y), -np.sin(x) * np.cos(y), 0 * x])
    f = fluid.f.reshape(19, -1)[:, : lattice.nodes]
    f[:] = 3 * WEIGHTS[:, None] * (VELOCITIES @ vortex)
    rate = 2 * viscosity(relaxation_time) * k**2
    settle, steps = (2 * round(share / rate / 2) for share in (1, 2))
    amplitude = []
    for count in (settle, steps):
        fluid.advance(count)
        amplitude.append((fluid.velocity_field()[:, :, 0] * vortex).sum())
    return float(np.log(amplitude[0] / amplitude[1]) / steps / rate)


def viscosity_independence() -> Iterator[Comparison]:
    """Permeability of a square array at several relaxation times over that at τ = 1.25.

    Marks: with TRT only the magic parameter enters (Ginzburg et al. 2008, Commun. Comput. Phys.
    3:427), so 1e-6, what the iteration leaves; BGK is shown without a mark.
    """
    for collision, bounce_back in (
        ("trt", "half-way"),
        ("trt", "interpolated"),
        ("bgk", "half-way"),
    ):
        for pitch in (12, 24):
            lattice = make_pillars(pitch, 0, pitch * radius_of(0.2), bounce_back=bounce_back)
            mean = {
                tau: steady(lattice, tau, pitch / 2, collision).mean_velocity()[0]
                for tau in (0.6, 0.8, 1.25, 2.0, 5.0)
            }
            for tau in (0.6, 0.8, 2.0, 5.0):
                yield Comparison(
                    "permeability / that at τ = 1.25",
                    mean[tau] / mean[1.25],
                    1.0,
                    1e-6 if collision == "trt" else None,
                    "1",
                    f"{collision.upper()}, {bounce_back}",
                    tau,
                    "relaxation time τ",
                    pitch,
                    PITCH,
                )


def radius_of(solid_fraction: float) -> float:
    """Pillar radius over pitch."""
    return (solid_fraction / np.pi) ** 0.5


def wall_mark(radii, values, radius: float, pitch: float, bounce_back: str) -> float:
    """Relative change of a tabulated quantity when the wall moves by WALL_ERROR.

    ``radii``, over pitch, and ``values`` are the reference table; ``pitch`` in nodes.
    """
    order = np.argsort(radii)
    radii, values = np.asarray(radii)[order], np.asarray(values)[order]
    slope = np.interp(radius, radii, np.gradient(np.log(values), radii))
    return float(abs(slope) * WALL_ERROR[bounce_back] / pitch)


def square_arrays() -> Iterator[Comparison]:
    """Permeability k/λ² of square arrays over the solid fraction.

    Mark: the error that a wall displaced by WALL_ERROR would make. The coarsest resolution has 24
    nodes per pitch, or four in the gap, the fewest that the solver accepts.
    """
    table = [r for r in read_reference("sangani_acrivos_1982") if r["drag_F_over_muU_computed"]]
    radii = [radius_of(r["solid_fraction"]) for r in table]
    exact = [1 / r["drag_F_over_muU_computed"] for r in table]
    for radius, permeability, row in zip(radii, exact, table, strict=True):
        if row["solid_fraction"] > 0.6:
            continue
        for bounce_back in WALL_ERROR:
            for pitch in (max(24, math.ceil(4 / (1 - 2 * radius))), 48, 96):
                lattice = make_pillars(pitch, 0, radius * pitch, bounce_back=bounce_back)
                fluid = steady(lattice, RELAXATION_TIME, (1 - radius) * pitch)
                yield Comparison(
                    "permeability",
                    fluid.mean_velocity()[0] / pitch**2,
                    permeability,
                    wall_mark(radii, exact, radius, pitch, bounce_back),
                    "λ²",
                    bounce_back,
                    row["solid_fraction"],
                    "solid fraction",
                    pitch,
                    PITCH,
                )


def _solve(
    row: dict, periodicity: int, height_um: float, spacing_um: float, bounce_back: str
) -> EmptyFlow:
    """Flow through the array of a reference row, by the call that the campaign makes."""
    radius = row["radius_over_pitch"] * PITCH_UM
    geometry = Geometry(
        pillar_radius_um=radius, gap_um=PITCH_UM - 2 * radius, periodicity=periodicity
    )
    numerics = Numerics(
        precision="float64",
        relaxation_time=RELAXATION_TIME,
        spacing_um=spacing_um,
        rows=1,
        bounce_back=bounce_back,
    )
    return solve_empty_array(geometry, Flow(height_um=height_um), numerics)


def _tensor_comparisons(
    flow: EmptyFlow, row: dict, table: list[dict], at: dict
) -> Iterator[Comparison]:
    """Permeabilities and tilt; ``table``: plane arrays of the same periodicity, for the marks."""
    summary, bounce_back = flow.summary(), flow.numerics.bounce_back
    at = at | {"variant": bounce_back, "resolution": flow.pitch, "resolution_of": PITCH}
    radii = [r["radius_over_pitch"] for r in table]
    name = f"R/λ = {row['radius_over_pitch']:g}"
    for axes in ("xx", "yy"):
        values = [r[f"K{axes}_over_pitch2"] for r in table]
        yield Comparison(
            f"permeability k_{axes}, {name}",
            summary[f"permeability_{axes}_over_pitch2"],
            row[f"K{axes}_over_pitch2"],
            wall_mark(radii, values, row["radius_over_pitch"], flow.pitch, bounce_back),
            "λ²",
            **at,
        )
    share = WALL_ERROR[bounce_back] / 10
    tilt = row["tilt_deg_axial_force"]
    array_angle = np.degrees(np.arctan(1 / flow.geometry.periodicity))
    yield Comparison(
        f"tilt, {name}", summary["tilt_deg"], tilt, share * array_angle / tilt, "°", **at
    )


def _plane_arrays(periodicity: int) -> list[dict]:
    return [
        r
        for r in read_reference("array_permeability_tensor_2d")
        if r["layout"] == "row-shifted" and r["periodicity"] == periodicity
    ]


def row_shifted_arrays() -> Iterator[Comparison]:
    """Permeability tensor, and tilt of the stream under an axial force, of plane arrays.

    Marks: permeabilities as in square_arrays. The tilt adds to the array angle atan(1/N_p), by
    which cells are sorted: its error may be 1 % of that angle (half of that in the critical
    diameter, D_c ∝ ε^0.48), five times as much with half-way bounce-back.
    """
    for periodicity in (4, 10, 20):
        table = _plane_arrays(periodicity)
        for row in table:
            if row["radius_over_pitch"] == 0.2:
                continue
            at = {"parameter": periodicity, "parameter_of": "periodicity N_p"}
            for bounce_back in WALL_ERROR:
                for spacing in SPACINGS_UM:
                    flow = _solve(row, periodicity, 0.0, spacing, bounce_back)
                    yield from _tensor_comparisons(flow, row, table, at)


def finite_height_arrays() -> Iterator[Comparison]:
    """Permeability and tilt of an array between plates, R/λ = 0.25 and N_p = 10.

    Marks as in row_shifted_arrays: the plates take a share of the drag, so that a misplaced pillar
    wall matters less than in the plane.
    """
    table = _plane_arrays(10)
    for row in read_reference("pillar_array_finite_height_3d"):
        if row["layout"] != "row-shifted":
            continue
        height = row["height_over_pitch"]
        at = {"parameter": height, "parameter_of": "height / pitch"}
        for bounce_back in WALL_ERROR:
            for spacing in (1.5, 1.0, 0.75):
                flow = _solve(row, 10, height * PITCH_UM, spacing, bounce_back)
                yield from _tensor_comparisons(flow, row, table, at)


def first_lane_width() -> Iterator[Comparison]:
    """Width β of the lane next to a pillar that carries 1/N_p of the flux, over the gap.

    Without lateral flux this lane passes below the next pillar of the shifted row; a point-like
    follower further out than β is displaced, so 2β is its critical diameter. The lattice of pillars
    has an inversion centre in the middle of each gap and Stokes flow is reversible: the profile
    across a gap is symmetric, and the lanes at its two pillars are equally wide. The mean of both
    is taken.

    Mark: a tenth of the 10 % by which devices scatter about the law D_c = 1.4 G ε^0.48; half of it
    with half-way bounce-back.
    """
    for row in read_reference("first_lane_width_2d"):
        periodicity = round(row["periodicity"])
        if periodicity not in (4, 10, 20) or row["radius_over_pitch"] == 0.2:
            continue
        for bounce_back in WALL_ERROR:
            for spacing in SPACINGS_UM[:2]:
                flow = _solve(row, periodicity, 0.0, spacing, bounce_back)
                nodes = row["gap_over_pitch"] * flow.pitch
                yield Comparison(
                    f"first lane, R/λ = {row['radius_over_pitch']:g}",
                    lane_width(flow),
                    row["first_lane_width_over_gap"],
                    WALL_ERROR[bounce_back] / 10,
                    "gap",
                    bounce_back,
                    periodicity,
                    "periodicity N_p",
                    flow.pitch,
                    PITCH,
                    note=f"only {nodes:.0f} nodes in the gap" if nodes < 10 else "",
                )


def lane_width(flow: EmptyFlow) -> float:
    """First lane width over gap of a plane array, from the velocity across the narrowest gap."""
    array = array_of(flow)
    lattice, pitch, radius = array.lattice, array.pitch, array.radius
    f = flow.populations.reshape(19, -1)[:, : lattice.nodes]
    u = VELOCITIES[:, 0] @ f - flow.body_force[0] / 2  # the step ends with a full force
    across = lattice.column[[(pitch - 1) // 2, pitch // 2]]  # twice the same for an odd pitch
    distance = np.mod(np.arange(pitch) + 0.5 - pitch / 2, pitch)  # from the pillar's centre
    inside = (distance > radius + NEAREST) & (distance < pitch - radius - NEAREST)
    order = np.flatnonzero(inside)[np.argsort(distance[inside])]
    y = np.concatenate([[radius], distance[order], [pitch - radius]]) - radius
    profile = np.concatenate([[0], u[across[:, order]].mean(axis=0), [0]])
    gap = pitch - 2 * radius
    flux = CubicSpline(y, profile).antiderivative()
    share = flux(gap) / flow.geometry.periodicity
    low, high = (
        flux.solve(share, extrapolate=False),
        flux.solve(flux(gap) - share, extrapolate=False),
    )
    return float((low[0] + gap - high[0]) / 2 / gap)
