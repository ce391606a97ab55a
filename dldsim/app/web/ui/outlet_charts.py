"""Figure of what leaves a device: both populations along it, their exits, the walls."""

from collections.abc import Sequence

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from dldsim.app.web.ui.chart_style import CELL, CELL_DASH, GREY, TEMPLATE, Row

BANDS = (("05", "95", 0.16), ("25", "75", 0.3))
"""Quantiles that are shaded, and how strongly."""


def fan(
    positions: Sequence[Row], exits: Sequence[Row], outlets: Sequence[Row], cut_um: float
) -> go.Figure:
    """Both populations fanning out along the array; shares of cells across its end beside it."""
    figure = make_subplots(
        cols=2, shared_yaxes=True, column_widths=[0.74, 0.26], horizontal_spacing=0.03
    )
    figure.update_layout(template=TEMPLATE, height=430, barmode="overlay", bargap=0)
    for k, colour in enumerate(CELL):
        along = [r for r in positions if r["population"] == k + 1]
        x = [r["x_mm"] for r in along]
        for low, high, strength in BANDS:
            figure.add_scatter(
                x=x + x[::-1],
                y=[r[f"y_{high}_um"] for r in along] + [r[f"y_{low}_um"] for r in along][::-1],
                mode="lines",
                fill="toself",
                fillcolor=_faint(colour, strength),
                line={"width": 0},
                showlegend=False,
                hoverinfo="skip",
                row=1,
                col=1,
            )
        figure.add_scatter(
            x=x,
            y=[r["y_50_um"] for r in along],
            mode="lines",
            line={"color": colour, "width": 2, "dash": CELL_DASH[k]},
            name=f"cell type {k + 1}, half below",
            hovertemplate="%{x:.2f} mm: %{y:.0f} µm<extra></extra>",
            row=1,
            col=1,
        )
        leaving = [r for r in exits if r["population"] == k + 1 and r["cells"] > 0]
        figure.add_bar(
            x=[r["cells"] for r in leaving],
            y=[(r["low_um"] + r["high_um"]) / 2 for r in leaving],
            width=[r["high_um"] - r["low_um"] for r in leaving],
            orientation="h",
            marker={"color": colour, "opacity": 0.55},
            showlegend=False,
            hovertemplate="%{y:.0f} µm: %{x:.1%}<extra></extra>",
            row=1,
            col=2,
        )
    for wall in [r["low_um"] for r in outlets][1:]:
        own = abs(wall - cut_um) < 1e-6
        for column in (1, 2):
            figure.add_hline(
                y=wall,
                line={"color": "black" if own else GREY, "dash": "solid" if own else "dot"},
                row=1,
                col=column,
            )
    figure.update_yaxes(range=window(positions, outlets))
    figure.update_yaxes(title_text="above the lower side wall [µm]", col=1)
    figure.update_xaxes(title_text="length of array [mm]", col=1)
    figure.update_xaxes(title_text="share of cells", col=2)
    return figure


BINS = 16
"""Intervals of the histogram of simulated cells."""


def checked(exits: Sequence[Row], cells: Sequence[Row], cut_um: float) -> go.Figure:
    """Predicted and simulated exits, a panel for each cell type."""
    left = [c["exit_um"] for c in cells if c["exit_um"] is not None]
    used = [r for r in exits if r["cells_high"] > 1e-3]
    low = min([*left, *(r["low_um"] for r in used), cut_um])
    high = max([*left, *(r["high_um"] for r in used), cut_um])
    width = (high - low) / BINS or 1.0
    middles = [low + (i + 0.5) * width for i in range(BINS)]

    def binned(places: Sequence[float], weights: Sequence[float]) -> list[float]:
        shares = [0.0] * BINS
        for place, weight in zip(places, weights, strict=True):
            if low <= place <= high:
                shares[min(int((place - low) / width), BINS - 1)] += weight
        return shares

    titles = [f"cell type {p}" for p in (1, 2)]
    figure = make_subplots(rows=2, shared_xaxes=True, vertical_spacing=0.12, subplot_titles=titles)
    figure.update_layout(template=TEMPLATE, height=430, barmode="overlay", bargap=0)
    for k, colour in enumerate(CELL):
        mine = [c for c in cells if c["population"] == k + 1]
        places = [c["exit_um"] for c in mine if c["exit_um"] is not None]
        predicted = [r for r in exits if r["population"] == k + 1]
        for name, shares, marker in (
            (
                "predicted",
                binned(
                    [(r["low_um"] + r["high_um"]) / 2 for r in predicted],
                    [r["cells"] for r in predicted],
                ),
                {"color": _faint(colour, 0.3), "line": {"width": 0}},
            ),
            (
                "simulated",
                binned(places, [1 / max(len(mine), 1)] * len(places)),
                {"color": _faint(colour, 0.0), "line": {"color": colour, "width": 2}},
            ),
        ):
            figure.add_bar(
                x=middles,
                y=shares,
                width=width,
                marker=marker,
                name=f"{name}, type {k + 1}",
                hovertemplate="%{x:.0f} µm: %{y:.1%}<extra></extra>",
                row=k + 1,
                col=1,
            )
        figure.add_vline(x=cut_um, line={"color": "black"}, row=k + 1, col=1)
    figure.update_yaxes(title_text="share of cells")
    figure.update_xaxes(title_text="above the lower side wall [µm]", row=2, col=1)
    return figure


def window(positions: Sequence[Row], outlets: Sequence[Row]) -> tuple[float, float]:
    """Part of the width [µm] that holds the cells and all inner walls, with a margin."""
    walls = [r["low_um"] for r in outlets][1:]
    low = min([*(r["y_05_um"] for r in positions), *walls])
    high = max([*(r["y_95_um"] for r in positions), *walls])
    margin = 0.15 * (high - low)
    return low - margin, high + margin


def _faint(colour: str, strength: float) -> str:
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},{strength})"
