"""Cost and conservation of the runs."""

from collections.abc import Callable

import numpy as np
from markupsafe import Markup

from dldsim.report import flow_figures
from dldsim.report.formats import number, numbers, texts
from dldsim.report.page import Page

QUANTITIES = {
    "ms_per_step": ("wall time per step", "ms"),
    "mlups": ("speed", "MLUPS"),
    "steps": ("steps", "1"),
    "nodes": ("fluid nodes", "1"),
    "vertices": ("membrane vertices", "1"),
    "wall_time_s": ("wall time per run", "s"),
    "spacing_um": ("lattice spacing Δx", "µm"),
    "time_step_us": ("time step", "µs"),
    "capillary_number": (Markup("capillary number μU/k<sub>s</sub>"), "1"),
    "lag_number": ("lag number (numerical Reynolds number)", "1"),
    "mach_max": ("largest Mach number", "1"),
    "volume_drift_max": ("largest volume drift", "1"),
    "area_drift_max": ("largest area drift", "1"),
    "min_clearance_um": ("smallest clearance", "µm"),
    "lateral_flux_ratio": ("lateral/axial flux", "1"),
}


def contents(page: Page) -> dict | None:
    runs = page["runs"]
    if runs.empty:
        return None
    names = [name for name in QUANTITIES if runs[name].notna().any()]

    def column(what: Callable) -> list[str]:
        return [number(float(what(runs[name].dropna())), 3) for name in names]

    left_out = runs["left_out"].fillna("").replace("", "nothing").value_counts()
    return {
        "cost": page.figure("numerics", flow_figures.draw_numerics(runs), ["runs"]),
        "quantities": page.table(
            {
                "quantity": [QUANTITIES[n][0] for n in names],
                "unit": [QUANTITIES[n][1] for n in names],
                "smallest": column(np.min),
                "median": column(np.median),
                "largest": column(np.max),
            },
            ["runs"],
        ),
        "left_out": page.table(
            {
                "left out of the simulation": texts(left_out.index),
                "runs": numbers(left_out.to_numpy()),
            },
            ["runs"],
        ),
    }
