"""Figures of the regressors and of what the surrogate says about its inputs."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from dldsim.analysis.benchmark import pooled
from dldsim.analysis.regressors import ON_INDEX
from dldsim.report.angle_figures import AXIS_LABEL, BOX
from dldsim.report.statistics_figures import term_label
from dldsim.report.style import (
    GREY,
    MODE_COLOUR,
    MODE_MARKER,
    dodged,
    dot,
    key,
    legend,
    mode_keys,
    multiples,
    ordered,
    styled,
)

SPLIT_COLOUR = {"random": "#56B4E9", "geometry": "#D55E00", "stiffness": "#009E73"}
SPLIT_MARKER = {"random": "o", "geometry": "D", "stiffness": "^"}
SPLIT_NAME = {
    "random": "random split",
    "geometry": "split by geometry",
    "stiffness": "split by stiffness set",
}
BANDS_DEG = (0.3, 1.0)
"""Errors marked in the parity figure."""
WORST_R2 = -0.2


def pooled_scores(predictions: pd.DataFrame) -> pd.DataFrame:
    """RMSE, MAE, median error and R² of every model and split over all held-out predictions.

    Pooling avoids the R² of a fold with few, nearly equal angles. Columns: model, split, n,
    rmse_deg, mae_deg, median_deg, r2 (null when all observations are equal), r2_low and r2_high
    (least and largest over the repeats); sorted by RMSE by geometry.
    """
    rows = []
    for (model, split), group in predictions.groupby(["model", "split"]):
        score = pooled(group)
        repeats = [pooled(part)["r2"] for _, part in group.groupby("repeat")]
        known = [r2 for r2 in repeats if r2 is not None]
        rows.append(
            {
                "model": model,
                "split": split,
                "n": len(group),
                "rmse_deg": score["rmse_deg"],
                "mae_deg": score["mae_deg"],
                "median_deg": score["median_absolute_error_deg"],
                "r2": score["r2"],
                "r2_low": min(known, default=None),
                "r2_high": max(known, default=None),
            }
        )
    scores = pd.DataFrame(rows)
    by_geometry = scores[scores["split"] == "geometry"].set_index("model")["rmse_deg"]
    order = scores["model"].map(by_geometry).fillna(np.inf)
    return scores.assign(order=order).sort_values(["order", "model", "split"]).drop(columns="order")


def on_same_rows(predictions: pd.DataFrame) -> pd.DataFrame:
    """Regressors in the source's form beside the same on Ca, on outcomes with a deformation index.

    Columns: model, n, and rmse_deg, median_deg and r2 as `…_ca` and `…_index`; by geometry.
    """
    part = predictions[predictions["split"] == "geometry"]
    rows = []
    for name in dict.fromkeys(part["model"]):
        by_index = part[part["model"] == name + ON_INDEX]
        if by_index.empty:
            continue
        both = part[part["model"] == name].merge(by_index[["outcome_id", "repeat"]])
        row = {"model": name, "n": len(by_index)}
        for form, table in (("ca", both), ("index", by_index)):
            score = pooled(table)
            row |= {
                f"rmse_deg_{form}": score["rmse_deg"],
                f"median_deg_{form}": score["median_absolute_error_deg"],
                f"r2_{form}": score["r2"],
            }
        rows.append(row)
    return pd.DataFrame(rows)


def by_kind(predictions: pd.DataFrame, model: str) -> pd.DataFrame:
    """Errors of one model on arrays held out by cell shape and source; columns as `pooled` has."""
    part = predictions[(predictions["model"] == model) & (predictions["split"] == "geometry")]
    return pd.DataFrame(
        [
            {"cell_shape": shape, "source": source, **pooled(group)}
            for (shape, source), group in part.groupby(["cell_shape", "source"])
        ]
    )


SHAPE_COLOUR = {"biconcave": "#D55E00", "sphere": "#0072B2", "ellipsoid": "#009E73"}
SHAPE_MARKER = {"biconcave": "D", "sphere": "o", "ellipsoid": "s"}


@styled
def draw_conditions(predictions: pd.DataFrame, model: str) -> Figure:
    """Residuals of one model on arrays held out over capillary number and channel height."""
    part = predictions[(predictions["model"] == model) & (predictions["split"] == "geometry")]
    figure = Figure(figsize=(9.2, 3.4), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    shapes = [shape for shape in SHAPE_COLOUR if (part["cell_shape"] == shape).any()]
    for panel, name in zip(panels, ("capillary_number", "vertical_confinement"), strict=True):
        for shape in shapes:
            here = part[part["cell_shape"] == shape]
            residual = here["predicted_deg"] - here["observed_deg"]
            colour, marker = SHAPE_COLOUR[shape], SHAPE_MARKER[shape]
            dot(panel, here[name], residual, colour, marker, True, markersize=3.5, alpha=0.7)
        panel.axhline(0, color="black", linewidth=0.8)
        panel.set(xlabel=AXIS_LABEL[name])
    panels[0].set(xscale="log", ylabel="predicted − simulated [°]")
    legend(figure, [key(SHAPE_COLOUR[s], SHAPE_MARKER[s], label=s) for s in shapes])
    return figure


@styled
def draw_sobol(sobol: pd.DataFrame) -> Figure:
    """First and total order Sobol indices of the surrogate with bootstrap intervals."""
    figure = Figure(figsize=(6.4, 1.2 + 0.42 * len(sobol)), layout="constrained")
    axes = figure.subplots()
    places = np.arange(len(sobol))[::-1]
    for offset, order, colour, label in (
        (0.17, "first", "#0072B2", "first order"),
        (-0.17, "total", "#E69F00", "total order"),
    ):
        value = sobol[f"{order}_order"]
        bars = np.abs(
            np.vstack([value - sobol[f"{order}_order_low"], sobol[f"{order}_order_high"] - value])
        )
        axes.barh(
            places + offset,
            value,
            height=0.3,
            color=colour,
            label=label,
            xerr=bars,
            error_kw={"elinewidth": 0.9, "capsize": 2},
        )
    axes.set_yticks(places, [term_label(name) for name in sobol["factor"]])
    axes.grid(axis="y", visible=False)
    axes.set(
        xlabel=r"share of the variance of the predicted $\theta_m$",
        xlim=(min(0, sobol["first_order_low"].min()), None),
    )
    axes.legend(loc="lower right")
    return figure


@styled
def draw_benchmark(scores: pd.DataFrame, benchmark: pd.DataFrame) -> Figure:
    """RMSE and R² per model and kind of split.

    scores: table from pooled_scores (large dots, R² with its range over repeats); benchmark: one
    bar per fold (RMSE).
    """
    models = list(dict.fromkeys(scores["model"]))[::-1]
    splits = [s for s in SPLIT_COLOUR if (scores["split"] == s).any()]
    figure = Figure(figsize=(9.2, 1.3 + 0.42 * len(models)), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    for index, split in enumerate(splits):
        colour, marker = SPLIT_COLOUR[split], SPLIT_MARKER[split]
        offset = dodged(index, len(splits), 0.5)
        folds = benchmark[(benchmark["split"] == split) & benchmark["model"].isin(models)]
        left.plot(
            folds["rmse_deg"],
            folds["model"].map(models.index) + offset,
            "|",
            color=colour,
            markersize=7,
            alpha=0.7,
        )
        part = scores[scores["split"] == split]
        places = part["model"].map(models.index) + offset
        dot(left, part["rmse_deg"], places, colour, marker, True, markersize=5)
        r2 = part["r2"].astype(float)
        right.hlines(
            places,
            part["r2_low"].astype(float).clip(lower=WORST_R2),
            part["r2_high"].astype(float).clip(lower=WORST_R2),
            color=colour,
        )
        dot(right, r2.clip(lower=WORST_R2), places, colour, marker, True, markersize=5)
        for place, value in zip(places, r2, strict=True):
            if value < WORST_R2:
                right.annotate(
                    f"−{-value:.2g}",
                    (WORST_R2, place),
                    xytext=(-6, 0),
                    ha="right",
                    va="center",
                    textcoords="offset points",
                    fontsize=8,
                    color=colour,
                )
    left.set_yticks(range(len(models)), models)
    left.set_ylim(-0.5, len(models) - 0.5)
    left.set(xlabel=r"RMSE of $\theta_m$ [°]", xlim=(0, None))
    right.set(xlabel="$R^2$ of all held-out predictions", xlim=(-0.35, 1.03))
    right.axvline(0, color=GREY, linewidth=0.8)
    handles = [key(SPLIT_COLOUR[s], SPLIT_MARKER[s], label=SPLIT_NAME[s]) for s in splits]
    legend(figure, [*handles, key(GREY, "|", label="single fold")])
    return figure


@styled
def draw_parity(predictions: pd.DataFrame, scores: pd.DataFrame, model: str) -> Figure:
    """Predicted against simulated θ_m of one model, a panel per kind of split."""
    part = predictions[predictions["model"] == model]
    splits = [s for s in SPLIT_COLOUR if (part["split"] == s).any()]
    both = part[["observed_deg", "predicted_deg"]]
    pad = 0.05 * (both.max().max() - both.min().min()) + 0.1
    limits = (both.min().min() - pad, both.max().max() + pad)
    line = np.array(limits)
    figure = Figure(figsize=(9.2, 3.9), layout="constrained")
    panels = figure.subplots(1, len(splits), sharex=True, sharey=True, squeeze=False)[0]
    for panel, split in zip(panels, splits, strict=True):
        score = scores[(scores["model"] == model) & (scores["split"] == split)].iloc[0]
        panel.plot(line, line, color="black", linewidth=1)
        for band, shade in zip(BANDS_DEG[::-1], ("#F1F2F4", "#DCDFE3"), strict=True):
            panel.fill_between(line, line - band, line + band, color=shade, zorder=0)
        r2 = "–" if pd.isna(score["r2"]) else f"{score['r2']:.3f}"
        panel.set_title(f"{SPLIT_NAME[split]}\nRMSE {score['rmse_deg']:.2g}°, $R^2$ {r2}")
        for filled, dots in part[part["split"] == split].groupby("decided"):
            dot(
                panel,
                dots["observed_deg"],
                dots["predicted_deg"],
                SPLIT_COLOUR[split],
                SPLIT_MARKER[split],
                filled,
                markersize=4,
            )
        panel.set(xlim=limits, ylim=limits, aspect="equal", xlabel=r"simulated $\theta_m$ [°]")
    panels[0].set_ylabel(r"predicted $\theta_m$, held out [°]")
    handles = [
        key(GREY, "o", label="settled"),
        key(GREY, "o", filled=False, label="not settled"),
        key(
            "black",
            line="-",
            label="exact; shades ± " + "°, ± ".join(f"{b:g}" for b in BANDS_DEG) + "°",
        ),
    ]
    legend(figure, handles)
    return figure


@styled
def draw_residuals(predictions: pd.DataFrame, model: str) -> Figure:
    """Residuals of one model on arrays held out: over the prediction, by N_p, and their spread."""
    part = predictions[(predictions["model"] == model) & (predictions["split"] == "geometry")]
    residual = part["predicted_deg"] - part["observed_deg"]
    figure = Figure(figsize=(9.2, 3.4), layout="constrained")
    over, by, spread = figure.subplots(1, 3, sharey=True, width_ratios=(1.3, 1, 0.7))
    for (mode, filled), here in part.groupby(["mode", "decided"]):
        dot(
            over,
            here["predicted_deg"],
            residual[here.index],
            MODE_COLOUR[mode],
            MODE_MARKER[mode],
            filled,
            markersize=4,
        )
    levels = ordered(part["periodicity"])
    by.boxplot(
        [residual[part["periodicity"] == v] for v in levels], positions=range(len(levels)), **BOX
    )
    by.set_xticks(range(len(levels)), [str(v) for v in levels])
    spread.hist(residual, bins=25, orientation="horizontal", color="#9AA5B1")
    for panel in (over, by, spread):
        panel.axhline(0, color="black", linewidth=0.8)
    over.set(xlabel=r"predicted $\theta_m$ [°]", ylabel="predicted − simulated [°]")
    by.set(xlabel=AXIS_LABEL["periodicity"])
    spread.set(xlabel="predictions")
    legend(figure, mode_keys(part) + [key(GREY, "o", filled=False, label="not settled")])
    return figure


@styled
def draw_partial_dependence(table: pd.DataFrame) -> Figure:
    """Mean predicted θ_m over pairs of inputs; blank: no combination inside the domain."""
    pairs = list(dict.fromkeys(zip(table["x_name"], table["y_name"], strict=True)))
    figure, panels = multiples(len(pairs), 2, 9.2, 3.2)
    low, high = table["angle_deg"].min(), table["angle_deg"].max()
    for panel, (x_name, y_name) in zip(panels, pairs, strict=True):
        if x_name == "capillary_number":
            panel.set_xscale("log")
        here = table[(table["x_name"] == x_name) & (table["y_name"] == y_name)]
        grid = here.pivot(index="y", columns="x", values="angle_deg")
        image = panel.pcolormesh(
            grid.columns,
            grid.index,
            np.ma.masked_invalid(grid.to_numpy()),
            cmap="viridis",
            vmin=low,
            vmax=high,
            shading="nearest",
        )
        if grid.notna().all(axis=None) and min(grid.shape) > 1 and high > low:
            lines = panel.contour(
                grid.columns, grid.index, grid.to_numpy(), colors="white", linewidths=0.7
            )
            panel.clabel(lines, fontsize=7)
        panel.grid(False)
        panel.set(xlabel=AXIS_LABEL[x_name], ylabel=AXIS_LABEL[y_name])
    figure.colorbar(image, ax=panels, label=r"mean predicted $\theta_m$ [°]", shrink=0.9)
    return figure
