"""Made-up outcomes: a campaign by formula, and a survey of discs and spheres by laws."""

from itertools import product

import numpy as np
import pandas as pd
from scipy.stats import qmc

from dldsim.analysis.features import CellInFlow
from dldsim.config.sections import Numerics
from dldsim.laws import critical_diameter
from dldsim.tables.numerics import columns_of

CAPILLARY = {0.5: 0.147, 0.65: 0.075, 0.78: 0.0369}
"""Capillary number of each deformation index: the larger the index, the stiffer the set."""
MADE_WITH = columns_of(Numerics()) | {"release_axis": "y", "drive": "no-lateral-flux"}


def cell(capillary_number=0.075, radius_um=7.5, height_um=20.0, shape="biconcave"):
    return CellInFlow(shape, radius_um, height_um, capillary_number)


def bump_or_zigzag(r, g, n, d):
    """Sharp but smooth transition at D_c of a cell of effective diameter 15 µm (1 − DI/2)."""
    excess = 15 * (1 - d / 2) - 1.4 * g * n**-0.48
    return np.degrees(np.arctan(1 / n)) / (1 + np.exp(-excess / 0.8))


def make_outcomes(
    angle=bump_or_zigzag,
    radii=(5.0, 7.5, 10.0),
    gaps=(14.0, 18.0, 22.0),
    rows=(4, 6, 10),
    indices=(0.5, 0.65, 0.78),
):
    return pd.DataFrame(
        [
            {
                "outcome_id": f"r{r:04.1f}_g{g:04.1f}_n{n:02d}_s{s}",
                "pillar_radius_um": r,
                "gap_um": g,
                "periodicity": n,
                "stiffness_set": str(s),
                "deformation_index": d,
                "capillary_number": CAPILLARY[d],
                "cell_radius_um": 7.5,
                "cell_shape": "biconcave",
                "height_um": 20.0,
                "migration_angle_deg": angle(r, g, n, d),
                "status": "decided",
                **MADE_WITH,
            }
            for r, g, n, (s, d) in product(radii, gaps, rows, enumerate(indices, 1))
        ]
    )


def size_of(shape, capillary_number, height_to_radius):
    """Effective diameter over 2R: of a disc least at Ca 0.17; of a sphere 1 in the stiff limit."""
    if shape == "sphere":
        return 1 - 0.3 * capillary_number
    return 0.62 + 0.012 * np.log(capillary_number / 0.17) ** 2 + 0.02 * (height_to_radius - 3)


def share_by_law(shape, pillar, gap, rows, capillary_number, height_to_radius):
    """Share of the bump displacement of a cell of radius 1, by the law of its effective size."""
    size = 2 * size_of(shape, capillary_number, height_to_radius)
    return 1 / (1 + np.exp(-np.log(size / critical_diameter(gap, 1 / rows)) / 0.04))


RANGES = {
    "biconcave": ((0.5, 1.7), (1.4, 3.2), (0.02, 1.0), (2.2, 4.0)),
    "sphere": ((0.5, 3.0), (2.3, 5.5), (0.01, 0.6), (2.2, 6.0)),
}


def make_survey(discs=90, spheres=70, seed=1):
    """Points that fill the ranges of arrays, Ca and height, half of them about the transition."""
    parts = []
    for shape, count in (("biconcave", discs), ("sphere", spheres)):
        unit = qmc.Sobol(6, rng=np.random.default_rng(seed)).random_base2(9)[:count]
        pillar, gap, capillary, height = RANGES[shape]
        frame = pd.DataFrame(
            {
                "pillar": pillar[0] + unit[:, 0] * np.ptp(pillar),
                "gap": gap[0] + unit[:, 1] * np.ptp(gap),
                "periodicity": np.floor(4 + 11 * unit[:, 2]).astype(int),
                "capillary_number": capillary[0] * (capillary[1] / capillary[0]) ** unit[:, 3],
                "height": height[0] + unit[:, 4] * np.ptp(height),
            }
        )
        size = 2 * size_of(shape, frame["capillary_number"], frame["height"])
        near = size / (0.75 + 0.6 * unit[:, 5]) / critical_diameter(1, 1 / frame["periodicity"])
        frame["gap"] = np.where(np.arange(count) % 2, frame["gap"], near.clip(*gap))
        share = share_by_law(
            shape,
            *(frame[n] for n in ("pillar", "gap", "periodicity", "capillary_number", "height")),
        )
        parts.append(
            pd.DataFrame(
                {
                    "outcome_id": [f"s{shape}-{i:04d}" for i in range(count)],
                    "pillar_radius_um": 7.5 * frame["pillar"],
                    "gap_um": 7.5 * frame["gap"],
                    "periodicity": frame["periodicity"],
                    "stiffness_set": [f"{shape}-{i:04d}" for i in range(count)],
                    "deformation_index": np.nan,
                    "capillary_number": frame["capillary_number"],
                    "cell_radius_um": 7.5,
                    "cell_shape": shape,
                    "height_um": 7.5 * frame["height"],
                    "migration_angle_deg": np.degrees(np.arctan(share / frame["periodicity"])),
                    "status": "decided",
                    **MADE_WITH,
                }
            )
        )
    return pd.concat(parts, ignore_index=True)
