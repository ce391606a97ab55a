"""The report's figures of the validation; style and small parts from :mod:`dldsim.report.style`.

Every ``draw_…`` takes the table `validation` (pandas) and returns a matplotlib Figure.
"""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from dldsim.report.style import GREY, dot, key, legend, multiples, ordered, shades_of, styled

VARIANT_COLOUR = {"half-way": "#D55E00", "interpolated": "#0072B2"}
VARIANT_MARKER = {"half-way": "s", "interpolated": "o"}
SERIES = ["case", "quantity", "variant", "parameter"]
"""Columns that name a series of comparisons at different resolutions."""


def with_levels(validation: pd.DataFrame) -> pd.DataFrame:
    """Measured comparisons with the columns level, 0 for the coarsest of its series, and finest."""
    table = validation[validation["relative_error"].notna()].copy()
    resolution = table["resolution"].fillna(0.0)
    series = resolution.groupby([table[name] for name in SERIES], dropna=False)
    table["level"] = series.rank(method="dense").astype(int) - 1
    table["finest"] = resolution == series.transform("max")
    return table


def convergence(validation: pd.DataFrame) -> pd.DataFrame:
    """Root mean square error over the series of each case, variant and level.

    Only comparisons with a mark in series of several levels. Columns: case, variant, level,
    resolution (mean over the series), error.
    """
    table = with_levels(validation)
    several = table.groupby(SERIES, dropna=False)["level"].transform("max") > 0
    table = table[several & table["mark"].notna()]
    table = table.assign(square=table["relative_error"] ** 2)
    levels = table.groupby(["case", "variant", "level"], sort=False)
    means = levels[["resolution", "square"]].mean().reset_index()
    return means.assign(error=np.sqrt(means["square"])).drop(columns="square")


def observed_orders(validation: pd.DataFrame) -> pd.DataFrame:
    """Order between the coarsest and the finest level of `convergence`; case, variant, order.

    Pooled over the series, since the error of one quantity may pass through zero. Without those
    that are exact to rounding.
    """
    means = convergence(validation)
    ends = means.groupby(["case", "variant"], sort=False)[["resolution", "error"]].agg(
        ["first", "last"]
    )
    ends = ends[ends["error", "last"] > 1e-7]
    gain = np.log(ends["error", "first"] / ends["error", "last"])
    order = gain / np.log(ends["resolution", "last"] / ends["resolution", "first"])
    return order.rename("order").reset_index()


def _variant_keys(variants) -> list:
    return [
        key(VARIANT_COLOUR[v], VARIANT_MARKER[v], "-", label=f"{v} bounce-back")
        for v in VARIANT_COLOUR
        if v in set(variants)
    ]


@styled
def draw_convergence(validation: pd.DataFrame) -> Figure:
    """Error over resolution, a panel per fluid case: thin each series, thick the root mean square.

    Cases that are exact to rounding have no panel.
    """
    table = with_levels(validation[validation["group"] == "fluid"])
    means = convergence(table)
    means = means[means["error"] > 1e-7]
    cases = list(dict.fromkeys(means["case"]))
    figure, panels = multiples(len(cases), 3, 9.2, 2.9)
    for panel, case in zip(panels, cases, strict=True):
        here, of_case = means[means["case"] == case], table[table["case"] == case]
        for (variant, *_), part in of_case[of_case["mark"].notna()].groupby(
            ["variant", "quantity", "parameter"], dropna=False
        ):
            panel.plot(
                part["resolution"],
                part["relative_error"].abs(),
                linewidth=0.6,
                alpha=0.35,
                color=VARIANT_COLOUR.get(variant, GREY),
            )
        for variant, part in here.groupby("variant", sort=False):
            panel.plot(
                part["resolution"],
                part["error"],
                color=VARIANT_COLOUR.get(variant, GREY),
                marker=VARIANT_MARKER.get(variant, "D"),
                linewidth=1.8,
            )
        x = np.array([here["resolution"].min(), here["resolution"].max()])
        for order, line in ((1, ":"), (2, "--")):
            panel.plot(
                x, here["error"].max() * (x / x[0]) ** -order, line, color="black", linewidth=0.9
            )
        panel.set(
            xscale="log",
            yscale="log",
            xlabel=of_case["resolution_of"].iloc[0],
            ylim=(here["error"].min() / 8, here["error"].max() * 4),
        )
        ticks = ordered(here["resolution"].round())
        panel.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        panel.minorticks_off()
        panel.set_title(case)
        if panel.get_subplotspec().is_first_col():
            panel.set_ylabel("|relative error|")
    legend(
        figure,
        [
            *_variant_keys(means["variant"]),
            key(GREY, "D", "-", label="other variants"),
            key("black", line=":", label="order 1"),
            key("black", line="--", label="order 2"),
        ],
    )
    return figure


@styled
def draw_square_arrays(validation: pd.DataFrame) -> Figure:
    """Permeability error of square arrays over the solid fraction, a panel per bounce-back."""
    table = validation[validation["case"] == "square-arrays"].dropna(subset="relative_error")
    variants = [v for v in VARIANT_COLOUR if (table["variant"] == v).any()]
    figure = Figure(figsize=(9.2, 3.4), layout="constrained")
    panels = figure.subplots(1, len(variants), squeeze=False, sharey=True)[0]
    colours = shades_of(table["resolution"])
    for panel, variant in zip(panels, variants, strict=True):
        of_variant = table[table["variant"] == variant]
        for resolution, part in of_variant.groupby("resolution"):
            part = part.sort_values("parameter")
            panel.plot(
                part["parameter"],
                part["relative_error"].abs(),
                "-",
                marker=VARIANT_MARKER[variant],
                color=colours[resolution],
            )
            panel.plot(part["parameter"], part["mark"], ":", color=colours[resolution])
        panel.set(yscale="log", xlabel="solid fraction", title=f"{variant} bounce-back")
    panels[0].set_ylabel("|relative error| of the permeability")
    legend(
        figure,
        [
            *(key(c, "o", "-", label=f"{r:g} nodes per pitch") for r, c in colours.items()),
            key(GREY, line=":", label="allowed"),
        ],
    )
    return figure


@styled
def draw_tilts(validation: pd.DataFrame) -> Figure:
    """Tilt under axial force: computed against reference, and its error over the resolution."""
    tilts = with_levels(validation[validation["quantity"].str.startswith("tilt")])
    figure = Figure(figsize=(9.2, 3.8), layout="constrained")
    parity, error = figure.subplots(1, 2)
    top = 1.06 * tilts["reference"].max()
    parity.plot([0, top], [0, top], color="black", linewidth=1)
    for variant, part in tilts.groupby("variant", sort=False):
        colour = VARIANT_COLOUR.get(variant, GREY)
        for case, marker in (("row-shifted-arrays", "o"), ("finite-height-arrays", "^")):
            dots = part[part["finest"] & (part["case"] == case)]
            dot(parity, dots["reference"], dots["value"], colour, marker, variant == "interpolated")
            off = part[part["case"] == case]
            dot(
                error,
                off["resolution"],
                (off["value"] - off["reference"]).abs(),
                colour,
                marker,
                variant == "interpolated",
            )
    parity.set(
        xlabel="reference tilt [°]",
        ylabel="computed tilt, finest resolution [°]",
        xlim=(0, top),
        ylim=(0, top),
        aspect="equal",
    )
    error.set(xscale="log", yscale="log", xlabel="nodes per pitch", ylabel="|error| of tilt [°]")
    ticks = (20, 30, 40, 60, 80)
    error.set_xticks(ticks, [str(tick) for tick in ticks])
    error.minorticks_off()
    present = set(tilts["variant"])
    legend(
        figure,
        [
            *(
                key(VARIANT_COLOUR[v], "o", filled=v == "interpolated", label=f"{v} bounce-back")
                for v in VARIANT_COLOUR
                if v in present
            ),
            key(GREY, "o", label="plane arrays"),
            key(GREY, "^", label="arrays between plates"),
        ],
    )
    return figure
