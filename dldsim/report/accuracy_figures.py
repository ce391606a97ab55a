"""Figures of the accuracy study: error against run time, and numerical uncertainty.

As in :mod:`dldsim.report.style`: what is drawn is computed apart from drawing. Errors are shown
as a share of the bump angle, or of the reference's deformation index.
"""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from dldsim.evidence.accuracy import ANGLE, INDEX, REFERENCE, RELEASE, REPLAYED
from dldsim.report.style import GREY, MODE_COLOUR, dot, key, legend, multiples, styled

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#8C8C00")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<")
MODE_MARKER = {"bump": "o", "mixed": "D", "zigzag": "^", "none": "x"}
INITIAL = ("axis", RELEASE)
"""Knobs that say where a run begins: what they change is an error that no dearer run cures."""
LEAST = 1e-4
"""Errors below this share are drawn there: an axis of logarithms has no zero."""
QUANTITY = {ANGLE: r"$\theta_m$", INDEX: "DI"}
NAMES = {ANGLE: "θ<sub>m</sub>", INDEX: "the deformation index"}
SHARE = {ANGLE: "bump angle", INDEX: "reference DI"}


# ---------------------------------------------------------------------------------- computations


def knob_styles(knobs) -> dict[str, tuple[str, str]]:
    """Colour and marker of each knob; colours repeat with another marker."""
    return {
        knob: (COLOURS[i % len(COLOURS)], MARKERS[(i + i // len(COLOURS)) % len(MARKERS)])
        for i, knob in enumerate(dict.fromkeys(knobs))
    }


def overall(accuracy: pd.DataFrame, quantity: str) -> pd.DataFrame:
    """Each setting over all cases of a quantity, measured against the combined reference.

    Columns: kind, knob, setting, is_default, error (root mean square of the cases' shares), noise
    (likewise), cost (geometric mean of the processor time relative to the default), settled, front
    (no other is both cheaper and better). Without the reference itself, knobs of the release, and
    settings that have no value in some case. The time is that of a row, since how soon an orbit is
    found is chance; where the setting is about the number of rows, that of the replayed run.
    """
    part = accuracy[accuracy["quantity"] == quantity]
    default = part[(part["kind"] == "setting") & part["is_default"]].set_index("case")
    rows = part["rows"].where(~part["knob"].isin(REPLAYED)).fillna(1.0).astype(float)
    usual = part["case"].map(default["rows"]).where(~part["knob"].isin(REPLAYED)).fillna(1.0)
    own = part[part["knob"].isin(REPLAYED) & part["is_default"]].groupby("case")["processor_time_s"]
    base = part["case"].map(own.first()).where(part["knob"].isin(REPLAYED))
    time = part["processor_time_s"] / base.fillna(part["case"].map(default["processor_time_s"]))
    part = part.assign(cost=time / rows * usual.astype(float))
    part = part[~part["knob"].isin((REFERENCE, *INITIAL))]
    rows = []
    keys = ["kind", "knob", "setting", "rank"]
    for (kind, knob, setting, _), group in part.groupby(keys, sort=False):
        repeated_default = kind == "knob" and group["is_default"].all()
        if (
            len(group) < len(default)
            or group["error_to_reference_share"].isna().any()
            or repeated_default
        ):
            continue
        rows.append(
            {
                "kind": kind,
                "knob": knob,
                "setting": setting,
                "is_default": bool(group["is_default"].all()),
                "error": np.sqrt(np.mean(group["error_to_reference_share"] ** 2)),
                "noise": np.sqrt(np.mean(group["noise_share"] ** 2)),
                "cost": np.exp(np.log(group["cost"]).mean()),
                "settled": bool(group["settled"].all()),
            }
        )
    table = pd.DataFrame(
        rows, columns=["kind", "knob", "setting", "is_default", "error", "noise", "cost", "settled"]
    )
    costs, errors = table["cost"].to_numpy(), table["error"].to_numpy()
    front = [
        not ((costs < c) & (errors <= e) | (costs <= c) & (errors < e)).any()
        for c, e in zip(costs, errors, strict=True)
    ]
    return table.assign(front=np.array(front, bool)).sort_values("cost", ignore_index=True)


def gains(accuracy: pd.DataFrame, quantity: str) -> pd.DataFrame:
    """What one knob buys: from the default to the value next in cost, either way.

    Columns: knob, setting, cost (relative to the default), error_change (of the root mean square
    share against the combined reference; negative: better), per_doubling (error change for each
    doubling of the cost, null where the cost changes by less than 10 %), noise. Dearer values
    first by what they gain, then cheaper ones.
    """
    table = overall(accuracy, quantity)
    default = table[(table["kind"] == "setting") & table["is_default"]]
    table = table[table["kind"] == "knob"]
    if default.empty or table.empty:
        return pd.DataFrame(
            columns=["knob", "setting", "cost", "error_change", "per_doubling", "noise"]
        )
    change = table["error"] - default["error"].iloc[0]
    doublings = np.log2(table["cost"])
    per = (change / doublings).where(doublings.abs() > np.log2(1.1))
    return table.assign(error_change=change, per_doubling=per)[
        ["knob", "setting", "cost", "error_change", "per_doubling", "noise"]
    ].sort_values("error_change", ignore_index=True)


# ------------------------------------------------------------------------------------- drawing


@styled
def draw_knobs(accuracy: pd.DataFrame, quantity: str) -> Figure:
    """Error against the finest value of each knob over processor time, a panel per case."""
    table = accuracy[(accuracy["quantity"] == quantity) & (accuracy["kind"] == "knob")]
    styles = knob_styles(table["knob"])
    cases = list(dict.fromkeys(table["case"]))
    figure, panels = multiples(len(cases), 3, 9.2, 3.7)
    for panel, case in zip(panels, cases, strict=True):
        here = table[table["case"] == case]
        noise = here["noise_share"].iloc[0]
        if pd.notna(noise):
            panel.axhspan(0, 100 * noise, color="#EDEFF2", linewidth=0)
        for knob, part in here.groupby("knob", sort=False):
            colour, marker = styles[knob]
            part = part[~part["is_reference"] & part["error_share"].notna()].sort_values("rank")
            error = 100 * part["error_share"].clip(lower=LEAST)
            panel.plot(part["processor_time_s"], error, "-", color=colour, linewidth=1)
            for settled, dots in part.groupby("settled"):
                dot(panel, dots["processor_time_s"], error[dots.index], colour, marker, settled)
            own = part[part["is_default"]]
            panel.plot(
                own["processor_time_s"],
                error[own.index],
                "o",
                markersize=10,
                color="black",
                markerfacecolor="none",
                markeredgewidth=0.9,
            )
        panel.set(xscale="log", yscale="log", xlabel="processor time of a run [s]", title=case)
        panel.set_ylim(bottom=100 * LEAST / 1.6)
        if panel.get_subplotspec().is_first_col():
            panel.set_ylabel(f"error of {QUANTITY[quantity]} [% of {SHARE[quantity]}]")
    legend(
        figure,
        [
            *(key(*styles[knob], "-", label=knob) for knob in styles),
            key("black", "o", filled=False, label="default"),
            key(GREY, "o", filled=False, label="not settled"),
            *(
                [key("#EDEFF2", "s", label="differences between starts")]
                if table["noise_share"].notna().any()
                else []
            ),
        ],
    )
    return figure


@styled
def draw_pareto(accuracy: pd.DataFrame) -> Figure:
    """Error against the combined reference over cost relative to the default, with the front."""
    quantities = [q for q in (ANGLE, INDEX) if len(overall(accuracy, q))]
    figure, panels = multiples(len(quantities), 2, 9.2, 4.0)
    for panel, quantity in zip(panels, quantities, strict=True):
        table = overall(accuracy, quantity)
        noise = table["noise"].iloc[0]
        if pd.notna(noise):
            panel.axhspan(0, 100 * noise, color="#EDEFF2", linewidth=0)
        error = 100 * table["error"].clip(lower=LEAST)
        single = table["kind"] == "knob"
        for settled in (True, False):
            seen = single & (table["settled"] == settled)
            dot(panel, table["cost"][seen], error[seen], "#9AA0A6", "o", settled, markersize=4)
        front = table[table["front"]]
        panel.step(front["cost"], error[front.index], where="post", color="#009E73", linewidth=1.2)
        for i, row in table[~single].iterrows():
            colour = "black" if row["is_default"] else "#D55E00"
            dot(panel, [row["cost"]], [error[i]], colour, "D", row["settled"], markersize=7)
            panel.annotate(
                row["knob"],
                (row["cost"], error[i]),
                xytext=(6, 5),
                textcoords="offset points",
                fontsize=8.5,
                color=colour,
            )
        told = None
        for i, row in front[front["kind"] == "knob"].iterrows():
            if told is not None and row["error"] > 0.97 * told:
                continue
            told = row["error"]
            panel.annotate(
                f"{row['knob']} {row['setting']}",
                (row["cost"], error[i]),
                xytext=(4, -10),
                textcoords="offset points",
                fontsize=7,
                color=GREY,
            )
        panel.set(
            xscale="log",
            yscale="log",
            xlabel="processor time / that of the default",
            ylabel=f"error of {QUANTITY[quantity]} [% of {SHARE[quantity]}]",
            title=QUANTITY[quantity],
        )
    legend(
        figure,
        [
            key("black", "D", label="default"),
            key("#D55E00", "D", label="named settings"),
            key("#9AA0A6", "o", label="one knob changed"),
            key("#009E73", line="-", label="Pareto front"),
            key(GREY, "o", filled=False, label="not settled"),
        ],
    )
    return figure


@styled
def draw_gains(accuracy: pd.DataFrame) -> Figure:
    """Change of the error from the default to each other value of a knob, with its cost."""
    tables = {q: gains(accuracy, q) for q in (ANGLE, INDEX)}
    tables = {q: t for q, t in tables.items() if len(t)}
    tallest = max(len(t) for t in tables.values())
    figure, panels = multiples(len(tables), 2, 9.2, 1.0 + 0.2 * tallest)
    for panel, (quantity, table) in zip(panels, tables.items(), strict=True):
        table = table.sort_values("error_change", ascending=False, ignore_index=True)
        noise = table["noise"].iloc[0]
        if pd.notna(noise):
            panel.axvspan(-100 * noise, 100 * noise, color="#EDEFF2", linewidth=0)
        panel.axvline(0, color="black", linewidth=0.8)
        for place, row in table.iterrows():
            dearer, change = row["cost"] > 1, 100 * row["error_change"]
            colour = "#0072B2" if dearer else "#E69F00"
            panel.hlines(place, 0, change, color=colour, linewidth=1.6)
            dot(panel, [change], [place], colour, "o" if dearer else "s", True, markersize=4.5)
        panel.set_yticks(
            range(len(table)),
            [
                f"{row['knob']} {row['setting']}  (×{row['cost']:.2g})"
                for _, row in table.iterrows()
            ],
            fontsize=7.5,
        )
        panel.grid(axis="y", visible=False)
        panel.set(
            xlabel=f"change of the error of {QUANTITY[quantity]} [% of {SHARE[quantity]}]",
            title=QUANTITY[quantity],
        )
    legend(
        figure,
        [
            key("#0072B2", "o", "-", label="costs more than the default"),
            key("#E69F00", "s", "-", label="costs less"),
            key("#EDEFF2", "s", label="differences between starts"),
        ],
    )
    return figure


@styled
def draw_sigma(check: pd.DataFrame) -> Figure:
    """Difference of each pair from the reference against its uncertainty; filled: same mode."""
    table = check.dropna(subset=["error_deg", "sigma_num_deg"])
    figure = Figure(figsize=(5.6, 4.4), layout="constrained")
    panel = figure.subplots()
    error = table["error_deg"].abs()
    floor = max(1e-3, 0.5 * error[error > 0].min()) if (error > 0).any() else 1e-3
    error = error.clip(lower=floor)
    low, high = table["sigma_num_deg"].min() / 1.5, table["sigma_num_deg"].max() * 1.5
    line = np.array([low, high])
    for factor, style in ((1, "-"), (2, "--")):
        panel.plot(line, factor * line, style, color="black", linewidth=1)
    same = table["mode"] == table["reference_mode"]
    for (mode, agrees), dots in table.groupby([table["mode"], same]):
        dot(
            panel,
            dots["sigma_num_deg"],
            error[dots.index],
            MODE_COLOUR[mode],
            MODE_MARKER[mode],
            agrees,
            markersize=7,
        )
    panel.set(
        xscale="log",
        yscale="log",
        xlabel=r"$\sigma_{num}$ [°]",
        ylabel="|angle − angle at the reference| [°]",
    )
    present = [mode for mode in MODE_MARKER if (table["mode"] == mode).any()]
    legend(
        figure,
        [
            *(key(MODE_COLOUR[m], MODE_MARKER[m], label=m) for m in present),
            key(GREY, "o", label="mode of the reference"),
            key(GREY, "o", filled=False, label="another"),
            key("black", line="-", label="1 σ"),
            key("black", line="--", label="2 σ"),
        ],
        ncols=4,
    )
    return figure
