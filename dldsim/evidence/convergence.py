"""Order and limit of critical gaps over the lattice spacing and the numerical Reynolds number."""

from collections.abc import Sequence
from typing import Any

from dldsim.config.configuration import Config
from dldsim.evidence.critical_gaps import REYNOLDS, SPACING, Search, knobs, search_id, transitions
from dldsim.evidence.reference_study import Row


def observed_order(steps: Sequence[float], values: Sequence[float]) -> float | None:
    """Order p of three values v = v∞ + C h^p at falling steps h (Roache 1998, ch. 5).

    (v₁ − v₂)/(v₂ − v₃) = (h₁^p − h₂^p)/(h₂^p − h₃^p), whose right side rises with p. None where the
    values oscillate, do not change, or approach more slowly than any order above 0.
    """
    from scipy.optimize import brentq

    (h1, h2, h3), (v1, v2, v3) = steps, values
    if v2 == v3 or (v1 - v2) / (v2 - v3) <= 0:
        return None
    wanted = (v1 - v2) / (v2 - v3)

    def ratio(p: float) -> float:
        return (h1**p - h2**p) / (h2**p - h3**p)

    low, high = 1e-6, 1.0
    if wanted <= ratio(low):
        return None
    while ratio(high) < wanted:
        high *= 2
    return brentq(lambda p: ratio(p) - wanted, low, high, xtol=1e-14)


def extrapolate(steps: Sequence[float], values: Sequence[float], order: float) -> float:
    """Limit v∞ of the last two of such values."""
    (_, h2, h3), (_, v2, v3) = steps, values
    return v3 - (v2 - v3) * h3**order / (h2**order - h3**order)


STEP_OF = {SPACING: "spacing_um", REYNOLDS: "lag_number"}
"""What counts as the step h of a knob: what the runs had, not what was asked for."""


def convergence_table(rows: Sequence[Row], config: Config) -> list[dict[str, Any]]:
    """Rows of `convergence`: of each transition and knob, from rows of `critical_gaps`.

    The order is that of the three finest values, the campaign's own among them or not.
    """
    found = {row["search"]: row for row in rows}
    result = []
    for gap in transitions(config.reference):
        first = Search(gap.pillar_radius_um, gap.periodicity, gap.stiffness_set)
        for knob, values in knobs(config.reference).items():
            own = getattr(config.numerics, knob)
            at = {v: first._replace(knob=knob, rank=i) for i, v in enumerate(values)} | {own: first}
            of = [found[search_id(at[value])] for value in sorted(at, reverse=True)]
            result.append(_converged(of, knob, found[search_id(first)]))
    return result


def _converged(rows: Sequence[Row], knob: str, campaign: Row) -> dict[str, Any]:
    """One row of `convergence`; ``rows`` from coarse to fine."""
    gaps = [row["critical_gap_um"] for row in rows]
    steps = [row[STEP_OF[knob]] for row in rows]
    order = limit = None
    note = ""
    if None in gaps:
        note = "a search found no transition"
    elif len(finest := steps[-3:]) < 3 or not finest[0] > finest[1] > finest[2]:
        note = "an order needs three falling steps; the runs had " + ", ".join(
            f"{step:.4g}" for step in steps
        )
    elif (order := observed_order(finest, gaps[-3:])) is None:
        note = "no order: the values do not approach a limit evenly"
    else:
        limit = extrapolate(finest, gaps[-3:], order)
        widths = [row["high_um"] - row["low_um"] for row in rows[-3:]]
        if min(abs(gaps[-3] - gaps[-2]), abs(gaps[-2] - gaps[-1])) < max(widths):
            note = "differences below the width of the brackets: the order is uncertain"
    known = [gap for gap in gaps if gap is not None]
    return {
        **{
            key: campaign[key]
            for key in (
                "pillar_radius_um",
                "periodicity",
                "stiffness_set",
                "cell_shape",
                "cell_radius_um",
            )
        },
        "knob": knob,
        "steps": [step for step in steps if step is not None],
        "critical_gaps_um": known,
        "range_um": max(known) - min(known) if known else None,
        "observed_order": order,
        "extrapolated_gap_um": limit,
        "error_um": campaign["critical_gap_um"] - limit if limit is not None else None,
        "note": note,
    }
