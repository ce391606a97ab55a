"""What a simulation says of a prediction and of a design."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from dldsim.analysis import uncertainty
from dldsim.config.sections import Geometry
from dldsim.design.populations import Population
from dldsim.design.task import Task
from dldsim.experiments.migration import mode_of
from dldsim.vocabulary import GEOMETRY

CONFIRMED, MISSED = "prediction confirmed", "prediction missed"
UNINFORMATIVE = "prediction uninformative"
SIGMAS = 2
"""Numerical uncertainties that a simulated separation must exceed to count as one."""


def compare(
    task: Task, populations: Sequence[Population], geometry: Geometry, found: Sequence[Mapping]
) -> list[dict]:
    """Prediction and simulation of both cell types and of their difference; `verifications`."""
    place = [getattr(geometry, name) for name in GEOMETRY]
    angles = [float(a[0]) for a in task.angles(*place)]
    half = [float(h[0]) for h in task.half_widths(*place)]
    inside = [bool(known[0]) for known in task.inside(*place)]
    rows = []
    for k, population in enumerate(populations):
        row = found[k]
        rows.append(
            _judged(
                {
                    "population": str(population.number),
                    **geometry.model_dump(),
                    "outcome_id": row["outcome_id"],
                    "cell_shape": population.shape,
                    "cell_radius_um": population.radius_um,
                    "mean_velocity_mm_s": population.flow.mean_velocity_mm_s,
                    "deformation_index": population.deformation_index,
                    "ks_uN_per_m": population.stiffness.ks_uN_per_m,
                    "capillary_number": population.capillary_number,
                    "stiffness_basis": population.basis,
                    "predicted_deg": angles[k],
                    "simulated_deg": row["migration_angle_deg"],
                    "sigma_num_deg": row["sigma_num_deg"],
                    "predicted_mode": mode_of(angles[k], geometry.row_shift_fraction),
                    "mode": row["mode"],
                    "status": row["status"],
                    "wall_time_s": row["wall_time_s"],
                    "note": _note(row),
                },
                half[k],
                inside[k],
            )
        )
    first, second = found
    known = [r["migration_angle_deg"] is not None for r in found]
    sigmas = [r["sigma_num_deg"] for r in found]
    rows.append(
        _judged(
            {
                "population": "difference",
                **geometry.model_dump(),
                "outcome_id": f"{first['outcome_id']}, {second['outcome_id']}",
                "cell_shape": None,
                "cell_radius_um": None,
                "mean_velocity_mm_s": task.chip.flow.mean_velocity_mm_s,
                "deformation_index": None,
                "ks_uN_per_m": None,
                "capillary_number": None,
                "stiffness_basis": "",
                "predicted_deg": angles[1] - angles[0],
                "simulated_deg": second["migration_angle_deg"] - first["migration_angle_deg"]
                if all(known)
                else None,
                "sigma_num_deg": None if None in sigmas else math.hypot(*sigmas),
                "predicted_mode": ", ".join(r["predicted_mode"] for r in rows),
                "mode": ", ".join(r["mode"] for r in found),
                "status": ", ".join(r["status"] for r in found),
                "wall_time_s": sum(r["wall_time_s"] or 0.0 for r in found),
                "note": _notes([r["note"] for r in rows]),
            },
            math.hypot(*half),
            all(inside),
        )
    )
    return rows


def _judged(row: dict, half_width_deg: float, inside: bool) -> dict:
    """The row with its interval and whether the simulated value meets it.

    An interval of a difference that includes zero does not say which cell type goes further: what
    meets it is no confirmation, and `agrees` is then not known.
    """
    low, high = row["predicted_deg"] - half_width_deg, row["predicted_deg"] + half_width_deg
    simulated, sigma = row["simulated_deg"], row["sigma_num_deg"] or 0.0
    agrees = None
    if simulated is None:
        verdict = "no angle to compare with"
    elif not inside:
        verdict = "not compared: outside what was learnt"
    else:
        agrees = low - sigma <= simulated <= high + sigma
        off = simulated - row["predicted_deg"]
        verdict = f"{CONFIRMED} (± {half_width_deg:.2f}°)" if agrees else f"{MISSED} by {off:+.2f}°"
        if agrees and row["population"] == "difference" and low <= 0 <= high:
            agrees = None
            verdict = f"{UNINFORMATIVE}: its interval, {low:.2f} to {high:.2f}°, includes zero"
    return {
        **row,
        "predicted_low_deg": low,
        "predicted_high_deg": high,
        "agrees": agrees,
        "verdict": verdict,
    }


def _note(row: Mapping[str, Any]) -> str:
    """What a reader must know of an outcome that is not decided."""
    if row["status"] in uncertainty.OPEN:
        return f"{row['status']}: {row['stop_reason']}"
    return "" if row["status"] == "decided" else row["stop_reason"]


def _notes(of_each: Sequence[str]) -> str:
    """What a reader must know of both cell types: once where it is the same, else whose it is."""
    if len(set(of_each)) == 1:
        return of_each[0]
    return "; ".join(f"cell type {i}: {note}" for i, note in enumerate(of_each, 1) if note)


def difference_of(found: Sequence[Mapping] | None) -> float | None:
    """Angle of the second cell type minus that of the first [°]; None where one is not known."""
    angles = [row["migration_angle_deg"] for row in found or [{"migration_angle_deg": None}]]
    return None if None in angles else angles[1] - angles[0]


def towards(order: float, difference: float) -> float:
    """A difference with the sign that says whether it has the same order."""
    return math.copysign(difference, difference * order)


def parts(found: Sequence[Mapping], sigma_deg: float | None) -> bool | None:
    """Whether two outcomes part the cells from every place of release.

    Outcomes part if the angles differ by more than both spreads of the releases together and, where
    both are decided, by more than SIGMAS σ_num. Where one is undecided its bounds, means over the
    flux as the angle is, must not overlap. None where they do, where σ_num is not known, and where
    it is too large because a mode is open: a finer setting can tell.
    """
    difference = difference_of(found)
    if difference is None or any(row["status"] not in ("decided", "undecided") for row in found):
        return False
    if any(row["status"] == "undecided" for row in found):
        apart = max(r["angle_low_deg"] for r in found) > min(r["angle_high_deg"] for r in found)
        return True if apart and abs(difference) > _spread(found) else None
    if abs(difference) <= _spread(found):
        return False
    if sigma_deg is None or abs(difference) > SIGMAS * sigma_deg:
        return None if sigma_deg is None else True
    return None if any(row["mode_open"] for row in found) else False


def separated(
    found: Sequence[Mapping], sigma_deg: float | None, finer: Sequence[Mapping] | None
) -> bool | None:
    """Whether a design separates: at the campaign's setting and, in the same order, at a finer one.

    A mode that is open by σ_num is settled where the finer setting is decided and gives both cell
    types the same modes. None where it stays open, or the finer setting was not simulated.
    """
    known = parts(found, sigma_deg)
    if known is False or finer is None:
        return False if known is False else None
    same, here, there = parts(finer, sigma_deg), difference_of(found), difference_of(finer)
    if here is None or there is None:
        return same if known else None
    if same is not False and towards(here, there) < 0:
        return False
    if known or any(row["status"] not in ("decided", "undecided") for row in finer):
        return same
    if any(row["status"] == "undecided" for row in finer):
        return None
    if towards(here, there) <= _spread(finer):
        return False
    both = zip(found, finer, strict=True)
    settled = all(a["status"] == "decided" and a["mode"] == b["mode"] for a, b in both)
    return True if settled else None


def _spread(found: Sequence[Mapping]) -> float:
    """Spreads of the angles [°] over the places of release of both cell types together."""
    return sum(row["angle_spread_deg"] or 0.0 for row in found)


def design_verdict(
    difference: Mapping[str, Any],
    found: Sequence[Mapping],
    finer: Sequence[Mapping] | None,
    separates: bool | None,
) -> str:
    """Whether it separates, at which settings, whether that was predicted, and what is open."""
    simulated, sigma = difference["simulated_deg"], difference["sigma_num_deg"]
    if simulated is None:
        return f"no separation measured: {difference['note']}"
    size = f"{abs(simulated):.2f}°" if sigma is None else f"{abs(simulated):.2f} ± {sigma:.2f}°"
    assert finer is not None or not separates  # it takes two settings
    if finer is not None:
        there = _settings(finer)
        words = {
            True: f"separates by {size}, {there} as well",
            False: f"does not separate: {abs(simulated):.2f}° but {there}",
            None: f"open: {abs(simulated):.2f}°, {there}, undecided",
        }[separates]
    elif separates is None and parts(found, sigma) is None:
        why = _undecided(found) or (
            "numerical uncertainty not studied"
            if sigma is None
            else f"near a transition, σ_num {sigma:.2f}° reaches another mode"
        )
        words = f"open, {abs(simulated):.2f}°: {why}"
    elif separates is None:
        words = f"separates by {size} at this setting; not confirmed at a finer one"
    else:
        words = f"does not separate: {_why_not(found, simulated, sigma)}"
    said = [words, difference["verdict"]]
    if separates is not False and simulated * difference["predicted_deg"] < 0:
        said.append("in the opposite order")
    return "; ".join([*said, *filter(None, [difference["note"]])])


def _settings(finer: Sequence[Mapping]) -> str:
    """What a finer setting gave, in words."""
    value = difference_of(finer)
    outcome = "no angle" if value is None else f"{abs(value):.2f}°"
    lag = max(row["lag_number"] or 0.0 for row in finer)
    domain = f"{finer[0]['rows_in_domain']} × {finer[0]['lanes_in_domain']} pillars"
    spacing = finer[0]["spacing_um"] or math.nan
    return f"{outcome} at spacing {spacing:.2f} µm, Re {lag:.2f} and {domain}"


def _undecided(found: Sequence[Mapping]) -> str:
    """Which of two outcomes are not decided, in words; empty: none."""
    return " and ".join(
        f"cell type {i} is {row['status']}"
        for i, row in enumerate(found, 1)
        if row["status"] != "decided"
    )


def _why_not(found: Sequence[Mapping], simulated: float, sigma: float | None) -> str:
    """Why two outcomes do not part, in words."""
    if open_ := _undecided(found):
        return open_
    if sigma is not None and abs(simulated) <= SIGMAS * sigma:
        return f"{abs(simulated):.2f}° is within {SIGMAS} σ_num of zero"
    spread = sum(row["angle_spread_deg"] or 0.0 for row in found)
    return f"{abs(simulated):.2f}° is within the spread of the releases, {spread:.2f}°"
