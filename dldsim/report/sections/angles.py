"""Migration angles over geometry and deformability."""

from dldsim.report import angle_figures
from dldsim.report.page import Page
from dldsim.report.style import measured


def contents(page: Page) -> dict:
    outcomes = page["outcomes"]
    points = measured(outcomes)
    if points.empty:
        return {"known": False}
    indexed = points["deformation_index"].notna().any()
    return {
        "known": True,
        "angles": page.figure("angles", angle_figures.draw_angles(outcomes), ["outcomes"]),
        "deformability": page.figure(
            "deformability",
            angle_figures.draw_deformability(outcomes),
            ["outcomes", *(["calibration"] if "calibration" in page else [])],
        )
        if indexed
        else None,
        "density": page.figure("density", angle_figures.draw_density(outcomes), ["outcomes"])
        if indexed
        else None,
        "boxes": page.figure("boxes", angle_figures.draw_boxes(outcomes), ["outcomes"]),
        "factors": page.figure("factors", angle_figures.draw_factors(outcomes), ["outcomes"]),
        "first_period": page.figure(
            "first_period", angle_figures.draw_first_period(outcomes), ["outcomes"]
        )
        if points["source_angle_deg"].notna().any()
        else None,
    }
