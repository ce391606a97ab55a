"""Flow through the arrays without a cell."""

from dldsim.report import flow_figures
from dldsim.report.formats import array_columns, decimals, numbers, texts
from dldsim.report.page import Page


def contents(page: Page) -> dict | None:
    table = page["flows"]
    if table.empty:
        return None
    if table["permeability_over_pitch2"].isna().all():
        return {"known": False}
    return {
        "known": True,
        "worst": float(table["lateral_flux_ratio"].abs().max()),
        "flows": page.figure("flows", flow_figures.draw_flows(table), ["flows"]),
        "grid": page.table(
            {
                **array_columns(table),
                "permeability/λ²": numbers(table["permeability_over_pitch2"]),
                "tilt [°]": decimals(table["tilt_deg"]),
                "lateral/axial flux": numbers(table["lateral_flux_ratio"], 2),
                "follower D_c [µm]": decimals(table["follower_diameter_um"]),
                "Δx [µm]": numbers(table["spacing_um"]),
                "nodes": numbers(table["nodes"]),
                "steps": numbers(table["steps"]),
                "time [s]": numbers(table["wall_time_s"], 2),
                "status": texts(table["status"]),
            },
            ["flows"],
        ),
    }
