"""Falls through whole lanes: their lengths and peaks, what they say of mean and capture.

Positions count in row shifts; see :mod:`dldsim.experiments.settling`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.special import fdtrc, stdtr, stdtrit

from dldsim.config.sections import RunControl
from dldsim.experiments.migration import Migration, framed
from dldsim.vocabulary import SETTLED

CONFIDENCE = 0.95
UNLIKE = 0.05
"""Releases are unlike if the scatter of their passes' lengths has at most this chance (F test)."""


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
    whole = after - 1  # the row in which it falls
    peaks = [m[a : max(b, a + 1)].max() for a, b in pairwise(whole)]
    bend = np.abs(np.diff(m, prepend=m[0], append=m[-1]))
    errors = np.maximum(bend[whole], bend[whole + 1]) / 8 / np.abs(m[whole] - 1)
    return Passes(starts, errors, np.array(peaks))


def chance_beyond(values: np.ndarray, limit: float, resolution: float) -> float:
    """Chance that the next value reaches ``limit``: Student's t, n − 1 degrees of freedom.

    A value is known to the resolution: to the scatter comes that of a uniform error so wide.
    """
    n = len(values)
    scatter = math.hypot(values.std(ddof=1), resolution / math.sqrt(12)) * math.sqrt(1 + 1 / n)
    return float(stdtr(n - 1, (values.mean() - limit) / scatter))


def mean_of_passes(releases: Sequence[Passes], periodicity: int) -> tuple[float, float, float]:
    """Mean step of at least two passes and its 95 % interval.

    By the scatter of the passes' lengths (Student's t), and the errors of first and last start of
    each release.
    """
    rows = np.concatenate([passes.rows() for passes in releases])
    ends = sum(passes.start_errors[[0, -1]].sum() for passes in releases)
    half_width = stdtrit(len(rows) - 1, (1 + CONFIDENCE) / 2) * rows.std(ddof=1)
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
        if one.status in SETTLED and one.mode == "bump" and len(passes):
            return []
        if one.status in ("stationary", "undecided") and len(passes) > 1:
            found.append(passes)
    return found


def alike(releases: Sequence[Passes]) -> bool:
    """Whether passes of several releases may be of one motion, by the scatter of their lengths.

    One-way analysis of variance (Fisher's F).
    """
    lengths = [passes.rows() for passes in releases]
    rows = np.concatenate(lengths)
    within = sum(float(((one - one.mean()) ** 2).sum()) for one in lengths)
    if within == 0:
        return float(np.ptp(rows)) == 0
    between = sum(len(one) * float(one.mean() - rows.mean()) ** 2 for one in lengths)
    groups, rest = len(lengths) - 1, len(rows) - len(lengths)
    return float(fdtrc(groups, rest, between / groups / (within / rest))) > UNLIKE


def capture_per_row(releases: Sequence[Passes], control: RunControl) -> float:
    """Chance per row that the next pass has a peak of one row shift, which capture needs."""
    peaks = np.concatenate([passes.peaks for passes in releases])
    rows = np.concatenate([passes.rows() for passes in releases])
    return chance_beyond(peaks, 1.0, control.orbit_tolerance) / float(rows.mean())
