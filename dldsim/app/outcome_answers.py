"""The answer to “what comes out”: one array or a cascade of two, its tables, page and check."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from dldsim.analysis.stiffness import stiffness_at
from dldsim.app.asked import Asked
from dldsim.app.design_answers import scene_of
from dldsim.config.design_sections import DesignRequest, Device
from dldsim.config.explain import validate
from dldsim.config.provenance import derive_seed, provenance
from dldsim.config.sections import Geometry
from dldsim.design.cell_check import (
    PROCESSES,
    Compared,
    Drawn,
    Setting,
    compare,
    draw_checked,
    exit_um,
    simulate_cells,
)
from dldsim.design.cell_source import CellSource
from dldsim.design.device_outcome import DeviceOutcome, device_outcome, interval
from dldsim.design.draws import Stream
from dldsim.design.finished_campaign import Campaign
from dldsim.design.motion import simulated_in
from dldsim.design.outlet_task import outlet_seed
from dldsim.design.populations import flow_of
from dldsim.design.task import check_cells
from dldsim.errors import DldsimError
from dldsim.experiments.outcome_files import Progress
from dldsim.files import atomic_path
from dldsim.tables.parquet import write_csv, write_table
from dldsim.tables.registry import TABLES
from dldsim.vocabulary import GEOMETRY

CHECKS = ("device_checks", "checked_cells")
CELLS_MAX = 1000
"""Cells of a simulated check at most."""


class Design(NamedTuple):
    """A design as its file has it: name, array, device, and the request that it was made for.

    ``device``: as its mask has it, array length and walls between outlets included; ``asked``: the
    setting that it was made with. Of the request, fields at their default are left out.
    """

    name: str
    geometry: Geometry
    device: Device
    request: dict[str, Any]
    asked: Device | None = None


def read_design(path: Path) -> Design:
    """A design from the JSON file that was exported for it.

    Raises DldsimError if the file is not there or is no such file.
    """
    path = Path(path)
    remedy = "Name the .json file of a design, such as files/request-candidate-1.json."
    try:
        record = json.loads(path.read_text(encoding="utf-8-sig"))
        asked, mask = record["provenance"]["settings"]["device"], record["device"]
        values = {key: mask[key] for key in GEOMETRY}
        drawn = {
            "array_length_mm": mask["array_length_um"] / 1e3,
            "sample_position_mm": mask["sample_position_um"] / 1e3,
            "sample_width_um": mask["sample_width_um"],
            "outlet_walls_um": mask["outlet_walls_um"],
        }
        name, request = record["name"], _named(record["request"])
        device = {**asked, **drawn}
    except OSError as error:
        raise DldsimError(
            f"{path} cannot be read: {error.strerror}.", key=str(path), remedy=remedy
        ) from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise DldsimError(
            f"{path} is no file of a design ({type(error).__name__}: {str(error):.200}).",
            key=str(path),
            remedy=remedy,
        ) from error
    return Design(
        name, validate(Geometry, values), validate(Device, device), request, validate(Device, asked)
    )


def _named(request: dict[str, Any]) -> dict[str, Any]:
    """Fields of a request in a file that say something: those at their default are not known to
    have been asked for."""
    usual = {
        name: field.default
        for name, field in DesignRequest.model_fields.items()
        if not field.is_required()
    }
    plain = {name: list(v) if isinstance(v, tuple) else v for name, v in usual.items()}
    return {k: v for k, v in request.items() if k not in plain or v != plain[k]}


def make_outcomes(
    asked: Asked,
    designs: Sequence[Design],
    known: Campaign,
    seed: int,
    *,
    from_outlet: int | None = None,
) -> list[DeviceOutcome]:
    """What comes out of a design, and of a second one that ``from_outlet`` of the first feeds.

    Where the campaign has simulated the mean cell of a type in the very array, its motion is known.
    Raises DldsimError as `check_cells`, `device_outcome` and `DeviceOutcome.inflow` do.
    """
    name = f"request {asked.request.name}"
    check_cells(name, asked.request, asked.populations, known.model)
    found: list[DeviceOutcome] = []
    for design in designs:
        inflow = found[0].inflow(from_outlet) if found else None
        try:
            one = device_outcome(
                asked.request,
                design.name,
                design.geometry,
                design.device,
                asked.sources,
                known.model,
                asked.history,
                outlet_seed(seed),
                simulated=_simulated(asked, design, known),
                inflow=inflow,
            )
        except DldsimError as error:
            if inflow is None:
                raise
            raise DldsimError(
                f"The second device, {design.name}: {error}",
                key=[f"then.{key}" for key in error.keys],
                value=error.value,
                allowed=error.allowed,
            ) from error
        found.append(one)
    return found


def _simulated(asked: Asked, design: Design, known: Campaign) -> list[dict[str, Any] | None]:
    """Rows of `outcomes` of both cell types in the array of a design, where there are any."""
    outcomes = known.tables["outcomes"]
    return [simulated_in(outcomes, design.geometry, p) for p in asked.populations]


# ------------------------------------------------------------------------------- simulated check


def check_by_simulation(
    asked: Asked,
    design: Design,
    predicted: DeviceOutcome,
    known: Campaign,
    count: int,
    seed: int,
    directory: Path,
    progress: Progress,
    processes: int = PROCESSES,
) -> dict[str, pd.DataFrame]:
    """Tables of CHECKS: so many drawn cells, simulated in the nominal array, beside its prediction.

    The wall between the outlets is that of ``predicted``. Finished cells are kept in ``directory``
    and used again. Raises DldsimError for fewer than two cells or more than CELLS_MAX.
    """
    if not 2 <= count <= CELLS_MAX:
        raise DldsimError(
            f"simulate = {count}: allowed 2 to {CELLS_MAX} cells.",
            key="simulate",
            value=count,
            allowed=f"2 to {CELLS_MAX}",
            remedy="40 cells take some minutes on two cores.",
        )
    setting, drawn = _drawn(asked, design, known, count, seed)
    nominal = device_outcome(
        asked.request,
        design.name,
        design.geometry,
        design.device.model_copy(update={"outlet_walls_um": list(predicted.walls_um)}),
        asked.sources,
        known.model,
        asked.history,
        outlet_seed(seed),
        simulated=_simulated(asked, design, known),
        tolerance_um=0.0,
    )
    rows = simulate_cells(drawn, setting, directory, progress, processes)
    exits = [
        exit_um(row, d.start_um, nominal.paths[d.population - 1])
        for row, d in zip(rows, drawn, strict=True)
    ]
    head = {"request": asked.request.name, "device": design.name, "stage": 1}
    checks = []
    for k in (0, 1):
        own = [i for i, d in enumerate(drawn) if d.population == k + 1]
        part = [rows[i] for i in own], [exits[i] for i in own]
        found = compare(*part, k, nominal.paths[k], nominal.split, derive_seed(seed, f"check/{k}"))
        checks.append(head | {"population": k + 1} | _check_row(found, nominal, k))
    cells = [
        head
        | {
            "cell": d.number,
            "population": d.population,
            "radius_um": d.cell.radius_um,
            "ks_uN_per_m": d.stiffness.ks_uN_per_m,
            "start_um": d.start_um,
            "release_gap_fraction": d.release_gap_fraction,
            "status": row["status"],
            "mode": row.get("mode", "none"),
            "rows_completed": row.get("rows_completed"),
            "exit_um": place,
        }
        for d, row, place in zip(drawn, rows, exits, strict=True)
    ]
    return {
        kind: pd.DataFrame(table, columns=TABLES[kind].names)
        for kind, table in zip(CHECKS, (checks, cells), strict=True)
    }


def _check_row(found: Compared, nominal: DeviceOutcome, k: int) -> dict[str, Any]:
    return {
        "simulated": found.counted,
        "own": found.own,
        "lost": found.lost,
        "open": found.open_,
        "failed": found.failed,
        **interval("predicted", nominal.split.recovery[k]),
        "recovery": found.recovery,
        "recovery_low": found.recovery_low,
        "recovery_high": found.recovery_high,
        "chance_outlet": found.chance_outlet,
        "chance_exit": found.chance_exit,
        "agrees": found.agrees,
    }


def _drawn(
    asked: Asked, design: Design, known: Campaign, count: int, seed: int
) -> tuple[Setting, list[Drawn]]:
    """What is simulated with, and the cells."""
    scene = scene_of(known.settings)
    flow = flow_of(asked.request, known.chip.flow)
    device = design.device
    stream = Stream(1e3 * device.sample_position_mm, device.sample_width_um, flow.height_um)

    def drawing(source: CellSource):
        def of(levels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            radius, ks = source.draw(levels[0], levels[1])
            return radius, ks, stream.places(radius, levels[2])

        return of

    drawn = draw_checked(
        count,
        [drawing(source) for source in asked.sources],
        [scene.cell.model_copy(update={"shape": p.shape}) for p in asked.populations],
        lambda ks: stiffness_at(ks, known.sets, "ks_uN_per_m"),
        design.geometry.gap_um,
        scene.numerics.spacing_um / 2,
        derive_seed(seed, "checked cells"),
    )
    return Setting(design.geometry, flow, scene.numerics, scene.control), drawn


# ------------------------------------------------------------------------------------------ files


def write_outcomes(
    tables: Mapping[str, pd.DataFrame], directory: Path, about: Mapping[str, Any]
) -> list[Path]:
    """Tables with CSV twins, `outcome.png` and `outcome.html`; returns what was written, CSV twins
    left out. Tables of a simulated check that belong to an earlier answer are removed."""
    from dldsim.report.outcome_page import write_outcome_page
    from dldsim.report.outlet_figures import draw_fan
    from dldsim.report.style import render

    directory = Path(directory)
    paths = []
    for kind in set(CHECKS) - set(tables):  # of an earlier answer
        for ending in (".parquet", ".csv"):
            (directory / f"{kind}{ending}").unlink(missing_ok=True)
    for kind, table in tables.items():
        path = directory / f"{kind}.parquet"
        write_table(kind, table, path, about)
        write_csv(kind, path)
        paths.append(path)
    picture = directory / "outcome.png"
    with atomic_path(picture) as part:
        part.write_bytes(render(draw_fan(tables), "png"))
    write_outcome_page(directory, directory / "outcome.html")
    return [*paths, picture, directory / "outcome.html"]


def about_outcome(asked: Asked, known: Campaign, designs: Sequence[Design], seed: int) -> dict:
    """Provenance of the files of an outcome."""
    settings = {
        **known.settings,
        "design_requests": [asked.request.model_dump()],
        "arrays": [d.geometry.model_dump() for d in designs],
        "device": designs[0].device.model_dump(),
        "holds_for": known.model.holds_for,
    }
    return provenance(settings, seed)
