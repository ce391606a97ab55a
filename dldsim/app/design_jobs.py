"""Jobs of the rules about designs: tables and requests in, tables and files out."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from dldsim.analysis import surrogate
from dldsim.analysis.calibration import with_library
from dldsim.analysis.learning import survey_of
from dldsim.app.asked import ask
from dldsim.app.design_answers import SEARCH, resolve, verify_request
from dldsim.config.design_sections import DesignRequest
from dldsim.config.provenance import derive_seed, provenance
from dldsim.config.sections import Stiffness
from dldsim.design.chip import Chip
from dldsim.design.finished_campaign import LIBRARY, make_chip
from dldsim.design.outlet_task import OutletTask, outlet_seed
from dldsim.design.populations import Population, flow_of
from dldsim.design.search import Found, regret, search
from dldsim.design.verified import plain
from dldsim.errors import DldsimError
from dldsim.experiments.outcome_files import Progress
from dldsim.tables.parquet import read_many, read_table, write_csv, write_table
from dldsim.tables.registry import COLUMNS


class Inputs(NamedTuple):
    """What every job about designs needs."""

    requests: list[DesignRequest]
    chip: Chip
    sets: dict[str, Stiffness]
    model: surrogate.Surrogate
    calibration: pd.DataFrame

    def populations(self, request: DesignRequest) -> list[Population]:
        """Both cell types of a request."""
        return resolve(request, self.chip.flow, self.sets, self.calibration, self.model)

    def chip_for(self, request: DesignRequest) -> Chip:
        """The chip at the flow of a request."""
        return self.chip.at(flow_of(request, self.chip.flow))


def _inputs(
    settings: Mapping,
    model: Path,
    card: Path,
    calibration: Path,
    flows: Path,
    library: Path | None = None,
) -> Inputs:
    """``library``: calibrations for other cells, where there are some."""
    chip = make_chip(settings, read_table("flows", flows))
    curves = [read_table("calibration", calibration)]
    if library:
        curves.append(read_table(LIBRARY, library))
    return Inputs(
        [DesignRequest(**r) for r in settings["design_requests"]],
        chip,
        {name: Stiffness(**values) for name, values in settings["stiffness_sets"].items()},
        surrogate.load(model, card),
        with_library(curves),
    )


def _known(settings: Mapping, inputs: Inputs, outcomes: Path) -> dict[str, pd.DataFrame]:
    """Tables of outcomes and calibration, and of the survey where it is learnt from."""
    tables = {"outcomes": read_table("outcomes", outcomes), "calibration": inputs.calibration}
    survey = survey_of(settings)
    return tables if survey is None else tables | {"survey": survey}


def each_request(
    inputs: Inputs, answer: Callable[[DesignRequest], Any]
) -> tuple[list[Any], list[dict[str, str]]]:
    """What ``answer`` says to every request, and a row of `design_requests` for each.

    A request that cannot be answered takes no other with it: its row holds the reason.
    """
    found, rows = [], []
    for request in inputs.requests:
        row = {"request": request.name, "status": "answered", "reason": ""}
        try:
            found.append(answer(request))
        except DldsimError as error:
            row |= {"status": "failed", "reason": str(error)}
        rows.append(row)
    return found, rows


def design_job(
    settings: Mapping,
    *,
    tables: Mapping[str, Path],
    outcomes: Path,
    progress: Progress,
    **paths: Path,
) -> None:
    """Search for all requests; the tables of SEARCH and `design_requests`, with CSV twins."""
    inputs = _inputs(settings, **paths)
    known = _known(settings, inputs, outcomes)

    def answer(request: DesignRequest) -> Found:
        asked = ask(request, inputs.populations(request), known)
        cells, chip = (asked.sources, asked.history), inputs.chip_for(request)
        outlets = OutletTask(inputs.model, request, *cells, chip, outlet_seed(settings["seed"]))
        return search(
            inputs.model,
            request,
            asked.populations,
            chip,
            derive_seed(settings["seed"], f"design/{request.name}"),
            None,
            *cells,
            outlets,
        )

    found, requests = each_request(inputs, answer)
    content: dict[str, Any] = {kind: _empty(kind) for kind in SEARCH}
    if found:
        parts = zip(SEARCH, zip(*found, strict=True), strict=True)
        content = {kind: pd.concat(frames, ignore_index=True) for kind, frames in parts}
    content["design_requests"] = requests or _empty("design_requests")
    for kind, table in content.items():
        write_table(kind, table, tables[kind], provenance(settings, settings["seed"]))
        write_csv(kind, tables[kind])
    _tell(requests, progress)


def _tell(requests: Iterable[Mapping], progress: Progress) -> None:
    for row in requests:
        if row["status"] == "failed":
            progress(f"{row['request']} failed: {row['reason']}")


def regret_job(settings: Mapping, *, table: Path, progress: Progress, **paths: Path) -> None:
    """Regret of TPE, random and exhaustive search on the surrogate, with a CSV twin."""
    inputs = _inputs(settings, **paths)
    found, requests = each_request(
        inputs,
        lambda request: regret(
            inputs.model,
            request,
            inputs.populations(request),
            inputs.chip_for(request),
            derive_seed(settings["seed"], f"regret/{request.name}"),
        ),
    )
    _tell(requests, progress)
    kind = "search_regret"
    rows = pd.concat(found, ignore_index=True) if found else _empty(kind)
    write_table(kind, rows, table, provenance(settings, settings["seed"]))
    write_csv(kind, table)


def verify_job(
    name: str,
    settings: Mapping,
    *,
    outcomes: Path,
    verifications: Path,
    designs: Path,
    added: Path,
    requests: Path,
    files: Path,
    work: Path,
    threads: int,
    progress: Progress,
    **paths: Path,
) -> None:
    """Verification of one request: rows of `verifications`, `verified_designs` and `outcomes`.

    A request that cannot be answered has none, and the reason in its row of `verified_requests`.
    """
    inputs = _inputs(settings, **paths)
    inputs = inputs._replace(requests=[r for r in inputs.requests if r.name == name])
    tables = _known(settings, inputs, outcomes)
    Path(files).mkdir(parents=True, exist_ok=True)
    found, told = each_request(
        inputs,
        lambda request: verify_request(
            request,
            settings,
            inputs.chip,
            inputs.model,
            tables,
            work=work,
            files=files,
            progress=progress,
            threads=threads,
        ),
    )
    _tell(told, progress)
    about = provenance(settings, settings["seed"])
    content: dict[str, list[dict]] = {"verifications": [], "verified_designs": [], "outcomes": []}
    for verdicts in found:
        content = {
            "verifications": plain(verdicts.verifications),
            "verified_designs": plain(verdicts.designs),
            "outcomes": [row for row in verdicts.rows.values() if row["status"] != "failed"],
        }
    for kind, table, path in (
        ("verifications", content["verifications"], verifications),
        ("verified_designs", content["verified_designs"], designs),
        ("outcomes", content["outcomes"], added),
        ("verified_requests", told, requests),
    ):
        write_table(kind, table or _empty(kind), path, about)


def gather_verified(
    settings: Mapping,
    *,
    verifications: Iterable[Path],
    designs: Iterable[Path],
    added: Iterable[Path],
    requests: Iterable[Path],
    outcomes: Path,
    tables: Mapping[str, Path],
    model: Path,
    card: Path,
) -> None:
    """Tables of all requests, and the surrogate refitted to all outcomes, the verifying ones too.

    ``tables``: paths of `verifications`, `verified_designs`, `verified_requests` and `outcomes`.
    """
    about = provenance(settings, settings["seed"])
    learnt = read_many("outcomes", [outcomes, *added])
    for kind, table in (
        ("verifications", read_many("verifications", verifications)),
        ("verified_designs", read_many("verified_designs", designs)),
        ("verified_requests", read_many("verified_requests", requests)),
        ("outcomes", learnt),
    ):
        write_table(kind, table, tables[kind], about)
        write_csv(kind, tables[kind])
    seed = derive_seed(settings["seed"], "surrogate")
    surrogate.fit(learnt, seed, survey_of(settings)).save(model, card)


def _empty(kind: str) -> dict:
    return {column.name: [] for column in COLUMNS[kind]}
