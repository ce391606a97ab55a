"""Stability of the explicit time step: margins predicted, and what happened."""

from dldsim.evidence import stability_sweep
from dldsim.report import stability_figures
from dldsim.report.formats import numbers, records, texts
from dldsim.report.page import Page


def contents(page: Page) -> dict:
    table = page["stability"]
    odd = table[(table["outcome"] != stability_sweep.RAN) & (table["time_step"] == "automatic")]
    return {
        "found": stability_sweep.verdict(records(table)),
        "map": page.figure("stability_map", stability_figures.draw_map(table), ["stability"]),
        "cost": page.figure("stability_cost", stability_figures.draw_cost(table), ["stability"])
        if table["family"].str.startswith("stiffness-").any()
        else None,
        "odd": page.table(
            {
                "scene": texts(odd["title"]),
                "point": texts(odd["label"]),
                "outcome": texts(odd["outcome"]),
                "margin": numbers(odd["margin"]),
                "reason": texts(odd["reason"]),
            },
            ["stability"],
        )
        if len(odd)
        else None,
    }
