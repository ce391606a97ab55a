"""Summary: counts, the main numbers, outcomes by status, and what the numbers rest on."""

import json

import pandas as pd

from dldsim.analysis.regressors import SURROGATE
from dldsim.errors import DldsimError
from dldsim.report.formats import counted, duration, listing, number, numbers, texts
from dldsim.report.page import Page
from dldsim.report.sections import designs
from dldsim.report.style import mode_name
from dldsim.report.surrogate_figures import pooled_scores
from dldsim.vocabulary import BROKEN, GEOMETRY, MODES

STATUS_MEANING = {
    "decided": "known wherever the cell enters",
    "coexisting": "known; the motion depends on where the cell enters",
    "undecided": "not settled when the rows were spent: the angle lies within its interval",
    "stuck": "the cell stopped moving",
    "unstable": "a run left the safe range of the numerics",
    "failed": "a run broke off with an error",
}
RUN_MEANING = {
    "converged": "the motion repeats every row",
    "periodic": "the orbit repeats after several rows",
    "stationary": "no orbit, but the mean is known",
    "undecided": "not settled when the rows were spent",
    "stuck": "the cell stopped moving",
    "unstable": "the run left the safe range of the numerics",
    "failed": "the run broke off with an error",
}


def contents(page: Page) -> dict:
    outcomes = page["outcomes"]
    count = outcomes["status"].value_counts()
    broken = outcomes[outcomes["status"].isin(BROKEN)]
    return {
        "cards": _cards(page, modes_of(outcomes), broken),
        "by_status": page.table(_by_status(outcomes), ["outcomes"]),
        "by_run_status": page.table(_by_run_status(page["runs"]), ["runs"])
        if page.some("runs")
        else None,
        "broken": page.table(
            {
                "outcome": texts(broken["outcome_id"]),
                "status": texts(broken["status"]),
                "rows passed": numbers(broken["rows_total"]),
                "reason": texts(broken["stop_reason"]),
            },
            ["outcomes"],
        )
        if len(broken)
        else None,
        "undecided": int(count.get("undecided", 0)),
        "max_rows": page.setting("run_control", "max_rows"),
        "rows_max": page.setting("run_control", "outcome_rows_max"),
        "basis": _basis(page),
    }


def modes_of(outcomes: pd.DataFrame) -> list[str]:
    """Modes that outcomes with an angle have."""
    return [m for m in MODES[:-1] if (outcomes["mode"] == m).any()]


def simulation_time(page: Page) -> float:
    """Wall time of all simulations, summed over jobs [s]."""
    kinds = [k for k in ("outcomes", "flows", "assay_runs") if k in page]
    return float(sum(page[kind]["wall_time_s"].sum() for kind in kinds))


def card_of(page: Page) -> dict | None:
    """The surrogate's card, None without one."""
    path = page.results / "surrogate_card.json"
    if not path.exists():
        return None
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise DldsimError(
            f"{path} is not readable as JSON ({error}). Delete it and run `snakemake "
            "-j2 surrogate`."
        ) from error


def _cards(page: Page, modes: list[str], broken: pd.DataFrame) -> list[tuple[str, str]]:
    outcomes = page["outcomes"]
    count = outcomes["status"].value_counts()
    arrays = len(outcomes[GEOMETRY].drop_duplicates())
    releases = len(page["runs"]) if "runs" in page else outcomes["releases"].sum()
    cards = []
    if best := designs.largest(page):
        cards.append(
            (
                best["value"],
                f"largest simulated separation of a design ({best['request']}): {best['array']}",
            )
        )
    cards += [
        (
            counted(len(outcomes), "outcome"),
            f"{arrays} arrays × "
            f"{outcomes['stiffness_set'].nunique()} stiffness sets, {counted(releases, 'release')}",
        ),
        (
            f"{count.get('decided', 0)} decided",
            f"{count.get('coexisting', 0)} coexisting, "
            f"{count.get('undecided', 0)} undecided, {len(broken)} without an angle",
        ),
        (
            listing(modes) or "no mode",
            ", ".join(f"{(outcomes['mode'] == mode).sum()} {mode}" for mode in modes),
        ),
        (duration(simulation_time(page)), "simulation, summed over jobs"),
    ]
    error, card = None, card_of(page)
    if card is not None:
        error, name = card["scores_by_geometry"]["rmse_deg"], f"the surrogate ({SURROGATE})"
    elif page.some("predictions"):
        scores = pooled_scores(page["predictions"])
        by_array = scores[scores["split"] == "geometry"]
        if len(by_array):
            error, name = by_array.iloc[0]["rmse_deg"], by_array.iloc[0]["model"]
    if error is not None:
        cards.append(
            (f"± {number(float(error), 2)}°", f"error of {name} on arrays it has not seen (RMSE)")
        )
    return cards


def _by_status(outcomes: pd.DataFrame) -> dict[str, list]:
    statuses = [s for s in STATUS_MEANING if (outcomes["status"] == s).any()]
    modes = [m for m in MODES if (outcomes["mode"] == m).any()]
    columns = {"status": texts(statuses)}
    for mode in modes:
        columns[mode_name(mode)] = [
            number(int(((outcomes["status"] == s) & (outcomes["mode"] == mode)).sum()))
            for s in statuses
        ]
    columns["all"] = [number(int((outcomes["status"] == s).sum())) for s in statuses]
    columns["meaning"] = [STATUS_MEANING[s] for s in statuses]
    return columns


def _by_run_status(runs: pd.DataFrame) -> dict[str, list]:
    statuses = [s for s in RUN_MEANING if (runs["status"] == s).any()]
    return {
        "status of the release": texts(statuses),
        "all": [number(int((runs["status"] == s).sum())) for s in statuses],
        "meaning": [RUN_MEANING[s] for s in statuses],
    }


def _basis(page: Page) -> dict:
    """Numbers in the paragraph on what was measured, assumed and taken from literature."""
    outcomes = page["outcomes"]
    cell = outcomes.iloc[0]
    domains = ""
    if "runs" in page:
        sizes = page["runs"][["rows_in_domain", "lanes_in_domain"]].dropna().drop_duplicates()
        domains = listing(f"{int(rows)} × {int(lanes)}" for rows, lanes in sizes.to_numpy())
    capillary = outcomes["capillary_number"]
    return {
        "shape": cell["cell_shape"],
        "radius": f"{cell['cell_radius_um']:g}",
        "height": f"{cell['height_um']:g}" if cell["height_um"] else None,
        "domains": domains or "an unknown number of",
        "dilute": (outcomes["images"].dropna() == "dilute").all(),
        "capillary": f"{number(capillary.min(), 2)} to {number(capillary.max(), 2)}",
        "lag": number(outcomes["lag_number"].max(), 2),
    }
