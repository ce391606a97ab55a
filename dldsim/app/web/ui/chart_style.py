"""Colours, markers and axes that all figures of the page share; names of parameters.

Colours follow Okabe & Ito; cell types are also told apart by line and marker, modes by marker.
"""

from collections.abc import Mapping
from typing import Any

import plotly.graph_objects as go

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


def new_figure(height: int, **layout: Any) -> go.Figure:
    return go.Figure(layout={"template": TEMPLATE, "height": height, **layout})
