"""Analysis of variance of the migration angle, and the surrogate's Sobol indices."""

import pandas as pd

from dldsim.report import statistics_figures, surrogate_figures
from dldsim.report.formats import (
    NOT_MEASURED,
    decimals,
    listing,
    number,
    numbers,
    probability,
    term,
    texts,
)
from dldsim.report.page import Grid, Page

MODEL_CAPTION = {
    "hierarchical": "Hierarchical model, main effects and interactions: the result.",
    "main_effects": "Main effects alone.",
    "seed_interactions": "Interactions without main effects, as in the source paper.",
    "hierarchical_ca": "The hierarchical model with ln Ca in place of DI: what acts, velocity "
    "included.",
    "main_effects_ca": "Main effects alone with ln Ca in place of DI.",
}


def contents(page: Page) -> dict:
    table = page["anova"]
    order = [*MODEL_CAPTION, *(m for m in table["model"].unique() if m not in MODEL_CAPTION)]
    return {
        "effects": page.figure("effects", statistics_figures.draw_effects(table), ["anova"])
        if table["partial_eta_sq"].notna().any()
        else None,
        "models": [
            _model(page, model, part)
            for model in order
            if len(part := table[table["model"] == model])
        ],
        "residuals": _residuals(page) if page.some("anova_diagnostics") else None,
        "sobol": page.figure("sobol", surrogate_figures.draw_sobol(page["sobol"]), ["sobol"])
        if page.some("sobol")
        else None,
        "inside": page["sobol"]["inside_share"].iloc[0] if page.some("sobol") else None,
    }


def _model(page: Page, model: str, part: pd.DataFrame) -> dict:
    shown = part[part["sum_sq"].notna()]
    noted = part[(part["note"].fillna("") != "") & (part["term"] != "residual")]
    whole = [int(df) if df == int(df) else df for df in shown["df"]]
    return {
        "caption": MODEL_CAPTION.get(model, model),
        "grid": page.table(
            {
                "term": map(term, shown["term"]),
                "sum of squares [deg²]": numbers(shown["sum_sq"], 4),
                "df": numbers(whole),
                "F": numbers(shown["f_value"], 4),
                "p": map(probability, shown["p_value"]),
                "p, HC3": map(probability, shown["p_robust"]),
                "p, permutation": map(probability, shown["p_permutation"]),
                "partial η²": decimals(shown["partial_eta_sq"], 3),
                "partial ω²": decimals(shown["partial_omega_sq"], 3),
            },
            ["anova"],
        )
        if len(shown)
        else None,
        "notes": [
            (listing(map(term, group["term"])), note)
            for note, group in noted.groupby("note", sort=False)
        ],
    }


def _residuals(page: Page) -> Grid:
    found = page["anova_diagnostics"]
    tests = found[["test", "meaning"]].drop_duplicates("test")
    columns = {"residuals": texts(tests["test"])}
    for model in found["model"].unique():
        by_test = found[found["model"] == model].set_index("test")
        columns[statistics_figures.MODEL_TITLE.get(model, model)] = [
            NOT_MEASURED
            if name not in by_test.index
            else number(float(by_test.loc[name, "statistic"]))
            + (
                ""
                if pd.isna(by_test.loc[name, "p_value"])
                else f" (p = {probability(by_test.loc[name, 'p_value'])})"
            )
            for name in tests["test"]
        ]
    return page.table(columns | {"how to read it": texts(tests["meaning"])}, ["anova_diagnostics"])
