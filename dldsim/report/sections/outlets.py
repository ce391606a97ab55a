"""What comes out of a device: picture, purity and recovery, outlets, simulated check."""

import pandas as pd

from dldsim.report import outlet_figures
from dldsim.report.formats import number, percent
from dldsim.report.page import Page

NEEDED = ("device_outcomes", "device_outlets", "device_positions", "device_exits")


def contents(page: Page) -> dict | None:
    """Values of the chapter; None without the tables of a device."""
    if not all(page.some(kind) for kind in NEEDED):
        return None
    tables = {kind: _of_first(page[kind]) for kind in NEEDED}
    outcomes, outlets = tables["device_outcomes"], tables["device_outlets"]
    return {
        "fan": page.figure("device", outlet_figures.draw_fan(tables), ()),
        "device": " and ".join(dict.fromkeys(outcomes["device"])),
        "results": page.table(
            {
                "stage": [number(int(v)) for v in outcomes["stage"]],
                "cell type": [number(int(v)) for v in outcomes["population"]],
                "outlet": list(outcomes["outlet"]),
                **{
                    name: _with_interval(outcomes, column)
                    for name, column in (
                        ("purity", "purity"),
                        ("recovery", "recovery"),
                        ("clogs", "lost"),
                    )
                },
                "of the sample": [percent(v) for v in outcomes["recovery_of_sample"]],
                "enrichment": [number(v, 3) for v in outcomes["enrichment"]],
                "bump, mixed, zigzag": [
                    ", ".join(percent(row[f"share_{mode}"]) for mode in ("bump", "mixed", "zigzag"))
                    for _, row in outcomes.iterrows()
                ],
                "not learnt": [percent(v) for v in outcomes["extrapolated"]],
            },
            notes=list(outcomes["basis"]),
        ),
        "outlets": page.table(
            {
                "stage": [number(int(v)) for v in outlets["stage"]],
                "outlet": [number(int(v)) for v in outlets["outlet"]],
                "from [µm]": [number(v, 4) for v in outlets["low_um"]],
                "to [µm]": [number(v, 4) for v in outlets["high_um"]],
                "collects type": [number(int(v)) for v in outlets["collects"]],
                "of type 1": _with_interval(outlets, "cells_1"),
                "of type 2": _with_interval(outlets, "cells_2"),
                "type 1 among its cells": _with_interval(outlets, "purity_1"),
            }
        ),
        "stages": [
            {
                "stage": int(row["stage"]),
                "robust": percent(row["purity_recovery"]),
                "lengths": [_length(row, part) for part in ("90", "95")],
                "cut": number(row["cut_um"], 4),
                "length": number(row["array_length_mm"], 3),
                "width": number(row["array_width_mm"], 3),
                "flow": number(row["sample_uL_per_h"], 3),
            }
            for _, row in outcomes.drop_duplicates("stage").iterrows()
        ],
        **_check(page),
    }


def _of_first(table: pd.DataFrame) -> pd.DataFrame:
    """Rows of the first device, and of the second stage that it feeds."""
    return table[(table["device"] == table["device"].iloc[0]) | (table["stage"] > 1)]


def _with_interval(table: pd.DataFrame, name: str) -> list[str]:
    return [
        f"{percent(row[name])} ({percent(row[f'{name}_low'])} to {percent(row[f'{name}_high'])})"
        for _, row in table.iterrows()
    ]


def _length(row: pd.Series, part: str) -> str:
    name = f"length_{part}_mm"
    return f"{number(row[name])} mm ({number(row[f'{name}_low'])} to {number(row[f'{name}_high'])})"


def _check(page: Page) -> dict:
    """Predicted beside simulated cells; None without a simulated check."""
    if not (page.some("device_checks") and page.some("checked_cells")):
        return {"check": None, "agreement": None}
    checks = page["device_checks"]
    first = (page[kind][page[kind]["stage"] == 1] for kind in ("device_exits", "device_outcomes"))
    exits, outcomes = first  # the device that cells were simulated in
    picture = outlet_figures.draw_check(exits, page["checked_cells"], outcomes)
    return {
        "check": page.figure("device_check", picture, ()),
        "agreement": page.table(
            {
                "cell type": [number(int(v)) for v in checks["population"]],
                "simulated": [number(int(v)) for v in checks["simulated"]],
                "at its outlet": [number(int(v)) for v in checks["own"]],
                "clog": [number(int(v)) for v in checks["lost"]],
                "not settled": [number(int(v)) for v in checks["open"]],
                "failed": [number(int(v)) for v in checks["failed"]],
                "recovery predicted": _with_interval(checks, "predicted"),
                "simulated recovery": _with_interval(checks, "recovery"),
                "chance of the count": [number(v, 2) for v in checks["chance_outlet"]],
                "chance of the exits": [number(v, 2) for v in checks["chance_exit"]],
                "agrees": [number(bool(v)) for v in checks["agrees"]],
            },
            marked=~checks["agrees"].astype(bool),
        ),
    }
