"""What the service is asked and what it answers: the contract of /api/v1.

Rows of tables are those of :mod:`dldsim.tables.parquet`, column by column. In answers null means
"not known" or "not measured", as in the tables.
"""

import math
from functools import cache
from typing import Annotated, Any, Literal

import pyarrow as pa
from pydantic import BaseModel, ConfigDict, Field, create_model, field_validator, model_validator

from dldsim.app.asked import Both, with_measured
from dldsim.config.design_sections import CellTypes, DesignRequest, Device, Spring, check_cell_type
from dldsim.config.sections import Fraction, Name, Section, Shape, Unfit
from dldsim.design.measured_cells import Measured, read_measured
from dldsim.errors import DldsimError
from dldsim.tables.registry import COLUMNS

LARGEST = {
    "radius_1_um": 50.0,
    "radius_2_um": 50.0,
    "deformation_index_std_1": 1.0,
    "deformation_index_std_2": 1.0,
    "pillar_radius_um": 100.0,
    "gap_um": 200.0,
    "periodicity": 100,
    "tolerance_um": 10.0,
    "height_tolerance_um": 10.0,
    "pillar_aspect_ratio_max": 100.0,
    "lateral_separation_um": 1e5,
    "pressure_max_kPa": 1e5,
    "startup_trials": 1000,
    "trials": 1000,
    "grid_steps": 33,
    "draws": 512,
    "cells": 1024,
    "candidates": 10,
    "radius_std_1_um": 25.0,
    "radius_std_2_um": 25.0,
    "concentration_ratio": 1e6,
    "footprint_max_mm2": 1e4,
    "sample_min_uL_per_h": 1e6,
}
"""Largest values that the service takes, beside the ranges of the configuration: they bound what a
request can cost. The number of trials may be limited further by the settings of the service."""
SMALLEST = {
    "radius_1_um": 0.1,
    "radius_2_um": 0.1,
    "pillar_radius_um": 0.1,
    "gap_um": 0.1,
    "pillar_aspect_ratio_max": 0.01,
    "lateral_separation_um": 0.1,
    "pressure_max_kPa": 1e-9,
    "concentration_ratio": 1e-6,
    "footprint_max_mm2": 1e-6,
    "sample_min_uL_per_h": 1e-9,
}
"""Smallest values: positive ones below make numbers that overflow."""
SETS_LENGTH = 64
CSV_LENGTH = 100_000
"""Characters of a table of measured cells: some ten thousand cells."""
OUTCOME_DRAWS_MAX = 131_072
"""Draws of the array times cells of an outcome that is waited for."""
SEED_MAX = 2**31 - 1
UUID = r"^[0-9a-f]{8}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{12}$"
CampaignId = Annotated[
    str,
    Field(
        pattern=UUID,
        description="a campaign of POST /campaigns or /measurements; left out: the service's own",
    ),
]


def _no_flag(cls: type[BaseModel], value: Any, info: Any) -> Any:
    """Refuse true and false where a number is asked for, which they would count as."""
    given = value if isinstance(value, list | tuple) else [value]
    if cls.model_fields[info.field_name].annotation is not bool and any(
        isinstance(v, bool) for v in given
    ):
        raise ValueError("a value of this field, not true or false")
    return value


def no_flags() -> Any:
    """Validator of a request's fields against true and false in place of numbers."""
    return field_validator("*", mode="before")(classmethod(_no_flag))


class Answer(BaseModel):
    """Base of answers."""

    model_config = ConfigDict(protected_namespaces=())


# ----------------------------------------------------------------------------------------- problems


class FieldProblem(Answer):
    """What is wrong with one field."""

    field: str = Field(description="name of the field, empty for the whole request")
    value: str = Field(description="the value given, as text, shortened")
    message: str = Field(description="field, value and what is allowed")


class Problem(Answer):
    """The answer to everything that is refused or fails."""

    error: str = Field(description="kind of problem: invalid, infeasible, not-found, busy, …")
    message: str = Field(description="what is wrong and what to do, to be shown to a user")
    fields: list[FieldProblem] = []
    retry_after_s: int | None = Field(None, description="when to ask again, as in Retry-After")


# ----------------------------------------------------------------------------------------- requests


def _in_range(cls: type[BaseModel], value: Any, info: Any) -> Any:
    """Refuse what costs too much or overflows."""
    least, most = SMALLEST.get(info.field_name), LARGEST[info.field_name]
    for number in value if isinstance(value, tuple) else (value,):
        if number is not None and number > most:
            raise ValueError(f"this service takes up to {most:g}")
        if number is not None and least is not None and number < least:
            raise ValueError(f"this service takes {least:g} or more, up to {most:g}")
    return value


def in_range(*names: str) -> Any:
    """Validator of a request's fields against LARGEST and SMALLEST."""
    return field_validator(*names)(classmethod(_in_range))


def _measured_csv(i: int) -> Any:
    return Field(
        None,
        strict=True,
        max_length=CSV_LENGTH,
        description=f"measured cells of type {i}, the text of a CSV table with a column radius_um "
        "and, where it was measured, deformation_index or ks_uN_per_m; their mean and spread take "
        "the place of what the other fields say",
    )


class MeasuredCells(Section):
    """Tables of measured cells in a request; its fields of mean and spread follow from them."""

    population_1_csv: str | None = _measured_csv(1)
    population_2_csv: str | None = _measured_csv(2)

    @model_validator(mode="before")
    @classmethod
    def _mean_and_spread(cls, values: Any) -> Any:
        if not isinstance(values, dict):
            return values
        try:
            return with_measured(values, _read_both(values))
        except DldsimError as error:
            raise Unfit(str(error), _csv_at_fault(values)) from error

    @property
    def measured(self) -> Both:
        """Measured cells of both types, where there are any."""
        return _read_both(self.model_dump(include={"population_1_csv", "population_2_csv"}))


def _read_both(values: Any) -> Both:
    """Measured cells of both types; what is no text is left to the validation of its field."""
    first, second = (_read_csv(values.get(f"population_{i}_csv"), i) for i in (1, 2))
    return first, second


def _read_csv(text: Any, i: int) -> Measured | None:
    if not isinstance(text, str) or len(text) > CSV_LENGTH:
        return None
    return read_measured(text.encode("utf-8", "replace"), f"population_{i}_csv")


def _csv_at_fault(values: Any) -> str:
    """Name of the table that cannot be read."""
    try:
        _read_csv(values.get("population_1_csv"), 1)
    except DldsimError:
        return "population_1_csv"
    return "population_2_csv"


class DesignSpec(MeasuredCells, DesignRequest):
    """Two cell types to be separated: a request of `python -m dldsim design`, and how to do it."""

    _no_flags = no_flags()
    _in_range = in_range(*LARGEST)

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"stiffness_set_1": "1", "stiffness_set_2": "5", "trials": 60, "seed": 1}]
        }
    )

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9-]{1,40}$")] = Field(
        "request", description="letters, digits and hyphens; names the files"
    )
    stiffness_set_1: str | None = Field(
        None, max_length=SETS_LENGTH, description="instead of deformation_index_1"
    )
    stiffness_set_2: str | None = Field(
        None, max_length=SETS_LENGTH, description="instead of deformation_index_2"
    )
    seed: int = Field(1, ge=0, le=SEED_MAX, description="seed of everything random")
    verify: bool = Field(
        False, description="simulate both cell types in the best designs afterwards (minutes)"
    )
    campaign: CampaignId | None = None

    @property
    def request(self) -> DesignRequest:
        """The request alone, as the command line has it."""
        return DesignRequest(**self.model_dump(include=set(DesignRequest.model_fields)))


class OptimizeSpec(DesignSpec):
    """A request that is waited for; nothing is verified."""

    verify: Literal[False] = False


DEVICE = ("array_length_mm", "array_width_mm", "sample_position_mm", "sample_width_um", "outlets")
"""Settings of the device that a request may change."""


def _of_device(name: str) -> Any:
    field = Device.model_fields[name]
    text = field.description.partition("; default")[0]
    return Field(None, description=f"{text}; left out: the service's device")


Millimetres = Annotated[float, Field(ge=0.01, le=100)]


class OutcomeSpec(MeasuredCells, CellTypes):
    """Two cell types and one array: the options of `python -m dldsim outcome`."""

    _no_flags = no_flags()
    _in_range = in_range(*(name for name in LARGEST if name in CellTypes.model_fields))

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "pillar_radius_um": 9.0,
                    "gap_um": 12.0,
                    "periodicity": 10,
                    "stiffness_set_1": "3",
                    "radius_1_um": 4.5,
                    "radius_cv_1": 0.05,
                    "stiffness_set_2": "3",
                    "radius_2_um": 7.5,
                    "radius_std_2_um": 0.4,
                }
            ]
        }
    )

    pillar_radius_um: float = Field(ge=0.1, le=100, description="pillar radius P_r")
    gap_um: float = Field(ge=0.1, le=200, description="gap P_g between pillar surfaces")
    periodicity: int = Field(ge=2, le=100, description="rows N_p after which the array repeats")
    stiffness_set_1: str | None = Field(
        None, max_length=SETS_LENGTH, description="instead of deformation_index_1"
    )
    stiffness_set_2: str | None = Field(
        None, max_length=SETS_LENGTH, description="instead of deformation_index_2"
    )
    tolerance_um: float = Field(0.5, ge=0, le=10, description="fabrication: ± on P_r and P_g")
    array_length_mm: Millimetres | None = _of_device("array_length_mm")
    array_width_mm: Millimetres | None = _of_device("array_width_mm")
    sample_position_mm: Millimetres | None = _of_device("sample_position_mm")
    sample_width_um: Annotated[float, Field(ge=0.1, le=1e5)] | None = _of_device("sample_width_um")
    outlets: Annotated[int, Field(ge=2, le=20)] | None = _of_device("outlets")
    seed: int = Field(1, ge=0, le=SEED_MAX, description="seed of everything random")
    campaign: CampaignId | None = None

    @model_validator(mode="after")
    def _within_seconds(self) -> "OutcomeSpec":
        if self.draws * self.cells > OUTCOME_DRAWS_MAX:
            raise Unfit(
                f"draws times cells at most {OUTCOME_DRAWS_MAX:,}, not {self.draws * self.cells:,}",
                "draws",
                "cells",
            )
        return self

    @property
    def request(self) -> DesignRequest:
        """Both cell types as a request has them; its bounds of a search mean nothing."""
        names = {*CellTypes.model_fields, "tolerance_um"}
        return DesignRequest(name="outcome", **self.model_dump(include=names))

    @property
    def device(self) -> dict[str, Any]:
        """What is given of the device."""
        return self.model_dump(include=set(DEVICE), exclude_none=True)


class PredictSpec(Section):
    """One array and one cell type."""

    _no_flags = no_flags()

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "pillar_radius_um": 7.0,
                    "gap_um": 16.0,
                    "periodicity": 6,
                    "deformation_index": 0.7,
                }
            ]
        }
    )

    pillar_radius_um: float = Field(ge=0.1, le=100, description="pillar radius P_r")
    gap_um: float = Field(ge=0.1, le=200, description="gap P_g between pillar surfaces")
    periodicity: int = Field(ge=2, le=100, description="rows N_p after which the array repeats")
    cell_shape: Shape = Field("biconcave", description="rest shape of the cell type")
    cell_radius_um: float = Field(7.5, ge=0.1, le=50, description="radius of the cell type")
    deformation_index: Fraction | None = Field(None, description="of the cell type, by the assay")
    deformation_index_std: Fraction | None = Field(
        None, description="spread of it among cells; default 0"
    )
    assay: Name | None = Field(None, description="default: the campaign's own")
    stiffness_set: str | None = Field(
        None, max_length=SETS_LENGTH, description="instead of deformation_index"
    )
    ks_uN_per_m: Spring | None = Field(None, description="spring constant k_s, instead")
    rigid: bool = Field(False, description="a bead (cell_shape sphere), instead")
    velocity_mm_s: Annotated[float, Field(ge=1e-5, le=1000)] | None = Field(
        None, description="mean velocity; default: the campaign's"
    )
    height_um: Annotated[float, Field(ge=0, le=1000)] | None = Field(
        None, description="channel height; default: the campaign's"
    )
    level: float = Field(0.9, ge=0.5, le=0.99, description="level of the prediction interval")
    campaign: CampaignId | None = None

    @model_validator(mode="after")
    def _one_name(self) -> "PredictSpec":
        keys = "deformation_index", "stiffness_set", "ks_uN_per_m", "rigid"
        check_cell_type(self, keys, "cell_shape", "deformation_index_std")
        return self

    @property
    def request(self) -> DesignRequest:
        """A design request whose two cell types are this one."""
        cell = {f"shape_{i}": self.cell_shape for i in (1, 2)}
        for i in (1, 2):
            cell |= {
                f"radius_{i}_um": self.cell_radius_um,
                f"deformation_index_{i}": self.deformation_index,
                f"deformation_index_std_{i}": self.deformation_index_std,
                f"stiffness_set_{i}": self.stiffness_set,
                f"ks_{i}_uN_per_m": self.ks_uN_per_m,
                f"rigid_{i}": self.rigid,
            }
        named = self.model_dump(include={"assay", "velocity_mm_s", "height_um"})
        return DesignRequest(name="prediction", **cell, **named)


class StiffnessSpec(Section):
    """A measured deformation index."""

    _no_flags = no_flags()

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"deformation_index": 0.7, "error": 0.01}]}
    )

    deformation_index: float = Field(ge=0, le=1, description="as measured in the assay")
    error: float = Field(0.0, ge=0, le=1, description="its standard error")
    assay: str | None = Field(None, description="name of the assay; none: the campaign's default")
    campaign: CampaignId | None = None


class Measurement(Section):
    """The angle of one cell type in a fabricated device."""

    _no_flags = no_flags()

    pillar_radius_um: float = Field(ge=0.1, le=100, description="as fabricated")
    gap_um: float = Field(ge=0.1, le=200, description="as fabricated")
    periodicity: int = Field(ge=2, le=100, description="rows N_p")
    cell_shape: Shape = Field("biconcave", description="rest shape of the cell type")
    cell_radius_um: float = Field(ge=0.1, le=50, description="of the cell type")
    deformation_index: Fraction | None = Field(
        None, description="of the cell type, by the campaign's own assay"
    )
    ks_uN_per_m: Spring | None = Field(None, description="spring constant k_s, instead")
    migration_angle_deg: float = Field(
        ge=-45, le=45, description="measured against the flow, positive as the rows shift"
    )
    error_deg: float | None = Field(
        None, ge=0, le=45, description="standard error; kept with the data, not used in the fit"
    )
    note: str = Field("", max_length=200, description="what to remember of it")


class MeasurementsSpec(Section):
    """Measured angles to be learnt from, beside the outcomes of a campaign."""

    _no_flags = no_flags()

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "height_um": 20.0,
                    "mean_velocity_mm_s": 0.5,
                    "measurements": [
                        {
                            "pillar_radius_um": 7.0,
                            "gap_um": 16.0,
                            "periodicity": 6,
                            "deformation_index": 0.7,
                            "cell_radius_um": 7.5,
                            "migration_angle_deg": 5.0,
                            "error_deg": 0.3,
                        }
                    ],
                }
            ]
        }
    )

    measurements: list[Measurement] = Field(min_length=1, max_length=500)
    height_um: float = Field(ge=0.1, le=1000, description="channel height of the devices")
    mean_velocity_mm_s: float = Field(ge=1e-6, le=1000, description="mean velocity in them")
    name: str = Field("measured", max_length=80, description="shown beside every answer")
    campaign: CampaignId | None = None


# ------------------------------------------------------------------------------------------ answers


@cache
def row_model(kind: str) -> type[Answer]:
    """Model of one row of a table."""
    types = {pa.string(): str, pa.int64(): int, pa.float64(): float, pa.bool_(): bool}
    types |= {pa.list_(arrow): list[python] for arrow, python in types.items()}
    fields: dict[str, Any] = {}
    for c in COLUMNS[kind]:
        python = types[c.type]
        about = f"{c.description} [{c.unit}]" if c.unit else c.description
        fields[c.name] = (python | None if c.nullable else python, Field(description=about))
    name = "".join(word.capitalize() for word in kind.split("_"))
    return create_model(f"{name}Row", __base__=Answer, **fields)


Candidate = row_model("designs")
CellType = row_model("design_populations")
Trial = row_model("design_trials")
Tolerance = row_model("design_tolerances")
Importance = row_model("design_importance")
SlicePoint = row_model("design_slices")
VerificationRow = row_model("verifications")
VerifiedDesign = row_model("verified_designs")
DeviceOutcome = row_model("device_outcomes")
DeviceOutlet = row_model("device_outlets")
DevicePosition = row_model("device_positions")
DeviceExit = row_model("device_exits")


class Provenance(Answer):
    """Where an answer comes from."""

    dldsim_version: str
    physics_version: int
    campaign: str | None = Field(description="id of an uploaded campaign; null: the service's own")
    campaign_name: str = Field(description="in words, to be shown")
    origin: Literal["tracked", "uploaded", "measurements"]
    holds_for: str = Field(
        "", description="shapes, capillary numbers and heights that were learnt, to be shown"
    )
    outcomes: int = Field(description="rows of the table of outcomes")
    used: int = Field(description="of which learnt from")
    measured: int = Field(0, description="of which measured on fabricated devices, not simulated")
    geometries: int
    outcomes_sha256: str = Field(description="of the data learnt from, as in the model card")
    model_sha256: str
    fitted_by: dict[str, Any] = Field(description="versions that fitted the surrogate")
    scores_by_geometry: dict[str, Any] = Field(description="errors on arrays held out")
    config_hash: str | None = None
    seed: int | None = None
    warnings: list[str] = []


class Best(Answer):
    """The best feasible trial so far."""

    trial: int
    pillar_radius_um: float
    gap_um: float
    periodicity: int
    separation_deg: float
    value: float
    angle_1_deg: float
    angle_2_deg: float
    inside_training_domain: bool


class Progress(Answer):
    """How far a search is. While it runs `convergence` has one point a trial."""

    stage: Literal["queued", "search", "files", "done"] = "queued"
    trial: int = Field(0, description="trials done")
    trials: int = Field(description="trials asked for; of a grid: its points")
    best: Best | None = None
    convergence: list[float | None] = Field(
        [], description="best value after each trial; null while none is feasible"
    )
    elapsed_s: float = 0.0
    left_s: float | None = Field(
        None, description="estimated, time in the queue included; null: not known"
    )


class FileInfo(Answer):
    """One file that can be downloaded."""

    kind: Literal["json", "csv", "gds", "dxf", "report"]
    name: str
    candidate: int | None = Field(description="number of the candidate; null: report, or verified")
    verified: int | None = Field(description="number of the verified design; null: predicted")
    bytes: int
    sha256: str
    url: str


class Verdict(Answer):
    """The simulation of the best designs, in the background."""

    state: Literal["not-wanted", "waiting", "queued", "running", "done", "failed", "cancelled"]
    message: str = Field("", description="last sentence of the simulation, or why it failed")
    elapsed_s: float | None = None
    designs: list[VerifiedDesign] = []
    verifications: list[VerificationRow] = []


class AtOutlets(Answer):
    """What leaves a device; shares are medians over draws of the array with their 90 % interval."""

    device_outcomes: list[DeviceOutcome] = Field(
        description="purity, recovery, enrichment of each cell type; a device each candidate"
    )
    device_outlets: list[DeviceOutlet] = Field(description="what each outlet gets")
    device_positions: list[DevicePosition] = Field(description="places of the cells along it")
    device_exits: list[DeviceExit] = Field(description="shares across the end of the array")
    notes: list[str] = Field(description="what to know of measured cells and transients")


class DesignResult(Answer):
    """The tables of a search."""

    request: dict[str, Any] = Field(description="with the deformation indices of named sets")
    populations: list[CellType] = Field(
        [], description="both cell types: from what was measured to what acts"
    )
    designs: list[Candidate] = Field(description="ranked candidates, predicted, not simulated")
    trials: list[Trial]
    convergence: list[float | None] = Field(description="best value after each trial")
    tolerances: list[Tolerance] = Field(description="one thing off at a time, with sensitivity")
    importance: list[Importance]
    slices: list[SlicePoint] = Field(description="|| contour surfaces through the best candidate")
    at_outlets: AtOutlets | None = Field(None, description="what comes out of the candidates")
    warnings: list[str] = Field(description="sentences about extrapolation and open questions")
    seconds: dict[str, float] = Field(description="load, search, files: seconds of each part")


class DesignStatus(Answer):
    """A design job: `result` is there once `state` is done, the verdict comes later."""

    id: str
    state: Literal["queued", "running", "done", "failed", "cancelled"]
    queue_position: int | None = Field(None, description="jobs before this one; 0: next")
    created: str
    started: str | None = None
    finished: str | None = None
    attempts: int = Field(0, description="times it was begun; more than 1: after a restart")
    spec: DesignSpec
    progress: Progress
    error: str | None = Field(None, description="why it failed")
    result: DesignResult | None = None
    verification: Verdict
    files: list[FileInfo] = []
    provenance: Provenance | None = None


class Accepted(Answer):
    """A job that was taken; nothing of it is lost by a restart."""

    id: str
    state: str
    url: str
    queue_position: int


class OptimizeAnswer(Answer):
    """The best candidate of a search that was waited for."""

    id: str
    pillar_radius_um: float
    gap_um: float
    periodicity: int
    separation_deg: float
    uncertainty_deg: float
    angle_1_deg: float
    angle_2_deg: float
    mode_1: str
    mode_2: str
    verdict: str
    notes: list[str]
    convergence: list[float | None]
    importance: list[Importance]
    seconds: float
    url: str = Field(description="of the complete result")
    provenance: Provenance


class Prediction(Answer):
    """Predicted angle of one cell type in one array."""

    angle_deg: float
    low_deg: float
    high_deg: float
    level: float
    mode: str
    bump_angle_deg: float
    sigma_num_deg: float | None
    inside_domain: bool
    distance_outside: float | None = Field(
        description="from the training geometries, in units of their range; null: not measurable"
    )
    cell: CellType | None = Field(None, description="from what was measured to what acts")
    warnings: list[str]
    provenance: Provenance


class OutcomeAnswer(AtOutlets):
    """Purity and recovery of two populations at the outlets of one device."""

    request: dict[str, Any] = Field(description="both cell types, with what measured cells gave")
    device: dict[str, Any] = Field(description="the device that was looked at")
    populations: list[CellType] = Field(description="from what was measured to what acts")
    doubt: str = Field(description="said first: the assay does not tell the cell types apart")
    warnings: list[str]
    provenance: Provenance


class StiffnessAnswer(Answer):
    """Moduli of a cell with the measured deformation index; low to high is the interval."""

    deformation_index: float
    error: float
    ks_uN_per_m: float
    ks_uN_per_m_low: float
    ks_uN_per_m_high: float
    kal_uN_per_m: float
    kal_uN_per_m_low: float
    kal_uN_per_m_high: float
    kb_pN_um: float
    kb_pN_um_low: float
    kb_pN_um_high: float
    velocity_mm_s: float | None
    shear_stress_Pa: float | None
    between: list[str]
    assay: str
    index: str | None = Field(description="what the index is")
    label: str | None = Field(description="where it comes from, if not from simulations")
    cell_shape: str | None
    cell_radius_um: float | None
    truncated: bool = Field(description="the interval reaches the end of the calibrated range")
    provenance: Provenance


class ColumnInfo(Answer):
    name: str
    type: str
    unit: str
    description: str
    nullable: bool


class Table(Answer):
    """A table of the campaign."""

    kind: str
    columns: list[ColumnInfo]
    rows: list[dict[str, Any]]
    provenance: Provenance


class FieldLimit(Answer):
    """What a form needs to know of one field of a request."""

    name: str
    minimum: float | None
    exclusive_minimum: bool
    maximum: float | None
    default: Any
    unit: str
    description: str
    choices: list[str] | None = None


class CalibratedSet(Answer):
    stiffness_set: str
    deformation_index: float
    deformation_index_std: float | None


class ModelInfo(Answer):
    """The surrogate: its card, where it holds, and what may be asked of it."""

    card: dict[str, Any]
    deformation_index_range: tuple[float, float] = Field(
        description="of the campaign's own assay; 0 to 1 without a calibration"
    )
    domain: dict[str, Any] = Field(
        description="`shapes`: of each shape `geometries` (P_r/R, P_g/R, N_p), in whose hull the "
        "surrogate interpolates, and ranges; `geometries`: of the campaign's own shape; `arrays`: "
        "(P_r, P_g, N_p) of the campaign in µm"
    )
    calibrated_range: dict[str, tuple[float, float]] = Field(description="by assay")
    stiffness_sets: list[CalibratedSet]
    flow: dict[str, Any]
    cell: dict[str, Any]
    device: dict[str, Any]
    safety_distance_um: float
    fields: list[FieldLimit] = Field(description="of a design request, with the service's limits")
    limits: dict[str, int | float] = Field(description="of this service")
    provenance: Provenance


class CampaignStatus(Answer):
    """An uploaded campaign, or measurements beside one; usable once `state` is ready."""

    id: str
    state: Literal["queued", "fitting", "ready", "failed", "cancelled"]
    name: str
    origin: Literal["uploaded", "measurements"]
    created: str
    rows: int
    found: list[str] = Field([], description="what the tables were read with: separators, commas")
    error: str | None = None
    card: dict[str, Any] | None = None
    provenance: Provenance | None = None
    url: str


class Health(Answer):
    """Whether the service can answer, and if not, why."""

    status: Literal["healthy", "unhealthy"]
    problems: list[str]
    version: str
    campaign: str | None = Field(description="the campaign that answers come from")
    workers: dict[str, int] = Field(description="processes alive, by kind of work")
    queued: int
    running: int
    uptime_s: float


def limits_of(model: type[BaseModel]) -> list[FieldLimit]:
    """Ranges, units, defaults and meanings of the fields of a request."""
    units = {"_um": "µm", "_deg": "°", "_kPa": "kPa", "_mm_s": "mm/s", "_uN_per_m": "µN/m"}
    units |= {"_mm": "mm", "_mm2": "mm²", "_uL_per_h": "µL/h"}
    found = []
    for name, field in model.model_fields.items():
        schema = model.model_json_schema()["properties"][name]
        parts = [schema, *schema.get("anyOf", []), *schema.get("prefixItems", [])]
        at = {
            key: part[key]
            for part in reversed(parts)
            for key in ("minimum", "exclusiveMinimum", "maximum")
            if key in part
        }
        most = min(filter(None, (at.get("maximum"), LARGEST.get(name))), default=None)
        low = SMALLEST.get(name, at.get("minimum", at.get("exclusiveMinimum")))
        default = None if field.is_required() else field.default
        stem = name[:-2] if name[-2:] in ("_1", "_2") else name
        found.append(
            FieldLimit(
                name=name,
                minimum=low,
                maximum=most,
                exclusive_minimum="exclusiveMinimum" in at and name not in SMALLEST,
                default=default,
                description=field.description or "",
                unit=next((u for end, u in units.items() if stem.endswith(end)), ""),
                choices=schema.get("enum"),
            )
        )
    return found


def finite(value: Any) -> Any:
    """The value with numbers that JSON cannot carry as None."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: finite(v) for key, v in value.items()}
    if isinstance(value, list | tuple):
        return [finite(v) for v in value]
    return value
