"""Figures of paths through the pillars, row by row."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from dldsim.laws import pillar_centres
from dldsim.report.style import (
    GREY,
    MODE_COLOUR,
    PILLAR,
    key,
    legend,
    measured,
    mode_name,
    ordered,
    settled,
    shades_of,
    styled,
)
from dldsim.vocabulary import BROKEN, GEOMETRY, MODES, SETTLED

LONGEST_VIEW = 14
"""Rows that a trajectory panel shows at most, unless one period is longer."""


def row_map(run) -> tuple[np.ndarray, np.ndarray]:
    """Position before each row and its lateral step, (rows + probes,) each; probes last.

    Positions midway between rows are heights over the gap: 0 to 1 in the gap, −2 P_r/P_g to 0
    behind its lower pillar. Steps are in row shifts.
    """
    total = cumulated_row_shifts(run)
    seen = total - np.arange(len(total))
    seen = np.concatenate([seen[:-1], seen[-1] - np.asarray(run["probe_offsets"], dtype=float)])
    row_shift = run["pitch_um"] * run["row_shift_fraction"]
    height = run["release_gap_fraction"] + seen * row_shift / run["gap_um"]
    pillar = 2 * run["pillar_radius_um"] / run["gap_um"]
    steps = np.concatenate([np.diff(total), np.asarray(run["probe_steps"], dtype=float)])
    return (height + pillar) % (1 + pillar) - pillar, steps


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
    alike = (
        runs.assign(settled=settled(runs))
        .groupby("outcome_id")
        .agg(settled=("settled", "all"), modes=("mode", "nunique"))
    )
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
    """The last rows of each run, at least N_p where it has them.

    Those of a longer run are moved back by whole rows to where the shortest ends, and up or down by
    whole pitches to where its path begins: the array is the same there.
    """
    rows = [runs[runs["run_id"] == run_id].iloc[0] for run_id in run_ids]
    first = rows[0]
    pitch = first["pitch_um"]
    view = pitch * max(LONGEST_VIEW, first["periodicity"] + 1)
    tracks = [trajectories[trajectories["run_id"] == run_id] for run_id in run_ids]
    ends = [track["x_um"].max() for track in tracks]
    end = min(ends)
    moved = []
    for last, track in zip(ends, tracks, strict=True):
        back = pitch * round((last - end) / pitch)
        lower = back * first["row_shift_fraction"]
        moved.append(track.assign(x_um=track["x_um"] - back, y_um=track["y_um"] - lower))
    start = max(end - view, *(track["x_um"].min() for track in moved))
    paths = []
    for run, track in zip(rows, moved, strict=True):
        seen = track[track["x_um"].between(start, end)]
        if paths:
            off = seen["y_um"].iloc[0] - paths[0]["y"][0]
            seen = seen.assign(y_um=seen["y_um"] - pitch * round(off / pitch))
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
        title,
        paths,
        pillars_in(first, xlim, ylim),
        first["pillar_radius_um"],
        first["cell_radius_um"],
        xlim,
        ylim,
    )


@styled
def draw_trajectories(panels: list[TrajectoryPanel]) -> Figure:
    """Paths over pillars with the true aspect ratio, and the deformation index below each."""
    width, left, right, strip = 9.2, 0.68, 0.12, 0.55
    inner = width - left - right
    heights = [inner * (p.ylim[1] - p.ylim[0]) / (p.xlim[1] - p.xlim[0]) for p in panels]
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
                facecolor=PILLAR,
                edgecolor="#8A9099",
                linewidth=0.5,
            )
        )
        for path in panel.paths:
            colour = MODE_COLOUR[path["mode"]]
            axes.plot(path["x"], path["y"], color=colour, linewidth=1.8, label=path["label"])
            axes.plot(path["x"][-1], path["y"][-1], ">", color=colour, markersize=6)
            below_axes.plot(path["x"], path["deformation_index"], color=colour, linewidth=1.2)
        start = panel.paths[0]
        axes.add_patch(
            Circle(
                (start["x"][0], start["y"][0]),
                panel.cell_radius,
                fill=False,
                edgecolor="black",
                linestyle=(0, (2, 1.5)),
                linewidth=0.9,
            )
        )
        axes.set(xlim=panel.xlim, ylim=panel.ylim, ylabel="$y$ [µm]")
        axes.set_title(panel.title, pad=19)
        axes.tick_params(labelbottom=False)
        axes.grid(False)
        for spine in axes.spines.values():
            spine.set_visible(True)
        axes.legend(
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0),
            ncols=len(panel.paths),
            borderpad=0.1,
            borderaxespad=0.2,
            handlelength=1.6,
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
                "color": MODE_COLOUR[run["mode"]],
                "alpha": 0.75,
                "linewidth": 1,
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
        for m in MODES
        if (runs["mode"] == m).any()
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
    below is the distance from the transition. Circles: from nearer to the pillar than where the
    cell rests (`lane_depth`).
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
            rows = len(run["lateral_steps_um"])
            colour = colours[run["run_id"]]
            axes.plot(
                height[:rows],
                steps[:rows],
                ".",
                color=colour,
                markersize=4,
                label=f"set {run['stiffness_set']}, {run['release_gap_fraction']:g}",
            )
            axes.plot(
                height[rows:], steps[rows:], "o", color=colour, markersize=4, fillstyle="none"
            )
        axes.set(xlim=(-2 * radius / gap, 1), xlabel="height in gap (grey: pillar)")
        axes.set_title(f"$P_r$ = {radius:g}, $P_g$ = {gap:g} µm, $N_p$ = {periodicity}")
        axes.legend(title="stiffness, release", loc="lower right", fontsize=7, title_fontsize=7)
    for axes in grid.flat[len(panels) :]:
        axes.set_visible(False)
    for axes in grid[:, 0]:
        axes.set_ylabel(r"lateral step / $\varepsilon\lambda$")
    return figure
