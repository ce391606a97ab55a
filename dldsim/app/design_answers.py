"""The answer to one design request: search, simulated check, tables and files."""

import json
import re
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from dldsim.analysis import surrogate
from dldsim.app.asked import Both, ask
from dldsim.config.design_sections import DesignRequest, Verification
from dldsim.config.provenance import derive_seed, provenance
from dldsim.config.sections import CellShape, Flow, Geometry, Numerics, RunControl, Stiffness
from dldsim.design.chip import Chip
from dldsim.design.device_outcome import KINDS as DEVICE_KINDS
from dldsim.design.device_outcome import SUMMED_UP, DeviceOutcome, tables_of, warnings_of
from dldsim.design.export import FILES, export_design
from dldsim.design.finished_campaign import Campaign, calibration_of
from dldsim.design.outlet_task import OutletTask, outlet_seed
from dldsim.design.populations import Population, flow_of, make_populations
from dldsim.design.rounds import verify
from dldsim.design.search import Each, Found, search
from dldsim.design.simulator import Scene, Simulator
from dldsim.design.verified import Verdicts, devices_of, export, plain
from dldsim.errors import DldsimError
from dldsim.experiments.outcome_files import Progress
from dldsim.tables.parquet import describe, write_csv, write_table
from dldsim.vocabulary import GEOMETRY

SEARCH = (
    "design_populations",
    "designs",
    "design_trials",
    "design_tolerances",
    "design_importance",
    "design_slices",
)
"""Kinds of tables of a search, in the order of `Found`."""


def resolve(
    request: DesignRequest,
    flow: Flow,
    sets: Mapping[str, Stiffness],
    calibration: pd.DataFrame | None,
    model: surrogate.Surrogate,
) -> list[Population]:
    """Both cell types of a request at its flow; ``flow``: the campaign's.

    Raises DldsimError as `make_populations` does.
    """
    return make_populations(request, flow_of(request, flow), sets, calibration, model.domains)


def resolve_by(known: Campaign, request: DesignRequest) -> list[Population]:
    """The same by what a finished campaign knows."""
    return resolve(request, known.chip.flow, known.sets, known.calibration, known.model)


def scene_of(settings: Mapping) -> Scene:
    """The campaign's cell, flow, numerics and run control."""
    return Scene(
        CellShape(**settings["cell"]),
        Flow(**settings["flow"]),
        Numerics(**settings["numerics"]),
        RunControl(**settings["run_control"]),
    )


def verify_request(
    request: DesignRequest,
    settings: Mapping,
    chip: Chip,
    model: surrogate.Surrogate,
    tables: Mapping[str, pd.DataFrame],
    *,
    work: Path,
    files: Path,
    progress: Progress | None,
    measured: Both = (None, None),
    threads: int = 1,
) -> Verdicts:
    """Verify the designs of one request by simulation, look at the outlets of those whose files are
    written, and write them.

    ``settings``: sections of the configuration, `seed` and `verification` among them; ``tables``:
    `outcomes`, and `calibration` and `survey` if there are any; ``work``: where finished ones are
    kept; ``files``: folder of the designs' files; ``threads``: cells simulated at a time.
    """
    sets = {name: Stiffness(**values) for name, values in settings["stiffness_sets"].items()}
    populations = resolve(request, chip.flow, sets, calibration_of(tables), model)
    flow = flow_of(request, chip.flow)
    budget = Verification(**settings["verification"])
    simulator = Simulator(work, scene_of(settings)._replace(flow=flow), progress, threads)
    asked = ask(request, populations, tables, measured)
    verdicts = verify(
        model,
        tables["outcomes"],
        request,
        chip.at(flow),
        budget,
        populations,
        simulator,
        derive_seed(settings["seed"], f"verify/{request.name}"),
        sources=asked.sources,
        history=asked.history,
        fit=partial(surrogate.fit, survey=tables.get("survey")),
        resistance=simulator.resistance,
        each=simulator.each,
        glance=simulator.glance,
        progress=progress,
    )
    seed = outlet_seed(settings["seed"])
    task = OutletTask(model, request, asked.sources, asked.history, chip.at(flow), seed)
    try:
        devices = devices_of(verdicts, task, budget.exports)
    except DldsimError as error:
        devices = []
        if progress:
            progress(f"no outcome of the device: {error}")
    verdicts = verdicts._replace(devices=devices)
    Path(files).mkdir(parents=True, exist_ok=True)
    export(
        verdicts,
        request,
        chip.at(flow),
        simulator,
        budget.exports,
        files,
        provenance(settings, settings["seed"]),
        model.card,
    )
    return verdicts


class Made(NamedTuple):
    """The answer to one request: its cell types, settings, tables of the search, and what comes out
    of the candidates, in their order; ``notes``: what to know about that."""

    request: DesignRequest
    populations: Sequence[Population]
    settings: dict[str, Any]
    found: Found
    devices: list[DeviceOutcome]
    notes: list[str]

    @property
    def about(self) -> dict[str, Any]:
        """Provenance of everything that is written of it."""
        return provenance(self.settings, self.settings["seed"])


def make_designs(
    request: DesignRequest,
    known: Campaign,
    seed: int,
    budget: Verification,
    each: Each | None = None,
    measured: Both = (None, None),
) -> Made:
    """Search for one request, and look at the outlets of its candidates.

    ``budget`` is that of a verification later, ``each`` as in `search`, ``measured``: cells of both
    types, whose mean and scatter the request has. A device that its cells do not fit has no
    outcomes, and the notes say why.

    Raises DldsimError as `search` does.
    """
    populations = resolve_by(known, request)
    asked = ask(request, populations, known.tables, measured)
    chip = known.chip.at(flow_of(request, known.chip.flow))
    number = derive_seed(seed, f"design/{request.name}")
    cells = asked.sources, asked.history
    task = OutletTask(known.model, request, *cells, chip, outlet_seed(seed))
    found = search(known.model, request, populations, chip, number, each, *cells, task)
    notes = asked.notes
    try:
        devices = [
            task.outcome(candidate_name(request, design["design"]), geometry_of(design))
            for _, design in found.designs.iterrows()
        ]
        notes = [*notes, *warnings_of(devices)]
    except DldsimError as error:
        devices, notes = [], [*notes, f"no outcome of the device: {error}"]
    settings = {
        **known.settings,
        "seed": seed,
        "verification": budget.model_dump(),
        "design_requests": [request.model_dump()],
        "surrogate": {k: known.model.card[k] for k in ("data", "scores_by_geometry", "versions")},
        "holds_for": known.model.holds_for,
    }
    return Made(request, populations, settings, found, devices, notes)


def candidate_name(request: DesignRequest, number: int) -> str:
    """Name of a candidate and its files."""
    return f"{request.name}-candidate-{number}"


def geometry_of(design: Mapping[str, Any]) -> Geometry:
    """The array of a row of `designs` or `verified_designs`."""
    return Geometry(**{name: design[name] for name in GEOMETRY})


def write_designs(
    made: Made, known: Campaign, directory: Path, verdicts: Verdicts | None = None
) -> list[Path]:
    """Tables with CSV twins, `files/NAME-candidate-K.*` of every candidate, and `report.html`.

    Of the first candidate's mask there is a picture, too.
    ``verdicts``: of `verify_request`, which writes the files of the simulated designs itself.
    Returns what was written, CSV twins left out.
    """
    directory = Path(directory)
    written = write_tables(made, verdicts, directory)
    for _, design in made.found.designs.iterrows():
        name = candidate_name(made.request, design["design"])
        files = export_design(
            name,
            design.to_dict(),
            made.request,
            known.chip.device,
            directory / "files",
            about=made.about,
            card=known.model.card,
            picture=design["design"] == 1,
            outcome=next((d for d in made.devices if d.name == name), None),
        )
        written += files.values()
    from dldsim.report.design_page import write_report

    write_report(directory, directory / "report.html")
    return [*written, directory / "report.html"]


LATER = ("verifications", "verified_designs")
"""Kinds of tables of a simulated check, which a search alone does not write."""


def remove_stale(made: Made, directory: Path, verdicts: Verdicts | None = None) -> list[Path]:
    """Remove what an earlier request of the same name left in a folder and this one does not
    overwrite: files of candidates and of simulated designs, and tables; returns what was removed.

    What was made with the same settings, such as simulated designs of this very request, stays.
    """
    directory, own = Path(directory), made.about["config_hash"]
    names = {candidate_name(made.request, k) for k in made.found.designs["design"]}
    if verdicts is not None:
        names |= set(verdicts.designs.head(made.settings["verification"]["exports"])["name"])
    endings = "|".join(map(re.escape, FILES.values()))
    pattern = re.compile(rf"({re.escape(made.request.name)}-(?:candidate-)?\d+)(?:{endings})")
    found: dict[str, list[Path]] = {}
    for path in sorted((directory / "files").glob("*")):
        match = pattern.fullmatch(path.name)
        if match and match[1] not in names:
            found.setdefault(match[1], []).append(path)
    stale = []
    for name, paths in found.items():
        try:
            record = json.loads((directory / "files" / f"{name}.json").read_text(encoding="utf-8"))
            same = record["provenance"]["config_hash"] == own
        except (OSError, ValueError, KeyError, TypeError):
            same = False
        stale += [] if same else paths
    kinds = () if made.devices else DEVICE_KINDS
    for kind in kinds if verdicts is not None else (*kinds, *LATER):
        path = directory / f"{kind}.parquet"
        if path.exists() and describe(path)["provenance"]["config_hash"] != own:
            stale += [p for p in (path, path.with_suffix(".csv")) if p.exists()]
    for path in stale:
        path.unlink()
    return stale


def write_tables(made: Made, verdicts: Verdicts | None, directory: Path) -> list[Path]:
    """Tables of a search, of its outlets, and of its verification, with CSV twins; returns the
    Parquet files.

    What comes out is that of the simulated designs, where there are any; of the first device there
    is the way of the cells, too.
    """
    about = made.about
    devices = made.devices if verdicts is None else verdicts.devices or made.devices
    tables: dict[str, Any] = dict(zip(SEARCH, made.found, strict=True))
    tables |= tables_of(devices[:1]) | tables_of(devices, SUMMED_UP)
    if verdicts is not None:
        tables |= {
            "verifications": plain(verdicts.verifications),
            "verified_designs": plain(verdicts.designs),
        }
    paths = []
    for kind, table in tables.items():
        path = Path(directory) / f"{kind}.parquet"
        write_table(kind, table, path, about)
        write_csv(kind, path)
        paths.append(path)
    return paths
