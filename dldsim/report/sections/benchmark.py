"""Regressors of the migration angle, and the card of the surrogate."""

import math

import pandas as pd

from dldsim.analysis.regressors import SURROGATE
from dldsim.report import surrogate_figures
from dldsim.report.formats import NOT_MEASURED, decimals, fixed, number, texts
from dldsim.report.page import Grid, Page
from dldsim.report.sections.summary import card_of


def contents(page: Page) -> dict | None:
    benchmark, predictions = page["benchmark"], page["predictions"]
    if predictions.empty:
        return None
    scores = surrogate_figures.pooled_scores(predictions)
    models = list(dict.fromkeys(scores["model"]))
    splits = [s for s in ("geometry", "random", "stiffness") if (scores["split"] == s).any()]
    both = ["benchmark", "predictions"]
    return {
        "best": models[0],
        "errors": page.figure(
            "benchmark", surrogate_figures.draw_benchmark(scores, benchmark), both
        ),
        "splits": [
            (surrogate_figures.SPLIT_NAME[split], _split(page, models, scores, benchmark, split))
            for split in splits
        ],
        "parity": page.figure(
            "parity", surrogate_figures.draw_parity(predictions, scores, models[0]), ["predictions"]
        ),
        "residuals": page.figure(
            "residuals",
            surrogate_figures.draw_residuals(predictions, page["outcomes"], models[0]),
            ["predictions", "outcomes"],
        ),
        "partial_dependence": page.figure(
            "partial_dependence",
            surrogate_figures.draw_partial_dependence(page["partial_dependence"]),
            ["partial_dependence"],
        )
        if page.some("partial_dependence")
        else None,
        **_card(page, scores),
    }


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
    columns: dict[str, list[str]] = {"model": texts(models)}
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


def _card(page: Page, scores: pd.DataFrame) -> dict:
    """What the surrogate's card says of errors, intervals and domain."""
    card = card_of(page)
    same = scores[(scores["model"] == SURROGATE) & (scores["split"] == "geometry")]
    if card is None:
        return {"card": None, "coverage": None, "same": None, "surrogate": SURROGATE}
    measured = card["conformal"]["measured"]
    coverage = page.table(
        {
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
        "surrogate": SURROGATE,
        "card_link": page.link(page.results / "surrogate_card.json"),
        "same": float(same["rmse_deg"].iloc[0]) if len(same) else None,
    }
