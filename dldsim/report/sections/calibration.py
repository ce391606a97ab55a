"""Assays: what each tells apart, and the source's slit."""

import pandas as pd
from markupsafe import Markup

from dldsim.config.assay_sections import FIXED_VELOCITY, GROUP_VELOCITY
from dldsim.report import assay_figures, calibration_figures
from dldsim.report.formats import NOT_MEASURED, fixed, numbers, plus_minus, texts
from dldsim.report.page import Grid, Page, Picture
from dldsim.tables.parquet import read_table

SOURCE = (GROUP_VELOCITY, FIXED_VELOCITY)
"""The assays of the source's slit, which stand beside its figures."""
CAUSES = {
    "release": "std_release",
    "off axis": "std_offset",
    "size": "std_size",
    "orientation": "std_orientation",
}


def contents(page: Page) -> dict:
    runs, calibration = page["assay_runs"], page["calibration"]
    broken = runs[runs["deformation_index"].isna()]
    source = runs[runs["assay"].isin(SOURCE)]
    curves = calibration[calibration["assay"].isin(SOURCE)]
    correlations = None
    if len(curves) and page.some("calibration_correlations"):
        pairs = page["calibration_correlations"]
        correlations = page.figure(
            "correlations",
            calibration_figures.draw_correlations(pairs[pairs["assay"].isin(SOURCE)]),
            ["calibration_correlations"],
        )
    diameters, tracks = _diameters(page, source)
    return {
        "broken": page.table(
            {
                "passage": texts(broken["run_id"]),
                "status": texts(broken["status"]),
                "reason": texts(broken["stop_reason"]),
            },
            ["assay_runs"],
        )
        if len(broken)
        else None,
        "curves": page.figure("curves", assay_figures.draw_curves(calibration), ["calibration"])
        if calibration["deformation_index"].notna().any()
        else None,
        "library": page.figure(
            "calibration_library",
            assay_figures.draw_curves(page["calibration_library"]),
            ["calibration_library"],
        )
        if page.some("calibration_library")
        else None,
        "study": page.figure(
            "assay_study", assay_figures.draw_curves(page["assay_study"]), ["assay_study"]
        )
        if page.some("assay_study")
        else None,
        "values": _values(page, calibration) if len(calibration) else None,
        "calibration": page.figure(
            "calibration",
            calibration_figures.draw_calibration(source, curves),
            ["assay_runs", "calibration"],
        )
        if len(curves)
        else None,
        "correlations": correlations,
        "moduli": page.figure("moduli", calibration_figures.draw_moduli(source), ["assay_runs"])
        if source["deformation_index"].notna().any()
        else None,
        "diameters": diameters,
        "tracks": tracks,
    }


def _values(page: Page, table: pd.DataFrame) -> Grid:
    return page.table(
        {
            "assay": texts(table["assay"]),
            "index": texts(table["index"]),
            "from": [label or "simulated" for label in texts(table["label"])],
            "cell": [
                f"{shape}, R {radius:g} µm" if shape else "of the publication"
                for shape, radius in zip(table["cell_shape"], table["cell_radius_um"], strict=True)
            ],
            "membrane": texts(table["group"]),
            "set": texts(table["stiffness_set"]),
            Markup("<i>k</i><sub>s</sub> [µN/m]"): numbers(table["ks_uN_per_m"]),
            Markup("<i>k</i><sub>b</sub> [pN·µm]"): numbers(table["kb_pN_um"]),
            Markup("<i>k</i><sub>α</sub> [µN/m]"): numbers(table["kal_uN_per_m"]),
            "velocity [mm/s]": numbers(table["velocity_mm_s"], 4),
            "stress [Pa]": numbers(table["shear_stress_Pa"]),
            "passages": numbers(table["runs"]),
            "DI": plus_minus(table["deformation_index"], table["deformation_index_std"], 3),
            **{
                f"± {cause}": [fixed(v, 4) if pd.notna(v) else NOT_MEASURED for v in table[name]]
                for cause, name in CAUSES.items()
            },
            "to the next": numbers(table["resolving_power"], 2),
            "softest to stiffest": numbers(table["resolving_power_all"], 2),
        },
        ["calibration"],
    )


def _diameters(page: Page, runs: pd.DataFrame) -> tuple[Picture | None, int]:
    """The figure of the trajectories in the source's slit, and how many there are."""
    folder = page.results / "assays"
    known = set(runs["run_id"])
    tracks = [
        read_table("assay_trajectory", path)
        for assay in SOURCE
        for path in sorted(folder.glob(f"{assay}_*.trajectory.parquet"))
    ]
    tracks = [part for track in tracks if len(part := track[track["run_id"].isin(known)])]
    if not tracks:
        return None, 0
    figure = calibration_figures.draw_diameters(pd.concat(tracks), runs)
    links = [page.link(folder)] if page.linked else []
    count = sum(part["run_id"].nunique() for part in tracks)
    return page.figure("diameters", figure, ["assay_runs"], links), count
