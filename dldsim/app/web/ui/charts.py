"""Plotly figures of the page. Each takes rows as the API answers them and computes no physics.

Colours follow Okabe & Ito; cell types are also told apart by line and marker, modes by marker.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from math import ceil, radians, tan
from typing import Any

import plotly.graph_objects as go
from plotly.subplots import make_subplots

Row = Mapping[str, Any]

PARAMETER = {
    "pillar_radius_um": "P<sub>r</sub> [µm]",
    "gap_um": "P<sub>g</sub> [µm]",
    "periodicity": "N<sub>p</sub> [rows]",
}
PLAIN = {
    "pillar_radius_um": "pillar radius P_r",
    "gap_um": "gap P_g",
    "periodicity": "periodicity N_p",
    "edge_um": "all pillar edges outwards",
    "ks_1_uN_per_m": "spring constant k_s, type 1",
    "ks_2_uN_per_m": "spring constant k_s, type 2",
}
CELL = ("#0072B2", "#D55E00")
CELL_FILL = ("rgba(0,114,178,0.18)", "rgba(213,94,0,0.18)")
CELL_DASH = ("solid", "dash")
MODE = {
    "bump": ("#0072B2", "circle"),
    "mixed": ("#009E73", "diamond"),
    "zigzag": ("#D55E00", "triangle-up"),
    "none": ("#7F7F7F", "x"),
}
SKY, BLUE, ORANGE, GREEN, GREY, PILLAR = (
    "#56B4E9",
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#5F6368",
    "#C9CDD2",
)
DECIDED = ("decided", "coexisting", "measured")
"""Statuses of outcomes whose angle is known."""
ORDERED = "Cividis"
ROWS_SHOWN = 16
"""Rows of pillars that a drawing shows at most."""
BINS = 12
"""Colours of the lines in parallel coordinates."""
TEMPLATE = go.layout.Template(
    layout={
        "font": {
            "family": "Source Sans Pro, DejaVu Sans, sans-serif",
            "size": 14,
            "color": "#262730",
        },
        "paper_bgcolor": "white",
        "plot_bgcolor": "white",
        "hovermode": "closest",
        "margin": {"l": 60, "r": 48, "t": 30, "b": 50},
        "modebar": {"orientation": "v"},  # in the margin at the right, beside legend and curves
        "xaxis": {
            "gridcolor": "#E4E6E9",
            "linecolor": "#444444",
            "ticks": "outside",
            "zeroline": False,
            "automargin": True,
        },
        "yaxis": {
            "gridcolor": "#E4E6E9",
            "linecolor": "#444444",
            "ticks": "outside",
            "zeroline": False,
            "automargin": True,
        },
        "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0, "xanchor": "left"},
    }
)


def _figure(height: int, **layout: Any) -> go.Figure:
    return go.Figure(layout={"template": TEMPLATE, "height": height, **layout})


def value_title(objective: str) -> str:
    """What a value of the objective is, with its unit."""
    if objective == "robust":
        return "robust separation [°]"
    if objective == "purity-recovery":
        return "smallest purity or recovery"
    return "separation |Δθ| [°]"


def convergence(
    best: Sequence[float | None],
    objective: str,
    total: int | None = None,
    trials: Sequence[Row] = (),
) -> go.Figure:
    """Best value after each trial, and the trials if they are known.

    A negative robust value is the share of the draws' range by which the order of the two cell
    types is open, not an angle.
    """
    figure = _figure(300, xaxis_title="trial", yaxis_title=value_title(objective))
    good = [t for t in trials if t["feasible"] and t["value"] is not None]
    if good:
        figure.add_scatter(
            x=[t["trial"] + 1 for t in good],
            y=[t["value"] for t in good],
            mode="markers",
            name="feasible trial",
            marker={"color": SKY, "size": 6},
            customdata=[[t["pillar_radius_um"], t["gap_um"], t["periodicity"]] for t in good],
            hovertemplate="trial %{x}: %{y:.3g}<br>P_r %{customdata[0]:.2f} µm, P_g "
            "%{customdata[1]:.2f} µm, N_p %{customdata[2]}<extra></extra>",
        )
    figure.add_scatter(
        x=list(range(1, len(best) + 1)),
        y=list(best),
        mode="lines",
        name="best so far",
        line={"color": BLUE, "width": 2.5, "shape": "hv"},
        hovertemplate="after trial %{x}: %{y:.3g}<extra></extra>",
    )
    known = [v for v in best if v is not None]
    if objective == "robust" and known and min(known) < 0:
        figure.add_hline(y=0, line={"color": GREY, "width": 1, "dash": "dot"})
    if total:
        figure.update_xaxes(range=[0, total + 1])
    figure.update_layout(showlegend=bool(good))
    return figure


def importance(rows: Sequence[Row]) -> go.Figure:
    """Bars, largest on top."""
    known = sorted((r for r in rows if r["importance"] is not None), key=lambda r: r["importance"])
    figure = _figure(
        110 + 40 * len(known), xaxis_title="share of the importance", xaxis_range=[0, 1.08]
    )
    figure.add_bar(
        x=[r["importance"] for r in known],
        y=[PLAIN.get(r["parameter"], r["parameter"]) for r in known],
        orientation="h",
        marker_color=SKY,
        marker_line={"color": BLUE, "width": 1},
        text=[f"{r['importance']:.2f}" for r in known],
        textposition="outside",
        cliponaxis=False,
        hovertemplate="%{y}: %{x:.3f}<extra></extra>",
    )
    return figure


def parallel(trials: Sequence[Row], objective: str, best: int | None = None) -> go.Figure:
    """Feasible trials as lines over P_r, P_g, N_p, separation and value, coloured by the value.

    Drawn without WebGL, so that every browser shows it.
    """
    axes = {**PARAMETER, "separation_deg": "|Δθ| [°]", "value": value_title(objective)}
    if objective != "robust":
        del axes["value"]
    key = list(axes)[-1]
    good = sorted((t for t in trials if t["feasible"] and t[key] is not None), key=lambda t: t[key])
    figure = _figure(
        380,
        xaxis={"visible": False, "range": [-0.25, len(axes) - 0.75]},
        yaxis={"visible": False, "range": [-0.08, 1.2]},
        showlegend=False,
        margin={"l": 10, "r": 10, "t": 10, "b": 10},
    )
    if not good:
        return figure
    ends = {n: (min(t[n] for t in good), max(t[n] for t in good)) for n in axes}

    def scaled(name: str, value: float) -> float:
        low, high = ends[name]
        return (value - low) / (high - low) if high > low else 0.5

    colours = _sampled(ORDERED, BINS)
    bins: list[list[Row]] = [[] for _ in range(BINS)]
    for trial in good:
        bins[min(int(scaled(key, trial[key]) * BINS), BINS - 1)].append(trial)
    for colour, part in zip(colours, bins, strict=True):
        if part:
            x, y, text = _lines(part, axes, scaled)
            figure.add_scatter(
                x=x,
                y=y,
                text=text,
                mode="lines",
                opacity=0.75,
                line={"color": colour, "width": 1.3},
                hoverinfo="text",
            )
    chosen = next((t for t in good if t["trial"] == best), None)
    if chosen is not None:
        x, y, text = _lines([chosen], axes, scaled)
        figure.add_scatter(
            x=x, y=y, text=text, mode="lines", hoverinfo="text", line={"color": "black", "width": 3}
        )
    for place, (name, title) in enumerate(axes.items()):
        figure.add_annotation(
            x=place,
            y=1,
            showarrow=False,
            yshift=24,
            yanchor="bottom",
            text=f"<b>{title.replace('separation [', 'separation<br>[')}</b>",
        )
        figure.add_shape(
            type="line",
            x0=place,
            x1=place,
            y0=0,
            y1=1,
            layer="below",
            line={"color": "#444444", "width": 1},
        )
        for at, value in zip((0, 1), ends[name], strict=True):
            figure.add_annotation(
                x=place,
                y=at,
                text=f"{value:.3g}",
                showarrow=False,
                yshift=-11 if at == 0 else 10,
                font_size=12,
                bgcolor="rgba(255,255,255,0.8)",
            )
    return figure


def _lines(trials: Iterable[Row], axes: Mapping[str, str], scaled) -> tuple[list, list, list]:
    x: list[float | None] = []
    y: list[float | None] = []
    text: list[str] = []
    for trial in trials:
        words = (
            f"trial {trial['trial'] + 1}<br>P_r {trial['pillar_radius_um']:.2f} µm, "
            f"P_g {trial['gap_um']:.2f} µm, N_p {trial['periodicity']}<br>"
            f"|Δθ| {trial['separation_deg']:.2f}°, objective {trial['value']:.3g}"
        )
        x += [*range(len(axes)), None]
        y += [*(scaled(name, trial[name]) for name in axes), None]
        text += [words] * (len(axes) + 1)
    return x, y, text


def _sampled(scale: str, count: int) -> list[str]:
    from plotly.colors import sample_colorscale

    return sample_colorscale(scale, [i / (count - 1) for i in range(count)])


def surface(slices: Sequence[Row], x: str, y: str, designs: Sequence[Row]) -> go.Figure:
    """Predicted angle 2 − angle 1 over two parameters, the third as in the best candidate.

    Hatched: extrapolated; grey: against a constraint. Candidates carry their number; one whose
    third parameter differs from that of the best is drawn hollow.
    """
    part = [r for r in slices if {r["x_parameter"], r["y_parameter"]} == {x, y}]
    points = {}
    for r in part:
        at = (r["x"], r["y"]) if r["x_parameter"] == x else (r["y"], r["x"])
        points[at] = r
    xs, ys = (sorted({at[i] for at in points}) for i in (0, 1))
    most = max((abs(r["difference_deg"]) for r in part), default=1.0) or 1.0

    def grid(value) -> list[list]:
        return [[value(points[a, b]) if (a, b) in points else None for a in xs] for b in ys]

    figure = _figure(490, xaxis_title=PARAMETER[x], yaxis_title=PARAMETER[y], margin_t=50)
    hover = (
        f"{PARAMETER[x]} %{{x:.4g}}<br>{PARAMETER[y]} %{{y:.4g}}<br>"
        "θ₂ − θ₁ %{z:.2f}°<br>%{text}<extra></extra>"
    )
    about = grid(
        lambda r: (
            "against a constraint"
            if not r["feasible"]
            else "inside the training domain"
            if r["inside_training_domain"]
            else "extrapolated"
        )
    )
    values = grid(lambda r: r["difference_deg"])
    figure.add_heatmap(
        x=xs,
        y=ys,
        z=values,
        colorscale="PuOr",
        zmin=-most,
        zmax=most,
        text=about,
        colorbar={"title": {"text": "θ₂ − θ₁ [°]", "side": "right"}},
        hovertemplate=hover,
    )
    figure.add_heatmap(
        x=xs,
        y=ys,
        z=grid(lambda r: None if r["feasible"] else 1),
        hoverinfo="skip",
        showscale=False,
        colorscale=[[0, PILLAR], [1, PILLAR]],
    )
    if "periodicity" not in (x, y):  # there is nothing between whole rows
        figure.add_contour(
            x=xs,
            y=ys,
            z=values,
            showscale=False,
            hoverinfo="skip",
            ncontours=14,
            contours_coloring="none",
            showlegend=False,
            line={"width": 0.8, "color": "#444444"},
        )
    hatched = [
        at
        for i, a in enumerate(xs)
        for j, b in enumerate(ys)
        if (i + j) % 2 == 0
        and (at := (a, b)) in points
        and points[at]["feasible"]
        and not points[at]["inside_training_domain"]
    ]
    if hatched:
        figure.add_scatter(
            x=[a for a, _ in hatched],
            y=[b for _, b in hatched],
            mode="markers",
            name="extrapolated",
            hoverinfo="skip",
            marker={"symbol": "line-ne", "size": 8, "line": {"width": 1, "color": "#444444"}},
        )
    if not designs:
        return figure
    [third] = [name for name in PARAMETER if name not in (x, y)]
    for hollow in (False, True):
        shown = [d for d in designs if (d[third] != designs[0][third]) == hollow]
        if shown:
            figure.add_scatter(
                x=[d[x] for d in shown],
                y=[d[y] for d in shown],
                mode="markers",
                text=[str(d["design"]) for d in shown],
                marker={
                    "symbol": "star-open" if hollow else "star",
                    "size": 13,
                    "color": "black",
                    "line": {"width": 1.2, "color": "black"},
                },
                name="candidate" + (f" with another {PLAIN[third]}" if hollow else ""),
                hovertemplate="candidate %{text}<extra></extra>",
            )
    for d in designs:
        figure.add_annotation(
            x=d[x],
            y=d[y],
            text=str(d["design"]),
            showarrow=False,
            xshift=11,
            yshift=12,
            borderpad=1,
            bgcolor="rgba(255,255,255,0.8)",
        )
    return figure


def tornado(tolerances: Sequence[Row], separation: float) -> go.Figure:
    """Separation of one candidate with one thing off at a time."""
    names = list(dict.fromkeys(r["parameter"] for r in tolerances))
    reach = {
        n: max(abs(r["separation_deg"] - separation) for r in tolerances if r["parameter"] == n)
        for n in names
    }
    names.sort(key=reach.get)
    figure = _figure(130 + 45 * len(names), xaxis_title="separation [°]")
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
    figure = _figure(
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


def hull(points: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """Corners of the convex hull, closed (Andrew's monotone chain)."""
    points = sorted(set(points))
    if len(points) < 3:
        return points
    halves = []
    for order in (points, points[::-1]):
        half: list[tuple[float, float]] = []
        for p in order:
            while len(half) > 1 and _left_turn(half[-2], half[-1], p) <= 0:
                half.pop()
            half.append(p)
        halves.append(half[:-1])
    corners = halves[0] + halves[1]
    return [*corners, corners[0]]


def _left_turn(a, b, c) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def domain(
    geometries: Sequence[Sequence[float]], request: Row, designs: Sequence[Row] = ()
) -> go.Figure:
    """Arrays learnt from, the bounds of a request and its candidates, in units of each radius.

    Three projections: what lies inside all of them may still lie outside the hull.
    """
    titles = ("P<sub>r</sub> / R", "P<sub>g</sub> / R", "N<sub>p</sub>")
    names = ("pillar_radius_um", "gap_um", "periodicity")
    figure = make_subplots(cols=3, horizontal_spacing=0.09)
    figure.update_layout(template=TEMPLATE, height=390, margin_t=70)
    radii = list(dict.fromkeys((request["radius_1_um"], request["radius_2_um"])))
    for column, (a, b) in enumerate(((0, 1), (2, 1), (2, 0)), start=1):
        first = column == 1
        at = {"row": 1, "col": column}
        points = [(g[a], g[b]) for g in geometries]
        corners = hull(points)
        figure.add_scatter(
            x=[p[0] for p in corners],
            y=[p[1] for p in corners],
            mode="lines",
            fill="toself",
            fillcolor="rgba(86,180,233,0.18)",
            line={"color": SKY, "width": 1},
            name="inside all learnt from",
            showlegend=first,
            hoverinfo="skip",
            **at,
        )
        figure.add_scatter(
            x=[p[0] for p in points],
            y=[p[1] for p in points],
            mode="markers",
            marker={"color": BLUE, "size": 6},
            name="array learnt from",
            showlegend=first,
            hoverinfo="x+y",
            **at,
        )
        for k, radius in enumerate(radii):
            scale = (radius, radius, 1.0)
            (x0, x1), (y0, y1) = ([v / scale[i] for v in request[names[i]]] for i in (a, b))
            which = f"bounds, R = {radius:g} µm"
            figure.add_scatter(
                x=[x0, x1, x1, x0, x0],
                y=[y0, y0, y1, y1, y0],
                mode="lines",
                line={"color": CELL[1 - k], "width": 2, "dash": CELL_DASH[k]},
                name=which,
                showlegend=first,
                hoverinfo="name",
                **at,
            )
            if designs:
                figure.add_scatter(
                    x=[d[names[a]] / scale[a] for d in designs],
                    y=[d[names[b]] / scale[b] for d in designs],
                    mode="markers",
                    marker={
                        "symbol": "star" if k == 0 else "star-open",
                        "size": 12,
                        "color": "black",
                    },
                    text=[
                        f"candidate {d['design']}"
                        + ("" if d["inside_training_domain"] else ": extrapolated")
                        for d in designs
                    ],
                    name=f"candidates, R = {radius:g} µm",
                    showlegend=first,
                    hoverinfo="text",
                    **at,
                )
        figure.update_xaxes(title_text=titles[a], **at)
        figure.update_yaxes(title_text=titles[b], **at)
    return figure


def index_strip(
    learnt: Sequence[float], cells: Mapping[int, tuple[float, float | None]]
) -> go.Figure:
    """Range of deformation indices of an assay, and cell types by number with their spread."""
    figure = _figure(
        170,
        xaxis_title="deformation index",
        margin={"l": 70, "r": 48, "t": 10, "b": 50},
        yaxis={
            "tickvals": [1, 0],
            "ticktext": ["type 1", "type 2"],
            "range": [-0.6, 1.6],
            "showgrid": False,
        },
        showlegend=False,
    )
    figure.add_vrect(
        x0=learnt[0],
        x1=learnt[1],
        fillcolor="rgba(86,180,233,0.25)",
        line_width=0,
        annotation_text="calibrated",
        annotation_position="top left",
        annotation_font_size=12,
    )
    for number, (index, spread) in cells.items():
        k = number - 1
        figure.add_scatter(
            x=[index],
            y=[1 - k],
            mode="markers",
            error_x={"type": "data", "array": [spread or 0.0], "thickness": 2, "width": 7},
            marker={"color": CELL[k], "size": 11, "symbol": ("circle", "square")[k]},
            hovertemplate="%{x:.4f}" + (f" ± {spread:.4f}" if spread else "") + "<extra></extra>",
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
    figure = _figure(
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
    figure = _figure(480, xaxis_title=AXES[x], yaxis_title=RESPONSES[response])
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
                "symbol": [symbol if r["status"] in DECIDED else symbol + "-open" for r in part],
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
    figure = _figure(
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
    figure = _figure(
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
