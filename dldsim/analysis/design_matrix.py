"""Design matrices of linear models of the migration angle: columns, ranks, what is aliased.

Radius, gap and periodicity are categories; the deformation index and the logarithm of the
capillary number are numbers.
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd

DEFORMATION, LOG_CAPILLARY = "deformation_index", "log_capillary_number"
NUMERIC = (DEFORMATION, LOG_CAPILLARY)
"""Factors that are numbers; a model has one of them at most."""
ANGLE = "migration_angle_deg"

Term = tuple[str, ...]
"""Names of the factors of an effect; several are an interaction."""


def columns(data: pd.DataFrame, term: Term) -> np.ndarray:
    """Design columns of a term (rows × degrees of freedom): indicators without the first level."""
    block = np.ones((len(data), 1))
    for name in term:
        part = data[[name]].to_numpy(float)
        if name not in NUMERIC:
            part = (part == np.unique(part)[1:]).astype(float)
        block = (block[:, :, None] * part[:, None, :]).reshape(len(data), -1)
    return block


def width(data: pd.DataFrame, terms: Sequence[Term]) -> int:
    """Number of design columns of these terms, without the intercept."""
    levels = {n: 1 if n in NUMERIC else data[n].nunique() - 1 for t in terms for n in t}
    return sum(int(np.prod([levels[n] for n in term])) for term in terms)


def matrix(data: pd.DataFrame, terms: Sequence[Term]) -> np.ndarray:
    """Design matrix of these terms and the intercept, columns of length one or zero."""
    found = np.hstack([np.ones((len(data), 1)), *(columns(data, term) for term in terms)])
    return found / np.maximum(np.linalg.norm(found, axis=0), 1e-300)


def rank(data: pd.DataFrame, terms: Sequence[Term]) -> int:
    """Rank of the design matrix of these terms and the intercept."""
    names = list(dict.fromkeys(name for term in terms for name in term))
    rows = data[names].drop_duplicates() if names else data[:1]
    return int(np.linalg.matrix_rank(matrix(rows, terms)))


def basis(data: pd.DataFrame, terms: Sequence[Term]) -> np.ndarray:
    """Orthonormal columns that span the design of these terms and the intercept."""
    left, size, _ = np.linalg.svd(matrix(data, terms), full_matrices=False)
    return left[:, size > 1e-10 * size[0]]


def aliased(data: pd.DataFrame, terms: Sequence[Term]) -> list[Term]:
    """Terms that keep fewer degrees of freedom beside the others than they have."""
    full = rank(data, terms)
    if full == 1 + width(data, terms):
        return []
    return [t for t in terms if full - rank(data, [u for u in terms if u != t]) < width(data, [t])]


def label(term: Term) -> str:
    """Name of a term in the table, with joint factors in brackets inside an interaction."""
    return term[0] if len(term) == 1 else ":".join(f"({n})" if "&" in n else n for n in term)
