"""Figures of calibrations: what each assay tells apart."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from dldsim.report.style import key, legend, multiples, shades_of, styled


@styled
def draw_curves(calibration: pd.DataFrame) -> Figure:
    """Index against k_s with its scatter, a panel per assay and a line per cell; in brackets the
    change from the softest to the stiffest over the pooled standard deviation, cell by cell."""
    seen = calibration[calibration["deformation_index"].notna()]
    assays = list(dict.fromkeys(seen["assay"]))
    figure, panels = multiples(len(assays), 3, 9.2, 2.6)
    cells = seen["cell_shape"] + seen["cell_radius_um"].map(lambda r: f", R {r:g} µm")
    cells = cells.where(seen["cell_shape"] != "", "cell of the publication")
    colours = shades_of(cells)
    for panel, assay in zip(panels, assays, strict=True):
        mine = seen["assay"] == assay
        powers = []
        for cell in dict.fromkeys(cells[mine]):
            part = seen[mine & (cells == cell)].sort_values("ks_uN_per_m")
            panel.errorbar(
                part["ks_uN_per_m"],
                part["deformation_index"],
                part["deformation_index_std"].fillna(0.0),
                fmt="o-",
                color=colours[cell],
                markersize=3.5,
                linewidth=1,
                capsize=2,
            )
            if np.isfinite(power := part["resolving_power_all"].iloc[0]):
                powers.append(f"{power:.1f}")
        panel.set_title(f"{assay} (default)" if part["default"].any() else assay)
        panel.set_xscale("log")
        resolved = f"   ({', '.join(powers)} s.d.)" if powers else ""
        panel.set_xlabel(f"$k_s$ [µN/m]{resolved}")
        panel.set_ylabel("index")
    legend(figure, [key(c, "o", label=name) for name, c in colours.items()], ncols=4)
    return figure
