"""A random twentieth of a campaign, simulated once more with half the lattice spacing, half the
numerical Reynolds number, from other places of release and for many rows.

From these places a cell is first released at the campaign's numerics. Places from which it comes to
one motion, far from the transition on both lattices, are followed in one finer run
(`array_outcome.simulate_outcome`); otherwise the cell is released from each on the finer lattice.

At most one outcome in twenty may change by more than 2 σ_num.
"""

import math
import random
from collections.abc import Mapping, Sequence
from typing import Any

from dldsim.analysis.uncertainty import BEYOND, RANGES, error_of, verdict
from dldsim.config.provenance import derive_seed

Row = Mapping[str, Any]

SHARE = 0.05
"""Share of a campaign's outcomes that is checked, and share of those that may change."""
ROWS = 200
"""Rows that a cell is followed from each release, whether it has settled or not."""
FINER = 0.5
"""Factor on spacing and numerical Reynolds number."""
COST = 64.0
"""Factor in wall time per row, at most: 8 times the nodes and 8 times the steps, since the velocity
in lattice units falls by 4 where the Reynolds number limits it, and a row has twice the nodes."""


def sample(identifiers: Sequence[str], seed: int) -> list[str]:
    """A random twentieth of the outcomes, rounded up, in order; the same for the same seed."""
    count = min(len(identifiers), math.ceil(SHARE * len(identifiers)))
    chosen = random.Random(derive_seed(seed, "spot check")).sample(sorted(identifiers), count)
    return sorted(chosen)


def other_releases(releases: Sequence[float]) -> list[float]:
    """Places of release midway between those of the campaign; of a single one, midway to the
    pillars."""
    places = sorted(releases if len(releases) > 1 else {0.0, *releases, 1.0})
    return [round((a + b) / 2, 3) for a, b in zip(places, places[1:], strict=False)]


def release_sections(settings: Mapping[str, Any]) -> dict[str, Any]:
    """The section run_control of the releases at the campaign's numerics."""
    control = settings["run_control"]
    places = other_releases(control["release_gap_fractions"])
    return {
        "run_control": control
        | {"outcome_rows_max": control["max_rows"] * len(places), "release_gap_fractions": places}
    }


def check_sections(settings: Mapping[str, Any]) -> dict[str, Any]:
    """The sections numerics and run_control of a check, from those of the campaign, and those of
    the releases that it goes on from."""
    numerics, control = settings["numerics"], settings["run_control"]
    places = other_releases(control["release_gap_fractions"])
    return {
        "numerics": numerics
        | {key: FINER * numerics[key] for key in ("spacing_um", "reynolds_max")},
        "run_control": control
        | {
            "max_rows": ROWS,
            "min_rows": ROWS,
            "outcome_rows_max": ROWS * len(places),
            "release_gap_fractions": places,
        },
        "coarser": {"numerics": numerics, **release_sections(settings)},
    }


def cost_sentence(rows: Sequence[Row], releases: int) -> str:
    """What checking these outcomes takes at most, by their wall times in the campaign."""
    known = [
        row["wall_time_s"] / row["rows_total"]
        for row in rows
        if row["wall_time_s"] and row["rows_total"]
    ]
    if not known:
        return f"Spot check: {len(rows)} outcomes, none with a wall time to estimate the cost from."
    hours = sum(known) / len(known) * len(rows) * ROWS * releases * COST / 3600
    return (
        f"Spot check: {len(rows)} outcomes, {releases} releases each, {ROWS} rows: at most "
        f"about {hours:.3g} hours of one core."
    )


def check_row(row: Row, check: Row) -> dict[str, Any]:
    """Row of `spot_check`: an outcome of the campaign, with its σ_num, beside its check."""
    change = error_of(check, row)
    sigma = row["sigma_num_deg"]
    ratio = abs(change) / sigma if change is not None and sigma else None
    why = (
        row["sigma_num_basis"]
        if check["migration_angle_deg"] is not None
        else (f"the check is {check['status']}")
    )
    return {
        **{key: row[key] for key in COPIED},
        "check_mode": check["mode"],
        "check_status": check["status"],
        "check_start": check["start"],
        "check_angle_deg": check["migration_angle_deg"],
        "change_deg": change,
        "change_over_sigma": ratio,
        "check_spacing_um": check["spacing_um"],
        "check_wall_time_s": check["wall_time_s"],
        "verdict": verdict(ratio, ("holds", "changes"), why),
    }


COPIED = (
    "outcome_id",
    *RANGES,
    "stiffness_set",
    "mode",
    "status",
    "migration_angle_deg",
    "sigma_num_deg",
    "spacing_um",
)


def closing_sentence(rows: Sequence[Row]) -> str:
    """How many outcomes change by more than 2 σ_num, and whether that is few enough."""
    ratios = [r["change_over_sigma"] for r in rows if r["change_over_sigma"] is not None]
    changed = sum(ratio > BEYOND for ratio in ratios)
    untold = len(rows) - len(ratios)
    holds = "holds" if ratios and changed <= SHARE * len(ratios) else "does not hold"
    sentence = (
        f"Spot check: {changed} of {len(ratios)} outcomes change by more than {BEYOND:g} "
        f"σ_num; at most one in twenty may: {holds}."
    )
    return sentence + (f" Of {untold} it cannot be told." if untold else "")
