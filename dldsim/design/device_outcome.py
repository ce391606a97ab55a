"""What comes out of a device: both populations of a request, one array, its tables.

:mod:`dldsim.design.outlets` has the Monte Carlo; here it meets the surrogate, what the outcomes say
of transients and coexisting motions, and the device.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from dldsim.config.design_sections import DesignRequest, Device
from dldsim.config.feasibility import check_tolerance
from dldsim.config.provenance import derive_seed
from dldsim.config.sections import Geometry
from dldsim.design.cell_source import CellSource
from dldsim.design.chip import Chip
from dldsim.design.draws import (
    Stream,
    draw_cells,
    draw_devices,
    entering_again,
    shuffled_devices,
    swapped,
)
from dldsim.design.motion import History, motion_of
from dldsim.design.outlets import (
    CUTS,
    NOWHERE,
    Array,
    Course,
    Devices,
    Paths,
    Split,
    amounts,
    below,
    best_split,
    course,
    make_paths,
    selected,
    some_devices,
    spread,
)
from dldsim.design.side_walls import outlet_walls, wall_range, whole_array
from dldsim.errors import DldsimError
from dldsim.experiments.migration import BUMP_FROM, ZIGZAG_TO
from dldsim.tables.registry import TABLES

SUMMED_UP = ("device_outcomes", "device_outlets")
"""Kinds of tables with the result."""
KINDS = (*SUMMED_UP, "device_positions", "device_exits")
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
PLACED_BY = 512, 32
"""Draws of an array, and of cells in each, by which the wall between two outlets is placed, at
most."""
FOLLOWED = 256
"""Draws whose cells are followed along the array for the quantiles of their places."""
EXIT_BINS = 80
"""Intervals of the histogram of exits across the array."""


Weights = tuple[np.ndarray, np.ndarray]


class Inflow(NamedTuple):
    """What an earlier device gives to a later one: weights (D, C) of the cells of both populations.

    They belong to the cells and devices of the same numbers: the later device draws the same cells.
    ``placing``: likewise of the draws by which walls are placed.
    """

    weights: Weights
    placing: Weights | None = None


class DeviceOutcome(NamedTuple):
    """Both populations on their way through one device."""

    request: DesignRequest
    name: str
    stage: int
    device: Device
    array: Array
    devices: Devices
    paths: tuple[Paths, Paths]
    placed_by: tuple[Paths, Paths] | None
    mixture: tuple[float, float]
    split: Split
    walls_um: tuple[float, ...]
    course: Course
    extrapolated: tuple[float, float]
    beyond: tuple[str, str]
    basis: tuple[str, str]
    sample_uL_per_h: float

    @property
    def edges_um(self) -> list[float]:
        """Ends of the outlets, from side wall to side wall."""
        return [0.0, *self.walls_um, self.array.width_um]

    def inflow(self, outlet: int) -> Inflow:
        """What leaves by an outlet, numbered from the lower side wall.

        Raises DldsimError for an outlet that there is not, and one that no cell leaves by.
        """
        count = len(self.walls_um) + 1
        if not 1 <= outlet <= count:
            raise DldsimError(
                f"from_outlet = {outlet}: the first device has {count} outlets.",
                key="from_outlet",
                value=outlet,
                allowed=f"1 to {count}",
                remedy="Count from the lower side wall.",
            )
        low, high = self.edges_um[outlet - 1 : outlet + 1]

        def leaving(paths: tuple[Paths, Paths]) -> Weights:
            return selected(paths[0], low, high), selected(paths[1], low, high)

        first, second = leaving(self.paths)
        if not (first.any() or second.any()):
            raise DldsimError(
                f"from_outlet = {outlet}: no cell leaves the first device there, so that nothing "
                "feeds the second.",
                key="from_outlet",
                value=outlet,
                allowed="an outlet that cells leave by",
                remedy="Name another outlet.",
            )
        return Inflow((first, second), self.placed_by and leaving(self.placed_by))


def device_outcome(
    request: DesignRequest,
    name: str,
    geometry: Geometry,
    device: Device,
    sources: Sequence[CellSource],
    model,
    history: Sequence[History],
    seed: int,
    *,
    simulated: Sequence[Mapping[str, Any] | None] = (None, None),
    inflow: Inflow | None = None,
    tolerance_um: float | None = None,
    cuts: int = CUTS,
    along: bool = True,
    quick: bool = False,
) -> DeviceOutcome:
    """Carry both populations through a device and place the wall between its outlets.

    The wall is placed by draws of their own, so that those that tell what comes out do not favour
    it, and for cells that were not learnt where they would be if they had been; ``quick``: by the
    same. Draws go with the cells, not with which type is called the first.

    ``sources``: both cell types (`CellSource`); ``history``: what outcomes of their shapes say of
    transients; ``simulated``: rows of `outcomes` of both in this very array, where there are any,
    whose motion then takes the place of the prediction's error. ``inflow``: of an earlier device,
    else the sample of the request. ``tolerance_um``: that of the request unless given. ``cuts``:
    places that are tried for a wall between two outlets; ``along``: look along the device, not only
    at its end.

    Raises DldsimError as `whole_array`, `check_tolerance`, `wall_range` and `Stream.places` do.
    """
    array, _, _ = whole_array(geometry, device)
    flow = sources[0].population.flow
    stream = Stream(1e3 * device.sample_position_mm, device.sample_width_um, flow.height_um)
    off = request.tolerance_um if tolerance_um is None else tolerance_um
    check_tolerance(off, geometry.pillar_radius_um, geometry.gap_um)
    first, second = (
        motion_of(model, source.population, geometry, history[k], simulated[k])
        for k, source in enumerate(sources)
    )
    turned = _order(sources[0]) > _order(sources[1])

    def drawn(
        count: int, each: int, seed: int, weights: Weights | None, placing: bool = False
    ) -> tuple[Devices, tuple[Paths, Paths]]:
        devices = draw_devices(count, off, seed)
        if inflow is not None:
            devices = shuffled_devices(devices, seed)
        if turned:
            devices = swapped(devices)
        paths = []
        for k, motion in enumerate((first, second)):
            number = seed + 1 + (1 - k if turned else k)
            source = sources[k]
            cells = draw_cells(each, source.draw, source.squeezed_um, stream, number)
            if inflow is not None:
                cells = entering_again(cells, number)
            weight = None if weights is None else weights[k]
            predictor = motion.predictor._replace(learnt=None) if placing else motion.predictor
            paths.append(make_paths(array, cells, devices, k, predictor, weight))
        return devices, (paths[0], paths[1])

    draws, each = request.outlet_draws, request.cells
    devices, both = drawn(draws, each, seed, inflow and inflow.weights)
    placed_by = None
    if not quick:
        fewer = min(draws, PLACED_BY[0]), min(each, PLACED_BY[1])
        walls_of = derive_seed(seed, "walls"), inflow and inflow.placing
        placed_by = drawn(*fewer, *walls_of, placing=True)[1]
    inside = [m.inside(paths.cells) for m, paths in zip((first, second), both, strict=True)]
    ratio = request.concentration_ratio
    mixture = ratio / (1 + ratio), 1 / (1 + ratio)
    given = outlet_walls(array, device)
    walls = np.array(given or np.linspace(*wall_range(array, device), cuts), float)
    split = best_split(both, mixture, walls, placed_by)
    fine = np.linspace(0, array.width_um, CUTS)
    return DeviceOutcome(
        request,
        name,
        1 if inflow is None else 2,
        device,
        array,
        devices,
        both,
        placed_by,
        mixture,
        split,
        tuple(given or (split.cut_um,)),
        course(both, mixture, fine, split.upper) if along else NOWHERE,
        (float(1 - inside[0].mean()), float(1 - inside[1].mean())),
        (first.beyond, second.beyond),
        (first.basis, second.basis),
        Chip(flow, device).sample_uL_per_h,
    )


def _order(source: CellSource) -> tuple:
    """What tells two populations apart, whatever they are called."""
    of, scatter = source.population, source.radius
    cells = () if source.measured is None else tuple(source.measured.radius_um)
    stiffness = of.stiffness.ks_uN_per_m, of.ks_low, of.ks_high, source.ks_cv or 0.0
    return of.radius_um, *stiffness, of.shape, scatter.std, cells


def warnings_of(found: Sequence[DeviceOutcome]) -> list[str]:
    """What an answer must say of outcomes: cells whose motion was not learnt, and populations that
    do not enter a device in every draw."""
    told: dict[tuple[int, str], list[DeviceOutcome]] = {}
    for one in found:
        for k in (0, 1):
            if one.extrapolated[k] > 0:
                told.setdefault((k, one.beyond[k]), []).append(one)
    notes = []
    for (k, why), devices in told.items():
        names = ", ".join(dict.fromkeys(one.name for one in devices))
        shares = [one.extrapolated[k] for one in devices]
        most = max(shares)
        part = f"up to {most:.0%}" if min(shares) < most else f"{most:.0%}"
        notes.append(
            f"extrapolated: {part} of the cells of type {k + 1} in {names}: {why}; in half of the "
            "draws they bump, in half they do not"
        )
    for one in found:
        for k, paths in enumerate(one.paths):
            enters = float((paths.weight.sum(axis=1) > 0).mean())
            if enters < 1:
                notes.append(
                    f"cells of type {k + 1} enter {one.name} at stage {one.stage} in {enters:.1%} "
                    "of the draws: its recovery there, and the smallest of purities and "
                    "recoveries, are of these alone"
                )
    return notes


# ------------------------------------------------------------------------------------------ tables


def tables_of(
    found: Sequence[DeviceOutcome], kinds: Sequence[str] = KINDS
) -> dict[str, pd.DataFrame]:
    """Tables of KINDS, or of some of them, of devices; the stages of a cascade in order."""
    makers = dict(zip(KINDS, (_outcomes, _outlets, _positions, _exits), strict=True))
    tables = {}
    for kind in kinds:
        rows = [
            {"request": one.request.name, "device": one.name, "stage": one.stage} | row
            for one in found
            for row in makers[kind](one)
        ]
        tables[kind] = pd.DataFrame(rows, columns=TABLES[kind].names)
    return tables


def interval(name: str, values: np.ndarray) -> dict[str, float]:
    """Median over the devices and both ends of the interval, as columns."""
    middle, low, high = spread(values)
    return {name: middle, f"{name}_low": low, f"{name}_high": high}


def part_of(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """The one over the other; NaN, not defined, where there is no whole."""
    return np.divide(part, whole, out=np.full(np.shape(part), np.nan), where=whole > 0)


def _outcomes(one: DeviceOutcome) -> list[dict]:
    """Rows of `device_outcomes`."""
    split, lengths = one.split, one.course.lengths_um / 1e3
    rows = []
    for k, paths in enumerate(one.paths):
        entering = paths.weight.sum(axis=1)
        lost = part_of((paths.weight * paths.lost).sum(axis=1), entering)
        weight = paths.weight / max(paths.weight.sum(), 1e-300)
        share = paths.share

        def part(mask: np.ndarray, weight=weight) -> float:
            return float((weight * mask).sum())

        cells = paths.cells
        rows.append(
            {
                "population": k + 1,
                "outlet": "upper" if k == split.upper else "lower",
                **interval("purity", split.purity[k]),
                **interval("recovery", split.recovery[k]),
                **interval("enrichment", split.purity[k] / one.mixture[k]),
                **interval("lost", lost),
                "recovery_of_sample": float(
                    np.median(np.nan_to_num(split.recovery[k]) * paths.weight.mean(axis=1))
                ),
                "share_bump": part(share >= BUMP_FROM),
                "share_mixed": part((share < BUMP_FROM) & (share > ZIGZAG_TO)),
                "share_zigzag": part(share <= ZIGZAG_TO),
                "extrapolated": one.extrapolated[k],
                "radius_mean_um": float(cells.radius_um.mean()),
                "radius_99_um": float(np.quantile(cells.radius_um, 0.99)),
                "ks_mean_uN_per_m": float(np.exp(np.log(cells.ks_uN_per_m).mean())),
                "cut_um": split.cut_um,
                "purity_recovery": split.robust,
                **interval("value", split.value),
                **interval("length_90_mm", lengths[0]),
                **interval("length_95_mm", lengths[1]),
                "array_length_mm": one.array.length_um / 1e3,
                "array_width_mm": one.array.width_um / 1e3,
                "sample_uL_per_h": one.sample_uL_per_h,
                "basis": one.basis[k],
            }
        )
    return rows


def _outlets(one: DeviceOutcome) -> list[dict]:
    """Rows of `device_outlets`."""
    edges = np.array(one.edges_um)
    cells = [_between(paths, edges) for paths in one.paths]
    entering = amounts(one.paths, one.mixture)
    rows = []
    for i in range(len(edges) - 1):
        leave = [entering[k] * np.nan_to_num(cells[k][:, i]) for k in (0, 1)]
        upper = edges[i] >= one.split.cut_um - 1e-9
        rows.append(
            {
                "outlet": i + 1,
                "low_um": edges[i],
                "high_um": edges[i + 1],
                "collects": (one.split.upper if upper else 1 - one.split.upper) + 1,
                **interval("cells_1", cells[0][:, i]),
                **interval("cells_2", cells[1][:, i]),
                **interval("purity_1", part_of(leave[0], leave[0] + leave[1])),
            }
        )
    return rows


def _between(paths: Paths, edges: np.ndarray) -> np.ndarray:
    """Shares (D, E − 1) of the entering cells between edges (E,) at the end of the array; NaN in
    devices that none enters."""
    under, kept = below(paths, edges[1:-1], paths.array.length_um)
    shares = np.diff(under, axis=1, prepend=0.0, append=kept[:, None])
    return np.where(paths.weight.sum(axis=1)[:, None] > 0, shares, np.nan)


def _positions(one: DeviceOutcome) -> list[dict]:
    """Rows of `device_positions`, without the cells that are lost."""
    rows = []
    for k, paths in enumerate(one.paths):
        if not np.where(paths.lost, 0.0, paths.weight).any():
            continue
        some = some_devices(paths, FOLLOWED)
        paths = some if np.where(some.lost, 0.0, some.weight).any() else paths
        weight = np.where(paths.lost, 0.0, paths.weight).ravel()
        for x, value in zip(one.course.x_um, one.course.value, strict=True):
            lateral = paths.lateral_um(x).ravel()
            order = np.argsort(lateral, kind="stable")
            cumulated = np.cumsum(weight[order])
            at = np.searchsorted(cumulated, np.array(QUANTILES) * cumulated[-1])
            places = lateral[order][np.minimum(at, len(order) - 1)]
            rows.append(
                {
                    "population": k + 1,
                    "x_mm": x / 1e3,
                    **{f"y_{100 * q:02.0f}_um": y for q, y in zip(QUANTILES, places, strict=True)},
                    **interval("value", value),
                }
            )
    return rows


def _exits(one: DeviceOutcome) -> list[dict]:
    """Rows of `device_exits`."""
    edges = np.linspace(0, one.array.width_um, EXIT_BINS + 1)
    rows = []
    for k, paths in enumerate(one.paths):
        if not paths.weight.any():
            continue
        shares = _between(paths, edges)
        rows += [
            {
                "population": k + 1,
                "low_um": edges[i],
                "high_um": edges[i + 1],
                **interval("cells", shares[:, i]) | {"cells": float(np.nanmean(shares[:, i]))},
            }
            for i in range(EXIT_BINS)
        ]
    return rows
