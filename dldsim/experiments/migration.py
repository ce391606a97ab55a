"""From a path through the array to its settled motion; from several releases to an outcome.

Lateral positions y are taken where the path crosses the planes midway between rows. Lengths count
in row shifts s = λ/N_p: lateral step m = Δy/s of a row, framed position z = y/s − k at plane k, the
position seen from the pillars. Row map: m against z modulo N_p. Its shape decides the motion:

- In the bump lane m returns to 1 on both sides of a resting z: the cell stays and bumps.
- Where m stays below 1, z falls through one lane (N_p row shifts) after another. A *pass* is one
  such fall; passes of P rows carry 1 − N_p/P row shifts per row. Each passes the peak of the map
  once, and only a peak of at least 1 can let the bump lane catch the cell.

The map is a curve with a scatter, for m also depends on shape and orientation of the cell. So a
motion has settled when it rests in the lane, when its returns tighten, or when its mean and the
chance of another motion are known from repetitions: then, and then only, is its angle decided.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.stats import f_oneway
from scipy.stats import t as student

from dldsim.config.sections import RunControl
from dldsim.vocabulary import BROKEN, MODES, SETTLED

BUMP_FROM, ZIGZAG_TO = 0.9, 0.1
"""Shares of the full bump displacement that separate bump, mixed and zigzag mode."""
MAP_SCATTER = (0.1, 0.3)
"""Least and most scatter of the row map by shape and orientation, in row shifts."""
STILL_WITHIN = 0.25
"""A cell rests in the bump lane if it moves by less than this, in row shifts."""
LANE_WIDTH = 1.0
"""A cell that stays within so many row shifts may be in the bump lane."""
CONFIDENCE = 0.95
UNLIKE = 0.05
"""Releases are unlike if the scatter of their passes' lengths has at most this chance (F test)."""


def row_crossings(x: np.ndarray, y: np.ndarray, first: float, pitch: float) -> np.ndarray:
    """Lateral position at x = first, first + pitch, … up to the last x reached.

    ``x`` increases on the whole; each plane is taken at its first crossing, linearly interpolated.
    """
    ahead = np.maximum.accumulate(x)
    planes = first + pitch * np.arange((ahead[-1] - first) / pitch + 2)
    planes = planes[planes <= ahead[-1]]
    after = np.searchsorted(ahead, planes)
    before = np.maximum(after - 1, 0)
    width = x[after] - x[before]
    share = np.where(width > 0, (planes - x[before]) / np.where(width > 0, width, 1), 1.0)
    return y[before] + share * (y[after] - y[before])


def angle_of(mean_step: float, periodicity: int) -> float:
    """Angle [°] of a motion of ``mean_step`` row shifts per row."""
    return math.degrees(math.atan(mean_step / periodicity))


def mode_of(migration_angle_deg: float, row_shift_fraction: float) -> str:
    """Bump, zigzag or mixed, by the share of the full bump displacement."""
    share = math.tan(math.radians(migration_angle_deg)) / row_shift_fraction
    if share >= BUMP_FROM:
        return "bump"
    return "zigzag" if share <= ZIGZAG_TO else "mixed"


@dataclass(frozen=True)
class Migration:
    """Motion from one release; angles [°] are None where the path is too short for them.

    ``status``: "converged" (rests in the bump lane), "periodic" (orbit of p rows whose returns
    tighten or are below resolution), "stationary" (no orbit, but the mean is known to the tolerance
    and another motion is excluded), "undecided"; stuck, unstable, failed: the run broke off.
    ``angle_low_deg``, ``angle_high_deg``: 95 % interval of the settled mean; of an undecided
    motion, bounds that include the bump angle where the bump lane may still catch it.
    ``first_period_angle_deg``: angle of the first N_p rows, the source's protocol.
    ``orbit_rows``: p, or 0. ``settled_row``: row from which the settled motion holds.
    ``row_map_peak``: largest step on the row map in row shifts, transient left out.
    ``transition_distance``: how far the map's peak lies above (bump lane) or below one row shift;
    above it is a lower bound, for a cell at rest sees little of the map.
    ``capture_chance``: chance per row that the bump lane catches a motion that is not on it.
    ``lateral_steps`` (rows,) and ``lateral_start``, the first position: in the units of the
    positions.
    """

    status: str
    reason: str
    mode: str = "none"
    migration_angle_deg: float | None = None
    angle_low_deg: float | None = None
    angle_high_deg: float | None = None
    first_period_angle_deg: float | None = None
    orbit_rows: int = 0
    settled_row: int | None = None
    row_map_peak: float | None = None
    transition_distance: float | None = None
    capture_chance: float | None = None
    lateral_steps: np.ndarray = field(default_factory=lambda: np.empty(0))
    lateral_start: float = 0.0

    def positions(self) -> np.ndarray:
        """Lateral positions (rows + 1,)."""
        return self.lateral_start + np.concatenate([[0.0], np.cumsum(self.lateral_steps)])


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
) -> Migration:
    """Migration of a cell from its lateral positions at the row crossings (rows + 1,).

    ``others``: other releases of the same cell in the same array, in the same unit; where they fall
    through lane after lane alike, their passes count as well. Nothing is decided before the first
    array period is complete.
    """
    steps = np.diff(lateral)
    rows = len(steps)
    if rows < periodicity:
        return Migration(
            "undecided",
            f"only {rows} rows, fewer than one period of {periodicity}",
            lateral_steps=steps,
            lateral_start=float(lateral[0]) if len(lateral) else 0.0,
        )
    m = steps * periodicity / pitch
    found = (
        resting(m, control)
        or repeating(m, periodicity, control)
        or swinging(m, periodicity, control)
        or passing(m, periodicity, control, falling(others, pitch, periodicity))
        or undecided(m, periodicity, control)
    )
    return _migration(found, m, lateral, periodicity)


def _migration(found: Motion, m: np.ndarray, lateral: np.ndarray, periodicity: int) -> Migration:
    """Migration of a motion on a path of steps m in row shifts."""
    angle = angle_of(found.mean, periodicity)
    return Migration(
        found.status,
        found.reason,
        mode_of(angle, 1 / periodicity),
        angle,
        angle_of(found.low, periodicity),
        angle_of(found.high, periodicity),
        angle_of(m[:periodicity].mean(), periodicity),
        found.orbit_rows,
        found.settled_row,
        found.peak,
        found.distance,
        found.capture,
        np.diff(lateral),
        float(lateral[0]),
    )


# ------------------------------------------------------------------------------- in the bump lane


def framed(m: np.ndarray) -> np.ndarray:
    """Positions seen from the pillars (rows + 1,), in row shifts, not wrapped."""
    return np.concatenate([[0.0], np.cumsum(m - 1)])


def lane_entry(m: np.ndarray, tolerance: float) -> int | None:
    """Row of the first full step since which the path has stayed within one lane's width."""
    z = framed(m)[::-1]
    width = np.maximum.accumulate(z) - np.minimum.accumulate(z)
    start = len(m) + 1 - int(np.count_nonzero(width <= LANE_WIDTH))
    full = np.flatnonzero(m[start:] >= 1 - tolerance)
    return start + int(full[0]) if len(full) else None


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

    Its lowest positions of n swings give a predictive distribution of the next (Student's t). The
    lane holds if the chance that this falls below the lowest one from which the cell has come back,
    by more than the scatter of the row map, is below ``capture_chance_max`` per row.
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
    dips = [part for part in dips if len(part) and part[-1] < len(z) - 1]
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


@dataclass(frozen=True)
class Passes:
    """Falls through whole lanes: ``starts`` (n + 1,) in rows, ``peaks`` (n,) in row shifts.

    ``start_errors`` (n + 1,): bound of the interpolation's error in the starts, in rows.
    """

    starts: np.ndarray
    start_errors: np.ndarray
    peaks: np.ndarray

    def __len__(self) -> int:
        return len(self.peaks)

    def rows(self) -> np.ndarray:
        return np.diff(self.starts)


def find_passes(m: np.ndarray, periodicity: int) -> Passes:
    """Complete passes, each from a quarter lane before the peak of the row map to the next.

    All of them count, and the rows before the first start are the transient: to leave out more by
    looking at the scatter would make it too small.

    A start is where z first falls below its level, linearly interpolated within the row; that is
    wrong by at most an eighth of the second difference of z.
    """
    z = np.minimum.accumulate(framed(m))
    top = framed(m)[int(np.argmax(m[1:])) + 1] if len(m) > 1 else 0.0
    first = top + periodicity / 4
    first -= periodicity * math.floor((first - z[0]) / periodicity + 1)
    levels = np.arange(first, z[-1], -periodicity)
    after = np.searchsorted(-z, -levels, side="left")
    starts = after - (levels - z[after]) / (z[after - 1] - z[after])
    whole = np.floor(starts).astype(int)
    peaks = [m[a:b].max() for a, b in pairwise(whole)]
    bend = np.abs(np.diff(m, prepend=m[0], append=m[-1]))
    errors = np.maximum(bend[whole], bend[whole + 1]) / 8 / np.abs(m[whole] - 1)
    return Passes(starts, errors, np.array(peaks))


def chance_beyond(values: np.ndarray, limit: float, resolution: float) -> float:
    """Chance that the next value reaches ``limit``: Student's t, n − 1 degrees of freedom.

    A value is known to the resolution: to the scatter comes that of a uniform error so wide.
    """
    n = len(values)
    scatter = math.hypot(values.std(ddof=1), resolution / math.sqrt(12)) * math.sqrt(1 + 1 / n)
    return float(student.sf((limit - values.mean()) / scatter, n - 1))


def mean_of_passes(releases: Sequence[Passes], periodicity: int) -> tuple[float, float, float]:
    """Mean step of at least two passes and its 95 % interval.

    By the scatter of the passes' lengths (Student's t), and the errors of first and last start of
    each release.
    """
    rows = np.concatenate([passes.rows() for passes in releases])
    ends = sum(passes.start_errors[[0, -1]].sum() for passes in releases)
    half_width = student.ppf((1 + CONFIDENCE) / 2, len(rows) - 1) * rows.std(ddof=1)
    half_width = half_width / math.sqrt(len(rows)) + ends / len(rows)
    bounds = rows.mean(), max(1.0, rows.mean() - half_width), rows.mean() + half_width
    mean, low, high = (1 - periodicity / bound for bound in bounds)
    return float(mean), float(low), float(high)


def falling(others: Sequence[Migration], pitch: float, periodicity: int) -> list[Passes]:
    """Passes of other releases that fall through lane after lane, without an orbit.

    Empty if one of them was caught after a pass: then the lane does catch, and how often cannot be
    told from the passes that it let go.
    """
    found = []
    for one in others:
        passes = find_passes(one.lateral_steps * periodicity / pitch, periodicity)
        if one.status in ("stationary", "undecided") and len(passes) > 1:
            found.append(passes)
        elif one.status == "converged" and len(passes):
            return []
    return found


def alike(releases: Sequence[Passes]) -> bool:
    """Whether passes of several releases may be of one motion, by the scatter of their lengths."""
    lengths = [passes.rows() for passes in releases]
    within = sum(float(((rows - rows.mean()) ** 2).sum()) for rows in lengths)
    if within == 0:
        return float(np.ptp(np.concatenate(lengths))) == 0
    return float(f_oneway(*lengths).pvalue) > UNLIKE


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


def capture_per_row(releases: Sequence[Passes], control: RunControl) -> float:
    """Chance per row that the next pass has a peak of one row shift, which capture needs."""
    peaks = np.concatenate([passes.peaks for passes in releases])
    rows = np.concatenate([passes.rows() for passes in releases])
    return chance_beyond(peaks, 1.0, control.orbit_tolerance) / float(rows.mean())


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


# ------------------------------------------------------------------------------- several releases


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
            return _migration(
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
                    peak - 1,
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
        status == "coexisting",
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
    if status - {*SETTLED, "stuck"}:
        return "undecided", said
    low = max(one.angle_low_deg for one in found if one.status in SETTLED)
    high = min(one.angle_high_deg for one in found if one.status in SETTLED)
    return ("coexisting" if "stuck" in status or low > high else "decided"), said


def next_release(
    migrations: Mapping[float, Migration], places: Sequence[float], periodicity: int
) -> float | None:
    """The next place of release to simulate, in the given order, or None if the outcome is known.

    Two releases that agree are enough where both are far from the transition: a bump lane whose map
    exceeds one row shift by the least scatter of the row map, or peaks below it by the most.
    """
    left = [place for place in places if place not in migrations]
    if not left:
        return None
    known = len(migrations) > 1 and outcome_of(migrations, periodicity).status == "decided"
    return None if known and all(map(_far, migrations.values())) else left[0]


def _far(migration: Migration) -> bool:
    """Whether no scatter of the row map would change the motion."""
    distance = migration.transition_distance
    return distance is not None and (distance >= MAP_SCATTER[0] or distance <= -MAP_SCATTER[1])
