"""Typed, validated configuration: the single source of every setting's type, range and meaning.

Lengths are in µm, velocities in mm/s, viscosity in mPa·s, surface moduli in µN/m.
"""

import difflib
import math
import types
import typing
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    StringConstraints,
    TypeAdapter,
    ValidationError,
    field_validator,
    model_validator,
)

from dldsim.errors import DldsimError


class Section(BaseModel):
    """Base of all sections: immutable, and an unknown key is an error."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, coerce_numbers_to_str=True
    )


class Geometry(Section):
    """One array of round pillars on a row-shifted lattice."""

    pillar_radius_um: float = Field(gt=0, description="pillar radius P_r")
    gap_um: float = Field(gt=0, description="gap P_g between neighbouring pillar surfaces")
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

    ks_uN_per_m: float = Field(ge=0, description="edge spring constant k_s")
    kb_pN_um: float = Field(ge=0, description="dihedral bending constant k_b, an energy")
    kal_uN_per_m: float = Field(ge=0, description="local area constant k_α")
    kag_uN_per_m: float = Field(ge=0, description="global area constant k_ag")
    kv_Pa: float = Field(ge=0, description="volume constant k_v, a pressure")
    kvisc_nN_s_per_m: float = Field(ge=0, description="Kelvin–Voigt edge dashpot k_visc")


class CellShape(Section):
    """Shape at rest of the cell, and how it is turned at release."""

    shape: Literal["biconcave", "sphere", "ellipsoid"] = Field(
        "biconcave", description="rest shape; biconcave is the Evans–Fung profile"
    )
    radius_um: float = Field(7.5, gt=0, description="largest radius of the rest shape")
    aspect_ratio: float = Field(
        0.6, gt=0, le=1, description="ellipsoid only: half axis along the symmetry axis / radius"
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

    mean_velocity_mm_s: float = Field(0.5, gt=0, description="mean velocity over the unit cell, x")
    viscosity_mPa_s: float = Field(1.5, gt=0, description="dynamic viscosity, inside and outside")
    height_um: float = Field(20.0, ge=0, description="channel height; 0 is the 2D limit (no walls)")
    drive: Literal["no-lateral-flux", "axial"] = Field(
        "no-lateral-flux",
        description="body force direction: mean flow along x, or force along x",
    )


class Numerics(Section):
    """How the equations are solved."""

    spacing_um: float = Field(1.25, gt=0, description="largest lattice spacing wanted")
    velocity_lu: float = Field(0.025, gt=0, le=0.1, description="mean velocity in lattice units")
    relaxation_time: float = Field(3.0, gt=0.5, le=3, description="τ of the shear stress")
    reynolds_max: float = Field(
        0.15,
        gt=0,
        description="largest numerical Reynolds number U 2R/ν, the fluid's lag behind the cell; "
        "time_step automatic keeps it",
    )
    collision: Literal["trt", "bgk"] = Field("trt", description="collision operator")
    inertia: Literal["stokes", "navier-stokes"] = Field(
        "stokes", description="equilibrium without or with the quadratic (convective) term"
    )
    precision: Literal["float32", "float64"] = Field("float32", description="of the populations")
    bounce_back: Literal["half-way", "interpolated"] = Field(
        "interpolated", description="treatment of the pillar surface"
    )
    half_scene: bool = Field(
        True, description="compute half of the height between plates and mirror the rest"
    )
    rows: int = Field(2, ge=1, description="pillar rows in the domain (1 … N_p)")
    lanes: int = Field(1, ge=1, description="pillars per row in the domain")
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
        1.56, gt=0, description="dissipative coupling only: γ per vertex of the reference mesh"
    )
    contact_range_um: float = Field(0.5, ge=0, description="reach r_c of the contact repulsion")


def _thousandths(value: float) -> float:
    """Refuse a length that run ids cannot carry."""
    if not math.isclose(value, round(value, 3), rel_tol=0, abs_tol=1e-9):
        raise ValueError("at most three decimals (run ids carry no more)")
    return round(value, 3)


Place = Annotated[float, Field(ge=0, le=1), AfterValidator(_thousandths)]


class RunControl(Section):
    """Where runs begin, when they record and when they stop."""

    max_rows: int = Field(50, ge=2, description="most rows that a cell is followed from a release")
    min_rows: int = Field(
        0, ge=0, description="least rows that a cell is followed, settled or not"
    )
    orbit_tolerance: float = Field(
        0.03,
        gt=0,
        lt=1,
        description="resolution of a lateral position / row shift: an orbit that returns within it "
        "repeats",
    )
    still_rows: int = Field(
        8, ge=2, description="rows that a cell rests in the bump lane until it counts as settled"
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
    records_per_row: int = Field(20, ge=4, description="trajectory samples per row")
    release_gap_fractions: list[Place] = Field(
        [0.5, 0.2, 0.8],
        min_length=1,
        description="places of release of an outcome in the order of use, height of the centre "
        "above the lower pillar of its gap / P_g; 0.5 is the source's",
    )
    outcome_rows_max: int = Field(
        100, ge=2, description="most rows over all releases of an outcome; then it is undecided"
    )

    @field_validator("release_gap_fractions")
    @classmethod
    def _distinct(cls, places: list[float]) -> list[float]:
        if len(set(places)) < len(places):
            raise ValueError("each place once")
        return places


class Constriction(Section):
    """Channel with a slit throat in which the deformation index is measured."""

    spacing_um: float = Field(1.0, gt=0, description="largest lattice spacing wanted")
    width_um: float = Field(30.0, gt=0, description="channel width away from the throat")
    throat_width_um: float = Field(8.0, gt=0, description="width of the throat")
    throat_length_um: float = Field(40.0, gt=0, description="length of the throat")
    taper_length_um: float = Field(10.0, ge=0, description="length of each taper")
    approach_length_um: float = Field(26.0, gt=0, description="straight part on each side")
    height_um: float = Field(12.0, gt=0, description="channel height")
    axis: Literal["x", "y", "z"] = Field(
        "z", description="direction of the cell's symmetry axis at release (z: seen face on)"
    )
    release_positions_um: list[float] = Field(
        [0.0, 3.0, 6.0, 9.0],
        min_length=1,
        description="streamwise positions of release, from the first possible one",
    )
    fixed_velocity_mm_s: float | None = Field(
        None, gt=0, description="mean velocity of a second design, all groups at it; null: none"
    )


class ConstrictionGroup(Section):
    """One stiffness group of the calibration with its mean velocity in the channel."""

    stiffness: Stiffness
    velocity_mm_s: float = Field(gt=0, description="mean velocity in the wide channel")
    stiffness_set: str | None = Field(
        None, description="name of the campaign stiffness set that this group calibrates"
    )


class Device(Section):
    """The chip that a design's photomask draws: streams, array, outlets."""

    array_length_mm: float = Field(
        5.0, gt=0, le=100, description="length of the array; the whole rows that fit are drawn"
    )
    array_width_mm: float = Field(
        2.0, gt=0, le=100, description="width of the channel between its side walls"
    )
    inlet_length_mm: float = Field(1.0, gt=0, le=50, description="straight channel before it")
    outlet_length_mm: float = Field(1.0, gt=0, le=50, description="straight channel after it")
    sample_position_mm: float = Field(
        0.4, gt=0, description="middle of the sample stream above the lower side wall"
    )
    sample_width_um: float = Field(60.0, gt=0, description="width of the sample stream")
    divider_um: float = Field(30.0, gt=0, description="thickness of walls between streams")
    port_diameter_mm: float = Field(1.0, gt=0, le=10, description="diameter of the reservoirs")
    wall_gap_fraction: float = Field(
        0.5, gt=0, le=1, description="least gap between a pillar and a side wall / P_g"
    )
    alignment_mark_um: float = Field(200.0, gt=0, description="size of the alignment crosses")
    facet_tolerance_um: float = Field(
        0.01, gt=0, le=1, description="largest distance between circle and polygon in GDSII"
    )
    layer_channel: int = Field(1, ge=0, le=255, description="GDSII layer of the channel outline")
    layer_pillars: int = Field(2, ge=0, le=255, description="GDSII layer of the pillars")
    layer_alignment: int = Field(3, ge=0, le=255, description="GDSII layer of alignment crosses")
    layer_label: int = Field(4, ge=0, le=255, description="GDSII layer of the engraved label")
    layer_documentation: int = Field(
        10, ge=0, le=255, description="GDSII layer of expected paths and notes, not for exposure"
    )

    @model_validator(mode="after")
    def _streams_fit(self) -> "Device":
        half = self.sample_width_um / 2 + self.divider_um
        middle, width = 1e3 * self.sample_position_mm, 1e3 * self.array_width_mm
        if not half < middle < width - half:
            raise ValueError(
                f"sample_position_mm between {half / 1e3:g} and {(width - half) / 1e3:g}: the "
                "sample stream and its two dividers lie inside the channel"
            )
        layers = [value for key, value in self if key.startswith("layer_")]
        if len(set(layers)) < len(layers):
            raise ValueError("every layer_… another number")
        return self


Length = Annotated[float, Field(gt=0, lt=1000), AfterValidator(_thousandths)]
Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9-]{1,64}$")]
"""Part of file names, which may not be longer than some 255 characters."""


class Sweep(Section):
    """The geometries and stiffness sets of a campaign: every combination is one run."""

    pillar_radius_um: list[Length] = Field(min_length=1, description="pillar radii P_r")
    gap_um: list[Length] | None = Field(
        None, min_length=1, description="gaps P_g, combined with every radius"
    )
    gap_minus_radius_um: float | None = Field(
        None, gt=0, description="instead of gap_um: one gap P_g = P_r + this for each radius"
    )
    periodicity: list[Annotated[int, Field(ge=2, le=100)]] = Field(
        min_length=1, description="periodicities N_p"
    )
    stiffness_sets: list[str] = Field(min_length=1, description="names from stiffness_sets")
    safety_distance_um: float = Field(
        2.0, ge=0, description="d_safety: a gap must exceed P_r + d_safety"
    )
    skip_infeasible: bool = Field(
        False, description="leave out combinations with too small a gap instead of refusing them"
    )

    @field_validator("pillar_radius_um", "gap_um", "periodicity", "stiffness_sets")
    @classmethod
    def _no_duplicates(cls, values: list | None) -> list | None:
        repeated = sorted({v for v in values or [] if values.count(v) > 1})
        if repeated:
            raise ValueError(f"each value once; repeated: {', '.join(map(str, repeated))}")
        return values

    @model_validator(mode="after")
    def _one_kind_of_gap(self) -> "Sweep":
        if (self.gap_um is None) == (self.gap_minus_radius_um is None):
            raise ValueError("exactly one of gap_um and gap_minus_radius_um")
        return self

    def gaps_for(self, pillar_radius_um: float) -> list[float]:
        """Gaps combined with one pillar radius [µm]."""
        if self.gap_um is not None:
            return self.gap_um
        return [_thousandths(pillar_radius_um + self.gap_minus_radius_um)]


Bound = Annotated[float, Field(gt=0, lt=1000)]
Bounds = tuple[Bound, Bound]
Fraction = Annotated[float, Field(ge=0, le=1)]


class DesignRequest(Section):
    """Two cell types to be separated, and the bounds of the search.

    Each cell type is named either by its deformation index or by a stiffness set, whose calibrated
    deformation index is then taken.
    """

    name: Name = Field(description="letters, digits and hyphens, 64 at most")
    deformation_index_1: Fraction | None = Field(None, description="of the first cell type")
    deformation_index_2: Fraction | None = Field(None, description="of the second cell type")
    deformation_index_std_1: Annotated[float, Field(ge=0)] | None = Field(
        None, description="spread among cells of the first type; default: the calibration's, or 0"
    )
    deformation_index_std_2: Annotated[float, Field(ge=0)] | None = Field(
        None, description="spread among cells of the second type; default: the calibration's, or 0"
    )
    stiffness_set_1: str | None = Field(None, description="instead of deformation_index_1")
    stiffness_set_2: str | None = Field(None, description="instead of deformation_index_2")
    radius_1_um: float = Field(7.5, gt=0, description="radius of the first cell type")
    radius_2_um: float = Field(7.5, gt=0, description="radius of the second cell type")
    pillar_radius_um: Bounds = Field((4.0, 12.0), description="lowest and highest pillar radius")
    gap_um: Bounds = Field((12.0, 22.0), description="lowest and highest gap")
    periodicity: tuple[Annotated[int, Field(ge=2)], Annotated[int, Field(le=100)]] = Field(
        (4, 12), description="lowest and highest periodicity"
    )
    objective: Literal["separation", "robust"] = Field(
        "robust",
        description="what is maximised: |Δθ| as predicted, or the |Δθ| that nine of ten draws "
        "exceed with spread of the cells, error of the prediction and fabrication tolerance",
    )
    sampler: Literal["tpe", "grid"] = Field(
        "tpe", description="Parzen estimator with so many trials, or every point of a grid"
    )
    trials: int = Field(
        100, ge=1, le=10_000, description="trials of the search, 50 to 200 are typical"
    )
    startup_trials: int = Field(
        20, ge=1, le=10_000, description="random trials before the model guides"
    )
    grid_steps: int = Field(17, ge=2, le=65, description="values of P_r and of P_g in the grid")
    draws: int = Field(64, ge=8, le=4096, description="Monte Carlo draws of the robust objective")
    candidates: int = Field(5, ge=1, le=100, description="candidates to report")
    tolerance_um: float = Field(0.5, ge=0, description="± on P_r and P_g in the tolerance analysis")
    height_tolerance_um: float = Field(
        1.0, ge=0, description="± on the channel height, which only a simulation can judge"
    )
    pillar_aspect_ratio_max: float = Field(
        5.0, gt=0, description="largest height / diameter of a pillar that can be made"
    )
    lateral_separation_um: float = Field(
        100.0, gt=0, description="distance of the two cell types wanted at the end of the array"
    )
    pressure_max_kPa: Annotated[float, Field(gt=0)] | None = Field(
        None, description="largest pressure drop over the length which that takes; none: no limit"
    )

    @field_validator("pillar_radius_um", "gap_um", "periodicity")
    @classmethod
    def _ordered(cls, bounds: tuple) -> tuple:
        if bounds[0] > bounds[1]:
            raise ValueError("lowest bound first, highest bound second")
        return bounds

    @model_validator(mode="after")
    def _one_name_per_cell(self) -> "DesignRequest":
        for i in "12":
            given = [getattr(self, f"{key}_{i}") for key in ("deformation_index", "stiffness_set")]
            if sum(v is not None for v in given) != 1:
                raise ValueError(f"exactly one of deformation_index_{i} and stiffness_set_{i}")
        return self

    def with_deformation_indices(
        self, by_set: Mapping[str, float], spread_by_set: Mapping[str, float] | None = None
    ) -> "DesignRequest":
        """This request with stiffness sets replaced by their calibrated deformation indices.

        A spread that is not given becomes the set's, or 0. Raises DldsimError if a set has no
        calibrated value.
        """
        update: dict[str, Any] = {}
        for i in "12":
            name = getattr(self, f"stiffness_set_{i}")
            if getattr(self, f"deformation_index_std_{i}") is None:
                update[f"deformation_index_std_{i}"] = (spread_by_set or {}).get(name, 0.0)
            if name is None:
                continue
            if by_set.get(name) is None:
                raise DldsimError(
                    f"design request {self.name}: stiffness_set_{i} = {name} has no calibrated "
                    f"deformation index (calibrated: {', '.join(sorted(by_set)) or 'none'}). "
                    f"Add a constriction group for it, or give deformation_index_{i}."
                )
            update |= {f"deformation_index_{i}": by_set[name], f"stiffness_set_{i}": None}
        return self.model_copy(update=update)


class Verification(Section):
    """How designs are checked by simulation, for each design request."""

    rounds: int = Field(
        2, ge=0, description="rounds of search, simulation and refit at most; 0: no verification"
    )
    designs_per_round: int = Field(2, ge=1, description="new designs simulated in a round")
    transition_geometries: int = Field(
        1, ge=0, description="arrays simulated in a round where the predicted mode changes"
    )
    height_runs: bool = Field(
        True, description="simulate the best design at ± height_tolerance_um too"
    )
    finer_designs: int = Field(
        1, ge=0, description="designs that separate, best first, simulated once more on the next "
        "finer lattice at half the numerical Reynolds number; no other counts as separating"
    )
    exports: int = Field(1, ge=0, description="best verified designs whose files are written")
    outcomes_max: int = Field(20, ge=2, description="outcomes at most, two for each array")


class Fabrication(Section):
    """Fabrication errors whose consequences are asked of the surrogate."""

    radius_errors_um: list[Annotated[float, Field(gt=0)]] = Field(
        [0.25, 0.5, 1.0], min_length=1,
        description="standard deviations of the pillar radius at the pitch of the mask",
    )
    moved_deg: float = Field(0.5, gt=0, description="change of an angle that counts as moved")


RunId = Annotated[
    str, StringConstraints(pattern=r"^r\d\d+\.\d+_g\d\d+\.\d+_n\d\d+_s[A-Za-z0-9-]+$")
]
Setting = int | float | str


class WorkPrecision(Section):
    """Numerical settings whose error and run time are measured."""

    knobs: dict[str, Annotated[list[Setting], Field(min_length=2)]] = Field(
        {}, description="settings changed one at a time, values from coarse to finest"
    )
    alternatives: dict[Name, dict[str, Setting]] = Field(
        {}, description="whole settings by name: what differs from the default"
    )
    reference: dict[str, Setting] = Field(
        {}, description="jointly finer setting against which whole settings are measured"
    )


class AngleStudy(WorkPrecision):
    """Runs through arrays whose migration angle is studied."""

    cases: dict[Name, RunId] = Field({}, description="identifiers of runs by name")
    other_starts: list[Fraction] = Field(
        [], description="release_gap_fraction of the repetitions of each run"
    )
    long_rows: int = Field(
        100, ge=4, description="rows of the run that shows the error of stopping earlier"
    )


class IndexStudy(WorkPrecision):
    """Constriction groups whose deformation index is studied."""

    cases: list[Name] = Field([], description="names from constriction_groups")


class Accuracy(Section):
    """Runs and numerical settings of the study of error against run time."""

    migration_angle: AngleStudy = AngleStudy()
    deformation_index: IndexStudy = IndexStudy()

    @property
    def array_runs(self) -> list[str]:
        """Identifiers of all array runs of the study, each once."""
        return list(dict.fromkeys(self.migration_angle.cases.values()))


class StudyNumerics(Section):
    """Numerical settings of the reference: what differs from the campaign's."""

    spacing_um: float = Field(gt=0, description="largest lattice spacing wanted")
    reynolds_max: float = Field(gt=0, description="largest numerical Reynolds number")


class CriticalGap(Section):
    """An array and a cell whose transition from bump to zigzag is searched over the gap."""

    pillar_radius_um: Length = Field(description="pillar radius P_r")
    periodicity: int = Field(ge=2, le=100, description="periodicity N_p")
    stiffness_set: str = Field(description="name from stiffness_sets")
    bracket_um: tuple[Length, Length] = Field(
        description="gap at which the cell bumps, gap at which it does not"
    )

    @model_validator(mode="after")
    def _ordered(self) -> "CriticalGap":
        if self.bracket_um[0] >= self.bracket_um[1]:
            raise ValueError("bracket_um: the smaller gap, at which the cell bumps, first")
        return self


class CriticalDiameter(Section):
    """Stiff spheres whose critical gap is compared with the empirical law of Davis (2008)."""

    periodicities: list[Annotated[int, Field(ge=2, le=100)]] = Field(
        [], description="periodicities N_p"
    )
    radius_um: float = Field(5.0, gt=0, description="radius of the sphere")
    height_um: float = Field(30.0, gt=0, description="channel height")
    stiffness: Stiffness = Field(
        Stiffness(ks_uN_per_m=150, kb_pN_um=0, kal_uN_per_m=150, kag_uN_per_m=3000, kv_Pa=1e6,
                  kvisc_nN_s_per_m=0),
        description="membrane of the sphere; at 0.75 µPa·m of μU, Ca = μU/k_s is 0.005",
    )


class Reference(Section):
    """Array × cell pairs followed on finer lattices, and critical gaps against the settings."""

    pairs: list[RunId] = Field([], description="identifiers of the pairs")
    finest: list[RunId] = Field([], description="those of them that get the finest lattice too")
    numerics: StudyNumerics = Field(
        StudyNumerics(spacing_um=0.6, reynolds_max=0.1), description="of all pairs"
    )
    finest_numerics: StudyNumerics = Field(
        StudyNumerics(spacing_um=0.42, reynolds_max=0.1), description="of the finest"
    )
    releases: list[Fraction] = Field(
        [0.2, 0.5, 0.8], min_length=1, description="places of release, as shares of the gap"
    )
    rows: int = Field(100, ge=2, description="most rows that a cell is followed from a release")
    critical_gaps: list[CriticalGap] = Field([], description="transitions that are searched")
    critical_diameters: CriticalDiameter = CriticalDiameter()
    spacings_um: list[Annotated[float, Field(gt=0)]] = Field(
        [1.25, 0.9, 0.63], description="lattice spacings of the searches, coarse to fine"
    )
    reynolds_max: list[Annotated[float, Field(gt=0)]] = Field(
        [0.3, 0.15, 0.075], description="numerical Reynolds numbers of the searches, falling"
    )

    @model_validator(mode="after")
    def _finest_are_pairs(self) -> "Reference":
        if unknown := [run for run in self.finest if run not in self.pairs]:
            raise ValueError(f"finest must be among pairs; not there: {', '.join(unknown)}")
        return self


class Config(Section):
    """One campaign, every setting in place."""

    preset: str = Field("quick", description="name of the preset in force")
    seed: int = Field(1, ge=0, lt=2**64, description="seed of everything random")
    sweep: Sweep
    cell: CellShape = CellShape()
    flow: Flow = Flow()
    numerics: Numerics = Numerics()
    run_control: RunControl = RunControl()
    constriction: Constriction = Constriction()
    stiffness_sets: dict[Name, Stiffness] = Field(
        min_length=1, description="membranes of the campaign by name"
    )
    constriction_groups: dict[Name, ConstrictionGroup] = Field(
        min_length=1, description="stiffness groups of the calibration by name"
    )
    design_requests: list[DesignRequest] = Field([], description="separations to design for")
    verification: Verification = Verification()
    device: Device = Device()
    fabrication: Fabrication = Fabrication()
    accuracy: Accuracy = Accuracy()
    reference: Reference = Reference()

    @field_validator("cell", mode="before")
    @classmethod
    def _no_place(cls, cell: Any) -> Any:
        if isinstance(cell, Mapping) and "release_gap_fraction" in cell:
            raise ValueError(
                "no release_gap_fraction here: a campaign releases its cells at "
                "run_control.release_gap_fractions"
            )
        return cell

    @model_validator(mode="after")
    def _known_names(self) -> "Config":
        uses = [("sweep.stiffness_sets", name) for name in self.sweep.stiffness_sets]
        uses += [
            (f"constriction_groups.{group}.stiffness_set", value.stiffness_set)
            for group, value in self.constriction_groups.items()
        ]
        uses += [(f"accuracy: {run}", run.rpartition("_s")[2]) for run in self.accuracy.array_runs]
        uses += [(f"reference: {run}", run.rpartition("_s")[2]) for run in self.reference.pairs]
        uses += [("reference.critical_gaps", gap.stiffness_set)
                 for gap in self.reference.critical_gaps]
        for request in self.design_requests:
            uses += [
                (f"design_requests {request.name}", request.stiffness_set_1),
                (f"design_requests {request.name}", request.stiffness_set_2),
            ]
        unknown = [
            f"{key} names {name}"
            for key, name in uses
            if name is not None and name not in self.stiffness_sets
        ]
        if unknown:
            raise ValueError(
                f"unknown stiffness set: {'; '.join(unknown)}; known: "
                + ", ".join(self.stiffness_sets)
            )
        calibrated = [g.stiffness_set for g in self.constriction_groups.values() if g.stiffness_set]
        repeated = sorted({name for name in calibrated if calibrated.count(name) > 1})
        if repeated:
            raise ValueError(
                f"one constriction group per stiffness set; several for {', '.join(repeated)}"
            )
        missing = [name for name in self.sweep.stiffness_sets if name not in calibrated]
        if missing:
            raise ValueError(
                f"no constriction group calibrates stiffness set {', '.join(missing)}: "
                "give one of constriction_groups that stiffness_set"
            )
        names = [request.name for request in self.design_requests]
        repeated = sorted({name for name in names if names.count(name) > 1})
        if repeated:
            raise ValueError(f"design request names must differ; repeated: {', '.join(repeated)}")
        for group in self.accuracy.deformation_index.cases:
            if group not in self.constriction_groups:
                raise ValueError(
                    f"accuracy.deformation_index.cases names {group}; name some of the "
                    f"constriction_groups {', '.join(self.constriction_groups)}, or none: []"
                )
        return self


CELL_NUMERICS = {
    "coupling", "time_step", "reynolds_max", "kernel", "edge_to_spacing", "friction_nN_s_per_m",
    "contact_range_um",
}  # fmt: skip
"""The numerics that a flow without cell does not depend on."""

AREA_RESERVE = 0.1
"""Relative area growth that a squeezed membrane is assumed to bear in `smallest_passable_um`."""


def check_gap(geometry: Geometry, safety_distance_um: float) -> None:
    """Refuse a gap that does not exceed P_r + d_safety."""
    least = geometry.pillar_radius_um + safety_distance_um
    if geometry.gap_um <= least:
        raise DldsimError(
            f"gap_um = {geometry.gap_um:g} is too small for pillar_radius_um = "
            f"{geometry.pillar_radius_um:g}: a gap must exceed P_r + d_safety = {least:g} µm. "
            "Widen the gap, take a smaller pillar, or lower sweep.safety_distance_um."
        )


def _area_and_volume(cell: CellShape) -> tuple[float, float]:
    """Area / R² and volume / R³ of the rest shape."""
    if cell.shape == "biconcave":  # Evans & Fung (1972): 134.1 µm², 94.1 µm³ at R = 3.91 µm
        return 134.1 / 3.91**2, 94.1 / 3.91**3
    q = cell.aspect_ratio if cell.shape == "ellipsoid" else 1.0
    e = math.sqrt(1 - q * q)
    side = q * q * math.atanh(e) / e if e > 1e-6 else 1.0
    return 2 * math.pi * (1 + side), 4 / 3 * math.pi * q


def smallest_passable_um(cell: CellShape) -> float:
    """Diameter of the narrowest tube that the cell fits through [µm], a rough lower limit for gaps.

    A membrane keeps its volume and resists growth of its area, so the thinnest it can become is a
    cylinder with hemispherical ends of the same volume V and area A (Canham & Burton 1968):
    V = A r/2 − 2π r³/3. Here A is the rest area plus AREA_RESERVE. A cell between tall pillars can
    also flatten, which is easier: the limit is on the safe side, and only a simulation tells
    whether a wider gap is passed.
    """
    area, volume = _area_and_volume(cell)
    area *= 1 + AREA_RESERVE
    low, high = 0.0, math.sqrt(area / (4 * math.pi))  # V(r) rises up to the sphere of this area
    for _ in range(60):
        r = (low + high) / 2
        if area * r / 2 - 2 * math.pi * r**3 / 3 < volume:
            low = r
        else:
            high = r
    return 2 * high * cell.radius_um


def check_passable(geometry: Geometry, cell: CellShape, height_um: float = 0.0) -> None:
    """Refuse a gap, or a channel height other than 0, that the squeezed cell cannot pass."""
    least = smallest_passable_um(cell)
    for name, value in (("gap_um", geometry.gap_um), ("height_um", height_um or math.inf)):
        if value < least:
            raise DldsimError(
                f"{name} = {value:g} is smaller than a squeezed {cell.shape} cell of radius "
                f"{cell.radius_um:g} µm, about {least:.1f} µm across. Widen it, or lower "
                "cell.radius_um."
            )


def merge(base: Mapping, over: Mapping) -> dict:
    """`base` overlaid with `over`: mappings are merged, a null takes the key out, and everything
    else is replaced."""
    merged = dict(base)
    for key, value in over.items():
        if value is None:
            merged.pop(key, None)
            continue
        both = isinstance(merged.get(key), Mapping) and isinstance(value, Mapping)
        merged[key] = merge(merged[key], value) if both else value
    return merged


def _typed(value: Any) -> Any:
    """Texts inside a value read as YAML."""
    import yaml

    if isinstance(value, Mapping):
        return {key: _typed(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_typed(entry) for entry in value]
    try:
        return yaml.safe_load(value) if isinstance(value, str) else value
    except yaml.YAMLError:
        return value


def resolve(
    raw: Mapping, overrides: Mapping | None = None, files: Sequence[Mapping] = ()
) -> Config:
    """The validated configuration of one campaign.

    `raw` holds shared sections, `presets` and the name of one `preset`; `files` are further
    configurations that the user names, and `overrides` the command line, where numbers may come as
    text. Later ones win, and so do their names of a preset. Of each the preset in force goes over
    its own shared sections. Raises DldsimError with every problem's key, value and allowed values.
    """
    layers = [raw, *files, _typed(overrides or {})]
    for layer in layers:
        if not isinstance(layer, Mapping):
            raise DldsimError("The configuration is not a mapping of keys to values. See "
                              "config.yaml.")
        if not isinstance(layer.get("presets") or {}, Mapping):
            raise DldsimError("presets must be a mapping of names to partial configurations.")
    name = preset_of(layers)
    presets = {key: None for layer in layers for key in layer.get("presets") or {}}
    named = any("preset" in layer for layer in layers)
    if (presets or named) and name not in presets:
        raise DldsimError(
            f"Unknown preset {name!r}.{_did_you_mean(name, presets)} "
            f"Presets: {', '.join(presets) or 'none'}."
        )
    merged: dict[str, Any] = {}
    for layer in layers:
        for part in in_force(layer, name):
            merged = merge(merged, part)
    config = validate(Config, merged | {"preset": name})
    _check_sweep(config)
    return config


def sections_from(settings: Mapping[str, Any]) -> types.SimpleNamespace:
    """The sections of a configuration that a job was handed out; there are no others."""
    return types.SimpleNamespace(**{
        name: TypeAdapter(Config.model_fields[name].annotation).validate_python(value)
        for name, value in settings.items() if name in Config.model_fields
    })  # fmt: skip


def preset_of(layers: Iterable[Mapping]) -> str:
    """Name of the preset in force: the last that is named."""
    names = [layer["preset"] for layer in layers if layer.get("preset") is not None]
    return names[-1] if names else Config.model_fields["preset"].default


def in_force(layer: Mapping, preset: str) -> list[Mapping]:
    """What one configuration says under this preset: its shared sections, and the preset's."""
    shared = {key: value for key, value in layer.items() if key not in ("preset", "presets")}
    overlay = (layer.get("presets") or {}).get(preset) or {}
    if not isinstance(overlay, Mapping):
        raise DldsimError(f"presets.{preset} must be a mapping of keys to values.")
    return [shared, overlay]


def read_config(path: Path, overrides: Mapping | None = None) -> Config:
    """The validated configuration in a YAML file."""
    return resolve(read_layer(path), overrides)


def read_layer(path: Path) -> Any:
    """What a YAML file holds, not validated."""
    import yaml

    try:
        return yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise DldsimError(f"Cannot read the configuration {path}: {error.strerror}.") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise DldsimError(f"The configuration {path} is not valid YAML: {error}") from error


def _check_sweep(config: Config) -> None:
    """Every combination of the sweep must be sound; see Sweep.skip_infeasible."""
    sweep, feasible = config.sweep, 0
    for radius in sweep.pillar_radius_um:
        for gap in sweep.gaps_for(radius):
            geometry = Geometry(pillar_radius_um=radius, gap_um=gap, periodicity=2)
            try:
                check_gap(geometry, sweep.safety_distance_um)
            except DldsimError as error:
                if sweep.skip_infeasible:
                    continue
                raise DldsimError(
                    f"sweep: {error} Or set sweep.skip_infeasible: true to leave such "
                    "combinations out."
                ) from None
            check_passable(geometry, config.cell, config.flow.height_um)
            feasible += 1
    if not feasible:
        raise DldsimError(
            "sweep: no combination is left, every gap_um is at most P_r + d_safety "
            f"(d_safety = {sweep.safety_distance_um:g} µm). Add wider gaps or smaller pillars."
        )


def validate(model: type[Section], values: Mapping) -> Any:
    """An instance of a section, or a DldsimError in three lines per problem."""
    try:
        return model.model_validate(values)
    except ValidationError as error:
        problems = [_problem(model, details) for details in error.errors()]
    raise DldsimError(
        "The configuration cannot be used:\n"
        + "\n".join(problems)
        + "\nCorrect it in config.yaml or on the command line."
    )


def _did_you_mean(word: object, known: typing.Iterable) -> str:
    close = difflib.get_close_matches(str(word), [str(k) for k in known], n=1)
    return f" Did you mean {close[0]}?" if close else ""


def _problem(model: type[Section], details: Mapping) -> str:
    """Key path, value, and what is allowed there, one line each."""
    loc, kind, value = details["loc"], details["type"], details["input"]
    path = ".".join(str(part) for part in loc) or "(whole configuration)"
    if kind == "extra_forbidden":
        siblings = _model_at(model, loc[:-1]).model_fields
        value = "unknown key" + (f" (= {value!r})" if not isinstance(value, dict | list) else "")
        allowed = f"{', '.join(siblings)}.{_did_you_mean(loc[-1], siblings)}"
    elif kind == "missing":
        value, allowed = "missing", _allowed(model, loc, details)
    else:
        value = "" if isinstance(value, dict | BaseModel) else repr(value)
        allowed = _allowed(model, loc, details)
        if kind == "literal_error":
            allowed += _did_you_mean(details["input"], _choices(_annotation_at(model, loc)))
    lines = [f"  key      {path}", f"  value    {value}" if value else "", f"  allowed  {allowed}"]
    return "\n".join(line for line in lines if line)


def _field_at(model: type[Section], loc: tuple) -> tuple[Any, Any]:
    """Annotation and innermost named field at a key path."""
    annotation: Any = model
    field = None
    for part in loc:
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            field = annotation.model_fields.get(part)
            annotation = field.annotation if field else Any
        else:
            arguments = [a for a in typing.get_args(annotation) if a is not type(None)]
            if not arguments:
                return Any, field
            same = isinstance(part, int) and typing.get_origin(annotation) is tuple
            annotation = arguments[part] if same and part < len(arguments) else arguments[-1]
        annotation = _without_none(annotation)
    return annotation, field


def _without_none(annotation: Any) -> Any:
    arguments = typing.get_args(annotation)
    rest = [a for a in arguments if a is not type(None)]
    return rest[0] if type(None) in arguments and len(rest) == 1 else annotation


def _annotation_at(model: type[Section], loc: tuple) -> Any:
    return _field_at(model, loc)[0]


def _model_at(model: type[Section], loc: tuple) -> type[BaseModel]:
    annotation = _annotation_at(model, loc)
    while typing.get_origin(annotation) is Annotated:
        annotation = typing.get_args(annotation)[0]
    return annotation


def _choices(annotation: Any) -> tuple:
    return typing.get_args(annotation) if typing.get_origin(annotation) is Literal else ()


def _allowed(model: type[Section], loc: tuple, details: Mapping) -> str:
    """Kind, range or choices, and meaning of the value at a key path."""
    annotation, field = _field_at(model, loc)
    if details["type"] == "value_error":
        return str(details["ctx"]["error"])
    limits = list(field.metadata) if field and isinstance(loc[-1], str) else []
    while typing.get_origin(annotation) is Annotated:
        annotation, *extra = typing.get_args(annotation)
        limits += [m for e in extra for m in (getattr(e, "metadata", None) or [e])]
    if choices := _choices(annotation):
        text = "one of " + ", ".join(map(str, choices))
    else:
        names = {int: "whole number", float: "number", str: "text", bool: "true or false"}
        text = names.get(annotation, "")
    signs = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}
    ranges = [
        f"{sign} {getattr(m, key)}"
        for m in limits
        for key, sign in signs.items()
        if getattr(m, key, None) is not None
    ]
    text = " ".join(filter(None, [text, " and ".join(ranges)])) or details["msg"]
    if details["type"] == "too_short":
        text = f"at least {details['ctx']['min_length']} of"
    elif details["type"] == "string_pattern_mismatch":
        text = f"text like {details['ctx']['pattern']}"
    return f"{text} ({field.description})" if field and field.description else text


def json_schema() -> dict:
    """JSON schema of config.yaml, for editors: shared sections, `preset` and `presets`."""
    schema = Config.model_json_schema()
    for definition in schema["$defs"].values():  # a preset or a shared section may be partial
        definition.pop("required", None)
    schema.pop("required", None)
    sections = {key: value for key, value in schema["properties"].items() if key != "preset"}
    for key in ("stiffness_sets", "constriction_groups"):  # a preset takes one out with null
        entry = {"anyOf": [*sections[key]["patternProperties"].values(), {"type": "null"}]}
        sections[key] = {"type": "object", "additionalProperties": entry}
    schema["properties"]["presets"] = {
        "description": "named overlays of the sections above",
        "type": "object",
        "additionalProperties": {
            "type": "object",
            "properties": sections,
            "additionalProperties": False,
        },
    }
    return schema


def main() -> None:
    """Write the JSON schema to the file named on the command line."""
    import json
    import sys

    text = json.dumps(json_schema(), indent=2, ensure_ascii=False) + "\n"
    Path(sys.argv[1]).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
