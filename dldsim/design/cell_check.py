"""Simulated check of what leaves a device: cells drawn from both populations, each carried through
its array from a drawn place until its motion has settled.

A cell is released at a place in the gap that is drawn in proportion to the flow there, as a
parabola 6 f (1 − f) over the gap, where it fits. Its way through the whole device is that of its
simulated rows, and from then on that of its settled motion. Every cell has a file of its own, so
that an interrupted check goes on where it stopped.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dldsim.config.identifiers import Pair, outcome_id
from dldsim.config.provenance import provenance, settings_hash
from dldsim.config.sections import Cell, CellShape, Flow, Geometry, Numerics, RunControl, Stiffness
from dldsim.design.outlets import Paths, Split
from dldsim.errors import DldsimError, NoRoom
from dldsim.experiments.outcome_files import Progress, made_with
from dldsim.laws import rest_thickness
from dldsim.tables.parquet import read_rows, write_table
from dldsim.vocabulary import SETTLED

PROCESSES = 2
LEAST_CHANCE = 0.05
"""A simulated result that the prediction gives a smaller chance, together with all that it finds
less likely, does not agree with it."""
REPLICATES = 1000
CONFIDENCE = 0.9
"""Of the intervals of simulated shares."""
LOST = ("stuck", "does not fit")
"""Statuses of cells that leave by no outlet."""


class Drawn(NamedTuple):
    """A cell to be simulated: which population (1 or 2) it is of, where it enters the device above
    the lower side wall, and where in its gap it is released."""

    number: int
    population: int
    cell: CellShape
    stiffness: Stiffness
    start_um: float
    release_gap_fraction: float


def release_places(level: np.ndarray, nearest: np.ndarray) -> np.ndarray:
    """Places in the gap (n,), 0 to 1, at levels 0 to 1 of the flux of cells that come no nearer to
    a pillar than ``nearest`` (n,); the middle for cells that fill the gap.

    The flux below f is f² (3 − 2f), whose inverse is 1/2 − sin(asin(1 − 2u)/3).
    """
    nearest = np.minimum(nearest, 0.5)
    beside = nearest**2 * (3 - 2 * nearest)
    flux = beside + level * (1 - 2 * beside)
    return 0.5 - np.sin(np.arcsin(1 - 2 * flux) / 3)


def half_extent_um(cell: CellShape) -> float:
    """Half of a cell's size across the gap as it is released."""
    thickness = rest_thickness(cell.shape, cell.aspect_ratio) if cell.axis == "y" else 2.0
    return thickness / 2 * cell.radius_um


class Setting(NamedTuple):
    """What all cells of a check are simulated with."""

    geometry: Geometry
    flow: Flow
    numerics: Numerics
    control: RunControl

    def of(self, drawn: Drawn) -> dict[str, Any]:
        """Everything that the run of one cell depends on."""
        return {
            **{name: value.model_dump(mode="json") for name, value in self._asdict().items()},
            "cell": drawn.cell.model_dump(mode="json"),
            "stiffness": drawn.stiffness.model_dump(mode="json"),
            "release_gap_fraction": drawn.release_gap_fraction,
        }


def simulate_cells(
    drawn: Sequence[Drawn],
    setting: Setting,
    directory: Path,
    progress: Progress,
    processes: int = PROCESSES,
) -> list[dict]:
    """Rows of `runs` of all cells, in order; those that are there are used again.

    A cell that fits nowhere in its gap, or whose run fails, has only `status` and `stop_reason`.
    """
    directory = Path(directory)
    paths = [directory / f"cell-{d.number:04d}.parquet" for d in drawn]
    left = [
        (d, path)
        for d, path in zip(drawn, paths, strict=True)
        if not made_with(path, settings_hash(setting.of(d)))
    ]
    found: dict[int, dict] = {}
    if left:
        flow = _empty_flow(setting, directory, progress)
        start = time.perf_counter()
        for count, (one, row) in enumerate(_runs(left, setting, flow, processes), start=1):
            found[one.number] = row
            minutes = (time.perf_counter() - start) / count * (len(left) - count) / 60
            motion = row.get("mode", row["status"])
            progress(
                f"cell {len(drawn) - len(left) + count} of {len(drawn)} (type {one.population}, "
                f"radius {one.cell.radius_um:.3g} µm, k_s {one.stiffness.ks_uN_per_m:.3g} µN/m): "
                f"{motion}, {row.get('rows_completed', 0)} rows; about {minutes:.0f} min left"
            )
    return [
        found[d.number] if d.number in found else read_rows("runs", path)[0]
        for d, path in zip(drawn, paths, strict=True)
    ]


def _empty_flow(setting: Setting, directory: Path, progress: Progress) -> Path:
    """File of the flow without a cell, which all cells share."""
    from dldsim.solver.flow import solve_empty_array

    parts = setting.geometry, setting.flow, setting.numerics
    digest = settings_hash({"parts": [part.model_dump(mode="json") for part in parts]})
    path = directory / f"flow-{digest}.npz"
    if not path.exists():
        solve_empty_array(*parts, progress).save(path)
    return path


def _runs(
    left: Sequence[tuple[Drawn, Path]], setting: Setting, flow: Path, processes: int
) -> Iterator[tuple[Drawn, dict]]:
    """Cells with their rows as they are done."""
    if processes == 1:
        for one, path in left:
            yield one, _run(one, setting, flow, path)
        return
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor, as_completed

    pool = ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"))
    try:
        jobs = {pool.submit(_run, one, setting, flow, path): one for one, path in left}
        for job in as_completed(jobs):
            yield jobs[job], job.result()
    finally:
        pool.shutdown(cancel_futures=True)


def _run(drawn: Drawn, setting: Setting, flow: Path, path: Path) -> dict:
    """Simulate one cell and write its row."""
    from dldsim.experiments.array_run import simulate_run
    from dldsim.solver.flow import EmptyFlow

    name = outcome_id(Pair(setting.geometry, f"check-{drawn.number:04d}"))
    place = drawn.release_gap_fraction
    try:
        row = simulate_run(
            setting.geometry,
            drawn.stiffness,
            Cell(**drawn.cell.model_dump() | {"release_gap_fraction": place}),
            setting.flow,
            setting.numerics,
            setting.control,
            run_id=name,
            stiffness_set=name.rpartition("_s")[2],
            empty_flow=EmptyFlow.load(flow),
        ).row
    except NoRoom as error:
        return {"status": "does not fit", "stop_reason": str(error)}
    except DldsimError as error:
        return {"status": "failed", "stop_reason": str(error)}
    write_table("runs", [row], path, provenance(setting.of(drawn)))
    return row


def exit_um(row: dict, start_um: float, paths: Paths) -> float | None:
    """Where a simulated cell leaves the array, above the lower side wall; None if it does not."""
    if row.get("migration_angle_deg") is None:
        return None
    array = paths.array
    rows = round(array.length_um / array.pitch_um)
    steps = np.asarray(row["lateral_steps_um"])[:rows]
    settled = np.tan(np.radians(row["migration_angle_deg"])) * array.pitch_um
    free = start_um + steps.sum() + (rows - len(steps)) * settled
    radius = row["cell_radius_um"]
    return float(np.clip(free, radius, max(array.width_um - radius, radius)))


class Compared(NamedTuple):
    """One population, predicted and simulated.

    ``counted`` cells, of which ``own`` leave by the outlet that collects them, ``lost`` by none;
    ``open_``: not settled when the rows were spent; ``failed`` are not counted. ``recovery_…``:
    simulated share with its interval. ``chance_outlet``, ``chance_exit``: of what was simulated and
    of all that is as unlikely, by the prediction with its error: of the count at the outlet, and of
    the largest distance between the distributions of the exits (Kolmogorov–Smirnov).
    """

    counted: int
    own: int
    lost: int
    open_: int
    failed: int
    recovery: float
    recovery_low: float
    recovery_high: float
    chance_outlet: float
    chance_exit: float

    @property
    def agrees(self) -> bool:
        """Whether neither chance is below LEAST_CHANCE."""
        return min(self.chance_outlet, self.chance_exit) >= LEAST_CHANCE


def compare(
    rows: Sequence[dict],
    exits: Sequence[float | None],
    population: int,
    paths: Paths,
    split: Split,
    seed: int,
) -> Compared:
    """Simulated cells of one population (0 or 1) beside their prediction.

    Raises DldsimError if none of them could be simulated.
    """
    from scipy.stats import beta

    counted = [(r, e) for r, e in zip(rows, exits, strict=True) if e is not None or _lost(r)]
    n = len(counted)
    if n == 0:
        raise DldsimError(
            f"None of the {len(rows)} cells of type {population + 1} could be simulated: "
            f"{rows[0]['stop_reason'] if rows else 'none was drawn'}."
        )
    places = np.array([e for r, e in counted if not _lost(r)])
    own = int((places >= split.cut_um).sum())
    own = own if population == split.upper else len(places) - own
    tail = (1 - CONFIDENCE) / 2
    return Compared(
        n,
        own,
        n - len(places),
        sum(r["status"] not in (*SETTLED, *LOST) for r, _ in counted),
        len(rows) - n,
        own / n,
        float(beta.ppf(tail, own, n - own + 1)) if own else 0.0,
        float(beta.ppf(1 - tail, own + 1, n - own)) if own < n else 1.0,
        chance_of_count(own, n, split.recovery[population]),
        chance_of_exits(places, paths, seed),
    )


def _lost(row: dict) -> bool:
    return row["status"] in LOST


def chance_of_count(own: int, n: int, probabilities: np.ndarray) -> float:
    """Chance of ``own`` of n cells, and of all counts that are not more likely, where each of the
    probabilities (D,) is as likely to be the one of all cells."""
    from scipy.stats import binom

    chances = binom.pmf(np.arange(n + 1)[:, None], n, np.clip(probabilities, 0, 1)).mean(axis=1)
    return float(min(1.0, chances[chances <= chances[own] * (1 + 1e-9)].sum()))


def chance_of_exits(places: np.ndarray, paths: Paths, seed: int) -> float:
    """Chance that as many exits, drawn from one device, lie as far from the distribution over all
    devices as these; 1 without any."""
    if not len(places):
        return 1.0
    rng = np.random.default_rng(seed)
    lateral = paths.lateral_um(paths.array.length_um)
    weight = np.where(paths.lost, 0.0, paths.weight)
    devices = np.flatnonzero(weight.sum(axis=1) > 0)
    if not len(devices):
        return 0.0
    order = np.argsort(lateral, axis=None)
    known, cumulated = lateral.ravel()[order], np.cumsum(weight.ravel()[order])
    cumulated /= cumulated[-1]

    def distance(sample: np.ndarray) -> float:
        sample = np.sort(sample)
        edges = np.arange(len(sample) + 1) / len(sample)
        # of equal places, the distribution counts all or none: just above and just below
        above = np.searchsorted(known, sample, side="right")
        below = np.searchsorted(known, sample, side="left")
        cdf = np.concatenate([[0.0], cumulated])
        first = np.searchsorted(sample, sample, side="left")
        last = np.searchsorted(sample, sample, side="right")
        return float(
            max(np.abs(edges[last] - cdf[above]).max(), np.abs(edges[first] - cdf[below]).max())
        )

    observed = distance(places)
    chances = weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
    further = 0
    for device in rng.choice(devices, REPLICATES):
        drawn = rng.choice(lateral[device], len(places), p=chances[device])
        further += distance(drawn) >= observed - 1e-12
    return (further + 1) / (REPLICATES + 1)


def draw_checked(
    count: int,
    cells: Sequence[Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]],
    shapes: Sequence[CellShape],
    stiffness: Callable[[float], Stiffness],
    gap_um: float,
    margin_um: float,
    seed: int,
) -> list[Drawn]:
    """``count`` cells, half of each population, independent of each other.

    ``cells``: by population, from levels (3, n) to radii, spring constants and places of entry;
    ``margin_um``: room that a cell needs beside a pillar.
    """
    rng = np.random.default_rng(seed)
    drawn: list[Drawn] = []
    for population, (of, shape) in enumerate(zip(cells, shapes, strict=True), start=1):
        levels = rng.uniform(size=(4, count - count // 2 if population == 1 else count // 2))
        radius, ks, start = of(levels[:3])
        found = [shape.model_copy(update={"radius_um": round(float(r), 4)}) for r in radius]
        nearest = np.array([half_extent_um(c) + margin_um for c in found]) / gap_um
        places = release_places(levels[3], nearest).round(3)
        drawn += [
            Drawn(0, population, c, stiffness(float(k)), float(s), float(p))
            for c, k, s, p in zip(found, ks, start, places, strict=True)
        ]
    return [d._replace(number=i) for i, d in enumerate(drawn, start=1)]
