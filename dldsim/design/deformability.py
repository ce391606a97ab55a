"""What a calibration tells of a cell: from deformation index to stiffness, and back."""

from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from dldsim.analysis.calibration import curve_of, default_curves, stiffness_for
from dldsim.errors import DldsimError
from dldsim.tables.user_values import as_keys

SLIT = "constriction"
"""Kind of the assays whose index is that of a cell squeezed between walls."""


def ks_of_index(
    index: float | None,
    shape: str,
    radius_um: float,
    calibration: pd.DataFrame | None,
    error: float = 0.0,
    assay: str | None = None,
    *,
    keys: tuple[str, str, str],
) -> dict[str, Any]:
    """Stiffness and its interval for a deformation index ± error, as `stiffness_for` gives them.

    ``keys``: names of index, shape and radius in the input, for errors. Raises DldsimError as
    `stiffness_for` does, and without a calibration.
    """
    key, *of_cell = keys
    if calibration is None or index is None:
        raise DldsimError(
            f"{key}: a deformation index needs a calibration to tell the stiffness.",
            key=key,
            value=index,
            allowed="a stiffness set or a spring constant, without a calibration",
            remedy="Name the cell type by a stiffness set or a spring constant, or add the table "
            "calibration.",
        )
    try:
        return stiffness_for(
            index, calibration, error, assay, shape=shape, radius_um=radius_um, key=key
        )
    except DldsimError as refused:
        named = dict(zip(("shape", "radius_um"), of_cell, strict=True))
        refused.keys = tuple(named.get(name, name) for name in refused.keys)
        raise


class Seen(NamedTuple):
    """What an assay would see of a cell."""

    assay: str
    kind: str
    deformation_index: float


def seen_at(
    ks_uN_per_m: float,
    shape: str,
    radius_um: float,
    calibration: pd.DataFrame | None,
    assay: str | None = None,
) -> Seen | None:
    """Deformation index that an assay, by default the calibration's, has at a k_s.

    None where it was not calibrated there, or for no such cell.
    """
    if calibration is None:
        return None
    try:
        by = assay or default_curves(calibration)["assay"].iloc[0]
        curve = curve_of(calibration, by, shape, radius_um)
    except DldsimError:
        return None
    ks, values = curve["ks_uN_per_m"].to_numpy(float), curve["deformation_index"].to_numpy(float)
    if not len(ks) or not ks[0] <= ks_uN_per_m <= ks[-1]:
        return None
    kind = curve["kind"].iloc[0] if "kind" in curve else ""
    return Seen(by, kind, float(np.interp(ks_uN_per_m, ks, values)))


def default_assay(calibration: pd.DataFrame | None) -> str:
    """The assay by which a calibration is read unless another one is named; "" without one."""
    return "" if calibration is None else str(default_curves(calibration)["assay"].iloc[0])


def radius_range(
    shape: str, calibration: pd.DataFrame | None, assay: str | None = None
) -> tuple[float, float]:
    """Least and largest radius [µm] of such cells that an assay is calibrated for; 0 and infinity
    where it holds for any cell, or there is none to tell."""
    if calibration is not None and "cell_shape" in calibration:
        by = assay or default_assay(calibration)
        rows = calibration[(calibration["assay"] == by) & (calibration["cell_shape"] == shape)]
        radii = rows["cell_radius_um"].dropna()
        if len(radii):
            return float(radii.min()), float(radii.max())
    return 0.0, float("inf")


def index_range(
    shape: str, radius_um: float, calibration: pd.DataFrame | None, assay: str | None = None
) -> tuple[float, float]:
    """Least and largest deformation index that an assay is calibrated for.

    Raises DldsimError without a calibration, or for an assay that is not in it.
    """
    if calibration is None:
        raise DldsimError(
            "deformation_index: there is no calibration to read a stiffness from.",
            key="assay",
            value=assay,
            allowed="ks_uN_per_m instead of a deformation index",
        )
    by = assay or default_curves(calibration)["assay"].iloc[0]
    index = curve_of(calibration, by, shape, radius_um)["deformation_index"].dropna()
    return float(index.min()), float(index.max())


def ks_of_sets(calibration: pd.DataFrame | None) -> dict[str, float]:
    """Spring constant of each stiffness set that a calibration names."""
    if calibration is None:
        return {}
    names = as_keys(calibration["stiffness_set"])
    named = calibration[names.notna()].assign(stiffness_set=names)
    return (
        named.drop_duplicates("stiffness_set").set_index("stiffness_set")["ks_uN_per_m"].to_dict()
    )
