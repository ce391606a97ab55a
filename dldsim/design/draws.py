"""Quasi-random draws of cells and devices: sizes, stiffnesses, places of entry, what is off."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dldsim.design.outlets import Cells, Devices
from dldsim.errors import DldsimError

NEGATIVE_SHARE = 1e-3
"""Share of a normal distribution below zero that is cut off; more is refused."""
CELL_DIMENSIONS, DEVICE_DIMENSIONS = 5, 8
TERMS = 40
"""Of the series for the flow through a duct."""


class Scatter(NamedTuple):
    """A positive quantity among the cells of a population: normal cut off at zero, or lognormal.

    ``std``: standard deviation, before the cut.
    """

    mean: float
    std: float = 0.0
    distribution: str = "normal"

    def quantile(self, level: np.ndarray) -> np.ndarray:
        """Values at levels 0 to 1."""
        from scipy.stats import norm

        level = np.clip(level, 1e-9, 1 - 1e-9)
        if self.std == 0:
            return np.full(np.shape(level), self.mean)
        if self.distribution == "lognormal":
            width = np.sqrt(np.log1p((self.std / self.mean) ** 2))
            return self.mean * np.exp(width * norm.ppf(level) - width**2 / 2)
        below = norm.cdf(-self.mean / self.std)
        return self.mean + self.std * norm.ppf(below + level * (1 - below))


def check_scatter(scatter: Scatter, key: str, unit: str) -> None:
    """Refuse a normal distribution of which a part that counts is negative. Raises DldsimError."""
    from scipy.stats import norm

    if scatter.distribution != "normal" or scatter.std == 0:
        return
    below = norm.cdf(-scatter.mean / scatter.std)
    if below > NEGATIVE_SHARE:
        most = scatter.mean / -norm.ppf(NEGATIVE_SHARE)
        raise DldsimError(
            f"{key}: {scatter.std:.4g} {unit} about a mean of {scatter.mean:.4g} {unit}: "
            f"{below:.1%} of a normal distribution would be negative; allowed 0 to {most:.3g} "
            f"{unit} (a coefficient of variation of {most / scatter.mean:.2f}).",
            key=key,
            value=scatter.std,
            allowed=f"0 to {most:.3g} {unit}",
            remedy="Give a smaller one, or take a lognormal distribution.",
        )


def sobol(count: int, dimensions: int, seed: int) -> np.ndarray:
    """Scrambled Sobol points (dimensions, count) in 0 to 1."""
    from scipy.stats import qmc

    sequence = qmc.Sobol(dimensions, rng=np.random.default_rng(seed))
    return sequence.random_base2(max(count - 1, 1).bit_length())[:count].T


def draw_devices(count: int, tolerance_um: float, seed: int) -> Devices:
    """Devices with P_r and P_g evenly within ± tolerance."""
    from scipy.stats import norm

    points = sobol(count, DEVICE_DIMENSIONS, seed)
    centred = 2 * points - 1
    # the first dimensions of the sequence are the most even: they go to what moves outlets most
    return Devices(
        tolerance_um * centred[6],
        tolerance_um * centred[7],
        centred[:2],
        norm.ppf(np.clip(points[2:4], 1e-6, 1 - 1e-6)),
        points[4:6],
    )


class Stream(NamedTuple):
    """The sample stream where it enters the array, between its two walls; lengths in µm."""

    middle_um: float
    width_um: float
    height_um: float

    def places(self, radius_um: np.ndarray, level: np.ndarray) -> np.ndarray:
        """Places of entry (n,) of cells of these radii at levels 0 to 1 of their flux.

        Cells are carried in proportion to the flow of the sample's own inlet, where none comes
        nearer to a wall than its radius; in the array the stream is as wide and flows evenly, so
        that a part of the flux takes the same part of the width.

        Raises DldsimError if cells do not fit into the inlet.
        """
        if 2 * radius_um.max() >= self.width_um:
            raise DldsimError(
                f"device.sample_width_um = {self.width_um:g} µm: cells of up to "
                f"{2 * radius_um.max():.3g} µm do not fit into the inlet.",
                key="device.sample_width_um",
                value=self.width_um,
                allowed=f"more than {2 * radius_um.max():.3g} µm",
                remedy="Widen the sample stream, or leave out larger cells.",
            )
        nearest = flux_beside(radius_um, self.width_um, self.height_um)
        flux = nearest + level * (1 - 2 * nearest)
        return self.middle_um + self.width_um * (flux - 0.5)


def flux_beside(distance_um: np.ndarray, width_um: float, height_um: float) -> np.ndarray:
    """Share of the flow through a rectangular duct within a distance from one of its side walls.

    Series of the duct's velocity, averaged over its height (White, Viscous Fluid Flow, sec. 3-3):
    u ∝ 1 − 96/π⁴ Σ cosh(nπy/H) / (n⁴ cosh(nπW/2H)), n odd, y from the middle.
    """
    half = width_um / 2
    y = half - np.minimum(np.asarray(distance_um, float), half)
    n = np.arange(1, 2 * TERMS, 2).reshape(-1, *[1] * y.ndim)
    a = n * np.pi / height_um

    def until(y: np.ndarray) -> np.ndarray:
        # sinh(ay)/cosh(a half) without overflow
        ratio = (np.exp(a * (y - half)) - np.exp(-a * (y + half))) / (1 + np.exp(-2 * a * half))
        return y - 96 / np.pi**4 * np.sum(ratio / (n**4 * a), axis=0)

    return (1 - until(y) / until(np.full_like(y, half))) / 2


def draw_cells(
    count: int,
    population: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]],
    squeezed: Callable[[np.ndarray, np.ndarray], np.ndarray],
    stream: Stream,
    seed: int,
) -> Cells:
    """Cells of one population.

    ``population`` turns two levels, 0 to 1, into radii [µm] and spring constants [µN/m];
    ``squeezed`` turns these into the widths [µm] that cells need.
    """
    points = sobol(count, CELL_DIMENSIONS, seed)
    radius, stiffness = population(points[0], points[1])
    return Cells(
        radius,
        stiffness,
        squeezed(radius, stiffness),
        stream.places(radius, points[2]),
        points[3],
        points[4],
    )


def entering_again(cells: Cells, seed: int) -> Cells:
    """The same cells entering another device: size and stiffness stay, all else is drawn anew.

    Cells that enter in proportion to the flow do so again, whatever their size: what they keep off
    the walls of the inlet differs by less than the sample stream's own scatter.
    """
    order = np.random.default_rng(seed).permutation(len(cells.start_um))
    return cells._replace(
        start_um=cells.start_um[order], luck=cells.luck[order], lag=cells.lag[order]
    )


def shuffled_devices(devices: Devices, seed: int) -> Devices:
    """The same draws in another order, independent of those of an earlier device."""
    order = np.random.default_rng(seed).permutation(len(devices.off_gap_um))
    return Devices(*(values[..., order] for values in devices))


def swapped(devices: Devices) -> Devices:
    """The same draws with those of both populations exchanged."""
    return devices._replace(
        **{name: getattr(devices, name)[::-1] for name in ("deviate", "numerical", "coexist")}
    )
