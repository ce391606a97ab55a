"""Figures of one candidate: the array to scale, its tolerances, and what simulations say of it."""

from collections.abc import Sequence
from math import ceil, radians, tan

import plotly.graph_objects as go

from dldsim.app.web.ui.chart_style import (
    BLUE,
    CELL,
    CELL_DASH,
    CELL_FILL,
    GREY,
    ORANGE,
    PILLAR,
    PLAIN,
    Row,
    new_figure,
)

ROWS_SHOWN = 16
"""Rows of pillars that a drawing shows at most."""


def tornado(tolerances: Sequence[Row], separation: float) -> go.Figure:
    """Separation of one candidate with one thing off at a time."""
    names = list(dict.fromkeys(r["parameter"] for r in tolerances))
    reach = {
        n: max(abs(r["separation_deg"] - separation) for r in tolerances if r["parameter"] == n)
        for n in names
    }
    names.sort(key=reach.get)
    figure = new_figure(130 + 45 * len(names), xaxis_title="separation [°]")
    for sign, colour, label in ((-1, ORANGE, "smaller"), (1, BLUE, "larger")):
        rows = {r["parameter"]: r for r in tolerances if (r["offset"] > 0) == (sign > 0)}
        shown = [n for n in names if n in rows]
        figure.add_bar(
            orientation="h",
            y=[PLAIN[n] for n in shown],
            base=separation,
            name=label,
            x=[rows[n]["separation_deg"] - separation for n in shown],
            marker_color=colour,
            offset=-0.38 if sign < 0 else 0.02,
            width=0.36,
            customdata=[[rows[n]["offset"], rows[n]["separation_deg"]] for n in shown],
            hovertemplate="%{y} off by %{customdata[0]:+.3g}: %{customdata[1]:.2f}°<extra></extra>",
        )
    figure.add_vline(x=separation, line={"color": "black", "width": 1.2})
    figure.add_vline(x=0, line={"color": GREY, "width": 1, "dash": "dot"})
    return figure


def array(design: Row, radii: Sequence[float]) -> go.Figure:
    """An array to scale: pillars, mean direction of each cell type with its interval."""
    radius, gap, period = design["pillar_radius_um"], design["gap_um"], design["periodicity"]
    pitch = 2 * radius + gap
    rows = min(period + 1, ROWS_SHOWN)
    length = (rows - 1) * pitch
    start = pitch / 2
    types = range(1, len(radii) + 1)
    cell = ["cell"] if len(radii) == 1 else ["type 1", "type 2"]
    ends = [
        start + length * tan(radians(design[f"angle_{i}_{side}_deg"]))
        for i in types
        for side in ("low", "high")
    ]
    low = min(-radius, *ends) - 0.4 * pitch
    high = max(pitch + radius, *ends) + 0.4 * pitch
    shapes = []
    for i in range(rows):
        shift = i * pitch / period
        first, last = ceil((low - shift) / pitch - 0.5), int((high - shift) / pitch + 0.5)
        for j in range(first, last + 1):
            x, y = i * pitch, j * pitch + shift
            shapes.append(
                {
                    "type": "circle",
                    "x0": x - radius,
                    "x1": x + radius,
                    "y0": y - radius,
                    "y1": y + radius,
                    "fillcolor": PILLAR,
                    "layer": "below",
                    "line": {"color": "#9AA0A6", "width": 1},
                }
            )
    share = (high - low) / (length + 2 * pitch)
    figure = new_figure(
        int(min(max(900 * share, 160), 560)) + 110,
        shapes=shapes,
        xaxis_title="along the flow [µm]",
        yaxis_title="across [µm]",
        xaxis={"range": [-pitch, length + pitch], "showgrid": False, "constrain": "domain"},
        yaxis={"range": [low, high], "showgrid": False, "scaleanchor": "x", "constrain": "domain"},
    )
    for k, i in enumerate(types):
        angle, at_low, at_high = (design[f"angle_{i}_{s}deg"] for s in ("", "low_", "high_"))
        end, bottom, top = (start + length * tan(radians(a)) for a in (angle, at_low, at_high))
        figure.add_scatter(
            x=[0, length, length, 0],
            y=[start, bottom, top, start],
            mode="none",
            fill="toself",
            fillcolor=CELL_FILL[k],
            hoverinfo="skip",
            showlegend=False,
        )
        figure.add_scatter(
            x=[0, length],
            y=[start, end],
            mode="lines",
            hoverinfo="text",
            name=f"{cell[k]}: {angle:.2f}° ({design[f'mode_{i}']})",
            text=f"{cell[k]}: {angle:.2f}°, interval {at_low:.2f} to {at_high:.2f}°",
            line={"color": CELL[k], "width": 3, "dash": CELL_DASH[k]},
        )
        figure.add_shape(
            type="circle",
            x0=length - radii[k],
            x1=length + radii[k],
            y0=end - radii[k],
            y1=end + radii[k],
            fillcolor=CELL_FILL[k],
            line={"color": CELL[k], "width": 2, "dash": "solid" if k == 0 else "dot"},
        )
    figure.add_annotation(
        x=-0.85 * pitch,
        y=high - 0.2 * pitch,
        ax=45,
        ay=0,
        text="flow",
        arrowhead=2,
        arrowside="start",
        arrowcolor=GREY,
        font_color=GREY,
    )
    return figure


def verdicts(rows: Sequence[Row]) -> go.Figure:
    """Predicted interval and simulated difference of each array simulated."""
    rows = [r for r in rows if r["population"] == "difference"]
    labels = [
        f"{'h = ' + format(r['height_um'], 'g') + ' µm, ' if r['role'] == 'height' else ''}"
        f"P_r {r['pillar_radius_um']:.2f}, P_g {r['gap_um']:.2f}, N_p {r['periodicity']}"
        f" ({r['role']}, {i})"
        for i, r in enumerate(rows, start=1)
    ]
    figure = new_figure(
        140 + 42 * len(rows), xaxis_title="θ₂ − θ₁ [°]", yaxis={"autorange": "reversed"}
    )
    figure.add_vline(x=0, line={"color": GREY, "width": 1, "dash": "dot"})
    x, y = [], []
    for r, label in zip(rows, labels, strict=True):
        x += [r["predicted_low_deg"], r["predicted_high_deg"], None]
        y += [label, label, None]
    figure.add_scatter(
        x=x,
        y=y,
        mode="lines",
        line={"color": PILLAR, "width": 11},
        name="90 % prediction interval",
        hoverinfo="x",
    )
    figure.add_scatter(
        x=[r["predicted_deg"] for r in rows],
        y=labels,
        mode="markers",
        marker={"symbol": "line-ns", "size": 14, "color": "black", "line": {"width": 2}},
        name="predicted",
    )
    for agrees, colour, symbol, name in (
        (True, BLUE, "circle", "simulated, as predicted"),
        (False, ORANGE, "diamond", "simulated, prediction missed"),
        (None, GREY, "circle-open", "simulated, not comparable"),
    ):
        part = [
            (r, label)
            for r, label in zip(rows, labels, strict=True)
            if r["agrees"] is agrees and r["simulated_deg"] is not None
        ]
        if part:
            figure.add_scatter(
                x=[r["simulated_deg"] for r, _ in part],
                y=[label for _, label in part],
                mode="markers",
                marker={"color": colour, "symbol": symbol, "size": 11},
                name=name,
                error_x={"type": "data", "array": [r["sigma_num_deg"] or 0 for r, _ in part]},
            )
    figure.update_layout(margin_t=60)
    return figure
