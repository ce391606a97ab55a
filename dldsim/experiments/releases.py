"""Several releases of one cell in one array: what they say together, and which place comes next."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dldsim.config.sections import RunControl
from dldsim.experiments.migration import Migration, mode_of
from dldsim.experiments.settling import MAP_SCATTER, Motion, analyse_path, as_migration, lane_entry
from dldsim.vocabulary import ALIKE, BROKEN, COEXISTING, MODES, SETTLED, STUCK


@dataclass(frozen=True)
class Outcome:
    """What a cell does in an array wherever it enters; the releases weighted by flux of cells.

    ``status``: "decided"; "coexisting" (decided, but releases end in different motions, or in some
    the cell gets stuck); "undecided"; stuck, unstable or failed where no release got further.
    ``migration_angle_deg``, ``angle_low_deg``, ``angle_high_deg``: mean over the flux of cells and
    its interval; ``angle_spread_deg``: largest minus smallest. ``share_…``: of the flux of cells;
    none: without an angle. ``settled_row``: most rows until settled, None if any release is not.
    ``transition_distance``: that of the release nearest to the transition.
    """

    status: str
    reason: str
    mode: str
    migration_angle_deg: float | None
    angle_low_deg: float | None
    angle_high_deg: float | None
    angle_spread_deg: float | None
    share_bump: float
    share_mixed: float
    share_zigzag: float
    share_none: float
    coexisting: bool
    settled_row: int | None
    transition_distance: float | None
    releases: int


def flux_shares(fractions: Sequence[float]) -> np.ndarray:
    """Share of the flux of cells that each place of release (0 … 1 of the gap) stands for.

    Parabolic profile 6 f (1 − f), cut at the midpoints between places.
    """
    order = np.argsort(fractions)
    places = np.asarray(fractions, dtype=float)[order]
    cuts = np.concatenate([[0.0], (places[1:] + places[:-1]) / 2, [1.0]])
    shares = np.empty(len(places))
    shares[order] = np.diff(cuts**2 * (3 - 2 * cuts))
    return shares


def taken_together(
    migrations: Mapping[float, Migration], pitch: float, periodicity: int, control: RunControl
) -> dict[float, Migration]:
    """The releases, those that are undecided alone seen once more beside the others.

    Releases of one cell in one array meet the same row map: what one of them shows of its peaks and
    of the mean holds for all that fall through its lanes alike (`passing`), and a lane that holds
    one holds another that has come to the same place (`in_the_lane_of`).
    """
    together = dict(migrations)
    for place, one in migrations.items():
        if one.status == "undecided" and len(one.lateral_steps) >= periodicity:
            others = [other for at, other in migrations.items() if at != place]
            lateral = one.positions()
            lane = in_the_lane_of(others, lateral, pitch, periodicity, control)
            together[place] = lane or analyse_path(lateral, pitch, periodicity, control, others)
    return together


def in_the_lane_of(
    others: Sequence[Migration],
    lateral: np.ndarray,
    pitch: float,
    periodicity: int,
    control: RunControl,
) -> Migration | None:
    """A path (rows + 1,) that swings about the place in the bump lane where another has settled.

    In the frame of the pillars, modulo the pitch, the mean position of its last 2 ``still_rows``
    rows is that of the other, and all of them keep within those of the other, both by the least
    scatter of the row map. Paths that began apart and have come to the same place were drawn there.
    """
    m = np.diff(lateral) * periodicity / pitch
    rows = 2 * control.still_rows
    entry = lane_entry(m, control.orbit_tolerance)
    if entry is None or len(m) - entry < rows:
        return None

    def last(positions: np.ndarray) -> np.ndarray:
        return (positions * periodicity / pitch - np.arange(len(positions)))[-rows - 1 :]

    def in_lane(other: Migration) -> bool:
        steps = other.lateral_steps * periodicity / pitch
        since = lane_entry(steps, control.orbit_tolerance)
        return since is not None and len(steps) - since >= control.still_rows

    here = last(lateral)
    for other in others:
        if other.status not in SETTLED or not in_lane(other):
            continue
        there = last(other.positions())[-control.still_rows - 1 :]
        shift = periodicity * round(float(here.mean() - there.mean()) / periodicity)
        low, high = there.min() + shift - MAP_SCATTER[0], there.max() + shift + MAP_SCATTER[0]
        apart = abs(float(here.mean() - there.mean()) - shift)
        if apart <= MAP_SCATTER[0] and low <= here.min() and here.max() <= high:
            half_width, peak = float(np.ptp(here)) / rows, float(m[entry:].max())
            return as_migration(
                Motion(
                    "stationary",
                    f"swings in the bump lane since row {entry}, about the place where another "
                    f"release has settled: {apart:.2f} row shifts from it on the mean of {rows} "
                    "rows",
                    1.0,
                    1 - half_width,
                    1 + half_width,
                    0,
                    entry,
                    peak,
                    max(peak - 1, other.transition_distance),
                    0.0,
                ),
                m,
                lateral,
                periodicity,
            )
    return None


def outcome_of(migrations: Mapping[float, Migration], periodicity: int) -> Outcome:
    """Outcome of the releases simulated so far, by place of release (fraction of the gap)."""
    found = list(migrations.values())
    shares = flux_shares(list(migrations))
    known = [k for k, one in enumerate(found) if one.migration_angle_deg is not None]
    status, reason = _verdict(migrations)
    by_mode = {
        mode: float(
            sum(share for share, one in zip(shares, found, strict=True) if one.mode == mode)
        )
        for mode in MODES
    }
    distances = [one.transition_distance for one in found if one.transition_distance is not None]
    rows = [one.settled_row for one in found]
    mean = low = high = spread = None
    if known:

        def average(name: str) -> float:
            values = [getattr(found[k], name) for k in known]
            return float(np.average(values, weights=shares[known]))

        mean, low, high = map(average, ("migration_angle_deg", "angle_low_deg", "angle_high_deg"))
        spread = float(np.ptp([found[k].migration_angle_deg for k in known]))
    return Outcome(
        status,
        reason,
        "none" if mean is None else mode_of(mean, 1 / periodicity),
        mean,
        low,
        high,
        spread,
        *(by_mode[mode] for mode in MODES),
        status == COEXISTING,
        None if None in rows else max(rows),
        min(distances, key=abs, default=None),
        len(found),
    )


def _verdict(migrations: Mapping[float, Migration]) -> tuple[str, str]:
    """Status and reason of an outcome."""
    found = list(migrations.values())
    said = "; ".join(
        f"release {place:g}: {one.status}, "
        + ("no angle" if one.migration_angle_deg is None else f"{one.migration_angle_deg:.2f}°")
        for place, one in sorted(migrations.items())
    )
    status = {one.status for one in found}
    if status <= set(BROKEN):
        return next(s for s in BROKEN if s in status), said
    if status - {*SETTLED, STUCK}:
        return "undecided", said
    low = max(one.angle_low_deg for one in found if one.status in SETTLED)
    high = min(one.angle_high_deg for one in found if one.status in SETTLED)
    return (COEXISTING if STUCK in status or low > high else ALIKE), said


def next_release(
    migrations: Mapping[float, Migration], places: Sequence[float], periodicity: int
) -> float | None:
    """The next place of release to simulate, in the given order, or None if the outcome is known.

    Two releases that agree are enough where both are far from the transition.
    """
    left = [place for place in places if place not in migrations]
    if not left:
        return None
    known = len(migrations) > 1 and outcome_of(migrations, periodicity).status == ALIKE
    clear = all(far(migration.transition_distance) for migration in migrations.values())
    return None if known and clear else left[0]


def far(distance: float | None) -> bool:
    """Whether at this transition distance no scatter of the row map would change the motion."""
    return distance is not None and abs(distance) >= MAP_SCATTER[1]
