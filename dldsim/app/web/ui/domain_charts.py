"""Where the surrogate interpolates: arrays learnt from, bounds and candidates; range of indices."""

from collections.abc import Iterable, Mapping, Sequence

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from dldsim.app.web.ui.chart_style import BLUE, CELL, CELL_DASH, SKY, TEMPLATE, Row, new_figure


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
    figure = new_figure(
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
