"""From constriction runs to a deformation index per stiffness set, and back."""

import math
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from dldsim.errors import DldsimError

MODULI = ["ks_uN_per_m", "kal_uN_per_m", "kb_pN_um"]
SETTINGS = ["stiffness_set", "ks_uN_per_m", "kb_pN_um", "kal_uN_per_m", "velocity_mm_s"]
DEFORMATION = "deformation_index"


def calibrate(constriction_runs: pd.DataFrame) -> pd.DataFrame:
    """Deformation index of each stiffness group over its release positions.

    A table of kind `calibration`: mean, sample standard deviation (null for a single run), least,
    largest, and coefficient of variation. Runs without an index (failed, stuck) are left out:
    `runs` counts those with one; a group without any stays, with null numbers.

    Raises DldsimError if the table is empty, lacks columns, or a group has two settings.
    """
    _check_columns(constriction_runs, ["group", *SETTINGS, DEFORMATION])
    if constriction_runs.empty:
        raise DldsimError("Calibration: the table of constriction runs is empty.")
    rows = []
    for group, part in constriction_runs.groupby("group"):
        varied = [name for name in SETTINGS if part[name].nunique() > 1]
        if varied:
            raise DldsimError(
                f"Calibration: group {group} has runs of different {', '.join(varied)}; a group is "
                "one membrane at one velocity. Calibrate each design by itself."
            )
        values = part[DEFORMATION].dropna().astype(float)
        mean, spread = values.mean(), values.std(ddof=1)
        rows.append(
            {"group": group}
            | part.iloc[0][SETTINGS].to_dict()
            | {
                "runs": len(values), DEFORMATION: mean, "deformation_index_std": spread,
                "deformation_index_min": values.min(), "deformation_index_max": values.max(),
                "coefficient_of_variation": spread / mean if mean else np.nan,
            }
        )
    return pd.DataFrame(rows)


def correlations(constriction_runs: pd.DataFrame) -> pd.DataFrame:
    """Pearson correlation of every pair of deformation index, moduli and velocity.

    A table of kind `calibration_correlations` over the runs with an index; null where a variable
    is constant or fewer than three runs remain. Where velocity rises with stiffness, as in the
    source paper's groups, a correlation of the index with a modulus mixes both causes.
    """
    names = [DEFORMATION, *MODULI, "velocity_mm_s"]
    _check_columns(constriction_runs, names)
    data = constriction_runs[names].dropna().astype(float)
    rows = []
    for a, b in combinations(names, 2):
        x, y = data[a].to_numpy(), data[b].to_numpy()
        varies = len(data) > 2 and min(len(np.unique(x)), len(np.unique(y))) > 1
        r = np.corrcoef(x, y)[0, 1] if varies else np.nan
        rows.append({"variable_a": a, "variable_b": b, "pearson_r": r, "n": len(data)})
    return pd.DataFrame(rows)


def join_deformation_index(runs: pd.DataFrame, calibration: pd.DataFrame) -> pd.DataFrame:
    """Runs with the calibrated deformation index of their stiffness set, mean and scatter.

    Null where the calibration of a set failed. Raises DldsimError if a stiffness set is calibrated
    by no group or by several.
    """
    _check_columns(runs, ["stiffness_set"])
    _check_columns(calibration, ["stiffness_set", DEFORMATION, "deformation_index_std"])
    named = calibration[calibration["stiffness_set"].fillna("") != ""]
    names = named["stiffness_set"].astype(str)
    doubled = sorted(names[names.duplicated()])
    if doubled:
        raise DldsimError(f"Calibration: several groups calibrate stiffness set {doubled[0]}.")
    wanted = runs["stiffness_set"].astype(str)
    missing = sorted(set(wanted) - set(names))
    if missing:
        raise DldsimError(
            f"Calibration: no constriction group calibrates stiffness set {', '.join(missing)} "
            f"(calibrated: {', '.join(sorted(names)) or 'none'}). Add a group with that "
            "stiffness_set to constriction_groups."
        )
    by_set = named.set_index(names)
    return runs.assign(
        **{name: wanted.map(by_set[name]).astype(float)
           for name in (DEFORMATION, "deformation_index_std")}
    )


def stiffness_for(deformation_index: float, calibration: pd.DataFrame) -> dict[str, Any]:
    """Moduli and calibration velocity of a cell with this deformation index.

    Linear interpolation between groups that are neighbours in k_s. Keys: the moduli, velocity_mm_s
    and `between` (the two groups). The velocity belongs to the answer: where the groups' velocities
    differ, an index says nothing about stiffness without it.

    Raises DldsimError outside the calibrated range, and where the curve takes the value more than
    once, so that no single stiffness belongs to it.
    """
    _check_columns(calibration, ["group", *SETTINGS, DEFORMATION])
    curve = calibration.dropna(subset=[DEFORMATION]).sort_values("ks_uN_per_m", kind="stable")
    index = curve[DEFORMATION].to_numpy(float)
    if len(np.unique(index)) < 2:
        raise DldsimError(
            "Calibration: fewer than two different deformation indices, so no stiffness can be "
            "read from one. Repair the failed constriction runs or add groups."
        )
    low, high = index.min(), index.max()
    if not (math.isfinite(deformation_index) and low <= deformation_index <= high):
        raise DldsimError(
            f"deformation_index {deformation_index:g} is outside the calibrated range "
            f"{low:.4g} to {high:.4g}. Choose one inside, or add constriction groups beyond it."
        )
    columns = [*MODULI, "velocity_mm_s"]
    found = []
    for i, (a, b) in enumerate(zip(index[:-1], index[1:], strict=True)):
        if a != b and min(a, b) <= deformation_index <= max(a, b):
            share = (deformation_index - a) / (b - a)
            ends = curve.iloc[[i, i + 1]]
            left, right = ends[columns].to_numpy(float)
            values = (1 - share) * left + share * right
            if not found or not np.allclose(values, [found[-1][n] for n in columns]):
                found.append(dict(zip(columns, map(float, values), strict=True))
                             | {"between": tuple(ends["group"])})
    if len(found) > 1:
        raise DldsimError(
            f"deformation_index {deformation_index:g} belongs to {len(found)} stiffnesses, k_s = "
            f"{', '.join(format(f['ks_uN_per_m'], '.4g') for f in found)} µN/m: the calibration "
            "curve is not monotone there. Choose the stiffness directly."
        )
    return found[0]


def _check_columns(table: pd.DataFrame, needed: list[str]) -> None:
    missing = [name for name in needed if name not in table]
    if missing:
        raise DldsimError(f"Calibration: the table lacks {', '.join(missing)}.")
