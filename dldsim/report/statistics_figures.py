"""Figures of the analysis of variance and of robust arrays."""

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from dldsim.report.angle_figures import AXIS_LABEL
from dldsim.report.style import key, legend, multiples, ordered, styled
from dldsim.vocabulary import GEOMETRY

MODEL_TITLE = {
    "hierarchical": "hierarchical model",
    "main_effects": "main effects alone",
    "seed_interactions": "interactions alone (source paper)",
    "hierarchical_ca": "hierarchical model, ln Ca",
    "main_effects_ca": "main effects alone, ln Ca",
}


def worst_risk(fabrication: pd.DataFrame) -> pd.DataFrame:
    """Per geometry and error, the largest risk over the stiffness sets, and the least share inside.

    Columns: geometry, radius_error_um, mode_change_probability, moved_probability, inside_share.
    """
    found = fabrication.groupby([*GEOMETRY, "radius_error_um"], as_index=False)
    return found.agg(
        mode_change_probability=("mode_change_probability", "max"),
        moved_probability=("moved_probability", "max"),
        inside_share=("inside_share", "min"),
    )


def term_label(name: str) -> str:
    """Term of an analysis of variance as a label of matplotlib."""
    for column, symbol in (
        ("pillar_radius_um", "$P_r$"),
        ("gap_um", "$P_g$"),
        ("periodicity", "$N_p$"),
        ("deformation_index", "DI"),
        ("log_capillary_number", "ln Ca"),
        ("capillary_number", "Ca"),
        (":", " × "),
    ):
        name = name.replace(column, symbol)
    return name


@styled
def draw_effects(anova: pd.DataFrame) -> Figure:
    """Partial η² (bar) and ω² (diamond) of every term; filled where p < 0.05 by permutation.

    Without a permutation test the F test decides.
    """
    table = anova[anova["partial_eta_sq"].notna()]
    given = list(dict.fromkeys(table["model"]))
    models = sorted(given, key=lambda m: [*MODEL_TITLE, m].index(m))
    counts = [(table["model"] == model).sum() for model in models]
    figure, panels = multiples(len(models), 3, 9.2, 1.2 + 0.24 * max(counts), sharex=True)
    for panel, model in zip(panels, models, strict=True):
        part = table[table["model"] == model].iloc[::-1]
        p = part["p_permutation"].fillna(part["p_value"]).astype(float)
        clear = (p.fillna(1.0) < 0.05).to_numpy()
        places = np.arange(len(part))
        panel.barh(
            places,
            part["partial_eta_sq"],
            height=0.6,
            edgecolor="#0072B2",
            color=np.where(clear, "#0072B2", "#FFFFFF"),
        )
        panel.plot(part["partial_omega_sq"], places, "D", color="#E69F00", markersize=4)
        panel.set_yticks(places, [term_label(name) for name in part["term"]])
        panel.tick_params(axis="y", length=0)
        panel.grid(axis="y", visible=False)
        panel.set_ylim(len(part) - max(counts) - 0.6, len(part) - 0.4)
        panel.set_title(MODEL_TITLE.get(model, model))
        panel.set(xlabel="effect size", xlim=(-0.08, 1))
        panel.tick_params(axis="x", labelbottom=True)
    legend(
        figure,
        [
            key("#0072B2", "s", label=r"partial $\eta^2$, p < 0.05"),
            key("#0072B2", "s", filled=False, label=r"partial $\eta^2$, p ≥ 0.05"),
            key("#E69F00", "D", label=r"partial $\omega^2$"),
        ],
    )
    return figure


def _grid_map(panel, here: pd.DataFrame, values, text, colour_of) -> None:
    """Coloured cells over gap and N_p with a text in each."""
    gaps, periods = ordered(here["gap_um"]), ordered(here["periodicity"])
    for (_, row), value, label in zip(here.iterrows(), values, text, strict=True):
        corner = (gaps.index(row["gap_um"]) - 0.5, periods.index(row["periodicity"]) - 0.5)
        colour = "#F3F3F3" if pd.isna(value) else colour_of(value)
        panel.add_patch(Rectangle(corner, 1, 1, facecolor=colour, edgecolor="white"))
        dark = not pd.isna(value) and sum(colour[:3]) < 1.35
        panel.text(
            corner[0] + 0.5,
            corner[1] + 0.5,
            label,
            ha="center",
            va="center",
            color="white" if dark else "black",
            fontsize=8.5,
        )
    panel.set(
        xlim=(-0.5, len(gaps) - 0.5), ylim=(-0.5, len(periods) - 0.5), xlabel=AXIS_LABEL["gap_um"]
    )
    panel.set_xticks(range(len(gaps)), [f"{gap:g}" for gap in gaps])
    panel.set_yticks(range(len(periods)), [str(period) for period in periods])
    panel.grid(False)
    panel.tick_params(length=0)
    if panel.get_subplotspec().is_first_col():
        panel.set_ylabel(AXIS_LABEL["periodicity"])


@styled
def draw_robustness(robustness: pd.DataFrame) -> Figure:
    """Robustness score over gap and N_p, a panel per P_r; a frame marks the most robust 15 %."""
    radii = ordered(robustness["pillar_radius_um"])
    figure, panels = multiples(len(radii), 3, 9.2, 3.2)
    scores = robustness["robustness_score_deg2"].dropna()
    low, high = scores.min(), scores.max()
    wide = low > 0 and high / low > 30
    norm = (LogNorm if wide else Normalize)(low, high)
    colours = matplotlib.colormaps["cividis"]
    for panel, radius in zip(panels, radii, strict=True):
        here = robustness[robustness["pillar_radius_um"] == radius]
        angles = ["–" if pd.isna(a) else f"{a:z.1f}°" for a in here["mean_migration_angle_deg"]]
        _grid_map(panel, here, here["robustness_score_deg2"], angles, lambda v: colours(norm(v)))
        gaps, periods = ordered(here["gap_um"]), ordered(here["periodicity"])
        for _, row in here[here["robust"].astype(bool)].iterrows():
            corner = (gaps.index(row["gap_um"]) - 0.46, periods.index(row["periodicity"]) - 0.46)
            panel.add_patch(
                Rectangle(corner, 0.92, 0.92, fill=False, edgecolor="#D55E00", linewidth=2.4)
            )
        panel.set_title(f"$P_r$ = {radius:g} µm")
    scale = matplotlib.cm.ScalarMappable(norm, colours)
    figure.colorbar(scale, ax=panels, label="robustness score [deg²], low is robust", shrink=0.9)
    return figure


@styled
def draw_fabrication(fabrication: pd.DataFrame) -> Figure:
    """Largest probability over the stiffness sets that an error changes the mode.

    A panel per P_r and error; cells: P_g and N_p; an asterisk: less than half of the sizes lie
    where the surrogate interpolates.
    """
    table = worst_risk(fabrication)
    errors, radii = ordered(table["radius_error_um"]), ordered(table["pillar_radius_um"])
    figure, panels = multiples(len(errors) * len(radii), len(radii), 9.2, 2.5)
    norm, colours = Normalize(0, 1), matplotlib.colormaps["cividis"]
    for panel, (error, radius) in zip(panels, [(e, r) for e in errors for r in radii], strict=True):
        here = table[(table["radius_error_um"] == error) & (table["pillar_radius_um"] == radius)]
        text = [
            f"{100 * p:.0f} %" + ("*" if s < 0.5 else "")
            for p, s in zip(here["mode_change_probability"], here["inside_share"], strict=True)
        ]
        _grid_map(panel, here, here["mode_change_probability"], text, lambda v: colours(norm(v)))
        panel.set_title(f"$P_r$ = {radius:g} ± {error:g} µm")
    scale = matplotlib.cm.ScalarMappable(norm, colours)
    figure.colorbar(scale, ax=panels, label="probability of another mode", shrink=0.7)
    return figure
