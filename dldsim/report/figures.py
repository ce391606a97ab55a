"""The report's figures: numbers are computed apart from drawing, so that tests can check them.

Every ``draw_…`` takes tables (pandas) or computed data and returns a matplotlib Figure; nothing is
written here. Colours follow Okabe & Ito (bump blue, zigzag vermilion, mixed green) and viridis or
cividis for ordered quantities, all safe for colour-blind readers; modes and stiffness sets are also
told apart by marker or line. Open markers and dashed lines: the motion had not settled when the
rows were spent.
"""

import functools
import io
from dataclasses import dataclass

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from dldsim.laws import SCATTER_OF_DAVIS, critical_diameter, pillar_centres, rest_volume
from dldsim.vocabulary import BROKEN, DECIDED, GEOMETRY, MODES, SETTLED

MODE_COLOUR = {"bump": "#0072B2", "mixed": "#009E73", "zigzag": "#D55E00", "none": "#7F7F7F"}
MODE_MARKER = {"bump": "o", "mixed": "D", "zigzag": "^", "none": "x"}
SET_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">")
GREY = "#5F6368"
PILLAR = "#C9CDD2"
LONGEST_VIEW = 14
"""Rows that a trajectory panel shows at most, unless one period is longer."""

STYLE = {
    "font.size": 9,
    "font.family": "DejaVu Sans",
    "axes.titlesize": 9,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9,
    "axes.edgecolor": "#444444",
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E4E6E9",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.3,
    "lines.markersize": 5,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "svg.fonttype": "path",
    "svg.hashsalt": "dldsim",
    "figure.dpi": 100,
}


def styled(draw):
    """Apply the house style while a figure is drawn."""

    @functools.wraps(draw)
    def wrapper(*args, **kwargs):
        with matplotlib.rc_context(STYLE):
            return draw(*args, **kwargs)

    return wrapper


# ---------------------------------------------------------------------------------- computations


def mode_name(mode: str) -> str:
    """Migration mode as readers see it."""
    return "no mode" if mode == "none" else mode


def settled(table: pd.DataFrame) -> pd.Series:
    """True where the motion of a run, or of all releases of an outcome, has settled."""
    return table["status"].isin((*SETTLED, *DECIDED))


def measured(table: pd.DataFrame) -> pd.DataFrame:
    """Runs or outcomes that have a migration angle, settled or not."""
    return table[table["migration_angle_deg"].notna()]


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


def row_map(run) -> tuple[np.ndarray, np.ndarray]:
    """Position before each row and its lateral step, (rows,) each.

    Positions midway between rows are heights over the gap: 0 to 1 in the gap, −2 P_r/P_g to 0
    behind its lower pillar. Steps are in row shifts.
    """
    total = cumulated_row_shifts(run)
    rows = np.arange(len(total) - 1)
    row_shift = run["pitch_um"] * run["row_shift_fraction"]
    height = run["release_gap_fraction"] + (total[:-1] - rows) * row_shift / run["gap_um"]
    pillar = 2 * run["pillar_radius_um"] / run["gap_um"]
    return (height + pillar) % (1 + pillar) - pillar, np.diff(total)


def cumulated_row_shifts(run) -> np.ndarray:
    """Lateral position after each row in units of the row shift ελ, starting at 0, (rows + 1,).

    A bumping cell gains 1 per row; a zigzagging one returns to 0 after each N_p rows.
    """
    steps = np.asarray(run["lateral_steps_um"], dtype=float)
    return np.concatenate([[0.0], np.cumsum(steps)]) / (run["pitch_um"] * run["row_shift_fraction"])


def gap_heights(trajectory: pd.DataFrame, run) -> tuple[np.ndarray, np.ndarray]:
    """Where the centre of mass crosses each row: row number, and height in the gap.

    The height is 0 at the surface of the pillar below and 1 at that of the pillar above.
    """
    x = np.maximum.accumulate(trajectory["x_um"].to_numpy(float))
    pitch, radius = run["pitch_um"], run["pillar_radius_um"]
    rows = np.arange(np.ceil(x[0] / pitch), np.floor(x[-1] / pitch) + 1)
    y = np.interp(rows * pitch, x, trajectory["y_um"].to_numpy(float))
    above_pillar = np.mod(y - rows * pitch * run["row_shift_fraction"], pitch)
    return rows, (above_pillar - radius) / run["gap_um"]


def pillars_in(run, xlim: tuple[float, float], ylim: tuple[float, float]) -> np.ndarray:
    """Centres [µm], shape (n, 2), of the pillars that show in the window."""
    pitch, radius = run["pitch_um"], run["pillar_radius_um"]
    centres = []
    for i in range(
        int(np.ceil((xlim[0] - radius) / pitch)), int(np.floor((xlim[1] + radius) / pitch)) + 1
    ):
        shift = pitch * run["row_shift_fraction"]
        centres += pillar_centres(pitch, shift, i, ylim[0] - radius, ylim[1] + radius)
    return np.array(centres, dtype=float).reshape(-1, 2)


def pick_trajectories(runs: pd.DataFrame) -> list[tuple[str, list[str]]]:
    """Runs worth drawing: one typical run per mode, and the geometry that parts the sets most.

    Returns (heading, run ids) per panel. Of each outcome its first release is drawn. Typical:
    settled before not settled, then the angle ratio nearest to the median of its mode, then the run
    id. Sets are said to part only where the motion settled in one mode from every place of release.
    """
    points = measured(runs.drop_duplicates("outcome_id")).copy()
    points["angle_ratio"] = points["migration_angle_deg"] / points["bump_angle_deg"]
    points["open"] = ~settled(points)
    panels = []
    for mode in ("bump", "zigzag", "mixed"):
        of_mode = points[points["mode"] == mode]
        if len(of_mode):
            away = (of_mode["angle_ratio"] - of_mode["angle_ratio"].median()).abs()
            best = of_mode.assign(away=away).sort_values(["open", "away", "run_id"]).iloc[0]
            panels.append((f"{mode} mode", [best["run_id"]]))
    alike = runs.assign(settled=settled(runs)).groupby("outcome_id").agg(
        settled=("settled", "all"), modes=("mode", "nunique"))
    sure = alike.index[alike["settled"] & (alike["modes"] == 1)]
    widest, pair = 0.0, None
    decided = points[points["outcome_id"].isin(sure)]
    for _, group in decided.groupby(GEOMETRY):
        angle = group["migration_angle_deg"]
        if angle.max() - angle.min() > widest and group["mode"].nunique() > 1:
            widest = angle.max() - angle.min()
            pair = [group.loc[angle.idxmax(), "run_id"], group.loc[angle.idxmin(), "run_id"]]
    if pair:
        panels.append((f"one array, two stiffness sets, {widest:.2g}° apart", pair))
    return panels


@dataclass(frozen=True)
class TrajectoryPanel:
    """What one trajectory panel shows; lengths in µm, laboratory frame."""

    title: str
    paths: list[dict]
    pillars: np.ndarray
    pillar_radius: float
    cell_radius: float
    xlim: tuple[float, float]
    ylim: tuple[float, float]


def trajectory_panel(
    heading: str, run_ids: list[str], runs: pd.DataFrame, trajectories: pd.DataFrame
) -> TrajectoryPanel:
    """Window of at least N_p rows (where the runs have them) up to the end of the shortest run."""
    rows = [runs[runs["run_id"] == run_id].iloc[0] for run_id in run_ids]
    first = rows[0]
    pitch = first["pitch_um"]
    view = pitch * max(LONGEST_VIEW, first["periodicity"] + 1)
    tracks = [trajectories[trajectories["run_id"] == run_id] for run_id in run_ids]
    end = min(track["x_um"].max() for track in tracks)
    start = max(min(track["x_um"].min() for track in tracks), end - view)
    paths = []
    for run, track in zip(rows, tracks, strict=True):
        seen = track[track["x_um"].between(start, end)]
        angle = f"{run['migration_angle_deg']:.2f}°"
        mark = "" if run["status"] in SETTLED else ", not settled"
        paths.append(
            {
                "label": f"stiffness set {run['stiffness_set']}: {run['mode']}, {angle}{mark}",
                "mode": run["mode"],
                "x": seen["x_um"].to_numpy(float),
                "y": seen["y_um"].to_numpy(float),
                "deformation_index": seen["deformation_index"].to_numpy(float),
            }
        )
    y = np.concatenate([path["y"] for path in paths])
    xlim = (start - pitch / 2, end + pitch / 2)
    title = (
        f"{heading}: $P_r$ = {first['pillar_radius_um']:g} µm, $P_g$ = {first['gap_um']:g} µm, "
        f"$N_p$ = {first['periodicity']}"
    )
    ylim = (y.min() - 0.75 * pitch, y.max() + 0.75 * pitch)
    return TrajectoryPanel(
        title, paths, pillars_in(first, xlim, ylim), first["pillar_radius_um"],
        first["cell_radius_um"], xlim, ylim,
    )


# ------------------------------------------------------------------------------------- small parts


def ordered(values) -> list:
    return sorted(pd.unique(pd.Series(values)))


def shades_of(values, name: str = "viridis", top: float = 0.88) -> dict:
    """One colour per distinct value, dark to light."""
    values = ordered(values)
    colours = matplotlib.colormaps[name](np.linspace(0.0, top, max(len(values), 2)))
    return {value: matplotlib.colors.to_hex(c) for value, c in zip(values, colours, strict=False)}


def set_markers(runs: pd.DataFrame) -> dict:
    sets = ordered(runs["stiffness_set"])
    return {name: SET_MARKERS[i % len(SET_MARKERS)] for i, name in enumerate(sets)}


def multiples(count: int, columns: int, width: float, height: float, **options):
    """Figure and flat list of count axes in a grid; width of all, height of one row [inch]."""
    columns = min(columns, count)
    lines = -(-count // columns)
    figure = Figure(figsize=(width, height * lines), layout="constrained")
    axes = list(figure.subplots(lines, columns, squeeze=False, **options).flat)
    for spare in axes[count:]:
        spare.remove()
    return figure, axes[:count]


def dot(axes, x, y, colour, marker, filled, **options):
    axes.plot(
        x, y, marker, color=colour, markerfacecolor=colour if filled else "white",
        markeredgewidth=1.1, **options,
    )


def key(colour=GREY, marker="none", line="none", filled=True, label=""):
    return Line2D(
        [], [], color=colour, marker=marker, linestyle=line, label=label, markeredgewidth=1.1,
        markerfacecolor=colour if filled else "white",
    )


def legend(figure, handles, **options):
    figure.legend(
        handles=handles, loc="outside lower center", ncols=options.pop("ncols", 5),
        columnspacing=1.4, handletextpad=0.5, **options,
    )


def mode_keys(runs: pd.DataFrame) -> list:
    present = [mode for mode in MODES if (runs["mode"] == mode).any()]
    return [key(MODE_COLOUR[m], MODE_MARKER[m], label=mode_name(m)) for m in present]


def open_key(runs: pd.DataFrame) -> list:
    open_ = [key(GREY, "o", filled=False, label="not settled")]
    return open_ if (~settled(runs)).any() else []


def dodged(index: int, count: int, width: float) -> float:
    """Offset that keeps count markers at one abscissa apart within ± width/2."""
    return 0.0 if count < 2 else width * (index / (count - 1) - 0.5)


def _step(values) -> float:
    """Smallest distance between distinct values, 1 where there is only one."""
    values = ordered(values)
    return float(np.diff(values).min()) if len(values) > 1 else 1.0


# --------------------------------------------------------------------------------------- cell runs


@styled
def draw_trajectories(panels: list[TrajectoryPanel]) -> Figure:
    """Paths over pillars with the true aspect ratio, and the deformation index below each."""
    width, left, right, strip = 9.2, 0.68, 0.12, 0.55
    inner = width - left - right
    heights = [
        inner * (p.ylim[1] - p.ylim[0]) / (p.xlim[1] - p.xlim[0]) for p in panels
    ]
    above, between, below = 0.5, 0.12, 0.6
    total = sum(heights) + len(panels) * (above + between + strip + below)
    figure = Figure(figsize=(width, total))
    top = total
    for panel, height in zip(panels, heights, strict=True):
        top -= above + height
        axes = figure.add_axes((left / width, top / total, inner / width, height / total))
        top -= between + strip
        below_axes = figure.add_axes((left / width, top / total, inner / width, strip / total))
        top -= below
        axes.add_collection(
            PatchCollection(
                [Circle(centre, panel.pillar_radius) for centre in panel.pillars],
                facecolor=PILLAR, edgecolor="#8A9099", linewidth=0.5,
            )
        )
        for path in panel.paths:
            colour = MODE_COLOUR[path["mode"]]
            axes.plot(path["x"], path["y"], color=colour, linewidth=1.8, label=path["label"])
            axes.plot(path["x"][-1], path["y"][-1], ">", color=colour, markersize=6)
            below_axes.plot(path["x"], path["deformation_index"], color=colour, linewidth=1.2)
        start = panel.paths[0]
        axes.add_patch(
            Circle((start["x"][0], start["y"][0]), panel.cell_radius, fill=False,
                   edgecolor="black", linestyle=(0, (2, 1.5)), linewidth=0.9)
        )
        axes.set(xlim=panel.xlim, ylim=panel.ylim, ylabel="$y$ [µm]")
        axes.set_title(panel.title, pad=19)
        axes.tick_params(labelbottom=False)
        axes.grid(False)
        for spine in axes.spines.values():
            spine.set_visible(True)
        axes.legend(
            loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=len(panel.paths), borderpad=0.1,
            borderaxespad=0.2, handlelength=1.6,
        )
        below_axes.set(xlim=panel.xlim, xlabel="$x$ [µm]", ylabel="DI")
        highest = max(path["deformation_index"].max() for path in panel.paths)
        below_axes.set_ylim(0, 1.15 * max(highest, 0.05))
    return figure


@styled
def draw_all_runs(runs: pd.DataFrame, trajectories: pd.DataFrame | None) -> Figure:
    """Every run at once, a column per N_p: lateral steps summed up, and height in the gap."""
    runs = runs[runs["rows_completed"] > 0]
    periodicities, longest = ordered(runs["periodicity"]), runs["rows_completed"].max()
    tracks = {} if trajectories is None else dict(list(trajectories.groupby("run_id")))
    lines = 2 if tracks else 1
    figure = Figure(figsize=(9.2, 2.9 * lines), layout="constrained")
    grid = figure.subplots(lines, len(periodicities), squeeze=False, sharey="row", sharex=True)
    for column, periodicity in enumerate(periodicities):
        upper = grid[0, column]
        upper.set_title(f"$N_p$ = {periodicity}")
        upper.plot([0, longest], [0, longest], ":", color="black", linewidth=1)
        for _, run in runs[runs["periodicity"] == periodicity].iterrows():
            style = {
                "color": MODE_COLOUR[run["mode"]], "alpha": 0.75, "linewidth": 1,
                "linestyle": "-" if run["status"] in SETTLED else (0, (4, 1.5)),
            }
            total = cumulated_row_shifts(run)
            upper.plot(np.arange(len(total)), total, **style)
            if run["status"] in BROKEN:
                upper.plot(len(total) - 1, total[-1], "x", color="black")
            if run["run_id"] in tracks:
                rows, height = gap_heights(tracks[run["run_id"]], run)
                wrap = 0.5 * run["pitch_um"] / run["gap_um"]
                jumps = 1 + np.flatnonzero(np.abs(np.diff(height)) > wrap)
                rows, height = (np.insert(part, jumps, np.nan) for part in (rows, height))
                grid[1, column].plot(rows, height, **style)
        upper.set_xlim(0, longest)
        if tracks:
            grid[1, column].axhspan(-0.12, 0, color=PILLAR, linewidth=0)
            grid[1, column].axhspan(1, 1.12, color=PILLAR, linewidth=0)
            grid[1, column].set_ylim(-0.12, 1.12)
        grid[-1, column].set_xlabel("rows passed")
    grid[0, 0].set_ylabel(r"sum of lateral steps / $\varepsilon\lambda$")
    if tracks:
        grid[1, 0].set_ylabel("height in gap\n(0 lower, 1 upper pillar)")
    handles = [
        key(MODE_COLOUR[m], line="-", label=mode_name(m))
        for m in MODES if (runs["mode"] == m).any()
    ]
    handles.append(key("black", line=":", label="full bump"))
    if (~settled(runs)).any():
        handles.append(key(GREY, line="--", label="not settled"))
    if runs["status"].isin(BROKEN).any():
        handles.append(key("black", "x", label="run broke off here"))
    legend(figure, handles, ncols=7)
    return figure


@styled
def draw_row_maps(runs: pd.DataFrame) -> Figure:
    """Lateral step of each row against the position in the gap, a panel per geometry.

    Nearly a curve per run. Where it reaches one row shift there is a bump lane; how far it stays
    below is the distance from the transition.
    """
    panels = list(runs.groupby(GEOMETRY))
    columns = min(3, len(panels))
    lines = -(-len(panels) // columns)
    figure = Figure(figsize=(3.3 * columns, 2.7 * lines), layout="constrained")
    grid = figure.subplots(lines, columns, squeeze=False, sharey=True)
    for axes, ((radius, gap, periodicity), group) in zip(grid.flat, panels, strict=False):
        colours = shades_of(group["run_id"])
        axes.axvspan(-2 * radius / gap, 0, color=PILLAR, linewidth=0)
        axes.axhline(1, linestyle=":", color="black", linewidth=1)
        for _, run in group.iterrows():
            height, steps = row_map(run)
            axes.plot(height, steps, ".", color=colours[run["run_id"]], markersize=4,
                      label=f"set {run['stiffness_set']}, {run['release_gap_fraction']:g}")
        axes.set(xlim=(-2 * radius / gap, 1), xlabel="height in gap (grey: pillar)")
        axes.set_title(f"$P_r$ = {radius:g}, $P_g$ = {gap:g} µm, $N_p$ = {periodicity}")
        axes.legend(title="stiffness, release", loc="lower right", fontsize=7, title_fontsize=7)
    for axes in grid.flat[len(panels):]:
        axes.set_visible(False)
    for axes in grid[:, 0]:
        axes.set_ylabel(r"lateral step / $\varepsilon\lambda$")
    return figure


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
                panel.plot([x - 0.4 * _step(points[x_name]), x + 0.4 * _step(points[x_name])],
                           [of_period["bump_angle_deg"].iloc[0]] * 2, ":", color=colour)
            for index, (name, marker) in enumerate(markers.items()):
                of_set = of_period[of_period["stiffness_set"] == name].sort_values(x_name)
                x = of_set[x_name] + dodged(index, len(markers), dodge)
                panel.plot(x, of_set["migration_angle_deg"], color=colour, linewidth=0.7, alpha=0.5)
                bars = of_set["sigma_num_deg"].fillna(0.0)
                panel.errorbar(x, of_set["migration_angle_deg"], bars, fmt="none", ecolor=colour,
                               elinewidth=0.9)
                for filled, part in of_set.groupby(settled(of_set)):
                    dot(panel, part[x_name] + dodged(index, len(markers), dodge),
                         part["migration_angle_deg"], colour, marker, filled)
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
            panel.plot(array["deformation_index"], ratio, linestyle=styles[gap],
                       color=colours[periodicity], linewidth=1)
            for filled in (True, False):
                part = settled(array) == filled
                dot(panel, array["deformation_index"][part], ratio[part], colours[periodicity],
                     "o", filled, markersize=4)
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
        dot(left, part["migration_angle_deg"], part["source_angle_deg"],
             MODE_COLOUR[mode], MODE_MARKER[mode], filled)
    left.set(xlabel=r"settled $\theta_m$ [°]", ylabel="angle of first period [°]",
             xlim=(low, high), ylim=(low, high), aspect="equal")
    bumps = points[(points["mode"] == "bump") & (points["migration_angle_deg"] > 0)]
    periodicities = ordered(bumps["periodicity"])
    gaps = shades_of(bumps["gap_um"], "cividis")
    for (gap, filled), part in bumps.groupby(["gap_um", settled(bumps)]):
        offset = dodged(list(gaps).index(gap), len(gaps), 0.5)
        places = part["periodicity"].map(periodicities.index) + offset
        dot(right, places, part["source_angle_deg"] / part["migration_angle_deg"],
             gaps[gap], "o", filled)
    right.axhline(1, color="black", linestyle=":", linewidth=1)
    right.set_xticks(range(len(periodicities)), [str(p) for p in periodicities])
    right.set(xlabel="periodicity $N_p$", ylabel="first period / settled", ylim=(0, None))
    right.set_title("bumping outcomes")
    right.legend(handles=[key(c, "o", label=f"$P_g$ = {g:g} µm") for g, c in gaps.items()],
                 loc="lower right", ncols=2)
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
    left.fill_between(
        span, (1 - SCATTER_OF_DAVIS) * law, (1 + SCATTER_OF_DAVIS) * law, color="#E8E4D8"
    )
    left.plot(span, law, color="black", linewidth=1.2)
    columns = points[["pillar_radius_um", "stiffness_set"]].apply(tuple, axis=1)
    order = {key: i for i, key in enumerate(ordered(columns))}
    for (mode, filled), part in points.groupby(["mode", settled(points)]):
        places = [dodged(order[key], len(order), width) for key in columns[part.index]]
        dot(left, part["periodicity"] + places, part["size_over_gap"], MODE_COLOUR[mode],
             MODE_MARKER[mode], filled, markersize=4.5)
        dot(right, part["size_over_critical"], part["angle_ratio"], MODE_COLOUR[mode],
             MODE_MARKER[mode], filled, markersize=4.5)
    left.set_xticks(periodicities, [f"{p}\n{1 / p:.3g}" for p in periodicities])
    left.set(xlabel=r"periodicity $N_p$, and row shift fraction $\varepsilon = 1/N_p$",
             ylabel="cell size / gap",
             ylim=(0, 1.12 * max(points["size_over_gap"].max(), law.max())))
    right.axvspan(1 - SCATTER_OF_DAVIS, 1 + SCATTER_OF_DAVIS, color="#E8E4D8")
    right.axvline(1, color="black", linewidth=1.2)
    right.axhline(1, color="black", linestyle=":", linewidth=1)
    right.axhline(0, color="black", linestyle=":", linewidth=1)
    right.set(xlabel="cell size / $D_c$", ylabel=r"$\theta_m$ / bump angle")
    handles = mode_keys(points) + open_key(points)
    handles.append(key("black", line="-", label=r"$D_c = 1.4\,G\,\varepsilon^{0.48}$ (± 10 %)"))
    legend(figure, handles)
    return figure


# ------------------------------------------------------------------------------------------ designs


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
        panel.hlines(places, part["separation_tolerance_min_deg"],
                     part["separation_tolerance_max_deg"], color="#0072B2", linewidth=2.2)
        inside = part["inside_training_domain"].astype(bool).to_numpy()
        for filled in (True, False):
            dot(panel, part["separation_deg"][inside == filled], places[inside == filled],
                 "#0072B2", "o", filled, markersize=6)
        panel.set_yticks(places, [
            f"{row['rank']}:  $P_r$ {row['pillar_radius_um']:.3g}, $P_g$ {row['gap_um']:.3g} µm, "
            f"$N_p$ {row['periodicity']}" for _, row in part.iterrows()
        ])
        panel.grid(axis="y", visible=False)
        panel.set_title(request)
        panel.set(xlabel="predicted separation [°]", xlim=(0, None))
    handles = [key("#0072B2", "o", label="nominal"),
               key("#0072B2", "o", filled=False, label="outside training domain"),
               key("#0072B2", line="-", label="over fabrication tolerance"),
               key("#E8E4D8", "s", label="uncertainty of a difference")]
    legend(figure, handles)
    return figure


# --------------------------------------------------------------------------------- flow, numerics


@styled
def draw_flows(flows: pd.DataFrame) -> Figure:
    """Permeability against solid fraction, and tilt under axial force against N_p."""
    flows = flows[flows["permeability_over_pitch2"].notna()]
    pitch = 2 * flows["pillar_radius_um"] + flows["gap_um"]
    solid = np.pi * flows["pillar_radius_um"] ** 2 / pitch**2
    table = flows.assign(solid_fraction=solid, gap_over_pitch=flows["gap_um"] / pitch)
    figure = Figure(figsize=(9.2, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    colours = shades_of(table["periodicity"])
    for periodicity, part in table.groupby("periodicity"):
        part = part.sort_values("solid_fraction")
        left.plot(part["solid_fraction"], part["permeability_over_pitch2"], "o",
                  color=colours[periodicity], label=f"$N_p$ = {periodicity}")
    if (table["permeability_over_pitch2"] > 0).all():
        left.set_yscale("log")
    left.set(xlabel=r"solid fraction $\pi P_r^2/\lambda^2$", ylabel=r"permeability / $\lambda^2$")
    left.legend(ncols=2)
    scale = matplotlib.cm.ScalarMappable(
        matplotlib.colors.Normalize(table["gap_over_pitch"].min(), table["gap_over_pitch"].max()),
        matplotlib.colormaps["cividis"],
    )
    for _, part in table.groupby(["pillar_radius_um", "gap_um"]):
        part = part.sort_values("periodicity")
        colour = scale.to_rgba(part["gap_over_pitch"].iloc[0])
        right.plot(part["periodicity"], part["tilt_deg"], "o-", color=colour, linewidth=1)
    figure.colorbar(scale, ax=right, label=r"$P_g/\lambda$", shrink=0.9)
    right.set(xlabel="periodicity $N_p$", ylabel="tilt of the stream under axial force [°]",
              ylim=(min(0, 1.05 * table["tilt_deg"].min()), None))
    right.set_xticks(ordered(table["periodicity"]))
    return figure


@styled
def draw_numerics(runs: pd.DataFrame) -> Figure:
    """Cost per step against nodes, drift of volume and area, and wall time per run."""
    figure = Figure(figsize=(9.2, 3.1), layout="constrained")
    cost, drift, time = figure.subplots(1, 3)
    cost.plot(runs["nodes"] / 1000, runs["ms_per_step"], "o", color="#0072B2", markersize=4)
    cost.set(xlabel="fluid nodes [thousand]", ylabel="wall time per step [ms]", ylim=(0, None),
             xlim=(0, None))
    for name, label, colour in (("volume_drift_max", "volume", "#0072B2"),
                                ("area_drift_max", "area", "#E69F00")):
        values = np.sort(runs[name].dropna().to_numpy(float)) * 100
        drift.step(values, np.arange(1, len(values) + 1) / max(len(values), 1) * 100, where="post",
                   color=colour, label=label)
    drift.axvline(2, color="black", linestyle=":", linewidth=1)
    drift.set(xlabel="largest drift [%]", ylabel="runs below [%]", ylim=(0, 102))
    drift.set_xscale("symlog", linthresh=0.1)
    drift.set_xlim(left=0)
    drift.xaxis.set_major_formatter("{x:g}")
    drift.legend(loc="lower right")
    for mode in MODES:
        part = runs[runs["mode"] == mode]
        if len(part):
            time.plot(part["rows_completed"], part["wall_time_s"], MODE_MARKER[mode],
                      color=MODE_COLOUR[mode], markersize=4, label=mode_name(mode))
    time.set(xlabel="rows passed", ylabel="wall time of a run [s]", ylim=(0, None))
    time.legend()
    return figure


def render(figure: Figure, kind: str) -> bytes:
    """Image file of a figure, "svg" or "png"; equal figures give equal bytes."""
    stream = io.BytesIO()
    metadata = {"svg": {"Date": None, "Creator": None}, "png": {"Software": None}}[kind]
    with matplotlib.rc_context(STYLE):
        figure.savefig(stream, format=kind, dpi=170, metadata=metadata, facecolor="white")
    return stream.getvalue()
