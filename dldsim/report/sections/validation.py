"""Validation cases: errors, orders, and what misses its mark."""

from collections.abc import Callable, Iterable

from dldsim.evidence.validation import CASES, verdicts
from dldsim.report import validation_cell_figures, validation_figures
from dldsim.report.formats import NOT_MEASURED, fixed, number, numbers, percent, records, texts
from dldsim.report.page import Grid, Page

FIGURES = (
    (
        "convergence",
        {"square-arrays", "row-shifted-arrays", "duct-poiseuille"},
        validation_figures.draw_convergence,
    ),
    ("square_arrays", {"square-arrays"}, validation_figures.draw_square_arrays),
    ("tilts", {"row-shifted-arrays", "finite-height-arrays"}, validation_figures.draw_tilts),
    ("stretching", {"erythrocyte-stretching"}, validation_cell_figures.draw_stretching),
    ("capsules", {"capsule-in-shear"}, validation_cell_figures.draw_capsules),
    ("transition", {"rigid-transition"}, validation_cell_figures.draw_transition),
    ("constriction_shape", {"constriction-shape"}, validation_cell_figures.draw_constriction_shape),
)
"""Name of a figure, cases of which it shows one or more, and what draws it."""


def contents(page: Page) -> dict:
    table = page["validation"]
    present = set(table.loc[table["relative_error"].notna(), "case"])
    failing = table[table["passed"].eq(False)]
    notes = failing.loc[failing["note"] != "", ["case", "note"]].drop_duplicates()
    return {
        "cases": _cases(page),
        "failing": page.table(
            {
                "case": texts(failing["case"]),
                "quantity": texts(failing["quantity"]),
                "variant": texts(failing["variant"]),
                "at": [
                    f"{name} {number(value)}" if name else NOT_MEASURED
                    for name, value in zip(
                        failing["parameter_of"], failing["parameter"], strict=True
                    )
                ],
                "error": map(percent, failing["relative_error"]),
                "allowed": map(percent, failing["mark"]),
            },
            ["validation"],
        )
        if len(failing)
        else None,
        "reasons": notes.to_numpy().tolist(),
        **{
            name: page.figure(name, draw(table), ["validation"]) if cases & present else None
            for name, cases, draw in FIGURES
        },
    }


def _cases(page: Page) -> Grid:
    table = validation_figures.with_levels(page["validation"])
    unresolved = table.groupby("case")["resolution"].transform("count") == 0
    finest = table[
        table["finest"] & table["mark"].notna() & (table["resolution"].notna() | unresolved)
    ]
    orders = validation_figures.observed_orders(page["validation"])
    cases = verdicts(records(page["validation"]))

    def largest_error(case: str) -> str:
        part = finest[finest["case"] == case].assign(size=lambda t: t["relative_error"].abs())
        if not set(part["variant"]) <= set(validation_figures.VARIANT_COLOUR):
            part = part.assign(variant="")
        return _by_variant(part.groupby("variant")["size"].max().items(), percent)

    def order(case: str) -> str:
        part = orders[orders["case"] == case]
        return _by_variant(zip(part["variant"], part["order"], strict=True), lambda v: fixed(v, 1))

    names = [case["case"] for case in cases]
    sources = [CASES[name].source if name in CASES else None for name in names]
    return page.table(
        {
            "case": texts(names),
            "what": texts(CASES[name].title if name in CASES else "" for name in names),
            "largest error, finest resolution": map(largest_error, names),
            "order": map(order, names),
            "within marks": [
                f"{case['marked'] - case['failed']} of {case['marked']}" for case in cases
            ],
            "result": ["fails" if case["failed"] else "passes" for case in cases],
            "time [s]": numbers((case["wall_time_s"] for case in cases), 2),
        },
        ["validation"],
        [case["failed"] > 0 for case in cases],
        [f"Reference: {source}" if source else None for source in sources],
    )


def _by_variant(values: Iterable[tuple[str, float]], form: Callable[[float], str]) -> str:
    """Values with their variants, a dash for none."""
    parts = [f"{variant} {form(value)}" if variant else form(value) for variant, value in values]
    return ", ".join(parts) or NOT_MEASURED
