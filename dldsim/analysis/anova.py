"""What moves the migration angle: analysis of variance.

Of simulations, which repeat exactly, the residual is lack of fit of the model, and p-values rank
effects; of measurements it also holds the scatter of repeats. Angles come in modes, so that
residuals are neither normal nor of one variance: `anova` gives beside each F test one with a
heteroscedasticity-consistent covariance (HC3) and one by permutation, and `diagnostics` says how
far the residuals are from what an F test assumes.
"""

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from dldsim.analysis.anova_rows import WHERE, conditions, doubts_of_unit, usable
from dldsim.analysis.design_matrix import (
    ANGLE,
    DEFORMATION,
    LOG_CAPILLARY,
    NUMERIC,
    Term,
    aliased,
    label,
    rank,
    width,
)
from dldsim.analysis.permutation import permutation
from dldsim.errors import DldsimError
from dldsim.tables.user_values import as_numbers
from dldsim.vocabulary import GEOMETRY

MODELS = ("main_effects", "seed_interactions", "hierarchical")
BY_CAPILLARY = "_ca"
"""How the name of a model ends that has ln Ca in place of the deformation index."""
SEED_NOTE = (
    "the source paper's model, for comparison only: without main effects the interactions absorb "
    "them, and the first one also holds the overall slope of deformation_index"
)
MIN_RESIDUAL_DF = 5
"""Two-way interactions of the geometry enter the hierarchical model if as many are left."""
DESIGN_MOST = 3e7
"""Values of a design matrix that an analysis takes: they bound its time and memory."""


def anova(frame: pd.DataFrame, seed: int = 1) -> pd.DataFrame:
    """Type II analysis of variance of the migration angle [deg²], a table of kind `anova`.

    See `analyse`, which does it.
    """
    return analyse(frame, seed)[0]


def analyse(frame: pd.DataFrame, seed: int = 1) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Tables of kinds `anova` and `anova_diagnostics`.

    Columns needed: those in NEEDED; `stiffness_set`, if it is there, tells cells apart, otherwise
    the deformation index does. Radius, gap and periodicity are categories, the deformation
    index a number. Three models: main effects; the source paper's interactions without main
    effects; the hierarchical one with main effects, their interactions with the deformation index
    and, if the design allows, the two-way interactions of the geometry. Where each row tells its
    capillary number, and these differ, the first and the last again with ln Ca in place of the
    index, their names ending in BY_CAPILLARY. Before each the rank of
    the design matrix is checked: aliased factors are named, merged into one joint factor
    ("a & b") and tested together; what cannot be tested has null numbers and a note. So has every
    group of rows that is left out (term `rows`).

    Effect sizes are partial η² and partial ω² (Olejnik & Algina 2003, which corrects η² for the
    degrees of freedom and may be slightly negative). `p_robust`: Wald test with the HC3 covariance.
    `p_permutation`: see `permutation`; `seed` is its.

    Raises DldsimError for missing columns, values that a column cannot hold, rows that are there
    twice, no usable rows or a constant response.
    """
    data, places, notes = usable(frame, seed)
    if np.ptp(data[ANGLE]) <= 1e-12 * np.abs(data[ANGLE]).max():
        raise DldsimError(
            f"{WHERE}: migration_angle_deg is {data[ANGLE].iloc[0]:g} in all "
            f"{len(data)} rows; there is no variance to analyse. Widen the sweep."
        )
    notes += conditions(frame) + [(ANGLE, note) for note in doubts_of_unit(data)]
    found = _models(data, DEFORMATION, notes, seed)
    capillary = _capillary(frame, places)
    if capillary is not None:
        data[LOG_CAPILLARY] = np.log(capillary)
        told = [note for note in notes if note[0] != "mean_velocity_mm_s"]  # it is in Ca
        beside = _models(data, LOG_CAPILLARY, told, seed)
        for part in beside:
            for row in part:
                row["model"] += BY_CAPILLARY
        found = [[*first, *second] for first, second in zip(found, beside, strict=True)]
    rows, tests = found
    return (
        pd.DataFrame(rows),
        pd.DataFrame(tests, columns=["model", "test", "statistic", "p_value", "meaning"]),
    )


def _capillary(frame: pd.DataFrame, places: np.ndarray) -> np.ndarray | None:
    """Capillary numbers of these rows; None where not each has one, or all have the same."""
    if "capillary_number" not in frame:
        return None
    values = as_numbers(frame["capillary_number"].reset_index(drop=True), WHERE).to_numpy()[places]
    told = np.isfinite(values).all() and (values > 0).all() and np.ptp(values) > 0
    return values if told else None


def _models(
    data: pd.DataFrame, number: str, notes: Sequence[tuple[str, str]], seed: int
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Rows of all models with this number as a factor, and of the tests of their residuals.

    ln Ca has no model of the source's form: its tables are about the deformation index.
    """
    models = [m for m in MODELS if number == DEFORMATION or m != "seed_interactions"]
    data = data.copy()
    factors, has_number, gate_notes = _separable(data, number)
    for joint, members in factors.items():
        data[joint] = data.groupby(members).ngroup()
    main = [(name,) for name in factors] + [(number,)] * has_number
    design = data[[*factors, number]].drop_duplicates()
    rows = [_row(model, term, note) for model in models for term, note in [*notes, *gate_notes]]
    tests: list[dict[str, Any]] = []
    rows += _fit("main_effects", data, main, tests, seed)

    slopes = [(number, name) for name in factors] if has_number else []
    if number == DEFORMATION:
        if not slopes:
            why = "no interaction with deformation_index"
            rows.append(_row("seed_interactions", "all", why))
        elif rank(design, [(number,), *slopes]) < 1 + width(design, [(number,), *slopes]):
            why = "not estimable: the design is rank-deficient"
            rows.append(_row("seed_interactions", "all", why))
        else:
            rows += _fit("seed_interactions", data, slopes, tests, seed, SEED_NOTE)

    pairs = list(combinations(factors, 2))
    columns = 1 + width(design, main + slopes + pairs)
    left_out = []
    if len(data) * columns > DESIGN_MOST or len(design) * columns > DESIGN_MOST:
        why = f"left out: {columns} columns for {len(data)} rows are too many; bin the levels"
        left_out, pairs = [(pair, why) for pair in pairs], []
    terms, unusable = _estimable(design, main, slopes + pairs)
    left_out += unusable
    if len(data) - rank(design, terms) < MIN_RESIDUAL_DF and set(pairs) & set(terms):
        left_out += [
            (pair, f"left out: fewer than {MIN_RESIDUAL_DF} residual degrees of freedom")
            for pair in pairs
            if pair in terms
        ]
        terms, unusable = _estimable(design, main, slopes)
        left_out += [item for item in unusable if item not in left_out]
    rows += [_row("hierarchical", label(term), note) for term, note in left_out]
    rows += _fit("hierarchical", data, terms, tests, seed)
    order = {model: i for i, model in enumerate(MODELS)}
    return sorted(rows, key=lambda row: order[row["model"]]), tests


def _separable(
    data: pd.DataFrame, number: str
) -> tuple[dict[str, list[str]], bool, list[tuple[str, str]]]:
    """Factors (label → columns) with main effects that the design can tell apart.

    Also whether the number has an effect of its own, and notes on what it has not.
    """
    notes = [
        (name, f"only one level ({data[name].iloc[0]:g}): no effect to estimate")
        for name in [*GEOMETRY, number]
        if data[name].nunique() == 1
    ]
    constant = [name for name, _ in notes]
    groups = [[name] for name in GEOMETRY if name not in constant]
    has_number = number not in constant
    while True:
        work = data[[*GEOMETRY, number]].drop_duplicates()
        labels = {}
        for group in groups:
            labels[" & ".join(group)] = group
            work[" & ".join(group)] = work.groupby(group).ngroup()
        terms = [(label,) for label in labels] + [(number,)] * has_number
        found = aliased(work, terms)
        if not found:
            return labels, has_number, notes
        names = [term[0] for term in found]
        if has_number and number in names:
            others = ", ".join(name for name in names if name != number)
            notes.append(
                (
                    number,
                    f"follows from {others} in this table: not separable, its "
                    "effect is inside those factors",
                )
            )
            has_number = False
            continue
        merged, why = _most_aliased(work, names)
        members = [name for name in GEOMETRY if any(name in labels[label] for label in merged)]
        groups = [g for g in groups if " & ".join(g) not in merged] + [members]
        groups.sort(key=lambda group: GEOMETRY.index(group[0]))
        notes += [
            (
                label,
                f"{why}: separate effects cannot be estimated, tested together as "
                f"{' & '.join(members)}",
            )
            for label in merged
        ]


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


def _estimable(
    design: pd.DataFrame, main: list[Term], interactions: list[Term]
) -> tuple[list[Term], list[tuple[Term, str]]]:
    """Main effects and those interactions that the design can tell apart; notes on the others."""
    tied = [t for t in aliased(design, main + interactions) if t in interactions]
    names = ", ".join(map(label, tied))
    return (
        main + [t for t in interactions if t not in tied],
        [(t, f"left out: not all cells of the design are filled (aliased: {names})") for t in tied],
    )


NUMBERS = [
    "sum_sq",
    "df",
    "f_value",
    "p_value",
    "partial_eta_sq",
    "partial_omega_sq",
    "p_robust",
    "p_permutation",
]


def _row(model: str, term: str, note: str = "", **numbers: float) -> dict[str, Any]:
    return (
        {"model": model, "term": term} | dict.fromkeys(NUMBERS, np.nan) | numbers | {"note": note}
    )


def _fit(
    model: str,
    data: pd.DataFrame,
    terms: Sequence[Term],
    tests: list[dict[str, Any]],
    seed: int,
    note: str = "",
) -> list[dict[str, Any]]:
    """Rows of one model of full rank: Type II sums of squares by statsmodels; adds to `tests`."""
    if not terms:
        return [_row(model, "all", "no factor has an effect that can be estimated")]
    from statsmodels.formula.api import ols
    from statsmodels.stats.anova import anova_lm

    names = {name: f"v{i}" for i, name in enumerate(dict.fromkeys(sum(terms, ())))}
    code = {n: v if n in NUMERIC else f"C({v})" for n, v in names.items()}
    formula = "y ~ " + " + ".join(":".join(code[name] for name in term) for term in terms)
    fit = ols(formula, data.rename(columns=names | {ANGLE: "y"})).fit()
    residual_df = int(fit.df_resid)  # interactions without main effects have all levels
    if residual_df < 1:
        return [
            _row(
                model,
                "all",
                f"{len(data)} rows determine the model exactly: no residual "
                "degrees of freedom, nothing can be tested. Add sets or geometries.",
            )
        ]
    table = anova_lm(fit, typ=2)
    labels = {term: ":".join(code[name] for name in term) for term in terms}
    exact = fit.ssr <= 1e-12 * fit.centered_tss
    robust, permuted, remarks = None, {}, []
    if exact:
        note = "; ".join(filter(None, [note, "the model fits exactly: F is not defined"]))
    else:
        leverage = fit.get_influence().hat_matrix_diag.max()
        if leverage < 1 - 1e-8:  # HC3 divides by (1 − leverage)²
            robust = anova_lm(fit, typ=2, robust="hc3")
        else:
            remarks.append(("p_robust", "none: one row determines a coefficient (leverage 1)"))
        tests += [{"model": model} | test for test in _diagnostics(fit, data, float(leverage))]
        permuted, why = permutation(data, terms, seed)
        remarks += [("p_permutation", note) for note in why]
    rows = []
    for term in terms:
        found = table.loc[labels[term]]
        tested = {}
        if not exact:
            error = fit.ssr / residual_df
            tested = {
                "f_value": found["F"],
                "p_value": found["PR(>F)"],
                "partial_omega_sq": (found["sum_sq"] - found["df"] * error)
                / (found["sum_sq"] + (len(data) - found["df"]) * error),
                "p_robust": np.nan if robust is None else robust.loc[labels[term], "PR(>F)"],
                "p_permutation": permuted.get(term, np.nan),
            }
        rows.append(
            _row(
                model,
                label(term),
                note,
                sum_sq=found["sum_sq"],
                df=found["df"],
                partial_eta_sq=found["sum_sq"] / (found["sum_sq"] + fit.ssr),
                **tested,
            )
        )
    rows += [_row(model, term, remark) for term, remark in remarks]
    return [
        *rows,
        _row(model, "residual", _pure_error(data), sum_sq=fit.ssr, df=float(residual_df)),
    ]


def _pure_error(data: pd.DataFrame) -> str:
    """What the residual is: lack of fit, and the scatter of rows that repeat each other."""
    repeats = data.groupby([*GEOMETRY, DEFORMATION, "stiffness_set"])[ANGLE]
    df = len(data) - repeats.ngroups
    if not df:
        return (
            "lack of fit of the model and scatter of the data, which no row repeats; of "
            "simulations, which repeat exactly, all of it is lack of fit"
        )
    scatter = float((repeats.var(ddof=0) * repeats.size()).sum())
    return (
        f"lack of fit of the model, and scatter of repeated rows: sum of squares {scatter:.4g} "
        f"with {df} degrees of freedom"
    )


def _diagnostics(fit, data: pd.DataFrame, leverage: float) -> list[dict[str, Any]]:
    """What the residuals [deg] of a fitted model are like."""
    from scipy.stats import kurtosis, shapiro, skew
    from statsmodels.stats.diagnostic import het_breuschpagan

    residual = fit.resid.to_numpy()
    rows = []

    def add(test: str, statistic: float, p_value: float, meaning: str) -> None:
        rows.append(
            {
                "test": test,
                "statistic": float(statistic),
                "p_value": float(p_value),
                "meaning": meaning,
            }
        )

    none = np.nan
    add("rows", len(residual), none, "rows analysed")
    add("R²", fit.rsquared, none, "share of the variance that the model explains")
    add("adjusted R²", fit.rsquared_adj, none, "the same, corrected for degrees of freedom")
    add("residual standard deviation [°]", np.sqrt(fit.mse_resid), none, "lack of fit and scatter")
    add("largest leverage", leverage, none, "1: one row determines a coefficient, no HC3 then")
    if len(residual) <= 5000:
        w, p = shapiro(residual)
        add("Shapiro–Wilk W", w, p, "1 for normal residuals; small p: they are not normal")
    add("skewness", skew(residual), none, "0 for normal residuals")
    add("excess kurtosis", kurtosis(residual), none, "0 for normal residuals, larger: heavy tails")
    lm, p, *_ = het_breuschpagan(residual, fit.model.exog)
    add("Breusch–Pagan LM", lm, p, "small p: the residual variance depends on the factors")
    add(
        "correlation within geometry",
        _intraclass(residual, data),
        none,
        "0: rows of one geometry are as good as independent; near 1: they count as one",
    )
    return rows


def _intraclass(residual: np.ndarray, data: pd.DataFrame) -> float:
    """Intraclass correlation ICC(1) of residuals within geometries, null without repetitions."""
    parts = [
        p.to_numpy()
        for _, p in pd.Series(residual, data.index).groupby([data[name] for name in GEOMETRY])
    ]
    counts = np.array([len(p) for p in parts])
    if len(parts) < 2 or counts.sum() == len(parts):
        return np.nan
    size = (counts.sum() - (counts**2).sum() / counts.sum()) / (len(parts) - 1)
    means = np.array([p.mean() for p in parts])
    between = (counts * (means - residual.mean()) ** 2).sum() / (len(parts) - 1)
    within = sum(((p - p.mean()) ** 2).sum() for p in parts) / (counts.sum() - len(parts))
    total = between + (size - 1) * within
    return float((between - within) / total) if total > 0 else np.nan
