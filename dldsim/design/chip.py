"""What surrounds an array: channel, flow, device, and the pressure that drives it."""

from typing import NamedTuple

import numpy as np
import pandas as pd

from dldsim.config.design_sections import Device
from dldsim.config.sections import Flow
from dldsim.errors import DldsimError
from dldsim.vocabulary import GEOMETRY

SMALLEST_DIRECTION = 1e-4
"""Of the fit of the resistance, over the largest singular value."""
EDGE = 0.02
"""Part by which a quantity may lie beyond the flows that the resistance was fitted to."""


class Resistance:
    """Drag of a pillar / (μU) over geometry, from a table of `flows` of one channel height.

    Its logarithm is a quadratic of log(P_g/λ) and log(λ) and linear in ε, fitted by least squares.
    Directions of the terms in which the arrays hardly differ, such as those off the line of arrays
    whose P_r and P_g go together, take no part in it, and ``basis`` says so.
    ``error``: root mean square of the relative error where each array is left out in turn.
    Raises DldsimError for too few flows, or several heights or drives.
    """

    def __init__(self, flows: pd.DataFrame):
        table = flows.dropna(subset=["drag_over_mu_U"])
        for name in ("height_um", "drive"):
            if table[name].nunique() > 1:
                raise DldsimError(f"The table of flows mixes several values of {name}.")
        x = self._terms(*(table[name].to_numpy(float) for name in GEOMETRY))
        y = np.log(table["drag_over_mu_U"].to_numpy(float))
        if len(y) < 4:
            raise DldsimError(f"{len(y)} flows are too few to interpolate the pressure drop from.")
        self.height_um = float(table["height_um"].iloc[0])
        self.coefficients, _, rank, _ = np.linalg.lstsq(x, y, rcond=SMALLEST_DIRECTION)
        leverage = np.einsum("ij,ji->i", x, np.linalg.pinv(x, rcond=SMALLEST_DIRECTION))
        known = leverage < 1 - 1e-9  # the others decide their own value
        left_out = (y - x @ self.coefficients)[known] / (1 - leverage[known])
        self.error = float(np.sqrt(np.mean(np.expm1(left_out) ** 2))) if known.any() else np.nan
        error = "not known" if np.isnan(self.error) else f"{self.error:.1%}"
        self.basis = f"interpolated from {len(y)} flows without a cell (error {error})"
        if rank < x.shape[1]:
            self.basis += ", whose P_r, P_g and N_p do not all vary on their own: larger elsewhere"
        seen = self._ranged(*(table[name].to_numpy(float) for name in GEOMETRY))
        self.low, self.high = seen.min(axis=1), seen.max(axis=1)
        ranges = [f"{low:.3g} to {high:.3g}" for low, high in zip(self.low, self.high, strict=True)]
        self.beyond = (
            f"extrapolated from {len(y)} flows without a cell of P_g/λ {ranges[0]}, λ {ranges[1]} "
            f"µm, N_p {ranges[2]} (error not known)"
        )

    @staticmethod
    def _ranged(radius, gap, periodicity) -> np.ndarray:
        """What has to lie within the flows, P_g/λ, λ and N_p: (3, n)."""
        radius, gap, periodicity = np.broadcast_arrays(
            *(np.atleast_1d(np.asarray(v, float)) for v in (radius, gap, periodicity))
        )
        pitch = 2 * radius + gap
        return np.stack([gap / pitch, pitch, periodicity])

    def inside(self, radius, gap, periodicity) -> np.ndarray:
        """Whether arrays lie among those that it was fitted to, (n,)."""
        x = self._ranged(radius, gap, periodicity)
        low, high = (1 - EDGE) * self.low, (1 + EDGE) * self.high
        return ((x >= low[:, None]) & (x <= high[:, None])).all(axis=0)

    @staticmethod
    def _terms(radius, gap, periodicity) -> np.ndarray:
        pitch = 2 * np.asarray(radius) + gap
        a, b = np.log(gap / pitch), np.log(pitch)
        return np.column_stack([np.ones_like(a), a, b, a * a, a * b, b * b, 1 / periodicity])

    def drag_over_mu_U(self, radius, gap, periodicity) -> np.ndarray:
        """Drag per length of pillar / (μU), shape (n,)."""
        columns = np.broadcast_arrays(
            *(np.atleast_1d(np.asarray(v, float)) for v in (radius, gap, periodicity))
        )
        return np.exp(self._terms(*columns) @ self.coefficients)


class Chip(NamedTuple):
    """What surrounds an array: the channel and its flow, the device, and what limits the search."""

    flow: Flow
    device: Device = Device()
    safety_distance_um: float = 2.0
    resistance: Resistance | None = None
    no_resistance: str = "there is no table of flows"
    """Why the pressure drop is not known, where it is not."""

    def at(self, flow: Flow) -> "Chip":
        """The same chip with another flow; what the flows tell of one height holds for no other."""
        known = self.resistance
        if known is None or np.isclose(known.height_um, flow.height_um, rtol=1e-9):
            return self._replace(flow=flow)
        why = (
            f"the flows without a cell are of height {known.height_um:g} µm, this request has "
            f"{flow.height_um:g} µm"
        )
        return self._replace(flow=flow, resistance=None, no_resistance=why)

    def pressure_kPa(self, drag_over_mu_U, pitch_um, length_mm):
        """Pressure drop over a length of array at the flow's mean velocity.

        A force density f = drag_over_mu_U · μU/λ² along x drives the mean velocity U, without
        lateral flux; over a length L it is the pressure f·L.
        """
        speed = self.flow.viscosity_mPa_s * self.flow.mean_velocity_mm_s
        return np.asarray(drag_over_mu_U) * speed * length_mm / np.square(pitch_um)

    def pressure_basis(self, radius, gap, periodicity) -> list[str]:
        """Where the pressure drop of each array comes from, in words."""
        if self.resistance is None:
            count = np.broadcast(radius, gap, periodicity).size
            return [f"not known: {self.no_resistance}"] * count
        inside = self.resistance.inside(radius, gap, periodicity).tolist()
        return [self.resistance.basis if i else self.resistance.beyond for i in inside]

    @property
    def sample_uL_per_h(self) -> float:
        """Flow of the sample stream."""
        width_mm = self.device.sample_width_um / 1e3
        return 3.6 * self.flow.mean_velocity_mm_s * width_mm * self.flow.height_um

    @property
    def throughput_uL_per_h(self) -> float:
        """Flow through the whole width of the device's array."""
        velocity, width = self.flow.mean_velocity_mm_s, self.device.array_width_mm
        return 3.6 * velocity * width * self.flow.height_um
