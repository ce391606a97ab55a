"""Course of the design search: trials, importance of the parameters, slices."""

from dldsim.report import design_figures
from dldsim.report.page import Page


def contents(page: Page) -> dict | None:
    trials = page["design_trials"]
    if trials.empty:
        return None
    refused = trials[~trials["feasible"].astype(bool)]
    importance = page["design_importance"] if page.some("design_importance") else None
    slices = page.some("design_slices") and page.some("designs")
    return {
        "reasons": list(refused["reason"].fillna("").value_counts().items()),
        "history": page.figure("search", design_figures.draw_history(trials), ["design_trials"]),
        "parallel": page.figure(
            "search_parallel", design_figures.draw_parallel(trials), ["design_trials"]
        ),
        "importance": None
        if importance is None
        else page.figure(
            "search_importance", design_figures.draw_importance(importance), ["design_importance"]
        ),
        "evaluators": [] if importance is None else list(importance["evaluator"].unique()),
        "slices": page.figure(
            "search_slices",
            design_figures.draw_slices(page["design_slices"], page["designs"]),
            ["design_slices"],
        )
        if slices
        else None,
    }
