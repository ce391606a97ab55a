"""What more outcomes and more trials are worth: learning curve, and regret of a search."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from dldsim.report.accuracy_figures import knob_styles
from dldsim.report.style import GREY, key, legend, styled

METHOD_COLOUR = {"tpe": "#0072B2", "random": "#D55E00", "grid": "#009E73"}
METHOD_NAME = {"tpe": "TPE", "random": "random", "grid": "exhaustive grid"}


def learning_bands(curve: pd.DataFrame) -> pd.DataFrame:
    """Median, quartiles and times of each model at each number of arrays learnt from."""
    groups = curve.groupby(["model", "geometries"], sort=False)
    return groups.agg(
        outcomes=("outcomes", "mean"),
        rmse=("rmse_deg", "median"),
        low=("rmse_deg", lambda v: v.quantile(0.25)),
        high=("rmse_deg", lambda v: v.quantile(0.75)),
        fit_time_s=("fit_time_s", "median"),
        simulation_time_s=("simulation_time_s", lambda v: v.mean() if v.notna().all() else np.nan),
    ).reset_index()


def regret_bands(regret: pd.DataFrame) -> pd.DataFrame:
    """Median, least and largest regret, and time, over the repeats at each number of trials."""
    groups = regret.groupby(["request", "method", "evaluations"], sort=False)
    return groups.agg(
        regret=("regret_deg", "median"),
        low=("regret_deg", "min"),
        high=("regret_deg", "max"),
        time_s=("time_s", "median"),
    ).reset_index()


@styled
def draw_learning_curve(curve: pd.DataFrame, sigma_num_deg: float | None = None) -> Figure:
    """Error on unseen arrays over the outcomes learnt from, and what these cost."""
    bands = learning_bands(curve)
    figure = Figure(figsize=(9.2, 3.5), layout="constrained")
    error, cost = figure.subplots(1, 2)
    styles = knob_styles(bands["model"])
    for model, part in bands.groupby("model", sort=False):
        part = part.sort_values("outcomes")
        colour, marker = styles[model]
        error.fill_between(
            part["outcomes"], part["low"], part["high"], color=colour, alpha=0.15, linewidth=0
        )
        error.plot(part["outcomes"], part["rmse"], marker=marker, color=colour, label=model)
        cost.plot(part["outcomes"], part["fit_time_s"], marker=marker, color=colour)
    if sigma_num_deg is not None:
        error.axhline(
            sigma_num_deg,
            color="black",
            linestyle=":",
            linewidth=1,
            label=r"$\sigma_{num}$ of the outcomes",
        )
    one = bands[bands["model"] == bands["model"].iloc[0]].sort_values("outcomes")
    cost.plot(one["outcomes"], one["simulation_time_s"], "k--", linewidth=1)
    error.set(
        xlabel="outcomes learnt from",
        ylabel="RMSE on unseen arrays [°]",
        xscale="log",
        yscale="log",
    )
    cost.set(xlabel="outcomes learnt from", ylabel="time [s]", xscale="log", yscale="log")
    for panel in (error, cost):
        ticks = one["outcomes"].round().astype(int).tolist()
        panel.set_xticks(ticks, [str(tick) for tick in ticks])
        panel.minorticks_off()
    error.yaxis.set_major_formatter("{x:g}")
    below = {"ncols": 2, "loc": "upper center", "bbox_to_anchor": (0.5, -0.16)}
    error.legend(**below)
    cost.legend(
        handles=[
            key("black", line="--", label="simulating the outcomes"),
            key(GREY, "o", "-", label="fitting"),
        ],
        **below,
    )
    return figure


@styled
def draw_regret(regret: pd.DataFrame) -> Figure:
    """Regret of each search over evaluations and over time, a row of panels per request."""
    bands = regret_bands(regret)
    requests = list(dict.fromkeys(bands["request"]))
    figure = Figure(figsize=(9.2, 0.7 + 2.3 * len(requests)), layout="constrained")
    panels = figure.subplots(len(requests), 2, squeeze=False, sharey="row", sharex="col")
    for row, request in zip(panels, requests, strict=True):
        here = bands[bands["request"] == request]
        for method, part in here.groupby("method", sort=False):
            part = part.sort_values("evaluations")
            colour = METHOD_COLOUR[method]
            for panel, name in zip(row, ("evaluations", "time_s"), strict=True):
                panel.fill_between(
                    part[name], part["low"], part["high"], color=colour, alpha=0.15, linewidth=0
                )
                panel.plot(
                    part[name],
                    part["regret"],
                    marker="s" if method == "grid" else "none",
                    markersize=4,
                    color=colour,
                )
        row[0].set(title=request, ylabel="regret [°]", xscale="log", ylim=(0, None))
        row[1].set(xscale="log")
    panels[-1][0].set_xlabel("geometries tried")
    panels[-1][1].set_xlabel("time [s]")
    legend(
        figure,
        [
            key(METHOD_COLOUR[m], "s" if m == "grid" else "none", "-", label=METHOD_NAME[m])
            for m in METHOD_COLOUR
        ],
    )
    return figure
