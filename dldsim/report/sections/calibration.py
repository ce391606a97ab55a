"""Calibration of the deformation index in the constriction."""

import pandas as pd
from markupsafe import Markup

from dldsim.report import calibration_figures
from dldsim.report.formats import NOT_MEASURED, fixed, numbers, plus_minus, ranges, texts
from dldsim.report.page import Grid, Page, Picture
from dldsim.tables.parquet import read_table


def contents(page: Page) -> dict:
    runs, calibration = page["constriction_runs"], page["calibration"]
    broken = runs[runs["deformation_index"].isna()]
    diameters, tracks = _diameters(page)
    return {
        "broken": page.table(
            {
                "run": texts(broken["run_id"]),
                "group": texts(broken["group"]),
                "status": texts(broken["status"]),
                "reason": texts(broken["stop_reason"]),
            },
            ["constriction_runs"],
        )
        if len(broken)
        else None,
        "calibration": page.figure(
            "calibration",
            calibration_figures.draw_calibration(runs, calibration),
            ["constriction_runs", "calibration"],
        )
        if len(calibration)
        else None,
        "correlations": page.figure(
            "correlations",
            calibration_figures.draw_correlations(page["calibration_correlations"]),
            ["calibration_correlations"],
        )
        if len(calibration) and page.some("calibration_correlations")
        else None,
        "values": _values(page, calibration) if len(calibration) else None,
        "moduli": page.figure(
            "moduli", calibration_figures.draw_moduli(runs), ["constriction_runs"]
        )
        if runs["deformation_index"].notna().any()
        else None,
        "diameters": diameters,
        "tracks": tracks,
    }


def _values(page: Page, table: pd.DataFrame) -> Grid:
    return page.table(
        {
            "design": texts(table["design"]),
            "group": texts(table["group"]),
            "set": texts(table["stiffness_set"]),
            Markup("<i>k</i><sub>s</sub> [µN/m]"): numbers(table["ks_uN_per_m"]),
            Markup("<i>k</i><sub>b</sub> [pN·µm]"): numbers(table["kb_pN_um"]),
            Markup("<i>k</i><sub>α</sub> [µN/m]"): numbers(table["kal_uN_per_m"]),
            "velocity [mm/s]": numbers(table["velocity_mm_s"], 4),
            "runs": numbers(table["runs"]),
            "DI": plus_minus(table["deformation_index"], table["deformation_index_std"], 3),
            "95 % interval of the mean": ranges(
                table["deformation_index_low"], table["deformation_index_high"], 3
            ),
            "range": ranges(table["deformation_index_min"], table["deformation_index_max"], 3),
            "variation": [
                f"{fixed(100 * v, 1)} %" if pd.notna(v) else NOT_MEASURED
                for v in table["coefficient_of_variation"]
            ],
        },
        ["calibration"],
    )


def _diameters(page: Page) -> tuple[Picture | None, int]:
    """The figure of the trajectories in the constriction, and how many there are."""
    folder = page.results / "constriction"
    runs = page["constriction_runs"]
    known = set(runs["run_id"])
    tracks = [
        read_table("constriction_trajectory", path)
        for path in sorted(folder.glob("*.trajectory.parquet"))
    ]
    tracks = [part for track in tracks if len(part := track[track["run_id"].isin(known)])]
    if not tracks:
        return None, 0
    figure = calibration_figures.draw_diameters(pd.concat(tracks), runs)
    links = [page.link(folder)] if page.linked else []
    return page.figure("diameters", figure, ["constriction_runs"], links), len(tracks)
