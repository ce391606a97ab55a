"""Regressors of the migration angle, and the card of the surrogate."""

import math

import pandas as pd

from dldsim.analysis.domain import learnt
from dldsim.analysis.regressors import ON_INDEX, SURROGATE
from dldsim.report import surrogate_figures
from dldsim.report.formats import NOT_MEASURED, decimals, fixed, number, numbers, texts
from dldsim.report.page import Grid, Page
from dldsim.report.sections.summary import card_of


def contents(page: Page) -> dict | None:
    benchmark, predictions = page["benchmark"], page["predictions"]
    if predictions.empty:
        return None
    scores = surrogate_figures.pooled_scores(predictions)
    models = list(dict.fromkeys(scores["model"]))
    best = of_all_rows(models)[0]
    splits = [s for s in ("geometry", "random", "stiffness") if (scores["split"] == s).any()]
    both = ["benchmark", "predictions"]
    return {
        "best": best,
        "errors": page.figure(
            "benchmark", surrogate_figures.draw_benchmark(scores, benchmark), both
        ),
        "splits": [
            (surrogate_figures.SPLIT_NAME[split], _split(page, models, scores, benchmark, split))
            for split in splits
        ],
        "parity": page.figure(
            "parity", surrogate_figures.draw_parity(predictions, scores, best), ["predictions"]
        ),
        "residuals": page.figure(
            "residuals", surrogate_figures.draw_residuals(predictions, best), ["predictions"]
        ),
        "conditions": page.figure(
            "conditions", surrogate_figures.draw_conditions(predictions, SURROGATE), ["predictions"]
        )
        if (predictions["model"] == SURROGATE).any()
        else None,
        "by_kind": _by_kind(page, predictions),
        "by_index": _by_index(page, predictions),
        "partial_dependence": page.figure(
            "partial_dependence",
            surrogate_figures.draw_partial_dependence(page["partial_dependence"]),
            ["partial_dependence"],
        )
        if page.some("partial_dependence")
        else None,
        **_card(page, scores),
    }


def of_all_rows(models: list[str]) -> list[str]:
    """Those that learn from all outcomes, if there are any: errors on the rows with an index alone
    are of other angles."""
    return [name for name in models if not name.endswith(ON_INDEX)] or models


def _spread(values: pd.Series, digits: int = 2) -> str:
    """Mean ± standard deviation over folds."""
    mean = number(float(values.mean()), digits)
    return f"{mean} ± {number(float(values.std()), digits)}" if len(values) > 1 else mean


def _split(
    page: Page, models: list[str], scores: pd.DataFrame, benchmark: pd.DataFrame, split: str
) -> Grid:
    """Errors and times of all models under one way to hold outcomes back."""
    folds = benchmark[benchmark["split"] == split].groupby("model")
    found = scores[scores["split"] == split].set_index("model")
    models = [m for m in models if m in found.index]
    columns: dict[str, list[str]] = {"model": texts(models), "n": numbers(found["n"][models])}
    for name, heading in (
        ("mse_deg2", "MSE [deg²]"),
        ("rmse_deg", "RMSE [°]"),
        ("mae_deg", "MAE [°]"),
    ):
        mean = folds[name].agg(_spread)
        columns[heading] = [mean.get(m, NOT_MEASURED) for m in models]
    for name, heading, places in (
        ("rmse_deg", "RMSE, pooled [°]", 2),
        ("median_deg", "median error [°]", 2),
        ("r2", "R²", 3),
    ):
        columns[heading] = [fixed(found[name].get(m, math.nan), places) for m in models]
    for name, heading in (("fit_time_s", "fit [ms]"), ("predict_time_s", "predict [ms]")):
        mean = folds[name].mean()
        columns[heading] = [number(1e3 * float(mean.get(m, math.nan)), 2) for m in models]
    return page.table(columns, ["benchmark", "predictions"])


def _by_kind(page: Page, predictions: pd.DataFrame) -> Grid | None:
    """Errors of the surrogate's regressor by cell shape, on the campaign's and the survey's."""
    found = surrogate_figures.by_kind(predictions, SURROGATE)
    if found.empty:
        return None
    return page.table(
        {
            "cells": texts(found["cell_shape"]),
            "outcomes of the": texts(found["source"]),
            "n": numbers(found["predictions"]),
            "RMSE [°]": decimals(found["rmse_deg"]),
            "median error [°]": decimals(found["median_absolute_error_deg"]),
            "R²": decimals(found["r2"], 3),
        },
        ["predictions"],
    )


def _by_index(page: Page, predictions: pd.DataFrame) -> Grid | None:
    """Regressors in the source's form, on DI, beside the same on Ca."""
    found = surrogate_figures.on_same_rows(predictions)
    if found.empty:
        return None
    columns = {"model": texts(found["model"]), "n": numbers(found["n"])}
    for name, heading, places in (
        ("rmse_deg", "RMSE [°]", 2),
        ("median_deg", "median error [°]", 2),
        ("r2", "R²", 3),
    ):
        for form, words in (("ca", "on Ca"), ("index", "on DI")):
            columns[f"{heading}, {words}"] = decimals(found[f"{name}_{form}"], places)
    return page.table(columns, ["predictions"])


def _card(page: Page, scores: pd.DataFrame) -> dict:
    """What the surrogate's card says of errors, intervals and domain."""
    card = card_of(page)
    same = scores[(scores["model"] == SURROGATE) & (scores["split"] == "geometry")]
    if card is None:
        return {"card": None, "coverage": None, "learnt": "", "same": None, "surrogate": SURROGATE}
    measured = card["conformal"]["measured"]
    coverage = page.table(
        {
            "cells": texts(m["shape"] for m in measured),
            "level": [f"{100 * m['level']:g} %" for m in measured],
            "measured coverage": [
                f"{fixed(100 * m['coverage'], 1)} ± {fixed(100 * m['coverage_error'], 1)} %"
                for m in measured
            ],
            "mean half width [°]": decimals(m["mean_half_width_deg"] for m in measured),
        }
    )
    return {
        "card": card,
        "coverage": coverage,
        "learnt": learnt(card["domain"]),
        "surrogate": SURROGATE,
        "card_link": page.link(page.results / "surrogate_card.json"),
        "same": float(same["rmse_deg"].iloc[0]) if len(same) else None,
    }
