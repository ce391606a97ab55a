"""Validation case of a red cell in shear; see :mod:`dldsim.evidence.validation`.

The membrane is that of the case `erythrocyte-stretching`, from the literature and not fitted: G =
5.3 µN/m, κ = 0.2 pN·µm, R = 3.91 µm. Beside it Skalak membranes, since the area terms of the
network resist shear: under a mean tension σ a face stretched to λ₁, λ₂ pulls along these with 2σ
λ₁²/(λ₁² + λ₂²) and 2σ λ₂²/(λ₁² + λ₂²), at small strain as if G were G + σ; and the network with
`numerics.area_forces: gradient`, whose area terms do not.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import product

import numpy as np

from dldsim.config.sections import Cell, Flow, Numerics, Stiffness
from dldsim.evidence.reference import read_reference
from dldsim.evidence.validation import Comparison
from dldsim.evidence.validation_assays import sheared
from dldsim.evidence.validation_membrane import ERYTHROCYTE
from dldsim.solver import membrane as mb
from dldsim.solver.units import Units

RADIUS_UM = ERYTHROCYTE["radius_um"]
STRESSES = 0.95, 3.0, 9.49, 30.0
"""Of the ektacytometer's nine [Pa]."""
SHEARED_NODES = 5
STRAIN, AVERAGED = 40.0, 20.0
"""Strain of a run, and the last part of it that is averaged: a disc turns in 21."""
PLATEAU_PA = 5.0
"""Above it the elongation is what area and volume leave room for."""
PLATEAU_MARK = 0.1
"""Relative: K/G of these membranes lets the area grow, viscosities inside differ."""
VISCOSITY_OF_ANGLES = 10.7
"""Of the suspending liquid [mPa s], about that of a red cell's inside, as in the simulation."""


RED_CELL = Stiffness(
    ks_uN_per_m=ERYTHROCYTE["shear_modulus"] / mb.shear_modulus(1.0),
    kb_pN_um=ERYTHROCYTE["bending_modulus"] / mb.bending_modulus(1.0),
    kal_uN_per_m=ERYTHROCYTE["kal"],
    kag_uN_per_m=ERYTHROCYTE["kag"],
    kv_Pa=ERYTHROCYTE["kv"],
    kvisc_nN_s_per_m=0,
)
"""k_s and k_b from the shear and bending modulus."""
SKALAK_SHEAR_MODULUS = 2.5
"""µN/m, ± 0.4: of the linear regime in optical tweezers, and that with which Skalak's law fits
tweezers and ektacytometers (Dimitrakopoulos 2012, Phys. Rev. E 85:041917). 5.3 is with neo-Hooke's.
"""
SKALAK_AREA_MODULUS = 1060.0
"""µN/m: a red cell's is 450 000, which no time step would bear."""
ELONGATION, ANGLES = "red_cell_elongation_ektacytometer", "red_cell_inclination"


def skalak(shear_modulus: float, units: Units) -> mb.Moduli:
    """A continuous membrane of a shear modulus [µN/m] with the bending modulus of `RED_CELL`, in
    lattice units, its volume held as well as the step bears; K = (1 + 2C) G."""
    return mb.Moduli(
        ks=0.0,
        kb=units.energy(RED_CELL.kb_pN_um),
        kal=0.0,
        kag=0.0,
        kv=math.inf,
        kvisc=0.0,
        skalak=units.surface_modulus(shear_modulus),
        skalak_c=(SKALAK_AREA_MODULUS / shear_modulus - 1) / 2,
    )


NETWORK, ISOTROPIC = "network", "network, isotropic area terms"
MEMBRANES: Mapping[str, Stiffness | Callable[[Units], mb.Moduli]] = {
    NETWORK: RED_CELL,
    ISOTROPIC: RED_CELL,
} | {
    f"Skalak, G {modulus} µN/m": partial(skalak, modulus)
    for modulus in (ERYTHROCYTE["shear_modulus"], SKALAK_SHEAR_MODULUS)
}


def red_cell_in_shear() -> Iterator[Comparison]:
    """Elongation and inclination of a red cell in shear, as the assay `shear` simulates it.

    The network; the network with isotropic area terms and Skalak's law with the network's G, to see
    what the network's area terms do; and Skalak's law with the G that belongs to it. Elongation
    index beside an ektacytometer's. There the liquid is more viscous than the inside of the cell,
    here it is as viscous, and the membrane has no viscosity: at one stress cells are drawn out less
    in a less viscous liquid (Fischer & Korzeniewski 2011, Cytometry A 79:946), so that nothing is
    marked at low stress. On the plateau
    above 5 Pa, where area and volume decide, the mark is 10 %. Inclination beside cells in a
    liquid of 10.7 mPa s, about the viscosity of their inside: the donors' bounds are the mark.
    """
    table = {row["shear_stress_Pa"]: row for row in read_reference(ELONGATION)}
    cell = Cell(shape="biconcave", radius_um=RADIUS_UM, axis="z")
    for (name, membrane), stress in product(MEMBRANES.items(), STRESSES):
        forces = Numerics(area_forces="gradient" if name == ISOTROPIC else "to-centroid")
        run = sheared(membrane, stress, cell, SHEARED_NODES, STRAIN, Flow(), forces)
        late = run.strain > STRAIN - AVERAGED
        index, angle = run.elongation[late], run.inclination_deg[late]
        about = {
            "variant": name,
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
