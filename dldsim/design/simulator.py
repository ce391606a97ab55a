"""Outcomes of designs: simulated, kept on disk, and used again."""

import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dldsim.analysis import uncertainty
from dldsim.config import identifiers
from dldsim.config.provenance import provenance, settings_hash
from dldsim.config.sections import CellShape, Flow, Geometry, Numerics, RunControl
from dldsim.design.export import Verified
from dldsim.design.populations import Population
from dldsim.experiments.outcome_files import (
    OutcomeFiles,
    Partial,
    Progress,
    flow_row,
    made_with,
    write_outcome,
)
from dldsim.tables.parquet import read_columns, read_rows, write_table

if TYPE_CHECKING:
    from dldsim.experiments.array_outcome import OutcomeResult

SHAPES_EVERY = 2
"""Samples of a run from one recorded shape to the next."""


class Scene(NamedTuple):
    """What the campaign simulates with, at the flow of a request."""

    cell: CellShape
    flow: Flow
    numerics: Numerics
    control: RunControl


class Kept(NamedTuple):
    """Files of an outcome: its tables, and the shapes of its first release."""

    tables: OutcomeFiles
    shapes: Path


class Simulator:
    """Outcomes of a verification, each release kept on disk as soon as it is done, and used again.

    Called with geometry, population and channel height [µm] it returns the row of `outcomes`. An
    outcome is found again if everything it depends on is the same. The cell has its own shape,
    radius and moduli: what similarity assumes (moduli in proportion) is part of what is checked.
    On the finer lattice the cell is released as well: what goes on with a settled cell misses
    motions that there are on that lattice alone. ``threads``: outcomes that `each` simulates at a
    time; the time steps leave Python's lock to others.
    """

    def __init__(
        self, directory: Path, scene: Scene, progress: Progress | None = None, threads: int = 1
    ):
        self.directory, self.scene, self.threads = Path(directory), scene, threads
        self.models = uncertainty.read_models()
        self._progress, self._stopped = progress, threading.Event()
        self._flow: tuple[Any, Any] = (None, None)
        self._solving = threading.Lock()

    def each(
        self, simulate: Callable[[Population], dict], populations: Sequence[Population]
    ) -> list[dict]:
        """``simulate`` of every population, in their order, as many at a time as there are threads.

        Where one raises, or the user stops it, the others end at their next sign of progress.
        """
        if self.threads == 1:
            return [simulate(population) for population in populations]
        with ThreadPoolExecutor(self.threads) as pool:
            try:
                jobs = [pool.submit(simulate, population) for population in populations]
                for job in wait(jobs, return_when=FIRST_EXCEPTION).done:
                    job.result()
                return [job.result() for job in jobs]
            except BaseException:
                self._stopped.set()
                raise
            finally:
                pool.shutdown(wait=True, cancel_futures=True)
                self._stopped.clear()

    def _told(self, name: str) -> Progress:
        """How the outcome of that name tells its progress."""

        def tell(sentence: str) -> None:
            if self._stopped.is_set():
                raise KeyboardInterrupt
            if self._progress:
                self._progress(f"{name}: {sentence}" if self.threads > 1 else sentence)

        return tell

    def __call__(
        self, geometry: Geometry, population: Population, height_um: float, finer: bool = False
    ) -> dict:
        scene = self._at(geometry, height_um, finer)
        name = self.name(geometry, population, height_um, finer)
        settings = self._settings(geometry, population, scene)
        kept = self._files(name)
        there = finer or kept.shapes.exists()
        if not (there and made_with(kept.tables.outcome, settings_hash(settings))):
            self._simulate(geometry, population, scene, name, settings, recorded=not finer)
        [row] = read_rows("outcomes", kept.tables.outcome)
        return self._judged(row, population)

    def glance(
        self, geometry: Geometry, population: Population, height_um: float, finer: bool = True
    ) -> dict:
        """The same from the first place of release alone, on the finer lattice; an outcome that is
        asked for afterwards goes on with that release."""
        scene = self._at(geometry, height_um, finer)
        name = self.name(geometry, population, height_um, finer)
        settings = self._settings(geometry, population, scene)
        if made_with(self._files(name).tables.outcome, settings_hash(settings)):
            return self(geometry, population, height_um, finer)
        partial = Partial(self.directory / name, name, settings)
        first = scene.control.release_gap_fractions[:1]
        alone = scene.control.model_copy(update={"release_gap_fractions": first})
        releases = {"finished": partial.finished(first), "keep": partial.keep}
        scene = scene._replace(control=alone)
        result = self._outcome(geometry, population, scene, name, **releases)
        return self._judged(result.row, population)

    def _settings(self, geometry: Geometry, population: Population, scene: Scene) -> dict:
        """All that an outcome depends on."""
        sections = {
            **{name: getattr(scene, name) for name in ("flow", "numerics", "control")},
            "cell": self._cell(population),
            "stiffness": population.stiffness,
            "geometry": geometry,
        }
        return {name: section.model_dump(mode="json") for name, section in sections.items()}

    def _judged(self, row: Mapping[str, Any], population: Population) -> dict:
        """A row of `outcomes` with the index of its cell and with σ_num."""
        return {
            **row,
            "deformation_index": population.deformation_index,
            "deformation_index_std": None
            if population.deformation_index is None
            else population.deformation_index_std,
            **uncertainty.numerical_uncertainty(row, uncertainty.model_of(row, self.models)),
        }

    def name(
        self, geometry: Geometry, population: Population, height_um: float, finer: bool = False
    ) -> str:
        """Identifier of an outcome; another height than the scene's is part of it, in nm, and so is
        a finer lattice."""
        other = None if height_um == self.scene.flow.height_um else height_um
        return identifiers.checked_outcome_id(geometry, population.name, finer, other)

    def passage(self, row: Mapping[str, Any]) -> Verified:
        """A finished outcome with trajectory and recorded shapes of its first release."""
        from dldsim.experiments.vtk import read_vtkhdf

        kept = self._files(row["outcome_id"])
        columns = read_columns("trajectory", kept.tables.trajectory).to_pydict()
        columns = {k: np.array(v) for k, v in columns.items()}
        first = columns["run_id"] == columns["run_id"][0]
        return Verified(row, {k: v[first] for k, v in columns.items()}, read_vtkhdf(kept.shapes))

    def resistance(self, geometry: Geometry) -> dict[str, Any]:
        """Row of `flows` of an array at the scene's height, from the solver."""
        path = self.directory / f"{identifiers.geometry_id(geometry)}.flow.parquet"
        scene = self.scene
        settings = {"flow": scene.flow.model_dump(), "numerics": scene.numerics.model_dump()}
        if not made_with(path, settings_hash(settings)):
            row = flow_row(self._empty_flow(geometry, scene))
            write_table("flows", [row], path, provenance(settings))
        [row] = read_rows("flows", path)
        return row

    def _simulate(
        self, geometry, population, scene: Scene, name: str, settings: Mapping, recorded: bool
    ) -> None:
        """Simulate an outcome and write its tables, and the shapes of its first release."""
        from dldsim.experiments.vtk import Recorder, write_vtkhdf

        files, shapes = self._files(name)
        partial = Partial(self.directory / name, name, settings)
        finished = partial.finished(scene.control.release_gap_fractions)
        if recorded and not shapes.exists():
            finished = {}
        recorder = Recorder(SHAPES_EVERY) if recorded and not finished else None

        def keep(place: float, result) -> None:
            nonlocal recorder
            if recorder:
                write_vtkhdf(recorder.shapes(geometry, result), shapes, provenance(settings))
                recorder = None
            partial.keep(place, result)

        releases = {"finished": finished, "keep": keep, "observe": recorder}
        result = self._outcome(geometry, population, scene, name, **releases)
        write_outcome(result, files, settings)
        partial.remove()

    def _outcome(
        self, geometry, population, scene: Scene, name: str, **releases
    ) -> "OutcomeResult":
        """`simulate_outcome` of a cell type in a scene; ``releases``: what is done with each."""
        from dldsim.experiments.array_outcome import simulate_outcome

        return simulate_outcome(
            geometry,
            population.stiffness,
            self._cell(population),
            scene.flow,
            scene.numerics,
            scene.control,
            outcome_id=name,
            stiffness_set=name.rpartition("_s")[2],
            empty_flow=self._empty_flow(geometry, scene),
            progress=self._told(name),
            **releases,
        )

    def _at(self, geometry: Geometry, height_um: float, finer: bool) -> Scene:
        from dldsim.solver.pillars import next_finer

        flow = self.scene.flow.model_copy(update={"height_um": height_um})
        numerics = self.scene.numerics
        return self.scene._replace(
            flow=flow, numerics=next_finer(geometry, numerics) if finer else numerics
        )

    def _cell(self, population: Population) -> CellShape:
        named = {"shape": population.shape, "radius_um": population.radius_um}
        return self.scene.cell.model_copy(update=named)

    def _files(self, name: str) -> Kept:
        folder = self.directory
        tables = (folder / f"{name}.{kind}.parquet" for kind in OutcomeFiles._fields)
        return Kept(OutcomeFiles(*tables), folder / f"{name}.vtkhdf")

    def _empty_flow(self, geometry: Geometry, scene: Scene):
        """Flow without a cell; the last one is kept, which both cell types share."""
        from dldsim.solver.flow import solve_empty_array

        key = geometry, scene.flow, scene.numerics
        with self._solving:
            if self._flow[0] != key:
                self._flow = key, solve_empty_array(geometry, scene.flow, scene.numerics)
            return self._flow[1]
