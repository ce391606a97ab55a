"""What the service answers: bodies of the answers of /api/v1.

Rows of tables are those of :mod:`dldsim.tables.parquet`, column by column. In answers null means
"not known" or "not measured", as in the tables.
"""

import math
from functools import cache
from typing import Any, Literal

import pyarrow as pa
from pydantic import BaseModel, ConfigDict, Field, create_model

from dldsim.app.web.api.field_limits import FieldLimit
from dldsim.app.web.api.outcome_specs import CheckSpec
from dldsim.app.web.api.specs import DesignSpec
from dldsim.tables.registry import COLUMNS


class Answer(BaseModel):
    """Base of answers."""

    model_config = ConfigDict(protected_namespaces=())


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
DeviceCheck = row_model("device_checks")
CheckedCell = row_model("checked_cells")


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
    """Purity and recovery of two populations at the outlets of a device, or of both of a
    cascade."""

    request: dict[str, Any] = Field(description="both cell types, with what measured cells gave")
    device: dict[str, Any] = Field(description="the device that was looked at, the first of two")
    then: dict[str, Any] | None = Field(None, description="the second device of a cascade")
    populations: list[CellType] = Field(description="from what was measured to what acts")
    doubt: str = Field(description="said first: the assay does not tell the cell types apart")
    warnings: list[str]
    provenance: Provenance


class CheckAnswer(OutcomeAnswer):
    """An outcome, and simulated cells beside it."""

    device_checks: list[DeviceCheck] = Field(
        description="of each cell type: predicted and simulated recovery, and whether they agree"
    )
    checked_cells: list[CheckedCell] = Field(description="the simulated cells")


class CheckStatus(Answer):
    """A simulated check: `result` is there once `state` is done."""

    id: str
    state: Literal["queued", "running", "done", "failed", "cancelled"]
    queue_position: int | None = Field(None, description="jobs before this one; 0: next")
    created: str
    started: str | None = None
    finished: str | None = None
    attempts: int = Field(0, description="times it was begun; cells that were finished are kept")
    spec: CheckSpec
    message: str = Field("", description="how far it is: last sentence of the simulation")
    elapsed_s: float | None = Field(None, description="since it was begun last")
    error: str | None = Field(None, description="why it failed")
    result: CheckAnswer | None = None


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


def finite(value: Any) -> Any:
    """The value with numbers that JSON cannot carry as None."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: finite(v) for key, v in value.items()}
    if isinstance(value, list | tuple):
        return [finite(v) for v in value]
    return value
