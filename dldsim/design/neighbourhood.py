"""What lies around candidates: angles with one thing off, and slices through the best of them."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from dldsim.design.task import Task, fixed
from dldsim.experiments.migration import mode_of
from dldsim.vocabulary import GEOMETRY

SLICE_STEPS = 33
"""Values of P_r and of P_g in the slices through the best candidate."""


def tolerances(task: Task, designs: pd.DataFrame) -> pd.DataFrame:
    """Angles, modes and separation of each candidate with one thing off; `design_tolerances`.

    `edge_um` moves every pillar edge outwards, as exposure does: the pitch, which the mask fixes,
    stays, so that P_r grows by as much and P_g shrinks by twice as much; `ks_1_uN_per_m` goes to
    the ends of the cell type's interval, within what was learnt. The separation is counted in the
    order that the candidate has as wanted. `sensitivity_deg_per_unit` is the slope between the two
    offsets.
    """
    request = task.request
    rows = []
    for _, design in designs.iterrows():
        order = 1.0 if design["angle_2_deg"] >= design["angle_1_deg"] else -1.0
        for parameter, offsets in offsets_of(task):
            found = []
            for offset in offsets:
                radius, gap, periodicity = shifted(design, parameter, offset)
                angles = []
                for k, population in enumerate(task.populations):
                    cell = population.cell
                    if parameter == f"ks_{k + 1}_uN_per_m":
                        ks = population.stiffness.ks_uN_per_m + offset
                        known = np.exp(task.known(k))
                        cell = population.cell_at(np.clip(population.capillary(ks), *known))
                    angles.append(float(task.surrogate.predict(radius, gap, periodicity, cell)[0]))
                modes = [mode_of(a, 1 / periodicity) for a in angles]
                found.append(
                    {
                        "request": request.name,
                        "design": design["design"],
                        "parameter": parameter,
                        "offset": offset,
                        "angle_1_deg": angles[0],
                        "angle_2_deg": angles[1],
                        "separation_deg": order * (angles[1] - angles[0]),
                        "mode_1": modes[0],
                        "mode_2": modes[1],
                    }
                )
            slope = (found[1]["separation_deg"] - found[0]["separation_deg"]) / np.diff(offsets)[0]
            rows += [{**row, "sensitivity_deg_per_unit": slope} for row in found]
    columns = [
        "request",
        "design",
        "parameter",
        "offset",
        "angle_1_deg",
        "angle_2_deg",
        "separation_deg",
        "mode_1",
        "mode_2",
        "sensitivity_deg_per_unit",
    ]
    return pd.DataFrame(rows, columns=columns)


def slices(task: Task, design: Mapping[str, Any]) -> pd.DataFrame:
    """Predicted separation over two parameters, the third as in the best candidate.

    A table of kind `design_slices`, one slice for each pair that the bounds leave free; signed,
    angle 2 − angle 1.
    """
    request = task.request
    low, high = request.periodicity
    axes = {
        "pillar_radius_um": np.linspace(*request.pillar_radius_um, SLICE_STEPS),
        "gap_um": np.linspace(*request.gap_um, SLICE_STEPS),
        "periodicity": np.arange(low, high + 1),
    }
    found = [pd.DataFrame(columns=SLICE_COLUMNS)]
    for x, y in (
        ("pillar_radius_um", "gap_um"),
        ("periodicity", "gap_um"),
        ("periodicity", "pillar_radius_um"),
    ):
        if {x, y} & fixed(request):
            continue
        grid = np.meshgrid(axes[x], axes[y], indexing="ij")
        at = {name: np.full(grid[0].size, float(design[name])) for name in GEOMETRY}
        at |= {x: grid[0].ravel(), y: grid[1].ravel()}
        place = [at[name] for name in GEOMETRY]
        first, second = task.angles(*place)
        limits = task.limits(*place).values()
        found.append(
            pd.DataFrame(
                {
                    "request": request.name,
                    "x_parameter": x,
                    "y_parameter": y,
                    "x": at[x].astype(float),
                    "y": at[y].astype(float),
                    "difference_deg": second - first,
                    "feasible": np.all(
                        [np.broadcast_to(v, len(first)) <= 0 for v in limits], axis=0
                    ),
                    "inside_training_domain": task.inside(*place).all(axis=0),
                }
            )
        )
    return pd.concat(found[1:] or found, ignore_index=True)


SLICE_COLUMNS = [
    "request",
    "x_parameter",
    "y_parameter",
    "x",
    "y",
    "difference_deg",
    "feasible",
    "inside_training_domain",
]


def offsets_of(task: Task) -> list[tuple[str, tuple[float, float]]]:
    """What may be off, and by how much either way; what cannot is left out."""
    width = task.request.tolerance_um
    ends = [
        *((name, (-width, width)) for name in ("pillar_radius_um", "gap_um", "edge_um")),
        *(
            (f"ks_{p.number}_uN_per_m", (p.ks_low - ks, p.ks_high - ks))
            for p in task.populations
            for ks in [p.stiffness.ks_uN_per_m]
        ),
    ]
    return [(name, (low, high)) for name, (low, high) in ends if high > low]


def shifted(design: Mapping[str, Any], parameter: str, offset: float) -> tuple[float, float, int]:
    """Geometry of a design with one thing off."""
    radius, gap = design["pillar_radius_um"], design["gap_um"]
    radius += offset if parameter in ("pillar_radius_um", "edge_um") else 0.0
    gap += {"gap_um": offset, "edge_um": -2 * offset}.get(parameter, 0.0)
    return radius, max(gap, 1e-3), int(design["periodicity"])
