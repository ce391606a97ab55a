"""What moves the migration angle: analysis of variance and local stability of geometries.

The simulation is deterministic, so the residual of an analysis of variance here is lack of fit of
the model, not noise; p-values rank effects, they do not measure repeatability. Angles come in
modes, so that residuals are neither normal nor of one variance: `anova` gives beside each F test
one with a heteroscedasticity-consistent covariance (HC3) and one by permutation, and
`diagnostics` says how far the residuals are from what an F test assumes.
"""
from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from dldsim.errors import DldsimError
from dldsim.vocabulary import GEOMETRY

DEFORMATION = "deformation_index"
ANGLE = "migration_angle_deg"
NEEDED = [*GEOMETRY, "stiffness_set", DEFORMATION, ANGLE]

MODELS = ("main_effects", "seed_interactions", "hierarchical")
SEED_NOTE = (
    "the source paper's model, for comparison only: without main effects the interactions absorb "
    "them, and the first one also holds the overall slope of deformation_index"
)
MIN_RESIDUAL_DF = 5
"""Two-way interactions of the geometry enter the hierarchical model if as many are left."""
ROBUST_SHARE = 0.15

PERMUTATIONS = 999
LEAST_COMPLETE = 0.8
"""Share of the rows that geometries with all stiffness sets must hold for a permutation test."""

Term = tuple[str, ...]


def anova(frame: pd.DataFrame, seed: int = 1) -> pd.DataFrame:
    """Type II analysis of variance of the migration angle [deg²], a table of kind `anova`.

    See `analyse`, which does it.
    """
    return analyse(frame, seed)[0]


def analyse(frame: pd.DataFrame, seed: int = 1) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Tables of kinds `anova` and `anova_diagnostics`.

    Columns needed: those in NEEDED. Radius, gap and periodicity are categories, the deformation
    index a number. Three models: main effects; the source paper's interactions without main
    effects; the hierarchical one with main effects, their interactions with the deformation index
    and, if the design allows, the two-way interactions of the geometry. Before each the rank of
    the design matrix is checked: aliased factors are named, merged into one joint factor
    ("a & b") and tested together; what cannot be tested has null numbers and a note.

    Effect sizes are partial η² and partial ω² (Olejnik & Algina 2003, which corrects η² for the
    degrees of freedom and may be slightly negative). `p_robust`: Wald test with the HC3 covariance.
    `p_permutation`: see `_permutation`; `seed` is its.

    Raises DldsimError for missing columns, no usable rows or a constant response.
    """
    data, notes = _usable(frame)
    factors, has_index, gate_notes = _separable(data)
    notes += gate_notes
    for label, members in factors.items():
        data[label] = data.groupby(members).ngroup()
    main = [(label,) for label in factors] + [(DEFORMATION,)] * has_index
    rows = [_row(model, term, note) for model in MODELS for term, note in notes]
    tests: list[dict[str, Any]] = []
    rows += _fit("main_effects", data, main, tests, seed)

    slopes = [(DEFORMATION, label) for label in factors] if has_index else []
    if not slopes:
        rows.append(_row("seed_interactions", "all", "no interaction with deformation_index"))
    elif _rank(data, [(DEFORMATION,), *slopes]) < 1 + _width(data, [(DEFORMATION,), *slopes]):
        rows.append(_row("seed_interactions", "all", "not estimable: the design is rank-deficient"))
    else:
        rows += _fit("seed_interactions", data, slopes, tests, seed, SEED_NOTE)

    pairs = list(combinations(factors, 2))
    terms, left_out = _estimable(data, main, slopes + pairs)
    if len(data) - _rank(data, terms) < MIN_RESIDUAL_DF and set(pairs) & set(terms):
        left_out += [(pair, f"left out: fewer than {MIN_RESIDUAL_DF} residual degrees of freedom")
                     for pair in pairs if pair in terms]
        terms, unusable = _estimable(data, main, slopes)
        left_out += [item for item in unusable if item not in left_out]
    rows += [_row("hierarchical", _label(term), note) for term, note in left_out]
    rows += _fit("hierarchical", data, terms, tests, seed)
    order = {model: i for i, model in enumerate(MODELS)}
    return (pd.DataFrame(sorted(rows, key=lambda row: order[row["model"]])),
            pd.DataFrame(tests, columns=["model", "test", "statistic", "p_value", "meaning"]))


def _usable(frame: pd.DataFrame) -> tuple[pd.DataFrame, list[tuple[str, str]]]:
    """Rows with all numbers, and notes (term, text) on what was left out."""
    missing = [name for name in NEEDED if name not in frame]
    if missing:
        raise DldsimError(
            f"Analysis of variance: the table lacks {', '.join(missing)}. Needed columns: "
            f"{', '.join(NEEDED)}."
        )
    if len(frame) and frame[DEFORMATION].isna().all():
        raise DldsimError(
            "Analysis of variance: deformation_index is null in all rows, though stiffness_set is "
            "given. Join the table with the calibration first (the campaign's gather rule does), "
            "or fill the column with the deformation index of each stiffness set."
        )
    numbers = [*GEOMETRY, DEFORMATION, ANGLE]
    data = pd.DataFrame({"stiffness_set": frame["stiffness_set"].astype(str)})
    for name in numbers:
        try:
            data[name] = pd.to_numeric(frame[name]).astype(float)
        except (TypeError, ValueError) as error:
            message = f"Analysis of variance: column {name} holds text: {error}."
            raise DldsimError(message) from error
    data = data.replace([np.inf, -np.inf], np.nan)
    notes = [
        ("rows", f"{count} of {len(data)} rows left out: no {name}")
        for name in numbers if (count := int(data[name].isna().sum()))
    ]
    data = data.dropna().reset_index(drop=True)
    if data.empty:
        raise DldsimError(
            f"Analysis of variance: none of the {len(frame)} rows has all of {', '.join(numbers)}."
        )
    if np.ptp(data[ANGLE]) <= 1e-12 * np.abs(data[ANGLE]).max():
        raise DldsimError(
            f"Analysis of variance: migration_angle_deg is {data[ANGLE].iloc[0]:g} in all "
            f"{len(data)} rows; there is no variance to analyse. Widen the sweep."
        )
    return data, notes


def _separable(data: pd.DataFrame) -> tuple[dict[str, list[str]], bool, list[tuple[str, str]]]:
    """Factors (label → columns) with main effects that the design can tell apart.

    Also whether the deformation index has an effect of its own, and notes on what it has not.
    """
    notes = [(name, f"only one level ({data[name].iloc[0]:g}): no effect to estimate")
             for name in [*GEOMETRY, DEFORMATION] if data[name].nunique() == 1]
    constant = [name for name, _ in notes]
    groups = [[name] for name in GEOMETRY if name not in constant]
    has_index = DEFORMATION not in constant
    while True:
        work = data.copy()
        labels = {}
        for group in groups:
            labels[" & ".join(group)] = group
            work[" & ".join(group)] = data.groupby(group).ngroup()
        terms = [(label,) for label in labels] + [(DEFORMATION,)] * has_index
        aliased = _aliased(work, terms)
        if not aliased:
            return labels, has_index, notes
        names = [term[0] for term in aliased]
        if has_index and DEFORMATION in names:
            others = ", ".join(name for name in names if name != DEFORMATION)
            notes.append((DEFORMATION, f"follows from {others} in this table: not separable, its "
                          "effect is inside those factors"))
            has_index = False
            continue
        merged, why = _most_aliased(work, names)
        members = [name for name in GEOMETRY if any(name in labels[label] for label in merged)]
        groups = [g for g in groups if " & ".join(g) not in merged] + [members]
        groups.sort(key=lambda group: GEOMETRY.index(group[0]))
        notes += [(label, f"{why}: separate effects cannot be estimated, tested together as "
                   f"{' & '.join(members)}") for label in merged]


def _most_aliased(work: pd.DataFrame, names: Sequence[str]) -> tuple[list[str], str]:
    """The labels to merge, and why: a pair of which one determines the other, or all."""
    for a, b in combinations(names, 2):
        b_of_a = work.groupby(a)[b].nunique().max() == 1
        a_of_b = work.groupby(b)[a].nunique().max() == 1
        if a_of_b and b_of_a:
            return [a, b], f"{b} is a function of {a}, and the reverse"
        if a_of_b or b_of_a:
            return [a, b], f"{b} is a function of {a}" if b_of_a else f"{a} is a function of {b}"
    return list(names), f"{', '.join(names)} are linearly dependent in this table"


def _columns(data: pd.DataFrame, term: Term) -> np.ndarray:
    """Design columns of a term (rows × degrees of freedom): indicators without the first level."""
    block = np.ones((len(data), 1))
    for name in term:
        part = data[[name]].to_numpy(float)
        if name != DEFORMATION:
            part = (part == np.unique(part)[1:]).astype(float)
        block = (block[:, :, None] * part[:, None, :]).reshape(len(data), -1)
    return block


def _width(data: pd.DataFrame, terms: Sequence[Term]) -> int:
    return sum(_columns(data, term).shape[1] for term in terms)


def _rank(data: pd.DataFrame, terms: Sequence[Term]) -> int:
    """Rank of the design matrix of these terms and the intercept."""
    matrix = np.hstack([np.ones((len(data), 1)), *(_columns(data, term) for term in terms)])
    norm = np.linalg.norm(matrix, axis=0)
    return int(np.linalg.matrix_rank(matrix[:, norm > 0] / norm[norm > 0]))


def _aliased(data: pd.DataFrame, terms: Sequence[Term]) -> list[Term]:
    """Terms that keep fewer degrees of freedom beside the others than they have."""
    full = _rank(data, terms)
    if full == 1 + _width(data, terms):
        return []
    return [t for t in terms
            if full - _rank(data, [u for u in terms if u != t]) < _width(data, [t])]


def _estimable(
    data: pd.DataFrame, main: list[Term], interactions: list[Term]
) -> tuple[list[Term], list[tuple[Term, str]]]:
    """Main effects and those interactions that the design can tell apart; notes on the others."""
    aliased = [t for t in _aliased(data, main + interactions) if t in interactions]
    names = ", ".join(map(_label, aliased))
    return (
        main + [t for t in interactions if t not in aliased],
        [(t, f"left out: not all cells of the design are filled (aliased: {names})")
         for t in aliased],
    )


def _label(term: Term) -> str:
    """Name of a term in the table, with joint factors in brackets inside an interaction."""
    return term[0] if len(term) == 1 else ":".join(f"({n})" if "&" in n else n for n in term)


NUMBERS = ["sum_sq", "df", "f_value", "p_value", "partial_eta_sq", "partial_omega_sq", "p_robust",
           "p_permutation"]


def _row(model: str, term: str, note: str = "", **numbers: float) -> dict[str, Any]:
    return {"model": model, "term": term} | dict.fromkeys(NUMBERS, np.nan) | numbers | {
        "note": note}


def _fit(
    model: str, data: pd.DataFrame, terms: Sequence[Term], tests: list[dict[str, Any]], seed: int,
    note: str = "",
) -> list[dict[str, Any]]:
    """Rows of one model of full rank: Type II sums of squares by statsmodels; adds to `tests`."""
    if not terms:
        return [_row(model, "all", "no factor has an effect that can be estimated")]
    residual_df = len(data) - _rank(data, terms)
    if residual_df < 1:
        return [_row(model, "all", f"{len(data)} rows determine the model exactly: no residual "
                     "degrees of freedom, nothing can be tested. Add sets or geometries.")]
    from statsmodels.formula.api import ols
    from statsmodels.stats.anova import anova_lm

    names = {name: f"v{i}" for i, name in enumerate(dict.fromkeys(sum(terms, ())))}
    code = {n: v if n == DEFORMATION else f"C({v})" for n, v in names.items()}
    formula = "y ~ " + " + ".join(":".join(code[name] for name in term) for term in terms)
    fit = ols(formula, data.rename(columns=names | {ANGLE: "y"})).fit()
    table = anova_lm(fit, typ=2)
    labels = {term: ":".join(code[name] for name in term) for term in terms}
    exact = fit.ssr <= 1e-12 * fit.centered_tss
    robust = None
    if exact:
        note = "; ".join(filter(None, [note, "the model fits exactly: F is not defined"]))
    else:
        leverage = fit.get_influence().hat_matrix_diag.max()
        if leverage < 1 - 1e-8:  # HC3 divides by (1 − leverage)²
            robust = anova_lm(fit, typ=2, robust="hc3")
        tests += [{"model": model} | test for test in _diagnostics(fit, data, float(leverage))]
    permuted = {} if exact else _permutation(data, terms, seed)
    rows = []
    for term in terms:
        found = table.loc[labels[term]]
        tested = {}
        if not exact:
            error = fit.ssr / residual_df
            tested = {
                "f_value": found["F"], "p_value": found["PR(>F)"],
                "partial_omega_sq": (found["sum_sq"] - found["df"] * error)
                / (found["sum_sq"] + (len(data) - found["df"]) * error),
                "p_robust": np.nan if robust is None else robust.loc[labels[term], "PR(>F)"],
                "p_permutation": permuted.get(term, np.nan),
            }
        rows.append(_row(model, _label(term), note, sum_sq=found["sum_sq"], df=found["df"],
                         partial_eta_sq=found["sum_sq"] / (found["sum_sq"] + fit.ssr), **tested))
    return [*rows, _row(model, "residual", "lack of fit of the model: the simulation has no noise",
                        sum_sq=fit.ssr, df=float(residual_df))]


def _diagnostics(fit, data: pd.DataFrame, leverage: float) -> list[dict[str, Any]]:
    """What the residuals [deg] of a fitted model are like."""
    from scipy.stats import kurtosis, shapiro, skew
    from statsmodels.stats.diagnostic import het_breuschpagan

    residual = fit.resid.to_numpy()
    rows = []

    def add(test: str, statistic: float, p_value: float, meaning: str) -> None:
        rows.append({"test": test, "statistic": float(statistic), "p_value": float(p_value),
                     "meaning": meaning})

    none = np.nan
    add("rows", len(residual), none, "rows analysed")
    add("R²", fit.rsquared, none, "share of the variance that the model explains")
    add("adjusted R²", fit.rsquared_adj, none, "the same, corrected for degrees of freedom")
    add("residual standard deviation [°]", np.sqrt(fit.mse_resid), none, "lack of fit")
    add("largest leverage", leverage, none, "1: one row determines a coefficient, no HC3 then")
    if len(residual) <= 5000:
        w, p = shapiro(residual)
        add("Shapiro–Wilk W", w, p, "1 for normal residuals; small p: they are not normal")
    add("skewness", skew(residual), none, "0 for normal residuals")
    add("excess kurtosis", kurtosis(residual), none, "0 for normal residuals, larger: heavy tails")
    lm, p, *_ = het_breuschpagan(residual, fit.model.exog)
    add("Breusch–Pagan LM", lm, p, "small p: the residual variance depends on the factors")
    add("correlation within geometry", _intraclass(residual, data), none,
        "0: rows of one geometry are as good as independent; near 1: they count as one")
    return rows


def _intraclass(residual: np.ndarray, data: pd.DataFrame) -> float:
    """Intraclass correlation ICC(1) of residuals within geometries, null without repetitions."""
    parts = [p.to_numpy() for _, p in pd.Series(residual, data.index).groupby(
        [data[name] for name in GEOMETRY])]
    counts = np.array([len(p) for p in parts])
    if len(parts) < 2 or counts.sum() == len(parts):
        return np.nan
    size = (counts.sum() - (counts**2).sum() / counts.sum()) / (len(parts) - 1)
    means = np.array([p.mean() for p in parts])
    between = (counts * (means - residual.mean()) ** 2).sum() / (len(parts) - 1)
    within = sum(((p - p.mean()) ** 2).sum() for p in parts) / (counts.sum() - len(parts))
    total = between + (size - 1) * within
    return float((between - within) / total) if total > 0 else np.nan


def _permutation(data: pd.DataFrame, terms: Sequence[Term], seed: int) -> dict[Term, float]:
    """p-value of each term by permutation of residuals (Freedman & Lane 1983).

    The residuals of the model without the term (and without what contains it) are permuted and put
    back on its fit. Rows of one geometry share most of their lack of fit, hence what is permuted
    are whole geometries, with all their stiffness sets; for the deformation index alone, the sets
    within each geometry. Only geometries with all sets take part; empty where they hold less than
    LEAST_COMPLETE of the rows, or are fewer than five.
    """
    sets = data["stiffness_set"].nunique()
    group = data.groupby(GEOMETRY).ngroup()
    complete = (group.map(group.value_counts()) == sets) & (
        data.groupby(group)["stiffness_set"].transform("nunique") == sets)
    work = data[complete].assign(group=group[complete])
    work = work.sort_values(["group", "stiffness_set"]).reset_index(drop=True)
    count = len(work) // sets
    if count < 5 or len(work) < LEAST_COMPLETE * len(data):
        return {}
    rng = np.random.default_rng(seed)
    y = work[ANGLE].to_numpy()
    full = _basis(work, terms)
    if full.shape[1] >= len(work):
        return {}
    whole = np.argsort(rng.random((PERMUTATIONS, count)), axis=1)
    blocks = (whole[:, :, None] * sets + np.arange(sets)).reshape(PERMUTATIONS, -1)
    within = np.argsort(rng.random((PERMUTATIONS, count, sets)), axis=2)
    swaps = (np.arange(count)[:, None] * sets + within).reshape(PERMUTATIONS, -1)
    found = {}
    for term in terms:
        kept = [t for t in terms if not set(term) <= set(t)]
        beside = _basis(work, [*kept, term])  # Type II: what contains the term is left out of both
        less = _basis(work, kept)
        if term == (DEFORMATION,) and sets < 2:
            continue
        fitted = less @ (less.T @ y)
        order = swaps if term == (DEFORMATION,) else blocks
        sample = np.vstack([y, fitted + (y - fitted)[order]]).T
        gain = ((beside.T @ sample) ** 2).sum(axis=0) - ((less.T @ sample) ** 2).sum(axis=0)
        rest = (sample**2).sum(axis=0) - ((full.T @ sample) ** 2).sum(axis=0)
        ratio = gain / np.maximum(rest, 1e-300)
        found[term] = float((1 + (ratio[1:] >= ratio[0] * (1 - 1e-9)).sum()) / (1 + PERMUTATIONS))
    return found


def _basis(data: pd.DataFrame, terms: Sequence[Term]) -> np.ndarray:
    """Orthonormal columns that span the design of these terms and the intercept."""
    matrix = np.hstack([np.ones((len(data), 1)), *(_columns(data, term) for term in terms)])
    left, size, _ = np.linalg.svd(matrix / np.maximum(np.linalg.norm(matrix, axis=0), 1e-300),
                                  full_matrices=False)
    return left[:, size > 1e-10 * size[0]]


def robustness(frame: pd.DataFrame) -> pd.DataFrame:
    """Stability score of each geometry [deg²], a table of kind `robustness`.

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
        raise DldsimError("Robustness: no row has a migration angle. See the status of "
                          "the outcomes.")
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
        rows.append({
            "pillar_radius_um": geometry.iloc[0], "gap_um": geometry.iloc[1],
            "periodicity": int(geometry.iloc[2]),
            "mean_migration_angle_deg": np.nanmean(values[i]),
            "stability_score_deg2": np.mean(steps**2) if steps.size else np.nan,
            "neighbours": steps.size,
            "modes": modes.get(tuple(geometry), ""),
        })
    table = pd.DataFrame(rows)
    scores = table["stability_score_deg2"].dropna().sort_values()
    kept = max(1, round(ROBUST_SHARE * len(scores)))
    robust = table["stability_score_deg2"] <= (scores.iloc[kept - 1] if len(scores) else -np.inf)
    table.insert(6, "robust", robust)
    return table


def most_frequent(table: pd.DataFrame) -> pd.DataFrame:
    """Values of each parameter among the robust geometries of a `robustness` table.

    Columns: parameter, value, count, and `expected`, the count in a random choice of as many scored
    geometries. Ordered by parameter, most frequent first.
    """
    scored = table[table["stability_score_deg2"].notna()]
    robust = scored[scored["robust"].astype(bool)]
    rows = []
    for name in GEOMETRY:
        share = scored[name].value_counts(normalize=True)
        for value, count in robust[name].value_counts().items():
            rows.append({"parameter": name, "value": value, "count": int(count),
                         "expected": float(share[value] * len(robust))})
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
