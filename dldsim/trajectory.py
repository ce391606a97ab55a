"""From a path through the array to rows, orbit, migration angle and mode.

Seen from the pillars, a cell that has forgotten its release repeats its motion: row after row when
it bumps, every N_p rows or so when it zigzags. Lateral positions are taken where the path crosses
the planes midway between rows; everything is in the units of the positions given.
"""

import math
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


@dataclass(frozen=True)
class Migration:
    """Result of a path; angles [°] are None where the path is too short for them."""

    status: str
    reason: str
    mode: str
    migration_angle_deg: float | None
    first_period_angle_deg: float | None
    sigma_orbit_deg: float | None
    orbit_rows: int
    lateral_steps: np.ndarray


def analyse_path(
    lateral: np.ndarray, pitch: float, periodicity: int, tolerance: float
) -> Migration:
    """Migration of a cell from its lateral positions at the row crossings (rows + 1,).

    Status "converged" (repeats every row), "periodic" (every p rows) or "period_limit" (does not
    repeat; the angle is that of the second half, at least N_p rows). ``sigma_orbit_deg`` is how
    well the motion repeats: the drift on an orbit, else the change against the rows before.
    """
    rows = len(lateral) - 1
    steps = np.diff(lateral)
    first = angle_deg(lateral, periodicity, pitch, periodicity) if rows >= periodicity else None
    orbit = find_orbit(lateral, pitch, periodicity, tolerance)
    if orbit:
        window = orbit.rows * max(1, periodicity // orbit.rows)
        angle = angle_deg(lateral, window, pitch)
        sigma = math.degrees(math.atan(abs(orbit.drift) / periodicity))
        status = "converged" if orbit.rows == 1 else "periodic"
        reason = (
            f"the motion repeats every {orbit.rows} row(s) with a drift of "
            f"{abs(orbit.drift):.3f} row shifts per row"
        )
    elif rows >= periodicity:
        window = max(periodicity, rows // 2)
        angle = angle_deg(lateral, window, pitch)
        back = min(window, rows - window)
        before = angle_deg(lateral, back, pitch, rows - window) if back else None
        sigma = None if before is None else abs(angle - before)
        status = "period_limit"
        reason = f"the motion did not repeat in {rows} rows; angle of the last {window} rows"
    else:
        return Migration(
            "period_limit", f"only {rows} rows, fewer than one period of {periodicity}", "none",
            None, None, None, 0, steps,
        )  # fmt: skip
    mode = mode_of(angle, 1 / periodicity)
    return Migration(status, reason, mode, angle, first, sigma, orbit.rows if orbit else 0, steps)
