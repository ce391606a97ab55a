"""Figures of the source's slit: the deformation index and what it depends on.

The panels of the source paper's analysis from our data. Where the message differs from the paper's,
the caption in the report says how.
"""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from dldsim.config.assay_sections import FIXED_VELOCITY, GROUP_VELOCITY
from dldsim.report.style import GREY, dodged, key, legend, multiples, ordered, shades_of, styled

PAPER_DEFORMATION_INDEX = {"G1": 0.50, "G2": 0.60, "G5": 0.777, "G6": 0.781, "G7": 0.784}
"""Deformation index that the source paper gives for its stiffness sets 1 to 5."""
PAPER_CORRELATION = {"ks_uN_per_m": 0.77, "kal_uN_per_m": 0.73, "kb_pN_um": 0.33}
"""The source paper's correlations of the deformation index with the moduli."""
PAPER_VARIATION = {
    "G1": (0.15, 0.20),
    "G2": (0.15, 0.20),
    "G3": (0.15, 0.20),
    "G4": (0.05, 0.08),
    "G5": (0.05, 0.08),
    "G6": (0.05, 0.08),
    "G7": (0.05, 0.08),
}
"""The source paper's coefficients of variation over release positions."""
ASSAY_COLOUR = {GROUP_VELOCITY: "#0072B2", FIXED_VELOCITY: "#E69F00"}
ASSAY_MARKER = {GROUP_VELOCITY: "o", FIXED_VELOCITY: "s"}
ASSAY_NAME = {
    GROUP_VELOCITY: "velocity rises with stiffness",
    FIXED_VELOCITY: "one velocity for all",
}
VARIABLE_LABEL = {
    "deformation_index": "DI",
    "ks_uN_per_m": "$k_s$",
    "kb_pN_um": "$k_b$",
    "kal_uN_per_m": r"$k_\alpha$",
    "velocity_mm_s": "velocity",
}


def correlation_matrix(correlations: pd.DataFrame) -> pd.DataFrame:
    """Square symmetric matrix of Pearson r with unit diagonal from the pairs of one assay."""
    names = list(dict.fromkeys([*correlations["variable_a"], *correlations["variable_b"]]))
    matrix = pd.DataFrame(np.nan, index=names, columns=names)
    for _, row in correlations.iterrows():
        matrix.loc[row["variable_a"], row["variable_b"]] = row["pearson_r"]
        matrix.loc[row["variable_b"], row["variable_a"]] = row["pearson_r"]
    for name in names:
        matrix.loc[name, name] = 1.0
    return matrix


@styled
def draw_calibration(runs: pd.DataFrame, calibration: pd.DataFrame) -> Figure:
    """DI per group and assay over release positions, and the coefficient of variation."""
    figure = Figure(figsize=(9.2, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.5, 1))
    groups = ordered(calibration["group"])
    assays = [d for d in ASSAY_COLOUR if (calibration["assay"] == d).any()]
    seen = runs[runs["deformation_index"].notna()]
    for index, assay in enumerate(assays):
        colour, marker = ASSAY_COLOUR[assay], ASSAY_MARKER[assay]
        offset = dodged(index, len(assays), 0.36)
        for _, row in calibration[calibration["assay"] == assay].iterrows():
            place = groups.index(row["group"]) + offset
            part = seen[(seen["assay"] == assay) & (seen["group"] == row["group"])]
            spread = np.array([dodged(i, len(part), 0.16) for i in range(len(part))])
            left.plot(
                place + spread,
                part["deformation_index"],
                marker,
                alpha=0.7,
                color=colour,
                markersize=3.5,
                markeredgewidth=0,
            )
            left.errorbar(
                place + 0.13,
                row["deformation_index"],
                row["deformation_index_std"],
                fmt="_",
                color="black",
                capsize=2.5,
                markersize=7,
                elinewidth=1,
            )
            right.plot(place, 100 * row["coefficient_of_variation"], marker, color=colour)
    for place, group in enumerate(groups):
        if group in PAPER_DEFORMATION_INDEX:
            left.plot(
                place - 0.36,
                PAPER_DEFORMATION_INDEX[group],
                "D",
                color=GREY,
                markerfacecolor="white",
                markersize=5,
            )
        if group in PAPER_VARIATION:
            low, high = PAPER_VARIATION[group]
            right.add_patch(
                Rectangle((place - 0.4, 100 * low), 0.8, 100 * (high - low), color="#E8E4D8")
            )
    sets = calibration[calibration["stiffness_set"] != ""].set_index("group")["stiffness_set"]
    names = [f"{g}\nset {sets[g]}" if g in sets else g for g in groups]
    for panel in (left, right):
        panel.set_xticks(range(len(groups)), names if panel is left else groups)
        panel.set_xlim(-0.6, len(groups) - 0.4)
    left.set(ylabel="deformation index DI")
    right.set(ylabel="coefficient of variation [%]", ylim=(0, 22))
    handles = [key(ASSAY_COLOUR[d], ASSAY_MARKER[d], label=ASSAY_NAME[d]) for d in assays]
    handles += [
        key("black", "_", label="mean and standard deviation"),
        key(GREY, "D", filled=False, label="source paper"),
        key("#E8E4D8", "s", label="source paper, range"),
    ]
    legend(figure, handles, ncols=5)
    return figure


@styled
def draw_correlations(correlations: pd.DataFrame) -> Figure:
    """Pearson matrix of each assay; below DI's row the source paper's figures in brackets."""
    assays = [d for d in ASSAY_COLOUR if (correlations["assay"] == d).any()]
    figure, panels = multiples(len(assays), 2, 9.2, 3.9)
    for panel, assay in zip(panels, assays, strict=True):
        matrix = correlation_matrix(correlations[correlations["assay"] == assay])
        panel.imshow(np.nan_to_num(matrix.to_numpy()), cmap="PuOr_r", vmin=-1.35, vmax=1.35)
        for i, (name, row) in enumerate(matrix.iterrows()):
            for j, (other, value) in enumerate(row.items()):
                text = "–" if np.isnan(value) else f"{value:.2f}".replace("-", "−")
                seed = assay == GROUP_VELOCITY and name == "deformation_index"
                if seed and other in PAPER_CORRELATION:
                    text += f"\n({PAPER_CORRELATION[other]:.2f})"
                panel.text(
                    j,
                    i,
                    text,
                    ha="center",
                    va="center",
                    fontsize=8,
                    color="white" if abs(value) > 0.75 else "black",
                )
        labels = [VARIABLE_LABEL.get(name, name) for name in matrix]
        panel.set_xticks(range(len(labels)), labels)
        panel.set_yticks(range(len(labels)), labels)
        panel.grid(False)
        panel.spines[:].set_visible(False)
        panel.tick_params(length=0)
        panel.set_title(ASSAY_NAME[assay])
    return figure


@styled
def draw_moduli(runs: pd.DataFrame) -> Figure:
    """DI of each constriction run against k_s, k_α, k_b and the velocity."""
    seen = runs[runs["deformation_index"].notna()]
    names = {
        "ks_uN_per_m": "$k_s$ [µN/m]",
        "kal_uN_per_m": r"$k_\alpha$ [µN/m]",
        "kb_pN_um": "$k_b$ [pN·µm]",
        "velocity_mm_s": "velocity [mm/s]",
    }
    figure, panels = multiples(4, 4, 9.2, 2.7, sharey=True)
    assays = [d for d in ASSAY_COLOUR if (seen["assay"] == d).any()]
    for panel, (name, label) in zip(panels, names.items(), strict=True):
        for assay in assays:
            part = seen[seen["assay"] == assay]
            panel.plot(
                part[name],
                part["deformation_index"],
                ASSAY_MARKER[assay],
                color=ASSAY_COLOUR[assay],
                markersize=4,
                alpha=0.7,
                markeredgewidth=0,
            )
        if name == "kb_pN_um" and (seen[name] > 0).all():
            panel.set_xscale("log")
            panel.xaxis.set_major_formatter("{x:g}")
            panel.xaxis.set_minor_formatter("")
        panel.set(xlabel=label)
    panels[0].set_ylabel("deformation index DI")
    legend(figure, [key(ASSAY_COLOUR[d], ASSAY_MARKER[d], label=ASSAY_NAME[d]) for d in assays])
    return figure


@styled
def draw_diameters(tracks: pd.DataFrame, runs: pd.DataFrame) -> Figure:
    """Diameters D (along the flow), H (across) and DI along the channel, coloured by group."""
    group_of = runs.set_index("run_id")["group"]
    assay_of = runs.set_index("run_id")["assay"]
    colours = shades_of(group_of)
    names = {
        "diameter_d_um": "$D$ along flow [µm]",
        "diameter_h_um": "$H$ across flow [µm]",
        "deformation_index": "DI",
    }
    figure = Figure(figsize=(9.2, 5.6), layout="constrained")
    panels = figure.subplots(3, 1, sharex=True)
    for panel, (name, label) in zip(panels, names.items(), strict=True):
        for run_id, track in tracks.groupby("run_id"):
            line = "--" if assay_of[run_id] == FIXED_VELOCITY else "-"
            panel.plot(
                track["x_um"],
                track[name],
                line,
                color=colours[group_of[run_id]],
                linewidth=0.9,
                alpha=0.8,
            )
        panel.set_ylabel(label)
        panel.set_ylim(bottom=0)
    panels[-1].set_xlabel("centre of mass along the channel $x$ [µm]")
    handles = [key(c, line="-", label=g) for g, c in colours.items()]
    if (assay_of == FIXED_VELOCITY).any():
        handles.append(key(GREY, line="--", label=ASSAY_NAME[FIXED_VELOCITY]))
    legend(figure, handles, ncols=8)
    return figure
