"""Conformal intervals of shares of the bump displacement, shape by shape.

Geometries, not outcomes, are the units that are exchangeable.
"""

from collections.abc import Mapping

import numpy as np

SPREAD_FLOOR = 0.01
"""Least variance of a share in the scores: near the limits errors are small, but not zero."""


def spread_of(share) -> np.ndarray:
    """Scale of the error of a predicted share s: √(s (1 − s) + floor), largest half way."""
    share = np.clip(share, 0, 1)
    return np.sqrt(share * (1 - share) + SPREAD_FLOOR)


def conformal_factor(scores: list[list[float]], level: float) -> float:
    """Smallest q so that a share level of scores of a new geometry is below q; inf if too few.

    `scores` holds those of each geometry. Every geometry has equal weight, and one more of unknown,
    infinite score stands for the new one (hierarchical conformal prediction, Lee, Barber & Willett,
    arXiv:2306.06342, eq. 4).
    """
    if not scores:
        return float("inf")
    values = np.concatenate([np.asarray(s, float) for s in scores])
    weights = np.concatenate([np.full(len(s), 1 / len(s)) for s in scores]) / (len(scores) + 1)
    order = np.argsort(values)
    reached = np.flatnonzero(np.cumsum(weights[order]) >= level - 1e-12)
    return float(values[order][reached[0]]) if reached.size else float("inf")


def scores_of(
    predicted: np.ndarray, observed: np.ndarray, groups: np.ndarray, shape: np.ndarray
) -> dict[str, list[list[float]]]:
    """Error of shares over its scale, by shape and group."""
    score = np.abs(observed - predicted) / spread_of(predicted)
    return {
        str(name): [score[(shape == name) & (groups == g)].tolist() for g in np.unique(groups[own])]
        for name in np.unique(shape)
        for own in [shape == name]
    }


def factors_of(scores: Mapping[str, list[list[float]]], level: float) -> dict[str, float]:
    """`conformal_factor` of each shape."""
    return {shape: conformal_factor(own, level) for shape, own in scores.items()}


def reach_of(factors: Mapping[str, float], shape, share) -> np.ndarray:
    """Half-width of the interval of shares, (n,); infinite for shapes without scores."""
    names, where = np.unique(shape, return_inverse=True)
    return np.array([factors.get(name, np.inf) for name in names])[where] * spread_of(share)
