"""Accuracy: of a simulated angle, of the surrogate, and of the design search."""

import numpy as np
import pandas as pd
from markupsafe import Markup

from dldsim.analysis import uncertainty
from dldsim.evidence import spot_check
from dldsim.evidence.accuracy import ANGLE, INDEX, SETTING
from dldsim.report import accuracy_figures, learning_figures
from dldsim.report.formats import decimals, fixed, number, numbers, percent, records, text, texts
from dldsim.report.page import Grid, Page

SIGMA_HEADING = Markup("σ<sub>num</sub> [°]")
ANGLE_HEADING = Markup("θ<sub>m</sub> [°]")


def contents(page: Page) -> dict:
    return {
        "kinds": list(page["outcomes"]["sigma_num_kind"].value_counts().items()),
        "study": _work_precision(page) if page.some("accuracy") else None,
        "reference": _reference_check(page) if page.some("reference_check") else None,
        "spot": _spot_check(page) if page.some("spot_check") else None,
        "limits": _convergence(page) if page.some("convergence") else None,
        "learning": _learning_curve(page) if page.some("learning_curve") else None,
        "regret": page.figure(
            "search_regret", learning_figures.draw_regret(page["search_regret"]), ["search_regret"]
        )
        if page.some("search_regret")
        else None,
    }


def _learning_curve(page: Page):
    sigma = page["outcomes"]["sigma_num_deg"].dropna()
    floor = float(np.sqrt(np.mean(sigma**2))) if len(sigma) else None
    return page.figure(
        "learning_curve",
        learning_figures.draw_learning_curve(page["learning_curve"], floor),
        ["learning_curve"],
    )


def _changed(table: pd.DataFrame, other: str, word: str) -> list[str]:
    """The mode, and that of the check where it is another."""
    return [
        text(mode if mode == check else f"{mode}, {word} {check}")
        for mode, check in zip(table["mode"], table[other], strict=True)
    ]


def _reference_check(page: Page) -> dict:
    check = page["reference_check"]
    return {
        "sentence": uncertainty.closing_sentence(records(check)),
        "figure": page.figure("sigma_num", accuracy_figures.draw_sigma(check), ["reference_check"])
        if check["error_over_sigma"].notna().any()
        else None,
        "grid": page.table(
            {
                "pair": texts(check["outcome_id"]),
                "mode": _changed(check, "reference_mode", "reference"),
                "reference begun by": texts(check["reference_start"]),
                ANGLE_HEADING: decimals(check["migration_angle_deg"]),
                "reference [°]": decimals(check["reference_angle_deg"]),
                "difference [°]": decimals(check["error_deg"]),
                SIGMA_HEADING: decimals(check["sigma_num_deg"]),
                "distance, reference": [
                    f"{fixed(a)}, {fixed(b)}"
                    for a, b in zip(
                        check["transition_distance"], check["reference_distance"], strict=True
                    )
                ],
                "spacings [µm]": [
                    f"{number(a)}, {number(b)}"
                    for a, b in zip(check["spacing_um"], check["reference_spacing_um"], strict=True)
                ],
            },
            ["reference_check"],
            ~(check["error_over_sigma"] <= uncertainty.BEYOND),
            texts(check["verdict"]),
        ),
    }


def _spot_check(page: Page) -> dict:
    check = page["spot_check"]
    return {
        "sentence": spot_check.closing_sentence(records(check)),
        "rows": spot_check.ROWS,
        "grid": page.table(
            {
                "outcome": texts(check["outcome_id"]),
                "mode": _changed(check, "check_mode", "check"),
                ANGLE_HEADING: decimals(check["migration_angle_deg"]),
                "check [°]": decimals(check["check_angle_deg"]),
                SIGMA_HEADING: decimals(check["sigma_num_deg"]),
                "verdict": [
                    f"{verdict}; check begun by: {start}"
                    for verdict, start in zip(check["verdict"], check["check_start"], strict=True)
                ],
            },
            ["spot_check"],
            ~(check["change_over_sigma"] <= uncertainty.BEYOND),
        ),
    }


def _convergence(page: Page) -> Grid:
    found = page["convergence"]
    return page.table(
        {
            Markup("P<sub>r</sub> [µm]"): numbers(found["pillar_radius_um"]),
            Markup("N<sub>p</sub>"): numbers(found["periodicity"]),
            "cell": texts(found["stiffness_set"]),
            "knob": texts(found["knob"]),
            "steps": [", ".join(fixed(v, 3) for v in steps) for steps in found["steps"]],
            "critical gaps [µm]": [
                ", ".join(fixed(v) for v in gaps) for gaps in found["critical_gaps_um"]
            ],
            "order": decimals(found["observed_order"]),
            "limit [µm]": decimals(found["extrapolated_gap_um"]),
            "campaign − limit [µm]": decimals(found["error_um"]),
            "note": texts(found["note"]),
        },
        ["convergence"],
    )


def _work_precision(page: Page) -> dict:
    table = page["accuracy"]
    knobs = []
    for quantity, name in ((ANGLE, "knobs_angle"), (INDEX, "knobs_index")):
        part = table[table["quantity"] == quantity]
        if (part["kind"] == "knob").any() and part["error_share"].notna().any():
            knobs.append(
                (
                    Markup(accuracy_figures.NAMES[quantity]),
                    page.figure(name, accuracy_figures.draw_knobs(part, quantity), ["accuracy"]),
                )
            )
    whole = any(len(accuracy_figures.overall(table, q)) for q in (ANGLE, INDEX))
    missing = table[table["value"].isna()]
    return {
        "knobs": knobs,
        "pareto": page.figure("pareto", accuracy_figures.draw_pareto(table), ["accuracy"])
        if whole
        else None,
        "gains": page.figure("gains", accuracy_figures.draw_gains(table), ["accuracy"])
        if whole
        else None,
        "settings": _settings(page) if whole else None,
        "missing": page.table(
            {
                "case": texts(missing["case"]),
                "setting": [
                    f"{knob} = {value}"
                    for knob, value in zip(missing["knob"], missing["setting"], strict=True)
                ],
                "status": texts(missing["status"]),
            },
            ["accuracy"],
        )
        if len(missing)
        else None,
        "points": _points(page),
    }


def _settings(page: Page) -> Grid:
    whole = page["accuracy"]
    whole = whole[whole["kind"] == SETTING]

    def value(row) -> str:
        unit = "°" if row["quantity"] == ANGLE else ""
        return fixed(row["value"], 2 if unit else 4) + unit

    rows = [row for _, row in whole.iterrows()]
    return page.table(
        {
            "case": texts(whole["case"]),
            "setting": texts(whole["knob"]),
            Markup("θ<sub>m</sub> or DI"): map(value, rows),
            "mode": [text(row["mode"].strip("/")) for row in rows],
            "error": map(percent, whole["error_to_reference_share"]),
            "starts": map(percent, whole["noise_share"]),
            "processor time [s]": numbers(whole["processor_time_s"], 2),
            "spacing [µm]": numbers(whole["spacing_um"]),
            "status": texts(whole["status"]),
        },
        ["accuracy"],
        ~whole["settled"].astype(bool),
        [f"differs in {changed}" if changed else "the default" for changed in whole["setting"]],
    )


def _points(page: Page) -> Grid:
    table = page["accuracy"]
    knobs = table[table["kind"] != SETTING]
    return page.table(
        {
            "case": texts(knobs["case"]),
            "knob": texts(knobs["knob"]),
            "value": [
                text(s) + (" (default)" if d else "")
                for s, d in zip(knobs["setting"], knobs["is_default"], strict=True)
            ],
            Markup("θ<sub>m</sub> [°] or DI"): decimals(knobs["value"].astype(float), 4),
            "error": map(percent, knobs["error_share"]),
            "to the reference": map(percent, knobs["error_to_reference_share"]),
            "processor time [s]": numbers(knobs["processor_time_s"], 2),
            "status": texts(knobs["status"]),
        },
        ["accuracy"],
        ~knobs["settled"].astype(bool),
    )
