"""Figures of migration angles and modes over geometry and deformability."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from dldsim.laws import SCATTER_OF_DAVIS as SCATTER_OF_LAW
from dldsim.laws import critical_diameter, rest_volume
from dldsim.report.style import (
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
    set_markers,
    settled,
    shades_of,
    styled,
)

BOX = {
    "showfliers": False,
    "widths": 0.6,
    "patch_artist": True,
    "medianprops": {"color": "black"},
    "boxprops": {"facecolor": "#EDEFF2", "linewidth": 0.7},
    "whiskerprops": {"linewidth": 0.7},
    "capprops": {"linewidth": 0.7},
}
AXIS_LABEL = {
    "pillar_radius_um": "pillar radius $P_r$ [µm]",
    "gap_um": "gap $P_g$ [µm]",
    "periodicity": "periodicity $N_p$",
    "deformation_index": "deformation index DI",
    "capillary_number": "capillary number Ca",
    "vertical_confinement": "2R / channel height",
}


def critical_size_ratio(row_shift_fraction):
    """Empirical critical diameter over gap, D_c/G = 1.4 ε^0.48, of rigid spheres (Davis 2008)."""
    return critical_diameter(1, np.asarray(row_shift_fraction, dtype=float))


def volume_equivalent_diameter(shape: str, radius_um: float, aspect_ratio: float) -> float:
    """Diameter [µm] of the sphere that has the volume of the cell at rest."""
    return 2 * radius_um * rest_volume(shape, aspect_ratio) ** (1 / 3)


def mode_points(outcomes: pd.DataFrame, aspect_ratio: float) -> pd.DataFrame:
    """Size over gap, size over critical diameter and angle over bump angle of measured outcomes.

    Columns added: size_um, size_over_gap, size_over_critical, angle_ratio.
    """
    points = measured(outcomes).copy()
    points["size_um"] = [
        volume_equivalent_diameter(shape, radius, aspect_ratio)
        for shape, radius in zip(points["cell_shape"], points["cell_radius_um"], strict=True)
    ]
    points["size_over_gap"] = points["size_um"] / points["gap_um"]
    law = critical_size_ratio(points["row_shift_fraction"])
    points["size_over_critical"] = points["size_over_gap"] / law
    points["angle_ratio"] = points["migration_angle_deg"] / points["bump_angle_deg"]
    return points


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


def _step(values) -> float:
    """Smallest distance between distinct values, 1 where there is only one."""
    values = ordered(values)
    return float(np.diff(values).min()) if len(values) > 1 else 1.0


@styled
def draw_angles(outcomes: pd.DataFrame) -> Figure:
    """θ_m against gap, a panel per P_r (against N_p where each P_r has a single gap)."""
    points = measured(outcomes)
    radii = ordered(points["pillar_radius_um"])
    against_gap = points.groupby("pillar_radius_um")["gap_um"].nunique().max() > 1
    x_name = "gap_um" if against_gap else "periodicity"
    colours, markers = shades_of(points["periodicity"]), set_markers(points)
    dodge = 0.34 * _step(points[x_name])
    figure, panels = multiples(len(radii), 3, 9.2, 3.3, sharey=True)
    for panel, radius in zip(panels, radii, strict=True):
        here = points[points["pillar_radius_um"] == radius]
        for periodicity, of_period in here.groupby("periodicity"):
            colour = colours[periodicity]
            if against_gap:
                panel.axhline(of_period["bump_angle_deg"].iloc[0], color=colour, linestyle=":")
            else:
                x = of_period["periodicity"].iloc[0]
                panel.plot(
                    [x - 0.4 * _step(points[x_name]), x + 0.4 * _step(points[x_name])],
                    [of_period["bump_angle_deg"].iloc[0]] * 2,
                    ":",
                    color=colour,
                )
            for index, (name, marker) in enumerate(markers.items()):
                of_set = of_period[of_period["stiffness_set"] == name].sort_values(x_name)
                x = of_set[x_name] + dodged(index, len(markers), dodge)
                panel.plot(x, of_set["migration_angle_deg"], color=colour, linewidth=0.7, alpha=0.5)
                bars = of_set["sigma_num_deg"].fillna(0.0)
                panel.errorbar(
                    x,
                    of_set["migration_angle_deg"],
                    bars,
                    fmt="none",
                    ecolor=colour,
                    elinewidth=0.9,
                )
                for filled, part in of_set.groupby(settled(of_set)):
                    dot(
                        panel,
                        part[x_name] + dodged(index, len(markers), dodge),
                        part["migration_angle_deg"],
                        colour,
                        marker,
                        filled,
                    )
        gap = "" if against_gap else f", $P_g$ = {here['gap_um'].iloc[0]:g} µm"
        panel.set_title(f"$P_r$ = {radius:g} µm{gap}")
        panel.set_xlabel("gap $P_g$ [µm]" if against_gap else "periodicity $N_p$")
        panel.set_xticks(ordered(points[x_name]))
        if panel.get_subplotspec().is_first_col():
            panel.set_ylabel(r"migration angle $\theta_m$ [°]")
    handles = [key(c, "s", label=f"$N_p$ = {p}") for p, c in colours.items()]
    handles += [key(GREY, m, label=f"set {name}") for name, m in markers.items()]
    handles += [key(GREY, line=":", label="full bump angle")] + open_key(points)
    legend(figure, handles, ncols=8)
    return figure


@styled
def draw_deformability(outcomes: pd.DataFrame) -> Figure:
    """θ_m over the bump angle against the calibrated DI, a line per array, a panel per P_r."""
    points = measured(outcomes)
    points = points[points["deformation_index"].notna()]
    radii = ordered(points["pillar_radius_um"])
    colours = shades_of(points["periodicity"])
    gaps = ordered(points["gap_um"])
    styles = {gap: ["-", "--", "-.", ":"][i % 4] for i, gap in enumerate(gaps)}
    figure, panels = multiples(len(radii), 3, 9.2, 3.0, sharey=True, sharex=True)
    for panel, radius in zip(panels, radii, strict=True):
        here = points[points["pillar_radius_um"] == radius]
        for (gap, periodicity), array in here.groupby(["gap_um", "periodicity"]):
            array = array.sort_values("deformation_index")
            ratio = array["migration_angle_deg"] / array["bump_angle_deg"]
            panel.plot(
                array["deformation_index"],
                ratio,
                linestyle=styles[gap],
                color=colours[periodicity],
                linewidth=1,
            )
            for filled in (True, False):
                part = settled(array) == filled
                dot(
                    panel,
                    array["deformation_index"][part],
                    ratio[part],
                    colours[periodicity],
                    "o",
                    filled,
                    markersize=4,
                )
        panel.axhline(1, color="black", linestyle=":", linewidth=1)
        panel.set_title(f"$P_r$ = {radius:g} µm")
        panel.set_xlabel("deformation index DI")
        if panel.get_subplotspec().is_first_col():
            panel.set_ylabel(r"$\theta_m$ / bump angle")
    handles = [key(c, "o", label=f"$N_p$ = {p}") for p, c in colours.items()]
    handles += [key(GREY, line=s, label=f"$P_g$ = {g:g} µm") for g, s in styles.items()]
    legend(figure, handles + open_key(points), ncols=7)
    return figure


@styled
def draw_first_period(outcomes: pd.DataFrame) -> Figure:
    """First-period angle (the source paper's protocol) against the settled one."""
    points = measured(outcomes)
    points = points[points["source_angle_deg"].notna()]
    figure = Figure(figsize=(9.2, 3.9), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.15))
    both = points[["migration_angle_deg", "source_angle_deg"]]
    pad = 0.06 * (both.max().max() - min(0.0, both.min().min())) + 0.1
    low, high = min(0.0, both.min().min()) - pad, both.max().max() + pad
    left.plot([low, high], [low, high], ":", color="black", linewidth=1)
    for (mode, filled), part in points.groupby(["mode", settled(points)]):
        dot(
            left,
            part["migration_angle_deg"],
            part["source_angle_deg"],
            MODE_COLOUR[mode],
            MODE_MARKER[mode],
            filled,
        )
    left.set(
        xlabel=r"settled $\theta_m$ [°]",
        ylabel="angle of first period [°]",
        xlim=(low, high),
        ylim=(low, high),
        aspect="equal",
    )
    bumps = points[(points["mode"] == "bump") & (points["migration_angle_deg"] > 0)]
    periodicities = ordered(bumps["periodicity"])
    gaps = shades_of(bumps["gap_um"], "cividis")
    for (gap, filled), part in bumps.groupby(["gap_um", settled(bumps)]):
        offset = dodged(list(gaps).index(gap), len(gaps), 0.5)
        places = part["periodicity"].map(periodicities.index) + offset
        dot(
            right,
            places,
            part["source_angle_deg"] / part["migration_angle_deg"],
            gaps[gap],
            "o",
            filled,
        )
    right.axhline(1, color="black", linestyle=":", linewidth=1)
    right.set_xticks(range(len(periodicities)), [str(p) for p in periodicities])
    right.set(xlabel="periodicity $N_p$", ylabel="first period / settled", ylim=(0, None))
    right.set_title("bumping outcomes")
    right.legend(
        handles=[key(c, "o", label=f"$P_g$ = {g:g} µm") for g, c in gaps.items()],
        loc="lower right",
        ncols=2,
    )
    legend(figure, mode_keys(points) + open_key(points))
    return figure


@styled
def draw_mode_map(points: pd.DataFrame) -> Figure:
    """Modes over row shift and size against D_c = 1.4 G ε^0.48, and the angle across that line.

    points: table from mode_points.
    """
    figure = Figure(figsize=(9.2, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    periodicities = ordered(points["periodicity"])
    width = 0.6 * _step(periodicities)
    span = np.linspace(max(periodicities[0] - width, 1.5), periodicities[-1] + width, 200)
    law = critical_size_ratio(1 / span)
    left.fill_between(span, (1 - SCATTER_OF_LAW) * law, (1 + SCATTER_OF_LAW) * law, color="#E8E4D8")
    left.plot(span, law, color="black", linewidth=1.2)
    columns = points[["pillar_radius_um", "stiffness_set"]].apply(tuple, axis=1)
    order = {key: i for i, key in enumerate(ordered(columns))}
    for (mode, filled), part in points.groupby(["mode", settled(points)]):
        places = [dodged(order[key], len(order), width) for key in columns[part.index]]
        dot(
            left,
            part["periodicity"] + places,
            part["size_over_gap"],
            MODE_COLOUR[mode],
            MODE_MARKER[mode],
            filled,
            markersize=4.5,
        )
        dot(
            right,
            part["size_over_critical"],
            part["angle_ratio"],
            MODE_COLOUR[mode],
            MODE_MARKER[mode],
            filled,
            markersize=4.5,
        )
    left.set_xticks(periodicities, [f"{p}\n{1 / p:.3g}" for p in periodicities])
    left.set(
        xlabel=r"periodicity $N_p$, and row shift fraction $\varepsilon = 1/N_p$",
        ylabel="cell size / gap",
        ylim=(0, 1.12 * max(points["size_over_gap"].max(), law.max())),
    )
    right.axvspan(1 - SCATTER_OF_LAW, 1 + SCATTER_OF_LAW, color="#E8E4D8")
    right.axvline(1, color="black", linewidth=1.2)
    right.axhline(1, color="black", linestyle=":", linewidth=1)
    right.axhline(0, color="black", linestyle=":", linewidth=1)
    right.set(xlabel="cell size / $D_c$", ylabel=r"$\theta_m$ / bump angle")
    handles = mode_keys(points) + open_key(points)
    handles.append(key("black", line="-", label=r"$D_c = 1.4\,G\,\varepsilon^{0.48}$ (± 10 %)"))
    legend(figure, handles)
    return figure


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
            dot(
                axes,
                here["deformation_index"] + noise,
                here["migration_angle_deg"],
                MODE_COLOUR[mode],
                MODE_MARKER[mode],
                filled,
                markersize=4,
            )
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
                panel.plot(
                    i + noise,
                    part["migration_angle_deg"],
                    MODE_MARKER[mode],
                    markersize=3,
                    color=MODE_COLOUR[mode],
                    alpha=0.75,
                    markeredgewidth=0,
                )
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
            box = BOX | {
                "widths": 0.66 / len(radii),
                "boxprops": {"facecolor": colours[radius], "alpha": 0.35},
            }
            axes.boxplot([here["migration_angle_deg"]], positions=[centre], **box)
            for periodicity, part in here.groupby("periodicity"):
                dot(
                    axes,
                    [centre] * len(part),
                    part["migration_angle_deg"],
                    colours[radius],
                    markers[periodicity],
                    False,
                    markersize=4,
                )
    axes.set_xticks(range(len(gaps)), [f"{g:g}" for g in gaps])
    axes.set(xlabel=AXIS_LABEL["gap_um"], ylabel=r"migration angle $\theta_m$ [°]")
    handles = [key(c, "s", label=f"$P_r$ = {r:g} µm") for r, c in colours.items()]
    handles += [key(GREY, m, filled=False, label=f"$N_p$ = {p}") for p, m in markers.items()]
    legend(figure, handles, ncols=8)
    return figure
