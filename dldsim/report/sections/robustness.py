"""Robust arrays: the source's robustness score, and what a fabrication error does."""

from markupsafe import Markup

from dldsim.analysis.robustness import most_frequent
from dldsim.report import statistics_figures
from dldsim.report.formats import (
    ANGLE,
    GAP,
    PERIODICITY,
    PILLAR_RADIUS,
    decimals,
    numbers,
    term,
    texts,
)
from dldsim.report.page import Page
from dldsim.vocabulary import GEOMETRY

SURE = 0.05
"""Largest probability of a change in an array that bears the error."""


def contents(page: Page) -> dict:
    table = page["robustness"]
    if not table["robustness_score_deg2"].notna().any():
        return {"scored": False}
    best = table[table["robust"].astype(bool)].sort_values("robustness_score_deg2")
    frequent = most_frequent(table)
    return {
        "scored": True,
        "map": page.figure(
            "robustness_map", statistics_figures.draw_robustness(table), ["robustness"]
        ),
        "best": page.table(
            {
                Markup("{} [µm]").format(PILLAR_RADIUS): numbers(best["pillar_radius_um"]),
                Markup("{} [µm]").format(GAP): numbers(best["gap_um"]),
                PERIODICITY: numbers(best["periodicity"]),
                Markup("mean {} [°]").format(ANGLE): decimals(best["mean_migration_angle_deg"]),
                "score [deg²]": numbers(best["robustness_score_deg2"]),
                "neighbours": numbers(best["neighbours"]),
                "modes": texts(best["modes"]),
            },
            ["robustness"],
        ),
        "frequent": page.table(
            {
                "parameter": map(term, frequent["parameter"]),
                "value": numbers(frequent["value"]),
                "among the most robust": numbers(frequent["count"]),
                "expected of a random choice": decimals(frequent["expected"], 1),
            },
            ["robustness"],
        ),
        **_fabrication(page),
    }


def _fabrication(page: Page) -> dict:
    if not page.some("fabrication"):
        return {"fabrication": None, "bearing": None, "wrong": 0, "runs": 0}
    risk = page["fabrication"]
    runs = risk.drop_duplicates([*GEOMETRY, "stiffness_set"])
    worst = statistics_figures.worst_risk(risk)

    limit = risk["moved_limit_deg"].iloc[0]

    def kept(name: str) -> list[str]:
        return [
            f"{int((part[name] <= SURE).sum())} of {len(part)}"
            for _, part in worst.groupby("radius_error_um")
        ]

    return {
        "fabrication": page.figure(
            "fabrication", statistics_figures.draw_fabrication(risk), ["fabrication"]
        ),
        "wrong": int(runs.eval("predicted_mode != simulated_mode").sum()),
        "runs": len(runs),
        "bearing": page.table(
            {
                Markup("error of {} [µm]").format(PILLAR_RADIUS): numbers(
                    sorted(float(e) for e in worst["radius_error_um"].unique())
                ),
                "arrays that keep their mode with 95 %": kept("mode_change_probability"),
                f"arrays that move by less than {limit:g}° with 95 %": kept("moved_probability"),
            },
            ["fabrication"],
        ),
    }
