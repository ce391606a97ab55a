"""All runs, one row for each place of release."""

import pandas as pd
from markupsafe import Markup

from dldsim.report.formats import NOT_MEASURED, decimals, number, numbers, ranges, texts
from dldsim.report.page import Page
from dldsim.report.style import mode_name, settled


def contents(page: Page) -> dict:
    runs = page["runs"].sort_values("run_id")
    return {
        "grid": page.table(
            {
                "run": texts(runs["run_id"]),
                "status": texts(runs["status"]),
                "mode": map(mode_name, runs["mode"]),
                Markup("θ<sub>m</sub> [°]"): decimals(runs["migration_angle_deg"]),
                "95 % interval [°]": ranges(runs["angle_low_deg"], runs["angle_high_deg"]),
                "first period [°]": decimals(runs["first_period_angle_deg"]),
                "rows": numbers(runs["rows_completed"]),
                "orbit [rows]": [number(int(v)) if v else NOT_MEASURED for v in runs["orbit_rows"]],
                "settled from row": [
                    NOT_MEASURED if pd.isna(v) else number(int(v)) for v in runs["settled_row"]
                ],
                "largest step [row shifts]": decimals(runs["row_map_peak"]),
                "time [s]": numbers(runs["wall_time_s"], 2),
            },
            ["runs"],
            ~settled(runs),
            texts(runs["stop_reason"]),
        )
    }
