"""The campaign that designs are made from: its tables, its surrogate, and what they hold for."""

from collections.abc import Iterable, Mapping, Sequence
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
from dldsim.design.chip import Chip, Resistance
from dldsim.design.deformability import ks_of_index
from dldsim.errors import DldsimError
from dldsim.experiments.migration import mode_of
from dldsim.files import atomic_path
from dldsim.tables.numerics import COLUMN_OF, settings_of
from dldsim.tables.parquet import describe, read_table, write_table
from dldsim.vocabulary import GEOMETRY

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
    """A finished campaign that designs are made from: settings as its tables tell them."""

    settings: dict[str, Any]
    tables: dict[str, pd.DataFrame]
    chip: Chip
    model: surrogate.Surrogate

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
    return make_campaign(tables, model, about.get("run_control"), device, safety_distance_um)


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
    settings = settings_of_outcomes(tables["outcomes"], tables.get("flows"))
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
    request; shape and radius of the cells, velocity and height, where the request does not say its
    own; and, to ``simulate``, everything that is simulated with. Raises DldsimError that names key,
    value, and what the campaign was made with.
    """
    if settings is None:
        return
    wanted: list[tuple[str, Any, Any, str]] = []
    sections = {
        "cell": ("aspect_ratio",),
        "flow": ("viscosity_mPa_s", "drive"),
        "numerics": ("contact_range_um", "area_forces"),
    }
    if simulate:
        sections["cell"] = ("aspect_ratio", "axis")
        sections |= {
            "numerics": tuple(Numerics.model_fields),
            "run_control": tuple(RunControl.model_fields),
        }
    for name, keys in sections.items():
        wanted += [
            (f"{name}.{key}", value, known.settings[name].get(key), "")
            for key, value in _named(settings, name, keys)
        ]
    for i in (1, 2) if request else ():
        name = getattr(request, f"stiffness_set_{i}")
        if name in (settings.stiffness_sets or {}) and name in known.settings["stiffness_sets"]:
            own = known.settings["stiffness_sets"][name]
            wanted += [
                (f"stiffness_sets.{name}.{key}", value, own[key], "")
                for key, value in settings.stiffness_sets[name]
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


MEASURED = "measured"
"""Status of a row that was measured on a fabricated device."""


def with_measurements(
    outcomes: pd.DataFrame,
    measurements: Sequence[Mapping[str, Any]],
    calibration: pd.DataFrame | None = None,
) -> pd.DataFrame:
    """The table of outcomes with measured angles below, to be learnt from like outcomes.

    A measurement has the keys MEASURED_KEYS, one of `deformation_index` (by the assay that the
    campaign's own indices come from) and `ks_uN_per_m`, and `cell_shape` unless it is a biconcave
    disc. The index gives k_s by the calibration, and this Ca with the campaign's viscosity. Of a
    measured row all other columns are null. A measured array counts as an array of its own in the
    surrogate's intervals if its size differs from those simulated.

    Raises DldsimError for keys that are missing, for an index without a calibration or outside of
    its range, and for angles that no array of that periodicity can cause.
    """
    viscosity = settings_of_outcomes(outcomes)["flow"]["viscosity_mPa_s"]
    rows = []
    for i, given in enumerate(measurements, start=1):
        at = f"measurements.{i - 1}."
        if missing := [key for key in MEASURED_KEYS if given.get(key) is None]:
            raise DldsimError(f"Measurement {i} lacks {', '.join(missing)}.", key=at + missing[0])
        bump = float(np.degrees(np.arctan(1 / given["periodicity"])))
        angle = given["migration_angle_deg"]
        if not -bump / 2 <= angle <= 1.5 * bump:
            allowed = f"{-bump / 2:.3g} to {1.5 * bump:.3g}"
            raise DldsimError(
                f"Measurement {i}: migration_angle_deg = {angle:g} with periodicity "
                f"{given['periodicity']}: allowed {allowed}. Full bump motion has {bump:.3g}°.",
                key=at + "migration_angle_deg",
                value=angle,
                allowed=allowed,
                remedy="Look at the sign, the unit and the row shift.",
            )
        ks = _measured_ks(given, calibration, i, at)
        rows.append(
            {
                **{key: given[key] for key in MEASURED_KEYS},
                "cell_shape": given.get("cell_shape") or "biconcave",
                "deformation_index": given.get("deformation_index"),
                "ks_uN_per_m": ks,
                "capillary_number": viscosity * given["mean_velocity_mm_s"] / ks,
                "outcome_id": f"measured-{i:04d}",
                "stiffness_set": MEASURED,
                "status": MEASURED,
                "stop_reason": "",
                "mode": mode_of(angle, 1 / given["periodicity"]),
                "pitch_um": 2 * given["pillar_radius_um"] + given["gap_um"],
                "row_shift_fraction": 1 / given["periodicity"],
                "bump_angle_deg": bump,
                "sigma_num_kind": MEASURED,
                "sigma_num_basis": MEASURED,
            }
        )
    return pd.concat(
        [
            outcomes,
            pd.DataFrame(rows, columns=outcomes.columns).astype(
                {name: kind for name, kind in outcomes.dtypes.items() if kind.kind == "f"}
            ),
        ],
        ignore_index=True,
    )


MEASURED_KEYS = (
    *GEOMETRY,
    "cell_radius_um",
    "height_um",
    "mean_velocity_mm_s",
    "migration_angle_deg",
)


def _measured_ks(given: Mapping, calibration: pd.DataFrame | None, number: int, at: str) -> float:
    """Spring constant [µN/m] of a measured cell type."""
    index, ks = given.get("deformation_index"), given.get("ks_uN_per_m")
    if (index is None) == (ks is None):
        raise DldsimError(
            f"Measurement {number}: exactly one of deformation_index and ks_uN_per_m.",
            key=(at + "deformation_index", at + "ks_uN_per_m"),
            value=(index, ks),
        )
    if ks is not None:
        return float(ks)
    shape = given.get("cell_shape") or "biconcave"
    keys = at + "deformation_index", at + "cell_shape", at + "cell_radius_um"
    return ks_of_index(index, shape, given["cell_radius_um"], calibration, keys=keys)["ks_uN_per_m"]


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


def settings_of_outcomes(
    outcomes: pd.DataFrame, flows: pd.DataFrame | None = None
) -> dict[str, Any]:
    """Sections cell, flow, numerics and stiffness_sets as a table of outcomes tells them.

    The viscosity is that of the capillary number Ca = μU/k_s. Raises DldsimError for mixed ones,
    and for values that no configuration can have.
    """
    for name in (*CELL_COLUMNS.values(), *FLOW_COLUMNS, *COLUMN_OF.values()):
        if outcomes[name].nunique() != 1:
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
    if flows is not None and len(flows):
        flow["drive"] = flows["drive"].iloc[0]
    cell = {name: first[column] for name, column in CELL_COLUMNS.items()}
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


CELL_COLUMNS = {"shape": "cell_shape", "radius_um": "cell_radius_um", "axis": "release_axis"}
"""Column of each setting of the cell that `outcomes` tells."""
FLOW_COLUMNS = ("height_um", "mean_velocity_mm_s")
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
