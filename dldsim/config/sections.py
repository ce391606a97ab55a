"""Typed, validated settings of a simulation: every setting's type, range and meaning.

Lengths are in µm, velocities in mm/s, viscosity in mPa·s, surface moduli in µN/m.
"""

import math
import typing
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    StringConstraints,
    ValidationInfo,
    field_validator,
    model_validator,
)


class Unfit(ValueError):
    """Settings that are valid alone and not together, with the keys of those that are at fault."""

    def __init__(self, text: str, *keys: str):
        super().__init__(text)
        self.keys = keys


class Section(BaseModel):
    """Base of all sections: immutable, an unknown key is an error, and true is no number."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, coerce_numbers_to_str=True
    )

    @field_validator("*", mode="before")
    @classmethod
    def _true_is_no_number(cls, value: Any, info: ValidationInfo) -> Any:
        assert info.field_name is not None  # it has one, since it validates fields
        if _holds_flag(value) and bool not in _parts(cls.model_fields[info.field_name].annotation):
            raise ValueError("no true or false")
        if _holds_underscore(value) and str not in _parts(
            cls.model_fields[info.field_name].annotation
        ):
            raise ValueError("in plain digits")
        return value


def _holds_flag(value: Any) -> bool:
    return isinstance(value, bool) or (
        isinstance(value, list | tuple) and any(_holds_flag(entry) for entry in value)
    )


def _holds_underscore(value: Any) -> bool:
    """Whether this is a text such as 1_000, or holds one: Python reads it as a number."""
    return (isinstance(value, str) and "_" in value) or (
        isinstance(value, list | tuple) and any(_holds_underscore(entry) for entry in value)
    )


def _parts(annotation: Any) -> set:
    """All types that an annotation is made of."""
    inner = typing.get_args(annotation)
    if typing.get_origin(annotation) is typing.Literal:
        return {type(choice) for choice in inner}
    return {annotation}.union(*(_parts(part) for part in inner)) if inner else {annotation}


Periodicity = Annotated[int, Field(ge=2, le=100)]


class Geometry(Section):
    """One array of round pillars on a row-shifted lattice."""

    pillar_radius_um: float = Field(gt=0, le=1000, description="pillar radius P_r")
    gap_um: float = Field(gt=0, le=1000, description="gap P_g between neighbouring pillar surfaces")
    periodicity: int = Field(ge=2, le=100, description="rows N_p after which the array repeats")

    @property
    def pitch_um(self) -> float:
        """Centre-to-centre distance λ = 2 P_r + P_g [µm]."""
        return 2 * self.pillar_radius_um + self.gap_um

    @property
    def row_shift_fraction(self) -> float:
        """Row shift as a fraction ε = 1/N_p of the pitch."""
        return 1 / self.periodicity


class Stiffness(Section):
    """Elastic and viscous coefficients of one membrane; a zero removes its term."""

    ks_uN_per_m: float = Field(ge=0, le=1e6, description="edge spring constant k_s")
    kb_pN_um: float = Field(ge=0, le=1e6, description="dihedral bending constant k_b, an energy")
    kal_uN_per_m: float = Field(ge=0, le=1e6, description="local area constant k_α")
    kag_uN_per_m: float = Field(ge=0, le=1e8, description="global area constant k_ag")
    kv_Pa: float = Field(ge=0, le=1e10, description="volume constant k_v, a pressure")
    kvisc_nN_s_per_m: float = Field(ge=0, le=1e6, description="Kelvin–Voigt edge dashpot k_visc")


Shape = Literal["biconcave", "sphere", "ellipsoid"]


class CellShape(Section):
    """Shape at rest of the cell, and how it is turned at release."""

    shape: Shape = Field("biconcave", description="rest shape; biconcave is the Evans–Fung profile")
    radius_um: float = Field(7.5, ge=0.1, le=1000, description="largest radius of the rest shape")
    aspect_ratio: float = Field(
        0.6, ge=0.05, le=1, description="ellipsoid only: half axis along the symmetry axis / radius"
    )
    axis: Literal["x", "y", "z"] = Field(
        "y", description="direction of the symmetry axis at release (x along the flow, z height)"
    )


class Cell(CellShape):
    """A cell with the place at which one run releases it."""

    release_gap_fraction: float = Field(
        0.5,
        ge=0,
        le=1,
        description="height of the centre above the lower pillar of its gap at release / P_g",
    )


class Flow(Section):
    """The carrying liquid and what drives it."""

    mean_velocity_mm_s: float = Field(
        0.5, ge=1e-5, le=1000, description="mean velocity over the unit cell, x"
    )
    viscosity_mPa_s: float = Field(
        1.5, ge=0.01, le=1e6, description="dynamic viscosity, inside and outside"
    )
    height_um: float = Field(
        20.0, ge=0, le=1000, description="channel height; 0 is the 2D limit (no walls)"
    )
    drive: Literal["no-lateral-flux", "axial"] = Field(
        "no-lateral-flux", description="body force direction: mean flow along x, or force along x"
    )


class Numerics(Section):
    """How the equations are solved."""

    spacing_um: float = Field(1.25, ge=0.01, le=100, description="largest lattice spacing wanted")
    velocity_lu: float = Field(
        0.025,
        ge=1e-6,
        le=0.1,
        description="mean velocity in lattice units wanted; lower where the step is shortened",
    )
    relaxation_time: float = Field(3.0, ge=0.501, le=3, description="τ of the shear stress")
    reynolds_max: float = Field(
        0.15,
        ge=1e-6,
        le=100,
        description="largest numerical Reynolds number U 2R/ν, the fluid's lag behind the cell; "
        "time_step automatic keeps it",
    )
    collision: Literal["trt", "bgk"] = Field("trt", description="collision operator")
    inertia: Literal["stokes", "navier-stokes"] = Field(
        "stokes", description="equilibrium without or with the quadratic (convective) term"
    )
    precision: Literal["float32", "float64"] = Field(
        "float32", description="floating-point type of the populations"
    )
    bounce_back: Literal["half-way", "interpolated"] = Field(
        "interpolated", description="treatment of the pillar surface"
    )
    half_scene: bool = Field(
        True, description="compute half of the height between plates and mirror the rest"
    )
    rows: int = Field(1, ge=1, le=100, description="pillar rows in the domain (1 … N_p)")
    lanes: int = Field(2, ge=1, le=20, description="pillars per row in the domain")
    images: Literal["aligned", "dilute"] = Field(
        "dilute",
        description="periodic images of the cell: with the mean flux held; or without what they do "
        "to the mean flow, as of one cell in an endless array",
    )
    coupling: Literal["no-slip", "dissipative"] = Field(
        "no-slip", description="how membrane and fluid are tied"
    )
    time_step: Literal["automatic", "as-given"] = Field(
        "automatic",
        description="automatic: shorter than velocity_lu gives where the membrane needs it",
    )
    kernel: Literal["compact", "linear", "3-point", "4-point"] = Field(
        "compact", description="immersed-boundary kernel"
    )
    edge_to_spacing: float = Field(
        1.0, ge=0.3, le=2, description="mean membrane edge / lattice spacing wanted"
    )
    friction_nN_s_per_m: float = Field(
        1.56,
        ge=1e-4,
        le=1e4,
        description="dissipative coupling only: γ per vertex of the reference mesh",
    )
    contact_range_um: float = Field(
        0.5, ge=0, le=100, description="reach r_c of the contact repulsion"
    )
    area_forces: Literal["to-centroid", "gradient"] = Field(
        "to-centroid",
        description="of the area terms on a face's vertices: towards its centroid, as in the "
        "source, which resists shear; or along the gradient of its area",
    )

    @property
    def staggered(self) -> bool:
        """Whether images ahead are half of the lanes aside, where that keeps them farther off."""
        return self.images == "dilute" and self.lanes % 2 == 0 and self.lanes > self.rows


def thousandths(value: float) -> float:
    """Refuse a length that run ids cannot carry."""
    if not math.isclose(value, round(value, 3), rel_tol=0, abs_tol=1e-9):
        raise ValueError("at most three decimals (run ids carry no more)")
    return round(value, 3)


Place = Annotated[float, Field(ge=0, le=1), AfterValidator(thousandths)]


def distinct(places: list[float]) -> list[float]:
    """Refuse a place of release that is named twice."""
    if len(set(places)) < len(places):
        raise ValueError("each place once")
    return places


Places = Annotated[list[Place], Field(min_length=1), AfterValidator(distinct)]


class RunControl(Section):
    """Where runs begin, when they record and when they stop."""

    max_rows: int = Field(
        40, ge=2, le=10_000, description="most rows that a cell is followed from a release"
    )
    min_rows: int = Field(
        0, ge=0, le=10_000, description="least rows that a cell is followed, settled or not"
    )
    orbit_tolerance: float = Field(
        0.03,
        gt=0,
        lt=1,
        description="resolution of a lateral position / row shift: an orbit that returns within it "
        "repeats",
    )
    still_rows: int = Field(
        8,
        ge=2,
        le=1000,
        description="rows that a cell rests in a bump lane that is not deep until it counts as "
        "settled",
    )
    mean_tolerance: float = Field(
        0.1,
        gt=0,
        lt=1,
        description="half-width of the 95 % interval of the mean lateral step / row shift with "
        "which a motion without orbit counts as settled",
    )
    capture_chance_max: float = Field(
        0.002,
        gt=0,
        lt=1,
        description="chance per row of another motion below which that is excluded",
    )
    records_per_row: int = Field(20, ge=4, le=1000, description="trajectory samples per row")
    release_gap_fractions: Places = Field(
        [0.5, 0.2, 0.8],
        description="places of release of an outcome in the order of use, height of the centre "
        "above the lower pillar of its gap / P_g; 0.5 is the source's",
    )
    outcome_rows_max: int = Field(
        120,
        ge=2,
        le=100_000,
        description="most rows over all releases of an outcome; then it is undecided",
    )

    @model_validator(mode="after")
    def _least_rows_within_most(self) -> "RunControl":
        if self.min_rows > self.max_rows:
            raise Unfit("min_rows at most max_rows", "min_rows", "max_rows")
        return self


class Constriction(Section):
    """Channel with a slit throat in which the deformation index is measured."""

    spacing_um: float = Field(1.0, ge=0.01, le=100, description="largest lattice spacing wanted")
    width_um: float = Field(30.0, gt=0, le=1000, description="channel width away from the throat")
    throat_width_um: float = Field(8.0, gt=0, le=1000, description="width of the throat")
    throat_length_um: float = Field(40.0, gt=0, le=1000, description="length of the throat")
    taper_length_um: float = Field(10.0, ge=0, le=1000, description="length of each taper")
    approach_length_um: float = Field(26.0, gt=0, le=1000, description="straight part on each side")
    height_um: float = Field(12.0, gt=0, le=1000, description="channel height")
    axis: Literal["x", "y", "z"] = Field(
        "z", description="direction of the cell's symmetry axis at release (z: seen face on)"
    )
    release_positions_um: list[Annotated[float, Field(ge=0, le=1000)]] = Field(
        [0.0, 3.0, 6.0, 9.0],
        min_length=1,
        description="streamwise positions of release, from the first possible one",
    )


class ConstrictionGroup(Section):
    """One stiffness group of the calibration with its mean velocity in the channel."""

    stiffness: Stiffness
    velocity_mm_s: float = Field(ge=1e-5, le=1000, description="mean velocity in the wide channel")
    stiffness_set: str | None = Field(
        None, description="name of the campaign stiffness set that this group calibrates"
    )


Length = Annotated[float, Field(gt=0, lt=1000), AfterValidator(thousandths)]
Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9-]+$", max_length=64)]
Fraction = Annotated[float, Field(ge=0, le=1)]
CELL_NUMERICS = {
    "coupling",
    "time_step",
    "reynolds_max",
    "kernel",
    "edge_to_spacing",
    "friction_nN_s_per_m",
    "contact_range_um",
    "area_forces",
}
"""The numerics that a flow without cell does not depend on."""
