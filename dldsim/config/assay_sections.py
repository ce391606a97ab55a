"""Assays: named ways to measure how deformable a cell is, as sections of the configuration."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from dldsim.config.sections import Constriction, Name, Section, Unfit

Shape = Literal["biconcave", "sphere"]
Axis = Literal["x", "y", "z"]
Radius = Annotated[float, Field(ge=0.1, le=1000)]
Velocity = Annotated[float, Field(ge=1e-5, le=1000)]
Index = Annotated[float, Field(ge=0, lt=1)]
Spacing = Field(1.0, ge=0.01, le=100, description="largest lattice spacing wanted")
GROUP_VELOCITY, FIXED_VELOCITY = "group-velocity", "fixed-velocity"
"""Assays of the source's slit: each group at its own velocity (the source paper's), all at one."""
CIRCULARITY = "-circularity"
"""Ending of the name of the curve of a channel whose index is 1 − circularity."""
SOURCE_TABLE = "source-table"
"""Assay of the source's printed indices."""


class AssayCell(Section):
    """A cell at rest that an assay is calibrated for."""

    shape: Shape = Field("biconcave", description="rest shape")
    radius_um: Radius = Field(7.5, description="largest radius of the rest shape")


class Simulated(Section):
    """What all simulated assays have.

    A passage differs from the first in one thing at a time: place of release, size or orientation.
    The scatter over them is that of the calibration.
    """

    viscosity_mPa_s: float | None = Field(
        None, ge=0.01, le=1e6, description="of the liquid in the assay; null: the campaign's"
    )
    cells: list[AssayCell] = Field(
        [], description="cells that are calibrated; none: the campaign's cell"
    )
    between: int = Field(
        0, ge=0, le=20, description="membranes between neighbouring sets, in equal ratios of k_s"
    )
    radius_factors: list[Annotated[float, Field(gt=0.5, lt=2)]] = Field(
        [], description="sizes of further passages / radius_um"
    )
    other_axes: list[Axis] = Field(
        [], description="orientations of further passages, for cells that are not round"
    )


class Offsets(Section):
    """Places of release off the axis."""

    offsets_um: list[Annotated[float, Field(gt=0, le=1000)]] = Field(
        [], description="release of further passages off the axis, across the picture"
    )


class ConstrictionAssay(Offsets, Simulated):
    """Passage of a slit throat, index with the centre in its middle."""

    kind: Literal["constriction"]
    channel: Constriction | None = Field(
        None, description="the channel; null: the section constriction, the source's"
    )
    groups: bool = Field(
        False, description="the membranes are constriction_groups, not stiffness_sets"
    )
    velocity_mm_s: Velocity | None = Field(
        None, description="mean velocity in the wide channel; null: each group's own"
    )

    @model_validator(mode="after")
    def _some_velocity(self) -> "ConstrictionAssay":
        if self.velocity_mm_s is None and not self.groups:
            raise Unfit("a velocity, unless groups: true brings theirs", "velocity_mm_s")
        if self.groups and self.between:
            raise Unfit("groups or membranes between stiffness sets, not both", "between")
        return self

    @property
    def slit(self) -> Constriction:
        """The channel, once it is in place (`assays.assay_of`)."""
        assert self.channel is not None
        return self.channel

    @property
    def axis(self) -> Axis:
        return self.slit.axis


class ChannelAssay(Offsets, Simulated):
    """Straight rectangular channel, index of the shape that has become steady."""

    kind: Literal["channel"]
    spacing_um: float = Spacing
    width_um: float = Field(20.0, gt=0, le=1000, description="channel width, in the picture")
    height_um: float = Field(20.0, gt=0, le=1000, description="channel height, along the view")
    period_um: float = Field(40.0, gt=0, le=1000, description="distance of the next cell")
    velocity_mm_s: Velocity | None = Field(None, description="mean velocity over the section")
    flow_rate_nl_per_s: float | None = Field(
        None, gt=0, le=1e6, description="instead of velocity_mm_s"
    )
    axis: Axis = Field("x", description="direction of the cell's symmetry axis at release")
    steady_change: float = Field(
        0.003, gt=0, lt=1, description="change of the index over a travel of 4 R that is steady"
    )
    travel_max_um: float = Field(
        600.0, gt=0, le=1e5, description="mean flow's travel after which a shape is not steady"
    )

    @model_validator(mode="after")
    def _one_velocity(self) -> "ChannelAssay":
        if (self.velocity_mm_s is None) == (self.flow_rate_nl_per_s is None):
            keys = "velocity_mm_s", "flow_rate_nl_per_s"
            raise Unfit("exactly one of velocity_mm_s and flow_rate_nl_per_s", *keys)
        return self

    @property
    def mean_velocity_mm_s(self) -> float:
        """Mean velocity over the section; 1 nl/s through 1 µm² is 1 m/s."""
        if self.flow_rate_nl_per_s is None:
            assert self.velocity_mm_s is not None
            return self.velocity_mm_s
        return 1e3 * self.flow_rate_nl_per_s / (self.width_um * self.height_um)


class ShearAssay(Simulated):
    """Simple shear between moving plates, elongation seen along the velocity gradient."""

    kind: Literal["shear"]
    stress_Pa: float = Field(ge=1e-4, le=1e4, description="shear stress of the liquid")
    nodes_per_radius: int = Field(5, ge=4, le=50, description="radius of the cell / spacing")
    axis: Axis = Field("z", description="direction of the cell's symmetry axis at release")
    strain_window: float = Field(
        10.0, gt=0, le=1e4, description="strain over which is averaged; a disc turns in 21"
    )
    steady_change: float = Field(
        0.006, gt=0, lt=1, description="change of the mean index between windows that is steady"
    )
    strain_max: float = Field(80.0, gt=0, le=1e5, description="strain after which it is not steady")


class TableAssay(Section):
    """Published pairs of index and stiffness set, used as read."""

    kind: Literal["table"]
    indices: dict[str, Index] = Field(min_length=2, description="index by stiffness set")
    error: float = Field(0.0, ge=0, lt=1, description="standard error of each index")
    label: str = Field(
        "read from a publication, not reproduced here", description="shown with every answer"
    )


SimulatedAssay = ConstrictionAssay | ChannelAssay | ShearAssay


def _kind(assay: Any) -> Any:
    """What an assay, or its settings, says of its kind."""
    return assay.get("kind") if isinstance(assay, Mapping) else getattr(assay, "kind", None)


Assay = Annotated[
    Annotated[ConstrictionAssay, Tag("constriction")]
    | Annotated[ChannelAssay, Tag("channel")]
    | Annotated[ShearAssay, Tag("shear")]
    | Annotated[TableAssay, Tag("table")],
    Discriminator(_kind),
]


class CalibrationLibrary(Section):
    """Cells for which assays are calibrated beyond the campaign's own: `calibration_library`."""

    assays: list[Name] = Field([], description="names from assays")
    cells: list[AssayCell] = Field([], description="cells at rest that all of them measure")


class AssayStudy(Section):
    """Ways of measuring that are compared, to see what they resolve: `assay_study`."""

    of_campaign: list[Name] = Field([], description="names from assays that are compared too")
    assays: dict[Name, Assay] = Field({}, description="ways of measuring by name")
    cells: list[AssayCell] = Field([], description="cells at rest that all of them measure")
