"""Validation cases of red cells in flow; see :mod:`dldsim.evidence.validation`.

The membrane is that of the case `erythrocyte-stretching`, from the literature and not fitted: G =
5.3 µN/m, κ = 0.2 pN·µm, R = 3.91 µm.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from dldsim.config.sections import Cell, Flow, Numerics, Stiffness
from dldsim.errors import DldsimError
from dldsim.evidence.reference import read_reference
from dldsim.evidence.validation import Comparison
from dldsim.evidence.validation_assays import sheared
from dldsim.evidence.validation_membrane import ERYTHROCYTE
from dldsim.experiments.passage import refined_step
from dldsim.experiments.runner import Stop, advance_until
from dldsim.solver import membrane as mb
from dldsim.solver.flow import Fluid, advance_to_steady
from dldsim.solver.lattice import Lattice, make_lattice
from dldsim.solver.observe import Sample
from dldsim.solver.scene import CellInFlow
from dldsim.solver.units import Units
from dldsim.vocabulary import UNSTABLE

RADIUS_UM = ERYTHROCYTE["radius_um"]
STRESSES = 0.95, 3.0, 9.49, 30.0
"""Of the ektacytometer's nine [Pa]."""
SHEARED_NODES = 5
STRAIN, AVERAGED = 40.0, 20.0
"""Strain of a run, and the last part of it that is averaged: a disc turns in 21."""
PLATEAU_PA = 5.0
"""Above it the elongation is what area and volume leave room for."""
PLATEAU_MARK = 0.1
"""Relative: K/G of this membrane lets the area grow, viscosities inside differ."""
VISCOSITY_OF_ANGLES = 10.7
"""Of the suspending liquid [mPa s], about that of a red cell's inside, as in the simulation."""


def red_cell(**changes: float) -> Stiffness:
    """Membrane of a red cell, k_s and k_b from its shear and bending modulus."""
    given = {
        "ks_uN_per_m": ERYTHROCYTE["shear_modulus"] / mb.shear_modulus(1.0),
        "kb_pN_um": ERYTHROCYTE["bending_modulus"] / mb.bending_modulus(1.0),
        "kal_uN_per_m": ERYTHROCYTE["kal"],
        "kag_uN_per_m": ERYTHROCYTE["kag"],
        "kv_Pa": ERYTHROCYTE["kv"],
        "kvisc_nN_s_per_m": 0.0,
    }
    return Stiffness(**{**given, **changes})


# ------------------------------------------------------------------------------ red cell in shear


def red_cell_in_shear() -> Iterator[Comparison]:
    """Elongation and inclination of a red cell in shear, as the assay `shear` simulates it.

    Elongation index beside an ektacytometer's. There the liquid is three to four times as viscous
    as the inside of the cell, here as viscous, and the membrane has no viscosity: what turns and
    sways the cell differs, so that nothing is marked at low stress. On the plateau above 5 Pa,
    where area and volume decide, the mark is 10 %. Inclination beside cells in a liquid of 10.7
    mPa s, about the viscosity of their inside: the donors' bounds are the mark.
    """
    table = {row["shear_stress_Pa"]: row for row in read_reference(ELONGATION)}
    cell = Cell(shape="biconcave", radius_um=RADIUS_UM, axis="z")
    for stress in STRESSES:
        run = sheared(red_cell(), stress, cell, SHEARED_NODES, STRAIN)
        late = run.strain > STRAIN - AVERAGED
        index, angle = run.elongation[late], run.inclination_deg[late]
        about = {
            "parameter": stress,
            "parameter_of": "shear stress [Pa]",
            "resolution": SHEARED_NODES,
            "resolution_of": "radius of the cell",
        }
        yield Comparison(
            "elongation index",
            index.mean(),
            table[stress]["elongation_index"],
            PLATEAU_MARK if stress > PLATEAU_PA else None,
            source=table[stress]["source"],
            note=f"swings from {index.min():.3f} to {index.max():.3f}; area "
            f"{run.area[late].mean() - 1:+.1%}",
            **about,
        )
        if bounds := angles(stress):
            mean, low, high, source = bounds
            bound = high if angle.mean() > mean else low
            yield Comparison(
                "inclination",
                angle.mean(),
                mean,
                abs(bound / mean - 1),
                "deg",
                source=source,
                note=f"sways from {angle.min():.1f}° to {angle.max():.1f}°",
                **about,
            )


ELONGATION, ANGLES = "red_cell_elongation_ektacytometer", "red_cell_inclination"


def angles(stress_Pa: float) -> tuple[float, float, float, str] | None:
    """Mean, lowest and highest inclination [deg] of the donors' cells at a stress, and the source;
    None outside of what was measured. Between shear rates by their logarithm."""
    rows = read_reference(ANGLES)
    rates = np.array([row["shear_rate_per_s"] for row in rows])
    rate = stress_Pa / VISCOSITY_OF_ANGLES * 1e3
    if not rates[0] <= rate <= rates[-1]:
        return None
    values = (
        float(np.interp(np.log(rate), np.log(rates), [row[name] for row in rows]))
        for name in ("mean_deg", "lowest_deg", "highest_deg")
    )
    return *values, rows[0]["source"]


# ------------------------------------------------------------------------------- red cell in a tube

LENGTHS = "red_cell_length_in_tube"
TUBE_SPACINGS_UM = 0.33, 0.25
TUBE_VELOCITIES_MM_S = 0.8, 6.0
"""Mean of the tube without the cell, to which the pressure is set."""
TUBE_PERIOD_UM = 20.0
TUBE_FLOW = Flow(viscosity_mPa_s=1.0)
"""Of the watery liquid at room temperature; the inside is at rest in a steady axisymmetric shape,
so that its viscosity does not matter."""
SQUEEZED = 0.75
"""Width at the start over that at rest, at equal volume: the cell is wider than the tube."""
TRAVEL = 25.0
"""Of the mean flow, in radii of the cell."""
AREA = 5000.0
"""k_ag [µN/m], ten times that of the other cases: in a tube the length is what the area leaves."""


class Carried(NamedTuple):
    """A cell in a tube: length and velocity over the last fifth of its way, change of the length
    over that, and area over that at rest."""

    length_um: float
    velocity_mm_s: float
    change_um: float
    area: float
    steps: int


def red_cell_in_tube() -> Iterator[Comparison]:
    """Length of a red cell in a glass capillary of 6.6 µm over its velocity.

    The cell starts squeezed, facing the flow, on the axis, and takes the shape of a parachute or a
    bullet. Mark: the experiment's error bars, between its velocities by their logarithm.
    """
    rows = read_reference(LENGTHS)
    speeds = np.log([row["cell_velocity_mm_s"] for row in rows])
    diameter = rows[0]["tube_diameter_um"]
    for velocity in TUBE_VELOCITIES_MM_S:
        for spacing in TUBE_SPACINGS_UM:
            seen = in_tube(red_cell(kag_uN_per_m=AREA), diameter, velocity, spacing)
            at = np.log(seen.velocity_mm_s)
            mean, low, high = (
                float(np.interp(at, speeds, [row[name] for row in rows]))
                for name in ("length_um", "length_lo_um", "length_hi_um")
            )
            bound = high if seen.length_um > mean else low
            yield Comparison(
                "length",
                seen.length_um,
                mean,
                abs(bound / mean - 1),
                "µm",
                parameter=velocity,
                parameter_of="mean velocity of the tube [mm/s]",
                resolution=RADIUS_UM / spacing,
                resolution_of="radius of the cell",
                source=rows[0]["source"],
                note=f"cell at {seen.velocity_mm_s:.2f} mm/s; length changed by "
                f"{seen.change_um:+.2f} µm in the last fifth; area {seen.area - 1:+.1%}; "
                f"{seen.steps} steps",
            )


def make_tube(diameter: float, length: int, dtype) -> tuple[Lattice, float]:
    """A round tube along z, ``diameter`` in nodes, and the place of its axis across."""
    width = int(np.ceil(diameter)) + 2
    centre, radius = width / 2, diameter / 2
    x = np.arange(width) + 0.5 - centre
    solid = x[:, None] ** 2 + x**2 >= radius**2

    def link_fraction(ix, iy, cx, cy):
        """Distance from a fluid column to the wall along (cx, cy), in links."""
        px, py = ix + 0.5 - centre, iy + 0.5 - centre
        a, b, c = cx**2 + cy**2, px * cx + py * cy, px**2 + py**2 - radius**2
        return np.minimum((np.sqrt(b**2 - a * c) - b) / a, 1)

    return make_lattice(
        solid, length, walls=False, link_fraction=link_fraction, dtype=dtype
    ), centre


def in_tube(
    stiffness: Stiffness, diameter_um: float, velocity_mm_s: float, spacing_um: float
) -> Carried:
    """Carry a red cell along a tube under the pressure of a mean velocity. Raises DldsimError if
    the run leaves its safe range."""
    numerics = Numerics(contact_range_um=0, half_scene=False)
    length, diameter = round(TUBE_PERIOD_UM / spacing_um), diameter_um / spacing_um
    lattice, centre = make_tube(diameter, length, np.dtype(numerics.precision))
    flow = TUBE_FLOW.model_copy(update={"mean_velocity_mm_s": velocity_mm_s})
    cell = Cell(shape="biconcave", radius_um=RADIUS_UM, axis="z")
    place = centre, centre, length / 2
    radius = RADIUS_UM / spacing_um

    def make_scene(numerics: Numerics) -> CellInFlow:
        units = Units.of(spacing_um, flow, numerics)
        fluid = Fluid.of(lattice, numerics)
        force = 8 * units.viscosity_lu * numerics.velocity_lu / (diameter / 2) ** 2
        fluid.set_body_force((0.0, 0.0, force))
        return CellInFlow(fluid, units, cell, stiffness, numerics, {})

    numerics = refined_step(make_scene, place, numerics, 1.0, TRAVEL * radius, None)
    scene = make_scene(numerics)
    advance_to_steady(scene.fluid, diameter / 2)
    scene.place(place)
    scene.body.x[:] = place + (scene.body.x - place) * (SQUEEZED, SQUEEZED, SQUEEZED**-2)
    steps = radius / numerics.velocity_lu
    rows = []

    def watch(sample: Sample) -> Stop | None:
        rows.append((sample.step, sample.centre[2], sample.extent[2], sample.area_ratio))
        done = sample.step >= TRAVEL * steps
        return Stop("converged", "the cell has gone its way") if done else None

    stop = advance_until(scene, 2 * max(1, round(steps / 8)), watch)
    if stop.status == UNSTABLE:
        raise DldsimError(f"Red cell in a tube at {velocity_mm_s:g} mm/s: {stop.reason}.")
    step, z, extent, area = np.array(rows)[-len(rows) // 5 :].T
    speed = np.polyfit(step, z, 1)[0]
    return Carried(
        extent.mean() * spacing_um,
        float(scene.units.velocity_from_lu(speed)),
        (extent[-1] - extent[0]) * spacing_um,
        area.mean(),
        scene.steps,
    )
