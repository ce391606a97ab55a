"""Outlets as an aim: how long an array may be, and what it parts, over many arrays."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from dldsim.analysis.surrogate import Surrogate
from dldsim.config.design_sections import DesignRequest, Device
from dldsim.config.provenance import derive_seed
from dldsim.config.sections import Geometry
from dldsim.design.cell_source import CellSource
from dldsim.design.chip import Chip
from dldsim.design.device_outcome import DeviceOutcome, device_outcome
from dldsim.design.motion import History
from dldsim.design.side_walls import FEWEST_LANES
from dldsim.errors import DldsimError

OBJECTIVE = "purity-recovery"
SHORT = "array must hold a period"
NARROW = "array must hold three pillars side by side"
"""Constraints on the device."""
SEARCH_DRAWS, SEARCH_CELLS, SEARCH_CUTS = 64, 40, 61
"""Draws of the array, cells of each type in each, and places of the wall, while many arrays are
compared; a candidate then has those of its request."""


def outlet_seed(seed: int) -> int:
    """Seed of the draws at the outlets, the same whoever asks and whatever a request is called."""
    return derive_seed(seed, "outlets")


class OutletTask:
    """Both populations of a request in arrays of a chip.

    ``history``: what outcomes of their shapes say of transients.
    """

    def __init__(
        self,
        surrogate: Surrogate,
        request: DesignRequest,
        sources: Sequence[CellSource],
        history: Sequence[History],
        chip: Chip,
        seed: int,
    ):
        self.surrogate, self.request, self.chip, self.seed = surrogate, request, chip, seed
        self.sources, self.history = sources, history
        self._known: dict[tuple, DeviceOutcome] = {}

    @cached_property
    def _quick(self) -> DesignRequest:
        """The request with the draws of a search."""
        fewer = {
            "draws": min(self.request.outlet_draws, SEARCH_DRAWS),
            "cells": min(self.request.cells, SEARCH_CELLS),
        }
        return self.request.model_copy(update=fewer)

    def length_mm(self, radius, gap, periodicity) -> np.ndarray:
        """Length of array (n,): the device's, or what footprint and pressure leave of it."""
        request, device = self.request, self.chip.device
        length = np.full(np.shape(radius), device.array_length_mm)
        if request.footprint_max_mm2 is not None:
            length = np.minimum(length, request.footprint_max_mm2 / device.array_width_mm)
        known = self.chip.resistance  # without it `check` of a task refuses a limit
        if request.pressure_max_kPa is not None and known is not None:
            drag = known.drag_over_mu_U(radius, gap, periodicity)
            each = self.chip.pressure_kPa(drag, 2 * np.asarray(radius) + gap, 1.0)
            length = np.minimum(length, request.pressure_max_kPa / each)
        return length

    def limits(self, radius, gap, periodicity) -> dict[str, np.ndarray]:
        """Constraints, (n,) each; above zero is violated, by so many µm."""
        pitch = 2 * np.asarray(radius) + gap
        needed = FEWEST_LANES * pitch + gap
        return {
            SHORT: periodicity * pitch - 1e3 * self.length_mm(radius, gap, periodicity),
            NARROW: needed - 1e3 * self.chip.device.array_width_mm,
        }

    def device(self, geometry: Geometry) -> Device:
        """The device with the array as long as it may be."""
        place = (np.array([value]) for value in geometry.model_dump().values())
        length = float(self.length_mm(*place)[0])
        return self.chip.device.model_copy(update={"array_length_mm": length})

    def score(self, radius, gap, periodicity) -> np.ndarray:
        """Score (n,) of the outlets, with the draws of a search: the smallest purity or recovery
        that nine of ten draws exceed, and a little of its mean."""
        return np.array(
            [
                self._outcome(
                    self._quick,
                    "",
                    Geometry(pillar_radius_um=r, gap_um=g, periodicity=int(n)),
                    cuts=SEARCH_CUTS,
                    along=False,
                    quick=True,
                ).split.score
                for r, g, n in zip(radius, gap, periodicity, strict=True)
            ]
        )

    def outcome(
        self,
        name: str,
        geometry: Geometry,
        simulated: Sequence[Mapping[str, Any] | None] = (None, None),
    ) -> DeviceOutcome:
        """What comes out of a design, with the draws of the request."""
        if any(simulated):
            return self._outcome(self.request, name, geometry, simulated=simulated)
        place = tuple(geometry.model_dump().values())
        if place not in self._known:
            self._known[place] = self._outcome(self.request, name, geometry)
        return self._known[place]._replace(name=name)

    def _outcome(self, request: DesignRequest, name: str, geometry: Geometry, **options):
        return device_outcome(
            request,
            name,
            geometry,
            self.device(geometry) if request.objective == OBJECTIVE else self.chip.device,
            self.sources,
            self.surrogate,
            self.history,
            self.seed,
            **options,
        )

    def check(self) -> None:
        """Refuse limits that no array can meet. Raises DldsimError that names the key."""
        request, chip = self.request, self.chip
        least = request.sample_min_uL_per_h
        if least is not None and chip.sample_uL_per_h < least:
            raise DldsimError(
                f"design request {request.name}: sample_min_uL_per_h = {least:g}, but a sample "
                f"stream {chip.device.sample_width_um:g} µm wide and {chip.flow.height_um:g} µm "
                f"high carries {chip.sample_uL_per_h:.3g} µL/h at "
                f"{chip.flow.mean_velocity_mm_s:g} mm/s.",
                key="sample_min_uL_per_h",
                value=least,
                allowed=f"up to {chip.sample_uL_per_h:.3g} µL/h",
                remedy="Widen device.sample_width_um, or raise velocity_mm_s or height_um.",
            )
        if request.objective != OBJECTIVE:
            return
        smallest = 2 * request.pillar_radius_um[0] + request.gap_um[0]
        needed = request.periodicity[0] * smallest / 1e3
        footprint, width = request.footprint_max_mm2, chip.device.array_width_mm
        if footprint is not None and footprint / width < needed <= chip.device.array_length_mm:
            raise DldsimError(
                f"design request {request.name}: footprint_max_mm2 = {footprint:g} leaves an array "
                f"{width:g} mm wide {footprint / width:.3g} mm of length, less than a period of "
                f"the smallest pitch within the bounds, {needed:.3g} mm.",
                key="footprint_max_mm2",
                value=footprint,
                allowed=f"{needed * width:.3g} mm² or more",
                remedy="Raise footprint_max_mm2, or lower device.array_width_mm.",
            )
