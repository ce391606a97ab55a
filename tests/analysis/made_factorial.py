"""Full factorials of made-up angles, for the analysis of variance."""

from itertools import product

import numpy as np
import pandas as pd

DI = {"1": 0.50, "2": 0.60, "3": 0.78}


def factorial(angle, radii=(6, 8, 10), gaps=(18, 20, 22), rows=(4, 6, 8), sets=DI):
    """One row per geometry and set; angle(P_r, P_g, N_p, DI) in degrees."""
    return pd.DataFrame(
        [
            {
                "pillar_radius_um": r,
                "gap_um": g,
                "periodicity": n,
                "stiffness_set": s,
                "deformation_index": sets[s],
                "migration_angle_deg": angle(r, g, n, sets[s]),
            }
            for r, g, n, s in product(radii, gaps, rows, sets)
        ]
    )


def noisy(seed=0, **effects):
    rng = np.random.default_rng(seed)
    return lambda r, g, n, d: (
        effects.get("r", 0) * r
        + effects.get("g", 0) * g
        + effects.get("n", 0) * n
        + effects.get("d", 0) * d
        + effects.get("rd", 0) * r * d
        + effects.get("gn", 0) * g * n
        + rng.normal(scale=0.1)
    )


def pick(table, model, term):
    rows = table[(table["model"] == model) & (table["term"] == term)]
    assert len(rows) == 1, (model, term, table)
    return rows.iloc[0]
