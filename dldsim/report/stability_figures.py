"""The report's figures of the stability sweep.

Style and small parts come from :mod:`dldsim.report.style`.
"""

import pandas as pd
from matplotlib.figure import Figure

from dldsim.evidence.stability_sweep import FAMILIES
from dldsim.report.style import GREY, key, legend, styled

OUTCOMES = {
    "ran": ("#0072B2", "o", "ran"),
    "stuck": ("#009E73", "s", "stuck (the cell clogs)"),
    "unstable": ("#D55E00", "X", "blew up"),
}
LEAST = 0.03
"""Smallest margin shown."""


@styled
def draw_map(stability: pd.DataFrame) -> Figure:
    """Every point by its largest margin: what was predicted, what happened."""
    names = [name for name in FAMILIES if name in set(stability["family"])]
    figure = Figure(figsize=(7.4, 0.8 + 0.27 * len(names)), layout="constrained")
    axes = figure.add_subplot()
    place = {name: len(names) - 1 - i for i, name in enumerate(names)}
    lift = {"automatic": 0.16, "as-given": -0.16}
    for row in stability[stability["margin"].notna()].itertuples():
        colour, marker, _ = OUTCOMES[row.outcome]
        automatic = row.time_step == "automatic"
        axes.plot(
            max(row.margin, LEAST),
            place[row.family] + lift[row.time_step],
            marker,
            color=colour,
            mfc=colour if automatic else "white",
            ms=5,
            mew=1,
        )
    axes.axvline(1, color=GREY, lw=1)
    axes.set_xscale("log")
    axes.set_yticks(list(place.values()), [FAMILIES[name].title for name in names])
    axes.set_ylim(-0.7, len(names) - 0.3)
    axes.set_xlabel("largest margin of the step given: ω², delay, speed / what is safe")
    axes.grid(axis="x", visible=False)
    keys = [key(c, m, label=text) for c, m, text in OUTCOMES.values()]
    keys += [
        key(GREY, "o", label="step shortened where the margin exceeds 1"),
        key(GREY, "o", filled=False, label="step as given all the same"),
    ]
    legend(figure, keys, ncols=3)
    return figure


@styled
def draw_cost(stability: pd.DataFrame) -> Figure:
    """What stiffness costs: the factor on the number of steps over the multiplier of the moduli."""
    stiff = stability[
        stability["family"].str.startswith("stiffness-") & (stability["time_step"] == "automatic")
    ]
    figure = Figure(figsize=(4.6, 3.2), layout="constrained")
    axes = figure.add_subplot()
    membranes = stiff.groupby("label", sort=False)
    for (name, series), style in zip(membranes, "osD^vP*X<>ph", strict=False):
        series = series.sort_values("parameter")
        group = not name.startswith("set")
        axes.plot(
            series["parameter"],
            series["refinement"],
            "-",
            marker=style,
            ms=4,
            label=name,
            color="#D55E00" if group else "#0072B2",
            mfc="white" if group else None,
            lw=0.8,
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("multiplier of k_s, k_b and k_α")
    axes.set_ylabel("time steps / those of the step given")
    axes.legend(ncols=2, fontsize=7.5)
    return figure
