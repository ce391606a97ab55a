"""The answer to one design request: search, simulated check, tables and files."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from dldsim.analysis import surrogate
from dldsim.analysis.calibration import default_curves, join_deformation_index
from dldsim.config.design_sections import DesignRequest, Verification
from dldsim.config.provenance import derive_seed, provenance
from dldsim.config.sections import CellShape, Flow, Numerics, RunControl, Stiffness
from dldsim.design.chip import Chip
from dldsim.design.export import export_design
from dldsim.design.finished_campaign import Campaign
from dldsim.design.populations import make_populations
from dldsim.design.rounds import verify
from dldsim.design.search import Each, Found, search
from dldsim.design.simulator import Scene, Simulator, conditions
from dldsim.design.verified import Verdicts, export, plain
from dldsim.errors import DldsimError
from dldsim.experiments.outcome_files import Progress
from dldsim.tables.parquet import write_csv, write_table

SEARCH = ("designs", "design_trials", "design_tolerances", "design_importance", "design_slices")
"""Kinds of tables of a search, in the order of `Found`."""


def by_deformation_index(request: DesignRequest, calibration: pd.DataFrame | None) -> DesignRequest:
    """The request with its stiffness sets replaced by their calibrated index and its scatter."""
    names = [n for n in (request.stiffness_set_1, request.stiffness_set_2) if n is not None]
    index, spread = {}, {}
    if names:
        keys = [f"stiffness_set_{i}" for i in "12" if getattr(request, f"stiffness_set_{i}")]
        if calibration is None:
            raise DldsimError(
                f"design request {request.name}: stiffness sets need a calibration.",
                key=keys,
                value=names,
                allowed="deformation_index_1 and deformation_index_2",
                remedy="Name the cell types by these, or add the table calibration.",
            )
        known = default_curves(calibration)["stiffness_set"].dropna()
        known = sorted({str(n) for n in known if n})
        for key in keys:
            if (name := getattr(request, key)) not in known:
                raise DldsimError(
                    f"{key}: no membrane of the default assay stands for stiffness set {name} "
                    f"(calibrated: {', '.join(known) or 'none'}).",
                    key=key,
                    value=name,
                    allowed=", ".join(known),
                    remedy="Name a calibrated one.",
                )
        joined = join_deformation_index(pd.DataFrame({"stiffness_set": names}), calibration)
        for name, mean, std in joined[
            ["stiffness_set", "deformation_index", "deformation_index_std"]
        ].to_numpy():
            index |= {} if np.isnan(mean) else {name: float(mean)}
            spread[name] = 0.0 if np.isnan(std) else float(std)
    return request.with_deformation_indices(index, spread)


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
) -> Verdicts:
    """Verify the designs of one request by simulation and write their files.

    ``settings``: sections of the configuration, `seed` and `verification` among them; ``tables``:
    `outcomes` and `calibration`; ``work``: where finished ones are kept; ``files``: folder of the
    designs' files.
    """
    scene = scene_of(settings)
    conditions(tables["outcomes"], scene)
    resolved = by_deformation_index(request, tables["calibration"])
    sets = {name: Stiffness(**values) for name, values in settings["stiffness_sets"].items()}
    populations = make_populations(request, resolved, tables["calibration"], sets)
    budget = Verification(**settings["verification"])
    simulator = Simulator(work, scene, progress)
    verdicts = verify(
        model,
        tables["outcomes"],
        resolved,
        chip,
        budget,
        populations,
        simulator,
        derive_seed(settings["seed"], f"verify/{request.name}"),
        resistance=simulator.resistance,
        progress=progress,
    )
    Path(files).mkdir(parents=True, exist_ok=True)
    export(
        verdicts,
        resolved,
        chip,
        simulator,
        budget.exports,
        files,
        provenance(settings, settings["seed"]),
        model.card,
    )
    return verdicts


class Made(NamedTuple):
    """The answer to one request: as asked, by deformation indices, settings and tables."""

    request: DesignRequest
    resolved: DesignRequest
    settings: dict[str, Any]
    found: Found

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
) -> Made:
    """Search for one request; ``budget`` is that of a verification later, ``each`` as in `search`.

    Raises DldsimError as `search` does.
    """
    resolved = by_deformation_index(request, known.tables.get("calibration"))
    found = search(
        known.model, resolved, known.chip, derive_seed(seed, f"design/{request.name}"), each
    )
    settings = {
        **known.settings,
        "seed": seed,
        "verification": budget.model_dump(),
        "design_requests": [request.model_dump()],
        "surrogate": {k: known.model.card[k] for k in ("data", "scores_by_geometry", "versions")},
        "holds_for": known.model.holds_for,
    }
    return Made(request, resolved, settings, found)


def write_designs(
    made: Made, known: Campaign, directory: Path, verdicts: Verdicts | None = None
) -> list[Path]:
    """Tables with CSV twins, `files/NAME-candidate-K.*` of every candidate, and `report.html`.

    Of the first candidate's mask there is a picture, too.
    ``verdicts``: of `verify_request`, which writes the files of the simulated designs itself.
    Returns what was written, CSV twins left out.
    """
    directory = Path(directory)
    written = write_tables(made.found, verdicts, directory, made.about)
    for _, design in made.found.designs.iterrows():
        name = f"{made.request.name}-candidate-{design['design']}"
        files = export_design(
            name,
            design.to_dict(),
            made.resolved,
            known.chip.device,
            directory / "files",
            about=made.about,
            card=known.model.card,
            picture=design["design"] == 1,
        )
        written += files.values()
    from dldsim.report.design_page import write_report

    write_report(directory, directory / "report.html")
    return [*written, directory / "report.html"]


def write_tables(
    found: Found, verdicts: Verdicts | None, directory: Path, about: Mapping[str, Any]
) -> list[Path]:
    """Tables of a search, and of its verification, with CSV twins; returns the Parquet files."""
    tables = dict(zip(SEARCH, found, strict=True))
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
