"""How much the migration angle changes from an array to its neighbours: the source's robustness."""

import numpy as np
import pandas as pd

from dldsim.analysis.design_matrix import ANGLE
from dldsim.errors import DldsimError
from dldsim.vocabulary import GEOMETRY

ROBUST_SHARE = 0.15


def robustness(frame: pd.DataFrame) -> pd.DataFrame:
    """Robustness score of each geometry [deg²], a table of kind `robustness`.

    S is the mean squared difference of the migration angle to the neighbours (source paper's
    stability mapping). A neighbour has the nearest lower or higher value of one parameter that is
    present with the two others equal; parameters of which one determines the other (gap = radius
    + 10 µm) are varied together, since nothing else is in the data. The angle of a geometry is its
    mean over stiffness sets; differences are taken over the sets that both geometries have, lest a
    failed run look like sensitivity. Without a neighbour S is null. `robust` marks the lowest 15 %
    of the scored geometries (at least one, ties included). The score depends on the grid's steps,
    and an array in which nothing happens is stable too.

    Raises DldsimError for missing columns or no angle at all.
    """
    missing = [n for n in [*GEOMETRY, "stiffness_set", ANGLE] if n not in frame]
    if missing:
        raise DldsimError(f"Robustness: the table lacks {', '.join(missing)}.")
    data = frame.dropna(subset=[*GEOMETRY, ANGLE])
    if data.empty:
        raise DldsimError(
            "Robustness: no row has a migration angle. See the status of the outcomes."
        )
    angles = data.pivot_table(index=GEOMETRY, columns="stiffness_set", values=ANGLE)
    modes = _modes(data)
    geometries = pd.DataFrame(angles.index.tolist(), columns=GEOMETRY)
    neighbours = _neighbours(geometries)
    values = angles.to_numpy()
    rows = []
    for i, geometry in geometries.iterrows():
        differences = values[neighbours[i]] - values[i]
        differences = differences[~np.isnan(differences).all(axis=1)]
        steps = np.nanmean(differences, axis=1) if len(differences) else np.array([])
        rows.append(
            {
                "pillar_radius_um": geometry.iloc[0],
                "gap_um": geometry.iloc[1],
                "periodicity": int(geometry.iloc[2]),
                "mean_migration_angle_deg": np.nanmean(values[i]),
                "robustness_score_deg2": np.mean(steps**2) if steps.size else np.nan,
                "neighbours": steps.size,
                "modes": modes.get(tuple(geometry), ""),
            }
        )
    table = pd.DataFrame(rows)
    scores = table["robustness_score_deg2"].dropna().sort_values()
    kept = max(1, round(ROBUST_SHARE * len(scores)))
    robust = table["robustness_score_deg2"] <= (scores.iloc[kept - 1] if len(scores) else -np.inf)
    table.insert(6, "robust", robust)
    return table


def most_frequent(table: pd.DataFrame) -> pd.DataFrame:
    """Values of each parameter among the robust geometries of a `robustness` table.

    Columns: parameter, value, count, and `expected`, the count in a random choice of as many scored
    geometries. Ordered by parameter, most frequent first.
    """
    scored = table[table["robustness_score_deg2"].notna()]
    robust = scored[scored["robust"].astype(bool)]
    rows = []
    for name in GEOMETRY:
        share = scored[name].value_counts(normalize=True)
        for value, count in robust[name].value_counts().items():
            rows.append(
                {
                    "parameter": name,
                    "value": value,
                    "count": int(count),
                    "expected": float(share[value] * len(robust)),
                }
            )
    return pd.DataFrame(rows, columns=["parameter", "value", "count", "expected"])


def _modes(data: pd.DataFrame) -> dict[tuple, str]:
    """Modes of each geometry with their counts: "bump 2, zigzag 1"."""
    if "mode" not in data:
        return {}
    return {
        key: ", ".join(f"{mode} {n}" for mode, n in sorted(group.value_counts().items()))
        for key, group in data.groupby(GEOMETRY)["mode"]
    }


def _neighbours(geometries: pd.DataFrame) -> list[list[int]]:
    """Positions of each geometry's one-parameter neighbours."""
    found: list[list[int]] = [[] for _ in range(len(geometries))]
    axes = axes_of(geometries)
    for axis in axes:
        others = [name for other in axes if other != axis for name in other]
        ordered = geometries.sort_values(axis)
        for _, line in ordered.groupby(others) if others else [(None, ordered)]:
            for a, b in zip(line.index[:-1], line.index[1:], strict=True):
                found[a].append(b)
                found[b].append(a)
    return found


def axes_of(geometries: pd.DataFrame) -> list[list[str]]:
    """Parameters that vary, those that determine each other on one axis."""
    axes: list[list[str]] = []
    for name in GEOMETRY:
        if geometries[name].nunique() == 1:
            continue
        for axis in axes:
            levels = geometries[[axis[0], name]].drop_duplicates()
            if levels[axis[0]].is_unique and levels[name].is_unique:
                axis.append(name)
                break
        else:
            axes.append([name])
    return axes
