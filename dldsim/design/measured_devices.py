"""Angles measured on fabricated devices, learnt from beside simulated ones."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from dldsim.config.feasibility import smallest_passable_um
from dldsim.config.sections import CellShape
from dldsim.design.deformability import ks_of_index
from dldsim.design.finished_campaign import settings_of_outcomes
from dldsim.errors import DldsimError
from dldsim.experiments.migration import mode_of
from dldsim.vocabulary import GEOMETRY

MEASURED = "measured"
"""Status of a row that was measured on a fabricated device."""


def with_measurements(
    outcomes: pd.DataFrame,
    measurements: Sequence[Mapping[str, Any]],
    calibration: pd.DataFrame | None = None,
) -> pd.DataFrame:
    """The table of outcomes with measured angles below, to be learnt from like outcomes.

    A measurement has the keys MEASURED_KEYS, one of `deformation_index` (by the assay that the
    campaign's own indices come from) and `ks_uN_per_m`, and `cell_shape` unless it is a biconcave
    disc. The index gives k_s by the calibration, and this Ca with the campaign's viscosity. Of a
    measured row all other columns are null. A measured array counts as an array of its own in the
    surrogate's intervals if its size differs from those simulated.

    Raises DldsimError for keys that are missing, for an index without a calibration or outside of
    its range, and for angles that no array of that periodicity can cause.
    """
    viscosity = settings_of_outcomes(outcomes)["flow"]["viscosity_mPa_s"]
    rows = []
    for i, given in enumerate(measurements, start=1):
        at = f"measurements.{i - 1}."
        if missing := [key for key in MEASURED_KEYS if given.get(key) is None]:
            raise DldsimError(f"Measurement {i} lacks {', '.join(missing)}.", key=at + missing[0])
        bump = float(np.degrees(np.arctan(1 / given["periodicity"])))
        angle = given["migration_angle_deg"]
        if not -bump / 2 <= angle <= 1.5 * bump:
            allowed = f"{-bump / 2:.3g} to {1.5 * bump:.3g}"
            raise DldsimError(
                f"Measurement {i}: migration_angle_deg = {angle:g} with periodicity "
                f"{given['periodicity']}: allowed {allowed}. Full bump motion has {bump:.3g}°.",
                key=at + "migration_angle_deg",
                value=angle,
                allowed=allowed,
                remedy="Look at the sign, the unit and the row shift.",
            )
        _check_passes(given, i, at)
        ks = _measured_ks(given, calibration, i, at)
        _check_capillary(viscosity * given["mean_velocity_mm_s"] / ks, outcomes, given, i, at)
        rows.append(
            {
                **{key: given[key] for key in MEASURED_KEYS},
                "cell_shape": given.get("cell_shape") or "biconcave",
                "deformation_index": given.get("deformation_index"),
                "ks_uN_per_m": ks,
                "capillary_number": viscosity * given["mean_velocity_mm_s"] / ks,
                "outcome_id": f"measured-{i:04d}",
                "stiffness_set": MEASURED,
                "status": MEASURED,
                "stop_reason": "",
                "mode": mode_of(angle, 1 / given["periodicity"]),
                "pitch_um": 2 * given["pillar_radius_um"] + given["gap_um"],
                "row_shift_fraction": 1 / given["periodicity"],
                "bump_angle_deg": bump,
                "sigma_num_kind": MEASURED,
                "sigma_num_basis": MEASURED,
            }
        )
    return pd.concat(
        [
            outcomes,
            pd.DataFrame(rows, columns=outcomes.columns).astype(
                {name: kind for name, kind in outcomes.dtypes.items() if kind.kind == "f"}
            ),
        ],
        ignore_index=True,
    )


CAPILLARY_BEYOND = 10.0
"""So many times beyond those simulated may the Ca of a measured cell lie."""


def _check_passes(given: Mapping, number: int, at: str) -> None:
    """Refuse an array or a channel that the cell cannot pass. Raises DldsimError."""
    cell = CellShape(
        shape=given.get("cell_shape") or "biconcave", radius_um=given["cell_radius_um"]
    )
    least = smallest_passable_um(cell)
    for key in ("gap_um", "height_um"):
        if given[key] < least and not (key == "height_um" and given[key] == 0):
            raise DldsimError(
                f"Measurement {number}: {key} = {given[key]:g}, and a squeezed {cell.shape} cell "
                f"of radius {cell.radius_um:g} µm is about {least:.3g} µm across.",
                key=at + key,
                value=given[key],
                allowed=f"{least:.3g} or more",
                remedy="Look at the units: lengths are in µm.",
            )


def _check_capillary(
    capillary: float, outcomes: pd.DataFrame, given: Mapping, number: int, at: str
) -> None:
    """Refuse a Ca far beyond those simulated, as of a wrong unit. Raises DldsimError."""
    known = outcomes["capillary_number"].dropna()
    low, high = known.min() / CAPILLARY_BEYOND, known.max() * CAPILLARY_BEYOND
    if not low <= capillary <= high:
        each = capillary / given["mean_velocity_mm_s"]
        raise DldsimError(
            f"Measurement {number}: Ca = μU/k_s = {capillary:.3g}; simulated were "
            f"{known.min():.3g} to {known.max():.3g}.",
            key=at + "mean_velocity_mm_s",
            value=given["mean_velocity_mm_s"],
            allowed=f"{low / each:.3g} to {high / each:.3g} mm/s at this stiffness",
            remedy="Look at the units: mm/s and µN/m.",
        )


MEASURED_KEYS = (
    *GEOMETRY,
    "cell_radius_um",
    "height_um",
    "mean_velocity_mm_s",
    "migration_angle_deg",
)


def _measured_ks(given: Mapping, calibration: pd.DataFrame | None, number: int, at: str) -> float:
    """Spring constant [µN/m] of a measured cell type."""
    index, ks = given.get("deformation_index"), given.get("ks_uN_per_m")
    if (index is None) == (ks is None):
        raise DldsimError(
            f"Measurement {number}: exactly one of deformation_index and ks_uN_per_m.",
            key=(at + "deformation_index", at + "ks_uN_per_m"),
            value=(index, ks),
        )
    if ks is not None:
        return float(ks)
    shape = given.get("cell_shape") or "biconcave"
    keys = at + "deformation_index", at + "cell_shape", at + "cell_radius_um"
    return ks_of_index(index, shape, given["cell_radius_um"], calibration, keys=keys)["ks_uN_per_m"]
