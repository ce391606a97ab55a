"""From passages through assays to a calibration: an index per membrane, with its scatter.

Published pairs of index and stiffness set stand beside the simulated curves.
"""

import math
from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from dldsim.analysis.calibration import DEFORMATION, MODULI, POINT, check_columns
from dldsim.config.assay_sections import CIRCULARITY, TableAssay
from dldsim.config.assays import NOTHING, OFFSET, ORIENTATION, RELEASE, SIZE
from dldsim.config.sections import Stiffness
from dldsim.errors import DldsimError

SETTINGS = [
    "kind",
    "stiffness_set",
    "ks_uN_per_m",
    "kb_pN_um",
    "kal_uN_per_m",
    "velocity_mm_s",
    "shear_stress_Pa",
    "viscosity_mPa_s",
]
ROUNDNESS = "circularity_index"
BOX, ELONGATION, OUTLINE = (
    "(a − b)/(a + b) of the bounding box",
    "(L − W)/(L + W), L along the flow",
    "1 − circularity of the outline",
)
CAUSES = (RELEASE, OFFSET, SIZE, ORIENTATION)


def calibrate(
    assay_runs: pd.DataFrame,
    default_assay: str,
    published: Mapping[str, tuple[TableAssay, Mapping[str, Stiffness]]] | None = None,
) -> pd.DataFrame:
    """Index of each membrane and cell in each assay, over its passages.

    A table of kind `calibration`: mean index, and for each cause that the passages vary the sample
    standard deviation over the first passage and those of that cause (null where none varies it);
    `deformation_index_std` is all of them, added in squares. Of a channel there is a second curve,
    of 1 − circularity. Passages without an index (failed, stuck, not steady) are left out: `runs`
    counts those with one; a point without any stays, with null numbers. ``published``: pairs of
    index and stiffness set by the name of their assay, and the moduli of the sets.

    Raises DldsimError if the table is empty, lacks columns, or a point has two settings.
    """
    check_columns(assay_runs, [*POINT, *SETTINGS, "varied", DEFORMATION, ROUNDNESS])
    rows = []
    for (assay, *cell, group), part in assay_runs.groupby(POINT, sort=False):
        varied = [name for name in SETTINGS if part[name].nunique(dropna=False) > 1]
        if varied:
            raise DldsimError(
                f"Calibration: {group} in assay {assay} has runs of different "
                f"{', '.join(varied)}; a point is one membrane at one velocity."
            )
        kind = part["kind"].iloc[0]
        curves = [(assay, ELONGATION if kind == "shear" else BOX, DEFORMATION)]
        curves += [(assay + CIRCULARITY, OUTLINE, ROUNDNESS)] if kind == "channel" else []
        for name, index, column in curves:
            rows.append(
                {
                    "assay": name,
                    "default": name == default_assay,
                    **dict(zip(POINT[1:], (*cell, group), strict=True)),
                    **part.iloc[0][SETTINGS].to_dict(),
                    "index": index,
                    "label": "",
                    **_scatter(part, column),
                }
            )
    for name, (assay, sets) in (published or {}).items():
        rows += _published_rows(name, name == default_assay, assay, sets)
    if not rows:
        raise DldsimError("Calibration: the table of passages is empty.")
    table = pd.DataFrame(rows)
    order = {name: i for i, name in enumerate(table["assay"].unique())}
    table = table.sort_values("assay", key=lambda names: names.map(order), kind="stable")
    return _with_resolving_power(table.reset_index(drop=True))


def _scatter(part: pd.DataFrame, column: str) -> dict[str, Any]:
    """Mean, scatter by cause, least and largest of one index over the passages of a point."""
    seen = part.dropna(subset=[column])
    values = seen[column].astype(float)
    by_cause = {}
    for cause in CAUSES:
        some = values[seen["varied"].isin((NOTHING, cause))]
        spread = some.std(ddof=1) if (seen["varied"] == cause).any() else np.nan
        by_cause[f"std_{cause}"] = spread
    mean, spreads = values.mean(), np.array([*by_cause.values()], float)
    total = math.sqrt(np.nansum(spreads**2)) if np.isfinite(spreads).any() else np.nan
    return {
        "runs": len(values),
        DEFORMATION: mean,
        "deformation_index_std": total,
        **by_cause,
        "deformation_index_min": values.min(),
        "deformation_index_max": values.max(),
        "coefficient_of_variation": total / abs(mean) if mean else np.nan,
    }


def _published_rows(
    name: str, default: bool, assay: TableAssay, sets: Mapping[str, Stiffness]
) -> list[dict]:
    """Rows of `calibration` of published pairs."""
    nothing = dict.fromkeys([f"std_{cause}" for cause in CAUSES], np.nan)
    return [
        {
            "assay": name,
            "default": default,
            "cell_shape": "",
            "cell_radius_um": np.nan,
            "group": group,
            "kind": assay.kind,
            "stiffness_set": group,
            **sets[group].model_dump(include=set(MODULI)),
            "velocity_mm_s": np.nan,
            "shear_stress_Pa": np.nan,
            "viscosity_mPa_s": np.nan,
            "index": "as the publication defines it",
            "label": assay.label,
            "runs": 0,
            DEFORMATION: value,
            "deformation_index_std": assay.error or np.nan,
            **nothing,
            "deformation_index_min": value,
            "deformation_index_max": value,
            "coefficient_of_variation": assay.error / value if assay.error and value else np.nan,
        }
        for group, value in assay.indices.items()
    ]


def _with_resolving_power(table: pd.DataFrame) -> pd.DataFrame:
    """The table with the change of the index over the pooled standard deviation √((s₁² + s₂²)/2):
    to the next stiffer membrane, and from the softest to the stiffest."""
    table = table.assign(resolving_power=np.nan, resolving_power_all=np.nan)
    for _, part in table.groupby(POINT[:-1], dropna=False):
        curve = part.sort_values("ks_uN_per_m", kind="stable")
        index = curve[DEFORMATION].to_numpy(float)
        spread = curve["deformation_index_std"].to_numpy(float)

        def between(a, b, index=index, spread=spread):
            pooled = np.sqrt((spread[a] ** 2 + spread[b] ** 2) / 2)
            change = np.abs(index[b] - index[a])
            return np.divide(change, pooled, where=pooled > 0, out=np.full_like(change, np.nan))

        first = np.arange(len(curve) - 1)
        table.loc[curve.index[:-1], "resolving_power"] = between(first, first + 1)
        if len(curve) > 1:
            ends = np.array([0]), np.array([len(curve) - 1])
            table.loc[curve.index, "resolving_power_all"] = between(*ends)[0]
    return table


def correlations(assay_runs: pd.DataFrame) -> pd.DataFrame:
    """Pearson correlation of every pair of deformation index, moduli and velocity, by assay.

    A table of kind `calibration_correlations` over the runs with an index; null where a variable
    is constant or fewer than three runs remain. Where velocity rises with stiffness, as in the
    source paper's groups, a correlation of the index with a modulus mixes both causes.
    """
    names = [DEFORMATION, *MODULI, "velocity_mm_s"]
    check_columns(assay_runs, ["assay", *names])
    rows = []
    for assay, part in assay_runs.groupby("assay", sort=False):
        known = [name for name in names if part[name].notna().any()]
        data = part[known].dropna().astype(float)
        for a, b in combinations(known, 2):
            x, y = data[a].to_numpy(), data[b].to_numpy()
            varies = len(data) > 2 and min(len(np.unique(x)), len(np.unique(y))) > 1
            r = np.corrcoef(x, y)[0, 1] if varies else np.nan
            rows.append(
                {"assay": assay, "variable_a": a, "variable_b": b, "pearson_r": r, "n": len(data)}
            )
    return pd.DataFrame(rows)
