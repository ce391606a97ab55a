"""Figures of the flow without a cell, and of what the runs cost."""

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from dldsim.report.style import MODE_COLOUR, MODE_MARKER, mode_name, ordered, shades_of, styled
from dldsim.vocabulary import MODES


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
        left.plot(
            part["solid_fraction"],
            part["permeability_over_pitch2"],
            "o",
            color=colours[periodicity],
            label=f"$N_p$ = {periodicity}",
        )
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
    right.set(
        xlabel="periodicity $N_p$",
        ylabel="tilt of the stream under axial force [°]",
        ylim=(min(0, 1.05 * table["tilt_deg"].min()), None),
    )
    right.set_xticks(ordered(table["periodicity"]))
    return figure


@styled
def draw_numerics(runs: pd.DataFrame) -> Figure:
    """Cost per step against nodes, drift of volume and area, and wall time per run."""
    figure = Figure(figsize=(9.2, 3.1), layout="constrained")
    cost, drift, time = figure.subplots(1, 3)
    cost.plot(runs["nodes"] / 1000, runs["ms_per_step"], "o", color="#0072B2", markersize=4)
    cost.set(
        xlabel="fluid nodes [thousand]",
        ylabel="wall time per step [ms]",
        ylim=(0, None),
        xlim=(0, None),
    )
    for name, label, colour in (
        ("volume_drift_max", "volume", "#0072B2"),
        ("area_drift_max", "area", "#E69F00"),
    ):
        values = np.sort(runs[name].dropna().to_numpy(float)) * 100
        drift.step(
            values,
            np.arange(1, len(values) + 1) / max(len(values), 1) * 100,
            where="post",
            color=colour,
            label=label,
        )
    drift.axvline(2, color="black", linestyle=":", linewidth=1)
    drift.set(xlabel="largest drift [%]", ylabel="runs below [%]", ylim=(0, 102))
    drift.set_xscale("symlog", linthresh=0.1)
    drift.set_xlim(left=0)
    drift.xaxis.set_major_formatter("{x:g}")
    drift.legend(loc="lower right")
    for mode in MODES:
        part = runs[runs["mode"] == mode]
        if len(part):
            time.plot(
                part["rows_completed"],
                part["wall_time_s"],
                MODE_MARKER[mode],
                color=MODE_COLOUR[mode],
                markersize=4,
                label=mode_name(mode),
            )
    time.set(xlabel="rows passed", ylabel="wall time of a run [s]", ylim=(0, None))
    time.legend()
    return figure
