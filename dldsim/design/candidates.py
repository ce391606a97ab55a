"""From trials to ranked candidates: tolerance, uncertainty, rank, verdict and notes."""

from collections.abc import Mapping, Sequence
from math import hypot
from typing import Any

import numpy as np
import pandas as pd

from dldsim.analysis.domain import DOMAIN_TOLERANCE
from dldsim.analysis.features import share_of
from dldsim.config.design_sections import DesignRequest
from dldsim.config.sections import Geometry
from dldsim.design.motion import gap_error
from dldsim.design.outlet_task import OBJECTIVE as OUTLETS
from dldsim.design.task import DECIMALS, TINY, Task, extrapolated, fixed, violations
from dldsim.experiments.migration import mode_of
from dldsim.tables.registry import TABLES
from dldsim.vocabulary import GEOMETRY

TOLERANCE_STEPS = 5
"""Values of P_r and of P_g across the tolerance, ends and middle included."""
GRID_CHECKED = 300
"""Best points of a grid whose tolerance and uncertainty are looked up."""
TRANSITION_POINTS = 2048
"""Random arrays among which those near a mode transition are chosen."""
TRANSITION_SHARE = 0.25
"""An array is near one where tan θ · N_p of a cell type is this close to a half."""
OPEN_SPAN = 0.5
"""Part of the bump displacement from which on an interval leaves a mode open."""
SAME_OUTLETS = 0.01
"""Purities and recoveries that differ by less are not ranked against each other."""
BOUND_SHARE = 0.02
"""A candidate nearer to a bound than this share of the range is on it: samplers seldom hit it."""


def make_candidates(task: Task, feasible: pd.DataFrame) -> pd.DataFrame:
    """The best distinct candidates with tolerance, uncertainty and verdict."""
    request, chip, surrogate = task.request, task.chip, task.surrogate
    beyond = extrapolated(task)
    inside = (feasible["outside"] <= DOMAIN_TOLERANCE) & (not beyond)
    table = feasible.assign(inside_training_domain=inside).dropna(subset="value")
    if len(table) > GRID_CHECKED:
        table = table.nlargest(GRID_CHECKED, ["inside_training_domain", "value"], keep="all")
    place = [table[name].to_numpy() for name in GEOMETRY]
    least, largest = over_tolerance(task, table)
    sigma = [surrogate.sigma_num_deg(table[f"angle_{i}_deg"], place[2]) for i in (1, 2)]
    first, second = sigma
    table = table.assign(
        separation_tolerance_min_deg=least,
        separation_tolerance_max_deg=largest,
        sigma_num_deg=np.nan if first is None or second is None else np.hypot(first, second),
        uncertainty_deg=np.hypot(*task.half_widths(*place)),
        mode_open=open_modes(task, table),
    )
    outlets = request.objective == OUTLETS
    table = table.assign(behind=table["mode_open"] & outlets).sort_values(
        ["inside_training_domain", "behind", "value", "separation_tolerance_min_deg", "trial"],
        ascending=[False, True, False, False, True],
    )
    chosen: list[pd.Series] = []
    for _, row in table.iterrows():
        if len(chosen) == request.candidates:
            break
        if all(distinct(request, row, c) for c in chosen):
            chosen.append(row)
    designs = pd.DataFrame(chosen).astype({"periodicity": int, "inside_training_domain": bool})
    if outlets:
        designs = with_outlets(task, designs)
    designs["design"] = range(1, len(designs) + 1)
    designs["rank"] = ranks = ranks_of(designs, "value", SAME_OUTLETS * outlets)
    place = [designs[name].to_numpy() for name in GEOMETRY]
    angles = [designs[f"angle_{i}_deg"].to_numpy(float) for i in (1, 2)]
    modes = [[mode_of(a, 1 / n) for a, n in zip(angle, place[2], strict=True)] for angle in angles]
    for i, (low, high) in enumerate(task.intervals(*place), start=1):
        designs[f"angle_{i}_low_deg"], designs[f"angle_{i}_high_deg"] = low, high
    drawn = task.drawn(*place)
    shift = np.array(
        [
            [
                [mode_of(a, 1 / n) for a in row] != np.full(len(row), mode)
                for row, n, mode in zip(angle, place[2], mode, strict=True)
            ]
            for angle, mode in zip(drawn, modes, strict=True)
        ]
    )
    length = task.length_mm(*angles)
    pressure = np.full(len(designs), np.nan)
    if chip.resistance is not None:
        pressure = task.pressure_kPa(place[0], place[1], place[2], length)
    designs = designs.assign(
        objective=request.objective,
        mode_1=modes[0],
        mode_2=modes[1],
        robust_separation_deg=task.robust(*place)[0],
        mode_change_probability=shift.any(axis=0).mean(axis=1),
        length_mm=np.where(np.isfinite(length), length, np.nan),
        pressure_drop_kPa=np.where(np.isfinite(pressure), pressure, np.nan),
        pressure_basis=chip.pressure_basis(*place),
        throughput_uL_per_h=chip.throughput_uL_per_h,
        verdict=[verdict_of(row) for _, row in designs.iterrows()],
        notes=[
            notes_of(row, ranks.count(row["rank"]), at_bounds(request, row), beyond, outlets)
            for _, row in designs.iterrows()
        ],
    )
    return designs[TABLES["designs"].names].reset_index(drop=True)


def over_tolerance(task: Task, table: pd.DataFrame) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest separation [deg] over ± tolerance, counted in the nominal order."""
    step = np.linspace(-1, 1, TOLERANCE_STEPS) * task.request.tolerance_um
    off_radius, off_gap = (v.ravel() for v in np.meshgrid(step, step))
    radius = table["pillar_radius_um"].to_numpy()[:, None] + off_radius
    gap = table["gap_um"].to_numpy()[:, None] + off_gap
    rows = np.repeat(table["periodicity"].to_numpy(), off_gap.size)
    first, second = task.angles(radius.ravel(), gap.ravel(), rows)
    order = np.where(table["angle_2_deg"] >= table["angle_1_deg"], 1.0, -1.0)[:, None]
    separation = order * (second - first).reshape(len(table), -1)
    return separation.min(axis=1), separation.max(axis=1)


def open_modes(task: Task, table: pd.DataFrame) -> np.ndarray:
    """Whether the mode of a cell type is open, (n,): its prediction interval, or what two standard
    deviations of the numerical error of the gap make of it, spans OPEN_SPAN of the bump
    displacement."""
    radius, gap, rows = (table[name].to_numpy() for name in GEOMETRY)
    ends = task.intervals(radius, gap, rows)
    off = np.exp(2 * gap_error(task.surrogate))
    ends += zip(*(task.angles(radius, at, rows) for at in (gap * off, gap / off)), strict=True)
    spans = [share_of(high, rows) - share_of(low, rows) for low, high in ends]
    return np.abs(spans).max(axis=0) >= OPEN_SPAN


def with_outlets(task: Task, designs: pd.DataFrame) -> pd.DataFrame:
    """Candidates with the value that their outlets have with all draws, best first."""
    splits = [
        task.outlets.outcome("", Geometry(**{n: row[n] for n in GEOMETRY})).split
        for row in designs.to_dict("records")
    ]
    values = {name: [getattr(s, name) for s in splits] for name in ("robust", "score")}
    return designs.assign(value=values["robust"], score=values["score"]).sort_values(
        ["inside_training_domain", "behind", "score"], ascending=[False, True, False], kind="stable"
    )


def distinct(request: DesignRequest, a: Mapping[str, Any], b: Mapping[str, Any]) -> bool:
    """Whether two geometries count as different."""
    apart = max(request.tolerance_um, TINY)
    return a["periodicity"] != b["periodicity"] or any(
        abs(a[name] - b[name]) > apart for name in ("pillar_radius_um", "gap_um")
    )


def ranks_of(designs: pd.DataFrame, value: str, same: float = 0.0) -> list[int]:
    """Rank of each design, best first: 1 + number of designs before its class of equals.

    Equal to the first of its class: on the same side of the training domain, ranked behind for an
    open mode or not, and apart by less than ``same`` or, where that is 0, the combined σ_num of the
    two separations. Without σ_num every design has its own rank.
    """
    ranks: list[int] = []
    leader = None
    for place, (_, row) in enumerate(designs.iterrows()):
        equal = leader is not None and (
            all(row.get(side) == leader.get(side) for side in ("inside_training_domain", "behind"))
            and leader[value] - row[value]
            < (same or hypot(leader["sigma_num_deg"], row["sigma_num_deg"]))
        )
        if not equal:
            leader = row
        ranks.append(ranks[-1] if equal else place + 1)
    return ranks


def at_bounds(request: DesignRequest, row: Mapping[str, Any]) -> list[str]:
    """Which bounds of the search a candidate lies on, in words; those of fixed parameters left out.

    A length is on a bound if it is nearer to it than BOUND_SHARE of the range.
    """
    found = []
    for name in (n for n in GEOMETRY if n not in fixed(request)):
        bounds = getattr(request, name)
        reach = 0 if name == "periodicity" else BOUND_SHARE * np.ptp(bounds)
        found += [
            f"{name} = {row[name]:g}, {end} bound {bound:g}"
            for end, bound in zip(("lowest", "highest"), bounds, strict=True)
            if abs(row[name] - bound) <= reach
        ]
    return found


def verdict_of(row: Mapping[str, Any]) -> str:
    """Whether a candidate's separation is resolved, in words."""
    if row["separation_deg"] <= row["uncertainty_deg"]:
        return "not resolved: separation below uncertainty"
    if row["separation_tolerance_min_deg"] <= row["uncertainty_deg"]:
        return "not robust: resolved at nominal size, not over the tolerance"
    return "resolved"


def notes_of(
    row: Mapping[str, Any],
    equals: int,
    bounds: Sequence[str] = (),
    beyond: Sequence[str] = (),
    outlets: bool = False,
) -> list[str]:
    """What else its prediction is worth, in words; ``equals``: candidates of its rank, ``bounds``:
    those that it lies on, ``beyond``: what of the request was not learnt, ``outlets``: ranked by
    them."""
    notes = []
    if row["mode_open"]:
        notes.append("a mode is open: its interval spans half of the bump displacement")
    if equals > 1:
        why = "equally good outlets" if outlets else "closer than σ_num"
        notes.append(f"one of {equals} not ranked against each other: {why}")
    if np.isnan(row["sigma_num_deg"]):
        notes.append("numerical uncertainty not studied")
    if not row["inside_training_domain"]:
        why = ", ".join(beyond) or "outside the training geometries"
        notes.append(f"extrapolated: {why}")
    if bounds:
        notes.append(f"on the edge of the search ({', '.join(bounds)}): better may lie beyond")
    return notes


def transition_geometries(task: Task, known: pd.DataFrame, count: int) -> list[dict[str, Any]]:
    """Arrays where a simulation teaches most: near a mode transition, far from those simulated.

    Among random feasible arrays in the training domain, those in which a cell type is predicted
    half-way between bump and zigzag; of these, one after the other, the one farthest from all
    geometries known or chosen, in units of the bounds. Fewer, or none, where no array is near.
    """
    request = task.request
    rng = np.random.default_rng(task.seed)
    radius, gap = (
        rng.uniform(*bounds, TRANSITION_POINTS).round(DECIMALS)
        for bounds in (request.pillar_radius_um, request.gap_um)
    )
    low, high = request.periodicity
    place = radius, gap, rng.integers(low, high + 1, TRANSITION_POINTS)
    good = np.all(
        [
            np.broadcast_to(v, TRANSITION_POINTS) <= 0
            for v in violations(request, task.populations, task.chip, radius, gap).values()
        ],
        axis=0,
    )
    good &= task.outside(*place) <= DOMAIN_TOLERANCE
    share = np.tan(np.radians(task.angles(*place))) * place[2]
    good &= np.abs(share - 0.5).min(axis=0) <= TRANSITION_SHARE
    points = np.column_stack(place)[good]
    scale = np.array(
        [
            np.ptp(b) or np.inf
            for b in (request.pillar_radius_um, request.gap_um, request.periodicity)
        ]
    )
    seen = known[GEOMETRY].to_numpy(float)
    chosen: list[dict[str, Any]] = []
    while len(points) and len(chosen) < count:
        away = np.linalg.norm((points[:, None] - seen) / scale, axis=2).min(axis=1)
        best = points[away.argmax()]
        points = np.delete(points, away.argmax(), axis=0)
        seen = np.vstack([seen, best])
        chosen.append(
            {
                "pillar_radius_um": float(best[0]),
                "gap_um": float(best[1]),
                "periodicity": int(best[2]),
            }
        )
    return chosen
