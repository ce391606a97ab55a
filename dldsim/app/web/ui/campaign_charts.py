"""Figures of a campaign: angles, modes, calibration."""

from collections.abc import Sequence
from itertools import pairwise
from math import radians, tan

import plotly.graph_objects as go

from dldsim.app.web.ui.chart_style import (
    BLUE,
    GREEN,
    GREY,
    MODE,
    ORANGE,
    PARAMETER,
    Row,
    new_figure,
)
from dldsim.vocabulary import DECIDED

KNOWN = (*DECIDED, "measured")
"""Statuses of outcomes whose angle is known."""
AXES = {
    **PARAMETER,
    "deformation_index": "deformation index of the cell",
    "confinement": "confinement 2R / P<sub>g</sub>",
}
RESPONSES = {
    "migration_angle_deg": "migration angle θ<sub>m</sub> [°]",
    "share": "tan θ<sub>m</sub> · N<sub>p</sub>  (1: bump, 0: zigzag)",
}
SYMBOLS = (
    "circle",
    "square",
    "triangle-up",
    "diamond",
    "triangle-down",
    "cross",
    "x",
    "star",
    "pentagon",
)
OKABE = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#E69F00",
    "#56B4E9",
    "#000000",
    "#7F7F7F",
    "#F0E442",
)


def share(run: Row) -> float | None:
    """Displacement per row in units of the row shift."""
    angle = run["migration_angle_deg"]
    return None if angle is None else tan(radians(angle)) * run["periodicity"]


def angles(outcomes: Sequence[Row], x: str, response: str, group: str) -> go.Figure:
    """Angle of each outcome over one parameter, grouped by mode or by another column.

    Hollow: undecided, the motion had not settled. Bars: σ_num. Outcomes of the same x stand side by
    side.
    """
    known = [r for r in outcomes if r["migration_angle_deg"] is not None and r[x] is not None]
    place = _side_by_side(known, x)
    figure = new_figure(480, xaxis_title=AXES[x], yaxis_title=RESPONSES[response])
    groups = sorted({r[group] for r in known}, key=lambda v: (isinstance(v, str), v))
    if group == "mode":
        groups = [m for m in MODE if m in groups]
    for i, value in enumerate(groups):
        colour, symbol = MODE[value] if group == "mode" else (OKABE[i % 9], SYMBOLS[i % 9])
        part = [r for r in known if r[group] == value]
        bars = None
        if response == "migration_angle_deg" and any(r["sigma_num_deg"] for r in part):
            bars = {
                "type": "data",
                "array": [r["sigma_num_deg"] or 0 for r in part],
                "thickness": 1,
                "width": 2,
            }
        figure.add_scatter(
            x=[place[r["outcome_id"]] for r in part],
            mode="markers",
            name=str(value),
            error_y=bars,
            y=[share(r) if response == "share" else r[response] for r in part],
            marker={
                "color": colour,
                "size": 9,
                "line": {"color": colour, "width": 1.5},
                "symbol": [symbol if r["status"] in KNOWN else symbol + "-open" for r in part],
            },
            customdata=[
                [
                    r["outcome_id"],
                    r["pillar_radius_um"],
                    r["gap_um"],
                    r["periodicity"],
                    r["stiffness_set"],
                    r["mode"],
                    r["status"],
                ]
                for r in part
            ],
            hovertemplate="%{customdata[0]}<br>P_r %{customdata[1]:.4g} µm, P_g "
            "%{customdata[2]:.4g} µm, N_p %{customdata[3]}, set %{customdata[4]}"
            "<br>%{y:.3g}, %{customdata[5]}, %{customdata[6]}<extra></extra>",
        )
    if x == "periodicity" and response == "migration_angle_deg" and known:
        rows = sorted({(r["periodicity"], r["bump_angle_deg"]) for r in known})
        figure.add_scatter(
            x=[r[0] for r in rows],
            y=[r[1] for r in rows],
            mode="lines",
            name="full bump",
            line={"color": "black", "width": 1, "dash": "dot"},
        )
    if response == "share":
        for level in (0.1, 0.9):
            figure.add_hline(y=level, line={"color": GREY, "width": 1, "dash": "dot"})
    return figure


def _side_by_side(outcomes: Sequence[Row], x: str) -> dict[str, float]:
    """Place of each outcome along x, spread over most of the distance of neighbouring values."""
    values = sorted({r[x] for r in outcomes})
    width = min((b - a for a, b in pairwise(values)), default=1.0) * 0.7
    place = {}
    for value in values:
        same = sorted(
            (r for r in outcomes if r[x] == value),
            key=lambda r: (
                r["periodicity"],
                r["gap_um"],
                r["pillar_radius_um"],
                r["stiffness_set"],
            ),
        )
        for k, outcome in enumerate(same):
            place[outcome["outcome_id"]] = value + width * ((k + 0.5) / len(same) - 0.5)
    return place


def modes(outcomes: Sequence[Row], x: str) -> go.Figure:
    """How many outcomes end in each mode, over one parameter."""
    values = sorted({r[x] for r in outcomes if r[x] is not None})
    labels = [f"{v:.4g}" for v in values]
    figure = new_figure(
        330, barmode="stack", xaxis_title=AXES[x], yaxis_title="outcomes", xaxis_type="category"
    )
    for mode, (colour, _) in MODE.items():
        counts = [sum(r[x] == v and r["mode"] == mode for r in outcomes) for v in values]
        if any(counts):
            figure.add_bar(
                x=labels,
                y=counts,
                name=mode if mode != "none" else "no angle",
                marker={
                    "color": colour,
                    "pattern": {
                        "fillmode": "overlay",
                        "fgcolor": "white",
                        "solidity": 0.25,
                        "shape": {"bump": "", "mixed": "/", "zigzag": "x", "none": "."}[mode],
                    },
                },
                hovertemplate=f"%{{x}}: %{{y}} {mode}<extra></extra>",
            )
    return figure


def calibration(rows: Sequence[Row], found: Row | None = None) -> go.Figure:
    """Index over stiffness with its scatter, by assay; dotted: an inverted measurement."""
    figure = new_figure(
        430,
        xaxis_title="edge spring constant k<sub>s</sub> [µN/m]",
        yaxis_title="deformation index",
        xaxis_type="log",
    )
    looks = {
        "group-velocity": (BLUE, "circle", "solid"),
        "fixed-velocity": (ORANGE, "square", "dash"),
    }
    for name in dict.fromkeys(r["assay"] for r in rows):
        part = sorted(
            (r for r in rows if r["assay"] == name and r["deformation_index"] is not None),
            key=lambda r: r["ks_uN_per_m"],
        )
        colour, symbol, dash = looks.get(name, (GREEN, "diamond", "dot"))
        figure.add_scatter(
            x=[r["ks_uN_per_m"] for r in part],
            y=[r["deformation_index"] for r in part],
            mode="lines+markers",
            name=name,
            line={"color": colour, "dash": dash, "width": 1.5},
            marker={"symbol": symbol, "size": 9},
            error_y={
                "type": "data",
                "array": [r["deformation_index_std"] or 0.0 for r in part],
                "thickness": 1.2,
            },
            customdata=[[r["group"], r["stiffness_set"] or "–"] for r in part],
            hovertemplate="%{customdata[0]}, set %{customdata[1]}<br>k_s %{x:.3g} µN/m, DI %{y:.4f}"
            "<extra></extra>",
        )
    if found:
        index, error = found["deformation_index"], found["error"]
        low, high = found["ks_uN_per_m_low"], found["ks_uN_per_m_high"]
        line = {"color": "black", "width": 1.2, "dash": "dot"}
        figure.add_hline(y=index, line=line)
        if error:
            figure.add_hrect(
                y0=index - error, y1=index + error, line_width=0, fillcolor="rgba(0,0,0,0.08)"
            )
        figure.add_vrect(x0=low, x1=high, fillcolor="rgba(0,158,115,0.18)", line_width=0)
        figure.add_scatter(
            x=[found["ks_uN_per_m"]],
            y=[index],
            mode="markers",
            name="measured",
            marker={"symbol": "star", "size": 15, "color": "black"},
            hovertemplate="k_s %{x:.4g} µN/m<extra></extra>",
        )
    return figure
