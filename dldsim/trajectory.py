"""From a path through the array to rows, orbit, migration angle and mode.

Seen from the pillars, a cell that has forgotten its release repeats its motion: row after row when
it bumps, every N_p rows or so when it zigzags. Lateral positions are taken where the path crosses
the planes midway between rows; everything is in the units of the positions given.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

REPEAT_WITHIN = 0.25
"""Every position of a repeating orbit returns to within this fraction of the row shift."""
BUMP_FROM, ZIGZAG_TO = 0.9, 0.1
"""Shares of the full bump displacement that separate bump, mixed and zigzag mode."""


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


@dataclass(frozen=True)
class Orbit:
    """A motion that repeats every ``rows`` rows, but for ``drift`` per row (in row shifts)."""

    rows: int
    drift: float


def find_orbit(
    lateral: np.ndarray, pitch: float, periodicity: int, tolerance: float
) -> Orbit | None:
    """Shortest orbit on which the path has settled, or None.

    ``lateral`` (rows + 1,): positions at the crossings. In the frame of the pillars, modulo the
    pitch, every position of the last p rows, and of the last array period, must be that of p rows
    before within a quarter of the row shift; the mean drift per row must stay below ``tolerance``
    row shifts.
    """
    row_shift = pitch / periodicity
    framed = lateral - row_shift * np.arange(len(lateral))
    for p in range(1, len(lateral) // 2 + 1):
        returns = max(p, periodicity)
        if len(framed) < returns + p:
            return None
        change = framed[-returns:] - framed[-returns - p : -p]
        change = (change - pitch * np.round(change / pitch)) / row_shift
        drift = change.mean() / p
        if np.abs(change).max() <= REPEAT_WITHIN and abs(drift) <= tolerance:
            return Orbit(p, float(drift))
    return None


def angle_deg(lateral: np.ndarray, rows: int, pitch: float, until: int | None = None) -> float:
    """arctan(Δy/Δx) over the ``rows`` rows that end at crossing ``until`` (default: the last)."""
    end = len(lateral) - 1 if until is None else until
    return math.degrees(math.atan((lateral[end] - lateral[end - rows]) / (rows * pitch)))


def mode_of(migration_angle_deg: float, row_shift_fraction: float) -> str:
    """Bump, zigzag or mixed, by the share of the full bump displacement."""
    share = math.tan(math.radians(migration_angle_deg)) / row_shift_fraction
    if share >= BUMP_FROM:
        return "bump"
    return "zigzag" if share <= ZIGZAG_TO else "mixed"


SETTLED = ("converged", "periodic", "stationary")
"""Statuses of a run whose settled motion is known."""
DECIDED = ("decided", "coexisting")
"""Statuses of an outcome whose angle is known."""


@dataclass(frozen=True)
class Migration:
    """Result of one release; angles [°] are None where the path is too short for them.

    ``status``: converged, periodic, stationary, undecided; stuck, unstable, failed (no angles).
    ``angle_low_deg``, ``angle_high_deg``: 95 % interval of the settled mean.
    """

    status: str
    reason: str
    mode: str
    migration_angle_deg: float | None
    angle_low_deg: float | None
    angle_high_deg: float | None
    first_period_angle_deg: float | None
    orbit_rows: int
    settled_row: int | None
    row_map_peak: float | None
    transition_distance: float | None
    capture_chance: float | None
    lateral_steps: np.ndarray


def analyse_path(lateral: np.ndarray, pitch: float, periodicity: int, control) -> Migration:
    """Migration of a cell from its lateral positions at the row crossings (rows + 1,).

    Status "converged" (repeats every row), "periodic" (every p rows) or "undecided" (does not
    repeat; the angle is that of the second half, at least N_p rows, and the interval reaches up to
    the bump angle). ``control``: its `orbit_tolerance` is the drift of an orbit.
    """
    rows = len(lateral) - 1
    steps = np.diff(lateral)
    if rows < periodicity:
        return Migration(
            "undecided", f"only {rows} rows, fewer than one period of {periodicity}", "none",
            None, None, None, None, 0, None, None, None, None, steps,
        )  # fmt: skip
    first = angle_deg(lateral, periodicity, pitch, periodicity)
    bump = math.degrees(math.atan(1 / periodicity))
    peak = float(steps[-max(periodicity, rows // 2) :].max() * periodicity / pitch)
    orbit = find_orbit(lateral, pitch, periodicity, control.orbit_tolerance)
    if orbit:
        angle = angle_deg(lateral, orbit.rows * max(1, periodicity // orbit.rows), pitch)
        half = math.degrees(math.atan(abs(orbit.drift) / periodicity))
        return Migration(
            "converged" if orbit.rows == 1 else "periodic",
            f"the motion repeats every {orbit.rows} row(s) with a drift of "
            f"{abs(orbit.drift):.3f} row shifts per row",
            mode_of(angle, 1 / periodicity), angle, angle - half, angle + half, first, orbit.rows,
            rows - max(orbit.rows, periodicity), peak, peak - 1, 0.0, steps,
        )  # fmt: skip
    window = max(periodicity, rows // 2)
    angle = angle_deg(lateral, window, pitch)
    return Migration(
        "undecided", f"the motion did not repeat in {rows} rows; angle of the last {window} rows",
        mode_of(angle, 1 / periodicity), angle, min(angle, 0.0), max(angle, bump), first, 0, None,
        peak, peak - 1, None, steps,
    )  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """What a cell does that enters anywhere: mean over the flux of cells, angles [°].

    ``status``: decided, coexisting (releases end in different motions), undecided, stuck, unstable,
    failed. ``settled_row``: most rows until a release has settled.
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
    """Share of the flux of cells that each place of release (gap fraction 0 to 1) stands for.

    Parabolic profile 6 f (1 − f), cut at the midpoints between places.
    """
    places = np.asarray(fractions, float)
    order = np.argsort(places)
    cuts = np.r_[0.0, (places[order][1:] + places[order][:-1]) / 2, 1.0]
    shares = np.empty(len(places))
    shares[order] = np.diff(cuts**2 * (3 - 2 * cuts))
    return shares


def outcome_of(migrations: Mapping[float, Migration], periodicity: int) -> Outcome:
    """Outcome of the releases, keyed by their gap fraction."""
    runs = list(migrations.values())
    shares = flux_shares([*migrations])
    by_mode = {mode: float(sum(s for s, m in zip(shares, runs, strict=True) if m.mode == mode))
               for mode in ("bump", "mixed", "zigzag", "none")}
    known = [(s, m) for s, m in zip(shares, runs, strict=True) if m.migration_angle_deg is not None]
    angles = [m.migration_angle_deg for _, m in known]
    modes = {m.mode for _, m in known}
    broken = [m for m in runs if m.status in ("failed", "unstable", "stuck")]
    open_ = [m for m in runs if m.status == "undecided"]
    coexisting = len(modes) > 1
    if broken:
        status, reason = broken[0].status, broken[0].reason
    elif open_:
        status, reason = "undecided", open_[0].reason
    elif coexisting:
        status, reason = "coexisting", f"the releases end in {', '.join(sorted(modes))}"
    else:
        status, reason = "decided", f"{len(runs)} release(s) end in the same motion"
    if broken or not known:
        angle = low = high = None
    else:
        weight = sum(s for s, _ in known)
        angle, low, high = (
            float(sum(s * getattr(m, name) for s, m in known) / weight)
            for name in ("migration_angle_deg", "angle_low_deg", "angle_high_deg")
        )
    settled = [m.settled_row for m in runs]
    distances = [m.transition_distance for m in runs if m.transition_distance is not None]
    return Outcome(
        status, reason, "none" if angle is None else mode_of(angle, 1 / periodicity), angle, low,
        high, max(angles) - min(angles) if angles else None,
        *(by_mode[mode] for mode in ("bump", "mixed", "zigzag", "none")), coexisting,
        None if None in settled else max(settled, default=None),
        min(distances, key=abs, default=None), len(runs),
    )  # fmt: skip


NEAR = 0.15
"""Distance from the transition within which all places are tried."""


def next_release(
    migrations: Mapping[float, Migration], places: Sequence[float], periodicity: int
) -> float | None:
    """The next place to try, in the given order, or None when enough is known.

    Two settled releases of one mode, overlapping intervals and far from the transition are enough.
    """
    left = [place for place in places if place not in migrations]
    runs = list(migrations.values())
    if not left or any(m.status in ("failed", "unstable") for m in runs):
        return None
    if len(runs) >= 2 and all(m.status in SETTLED for m in runs):
        same = len({m.mode for m in runs}) == 1
        far = all(abs(m.transition_distance or 0.0) > NEAR for m in runs)
        if same and far:
            return None
    return left[0]
