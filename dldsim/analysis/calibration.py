"""A calibration as it is used: from a stiffness set to its index, from an index to a stiffness.

A calibration is a curve of one assay for one cell, index against stiffness, with its scatter; see
`passages` for how it is made.
"""

import math
import typing
from collections.abc import Iterable
from typing import Any

import numpy as np
import pandas as pd

from dldsim.config.assay_sections import CIRCULARITY, Shape
from dldsim.config.design_sections import SPRING_LEAST
from dldsim.config.explain import did_you_mean
from dldsim.errors import DldsimError
from dldsim.tables.user_values import PLAUSIBLE, as_flags, as_keys, as_numbers, check_plausible

MODULI = ["ks_uN_per_m", "kal_uN_per_m", "kb_pN_um"]
POINT = ["assay", "cell_shape", "cell_radius_um", "group"]
"""What there is one index of."""
DEFORMATION = "deformation_index"
CURVE_STEPS = 200
"""Points between two membranes at which the inverse looks."""


def join_deformation_index(outcomes: pd.DataFrame, calibration: pd.DataFrame) -> pd.DataFrame:
    """Outcomes with the index of their stiffness set in the default assay, mean and scatter.

    Outcomes that name their cell are joined with the calibration of that cell. Null where a set or
    a cell has no calibrated index. Raises DldsimError if a stiffness set has none for any cell, or
    several.
    """
    check_columns(outcomes, ["stiffness_set"])
    check_columns(calibration, ["stiffness_set", DEFORMATION, "deformation_index_std"])
    named = default_curves(calibration)
    named = named[as_keys(named["stiffness_set"]).notna()]
    names = as_keys(named["stiffness_set"])
    wanted = as_keys(outcomes["stiffness_set"])
    missing = sorted(set(wanted.fillna("")) - set(names))
    if missing:
        calibrated = ", ".join(sorted(set(names))) or "none"
        raise DldsimError(
            "Calibration: no membrane of the default assay stands for stiffness set "
            f"{', '.join(name or '(none named)' for name in missing)} (calibrated: {calibrated}).",
            key="stiffness_set",
            value=missing,
            allowed=calibrated,
            remedy="Name one of these, or choose an assay that measures the set.",
        )
    cells = [c for c in POINT[1:3] if c in outcomes and c in named and named[c].notna().all()]
    if "cell_shape" in cells and (named["cell_shape"] == "").all():
        cells = []  # published pairs hold for the cells of the publication, whatever they are
    keys = pd.DataFrame({"set": names, **{c: named[c] for c in cells}})
    doubled = keys["set"][keys.duplicated()]
    if len(doubled):
        raise DldsimError(
            f"Calibration: several indices for stiffness set {min(doubled)}.", key="stiffness_set"
        )
    asked = pd.DataFrame({"set": wanted, **{c: outcomes[c] for c in cells}})
    columns = [DEFORMATION, "deformation_index_std"]
    found = asked.merge(named[columns].assign(**keys), "left", on=list(keys))
    return outcomes.assign(**{name: found[name].to_numpy(float) for name in columns})


def with_library(tables: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """Calibrations of several tables in one; of a point that is in two, the first counts."""
    return pd.concat(tables, ignore_index=True).drop_duplicates(POINT, ignore_index=True)


def default_curves(calibration: pd.DataFrame) -> pd.DataFrame:
    """The rows of the default assay; all, of a table that tells no assays apart.

    Raises DldsimError for several assays without a default.
    """
    if "assay" not in calibration or calibration["assay"].nunique() < 2:
        return calibration
    if "default" not in calibration or not calibration["default"].any():
        raise DldsimError(
            "Calibration: the table has several assays and no default one.",
            key="default",
            allowed="true for the rows of one assay",
            remedy="Add the column default, or keep the rows of one assay.",
        )
    return calibration[calibration["default"].astype(bool)]


def stiffness_for(
    deformation_index: float,
    calibration: pd.DataFrame,
    error: float = 0.0,
    assay: str | None = None,
    *,
    shape: str | None = None,
    radius_um: float | None = None,
    key: str = DEFORMATION,
) -> dict[str, Any]:
    """Moduli of a cell with this index, ± `error`, in an assay, by default the campaign's.

    ``shape``, ``radius_um``: of the cell at rest; needed where the assay is calibrated for several.
    Between calibrated radii index and scatter of each membrane are linear in the radius. Pairs of a
    publication hold for whatever cell it measured.

    Linear interpolation between membranes that are neighbours in k_s. Keys: the moduli and for each
    `…_low` and `…_high`, between which the curve ± its scatter meets the index ± `error` (added in
    squares); `truncated` if that interval reaches the end of the calibrated range, where it may go
    on; `between` (the two membranes, or the first and last that are possible); and what the answer
    rests on: assay, index, label, cell_shape, cell_radius_um, velocity_mm_s, shear_stress_Pa.

    Where the curve takes the index more than once but all of it lies in one unbroken interval, the
    middle of those stiffnesses is meant. `key`: name of the index in the input, for errors.

    Raises DldsimError outside the calibrated range, for an assay or cell that is not calibrated, an
    index in per cent, a negative error, and where separate stiffnesses belong to the index.
    """
    calibration = _as_calibration(calibration)
    _check_measurement(deformation_index, error, key)
    assay = assay or default_curves(calibration)["assay"].iloc[0]
    curve = curve_of(calibration, assay, shape, radius_um)
    index = curve[DEFORMATION].to_numpy(float)
    if len(np.unique(index)) < 2:
        raise DldsimError(
            f"Calibration: assay {assay} has fewer than two different indices, so no stiffness can "
            "be read from one. Repair the failed passages or add membranes.",
            key="assay",
            value=assay,
        )
    low, high = index.min(), index.max()
    if not low <= deformation_index <= high:
        raise _out_of_range(deformation_index, error, curve, calibration, shape, radius_um, key)
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
    if len(exact) > 1 and not (
        unbroken and dense[first] - slack <= exact[0] and exact[-1] <= dense[last] + slack
    ):
        found = ", ".join(f"{np.interp(p, places, curve['ks_uN_per_m']):.4g}" for p in exact)
        raise DldsimError(
            f"{key} = {deformation_index:g} belongs to {len(exact)} stiffnesses, k_s = {found} "
            f"µN/m: the curve of assay {assay} is not monotone there.",
            key=key,
            value=deformation_index,
            allowed="where the calibration curve is monotone",
            remedy="Choose the stiffness directly, or another assay.",
        )
    place = (exact[0] + exact[-1]) / 2
    ends = [
        min(place, dense[first] if possible.size else place),
        max(place, dense[last] if possible.size else place),
    ]
    values = {n: float(np.interp(place, places, curve[n])) for n in MODULI}
    for name in MODULI:
        at = curve[name].to_numpy(float)
        inside = places[(places > ends[0]) & (places < ends[1])]
        seen = np.interp(np.r_[ends, inside], places, at)
        values |= {f"{name}_low": float(seen.min()), f"{name}_high": float(seen.max())}
    groups = curve["group"].tolist()
    first_row = curve.iloc[0]
    given = {name: first_row.get(name) for name in ("index", "label", *POINT[1:3])}
    flow = {
        name: float(np.interp(place, places, curve[name]))
        if name in curve and curve[name].notna().all()
        else None
        for name in ("velocity_mm_s", "shear_stress_Pa")
    }
    return values | {
        "between": (groups[math.floor(exact[0])], groups[math.ceil(exact[-1])]),
        "truncated": bool(ends[0] <= 0 or ends[1] >= places[-1]),
        "assay": assay,
        **{name: None if pd.isna(value) else value for name, value in given.items()},
        **flow,
    }


def curve_of(
    calibration: pd.DataFrame, assay: str, shape: str | None, radius_um: float | None
) -> pd.DataFrame:
    """Rows of one assay for one cell, by k_s, those without an index left out.

    Raises DldsimError for an assay or a cell that is not calibrated.
    """
    check_assay(calibration, assay)
    rows = calibration[calibration["assay"] == assay].dropna(subset=[DEFORMATION])
    shaped = "cell_shape" in rows and len(rows) and (rows["cell_shape"].fillna("") != "").all()
    if shaped:
        rows = _of_cell(rows, assay, shape, radius_um)
    return rows.sort_values("ks_uN_per_m", kind="stable").reset_index(drop=True)


def check_assay(calibration: pd.DataFrame, assay: str) -> None:
    """Refuse an assay that is not calibrated. Raises DldsimError."""
    known = list(dict.fromkeys(calibration["assay"]))
    if assay not in known:
        raise DldsimError(
            f"Calibration: no assay {assay!r}.{did_you_mean(assay, known)} Calibrated: "
            f"{', '.join(known)}.",
            key="assay",
            value=assay,
            allowed=", ".join(known),
            remedy="Name one of these, or measure it with `python -m dldsim calibrate`.",
        )


def _of_cell(
    rows: pd.DataFrame, assay: str, shape: str | None, radius_um: float | None
) -> pd.DataFrame:
    """Rows of one cell, between calibrated radii by linear interpolation."""
    shapes = list(dict.fromkeys(rows["cell_shape"]))
    if shape is None and len(shapes) == 1:
        shape = shapes[0]
    if shape not in shapes:
        raise DldsimError(
            f"Assay {assay} is calibrated for {', '.join(shapes)}"
            + (f", not {shape}." if shape else ": name the shape of the cell."),
            key="shape",
            value=shape,
            allowed=", ".join(shapes),
            remedy="" if shape is None else remedy_for_cell(assay, shape, radius_um or 7.5),
        )
    rows = rows[rows["cell_shape"] == shape]
    radii = np.unique(rows["cell_radius_um"].to_numpy(float))
    if radius_um is None and len(radii) == 1:
        radius_um = radii[0]
    if radius_um is None or not radii[0] <= radius_um <= radii[-1]:
        allowed = " to ".join(dict.fromkeys(f"{r:g}" for r in (radii[0], radii[-1]))) + " µm"
        known = radius_um is not None and radius_um > 0
        raise DldsimError(
            f"Assay {assay} is calibrated for {shape} cells of radius {allowed}"
            + (
                ": name the radius of the cell."
                if radius_um is None
                else f", not {radius_um:g} µm."
            ),
            key="radius_um",
            value=radius_um,
            allowed=allowed,
            remedy=remedy_for_cell(assay, shape, radius_um) if known else "",
        )
    below, above = radii[radii <= radius_um][-1], radii[radii >= radius_um][0]
    small, large = (
        rows[rows["cell_radius_um"] == r].drop_duplicates("group").set_index("group")
        for r in (below, above)
    )
    if below == above:
        return small.reset_index()
    share = (radius_um - below) / (above - below)
    common = small.index.intersection(large.index, sort=False)
    mixed = small.loc[common].assign(cell_radius_um=radius_um)
    for name in (DEFORMATION, "deformation_index_std"):
        mixed[name] = (1 - share) * small.loc[common, name] + share * large.loc[common, name]
    return mixed.reset_index()


def remedy_for_cell(assay: str, shape: str, *radii_um: float) -> str:
    """The command that calibrates an assay for other cells; empty for shapes that none measures."""
    if shape not in typing.get_args(Shape):
        return "Name the cell by its spring constant instead; no assay measures this shape."
    radii = " ".join(f"{radius:g}" for radius in radii_um)
    name = assay.removesuffix(CIRCULARITY)
    return f"Measure it: python -m dldsim calibrate --assay {name} --shape {shape} --radius {radii}"


def _as_calibration(table: pd.DataFrame) -> pd.DataFrame:
    """A table of anybody with its numbers as numbers, its words true and false as such.

    Raises DldsimError for what is none, for values that no cell has, and for two rows of a point.
    """
    check_columns(table, ["assay", "group", *MODULI, DEFORMATION, "deformation_index_std"])
    if not len(table):
        raise DldsimError("Calibration: the table has no rows.")
    names = [*MODULI, DEFORMATION, "deformation_index_std"]
    names += [n for n in ("velocity_mm_s", "shear_stress_Pa", "cell_radius_um") if n in table]
    numbers = {name: as_numbers(table[name], "Calibration") for name in names}
    for name in numbers.keys() & PLAUSIBLE.keys() - {DEFORMATION}:
        check_plausible(numbers[name], "Calibration")
    if (wrong := numbers[DEFORMATION].abs() >= 1).any():
        raise DldsimError(
            f"Calibration: a deformation index of {numbers[DEFORMATION][wrong].iloc[0]:g}.",
            key=DEFORMATION,
            allowed="-1 to 1",
            remedy="Give shares, not per cent.",
        )
    spread = numbers["deformation_index_std"]
    if (wrong := (spread < 0) | (spread >= 1)).any():
        raise DldsimError(
            f"Calibration: a scatter of the index of {spread[wrong].iloc[0]:g}.",
            key="deformation_index_std",
            value=float(spread[wrong].iloc[0]),
            allowed="0 or more, less than 1; empty where it was not measured",
            remedy="Give shares, not per cent.",
        )
    measured = numbers[DEFORMATION].notna()
    for name in MODULI:
        least = SPRING_LEAST if name == "ks_uN_per_m" else 0.0
        bad = measured & ~(numbers[name] >= least)
        if bad.any():
            value = numbers[name][bad].iloc[0]
            raise DldsimError(
                f"Calibration: {name} is {'empty' if np.isnan(value) else f'{value:g}'} beside an "
                "index.",
                key=name,
                value=None if np.isnan(value) else float(value),
                allowed=f"{least:g} or more",
                remedy="Give moduli in the units of their columns, and leave out the index of "
                "what was not measured.",
            )
    table = table.assign(**numbers)
    if "default" in table:
        table["default"] = [bool(flag) for flag in as_flags(table["default"], "Calibration")]
    if "cell_shape" in table:
        table["cell_shape"] = table["cell_shape"].astype(object).fillna("")
        check_columns(table, ["cell_radius_um"])
        if (measured & (table["cell_shape"] != "") & table["cell_radius_um"].isna()).any():
            raise DldsimError(
                "Calibration: cell_radius_um is empty beside a cell_shape.",
                key="cell_radius_um",
                allowed="a radius in each row with a cell_shape",
            )
    point = [name for name in POINT if name in table]
    if (twice := measured & table.duplicated(point, keep=False)).any():
        told = ", ".join(f"{name} {table.loc[twice, name].iloc[0]}" for name in point)
        raise DldsimError(
            f"Calibration: two rows with an index for {told}.",
            key="group",
            allowed="one row for each membrane of a cell in an assay",
            remedy="Leave one.",
        )
    return table


def _check_measurement(index: float, error: float, key: str) -> None:
    """Refuse an index or an error that no cell has."""
    if not (math.isfinite(index) and abs(index) <= 1):
        per_cent = math.isfinite(index) and 1 < abs(index) <= 100
        raise DldsimError(
            f"{key} = {index:g} is no deformation index.",
            key=key,
            value=index,
            allowed="-1 to 1",
            remedy=f"If it is in per cent, give {index / 100:g}." if per_cent else "",
        )
    if not (math.isfinite(error) and 0 <= error < 1):
        raise DldsimError(
            f"The error of {key} must be 0 or more and less than 1, got {error:g}.",
            key="error",
            value=error,
            allowed="0 or more, less than 1",
            remedy=f"If it is in per cent, give {error / 100:g}." if 1 <= error <= 100 else "",
        )


def _out_of_range(
    value: float,
    error: float,
    curve: pd.DataFrame,
    calibration: pd.DataFrame,
    shape: str | None,
    radius_um: float | None,
    key: str,
) -> DldsimError:
    """An index outside the curve: its range, and what else could answer it."""
    assay = curve["assay"].iloc[0]
    index = curve[DEFORMATION].to_numpy(float)
    low, high = index.min(), index.max()
    allowed = f"{low:.4g} to {high:.4g}"
    if low <= error <= high:
        swapped = f"Index and error may be swapped: {error:g} ± {value:g}? "
    else:
        swapped = ""
    others = []
    for name in dict.fromkeys(calibration["assay"]):
        try:
            other = curve_of(calibration, name, shape, radius_um)[DEFORMATION]
        except DldsimError:
            continue
        if name != assay and other.min() <= value <= other.max():
            others.append((other.max() - other.min(), name, other.min(), other.max()))
    if others:
        _, name, least, most = max(others)
        another = f"Name another assay if it was measured there: {name} ({least:.4g} to {most:.4g})"
    else:
        another = "Measure in another assay"
    softer_is_more = index[0] > index[-1]
    driven = "stress" if curve.get("kind", pd.Series([""])).iloc[0] == "shear" else "velocity"
    faster = (value < low) == softer_is_more
    beyond = "stiffer than the stiffest" if faster else "softer than the softest"
    return DldsimError(
        f"{key} = {value:g} is outside the calibrated range {allowed} of assay {assay}.",
        key=key,
        value=value,
        allowed=allowed,
        remedy=f"{swapped}{another}; or measure and calibrate at a "
        f"{'higher' if faster else 'lower'} {driven}, for a cell {beyond} membrane here.",
    )


def _crossings(index: np.ndarray, value: float) -> list[float]:
    """Where a polyline through index[0], index[1], … takes a value, as places 0 … n − 1."""
    found: list[float] = []
    for i, (a, b) in enumerate(zip(index[:-1], index[1:], strict=True)):
        if a != b and min(a, b) <= value <= max(a, b):
            place = i + (value - a) / (b - a)
            if not found or not math.isclose(place, found[-1], abs_tol=1e-9):
                found.append(float(place))
    return found


def check_columns(table: pd.DataFrame, needed: list[str]) -> None:
    """Refuse a table that lacks columns."""
    missing = [name for name in needed if name not in table]
    if missing:
        raise DldsimError(f"Calibration: the table lacks {', '.join(missing)}.")
