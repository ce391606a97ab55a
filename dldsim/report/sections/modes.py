"""Migration modes: row maps near the transition, and the law for rigid spheres."""

from dldsim.report import angle_figures, trajectory_figures
from dldsim.report.page import Page, Picture
from dldsim.report.style import measured
from dldsim.vocabulary import GEOMETRY

ROW_MAPS = 6
"""Arrays whose row maps are drawn."""


def contents(page: Page) -> dict | None:
    outcomes = page["outcomes"]
    if measured(outcomes).empty:
        return None
    points = angle_figures.mode_points(outcomes, page.setting("cell", "aspect_ratio") or 1.0)
    right_side = (points["mode"] == "bump") & (points["size_over_critical"] > 1) | (
        points["mode"] == "zigzag"
    ) & (points["size_over_critical"] < 1)
    maps, arrays = _row_maps(page) if "runs" in page else (None, 0)
    return {
        "row_maps": maps,
        "arrays": arrays,
        "mode_map": page.figure("mode_map", angle_figures.draw_mode_map(points), ["outcomes"]),
        "size": float(points["size_um"].median()),
        "right": int(right_side.sum()),
        "told": int(points["mode"].isin(["bump", "zigzag"]).sum()),
    }


def _row_maps(page: Page) -> tuple[Picture | None, int]:
    """Row maps of the arrays in which an outcome comes nearest to the transition."""
    near = page["outcomes"].dropna(subset="transition_distance")
    near = near.assign(away=near["transition_distance"].abs()).sort_values("away", kind="stable")
    places = near[list(GEOMETRY)].drop_duplicates().head(ROW_MAPS)
    runs = page["runs"].merge(places, on=list(GEOMETRY))
    runs = runs[runs["lateral_steps_um"].map(len) > 0].drop_duplicates("outcome_id")
    if runs.empty:
        return None, 0
    figure = trajectory_figures.draw_row_maps(runs)
    return page.figure("row_maps", figure, ["runs", "outcomes"]), len(places)
