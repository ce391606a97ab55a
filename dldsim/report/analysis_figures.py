"""Figures of calibration, statistics and surrogate; as in :mod:`dldsim.report.figures`.

The panels of the source paper's analysis from our data. Where the message differs from the paper's,
the caption in the report says how.
"""

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from dldsim.analysis.regressors import pooled
from dldsim.analysis.statistics import GEOMETRY
from dldsim.config.identifiers import FIXED_VELOCITY, GROUP_VELOCITY
from dldsim.report.figures import (
    GREY,
    MODE_COLOUR,
    MODE_MARKER,
    SET_MARKERS,
    dodged,
    dot,
    key,
    legend,
    measured,
    mode_keys,
    multiples,
    open_key,
    ordered,
    settled,
    shades_of,
    styled,
)

PAPER_DEFORMATION_INDEX = {"G1": 0.50, "G2": 0.60, "G5": 0.777, "G6": 0.781, "G7": 0.784}
"""Deformation index that the source paper gives for its stiffness sets 1 to 5."""
PAPER_CORRELATION = {"ks_uN_per_m": 0.77, "kal_uN_per_m": 0.73, "kb_pN_um": 0.33}
"""The source paper's correlations of the deformation index with the moduli."""
PAPER_VARIATION = {"G1": (0.15, 0.20), "G2": (0.15, 0.20), "G3": (0.15, 0.20), "G4": (0.05, 0.08),
                   "G5": (0.05, 0.08), "G6": (0.05, 0.08), "G7": (0.05, 0.08)}
"""The source paper's coefficients of variation over release positions."""
DESIGN_COLOUR = {GROUP_VELOCITY: "#0072B2", FIXED_VELOCITY: "#E69F00"}
DESIGN_MARKER = {GROUP_VELOCITY: "o", FIXED_VELOCITY: "s"}
DESIGN_NAME = {GROUP_VELOCITY: "velocity rises with stiffness",
               FIXED_VELOCITY: "one velocity for all"}
SPLIT_COLOUR = {"random": "#56B4E9", "geometry": "#D55E00", "stiffness": "#009E73"}
SPLIT_MARKER = {"random": "o", "geometry": "D", "stiffness": "^"}
SPLIT_NAME = {"random": "random split", "geometry": "split by geometry",
              "stiffness": "split by stiffness set"}
AXIS_LABEL = {"pillar_radius_um": "pillar radius $P_r$ [µm]", "gap_um": "gap $P_g$ [µm]",
              "periodicity": "periodicity $N_p$", "deformation_index": "deformation index DI"}
VARIABLE_LABEL = {
    "deformation_index": "DI", "ks_uN_per_m": "$k_s$", "kb_pN_um": "$k_b$",
    "kal_uN_per_m": r"$k_\alpha$", "velocity_mm_s": "velocity",
}
BANDS_DEG = (0.3, 1.0)
"""Errors marked in the parity figure."""
WORST_R2 = -0.2
BOX = {"showfliers": False, "widths": 0.6, "patch_artist": True,
       "medianprops": {"color": "black"}, "boxprops": {"facecolor": "#EDEFF2", "linewidth": 0.7},
       "whiskerprops": {"linewidth": 0.7}, "capprops": {"linewidth": 0.7}}


# ---------------------------------------------------------------------------------- computations


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
        rows.append({
            "model": model, "split": split, "n": len(group), "rmse_deg": score["rmse_deg"],
            "mae_deg": score["mae_deg"], "median_deg": score["median_absolute_error_deg"],
            "r2": score["r2"], "r2_low": min(known, default=None),
            "r2_high": max(known, default=None),
        })
    scores = pd.DataFrame(rows)
    by_geometry = scores[scores["split"] == "geometry"].set_index("model")["rmse_deg"]
    order = scores["model"].map(by_geometry).fillna(np.inf)
    return scores.assign(order=order).sort_values(["order", "model", "split"]).drop(columns="order")


def correlation_matrix(correlations: pd.DataFrame) -> pd.DataFrame:
    """Square symmetric matrix of Pearson r with unit diagonal from the pairs of one design."""
    names = list(dict.fromkeys([*correlations["variable_a"], *correlations["variable_b"]]))
    matrix = pd.DataFrame(np.nan, index=names, columns=names)
    for _, row in correlations.iterrows():
        matrix.loc[row["variable_a"], row["variable_b"]] = row["pearson_r"]
        matrix.loc[row["variable_b"], row["variable_a"]] = row["pearson_r"]
    for name in names:
        matrix.loc[name, name] = 1.0
    return matrix


def density(x: np.ndarray, y: np.ndarray, steps: int = 80):
    """Gaussian kernel density of points on a grid (x, y, density), or None for too few points."""
    from scipy.stats import gaussian_kde

    if len(x) < 5 or np.ptp(x) == 0 or np.ptp(y) == 0:
        return None
    pads = 0.15 * np.ptp(x), 0.15 * np.ptp(y)
    grid_x = np.linspace(x.min() - pads[0], x.max() + pads[0], steps)
    grid_y = np.linspace(y.min() - pads[1], y.max() + pads[1], steps)
    points = np.vstack([v.ravel() for v in np.meshgrid(grid_x, grid_y)])
    return grid_x, grid_y, gaussian_kde(np.vstack([x, y]))(points).reshape(steps, steps)


def worst_risk(fabrication: pd.DataFrame) -> pd.DataFrame:
    """Per geometry and error, the largest risk over the stiffness sets, and the least share inside.

    Columns: geometry, radius_error_um, mode_change_probability, moved_probability, inside_share.
    """
    found = fabrication.groupby([*GEOMETRY, "radius_error_um"], as_index=False)
    return found.agg(mode_change_probability=("mode_change_probability", "max"),
                     moved_probability=("moved_probability", "max"),
                     inside_share=("inside_share", "min"))


# -------------------------------------------------------------------------------------- calibration


@styled
def draw_calibration(runs: pd.DataFrame, calibration: pd.DataFrame) -> Figure:
    """DI per group and design over release positions, and the coefficient of variation."""
    figure = Figure(figsize=(9.2, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.5, 1))
    groups = ordered(calibration["group"])
    designs = [d for d in DESIGN_COLOUR if (calibration["design"] == d).any()]
    seen = runs[runs["deformation_index"].notna()]
    for index, design in enumerate(designs):
        colour, marker = DESIGN_COLOUR[design], DESIGN_MARKER[design]
        offset = dodged(index, len(designs), 0.36)
        for _, row in calibration[calibration["design"] == design].iterrows():
            place = groups.index(row["group"]) + offset
            part = seen[(seen["design"] == design) & (seen["group"] == row["group"])]
            spread = np.array([dodged(i, len(part), 0.16) for i in range(len(part))])
            left.plot(place + spread, part["deformation_index"], marker, alpha=0.7, color=colour,
                      markersize=3.5, markeredgewidth=0)
            reach = row["deformation_index_high"] - row["deformation_index"]
            left.errorbar(place + 0.13, row["deformation_index"], reach, fmt="_", color="black",
                          capsize=2.5, markersize=7, elinewidth=1)
            right.plot(place, 100 * row["coefficient_of_variation"], marker, color=colour)
    for place, group in enumerate(groups):
        if group in PAPER_DEFORMATION_INDEX:
            left.plot(place - 0.36, PAPER_DEFORMATION_INDEX[group], "D", color=GREY,
                      markerfacecolor="white", markersize=5)
        if group in PAPER_VARIATION:
            low, high = PAPER_VARIATION[group]
            right.add_patch(Rectangle((place - 0.4, 100 * low), 0.8, 100 * (high - low),
                                      color="#E8E4D8"))
    sets = calibration[calibration["stiffness_set"] != ""].set_index("group")["stiffness_set"]
    names = [f"{g}\nset {sets[g]}" if g in sets else g for g in groups]
    for panel in (left, right):
        panel.set_xticks(range(len(groups)), names if panel is left else groups)
        panel.set_xlim(-0.6, len(groups) - 0.4)
    left.set(ylabel="deformation index DI")
    right.set(ylabel="coefficient of variation [%]", ylim=(0, 22))
    handles = [key(DESIGN_COLOUR[d], DESIGN_MARKER[d], label=DESIGN_NAME[d]) for d in designs]
    handles += [key("black", "_", label="mean and 95 % interval"),
                key(GREY, "D", filled=False, label="source paper"),
                key("#E8E4D8", "s", label="source paper, range")]
    legend(figure, handles, ncols=5)
    return figure


@styled
def draw_correlations(correlations: pd.DataFrame) -> Figure:
    """Pearson matrix of each design; below DI's row the source paper's figures in brackets."""
    designs = [d for d in DESIGN_COLOUR if (correlations["design"] == d).any()]
    figure, panels = multiples(len(designs), 2, 9.2, 3.9)
    for panel, design in zip(panels, designs, strict=True):
        matrix = correlation_matrix(correlations[correlations["design"] == design])
        panel.imshow(np.nan_to_num(matrix.to_numpy()), cmap="PuOr_r", vmin=-1.35, vmax=1.35)
        for i, (name, row) in enumerate(matrix.iterrows()):
            for j, (other, value) in enumerate(row.items()):
                text = "–" if np.isnan(value) else f"{value:.2f}".replace("-", "−")
                seed = design == GROUP_VELOCITY and name == "deformation_index"
                if seed and other in PAPER_CORRELATION:
                    text += f"\n({PAPER_CORRELATION[other]:.2f})"
                panel.text(j, i, text, ha="center", va="center", fontsize=8,
                           color="white" if abs(value) > 0.75 else "black")
        labels = [VARIABLE_LABEL.get(name, name) for name in matrix]
        panel.set_xticks(range(len(labels)), labels)
        panel.set_yticks(range(len(labels)), labels)
        panel.grid(False)
        panel.spines[:].set_visible(False)
        panel.tick_params(length=0)
        panel.set_title(DESIGN_NAME[design])
    return figure


@styled
def draw_moduli(runs: pd.DataFrame) -> Figure:
    """DI of each constriction run against k_s, k_α, k_b and the velocity."""
    seen = runs[runs["deformation_index"].notna()]
    names = {
        "ks_uN_per_m": "$k_s$ [µN/m]", "kal_uN_per_m": r"$k_\alpha$ [µN/m]",
        "kb_pN_um": "$k_b$ [pN·µm]", "velocity_mm_s": "velocity [mm/s]",
    }
    figure, panels = multiples(4, 4, 9.2, 2.7, sharey=True)
    designs = [d for d in DESIGN_COLOUR if (seen["design"] == d).any()]
    for panel, (name, label) in zip(panels, names.items(), strict=True):
        for design in designs:
            part = seen[seen["design"] == design]
            panel.plot(part[name], part["deformation_index"], DESIGN_MARKER[design],
                       color=DESIGN_COLOUR[design], markersize=4, alpha=0.7, markeredgewidth=0)
        if name == "kb_pN_um" and (seen[name] > 0).all():
            panel.set_xscale("log")
            panel.xaxis.set_major_formatter("{x:g}")
            panel.xaxis.set_minor_formatter("")
        panel.set(xlabel=label)
    panels[0].set_ylabel("deformation index DI")
    legend(figure, [key(DESIGN_COLOUR[d], DESIGN_MARKER[d], label=DESIGN_NAME[d])
                    for d in designs])
    return figure


@styled
def draw_diameters(tracks: pd.DataFrame, runs: pd.DataFrame) -> Figure:
    """Diameters D (along the flow), H (across) and DI along the channel, coloured by group."""
    group_of = runs.set_index("run_id")["group"]
    design_of = runs.set_index("run_id")["design"]
    colours = shades_of(group_of)
    names = {
        "diameter_d_um": "$D$ along flow [µm]", "diameter_h_um": "$H$ across flow [µm]",
        "deformation_index": "DI",
    }
    figure = Figure(figsize=(9.2, 5.6), layout="constrained")
    panels = figure.subplots(3, 1, sharex=True)
    for panel, (name, label) in zip(panels, names.items(), strict=True):
        for run_id, track in tracks.groupby("run_id"):
            line = "--" if design_of[run_id] == FIXED_VELOCITY else "-"
            panel.plot(track["x_um"], track[name], line, color=colours[group_of[run_id]],
                       linewidth=0.9, alpha=0.8)
        panel.set_ylabel(label)
        panel.set_ylim(bottom=0)
    panels[-1].set_xlabel("centre of mass along the channel $x$ [µm]")
    handles = [key(c, line="-", label=g) for g, c in colours.items()]
    if (design_of == FIXED_VELOCITY).any():
        handles.append(key(GREY, line="--", label=DESIGN_NAME[FIXED_VELOCITY]))
    legend(figure, handles, ncols=8)
    return figure


# --------------------------------------------------------------------------------------- statistics


@styled
def draw_density(outcomes: pd.DataFrame) -> Figure:
    """Density of DI against θ_m; points by mode (colour and marker)."""
    points = measured(outcomes)
    points = points[points["deformation_index"].notna()]
    figure = Figure(figsize=(6.4, 3.9), layout="constrained")
    axes = figure.subplots()
    x, y = (points[n].to_numpy(float) for n in ("deformation_index", "migration_angle_deg"))
    found = density(x, y)
    if found is not None:
        axes.contourf(*found, levels=8, cmap="Greys", alpha=0.7)
    width = 0.012 * max(np.ptp(x), 1e-3)
    for mode, part in points.groupby("mode"):
        for filled, here in part.groupby(settled(part)):
            noise = np.random.default_rng(0).uniform(-width, width, len(here))
            dot(axes, here["deformation_index"] + noise, here["migration_angle_deg"],
                MODE_COLOUR[mode], MODE_MARKER[mode], filled, markersize=4)
    axes.set(xlabel=AXIS_LABEL["deformation_index"], ylabel=r"migration angle $\theta_m$ [°]")
    axes.grid(False)
    legend(figure, mode_keys(points) + open_key(points))
    return figure


@styled
def draw_boxes(outcomes: pd.DataFrame) -> Figure:
    """Box plots of θ_m by P_g, N_p and P_r over all else, with every run as a point."""
    points = measured(outcomes)
    figure = Figure(figsize=(9.2, 3.6), layout="constrained")
    panels = figure.subplots(1, 3, sharey=True)
    for panel, name in zip(panels, ("gap_um", "periodicity", "pillar_radius_um"), strict=True):
        levels = ordered(points[name])
        groups = [points.loc[points[name] == v, "migration_angle_deg"] for v in levels]
        panel.boxplot(groups, positions=range(len(levels)), **BOX)
        for i, level in enumerate(levels):
            for mode, part in points[points[name] == level].groupby("mode"):
                noise = np.random.default_rng(i).uniform(-0.22, 0.22, len(part))
                panel.plot(i + noise, part["migration_angle_deg"], MODE_MARKER[mode], markersize=3,
                           color=MODE_COLOUR[mode], alpha=0.75, markeredgewidth=0)
        panel.set_xticks(range(len(levels)), [f"{v:g}" for v in levels])
        panel.set_xlabel(AXIS_LABEL[name])
    panels[0].set_ylabel(r"migration angle $\theta_m$ [°]")
    legend(figure, mode_keys(points))
    return figure


@styled
def draw_factors(outcomes: pd.DataFrame) -> Figure:
    """All geometric factors at once: gap along x, P_r as colour, N_p as marker."""
    points = measured(outcomes)
    gaps, radii = ordered(points["gap_um"]), ordered(points["pillar_radius_um"])
    colours, periods = shades_of(radii), ordered(points["periodicity"])
    markers = {p: SET_MARKERS[i % len(SET_MARKERS)] for i, p in enumerate(periods)}
    figure = Figure(figsize=(9.2, 4.0), layout="constrained")
    axes = figure.subplots()
    for index, radius in enumerate(radii):
        for place, gap in enumerate(gaps):
            here = points[(points["pillar_radius_um"] == radius) & (points["gap_um"] == gap)]
            if here.empty:
                continue
            centre = place + dodged(index, len(radii), 0.72)
            box = BOX | {"widths": 0.66 / len(radii),
                         "boxprops": {"facecolor": colours[radius], "alpha": 0.35}}
            axes.boxplot([here["migration_angle_deg"]], positions=[centre], **box)
            for periodicity, part in here.groupby("periodicity"):
                dot(axes, [centre] * len(part), part["migration_angle_deg"], colours[radius],
                    markers[periodicity], False, markersize=4)
    axes.set_xticks(range(len(gaps)), [f"{g:g}" for g in gaps])
    axes.set(xlabel=AXIS_LABEL["gap_um"], ylabel=r"migration angle $\theta_m$ [°]")
    handles = [key(c, "s", label=f"$P_r$ = {r:g} µm") for r, c in colours.items()]
    handles += [key(GREY, m, filled=False, label=f"$N_p$ = {p}") for p, m in markers.items()]
    legend(figure, handles, ncols=8)
    return figure


MODEL_TITLE = {
    "hierarchical": "hierarchical model", "main_effects": "main effects alone",
    "seed_interactions": "interactions alone (source paper)",
}


def _term(name: str) -> str:
    for column, symbol in (("pillar_radius_um", "$P_r$"), ("gap_um", "$P_g$"),
                           ("periodicity", "$N_p$"), ("deformation_index", "DI"), (":", " × ")):
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
    figure = Figure(figsize=(9.2, 1.2 + 0.24 * max(counts)), layout="constrained")
    panels = figure.subplots(1, len(models), squeeze=False, sharex=True)[0]
    for panel, model in zip(panels, models, strict=True):
        part = table[table["model"] == model].iloc[::-1]
        p = part["p_permutation"].fillna(part["p_value"]).astype(float)
        clear = (p.fillna(1.0) < 0.05).to_numpy()
        places = np.arange(len(part))
        panel.barh(places, part["partial_eta_sq"], height=0.6, edgecolor="#0072B2",
                   color=np.where(clear, "#0072B2", "#FFFFFF"))
        panel.plot(part["partial_omega_sq"], places, "D", color="#E69F00", markersize=4)
        panel.set_yticks(places, [_term(name) for name in part["term"]])
        panel.tick_params(axis="y", length=0)
        panel.grid(axis="y", visible=False)
        panel.set_ylim(len(part) - max(counts) - 0.6, len(part) - 0.4)
        panel.set_title(MODEL_TITLE.get(model, model))
        panel.set(xlabel="effect size", xlim=(-0.08, 1))
    legend(figure, [key("#0072B2", "s", label=r"partial $\eta^2$, p < 0.05"),
                    key("#0072B2", "s", filled=False, label=r"partial $\eta^2$, p ≥ 0.05"),
                    key("#E69F00", "D", label=r"partial $\omega^2$")])
    return figure


@styled
def draw_sobol(sobol: pd.DataFrame) -> Figure:
    """First and total order Sobol indices of the surrogate with bootstrap intervals."""
    figure = Figure(figsize=(6.4, 1.2 + 0.42 * len(sobol)), layout="constrained")
    axes = figure.subplots()
    places = np.arange(len(sobol))[::-1]
    for offset, order, colour, label in ((0.17, "first", "#0072B2", "first order"),
                                         (-0.17, "total", "#E69F00", "total order")):
        value = sobol[f"{order}_order"]
        bars = np.abs(np.vstack([value - sobol[f"{order}_order_low"],
                                 sobol[f"{order}_order_high"] - value]))
        axes.barh(places + offset, value, height=0.3, color=colour, label=label, xerr=bars,
                  error_kw={"elinewidth": 0.9, "capsize": 2})
    axes.set_yticks(places, [_term(name) for name in sobol["factor"]])
    axes.grid(axis="y", visible=False)
    axes.set(xlabel=r"share of the variance of the predicted $\theta_m$", xlim=(min(
        0, sobol["first_order_low"].min()), None))
    axes.legend(loc="lower right")
    return figure


def _grid_map(panel, here: pd.DataFrame, values, text, colour_of) -> None:
    """Coloured cells over gap and N_p with a text in each."""
    gaps, periods = ordered(here["gap_um"]), ordered(here["periodicity"])
    for (_, row), value, label in zip(here.iterrows(), values, text, strict=True):
        corner = (gaps.index(row["gap_um"]) - 0.5, periods.index(row["periodicity"]) - 0.5)
        colour = "#F3F3F3" if pd.isna(value) else colour_of(value)
        panel.add_patch(Rectangle(corner, 1, 1, facecolor=colour, edgecolor="white"))
        dark = not pd.isna(value) and sum(colour[:3]) < 1.35
        panel.text(corner[0] + 0.5, corner[1] + 0.5, label, ha="center", va="center",
                   color="white" if dark else "black", fontsize=8.5)
    panel.set(xlim=(-0.5, len(gaps) - 0.5), ylim=(-0.5, len(periods) - 0.5),
              xlabel=AXIS_LABEL["gap_um"])
    panel.set_xticks(range(len(gaps)), [f"{gap:g}" for gap in gaps])
    panel.set_yticks(range(len(periods)), [str(period) for period in periods])
    panel.grid(False)
    panel.tick_params(length=0)
    if panel.get_subplotspec().is_first_col():
        panel.set_ylabel(AXIS_LABEL["periodicity"])


@styled
def draw_robustness(robustness: pd.DataFrame) -> Figure:
    """Stability score over gap and N_p, a panel per P_r; a frame marks the most stable 15 %."""
    radii = ordered(robustness["pillar_radius_um"])
    figure, panels = multiples(len(radii), 3, 9.2, 3.2)
    scores = robustness["stability_score_deg2"].dropna()
    low, high = scores.min(), scores.max()
    wide = low > 0 and high / low > 30
    norm = (LogNorm if wide else Normalize)(low, high)
    colours = matplotlib.colormaps["cividis"]
    for panel, radius in zip(panels, radii, strict=True):
        here = robustness[robustness["pillar_radius_um"] == radius]
        angles = ["–" if pd.isna(a) else f"{a:.1f}°" for a in here["mean_migration_angle_deg"]]
        _grid_map(panel, here, here["stability_score_deg2"], angles, lambda v: colours(norm(v)))
        gaps, periods = ordered(here["gap_um"]), ordered(here["periodicity"])
        for _, row in here[here["robust"].astype(bool)].iterrows():
            corner = (gaps.index(row["gap_um"]) - 0.46, periods.index(row["periodicity"]) - 0.46)
            panel.add_patch(Rectangle(corner, 0.92, 0.92, fill=False, edgecolor="#D55E00",
                                      linewidth=2.4))
        panel.set_title(f"$P_r$ = {radius:g} µm")
    scale = matplotlib.cm.ScalarMappable(norm, colours)
    figure.colorbar(scale, ax=panels, label="stability score [deg²], low is stable", shrink=0.9)
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
        text = [f"{100 * p:.0f} %" + ("*" if s < 0.5 else "") for p, s in zip(
            here["mode_change_probability"], here["inside_share"], strict=True)]
        _grid_map(panel, here, here["mode_change_probability"], text, lambda v: colours(norm(v)))
        panel.set_title(f"$P_r$ = {radius:g} ± {error:g} µm")
    scale = matplotlib.cm.ScalarMappable(norm, colours)
    figure.colorbar(scale, ax=panels, label="probability of another mode", shrink=0.7)
    return figure


# ---------------------------------------------------------------------------------------- surrogate


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
        left.plot(folds["rmse_deg"], folds["model"].map(models.index) + offset, "|", color=colour,
                  markersize=7, alpha=0.7)
        part = scores[scores["split"] == split]
        places = part["model"].map(models.index) + offset
        dot(left, part["rmse_deg"], places, colour, marker, True, markersize=5)
        r2 = part["r2"].astype(float)
        right.hlines(places, part["r2_low"].astype(float).clip(lower=WORST_R2),
                     part["r2_high"].astype(float).clip(lower=WORST_R2), color=colour)
        dot(right, r2.clip(lower=WORST_R2), places, colour, marker, True, markersize=5)
        for place, value in zip(places, r2, strict=True):
            if value < WORST_R2:
                right.annotate(f"−{-value:.2g}", (WORST_R2, place), xytext=(-6, 0), ha="right",
                               va="center", textcoords="offset points", fontsize=8, color=colour)
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
            dot(panel, dots["observed_deg"], dots["predicted_deg"], SPLIT_COLOUR[split],
                SPLIT_MARKER[split], filled, markersize=4)
        panel.set(xlim=limits, ylim=limits, aspect="equal", xlabel=r"simulated $\theta_m$ [°]")
    panels[0].set_ylabel(r"predicted $\theta_m$, held out [°]")
    handles = [key(GREY, "o", label="settled"),
               key(GREY, "o", filled=False, label="not settled"),
               key("black", line="-", label="exact; shades ± " + "°, ± ".join(
                   f"{b:g}" for b in BANDS_DEG) + "°")]
    legend(figure, handles)
    return figure


@styled
def draw_residuals(predictions: pd.DataFrame, outcomes: pd.DataFrame, model: str) -> Figure:
    """Residuals of one model on arrays held out: over the prediction, by N_p, and their spread."""
    part = predictions[(predictions["model"] == model) & (predictions["split"] == "geometry")]
    part = part.merge(outcomes[["outcome_id", "periodicity", "mode"]], on="outcome_id")
    residual = part["predicted_deg"] - part["observed_deg"]
    figure = Figure(figsize=(9.2, 3.4), layout="constrained")
    over, by, spread = figure.subplots(1, 3, sharey=True, width_ratios=(1.3, 1, 0.7))
    for (mode, filled), here in part.groupby(["mode", "decided"]):
        dot(over, here["predicted_deg"], residual[here.index], MODE_COLOUR[mode], MODE_MARKER[mode],
            filled, markersize=4)
    levels = ordered(part["periodicity"])
    by.boxplot([residual[part["periodicity"] == v] for v in levels], positions=range(len(levels)),
               **BOX)
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
        here = table[(table["x_name"] == x_name) & (table["y_name"] == y_name)]
        grid = here.pivot(index="y", columns="x", values="angle_deg")
        image = panel.pcolormesh(grid.columns, grid.index, np.ma.masked_invalid(grid.to_numpy()),
                                 cmap="viridis", vmin=low, vmax=high, shading="nearest")
        if grid.notna().all(axis=None) and min(grid.shape) > 1 and high > low:
            lines = panel.contour(grid.columns, grid.index, grid.to_numpy(), colors="white",
                                  linewidths=0.7)
            panel.clabel(lines, fontsize=7)
        panel.grid(False)
        panel.set(xlabel=AXIS_LABEL[x_name], ylabel=AXIS_LABEL[y_name])
    figure.colorbar(image, ax=panels, label=r"mean predicted $\theta_m$ [°]", shrink=0.9)
    return figure
