"""Figures of the design search and of its verification."""

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from dldsim.report.style import GREY, dot, key, legend, multiples, styled

PARAMETERS = {"pillar_radius_um": "$P_r$ [µm]", "gap_um": "$P_g$ [µm]", "periodicity": "$N_p$"}
ROLE_COLOUR = {
    "design": "#0072B2",
    "transition": "#E69F00",
    "finer": "#CC79A7",
    "height": "#009E73",
}
ROLE_MARKER = {"design": "o", "transition": "D", "finer": "s", "height": "^"}
ROLE_NAME = {
    "design": "design",
    "transition": "array near a mode transition",
    "finer": "design, finer lattice",
    "height": "best design, other height",
}
TELLING, UNINFORMATIVE = "#A9B0B8", "#EBE3CF"
"""Colours of prediction intervals that tell the order of the cells, and of those that do not."""
AFTERWARDS = {"finer": 1, "height": 2}
"""Roles that follow the rounds, in this order."""


def best_so_far(trials: pd.DataFrame) -> pd.DataFrame:
    """Trials in order with the largest feasible value up to each, column `best`."""
    trials = trials.sort_values("trial")
    value = trials["value"].where(trials["feasible"].astype(bool))
    return trials.assign(best=value.cummax().ffill())


def rounds_of(verifications: pd.DataFrame) -> pd.DataFrame:
    """Differences of each request in the order of their runs, with their place along the axis."""
    table = verifications[verifications["population"] == "difference"]
    order = {name: i for i, name in enumerate(dict.fromkeys(table["request"]))}
    late = table["role"].map(AFTERWARDS).fillna(0)
    table = table.assign(order=table["request"].map(order), late=late)
    table = table.sort_values(["order", "late", "round", "array", "height_um"], kind="stable")
    place = table.groupby("request").cumcount()
    return table.assign(place=place).drop(columns=["order", "late"])


def tells_order(verifications: pd.DataFrame) -> pd.Series:
    """Whether the predicted interval of a difference leaves out zero."""
    return (verifications["predicted_low_deg"] > 0) | (verifications["predicted_high_deg"] < 0)


def parallel_lines(trials: pd.DataFrame) -> tuple[pd.DataFrame, dict[str, tuple[float, float]]]:
    """Feasible trials scaled to 0 … 1 on each axis, worst first, and the ends of the axes."""
    names = [*PARAMETERS, "value"]
    good = trials[trials["feasible"].astype(bool) & trials["value"].notna()]
    good = good.sort_values("value", kind="stable")
    ends = {name: (float(good[name].min()), float(good[name].max())) for name in names}
    scaled = {
        name: (good[name] - low) / (high - low) if high > low else 0.5 + 0 * good[name]
        for name, (low, high) in ends.items()
    }
    return pd.DataFrame(scaled), ends


@styled
def draw_designs(designs: pd.DataFrame) -> Figure:
    """Ranked designs: separation with its range over the fabrication tolerance, and uncertainty."""
    requests = list(dict.fromkeys(designs["request"]))
    tallest = designs.groupby("request").size().max()
    figure, panels = multiples(len(requests), 2, 9.2, 1.1 + 0.34 * tallest)
    for panel, request in zip(panels, requests, strict=True):
        part = designs[designs["request"] == request].sort_values("rank", ascending=False)
        places = np.arange(len(part))
        panel.barh(places, part["uncertainty_deg"], height=0.8, color="#E8E4D8")
        panel.hlines(
            places,
            part["separation_tolerance_min_deg"],
            part["separation_tolerance_max_deg"],
            color="#0072B2",
            linewidth=2.2,
        )
        inside = part["inside_training_domain"].astype(bool).to_numpy()
        for filled in (True, False):
            dot(
                panel,
                part["separation_deg"][inside == filled],
                places[inside == filled],
                "#0072B2",
                "o",
                filled,
                markersize=6,
            )
        panel.set_yticks(
            places,
            [
                f"{row['rank']}:  $P_r$ {row['pillar_radius_um']:.3g}, "
                f"$P_g$ {row['gap_um']:.3g} µm, $N_p$ {row['periodicity']}"
                for _, row in part.iterrows()
            ],
        )
        panel.grid(axis="y", visible=False)
        panel.set_title(request)
        panel.set(xlabel="predicted separation [°]", xlim=(0, None))
    handles = [
        key("#0072B2", "o", label="nominal"),
        key("#0072B2", "o", filled=False, label="outside training domain"),
        key("#0072B2", line="-", label="over fabrication tolerance"),
        key("#E8E4D8", "s", label="uncertainty of a difference"),
    ]
    legend(figure, handles)
    return figure


@styled
def draw_history(trials: pd.DataFrame) -> Figure:
    """Course of the search: value per trial and the best so far, a panel per request."""
    requests = list(dict.fromkeys(trials["request"]))
    figure, panels = multiples(len(requests), 3, 9.2, 2.9)
    for panel, request in zip(panels, requests, strict=True):
        part = best_so_far(trials[trials["request"] == request])
        good = part["feasible"].astype(bool) & part["value"].notna()
        panel.plot(part["trial"][good], part["value"][good], "o", color="#56B4E9", markersize=3)
        panel.step(part["trial"], part["best"], where="post", color="#0072B2")
        low = panel.get_ylim()[0]
        bottom = part["trial"][~part["feasible"].astype(bool)]
        if len(bottom):  # an empty artist that is not clipped upsets the layout
            panel.plot(
                bottom, np.full(len(bottom), low), "x", color=GREY, markersize=4, clip_on=False
            )
        panel.set(title=request, xlabel="trial", ylabel="objective", ylim=(low, None))
        panel.xaxis.set_major_locator(MaxNLocator(5, integer=True))
        panel.yaxis.set_major_formatter("{x:.3g}")
    legend(
        figure,
        [
            key("#56B4E9", "o", label="feasible trial"),
            key(GREY, "x", label="infeasible trial"),
            key("#0072B2", line="-", label="best so far"),
        ],
    )
    return figure


@styled
def draw_importance(importance: pd.DataFrame) -> Figure:
    """Importance of the parameters of each search."""
    requests = list(dict.fromkeys(importance["request"]))
    figure, panels = multiples(len(requests), 3, 9.2, 1.7, sharex=True)
    for panel, request in zip(panels, requests, strict=True):
        part = importance[importance["request"] == request].iloc[::-1]
        panel.barh(np.arange(len(part)), part["importance"].fillna(0.0), color="#56B4E9")
        panel.set_yticks(
            np.arange(len(part)), [PARAMETERS[n].split(" [")[0] for n in part["parameter"]]
        )
        panel.grid(axis="y", visible=False)
        panel.set(title=request, xlabel="importance", xlim=(0, 1))
    return figure


@styled
def draw_parallel(trials: pd.DataFrame) -> Figure:
    """Feasible trials as lines over the parameters and the objective, coloured by the latter."""
    requests = list(dict.fromkeys(trials["request"]))
    figure, panels = multiples(len(requests), 3, 9.2, 2.9)
    labels = [label.replace(" [", "\n[") for label in (*PARAMETERS.values(), "objective")]
    for panel, request in zip(panels, requests, strict=True):
        lines, ends = parallel_lines(trials[trials["request"] == request])
        colours = matplotlib.colormaps["cividis"](lines["value"].to_numpy(float))
        places = np.arange(len(ends))
        for line, colour in zip(lines.to_numpy(float), colours, strict=True):
            panel.plot(places, line, color=colour, linewidth=0.8, alpha=0.8)
        for place, (low, high) in zip(places, ends.values(), strict=True):
            panel.axvline(place, color="#444444", linewidth=0.8)
            panel.text(place, 1.03, f"{high:.3g}", ha="center", fontsize=7.5)
            panel.text(place, -0.03, f"{low:.3g}", ha="center", va="top", fontsize=7.5)
        panel.set_xticks(places, labels)
        panel.tick_params(axis="x", length=0, pad=12)
        panel.set_yticks([])
        panel.spines[:].set_visible(False)
        panel.grid(False)
        panel.set_title(request, pad=16)
    return figure


@styled
def draw_slices(slices: pd.DataFrame, designs: pd.DataFrame) -> Figure:
    """Predicted difference over pairs of parameters through the best candidate of each request."""
    requests = list(dict.fromkeys(slices["request"]))
    pairs = list(dict.fromkeys(zip(slices["x_parameter"], slices["y_parameter"], strict=True)))
    figure = Figure(figsize=(9.2, 0.5 + 2.6 * len(requests)), layout="constrained")
    panels = figure.subplots(len(requests), len(pairs), squeeze=False)
    for row, request in zip(panels, requests, strict=True):
        of_request = slices[slices["request"] == request]
        most = max(float(of_request["difference_deg"].abs().max()), 1e-6)
        norm = matplotlib.colors.Normalize(-most, most)
        best = designs[(designs["request"] == request) & (designs["design"] == 1)].iloc[0]
        for panel, (x, y) in zip(row, pairs, strict=True):
            part = of_request[(of_request["x_parameter"] == x) & (of_request["y_parameter"] == y)]
            if part.empty:  # a bound of this request leaves one value
                panel.set_axis_off()
                continue
            known = part["inside_training_domain"] & part["feasible"]
            table = part.pivot(index="y", columns="x", values="difference_deg")
            panel.contourf(table.columns, table.index, table.to_numpy(), 16, cmap="PuOr", norm=norm)
            hidden = part.assign(hidden=~known).pivot(index="y", columns="x", values="hidden")
            panel.contourf(
                table.columns,
                table.index,
                hidden.to_numpy(float),
                [0.5, 1.5],
                colors="none",
                hatches=["////"],
            )
            panel.plot(best[x], best[y], "*", color="black", markersize=10)
            panel.set(xlabel=PARAMETERS[x], ylabel=PARAMETERS[y])
            panel.grid(False)
        row[0].set_title(request)
        scale = matplotlib.cm.ScalarMappable(norm, "PuOr")
        figure.colorbar(scale, ax=row.tolist(), label="angle 2 − angle 1 [°]", shrink=0.9)
    return figure


@styled
def draw_rounds(verifications: pd.DataFrame) -> Figure:
    """Predicted interval and simulated difference of every array, round by round."""
    table = rounds_of(verifications)
    requests = list(dict.fromkeys(table["request"]))
    figure, panels = multiples(len(requests), 3, 9.2, 3.2)
    for panel, request in zip(panels, requests, strict=True):
        part = table[table["request"] == request]
        panel.axhline(0, color="#444444", linewidth=0.8)
        tells = tells_order(part)
        for known, colour in ((True, TELLING), (False, UNINFORMATIVE)):
            bars = part[tells == known]
            panel.vlines(
                bars["place"],
                bars["predicted_low_deg"],
                bars["predicted_high_deg"],
                color=colour,
                linewidth=7,
            )
        panel.plot(part["place"], part["predicted_deg"], "_", color="black", markersize=9)
        for _, row in part[part["simulated_deg"].notna()].iterrows():
            colour = ROLE_COLOUR[row["role"]]
            if pd.notna(row["sigma_num_deg"]):
                panel.errorbar(
                    row["place"],
                    row["simulated_deg"],
                    yerr=2 * row["sigma_num_deg"],
                    color=colour,
                    linewidth=1.2,
                    capsize=2,
                )
            dot(
                panel,
                [row["place"]],
                [row["simulated_deg"]],
                colour,
                ROLE_MARKER[row["role"]],
                row["agrees"] is not False and row["agrees"] != 0,
                markersize=6,
            )
        missing = part[part["simulated_deg"].isna()]
        panel.plot(missing["place"], np.zeros(len(missing)), "x", color="#D55E00", markersize=6)
        group = part["round"].where(~part["role"].isin(AFTERWARDS), -part["role"].map(AFTERWARDS))
        last = group.to_numpy()
        for place in np.flatnonzero(np.diff(last)):
            panel.axvline(place + 0.5, color="#444444", linewidth=0.6, linestyle=":")
        panel.set_xticks(
            part["place"],
            [
                f"{row['periodicity']}\n{row['gap_um']:.1f}\n{row['pillar_radius_um']:.1f}"
                for _, row in part.iterrows()
            ],
            fontsize=7,
        )
        panel.grid(axis="x", visible=False)
        panel.set(
            title=request,
            ylabel="angle 2 − angle 1 [°]",
            xlabel="$N_p$, $P_g$, $P_r$ [µm], by round",
        )
    legend(
        figure,
        [
            *(key(ROLE_COLOUR[r], ROLE_MARKER[r], label=ROLE_NAME[r]) for r in ROLE_COLOUR),
            key(GREY, "o", filled=False, label="prediction missed"),
            key(TELLING, "s", label="90 % prediction interval"),
            key(UNINFORMATIVE, "s", label="the same, includes zero: uninformative"),
            key("black", "_", label="predicted"),
            key("#D55E00", "x", label="no angle"),
        ],
        ncols=4,
    )
    return figure
