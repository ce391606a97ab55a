"""The campaign that designs are made from: its tables, its surrogate, and what they hold for."""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from dldsim import PHYSICS_VERSION
from dldsim.analysis import surrogate
from dldsim.analysis.calibration import with_library
from dldsim.analysis.features import learnable
from dldsim.analysis.learning import read_survey, with_survey
from dldsim.config.configuration import Partial, Sweep
from dldsim.config.design_sections import DesignRequest, Device
from dldsim.config.explain import validate
from dldsim.config.sections import CellShape, Flow, Numerics, RunControl, Section, Stiffness
from dldsim.design import assay_settings
from dldsim.design.chip import Chip, Resistance
from dldsim.errors import DldsimError
from dldsim.files import atomic_path
from dldsim.tables.numerics import COLUMN_OF, settings_of
from dldsim.tables.parquet import describe, read_table, write_table

CAMPAIGN_DATA = Path(__file__).parents[1] / "data" / "campaign"
"""Tables and surrogate of the campaign that comes with the package."""
KEPT = ("outcomes", "runs", "calibration", "flows")
LIBRARY = "calibration_library"
"""Kind of the calibrations for other cells, of a campaign that has some."""


def make_chip(settings: Mapping, flows: pd.DataFrame | None) -> Chip:
    """Chip of the sections `flow` and `device`, `safety_distance_um`, and a table of flows.

    Flows that the pressure drop cannot be interpolated from leave it unknown, with the reason.
    """
    chip = Chip(
        Flow(**settings["flow"]), Device(**settings["device"]), settings["safety_distance_um"]
    )
    if flows is None:
        return chip
    try:
        return chip._replace(resistance=Resistance(flows))
    except DldsimError as error:
        return chip._replace(no_resistance=str(error).rstrip("."))


class Campaign(NamedTuple):
    """A finished campaign that designs are made from: settings as its tables tell them.

    ``assays``: settings of its assays, where they are known (`assay_settings.read_made`).
    """

    settings: dict[str, Any]
    tables: dict[str, pd.DataFrame]
    chip: Chip
    model: surrogate.Surrogate
    assays: Mapping[str, Mapping[str, Any]] = {}

    @property
    def calibration(self) -> pd.DataFrame | None:
        """`calibration_of` its tables."""
        return calibration_of(self.tables)

    @property
    def sets(self) -> dict[str, Stiffness]:
        """Its stiffness sets by name."""
        return {n: Stiffness(**values) for n, values in self.settings["stiffness_sets"].items()}


def calibration_of(tables: Mapping[str, pd.DataFrame]) -> pd.DataFrame | None:
    """Calibration of the campaign's own cells, and of others where there are some; None without."""
    found = [tables[kind] for kind in ("calibration", LIBRARY) if kind in tables]
    return with_library(found) if found else None


def read_campaign(directory: Path, device: Device, safety_distance_um: float) -> Campaign:
    """Outcomes, calibration and surrogate in a folder; flows and calibrations for other cells if
    they are there.

    Where the surrogate learnt from the survey, it is among the tables. Raises DldsimError if a file
    is missing, damaged or of another physics version, or if the surrogate was learnt from others
    than these outcomes.
    """
    directory = Path(directory)
    tables = {
        kind: read_table(kind, directory / f"{kind}.parquet")
        for kind in ("outcomes", "calibration")
    }
    for kind in ("flows", LIBRARY):
        if (path := directory / f"{kind}.parquet").exists():
            tables[kind] = read_table(kind, path)
    model = surrogate.load(directory / "surrogate.json", directory / "surrogate_card.json")
    if model.card["data"]["survey"] is not None:
        tables["survey"] = read_survey()
    check_model(model, tables, directory)
    about = describe(directory / "outcomes.parquet")["provenance"]["settings"]
    known = make_campaign(tables, model, about.get("run_control"), device, safety_distance_um)
    return known._replace(assays=assay_settings.read_made(directory))


def make_campaign(
    tables: dict[str, pd.DataFrame],
    model: surrogate.Surrogate,
    run_control: Mapping | None,
    device: Device,
    safety_distance_um: float,
) -> Campaign:
    """A campaign of tables in memory: `outcomes`, and what there is of `calibration`, `flows` and
    `survey`.

    Raises DldsimError for outcomes of several conditions.
    """
    settings = settings_of_outcomes(tables["outcomes"])
    settings["run_control"] = dict(run_control or RunControl().model_dump())
    settings |= {"device": device.model_dump(), "safety_distance_um": safety_distance_um}
    return Campaign(settings, tables, make_chip(settings, tables.get("flows")), model)


def check_settings(
    settings: Partial | None,
    known: Campaign,
    request: DesignRequest | None = None,
    simulate: bool = False,
) -> None:
    """Refuse settings that answers of a campaign do not hold for.

    Compared are the settings that the configuration names: liquid and drive; reach of the contact
    and area forces, which are assumptions about the cell, not resolution; stiffness sets of the
    request, and all of them where it has an index; the assay that indices are read by; whether the
    survey was learnt from; shape and radius of the cells, velocity and height, where the request
    does not say its own; and, to ``simulate``, everything that is simulated with. Raises
    DldsimError that names key, value, and what the campaign was made with.
    """
    if settings is None:
        return
    by = None if request is None else request.assay
    by_index = request is not None and _measured(request)
    assay_settings.check_assays(settings, known.calibration, known.assays, by, by_index)
    wanted: list[tuple[str, Any, Any, str]] = []
    sections = {
        "cell": ("aspect_ratio",),
        "flow": ("viscosity_mPa_s", "drive"),
        "numerics": ("contact_range_um", "area_forces", "images"),
    }
    if simulate:
        sections["cell"] = ("aspect_ratio", "axis")
        sections |= {
            "numerics": tuple(Numerics.model_fields),
            "run_control": tuple(RunControl.model_fields),
        }
    learnt = known.model.card["data"]["survey"] is not None
    wanted += [
        (f"surrogate.{key}", value, learnt, "")
        for key, value in _named(settings, "surrogate", ("survey",))
        if learnt and not value
    ]
    for name, keys in sections.items():
        wanted += [
            (f"{name}.{key}", value, known.settings[name].get(key), "")
            for key, value in _named(settings, name, keys)
        ]
    by_sets = [] if request is None else [request.stiffness_set_1, request.stiffness_set_2]
    if by_index:  # k_s is read between all of them
        by_sets = list(known.settings["stiffness_sets"])
    for by_set in filter(None, by_sets):
        if by_set in settings.stiffness_sets and by_set in known.settings["stiffness_sets"]:
            own = known.settings["stiffness_sets"][by_set]
            wanted += [
                (f"stiffness_sets.{by_set}.{key}", value, own[key], "")
                for key, value in settings.stiffness_sets[by_set]
            ]
    flow = known.settings["flow"]
    said = set() if request is None else request.model_fields_set
    given = {field for field in said if getattr(request, field) is not None}
    for section, key, fields, options in OF_A_REQUEST if request else ():
        for field in fields:
            value = getattr(request, field)
            wanted += [
                (f"{section}.{key}", named, flow[key] if value is None else value, options)
                for _, named in _named(settings, section, (key,))
                if field not in given
            ]
    for key, value, other, options in wanted:
        if value == other or (
            isinstance(value, float) and np.isclose(value, other, rtol=1e-6, atol=0)
        ):
            continue
        remedy = (
            f"name it in the request, {options}"
            if options
            else "simulate a campaign with this value and name its folder with --results, or take "
            "the setting out of the configuration"
        )
        origin = "the request takes" if options else "answers come from a campaign with"
        raise DldsimError(
            f"{key} = {value} in the configuration, but {origin} {other}. What was learnt: "
            f"{known.model.holds_for}.",
            key=key,
            value=value,
            allowed=str(other),
            remedy=f"To have the other, {remedy}.",
        )


OF_A_REQUEST = (
    ("cell", "shape", ("shape_1", "shape_2"), "--shape1 and --shape2"),
    ("cell", "radius_um", ("radius_1_um", "radius_2_um"), "--r1 and --r2"),
    ("flow", "mean_velocity_mm_s", ("velocity_mm_s",), "--velocity"),
    ("flow", "height_um", ("height_um",), "--height"),
)
"""Settings of a campaign that a request may have its own of: section, key, fields, options."""


def _named(settings: Partial, section: str, keys: Iterable[str]) -> list[tuple[str, Any]]:
    """Keys of a section that the configuration names, with their values."""
    found = getattr(settings, section)
    if found is None:
        return []
    return [(key, getattr(found, key)) for key in keys if key in found.model_fields_set]


def packaged_campaign() -> Path:
    """Folder of the campaign that comes with the package.

    Raises DldsimError if none does, or if it is of another physics version.
    """
    remedy = "Name the folder of a finished campaign with --results, such as results/."
    if not CAMPAIGN_DATA.exists():
        raise DldsimError(f"No campaign comes with this installation. {remedy}")
    version = describe(CAMPAIGN_DATA / "calibration.parquet")["provenance"]["physics_version"]
    if version != PHYSICS_VERSION:
        raise DldsimError(
            f"The campaign that comes with this installation is of physics version {version}, "
            f"this is version {PHYSICS_VERSION}, whose angles differ. {remedy}"
        )
    return CAMPAIGN_DATA


def keep_campaign(results: Path, directory: Path = CAMPAIGN_DATA) -> None:
    """Make the tables and the surrogate of a results folder those that come with the package.

    Raises DldsimError like `read_campaign`, and without flows, from which pressures follow.
    """
    read_campaign(results, Device(), Sweep.model_fields["safety_distance_um"].default)
    for kind in (*KEPT, LIBRARY):
        path = Path(results) / f"{kind}.parquet"
        if kind == LIBRARY and not path.exists():
            continue
        about = describe(path)["provenance"]
        write_table(kind, read_table(kind, path), Path(directory) / path.name, about)
    for name in ("surrogate.json", "surrogate_card.json"):
        with atomic_path(Path(directory) / name) as part:
            part.write_bytes((Path(results) / name).read_bytes())
    made = assay_settings.read_made(results)
    with atomic_path(Path(directory) / assay_settings.KEPT) as part:
        part.write_text(json.dumps(made, indent=1, sort_keys=True) + "\n", encoding="utf-8")


def _measured(request: DesignRequest) -> bool:
    """Whether a cell type of a request has a stiffness, or a spread of it, by an assay."""
    fields = ("deformation_index_{}", "deformation_index_std_{}")
    return any(getattr(request, key.format(i)) is not None for key in fields for i in "12")


def with_default_assay(settings: Partial | None, request: DesignRequest) -> DesignRequest:
    """The request by the assay that a configuration names as default, unless it names its own or
    nothing that an assay has measured."""
    named = settings is not None and "default_assay" in settings.model_fields_set
    if settings is None or not named or request.assay is not None or not _measured(request):
        return request
    return request.model_copy(update={"assay": settings.default_assay})


def check_model(
    model: surrogate.Surrogate, tables: Mapping[str, pd.DataFrame], place: Path
) -> None:
    """Refuse a surrogate that was learnt from other outcomes. Raises DldsimError."""
    data = learnable(with_survey(tables["outcomes"], tables.get("survey")))
    if surrogate._data_hash(data) != model.card["data"]["sha256"]:
        others = "outcomes.parquet there"
        if "survey" in tables:
            others += " and the survey that comes with the package"
        raise DldsimError(
            f"{place}: the surrogate was learnt from other outcomes than those of {others}. Fit it "
            "anew: `snakemake -j2 surrogate`."
        )


def settings_of_outcomes(outcomes: pd.DataFrame) -> dict[str, Any]:
    """Sections cell, flow, numerics and stiffness_sets as a table of outcomes tells them.

    The viscosity is that of the capillary number Ca = μU/k_s. Raises DldsimError for mixed ones,
    and for values that no configuration can have.
    """
    for name in (*CELL_COLUMNS.values(), *FLOW_COLUMNS, *COLUMN_OF.values()):
        if outcomes[name].nunique() > 1:
            raise DldsimError(
                f"The table of outcomes mixes several values of {name}: designs are "
                "made from outcomes of one cell, channel and velocity.",
                key=name,
                allowed="one value",
            )
    done = outcomes[outcomes["capillary_number"].notna()]
    if done.empty:
        raise DldsimError("The table of outcomes has no run that was simulated.")
    first = done.iloc[0]
    flow = {name: first[name] for name in FLOW_COLUMNS}
    viscosity = first["capillary_number"] * first["ks_uN_per_m"] / flow["mean_velocity_mm_s"]
    flow["viscosity_mPa_s"] = round(float(viscosity), 9)
    cell = {name: first[column] for name, column in CELL_COLUMNS.items() if pd.notna(first[column])}
    names = list(Stiffness.model_fields)
    sets = done.drop_duplicates("stiffness_set").set_index("stiffness_set")[names]
    return {
        "cell": _section(CellShape, cell, CELL_COLUMNS),
        "flow": _section(Flow, flow, {"viscosity_mPa_s": "capillary_number"}),
        "numerics": _section(Numerics, settings_of(first), COLUMN_OF),
        "stiffness_sets": {
            str(k): {n: float(v) for n, v in row.items()} for k, row in sets.iterrows()
        },
    }


CELL_COLUMNS = {
    "shape": "cell_shape",
    "radius_um": "cell_radius_um",
    "aspect_ratio": "aspect_ratio",
    "axis": "release_axis",
}
"""Column of each setting of the cell that `outcomes` tells."""
FLOW_COLUMNS = ("height_um", "mean_velocity_mm_s", "drive")
"""Settings of the flow that are columns of `outcomes` by the same name."""


def _section(model: type[Section], values: Mapping, columns: Mapping[str, str]) -> dict[str, Any]:
    """A section as plain values; ``columns``: that of each setting, if it has another name."""
    try:
        plain = {k: v.item() if hasattr(v, "item") else v for k, v in values.items()}
        return validate(model, plain).model_dump()
    except DldsimError as error:
        fault = error.faults[0]
        column = columns.get(fault.key, fault.key)
        raise DldsimError(
            f"The table of outcomes: column {column} gives {fault.key} = {fault.value}; allowed "
            f"{fault.allowed}.",
            key=column,
            value=fault.value,
            allowed=fault.allowed,
        ) from error


if __name__ == "__main__":
    import sys

    keep_campaign(Path(sys.argv[1]))
