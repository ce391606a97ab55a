"""Migration of a cell: lateral positions at the rows, angle, mode, and what is known of them.

Lateral positions y are taken where the path crosses the planes midway between rows. Lengths count
in row shifts s = λ/N_p: lateral step m = Δy/s of a row, framed position z = y/s − k at plane k, the
position seen from the pillars. Whether the motion has settled: :mod:`dldsim.experiments.settling`.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from dldsim.vocabulary import BUMP, SETTLED

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
    ``row_map_peak``: largest step on the row map in row shifts, transient left out; in the bump
    lane also of those that `lane_depth` has tried.
    ``transition_distance``: how far the map's peak lies above (bump lane) or below one row shift.
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

    @property
    def in_bump_lane(self) -> bool:
        """Whether the motion has settled there."""
        return self.status in SETTLED and self.mode == BUMP


def framed(m: np.ndarray) -> np.ndarray:
    """Positions seen from the pillars (rows + 1,), in row shifts, not wrapped."""
    return np.concatenate([[0.0], np.cumsum(m - 1)])
