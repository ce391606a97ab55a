"""Style of the report's figures, and the small parts that they share.

Every ``draw_…`` of the report takes tables (pandas) or computed data and returns a matplotlib
Figure; nothing is written there, and numbers are computed apart from drawing, so that tests can
check them. Colours follow Okabe & Ito (bump blue, zigzag vermilion, mixed green) and viridis or
cividis for ordered quantities, all safe for colour-blind readers; modes and stiffness sets are also
told apart by marker or line. Open markers and dashed lines: the motion had not settled when the
rows were spent.
"""

import functools
import io

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, LogLocator, MaxNLocator, NullFormatter

from dldsim.vocabulary import DECIDED, MODES, SETTLED

MODE_COLOUR = {"bump": "#0072B2", "mixed": "#009E73", "zigzag": "#D55E00", "none": "#7F7F7F"}
MODE_MARKER = {"bump": "o", "mixed": "D", "zigzag": "^", "none": "x"}
SET_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">")
GREY = "#5F6368"
PILLAR = "#C9CDD2"
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


COLORBAR = "<colorbar>"
"""Label that matplotlib gives the axes of a colour bar, which has ticks of its own."""


def styled(draw):
    """Apply the house style while a figure is drawn, and to its logarithmic axes."""

    @functools.wraps(draw)
    def wrapper(*args, **kwargs):
        with matplotlib.rc_context(STYLE):
            figure = draw(*args, **kwargs)
            for panel in figure.axes:
                for axis in (panel.xaxis, panel.yaxis):
                    if axis.get_scale() == "log" and panel.get_label() != COLORBAR:
                        _label_logarithm(axis)
            return figure

    return wrapper


def _label_logarithm(axis) -> None:
    """Plain numbers: even steps on less than a decade, then 1, 2 and 5, 1 and 3, and powers of ten;
    no labels between, which would overlap."""
    low, high = axis.get_view_interval()
    decades = np.log10(high / low)
    steps = (1, 2, 5) if decades < 1.3 else (1, 3) if decades < 2.5 else (1,)
    if not isinstance(axis.get_major_locator(), FixedLocator):
        axis.set_major_locator(MaxNLocator(5) if decades < 0.8 else LogLocator(subs=steps))
        if 1e-4 < low < high < 1e6:
            axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def mode_name(mode: str) -> str:
    """Migration mode as readers see it."""
    return "no mode" if mode == "none" else mode


def settled(table: pd.DataFrame) -> pd.Series:
    """True where the motion of a run, or of all releases of an outcome, has settled."""
    return table["status"].isin((*SETTLED, *DECIDED))


def measured(table: pd.DataFrame) -> pd.DataFrame:
    """Runs or outcomes that have a migration angle, settled or not."""
    return table[table["migration_angle_deg"].notna()]


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
        x,
        y,
        marker,
        color=colour,
        markerfacecolor=colour if filled else "white",
        markeredgewidth=1.1,
        **options,
    )


def key(colour=GREY, marker="none", line="none", filled=True, label=""):
    return Line2D(
        [],
        [],
        color=colour,
        marker=marker,
        linestyle=line,
        label=label,
        markeredgewidth=1.1,
        markerfacecolor=colour if filled else "white",
    )


def legend(figure, handles, **options):
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=options.pop("ncols", 5),
        columnspacing=1.4,
        handletextpad=0.5,
        **options,
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


def render(figure: Figure, kind: str) -> bytes:
    """Image file of a figure, "svg" or "png"; equal figures give equal bytes."""
    stream = io.BytesIO()
    metadata = {"svg": {"Date": None, "Creator": None}, "png": {"Software": None}}[kind]
    with matplotlib.rc_context(STYLE):
        if (engine := figure.get_layout_engine()) is not None:
            engine.execute(figure)
            figure.set_layout_engine(None)  # once: saving would draw twice, a second file differ
        figure.savefig(stream, format=kind, dpi=170, metadata=metadata, facecolor="white")
    return stream.getvalue()
