"""From cells that enter a device to the outlets where they leave it, by Monte Carlo.

Two levels of draws. A *device* is one array as fabricated and one truth about it: what is drawn
once for it holds for all of its cells. A *cell* is one of a population. Purity and recovery are
taken over the cells of a device, and their intervals over the devices.

| drawn once for each device | drawn for each cell |
|---|---|
| P_r and P_g within the fabrication tolerance | radius and stiffness |
| error of the prediction, for each population | place of entry across the sample stream |
| numerical error: at which gap a mode changes | how far it falls behind in the first period |
| whether motions coexist, for each population | which of the coexisting motions it takes |

A cell that has settled moves by s · λ/N_p a row, s its share of the bump displacement. In the first
array period (N_p rows) it moves less, by a lag of so many pitches that is drawn from measured ones
(`Predictor.lags`); later it keeps the distance. At a side wall it stays. A cell that needs more
width than the gap clogs, and is lost. Interaction of cells, diffusion, and the flow near the side
walls are not in this.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from dldsim.experiments.migration import BUMP_FROM, ZIGZAG_TO

EXCEEDED_BY = 0.9
"""Share of the devices whose smallest purity or recovery exceeds the robust one."""
INTERVAL = (0.05, 0.95)
"""Quantiles over the devices between which a result is reported."""
EQUALS = 1e-3
"""Weight of the mean value, beside the robust one, in the choice of a cut."""
CUTS = 121
"""Places across the device that are tried for the wall between two outlets."""
ALONG = 64
"""Devices in which the cells are followed along the array; its end is that of all."""
STATIONS = 31
"""Places along the device, both ends included."""
REACHED = (0.9, 0.95)
"""Parts of the final value whose length is reported."""
GAIN = 0.01
"""By which a device must better the value at its inlet for a length to mean anything."""
MODES = ("zigzag", "mixed", "bump")


class Cells(NamedTuple):
    """Cells of one population, (C,) each.

    ``squeezed_um``: width of the narrowest gap that they pass; ``start_um``: place of entry above
    the lower side wall; ``luck`` and ``lag``: quantiles, 0 to 1, of the motion that a cell takes
    where several coexist, and of its lag.
    """

    radius_um: np.ndarray
    ks_uN_per_m: np.ndarray
    squeezed_um: np.ndarray
    start_um: np.ndarray
    luck: np.ndarray
    lag: np.ndarray


class Devices(NamedTuple):
    """What is drawn once for each device: (D,), and (2, D) where it is for each population.

    ``off_radius_um``, ``off_gap_um``: fabrication; ``deviate``: place within the prediction's
    error, −1 to 1 (`Predictor.off`); ``numerical``: standard normal, in units of
    `Predictor.gap_error`; ``coexist``: 0 to 1.
    """

    off_radius_um: np.ndarray
    off_gap_um: np.ndarray
    deviate: np.ndarray
    numerical: np.ndarray
    coexist: np.ndarray


class Predictor(NamedTuple):
    """What is known of the motion of one population.

    ``share(pillar_radius_um, gap_um, radius_um, ks_uN_per_m)``: share of the bump displacement,
    (n,) for arguments (n,), at the periodicity of the array. ``off(share, deviate)``: the same with
    the error at that signed level of its two-sided interval, −1 to 1. ``gap_error``: standard
    deviation, relative, of the gap at which a mode changes, as the numerics move it; a share is
    that predicted at a gap so much wider or narrower. ``range``: least and largest share there is.
    ``lags``: by mode, measured lags in pitches, (n,). ``coexisting``: chance that a share between
    the modes is a mixture of cells that bump and cells that do not, and not one motion of all.
    ``learnt(cells)``: whether their motion can be predicted, (C,), without it that of all;
    the error of others is as large as the range.
    """

    share: Callable[..., np.ndarray]
    off: Callable[[np.ndarray, np.ndarray], np.ndarray]
    gap_error: float
    range: tuple[float, float]
    lags: Mapping[str, np.ndarray]
    coexisting: float
    learnt: Callable[[Cells], np.ndarray] | None = None


class Array(NamedTuple):
    """The array of a device, lengths in µm."""

    pillar_radius_um: float
    gap_um: float
    periodicity: int
    length_um: float
    width_um: float

    @property
    def pitch_um(self) -> float:
        """Centre-to-centre distance of the mask, which fabrication keeps."""
        return 2 * self.pillar_radius_um + self.gap_um


class Paths(NamedTuple):
    """Ways of a population through the device: (D, C), and (C,) what is the same in all devices.

    ``share``: of the bump displacement once settled; ``lag``: in pitches; ``lost``: clogs.
    ``weight``: cells that each stands for, 1 unless an earlier device has sorted them.
    """

    array: Array
    cells: Cells
    share: np.ndarray
    lag: np.ndarray
    lost: np.ndarray
    weight: np.ndarray

    def lateral_um(self, x_um: float) -> np.ndarray:
        """Positions (D, C) above the lower side wall after a length of array."""
        pitch, period = self.array.pitch_um, self.array.periodicity * self.array.pitch_um
        behind = self.lag * pitch * min(x_um / period, 1)
        radius = self.cells.radius_um
        free = self.cells.start_um + self.share * x_um / self.array.periodicity - behind
        return np.clip(free, radius, np.maximum(self.array.width_um - radius, radius))


def make_paths(
    array: Array,
    cells: Cells,
    devices: Devices,
    population: int,
    predictor: Predictor,
    weight: np.ndarray | None = None,
) -> Paths:
    """Ways of one population, the first or second (0 or 1) of ``devices``; ``weight``: (D, C)."""
    radius, gap, size, stiffness = (
        np.broadcast_to(v, (len(devices.off_gap_um), len(cells.radius_um)))
        for v in (
            (array.pillar_radius_um + devices.off_radius_um)[:, None],
            (array.gap_um + devices.off_gap_um)[:, None],
            cells.radius_um,
            cells.ks_uN_per_m,
        )
    )
    moved = gap * np.exp(predictor.gap_error * devices.numerical[population])[:, None]
    deviate = devices.deviate[population][:, None]
    share = predictor.off(_shares(predictor, radius, moved, size, stiffness), deviate)
    if predictor.learnt is not None:
        least, largest = predictor.range
        end = np.where(deviate < 0, least, largest)
        share = np.where(predictor.learnt(cells), share, end)
    share = np.clip(share, *predictor.range)
    between = (share > ZIGZAG_TO) & (share < BUMP_FROM)
    mixture = between & (devices.coexist[population] < predictor.coexisting)[:, None]
    share = np.where(mixture, np.where(cells.luck < share, 1.0, 0.0), share)
    lags = np.stack([np.quantile(predictor.lags[mode], cells.lag) for mode in MODES])
    mode = np.where(share >= BUMP_FROM, 2, np.where(share > ZIGZAG_TO, 1, 0))
    lag = np.take_along_axis(lags, mode, axis=0)
    return Paths(
        array,
        cells,
        share,
        lag,
        cells.squeezed_um > gap,
        np.ones_like(share) if weight is None else weight,
    )


def _shares(predictor: Predictor, *at: np.ndarray) -> np.ndarray:
    """`Predictor.share` of arguments (D, C); where all cells are alike, of one of them."""
    alike = all(np.ptp(v, axis=1).max() == 0 for v in at[2:])
    asked = [v[:, :1] if alike else v for v in at]
    share = np.asarray(predictor.share(*(v.ravel() for v in asked)), float)
    return np.broadcast_to(share.reshape(asked[0].shape), at[0].shape)


class Split(NamedTuple):
    """What both populations give at a wall between a lower and an upper outlet.

    (2, D) for each population and device, but ``value`` (D,), the smallest of both purities and
    both recoveries, and ``robust``, which EXCEEDED_BY of the devices exceed. NaN is what is not
    defined: see `qualities` and `value_of`. ``upper``: the
    population, 0 or 1, that the upper outlet collects; the lower one collects the other.
    ``score``: by which splits are compared, robust and, to order those of which nothing is sure, a
    little of the mean value.
    """

    cut_um: float
    upper: int
    purity: np.ndarray
    recovery: np.ndarray
    value: np.ndarray
    robust: float
    score: float


def below(paths: Paths, cuts_um: np.ndarray, x_um: float) -> tuple[np.ndarray, np.ndarray]:
    """Shares of the entering cells of a population that are below each cut, (D, K), and that are
    not lost, (D,), after a length of array; cuts rising."""
    weight = np.where(paths.lost, 0.0, paths.weight)
    lateral = paths.lateral_um(x_um)
    draws, places = len(lateral), len(cuts_um) + 1
    place = np.searchsorted(cuts_um, lateral.ravel(), side="right")
    place += np.repeat(np.arange(draws) * places, lateral.shape[1])
    counts = np.bincount(place, weight.ravel(), minlength=draws * places).reshape(draws, places)
    entering = np.maximum(paths.weight.sum(axis=1), 1e-300)
    return np.cumsum(counts, axis=1)[:, :-1] / entering[:, None], weight.sum(axis=1) / entering


def amounts(paths: tuple[Paths, Paths], mixture: tuple[float, float]) -> np.ndarray:
    """Cells of both populations that enter, (2, D), in the proportion ``mixture`` before any
    sorting."""
    return np.stack([m * p.weight.mean(axis=1) for p, m in zip(paths, mixture, strict=True)])


def qualities(
    paths: tuple[Paths, Paths], mixture: tuple[float, float], cuts_um: np.ndarray, x_um: float
) -> tuple[np.ndarray, np.ndarray]:
    """Purities and recoveries (2, 2, D, K): of each population, by the population, 0 or 1, that the
    upper outlet collects, for each device and cut.

    An outlet without cells has no purity, a population of which no cell enters no recovery (NaN).
    """
    found = [below(p, cuts_um, x_um) for p in paths]
    entering = amounts(paths, mixture)[:, :, None]
    lower = np.stack([part for part, _ in found])
    sides = np.stack([lower, np.stack([kept[:, None] - part for part, kept in found])])
    sides = np.maximum(sides, 0.0)  # lower and upper × population × D × K
    cells = sides * entering
    total = cells.sum(axis=1, keepdims=True)
    part = np.divide(cells, total, out=np.full_like(cells, np.nan), where=total > 0)
    recovery = np.empty((2, 2, *lower.shape[1:]))
    purity = np.empty_like(recovery)
    for upper in (0, 1):
        for population in (0, 1):
            side = int(population == upper)
            recovery[population, upper] = sides[side, population]
            purity[population, upper] = part[side, population]
        recovery[:, upper][entering[:, :, 0] == 0] = np.nan
    return purity, recovery


def value_of(purity: np.ndarray, recovery: np.ndarray) -> np.ndarray:
    """The smallest of both purities and both recoveries; populations along the first axis.

    Where no cell of a population enters there is none (NaN). An outlet without cells recovers
    nothing: that is 0, whatever its purity would be.
    """
    smallest = np.where(np.isnan(recovery), np.nan, np.fmin(purity, recovery))
    return np.minimum.reduce(smallest)


def best_split(
    paths: tuple[Paths, Paths],
    mixture: tuple[float, float],
    cuts_um: np.ndarray,
    placed_by: tuple[Paths, Paths] | None = None,
) -> Split:
    """The cut, of those given and rising, with the largest robust value at the end of the device.

    Of equals the one with the largest mean value, and the middle one of the widest run of these.
    ``placed_by``: draws of their own by which it is chosen. The best for some draws looks better in
    these than it is: what a split gives is told by others.
    """
    if placed_by is None:
        upper, k = _chosen(paths, mixture, cuts_um)
    else:
        upper, k = _chosen(placed_by, mixture, cuts_um)
    cut = cuts_um[k : k + 1]
    purity, recovery = qualities(paths, mixture, cut, paths[0].array.length_um)
    value = value_of(purity, recovery)[upper, :, 0]
    robust, score = _judged(value) if fed(value).any() else NOTHING
    return Split(
        float(cut[0]),
        upper,
        purity[:, upper, :, 0],
        recovery[:, upper, :, 0],
        value,
        float(robust),
        float(score),
    )


NOTHING = (np.nan, 0.0)
"""Robust value and score where no device is fed with both populations."""


def fed(value: np.ndarray) -> np.ndarray:
    """Which devices, along the first axis, both populations enter: all others have no value."""
    return ~np.isnan(value)


def _judged(value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Robust value and score of the values of devices, along the first axis, that are fed."""
    known = value[fed(value if value.ndim == 1 else value[:, 0])]
    robust = np.quantile(known, 1 - EXCEEDED_BY, axis=0)
    return robust, (robust + EQUALS * known.mean(axis=0)) / (1 + EQUALS)


def _chosen(
    paths: tuple[Paths, Paths], mixture: tuple[float, float], cuts_um: np.ndarray
) -> tuple[int, int]:
    """The population that the upper outlet collects, and the index of the best cut.

    Where no device is fed with both populations, by the one that there is.
    """
    found = qualities(paths, mixture, cuts_um, paths[0].array.length_um)
    values = value_of(*found)
    if not fed(values).any():
        values = np.fmin.reduce(np.fmin(*found))
    if not fed(values).any():
        return 1, len(cuts_um) // 2
    score = np.stack([_judged(value)[1] for value in values])
    upper = int(score[1].max() >= score[0].max())
    return upper, middle_of_best(score[upper])


def middle_of_best(values: np.ndarray) -> int:
    """Index in the middle of the longest run of the largest values."""
    best = np.flatnonzero(values >= values.max() - 1e-9)
    runs = np.split(best, np.flatnonzero(np.diff(best) > 1) + 1)
    longest = max(runs, key=len)
    return int(longest[len(longest) // 2])


class Course(NamedTuple):
    """How the populations part along the device.

    ``x_um`` (X,); ``value`` (X, D): with the best cut at each place; ``lengths_um`` (2, D): where
    it first is REACHED of the final one, interpolated, NaN where that is no more than at the inlet.
    D: the first ALONG devices.
    """

    x_um: np.ndarray
    value: np.ndarray
    lengths_um: np.ndarray


def course(
    paths: tuple[Paths, Paths], mixture: tuple[float, float], cuts_um: np.ndarray, upper: int
) -> Course:
    """Value along the device where the upper outlet collects population ``upper``."""
    paths = (some_devices(paths[0], ALONG), some_devices(paths[1], ALONG))
    x = np.linspace(0, paths[0].array.length_um, STATIONS)
    value = np.stack(
        [
            value_of(*(q[:, upper] for q in qualities(paths, mixture, cuts_um, at))).max(axis=1)
            for at in x
        ]
    )
    parted = value[-1] > value[0] + GAIN
    known = np.nan_to_num(value)
    lengths = [np.where(parted, first_reached(x, known, part), np.nan) for part in REACHED]
    return Course(x, value, np.stack(lengths))


NOWHERE = Course(np.empty(0), np.empty((0, 0)), np.empty((len(REACHED), 0)))
"""The course of a device that was looked at only at its end."""


def some_devices(paths: Paths, count: int) -> Paths:
    """The first of the devices."""
    names = ("share", "lag", "lost", "weight")
    return paths._replace(**{name: getattr(paths, name)[:count] for name in names})


def first_reached(x: np.ndarray, value: np.ndarray, part: float) -> np.ndarray:
    """Where each column of ``value`` (X, D) first is ``part`` of its last, (D,); linear between."""
    wanted = part * value[-1]
    after = np.argmax(value >= wanted - 1e-12, axis=0)
    before = np.maximum(after - 1, 0)
    low, high = (np.take_along_axis(value, i[None], 0)[0] for i in (before, after))
    rise = high - low
    step = np.where(rise > 0, (wanted - low) / np.where(rise > 0, rise, 1), 1.0)
    return x[before] + np.clip(step, 0, 1) * (x[after] - x[before])


def selected(paths: Paths, low_um: float, high_um: float) -> np.ndarray:
    """Weights (D, C) of the cells that leave between two places, for a device that they enter."""
    lateral = paths.lateral_um(paths.array.length_um)
    inside = (lateral >= low_um) & (lateral < high_um) & ~paths.lost
    return np.where(inside, paths.weight, 0.0)


def spread(values: np.ndarray) -> tuple[float, float, float]:
    """Median and both ends of INTERVAL over the devices that have a value; NaN where none has."""
    values = values[~np.isnan(values)]
    if not len(values):
        return np.nan, np.nan, np.nan
    low, middle, high = np.quantile(values, [INTERVAL[0], 0.5, INTERVAL[1]])
    return float(middle), float(low), float(high)
