"""Figures of the validation cases of membranes and cells."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from dldsim.report.angle_figures import SCATTER_OF_LAW, critical_size_ratio
from dldsim.report.style import GREY, dot, key, legend, ordered, shades_of, styled
from dldsim.report.validation_figures import with_levels


@styled
def draw_stretching(validation: pd.DataFrame) -> Figure:
    """Axial and transverse diameter of a stretched red cell beside the experiment."""
    table = validation[validation["case"] == "erythrocyte-stretching"].dropna(subset="value")
    figure = Figure(figsize=(9.2, 3.6), layout="constrained")
    panel = figure.subplots()
    variants = list(dict.fromkeys(table["variant"]))
    lines = dict(zip(variants, ("-", "--", ":"), strict=False))
    for quantity, colour in (("axial diameter", "#0072B2"), ("transverse diameter", "#D55E00")):
        part = table[table["quantity"] == quantity]
        seen = part[part["mark"].notna()].drop_duplicates("parameter", keep="last")
        panel.errorbar(
            seen["parameter"],
            seen["reference"],
            seen["reference"] * seen["mark"],
            fmt="o",
            color=colour,
            capsize=3,
            markersize=4,
            linewidth=1,
        )
        for variant in variants:
            ours = part[part["variant"] == variant]
            panel.plot(ours["parameter"], ours["value"], lines[variant], color=colour)
    panel.set(xlabel="force [pN]", ylabel="diameter [µm]", ylim=(0, None))
    legend(
        figure,
        [
            key("#0072B2", "o", label="axial, experiment"),
            key("#D55E00", "o", label="transverse, experiment"),
            *(key(GREY, line=lines[v], label=f"computed, {v}") for v in variants),
        ],
    )
    return figure


LAW_COLOUR = {"neo-Hookean": "#0072B2", "Skalak": "#D55E00", "springs": "#009E73"}
PUBLISHED_MARKER = {"Ramanujan": "v", "Doddi": "<", "Huet(Basilisk) low": "+", "Huet": "x"}


def law_of(variant: str) -> str:
    """Membrane law that a variant of the case capsule-in-shear begins with."""
    return variant.split(",")[0].split(" ")[0]


def capsules(validation: pd.DataFrame) -> pd.DataFrame:
    """Rows of capsule-in-shear with the columns law and kind.

    kind: "resolved" (a radius in nodes, beside a reference of the same law), "extrapolated",
    "published" (beside a digitised curve), "springs" (beside another law), "variant".
    """
    table = validation[validation["case"] == "capsule-in-shear"].dropna(subset="value").copy()
    table["law"] = table["variant"].map(law_of)
    kind = pd.Series("variant", index=table.index)
    kind[table["mark"].notna()] = "resolved"
    kind[table["variant"].str.endswith("extrapolated")] = "extrapolated"
    kind[table["source"].str.contains("digitised")] = "published"
    kind[table["variant"].str.startswith("springs beside")] = "springs"
    return table.assign(kind=kind)


@styled
def draw_capsules(validation: pd.DataFrame) -> Figure:
    """Taylor deformation and inclination in shear over Ca, and the error over Ca."""
    table = with_levels(capsules(validation))
    figure = Figure(figsize=(9.2, 3.9), layout="constrained")
    shape, error, tilt = figure.subplots(1, 3)
    deformation = table[table["quantity"] == "Taylor deformation"]
    ca = np.array([0.007, 0.1])
    for line, law in (("-", "neo-Hookean"), ("--", "springs")):
        small = deformation[
            (deformation["law"] == law) & deformation["variant"].str.contains("small deformation")
        ]
        if len(small):
            ratio = (small["reference"] / small["parameter"]).iloc[0]
            shape.plot(ca, ratio * ca, line, color="black", linewidth=0.9)
    bent = deformation[deformation["variant"].str.fullmatch("neo-Hookean, κ = 0.01 G_s a²")]
    integral = bent.drop_duplicates("parameter").set_index("parameter")["reference"]
    published = deformation[deformation["kind"] == "published"]
    for curve, marker in PUBLISHED_MARKER.items():
        part = published[published["variant"].str.contains(curve, regex=False)]
        above = part["reference"] / part["parameter"].map(integral) - 1
        error.plot(
            part["parameter"] * 1.08,
            100 * above,
            marker,
            color=GREY,
            markersize=4,
            markerfacecolor="none",
            zorder=1,
        )
        published = published.drop(part.index)
    finest = table[table["finest"] & table["kind"].isin(["resolved", "springs"])]
    for law, colour in LAW_COLOUR.items():
        for panel, quantity in ((shape, "Taylor deformation"), (tilt, "inclination")):
            part = finest[(finest["law"] == law) & (finest["quantity"] == quantity)]
            known = part[part["kind"] == "resolved"]
            dot(panel, known["parameter"], known["reference"], colour, "s", False, markersize=8)
            dot(panel, part["parameter"], part["value"], colour, "o", True, markersize=3.5)
        of_law = deformation[(deformation["law"] == law) & deformation["mark"].notna()]
        resolved = of_law[of_law["kind"] == "resolved"]
        for level, marker in enumerate("^o"):
            part = resolved[resolved["level"] == level]
            dot(
                error,
                part["parameter"],
                100 * part["relative_error"],
                colour,
                marker,
                level > 0,
                markersize=4,
            )
        part = of_law[of_law["kind"] == "extrapolated"]
        error.plot(
            part["parameter"],
            100 * part["relative_error"],
            "_",
            color=colour,
            markersize=11,
            markeredgewidth=1.6,
        )
    error.axhline(0, color="black", linewidth=0.8)
    shape.set(xscale="log", yscale="log", ylabel="Taylor deformation")
    error.set(xscale="log", ylabel="Taylor deformation above reference [%]")
    tilt.set(xscale="log", ylabel="inclination [°]", ylim=(0, 50))
    shape.set_yticks(ticks := (0.02, 0.05, 0.1, 0.2, 0.5), [f"{tick:g}" for tick in ticks])
    for panel in (shape, error, tilt):
        panel.set_xlabel("Ca = μ γ̇ a / G$_s$")
        panel.set_xticks(ticks := (0.01, 0.03, 0.1, 0.3, 0.6), [f"{tick:g}" for tick in ticks])
        panel.set_xlim(0.007, 0.8)
        panel.minorticks_off()
    radii = ordered(table.loc[table["kind"] == "resolved", "resolution"])
    legend(
        figure,
        [
            *(key(c, "o", label=name) for name, c in LAW_COLOUR.items()),
            key(GREY, "s", filled=False, label="boundary integral, theory"),
            *(
                key(GREY, marker, filled=marker == "o", label=f"radius of {radius:g} nodes")
                for radius, marker in zip(radii, "^o", strict=False)
            ),
            key(GREY, "_", label="extrapolated"),
            *(
                key(GREY, marker, filled=False, label=label)
                for marker, label in (
                    ("v", "Ramanujan & Pozrikidis 1998"),
                    ("<", "Doddi & Bagchi 2008"),
                    ("x", "Huet, fine"),
                    ("+", "Huet, coarse"),
                )
            ),
            key("black", line="-", label="small deformation"),
        ],
        ncols=4,
    )
    return figure


@styled
def draw_transition(validation: pd.DataFrame) -> Figure:
    """Critical diameter of stiff spheres over the row shift, law with its scatter, lower bound."""
    table = validation[validation["case"] == "rigid-transition"].dropna(subset="value")
    figure = Figure(figsize=(6.4, 3.8), layout="constrained")
    panel = figure.subplots()
    epsilon = np.linspace(0.04, 0.26, 200)
    law = critical_size_ratio(epsilon)
    panel.fill_between(
        epsilon,
        (1 - SCATTER_OF_LAW) * law,
        (1 + SCATTER_OF_LAW) * law,
        color="#E4E6E9",
        linewidth=0,
    )
    panel.plot(epsilon, law, color="black")
    bound = table[table["quantity"] == "critical diameter beside streamline bound"]
    bound = bound.sort_values("parameter").drop_duplicates("parameter")
    panel.plot(1 / bound["parameter"], bound["reference"], "--", color=GREY, marker="_")
    colours = shades_of(table["resolution"].dropna(), top=0.8)
    extrapolated = table[table["variant"] == "extrapolated"]
    panel.plot(1 / extrapolated["parameter"], extrapolated["value"], "x", color="black")
    parts = {
        name: part.set_index(["parameter", "resolution"])
        for name, part in table.drop(extrapolated.index).groupby("quantity")
    }
    critical = parts["critical diameter"].sort_index()
    beside = 0.004 * critical.groupby(level="parameter").cumcount()  # of the same row shift
    for (periodicity, resolution), row in critical.iterrows():
        low, high = (
            parts[name].loc[(periodicity, resolution), "value"]
            for name in ("largest diameter that zigzags", "smallest diameter that bumps")
        )
        panel.errorbar(
            1 / periodicity + beside[periodicity, resolution],
            row["value"],
            [[row["value"] - low], [high - row["value"]]],
            fmt="o",
            markersize=2.5,
            color=colours[resolution],
            capsize=4,
            linewidth=1.2,
        )
    panel.set(
        xlabel="row-shift fraction ε = 1/N$_p$",
        ylabel="critical diameter / gap",
        xlim=(0.04, 0.26),
        ylim=(0, None),
    )
    legend(
        figure,
        [
            *(key(c, "o", label=f"stiff sphere, {r:g} nodes per gap") for r, c in colours.items()),
            key("black", "x", label="extrapolated"),
            key("black", line="-", label="1.4 ε$^{0.48}$ (shade: ±10 %)"),
            key(GREY, line="--", label="point-like follower"),
        ],
        ncols=3,
    )
    return figure


@styled
def draw_constriction_shape(validation: pd.DataFrame) -> Figure:
    """Diameters at the four positions of the source's table, experiment beside our channels."""
    table = validation[validation["case"] == "constriction-shape"].dropna(subset="value")
    figure = Figure(figsize=(9.2, 3.6), layout="constrained")
    panels = figure.subplots(1, 2)
    variants = list(dict.fromkeys(table["variant"]))
    colours = dict(zip(variants, shades_of(range(len(variants)), top=0.85).values(), strict=True))
    for panel, name in zip(panels, ("D", "H"), strict=True):
        part = table[table["quantity"].str.startswith(f"diameter {name}")]
        seen = part.drop_duplicates("parameter")
        bar = table["mark"].max() * seen["reference"]
        panel.errorbar(
            seen["parameter"],
            seen["reference"],
            bar,
            fmt="s",
            color="black",
            markerfacecolor="white",
            capsize=4,
            markersize=6,
            linewidth=1,
        )
        for n, (variant, of_variant) in enumerate(part.groupby("variant", sort=False)):
            panel.plot(
                of_variant["parameter"] + 0.13 * (n + 1),
                of_variant["value"],
                "o",
                markersize=3.5,
                color=colours[variant],
            )
        panel.set(xlabel="position", ylabel=f"{name} [µm]", xticks=[1, 2, 3, 4], ylim=(0, None))
    legend(
        figure,
        [
            key("black", "s", filled=False, label="experiment"),
            *(key(c, "o", label=v) for v, c in colours.items()),
        ],
        ncols=2,
    )
    return figure
