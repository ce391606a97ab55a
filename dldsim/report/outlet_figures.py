"""Figures of what leaves a device: both populations along it, and at its outlets."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from dldsim.report.formats import percent
from dldsim.report.style import GREY, key, legend, styled

POPULATION_COLOUR = {1: "#0072B2", 2: "#D55E00"}
KINDS = ("device_positions", "device_exits", "device_outlets", "device_outcomes")
BINS_SIMULATED = 16
"""Intervals of the histogram of simulated cells."""


def stages(outcomes: pd.DataFrame) -> list[int]:
    """Stages of a cascade in order."""
    return sorted(int(stage) for stage in outcomes["stage"].unique())


def window(positions: pd.DataFrame, outlets: pd.DataFrame) -> tuple[float, float]:
    """Part of the width [µm] that holds the cells and all inner walls, with a margin."""
    walls = outlets["low_um"].to_numpy()[1:]
    low = min(positions["y_05_um"].min(), walls.min())
    high = max(positions["y_95_um"].max(), walls.max())
    margin = 0.15 * (high - low)
    width = outlets["high_um"].max()
    return max(low - margin, -0.02 * width), min(high + margin, 1.02 * width)


@styled
def draw_fan(tables: Mapping[str, pd.DataFrame]) -> Figure:
    """Both populations along the device, their exits, and the walls between the outlets; a row of
    panels for each stage. ``tables``: those of KINDS of one device or cascade."""
    found = stages(tables["device_outcomes"])
    figure = Figure(figsize=(9.2, 0.5 + 3.6 * len(found)), layout="constrained")
    rows = figure.subplots(
        len(found), 2, squeeze=False, sharey="row", gridspec_kw={"width_ratios": (3.2, 1)}
    )
    for (fan, histogram), stage in zip(rows, found, strict=True):
        own = [tables[kind][tables[kind]["stage"] == stage] for kind in KINDS]
        along, leaving, walls, results = own
        for population, colour in POPULATION_COLOUR.items():
            part = along[along["population"] == population]
            for low, high, alpha in (("05", "95", 0.18), ("25", "75", 0.3)):
                ends = part[f"y_{low}_um"], part[f"y_{high}_um"]
                fan.fill_between(part["x_mm"], *ends, color=colour, alpha=alpha, linewidth=0)
            fan.plot(part["x_mm"], part["y_50_um"], color=colour)
            bars = leaving[leaving["population"] == population]
            height = bars["high_um"] - bars["low_um"]
            histogram.barh(
                bars["low_um"], bars["cells"], height, align="edge", color=colour, alpha=0.55
            )
        width, length = walls["high_um"].max(), results["array_length_mm"].iloc[0]
        for wall in walls["low_um"].iloc[1:]:
            cut = np.isclose(wall, results["cut_um"].iloc[0])
            for panel in (fan, histogram):
                panel.axhline(wall, color="black" if cut else GREY, linestyle="-" if cut else ":")
        for wall in (0.0, width):
            fan.axhline(wall, color=GREY, linewidth=2.5)
        for row in results.itertuples():
            fan.text(
                0.02 * length,
                window(along, walls)[1] if row.outlet == "upper" else window(along, walls)[0],
                f"{row.outlet} outlet, type {row.population}: purity {percent(row.purity)}, "
                f"recovery {percent(row.recovery)}",
                color=POPULATION_COLOUR[row.population],
                va="top" if row.outlet == "upper" else "bottom",
                fontsize=8.5,
            )
        fan.set(
            xlabel="length of array [mm]",
            ylabel="above the lower side wall [µm]",
            xlim=(0, length),
            ylim=window(along, walls),
        )
        histogram.set(xlabel="share of cells")
        if len(found) > 1:
            fan.set_title(f"Stage {stage}")
    legend(
        figure,
        [
            *(key(c, line="-", label=f"cell type {p}") for p, c in POPULATION_COLOUR.items()),
            Patch(color=GREY, alpha=0.5, label="half of the cells"),
            Patch(color=GREY, alpha=0.2, label="90 %"),
            key("black", line="-", label="wall between the outlets"),
        ],
    )
    return figure


@styled
def draw_check(exits: pd.DataFrame, cells: pd.DataFrame, outcomes: pd.DataFrame) -> Figure:
    """Predicted and simulated exits of both populations, side by side."""
    figure = Figure(figsize=(9.2, 3.4), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    cut = outcomes["cut_um"].iloc[0]
    done = cells.dropna(subset=["exit_um"])
    low, high = done["exit_um"].min(), done["exit_um"].max()
    used = exits[exits["cells_high"] > 1e-3]
    low, high = min(low, used["low_um"].min(), cut), max(high, used["high_um"].max(), cut)
    edges = np.linspace(low, high, BINS_SIMULATED + 1)
    for panel, (population, colour) in zip(panels, POPULATION_COLOUR.items(), strict=True):
        predicted = exits[exits["population"] == population]
        middle = (predicted["low_um"] + predicted["high_um"]) / 2
        share = np.histogram(middle, edges, weights=predicted["cells"])[0]
        panel.stairs(share, edges, color=colour, fill=True, alpha=0.3)
        mine = done.loc[done["population"] == population, "exit_um"]
        count = int((cells["population"] == population).sum())
        panel.stairs(np.histogram(mine, edges)[0] / max(count, 1), edges, color=colour)
        panel.plot(mine, np.zeros(len(mine)), "|", color=colour, markersize=9, clip_on=False)
        panel.axvline(cut, color="black")
        panel.set(
            title=f"Cell type {population}: {len(mine)} of {count} simulated cells leave",
            xlabel="above the lower side wall [µm]",
        )
    panels[0].set_ylabel("share of cells")
    legend(
        figure,
        [
            Patch(color=GREY, alpha=0.4, label="predicted"),
            key(GREY, line="-", label="simulated"),
            key(GREY, "|", label="a simulated cell"),
            key("black", line="-", label="wall between the outlets"),
        ],
    )
    return figure
