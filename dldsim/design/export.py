"""What leaves the building for a design: data, photomask, and the verifying runs to look at."""

import csv
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dldsim import PHYSICS_VERSION, __version__
from dldsim.config.design_sections import DesignRequest, Device
from dldsim.config.sections import Geometry
from dldsim.design.device_outcome import SUMMED_UP, DeviceOutcome, tables_of
from dldsim.design.layout import Layout, Stream, make_layout
from dldsim.design.mask import draw_mask, write_dxf, write_gds
from dldsim.errors import DldsimError
from dldsim.files import atomic_path
from dldsim.tables.registry import COLUMNS

if TYPE_CHECKING:
    from dldsim.experiments.vtk import Shapes

FILES = {
    "json": ".json",
    "csv": ".csv",
    "gds": ".gds",
    "dxf": ".dxf",
    "mask_picture": ".mask.png",
    "cell_1": ".cell-1.vtkhdf",
    "cell_2": ".cell-2.vtkhdf",
    "pillars": ".pillars.vtkhdf",
    "picture": ".passage.png",
    "animation": ".passage.gif",
}
"""Files of a design and how their names end; those from `cell_1` on need verifying runs."""
UNITS = {"_um": "µm", "_mm": "mm", "_deg": "°", "_s": "s", "_ms": "ms", "_mm_s": "mm/s"}
"""Unit of a quantity that is no column of a table, by the end of its name; else none."""
BULKY = {"domain"}
"""Parts of a model card that are of no use beside a design."""


class Verified(NamedTuple):
    """Outcome of one cell type: row of `outcomes`, `trajectory` and shapes of its first release."""

    row: Mapping[str, Any]
    trajectory: Mapping[str, Any]
    shapes: "Shapes"


def export_design(
    name: str,
    design: Mapping[str, Any],
    request: DesignRequest,
    device: Device,
    directory: Path,
    *,
    about: Mapping[str, Any],
    card: Mapping[str, Any] | None = None,
    verified: Sequence[Verified] | None = None,
    picture: bool = True,
    outcome: DeviceOutcome | None = None,
) -> dict[str, Path]:
    """Write all files of one design, ``name`` plus the endings in FILES; returns those written.

    ``design`` is a row of `designs`, ``about`` its provenance (config hash, seed, …), ``card`` the
    surrogate's model card. With ``verified``, the runs of both cell types, the mask shows their
    simulated angles in place of predicted ones, and there are time series, picture and animation;
    without, files of an earlier verification are deleted. ``picture``: of the mask, the slowest
    part. ``outcome``: what comes out of the device; the mask then has its length of array and its
    walls between outlets. Files are whole or not there.

    Raises DldsimError if a run belongs to another array, or if the device is too small.
    """
    geometry = Geometry(**{key: design[key] for key in Geometry.model_fields})
    populations = make_streams(design, request, verified)
    device = device if outcome is None else outcome.device
    walls = None if outcome is None else outcome.walls_um
    layout = make_layout(geometry, device, populations, name, walls)
    for run in verified or ():
        _check_array(name, layout, run)
    directory = Path(directory)
    paths = {kind: directory / f"{name}{ending}" for kind, ending in FILES.items()}
    write_gds(layout, paths["gds"])
    write_dxf(layout, paths["dxf"])
    if picture:
        _write_figure(draw_mask(paths["gds"], device), paths["mask_picture"])
    else:
        paths.pop("mask_picture").unlink(missing_ok=True)
    if verified:
        _write_passage(layout, verified, about, paths)
    else:
        for kind in list(FILES)[list(FILES).index("cell_1") :]:
            paths.pop(kind).unlink(missing_ok=True)
    record = make_record(name, design, request, layout, about, card, verified)
    record["outcome"] = None if outcome is None else _plain(outcome_rows(outcome))
    record["files"] = {kind: path.name for kind, path in paths.items()}
    with atomic_path(paths["json"]) as part:
        text = json.dumps(record, indent=1, ensure_ascii=False, allow_nan=False)
        part.write_text(text + "\n", encoding="utf-8")
    _write_csv(record, paths["csv"])
    return paths


def outcome_rows(outcome: DeviceOutcome) -> dict[str, list[dict]]:
    """Purity, recovery and outlets of a device for JSON, without what its other parts say."""
    tables = tables_of([outcome], SUMMED_UP)
    return {
        "populations": tables["device_outcomes"].to_dict("records"),
        "outlets": tables["device_outlets"].to_dict("records"),
    }


def make_streams(
    design: Mapping[str, Any], request: DesignRequest, verified: Sequence[Verified] | None = None
) -> list[Stream]:
    """Both cell types with the angle that the mask shows.

    That is the simulated angle with its numerical uncertainty, or, without a run or where the run
    has no angle, the predicted one with half the variance of the separation.
    """
    found = []
    for i in (1, 2):
        angle, error = design[f"angle_{i}_deg"], design["uncertainty_deg"] / math.sqrt(2)
        row = verified[i - 1].row if verified else {}
        if row.get("migration_angle_deg") is not None:
            angle, error = row["migration_angle_deg"], row.get("sigma_num_deg")
        found.append(Stream(f"cell {i}", getattr(request, f"radius_{i}_um"), angle, error))
    return found


def make_record(
    name: str,
    design: Mapping[str, Any],
    request: DesignRequest,
    layout: Layout,
    about: Mapping[str, Any],
    card: Mapping[str, Any] | None,
    verified: Sequence[Verified] | None,
) -> dict[str, Any]:
    """Content of the JSON file: plain values, null for "not measured", units of all columns."""
    runs = [
        {**run.row, "path_departure_um": run.shapes.departure_um(run.trajectory)}
        for run in verified or ()
    ]
    expected = layout.expected()
    for i, population in enumerate(expected["populations"]):
        found = bool(runs) and runs[i]["migration_angle_deg"] is not None
        population["angle_source"] = f"simulated, {runs[i]['status']}" if found else "predicted"
    record = {
        "name": name,
        "provenance": {
            **about,
            "dldsim_version": __version__,
            "physics_version": PHYSICS_VERSION,
            "surrogate": {k: v for k, v in card.items() if k not in BULKY} if card else None,
        },
        "request": request.model_dump(),
        "design": dict(design),
        "verification": runs,
        "device": expected,
    }
    names = {*design, *(key for run in runs for key in run)}
    record["columns"] = {
        n: {"unit": unit, "description": text}
        for n in sorted(names)
        for unit, text in [meaning_of(n)]
    }
    return _plain(record)


def meaning_of(quantity: str) -> tuple[str, str]:
    """Unit and meaning of a quantity, from the tables `designs` and `outcomes` or from its name."""
    for kind in ("designs", "outcomes"):
        for column in COLUMNS[kind]:
            if column.name == quantity:
                return column.unit, column.description
    endings = sorted((e for e in UNITS if quantity.endswith(e)), key=len)
    return (UNITS[endings[-1]] if endings else "", "")


def _check_array(name: str, layout: Layout, run: Verified) -> None:
    for key, wanted in layout.geometry.model_dump().items():
        for source, value in (("row", run.row[key]), ("shapes", getattr(run.shapes.geometry, key))):
            if abs(value - wanted) > 1e-6:
                raise DldsimError(
                    f"{name}: the verifying {run.row['outcome_id']} has {key} = {value:g} in its "
                    f"{source}, the design {wanted:g} (lengths to the nanometre). Simulate the "
                    "design itself."
                )


def _write_passage(
    layout: Layout, verified: Sequence[Verified], about: Mapping[str, Any], paths: dict[str, Path]
) -> None:
    """Time series, pillars, picture and animation of the verifying runs."""
    from dldsim.experiments.vtk import write_pillars, write_vtkhdf
    from dldsim.report.movie import draw_passage, write_animation

    passages = {}
    for i, run in enumerate(verified, start=1):
        write_vtkhdf(run.shapes, paths[f"cell_{i}"], about)
        passages[passage_label(i, run.row)] = run.shapes
    write_pillars([run.shapes for run in verified], paths["pillars"])
    _write_figure(draw_passage(passages), paths["picture"])
    write_animation(passages, paths["animation"])


def passage_label(number: int, row: Mapping[str, Any]) -> str:
    """A cell type by what it is made of, and what it did."""
    angle = row["migration_angle_deg"]
    result = row["status"] if angle is None else f"{angle:.2f}°, {row['mode']}"
    return (
        f"cell {number}, k_s {row['ks_uN_per_m']:.3g} µN/m, R {row['cell_radius_um']:g} µm: "
        f"{result}"
    )


def _write_figure(figure, path: Path) -> None:
    from dldsim.report.style import render

    with atomic_path(path) as part:
        part.write_bytes(render(figure, "png"))


def _write_csv(record: Mapping[str, Any], path: Path) -> None:
    """One quantity a line: section, quantity, value, unit, description; lists as JSON."""
    sections = [(key, record[key]) for key in ("provenance", "request", "design")]
    sections += [(f"verification {i}", run) for i, run in enumerate(record["verification"], 1)]
    device = dict(record["device"])
    populations = device.pop("populations")
    sections += [("device", device), *((p["name"], p) for p in populations)]
    with atomic_path(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["section", "quantity", "value", "unit", "description"])
        for section, values in sections:
            for key, value in values.items():
                if isinstance(value, list | dict):
                    value = json.dumps(value, ensure_ascii=False)
                writer.writerow([section, key, value, *meaning_of(key)])


def _plain(value: Any) -> Any:
    """The value for JSON: Python's own types, NaN as null."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and math.isnan(value) else value
