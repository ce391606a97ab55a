"""Critical gaps by the surrogate: where cells of one size go over from bumping to zigzagging."""

import numpy as np
import pandas as pd

from dldsim.analysis.features import SHAPES, CellInFlow
from dldsim.analysis.surrogate import LEVEL, Surrogate, half_way
from dldsim.errors import DldsimError
from dldsim.laws import critical_diameter

PERIODICITIES = (4, 5, 6, 8, 10, 12)
PILLAR_RADIUS = 1.0
"""Pillar radius of the map in cell radii."""
HEIGHT = 8 / 3
"""Channel height of the map in cell radii: 20 µm for a cell of 7.5 µm."""
STEPS = 400
"""Gaps tried between the narrowest and the widest learnt, evenly in the logarithm."""
CAPILLARY_STEPS = 24


def transition_map(surrogate: Surrogate, level: float = LEVEL) -> pd.DataFrame:
    """Critical gaps over shape, N_p and Ca beside pillars of the cell's radius R.

    Columns: cell_shape, periodicity, capillary_number, gap_over_2R (null: no transition in what was
    learnt) with its _low and _high, size_over_critical_diameter (2R/D_c at the critical gap, with
    the law of stiff spheres). Between low and high the interval of that level holds half of the
    bump displacement; where it does so up to the narrowest or widest gap learnt, they end there.
    Raises DldsimError if nothing was learnt at this height beside such pillars.
    """
    rows = []
    for shape in SHAPES:
        if shape not in surrogate.domains:
            continue
        own = surrogate.domains[shape]
        learnt = own.geometries[:, 1]
        gap = np.geomspace(learnt.min(), learnt.max(), STEPS)
        for periodicity in PERIODICITIES:
            for capillary in np.geomspace(*own.capillary_number, CAPILLARY_STEPS):
                at = PILLAR_RADIUS, gap, periodicity, CellInFlow(shape, 1.0, HEIGHT, capillary)
                inside = surrogate.inside_domain(*at)
                if not inside.any():
                    continue
                critical = half_way(gap, surrogate.share(*at), inside)
                half = np.degrees(np.arctan(0.5 / periodicity))
                low, high = surrogate.predict_interval(*at, level)
                open_ = gap[inside & (low <= half) & (half <= high)]
                known = np.isfinite(critical) and open_.size
                rows.append(
                    {
                        "cell_shape": shape,
                        "periodicity": periodicity,
                        "capillary_number": capillary,
                        "gap_over_2R": critical / 2,
                        "gap_over_2R_low": open_.min() / 2 if known else float("nan"),
                        "gap_over_2R_high": open_.max() / 2 if known else float("nan"),
                        "size_over_critical_diameter": 2
                        / critical_diameter(critical, 1 / periodicity),
                    }
                )
    if not rows:
        raise DldsimError(
            f"No transition can be drawn: learnt were {surrogate.holds_for}, and not "
            f"beside pillars of the cell's radius in channels {HEIGHT:.3g} radii high.",
            key="height/R",
            value=HEIGHT,
            allowed=surrogate.holds_for,
            remedy="Learn from the survey as well (surrogate.survey: true).",
        )
    return pd.DataFrame(rows)
