"""What the service is asked of a device or a cascade: bodies of `/outcome` and `/checks`."""

from typing import Annotated, Any

from pydantic import ConfigDict, Field, model_validator

from dldsim.app.web.api.ranges import LARGEST, in_range, no_flags
from dldsim.app.web.api.specs import SEED_MAX, SETS_LENGTH, CampaignId, MeasuredCells
from dldsim.config.design_sections import CellTypes, DesignRequest, Device
from dldsim.config.sections import Section, Unfit
from dldsim.vocabulary import GEOMETRY

DRAWS_MAX = 131_072
"""Draws of the array times cells of an outcome that is waited for."""
SIMULATED_MAX = 200
"""Cells of a simulated check: about half an hour of one process."""
DEVICE = (
    "array_length_mm",
    "array_width_mm",
    "sample_position_mm",
    "sample_width_um",
    "outlets",
    "outlet_walls_um",
)
"""Settings of the device that a request may change."""
CELLS = {
    "stiffness_set_1": "3",
    "radius_1_um": 4.5,
    "radius_cv_1": 0.05,
    "stiffness_set_2": "3",
    "radius_2_um": 7.5,
    "radius_std_2_um": 0.4,
}
ARRAY = {"pillar_radius_um": 9.0, "gap_um": 12.0, "periodicity": 10}
"""Cells and array of the examples."""


def _of_device(name: str) -> Any:
    field = Device.model_fields[name]
    text = field.description.partition("; default")[0]
    return Field(None, description=f"{text}; left out: the service's device")


Wall = Annotated[float, Field(gt=0, le=1e5)]
Millimetres = Annotated[float, Field(ge=0.01, le=100)]


class DeviceSpec(Section):
    """An array, and what of its device differs from the service's."""

    _no_flags = no_flags()

    pillar_radius_um: float = Field(ge=0.1, le=100, description="pillar radius P_r")
    gap_um: float = Field(ge=0.1, le=200, description="gap P_g between pillar surfaces")
    periodicity: int = Field(ge=2, le=100, description="rows N_p after which the array repeats")
    array_length_mm: Millimetres | None = _of_device("array_length_mm")
    array_width_mm: Millimetres | None = _of_device("array_width_mm")
    sample_position_mm: Millimetres | None = _of_device("sample_position_mm")
    sample_width_um: Annotated[float, Field(ge=0.1, le=1e5)] | None = _of_device("sample_width_um")
    outlets: Annotated[int, Field(ge=2, le=20)] | None = _of_device("outlets")
    outlet_walls_um: Annotated[list[Wall], Field(min_length=1, max_length=19)] | None = _of_device(
        "outlet_walls_um"
    )

    @property
    def geometry(self) -> dict[str, Any]:
        return self.model_dump(include=set(GEOMETRY))

    @property
    def device(self) -> dict[str, Any]:
        """What is given of the device."""
        return self.model_dump(include=set(DEVICE), exclude_none=True)


class CellsInDevice(MeasuredCells, CellTypes, DeviceSpec):
    """Two cell types and one device."""

    _no_flags = no_flags()
    _in_range = in_range(*(name for name in LARGEST if name in CellTypes.model_fields))

    stiffness_set_1: str | None = Field(
        None, max_length=SETS_LENGTH, description="instead of deformation_index_1"
    )
    stiffness_set_2: str | None = Field(
        None, max_length=SETS_LENGTH, description="instead of deformation_index_2"
    )
    tolerance_um: float = Field(0.5, ge=0, le=10, description="fabrication: ± on P_r and P_g")
    seed: int = Field(1, ge=0, le=SEED_MAX, description="seed of everything random")
    campaign: CampaignId | None = None

    @model_validator(mode="after")
    def _within_seconds(self) -> "CellsInDevice":
        if self.outlet_draws * self.cells > DRAWS_MAX:
            raise Unfit(
                f"draws times cells at most {DRAWS_MAX:,}, not {self.outlet_draws * self.cells:,}",
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
    def devices(self) -> list[DeviceSpec]:
        """The devices that the cells go through."""
        return [self]


class OutcomeSpec(CellsInDevice):
    """Two cell types, and a device or a cascade of two: the options of
    `python -m dldsim outcome`."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                ARRAY | CELLS,
                ARRAY | CELLS | {"then": ARRAY | {"periodicity": 6}, "from_outlet": 2},
            ]
        }
    )

    then: DeviceSpec | None = Field(
        None, description="a second device, which an outlet of the first feeds"
    )
    from_outlet: Annotated[int, Field(ge=1, le=20)] | None = Field(
        None, description="that outlet of the first device, counted from the lower side wall"
    )

    @model_validator(mode="after")
    def _cascade(self) -> "OutcomeSpec":
        if (self.then is None) != (self.from_outlet is None):
            raise Unfit(
                "then and from_outlet go together: a second device, and the outlet of the first "
                "that feeds it",
                "then",
                "from_outlet",
            )
        return self

    @property
    def devices(self) -> list[DeviceSpec]:
        return [self] if self.then is None else [self, self.then]


class CheckSpec(CellsInDevice):
    """Two cell types and one array, in which drawn cells are simulated."""

    model_config = ConfigDict(json_schema_extra={"examples": [ARRAY | CELLS | {"simulate": 40}]})

    simulate: int = Field(
        40,
        ge=2,
        le=SIMULATED_MAX,
        description="cells to simulate in the nominal array, half of each type",
    )
