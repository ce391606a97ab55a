"""From constriction runs to a deformation index per stiffness set, and back.

Two designs stand side by side: `group-velocity`, the source paper's, in which the velocity rises
with the stiffness, and `fixed-velocity`, in which all groups share one. Within a group only the
position of release along the flow varies, as in the source; the scatter over it says nothing about
cells off the axis, other sizes or other orientations.
"""

import math
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from dldsim.config.identifiers import GROUP_VELOCITY
from dldsim.errors import DldsimError
from dldsim.tables.user_table import PLAUSIBLE, as_keys, as_numbers, check_plausible

MODULI = ["ks_uN_per_m", "kal_uN_per_m", "kb_pN_um"]
SETTINGS = ["stiffness_set", "ks_uN_per_m", "kb_pN_um", "kal_uN_per_m", "velocity_mm_s"]
DEFORMATION = "deformation_index"
CONFIDENCE = 0.95
CURVE_STEPS = 200
"""Points between two groups at which the inverse looks."""


def calibrate(constriction_runs: pd.DataFrame) -> pd.DataFrame:
    """Deformation index of each stiffness group of each design over its release positions.

    A table of kind `calibration`: mean, sample standard deviation (null for a single run), 95 %
    confidence interval of the mean (Student's t, positions taken as a random sample), least,
    largest, and coefficient of variation. Runs without an index (failed, stuck) are left out:
    `runs` counts those with one; a group without any stays, with null numbers.

    Raises DldsimError if the table is empty, lacks columns, or a group has two settings.
    """
    from scipy.stats import t

    _check_columns(constriction_runs, ["design", "group", *SETTINGS, DEFORMATION])
    if constriction_runs.empty:
        raise DldsimError("Calibration: the table of constriction runs is empty.")
    rows = []
    for (design, group), part in constriction_runs.groupby(["design", "group"]):
        varied = [name for name in SETTINGS if part[name].nunique() > 1]
        if varied:
            raise DldsimError(
                f"Calibration: group {group} of design {design} has runs of different "
                f"{', '.join(varied)}; a group is one membrane at one velocity."
            )
        values = part[DEFORMATION].dropna().astype(float)
        count, mean, spread = len(values), values.mean(), values.std(ddof=1)
        reach = np.nan
        if count > 1:
            reach = t.ppf((1 + CONFIDENCE) / 2, count - 1) * spread / count**0.5
        rows.append(
            {"design": design, "group": group}
            | part.iloc[0][SETTINGS].to_dict()
            | {
                "runs": count,
                DEFORMATION: mean,
                "deformation_index_std": spread,
                "deformation_index_low": mean - reach,
                "deformation_index_high": mean + reach,
                "deformation_index_min": values.min(),
                "deformation_index_max": values.max(),
                "coefficient_of_variation": spread / mean if mean else np.nan,
            }
        )
    order = {GROUP_VELOCITY: 0}
    rows.sort(key=lambda row: (order.get(row["design"], 1), row["design"], row["group"]))
    return pd.DataFrame(rows)


def correlations(constriction_runs: pd.DataFrame) -> pd.DataFrame:
    """Pearson correlation of every pair of deformation index, moduli and velocity, by design.

    A table of kind `calibration_correlations` over the runs with an index; null where a variable
    is constant or fewer than three runs remain. Where velocity rises with stiffness, as in the
    source paper's groups, a correlation of the index with a modulus mixes both causes.
    """
    names = [DEFORMATION, *MODULI, "velocity_mm_s"]
    _check_columns(constriction_runs, ["design", *names])
    rows = []
    for design in sorted(constriction_runs["design"].unique(), key=lambda d: d != GROUP_VELOCITY):
        part = constriction_runs[constriction_runs["design"] == design]
        data = part[names].dropna().astype(float)
        for a, b in combinations(names, 2):
            x, y = data[a].to_numpy(), data[b].to_numpy()
            varies = len(data) > 2 and min(len(np.unique(x)), len(np.unique(y))) > 1
            r = np.corrcoef(x, y)[0, 1] if varies else np.nan
            rows.append(
                {"design": design, "variable_a": a, "variable_b": b, "pearson_r": r, "n": len(data)}
            )
    return pd.DataFrame(rows)


def join_deformation_index(outcomes: pd.DataFrame, calibration: pd.DataFrame) -> pd.DataFrame:
    """Outcomes with the calibrated deformation index of their stiffness set, mean and scatter.

    Null where the calibration of a set failed. Raises DldsimError if a stiffness set is calibrated
    by no group or by several.
    """
    _check_columns(outcomes, ["stiffness_set"])
    _check_columns(calibration, ["stiffness_set", DEFORMATION, "deformation_index_std"])
    named = calibration[as_keys(calibration["stiffness_set"]).notna()]
    names = as_keys(named["stiffness_set"])
    doubled = sorted(names[names.duplicated()])
    if doubled:
        raise DldsimError(f"Calibration: several groups calibrate stiffness set {doubled[0]}.")
    wanted = as_keys(outcomes["stiffness_set"])
    missing = sorted(set(wanted.fillna("")) - set(names))
    if missing:
        calibrated = ", ".join(sorted(names)) or "none"
        raise DldsimError(
            "Calibration: no constriction group calibrates stiffness set "
            f"{', '.join(name or '(none named)' for name in missing)} (calibrated: {calibrated}).",
            key="stiffness_set",
            value=missing,
            allowed=calibrated,
            remedy="Name one of these, or calibrate the set (constriction_groups of a campaign).",
        )
    by_set = named.set_index(names)
    return outcomes.assign(
        **{
            name: wanted.map(by_set[name]).astype(float)
            for name in (DEFORMATION, "deformation_index_std")
        }
    )


def stiffness_for(
    deformation_index: float,
    calibration: pd.DataFrame,
    error: float = 0.0,
    design: str = GROUP_VELOCITY,
    *,
    key: str = DEFORMATION,
) -> dict[str, Any]:
    """Moduli and calibration velocity of a cell with this deformation index, ± `error`.

    Linear interpolation between groups that are neighbours in k_s. Keys: the moduli, velocity_mm_s,
    `between` (the two groups, or the first and last that are possible), `design`, and for each
    modulus `…_low` and `…_high`, between which the curve ± its scatter over release positions meets
    the index ± `error` (added in squares); `truncated` if that interval reaches the end of the
    calibrated range, where it may go on. The velocity belongs to the answer: an index says nothing
    about stiffness without it.

    Where the curve takes the index more than once but all of it lies in one unbroken interval, the
    middle of those stiffnesses is meant. `key`: name of the index in the input, for errors. Raises
    DldsimError outside the calibrated range, for an
    unknown design, and where separate stiffnesses belong to the index.
    """
    _check_columns(
        calibration, ["design", "group", *SETTINGS, DEFORMATION, "deformation_index_std"]
    )
    numbers = {
        n: as_numbers(calibration[n], "Calibration")
        for n in [*MODULI, "velocity_mm_s", DEFORMATION, "deformation_index_std"]
    }
    for name in numbers.keys() & PLAUSIBLE.keys():
        check_plausible(numbers[name], "Calibration")
    calibration = calibration.assign(**numbers)
    known = calibration["design"].unique()
    if design not in known:
        calibrated = ", ".join(known)
        raise DldsimError(
            f"Calibration: no design {design!r} (calibrated: {calibrated}).",
            key="design",
            value=design,
            allowed=calibrated,
        )
    curve = calibration[calibration["design"] == design].dropna(subset=[DEFORMATION])
    curve = curve.sort_values("ks_uN_per_m", kind="stable")
    index = curve[DEFORMATION].to_numpy(float)
    if len(np.unique(index)) < 2:
        raise DldsimError(
            "Calibration: fewer than two different deformation indices, so no stiffness can be "
            "read from one. Repair the failed constriction runs or add groups."
        )
    low, high = index.min(), index.max()
    if not (math.isfinite(deformation_index) and low <= deformation_index <= high):
        allowed = f"{low:.4g} to {high:.4g}"
        raise DldsimError(
            f"{key} = {deformation_index:g} is outside the calibrated range {allowed} of design "
            f"{design}.",
            key=key,
            value=deformation_index,
            allowed=allowed,
            remedy="Choose one inside, or add constriction groups beyond it.",
        )
    if not (math.isfinite(error) and error >= 0):
        raise DldsimError(
            f"The error of a deformation index must be 0 or more, got {error:g}.",
            key="error",
            value=error,
            allowed="0 or more",
        )
    places = np.arange(len(index))
    dense = np.linspace(0, places[-1], places[-1] * CURVE_STEPS + 1)
    spread = curve["deformation_index_std"].fillna(0.0).to_numpy(float)
    reach = np.hypot(error, np.interp(dense, places, spread))
    off = np.interp(dense, places, index) - deformation_index
    exact = _crossings(index, deformation_index)
    possible = np.flatnonzero(np.abs(off) <= reach)
    first, last = possible[[0, -1]] if possible.size else (0, -1)
    unbroken = possible.size == last - first + 1 and possible.size > 0
    slack = 1 / CURVE_STEPS
    columns = [*MODULI, "velocity_mm_s"]
    if len(exact) > 1 and not (
        unbroken and dense[first] - slack <= exact[0] and exact[-1] <= dense[last] + slack
    ):
        found = ", ".join(f"{np.interp(p, places, curve['ks_uN_per_m']):.4g}" for p in exact)
        raise DldsimError(
            f"{key} = {deformation_index:g} belongs to {len(exact)} stiffnesses, k_s = {found} "
            f"µN/m: the calibration curve of design {design} is not monotone there.",
            key=key,
            value=deformation_index,
            allowed="where the calibration curve is monotone",
            remedy="Choose the stiffness directly.",
        )
    place = (exact[0] + exact[-1]) / 2
    ends = [
        min(place, dense[first] if possible.size else place),
        max(place, dense[last] if possible.size else place),
    ]
    values = {n: float(np.interp(place, places, curve[n])) for n in columns}
    for name in MODULI:
        at = curve[name].to_numpy(float)
        inside = places[(places > ends[0]) & (places < ends[1])]
        seen = np.interp(np.r_[ends, inside], places, at)
        values |= {f"{name}_low": float(seen.min()), f"{name}_high": float(seen.max())}
    groups = curve["group"].tolist()
    between = groups[math.floor(exact[0])], groups[math.ceil(exact[-1])]
    return values | {
        "between": between,
        "design": design,
        "truncated": bool(ends[0] <= 0 or ends[1] >= places[-1]),
    }


def _crossings(index: np.ndarray, value: float) -> list[float]:
    """Where a polyline through index[0], index[1], … takes a value, as places 0 … n − 1."""
    found: list[float] = []
    for i, (a, b) in enumerate(zip(index[:-1], index[1:], strict=True)):
        if a != b and min(a, b) <= value <= max(a, b):
            place = i + (value - a) / (b - a)
            if not found or not math.isclose(place, found[-1], abs_tol=1e-9):
                found.append(float(place))
    return found


def _check_columns(table: pd.DataFrame, needed: list[str]) -> None:
    missing = [name for name in needed if name not in table]
    if missing:
        raise DldsimError(f"Calibration: the table lacks {', '.join(missing)}.")
