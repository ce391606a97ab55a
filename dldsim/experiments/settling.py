"""When a motion has settled, and into which: the bump lane, an orbit, or passes of known mean.

Row map: lateral step m of a row, in row shifts, against the position z seen from the pillars,
modulo N_p (see :mod:`dldsim.experiments.migration`). Its shape decides the motion:

- In the bump lane m returns to 1 on both sides of a resting z: the cell stays and bumps.
- Where m stays below 1, z falls through one lane (N_p row shifts) after another. A *pass* is one
  such fall; passes of P rows carry 1 − N_p/P row shifts per row. Each passes the peak of the map
  once, and only a peak of at least 1 can let the bump lane catch the cell.

The map is a curve with a scatter, for m also depends on shape and orientation of the cell. So a
motion has settled when it rests in the lane, when its returns tighten, or when its mean and the
chance of another motion are known from repetitions: then, and then only, is its angle decided.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dldsim.config.sections import RunControl
from dldsim.experiments.migration import Migration, angle_of, framed, mode_of
from dldsim.experiments.passes import (
    Passes,
    alike,
    capture_per_row,
    chance_beyond,
    falling,
    find_passes,
    mean_of_passes,
)

MAP_SCATTER = (0.1, 0.3)
"""Least and most scatter of the row map by shape and orientation, in row shifts."""
STILL_WITHIN = 0.25
"""A cell rests in the bump lane if it moves by less than this, in row shifts."""
LANE_WIDTH = 1.0
"""A cell that stays within so many row shifts may be in the bump lane."""
LANE_ROWS = 3
"""Rows that a cell has stayed in what may be the bump lane before that is tried."""


@dataclass(frozen=True)
class Motion:
    """What a path shows of its settled motion; steps in row shifts per row."""

    status: str
    reason: str
    mean: float
    low: float
    high: float
    orbit_rows: int = 0
    settled_row: int | None = None
    peak: float | None = None
    distance: float | None = None
    capture: float | None = None


def analyse_path(
    lateral: np.ndarray,
    pitch: float,
    periodicity: int,
    control: RunControl,
    others: Sequence[Migration] = (),
    probes: Sequence[tuple[float, float]] = (),
) -> Migration:
    """Migration of a cell from its lateral positions at the row crossings (rows + 1,).

    ``others``: other releases of the same cell in the same array, in the same unit; where they fall
    through lane after lane alike, their passes count as well. ``probes``: of
    the bump lane from the last position (`held`). Unless they decide, nothing is decided before the
    first array period is complete.
    """
    steps = np.diff(lateral)
    rows = len(steps)
    m = steps * periodicity / pitch
    if found := held(m, control, probes):
        return as_migration(found, m, lateral, periodicity)
    if rows < periodicity:
        return Migration(
            "undecided",
            f"only {rows} rows, fewer than one period of {periodicity}",
            lateral_steps=steps,
            lateral_start=float(lateral[0]) if len(lateral) else 0.0,
        )
    found = (
        resting(m, control)
        or repeating(m, periodicity, control)
        or swinging(m, periodicity, control)
        or passing(m, periodicity, control, falling(others, pitch, periodicity))
        or undecided(m, periodicity, control)
    )
    return as_migration(found, m, lateral, periodicity)


def as_migration(found: Motion, m: np.ndarray, lateral: np.ndarray, periodicity: int) -> Migration:
    """Migration of a motion on a path of steps m in row shifts."""
    angle = angle_of(found.mean, periodicity)
    return Migration(
        found.status,
        found.reason,
        mode_of(angle, 1 / periodicity),
        angle,
        angle_of(found.low, periodicity),
        angle_of(found.high, periodicity),
        angle_of(m[:periodicity].mean(), periodicity) if len(m) >= periodicity else None,
        found.orbit_rows,
        found.settled_row,
        found.peak,
        found.distance,
        found.capture,
        np.diff(lateral),
        float(lateral[0]),
    )


# ------------------------------------------------------------------------------- in the bump lane


def lane_entry(m: np.ndarray, tolerance: float) -> int | None:
    """Row of the first full step since which the path has stayed within one lane's width."""
    z = framed(m)[::-1]
    width = np.maximum.accumulate(z) - np.minimum.accumulate(z)
    start = len(m) + 1 - int(np.count_nonzero(width <= LANE_WIDTH))
    full = np.flatnonzero(m[start:] >= 1 - tolerance)
    return start + int(full[0]) if len(full) else None


def may_be_held(m: np.ndarray, control: RunControl) -> bool:
    """Whether a path has stayed in what may be the bump lane, and is not about to fall."""
    entry = lane_entry(m, control.orbit_tolerance)
    return entry is not None and len(m) - entry >= LANE_ROWS and m[-1] >= 1 - STILL_WITHIN


def held(
    m: np.ndarray, control: RunControl, probes: Sequence[tuple[float, float]]
) -> Motion | None:
    """A bump lane that the scatter of the row map cannot open.

    ``probes``: offset, nearer to the pillar than the last position, and step from there, of those
    that came back. One counts if it began below all places that the cell has been at in the lane,
    and came back nearer to the middle of them than it began: swings do not grow. A step of one row
    shift and the most scatter of the map, or more: no shape or orientation lets the cell fall from
    there to where it is. Its mean step is then one row shift for good.
    """
    entry = lane_entry(m, control.orbit_tolerance)
    if entry is None:
        return None
    z = framed(m)[entry:]
    middle = float(z.min() + z.max()) / 2

    def counts(offset: float, step: float) -> bool:
        begin = z[-1] - offset
        return begin <= z.min() and begin + step - 1 - middle <= middle - begin

    depth = max((step - 1 for offset, step in probes if counts(offset, step)), default=0.0)
    if depth < MAP_SCATTER[1]:
        return None
    return Motion(
        "converged",
        f"held by the bump lane since row {entry}: put nearer to the pillar it comes back by "
        f"{depth:.2f} row shifts per row, as much as shape and orientation scatter the row map or "
        "more",
        1.0,
        1.0,
        1.0,
        1,
        entry,
        1 + depth,
        depth,
        0.0,
    )


def resting(m: np.ndarray, control: RunControl) -> Motion | None:
    """The bump lane, reached and stable.

    For ``still_rows`` rows the cell has moved by less than a quarter of a row shift and has kept
    within the positions that it took since it entered the lane, so that its excursions tighten; or
    it has moved by less than the resolution, in the second half at most half as far as in the
    first. A cell that slowly passes a peak of about one row shift fails: it ends its stay at its
    lowest position, and its drift fades no faster than the inverse square of the rows.
    """
    entry = lane_entry(m, control.orbit_tolerance)
    still = control.still_rows
    if entry is None or len(m) - entry < still:
        return None
    z = framed(m)[entry:]
    before, last = z[: len(z) - still], z[-still - 1 :]
    moved = float(np.ptp(last))
    within = (
        len(before) > 1
        and last.min() >= before.min() - 1e-9
        and last.max() <= before.max() + 1e-9
        and moved <= STILL_WITHIN
    )
    half = still // 2
    fades = moved <= control.orbit_tolerance and np.ptp(last[half:]) <= np.ptp(last[: half + 1]) / 2
    if not (within or fades):
        return None
    peak = float(m[entry:].max())
    return Motion(
        "converged",
        f"rests in the bump lane since row {entry}: moved by {moved:.3f} row shifts in the last "
        f"{still} rows, " + ("within the positions taken before" if within else "less and less"),
        1.0,
        1 - moved / still,
        1 + moved / still,
        1,
        entry,
        peak,
        peak - 1,
        0.0,
    )


def swinging(m: np.ndarray, periodicity: int, control: RunControl) -> Motion | None:
    """A bump lane in which the cell goes on swinging, as a tumbling cell does.

    Its lowest positions of n swings, all but the first, which belongs to the entry, give a
    predictive distribution of the next (Student's t). The lane holds if the chance that this falls
    below the lowest one from which the cell has come back, by more than the scatter of the row map,
    is below ``capture_chance_max`` per row.
    """
    entry = lane_entry(m, control.orbit_tolerance)
    if entry is None:
        return None
    z = framed(m)[entry:]
    if np.ptp(z[-control.still_rows - 1 :]) <= STILL_WITHIN:
        return None  # rest or none yet
    middle = (z.min() + z.max()) / 2
    below = np.flatnonzero(z < middle)
    dips = np.split(below, np.flatnonzero(np.diff(below) > 1) + 1)
    dips = [part for part in dips if len(part) and part[-1] < len(z) - 1][1:]
    if len(dips) < 3:
        return None
    lowest = np.array([z[part].min() for part in dips])
    rows_per_swing = (dips[-1][-1] - dips[0][-1]) / (len(dips) - 1)
    fall = chance_beyond(-lowest, -lowest.min() + MAP_SCATTER[0], control.orbit_tolerance)
    fall /= rows_per_swing
    rows = len(m) - entry
    half_width = float(np.ptp(z)) / rows
    if fall > control.capture_chance_max or half_width > control.mean_tolerance:
        return None
    peak = float(m[entry:].max())
    return Motion(
        "stationary",
        f"swings in the bump lane since row {entry}: {len(dips)} swings of {rows_per_swing:.1f} "
        f"rows, chance to leave it {fall:.1g} per row",
        1.0,
        1 - half_width,
        1 + half_width,
        0,
        entry,
        peak,
        peak - 1,
        0.0,
    )


# -------------------------------------------------------------------------------- orbits and passes


def repeating(m: np.ndarray, periodicity: int, control: RunControl) -> Motion | None:
    """Shortest orbit of p > 1 rows on which the path has settled.

    In the frame of the pillars, modulo the pitch, every position of the last p rows, and of the
    last array period, is that of p rows before: within ``orbit_tolerance``; or within the scatter
    of the row map, after returns that halved twice from orbit to orbit. (Halved once, a motion may
    be passing an orbit that it then leaves.) An orbit that falls through j lanes in p rows moves by
    1 − j N_p/p row shifts per row. Its interval is that of a cell that is off by the last return
    where it lingers: at the peak of the row map. What moves by less than a quarter of a row shift
    is no orbit but rest.
    """
    z = framed(m)
    for p in range(2, len(m) // 2 + 1):
        block = max(p, periodicity)
        if len(m) < block + p:
            return None
        change = z[p:] - z[:-p]
        lanes = -round(float(change[-1]) / periodicity)
        if np.ptp(z[-p - 1 :]) <= STILL_WITHIN:
            continue
        change = np.abs(change + lanes * periodicity)
        ends = [len(change) - p * back for back in range(3)]
        off, *earlier = (float(change[max(0, end - block) : end].max()) for end in ends if end > 0)
        halved = ends[2] >= block and off <= earlier[0] / 2 <= earlier[1] / 4
        if off <= control.orbit_tolerance or (halved and off <= MAP_SCATTER[0]):
            peak = float(m[-block:].max())
            mean = 1 - lanes * periodicity / p
            late = off / max(1 - peak, MAP_SCATTER[0])
            half_width = lanes * periodicity * late / p**2 + off / p
            how = "are below the resolution" if off <= control.orbit_tolerance else "tighten"
            return Motion(
                "periodic",
                f"repeats every {p} rows; returns are within {off:.3f} row shifts and {how}",
                mean,
                mean - half_width,
                mean + half_width,
                p,
                len(m) - block - p,
                peak,
                peak - 1,
                0.0,
            )
    return None


def passing(
    m: np.ndarray, periodicity: int, control: RunControl, others: Sequence[Passes] = ()
) -> Motion | None:
    """A motion through lane after lane whose mean is known and that the bump lane cannot catch.

    The 95 % interval of the mean has a half-width of at most ``mean_tolerance``, and the chance per
    row that a pass has a peak of one row shift is at most ``capture_chance_max``. Three passes are
    the least: of this release alone or, where they are alike, two of it and those of ``others``.
    """
    own = find_passes(m, periodicity)
    if len(own) < 2:
        return None
    releases = [own, *others] if others and alike([own, *others]) else [own]
    count = sum(map(len, releases))
    if count < 3:
        return None
    mean, low, high = mean_of_passes(releases, periodicity)
    capture = capture_per_row(releases, control)
    if max(high - mean, mean - low) > control.mean_tolerance:
        return None
    if capture > control.capture_chance_max:
        return None
    peaks = np.concatenate([passes.peaks for passes in releases])
    shared = f", {len(own)} of them here and those of other releases alike" if releases[1:] else ""
    return Motion(
        "stationary",
        f"{count} passes of {periodicity / (1 - mean):.2f} rows with peaks of {peaks.mean():.2f} "
        f"row shifts{shared}; chance of capture by the bump lane {capture:.1g} per row",
        mean,
        low,
        high,
        0,
        int(own.starts[0]),
        float(peaks.max()),
        float(peaks.mean()) - 1,
        capture,
    )


def undecided(m: np.ndarray, periodicity: int, control: RunControl) -> Motion:
    """The mean of the second half (at least N_p rows) with bounds of what it may become.

    The upper bound is full bump unless passes exclude it. The lower bound comes of the passes; with
    fewer than two it is no lateral motion, or the mean where that is lower.
    """
    window = max(periodicity, len(m) // 2)
    mean = float(m[-window:].mean())
    passes = find_passes(m, periodicity)
    capture, low, high = None, min(0.0, mean), max(1.0, mean)
    distance = None
    reason = f"not settled in {len(m)} rows: {len(passes)} complete passes"
    if len(passes) > 1:
        capture = capture_per_row([passes], control)
        distance = float(passes.peaks.mean()) - 1
        expected, low, high = mean_of_passes([passes], periodicity)
        low, high = min(low, mean), max(high, mean)
        if capture > control.capture_chance_max:
            high = max(1.0, high)
            reason += f", chance of capture by the bump lane {capture:.1g} per row"
        else:
            reason += f", mean {expected:.2f} within {low:.2f} to {high:.2f} row shifts per row"
    peak = float(m[-window:].max())
    return Motion("undecided", reason, mean, low, high, 0, None, peak, distance, capture)
