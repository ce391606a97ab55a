"""Where the mode changes, over the capillary number."""

import pandas as pd
from matplotlib.figure import Figure

from dldsim.report.style import key, legend, multiples, styled
from dldsim.report.surrogate_figures import SHAPE_COLOUR

SHAPE_NAME = {"biconcave": "discs", "sphere": "spheres", "ellipsoid": "ellipsoids"}

COLUMNS = 3


@styled
def draw_transition(table: pd.DataFrame, level: float) -> Figure:
    """Critical gap over Ca, a panel per N_p, with the surrogate's interval.

    table: from `dldsim.analysis.transition.transition_map`; level: that of its intervals.
    """
    rows = sorted(table["periodicity"].unique())
    figure, panels = multiples(len(rows), COLUMNS, 9.2, 3.0, sharex=True, sharey=True)
    shapes = [shape for shape in SHAPE_COLOUR if (table["cell_shape"] == shape).any()]
    for panel, periodicity in zip(panels, rows, strict=True):
        for shape in shapes:
            here = table[(table["periodicity"] == periodicity) & (table["cell_shape"] == shape)]
            ca, colour = here["capillary_number"], SHAPE_COLOUR[shape]
            low, high = here["gap_over_2R_low"], here["gap_over_2R_high"]
            panel.fill_between(ca, low, high, color=colour, alpha=0.15, linewidth=0)
            panel.plot(ca, here["gap_over_2R"], color=colour)
        panel.set(xscale="log", xlabel=r"Ca = $\mu U/k_s$", title=f"$N_p$ = {periodicity}")
    for panel in panels[::COLUMNS]:
        panel.set_ylabel(r"critical gap $P_g/2R$")
    handles = [key(SHAPE_COLOUR[s], line="-", label=SHAPE_NAME[s]) for s in shapes]
    legend(figure, [*handles, key(line="-", label=f"shade: {100 * level:g} % interval")])
    return figure
