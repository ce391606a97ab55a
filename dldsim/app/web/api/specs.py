"""What the service is asked: bodies of the requests of /api/v1."""

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, model_validator

from dldsim.app.asked import Both, check_measured, with_measured
from dldsim.app.web.api.ranges import LARGEST, in_range, no_flags
from dldsim.config.design_sections import DesignRequest, Spring, check_cell_type
from dldsim.config.sections import Fraction, Name, Section, Shape, Unfit
from dldsim.design.measured_cells import Measured, read_measured
from dldsim.design.populations import Asked
from dldsim.errors import DldsimError

SETS_LENGTH = 64
CSV_LENGTH = 100_000
"""Characters of a table of measured cells: some ten thousand cells."""
SEED_MAX = 2**31 - 1
CELL_TYPE = ("deformation_index", "stiffness_set", "ks_uN_per_m", "rigid")
"""Fields of a single cell type of which a request names one."""
UUID = r"^[0-9a-f]{8}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{12}$"
CampaignId = Annotated[
    str,
    Field(
        pattern=UUID,
        description="a campaign of POST /campaigns or /measurements; left out: the service's own",
    ),
]


def _measured_csv(i: int) -> Any:
    return Field(
        None,
        strict=True,
        max_length=CSV_LENGTH,
        description=f"measured cells of type {i}, the text of a CSV table with a column radius_um "
        "and, where it was measured, deformation_index or ks_uN_per_m; mean and spread follow from "
        "them, and another one beside them is refused",
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
            measured = _read_both(values)
        except DldsimError as error:
            raise Unfit(str(error), _csv_at_fault(values)) from error
        try:
            check_measured(values, measured)
        except DldsimError as error:
            raise Unfit(str(error), *error.keys) from error
        return with_measured(values, measured)

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
                    "deformation_index": 0.08,
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
    height_um: Annotated[float, Field(ge=0.1, le=1000)] | None = Field(
        None, description="channel height; default: the campaign's"
    )
    level: float = Field(0.9, ge=0.5, le=0.99, description="level of the prediction interval")
    campaign: CampaignId | None = None

    @model_validator(mode="after")
    def _one_name(self) -> "PredictSpec":
        check_cell_type(self, CELL_TYPE, "cell_shape", "deformation_index_std")
        return self

    @property
    def asked(self) -> Asked:
        """The cell type, with the names that its fields have here."""
        return Asked(
            self.cell_shape,
            self.cell_radius_um,
            self.deformation_index,
            self.deformation_index_std or 0.0,
            self.stiffness_set,
            self.ks_uN_per_m,
            self.rigid,
            (*CELL_TYPE, "cell_shape", "cell_radius_um"),
        )


class StiffnessSpec(Section):
    """A measured deformation index."""

    _no_flags = no_flags()

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"deformation_index": 0.08, "error": 0.005}]}
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
                            "deformation_index": 0.08,
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
