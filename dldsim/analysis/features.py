"""What the regressors of the migration angle learn from: outcomes, their features, their response.

What acts on a cell in Stokes flow are ratios: lengths over the cell radius R, and the capillary
number Ca = μU/k_s, in which velocity and stiffness enter as one. So outcomes of one radius and one
velocity serve others. Moduli are taken to go along with k_s, as they do from stiffness set to
stiffness set.
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from dldsim.errors import DldsimError
from dldsim.laws import critical_diameter
from dldsim.vocabulary import GEOMETRY

FEATURES = [
    "log_size_over_critical_diameter",
    "log_confinement",
    "log_periodicity",
    "log_pillar_radius_over_cell_radius",
    "log_gap_over_pillar_diameter",
    "log_capillary_number",
    "vertical_confinement",
    "shape",
    "bump_angle_deg",
]
COLUMN = {name: place for place, name in enumerate(FEATURES)}
SHAPES = ("biconcave", "sphere", "ellipsoid")
"""Shapes at rest; the feature is the place in this list."""
CELL = ["cell_shape", "cell_radius_um", "height_um", "capillary_number"]
"""Columns of `outcomes` that say what moves in which channel, in the order of `CellInFlow`."""
INPUTS = [*GEOMETRY, *CELL]
ANGLE, INDEX = "migration_angle_deg", "deformation_index"
INDEX_SCALE = 0.05
"""Deformation indices in this unit vary as much as ln Ca does."""


class CellInFlow(NamedTuple):
    """A cell in its channel and flow, all but the array; each field one value or shape (n,)."""

    shape: Any
    radius_um: Any
    height_um: Any
    capillary_number: Any

    @property
    def vertical_confinement(self):
        """2R / channel height; 0 without top and bottom (height 0)."""
        radius, height = np.asarray(self.radius_um, float), np.asarray(self.height_um, float)
        return np.divide(
            2 * radius, height, out=np.zeros(np.broadcast(radius, height).shape), where=height > 0
        )


def shape_codes(shape) -> np.ndarray:
    """Places of shapes in SHAPES. Raises DldsimError for another."""
    names, where = np.unique(np.atleast_1d(np.asarray(shape, str)), return_inverse=True)
    if unknown := sorted(set(map(str, names)) - set(SHAPES)):
        raise DldsimError(
            f"Surrogate: no cell shape {unknown[0]!r}.",
            key="cell_shape",
            value=unknown[0],
            allowed=", ".join(SHAPES),
        )
    return np.array([SHAPES.index(n) for n in names])[where]


def features(pillar_radius_um, gap_um, periodicity, cell: CellInFlow, index=None) -> np.ndarray:
    """Features of outcomes, shape (n, len(FEATURES)); the arguments are broadcast to one length.

    Size over critical diameter is 2R/D_c with the largest radius R of the cell at rest, confinement
    2R/P_g, vertical confinement 2R/height. ``index``: deformation indices that take the place of
    ln Ca, in units of INDEX_SCALE; the source's form. Raises DldsimError for lengths and capillary
    numbers that are not positive, values that are not finite, and unknown shapes.
    """
    stiffness = cell.capillary_number if index is None else index
    named = dict(
        zip(
            [
                *GEOMETRY,
                "cell_radius_um",
                "height_um",
                "capillary_number" if index is None else INDEX,
            ],
            (pillar_radius_um, gap_um, periodicity, cell.radius_um, cell.height_um, stiffness),
            strict=True,
        )
    )
    columns = [np.atleast_1d(np.asarray(v, float)) for v in named.values()]
    for name, values in zip(named, columns, strict=True):
        if not np.isfinite(values).all():
            raise DldsimError(f"Surrogate: {name} must be a finite number.", key=name)
        if name in ("height_um", INDEX):
            wrong, allowed = values < 0, "0 or more"
        else:
            wrong, allowed = values <= 0, "positive"
        if wrong.any():
            raise DldsimError(
                f"Surrogate: {name} must be {allowed}, got {values.min():g}.",
                key=name,
                value=float(values.min()),
                allowed=allowed,
            )
    *columns, code, upright = np.broadcast_arrays(
        *columns, shape_codes(cell.shape), np.atleast_1d(cell.vertical_confinement)
    )
    radius, gap, rows, size, _, stiffness = columns
    return np.column_stack(
        [
            np.log(2 * size / critical_diameter(gap, 1 / rows)),
            np.log(2 * size / gap),
            np.log(rows),
            np.log(radius / size),
            np.log(gap / (2 * radius)),
            np.log(stiffness) if index is None else stiffness / INDEX_SCALE,
            upright,
            code,
            np.degrees(np.arctan(1 / rows)),
        ]
    )


def share_of(angle_deg, periodicity) -> np.ndarray:
    """Share of the bump displacement, tan(θ) N_p: 0 zigzag, 1 bump."""
    return np.tan(np.radians(angle_deg)) * periodicity


def angle_of(share, periodicity) -> np.ndarray:
    """Angle [deg] of a share of the bump displacement, the inverse of `share_of`."""
    return np.degrees(np.arctan(np.asarray(share) / periodicity))


# --------------------------------------------------------------------------------- outcomes learnt


def learnable(outcomes: pd.DataFrame) -> pd.DataFrame:
    """Outcomes with an angle and all inputs, in a fixed order; undecided ones included.

    Raises DldsimError for missing columns or too few usable outcomes.
    """
    needed = ["outcome_id", *INPUTS, ANGLE, "status"]
    missing = [name for name in needed if name not in outcomes]
    if missing:
        raise DldsimError(f"Surrogate: the table of outcomes lacks {', '.join(missing)}.")
    data = outcomes.dropna(subset=[*INPUTS, ANGLE])
    data = data.sort_values("outcome_id").reset_index(drop=True)
    if data.groupby(GEOMETRY).ngroups < 3 or data[ANGLE].nunique() < 2:
        causes = ", ".join(
            f"{int(outcomes[n].isna().sum())} without {n}" for n in (ANGLE, "capillary_number")
        )
        raise DldsimError(
            f"Surrogate: {len(data)} of {len(outcomes)} outcomes are usable ({causes}); at least "
            "three geometries with different angles are needed. Widen the sweep, or see why the "
            "others failed (columns status and stop_reason)."
        )
    return data


def cells_of(data: pd.DataFrame) -> CellInFlow:
    """The cells of outcomes, each field of shape (n,)."""
    return CellInFlow(*(data[name].to_numpy() for name in CELL))


def inputs_and_angles(data: pd.DataFrame, by_index: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Features (n, len(FEATURES)) and angles [deg] (n,) of learnable outcomes.

    ``by_index``: with the deformation index, which they all must have, in place of ln Ca.
    """
    place = (data[name].to_numpy(float) for name in GEOMETRY)
    index = data[INDEX].to_numpy(float) if by_index else None
    return features(*place, cells_of(data), index), data[ANGLE].to_numpy(float)


def ratios_of(data: pd.DataFrame) -> np.ndarray:
    """(P_r/R, P_g/R, N_p) of outcomes, shape (n, 3)."""
    radius = data["cell_radius_um"]
    return np.column_stack(
        [data["pillar_radius_um"] / radius, data["gap_um"] / radius, data["periodicity"]]
    ).astype(float)


def described(values: Iterable[float]) -> str:
    """Least and largest of some values, in words."""
    low, high = min(values), max(values)
    return f"{low:.3g}" if high - low <= 1e-6 * abs(high) else f"{low:.3g} to {high:.3g}"
