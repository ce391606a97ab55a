"""All outcomes, one row each."""

import numpy as np
from markupsafe import Markup

from dldsim.report.formats import NOT_MEASURED, decimals, numbers, plus_minus, ranges, texts
from dldsim.report.page import Page
from dldsim.report.style import mode_name, settled


def contents(page: Page) -> dict:
    outcomes = page["outcomes"].sort_values("outcome_id")
    shares = outcomes[[f"share_{mode}" for mode in ("bump", "mixed", "zigzag")]].to_numpy(float)
    return {
        "grid": page.table(
            {
                "outcome": texts(outcomes["outcome_id"]),
                "status": texts(outcomes["status"]),
                "mode": map(mode_name, outcomes["mode"]),
                Markup("θ<sub>m</sub> [°]"): plus_minus(
                    outcomes["migration_angle_deg"], outcomes["sigma_num_deg"]
                ),
                "95 % interval [°]": ranges(outcomes["angle_low_deg"], outcomes["angle_high_deg"]),
                "spread [°]": decimals(outcomes["angle_spread_deg"]),
                "source's protocol [°]": decimals(outcomes["source_angle_deg"]),
                "bump [°]": decimals(outcomes["bump_angle_deg"]),
                "bump, mixed, zigzag [%]": [
                    ", ".join(f"{100 * v:.0f}" for v in row)
                    if np.isfinite(row).all()
                    else NOT_MEASURED
                    for row in shares
                ],
                "distance from the transition": decimals(outcomes["transition_distance"]),
                "releases": numbers(outcomes["releases"]),
                "rows": numbers(outcomes["rows_total"]),
                "DI": decimals(outcomes["deformation_index"], 3),
                "time [s]": numbers(outcomes["wall_time_s"], 2),
            },
            ["outcomes"],
            ~settled(outcomes),
            texts(outcomes["stop_reason"]),
        )
    }
