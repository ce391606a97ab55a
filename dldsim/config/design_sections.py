"""Settings of the search for designs, of their check by simulation, and of the chip."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, field_validator, model_validator

from dldsim.config.population_sections import CellScatter
from dldsim.config.sections import Fraction, Name, Periodicity, Section, Shape, Unfit, thousandths


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
        0.4, gt=0, le=100, description="middle of the sample stream above the lower side wall"
    )
    sample_width_um: float = Field(60.0, gt=0, le=1e5, description="width of the sample stream")
    divider_um: float = Field(30.0, gt=0, le=1e5, description="thickness of walls between streams")
    port_diameter_mm: float = Field(1.0, gt=0, le=10, description="diameter of the reservoirs")
    outlets: Annotated[int, Field(ge=2, le=20)] | None = Field(
        None,
        description="outlets side by side; default: as outlet_walls_um has them, else 2. Of two "
        "the wall between them is placed for the best separation, more are equally wide",
    )
    outlet_walls_um: list[Annotated[float, Field(gt=0, le=1e5)]] | None = Field(
        None,
        min_length=1,
        max_length=19,
        description="middles of the walls between outlets above the lower side wall, rising",
    )
    alignment_mark_um: float = Field(
        200.0, gt=0, le=1e5, description="size of the alignment crosses"
    )
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
        if not half < width - half:
            raise Unfit(
                f"array_width_mm more than {2 * half / 1e3:g}: the sample stream and its two "
                "dividers lie inside the channel",
                "array_width_mm",
                "sample_width_um",
                "divider_um",
            )
        if not half < middle < width - half:
            raise Unfit(
                f"sample_position_mm between {half / 1e3:g} and {(width - half) / 1e3:g}: the "
                "sample stream and its two dividers lie inside the channel",
                "sample_position_mm",
                "sample_width_um",
                "divider_um",
                "array_width_mm",
            )
        walls = self.outlet_walls_um
        if walls is not None:
            edges = [-self.divider_um / 2, *walls, width + self.divider_um / 2]
            if min(b - a for a, b in pairwise(edges)) <= self.divider_um:
                raise Unfit(
                    f"outlet_walls_um rising, inside the channel (0 to {width:g} µm), and further "
                    f"apart than divider_um = {self.divider_um:g}: every outlet has a width",
                    "outlet_walls_um",
                    "array_width_mm",
                    "divider_um",
                )
            if self.outlets is not None and self.outlets != len(walls) + 1:
                raise Unfit(
                    f"outlets = {len(walls) + 1} with {len(walls)} outlet_walls_um, or left out",
                    "outlets",
                    "outlet_walls_um",
                )
        layers = [value for key, value in self if key.startswith("layer_")]
        if len(set(layers)) < len(layers):
            raise ValueError("every layer_… another number")
        return self

    def walls_um(self, width_um: float) -> list[float] | None:
        """Walls between outlets of an array so wide; None where one is still to be placed."""
        if self.outlet_walls_um is not None:
            return list(self.outlet_walls_um)
        count = self.outlets or 2
        return None if count == 2 else [width_um * i / count for i in range(1, count)]


Bound = Annotated[float, Field(gt=0, lt=1000), AfterValidator(thousandths)]
Bounds = tuple[Bound, Bound]


Spread = Annotated[float, Field(ge=0, le=1)]
SPRING_LEAST = 1e-3
"""Least spring constant of a cell [µN/m]; smaller ones have no finite Ca, and no cell has them."""
SPRING_MOST = 1e6
"""Largest spring constant that a request may name [µN/m]."""
Spring = Annotated[float, Field(ge=SPRING_LEAST, le=SPRING_MOST)]
DEFORMABILITIES = ("deformation_index_{}", "stiffness_set_{}", "ks_{}_uN_per_m", "rigid_{}")
"""Fields of a cell type of which a request names one."""


class CellTypes(CellScatter):
    """Two cell types and the flow that carries them.

    Each cell type has a shape, a radius, and one of: a deformation index by an assay, a stiffness
    set, a spring constant, or nothing that deforms it (a bead).
    """

    shape_1: Shape = Field("biconcave", description="rest shape of the first cell type")
    shape_2: Shape = Field("biconcave", description="rest shape of the second cell type")
    deformation_index_1: Fraction | None = Field(None, description="of the first cell type")
    deformation_index_2: Fraction | None = Field(None, description="of the second cell type")
    deformation_index_std_1: Spread | None = Field(
        None, description="spread of it among cells of the first type; default 0"
    )
    deformation_index_std_2: Spread | None = Field(
        None, description="spread of it among cells of the second type; default 0"
    )
    assay: Name | None = Field(
        None,
        description="calibration by which deformation indices were measured; default: the "
        "campaign's own",
    )
    stiffness_set_1: str | None = Field(None, description="instead of deformation_index_1")
    stiffness_set_2: str | None = Field(None, description="instead of deformation_index_2")
    ks_1_uN_per_m: Spring | None = Field(
        None, description="spring constant k_s, instead of deformation_index_1"
    )
    ks_2_uN_per_m: Spring | None = Field(
        None, description="spring constant k_s, instead of deformation_index_2"
    )
    rigid_1: bool = Field(False, description="a bead (a sphere), instead of deformation_index_1")
    rigid_2: bool = Field(False, description="a bead (a sphere), instead of deformation_index_2")
    radius_1_um: float = Field(7.5, ge=0.1, le=1000, description="radius of the first cell type")
    radius_2_um: float = Field(7.5, ge=0.1, le=1000, description="radius of the second cell type")
    velocity_mm_s: Annotated[float, Field(ge=1e-5, le=1000)] | None = Field(
        None, description="mean velocity in the array; default: the campaign's"
    )
    height_um: Annotated[float, Field(ge=0.1, le=1000)] | None = Field(
        None, description="channel height; default: the campaign's"
    )

    @model_validator(mode="after")
    def _one_name_per_cell(self) -> "CellTypes":
        for i in "12":
            others = f"shape_{i}", f"deformation_index_std_{i}"
            check_cell_type(self, [key.format(i) for key in DEFORMABILITIES], *others)
            variation = f"ks_cv_{i}"
            for key in (f"deformation_index_std_{i}", f"rigid_{i}"):
                if getattr(self, variation) is not None and getattr(self, key) not in (None, False):
                    raise Unfit(f"one of {variation} and {key}", variation, key)
        return self


class DesignRequest(CellTypes):
    """Two cell types to be separated, and the bounds of the search."""

    name: Name = Field(description="letters, digits and hyphens, 64 at most")
    pillar_radius_um: Bounds = Field((4.0, 12.0), description="lowest and highest pillar radius")
    gap_um: Bounds = Field((12.0, 22.0), description="lowest and highest gap")
    periodicity: tuple[Periodicity, Periodicity] = Field(
        (4, 12), description="lowest and highest periodicity"
    )
    objective: Literal["separation", "robust", "purity-recovery"] = Field(
        "robust",
        description="what is maximised: |Δθ| as predicted, the |Δθ| that nine of ten draws exceed "
        "with spread of the cells, error of the prediction and fabrication tolerance, or the "
        "smallest purity or recovery that nine of ten draws exceed at the outlets of the device",
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
    candidates: int = Field(5, ge=1, le=100, description="candidates to report")
    tolerance_um: float = Field(
        0.5, ge=0, le=100, description="± on P_r and P_g in the tolerance analysis"
    )
    height_tolerance_um: float = Field(
        1.0, ge=0, le=100, description="± on the channel height of the best design, simulated"
    )
    pillar_aspect_ratio_max: float = Field(
        5.0, gt=0, le=1000, description="largest height / diameter of a pillar that can be made"
    )
    lateral_separation_um: float = Field(
        100.0,
        gt=0,
        le=1e5,
        description="distance of the two cell types wanted at the end of the array",
    )
    pressure_max_kPa: Annotated[float, Field(gt=0, le=1e9)] | None = Field(
        None,
        description="largest pressure drop: over the length which that takes, or with objective "
        "purity-recovery over the array, which is as long as this allows; none: no limit",
    )
    footprint_max_mm2: Annotated[float, Field(gt=0, le=1e4)] | None = Field(
        None,
        description="largest length times width of the array, with objective purity-recovery; "
        "none: no limit but the device's own length",
    )
    sample_min_uL_per_h: Annotated[float, Field(gt=0, le=1e9)] | None = Field(
        None, description="least flow of the sample stream; none: no limit"
    )

    @field_validator("pillar_radius_um", "gap_um", "periodicity")
    @classmethod
    def _ordered(cls, bounds: tuple) -> tuple:
        if bounds[0] > bounds[1]:
            raise ValueError("lowest bound first, highest bound second")
        return bounds

    @model_validator(mode="after")
    def _footprint_has_its_objective(self) -> "DesignRequest":
        if self.footprint_max_mm2 is not None and self.objective != "purity-recovery":
            raise Unfit(
                "footprint_max_mm2 with objective: purity-recovery, which alone chooses a length",
                "footprint_max_mm2",
                "objective",
            )
        return self


def is_given(value: Any) -> bool:
    """Whether a field says something: null and false do not, 0 does."""
    return value is not None and value is not False


def check_cell_type(named: Section, keys: Sequence[str], shape: str, spread: str) -> None:
    """Refuse a cell type whose fields, of these names, say too little, too much or two things.

    ``keys``: of DEFORMABILITIES.
    """
    index, by_set, _, rigid = keys
    given = [key for key in keys if is_given(getattr(named, key))]
    if len(given) != 1:
        raise Unfit(f"exactly one of {', '.join(keys[:-1])} and {rigid}", *keys)
    if given == [rigid] and getattr(named, shape) != "sphere":
        raise Unfit(f"{rigid} with {shape}: sphere, a bead", rigid, shape)
    if given[0] not in (index, by_set) and getattr(named, spread) is not None:
        raise Unfit(f"{spread} with {index} or {by_set} alone", spread, given[0])


class Verification(Section):
    """How designs are checked by simulation, for each design request."""

    rounds: int = Field(
        2,
        ge=0,
        le=100,
        description="rounds of search, simulation and refit at most; 0: no verification",
    )
    designs_per_round: int = Field(2, ge=1, le=100, description="new designs simulated in a round")
    transition_geometries: int = Field(
        1, ge=0, le=100, description="arrays simulated in a round where the predicted mode changes"
    )
    height_runs: bool = Field(
        True, description="simulate the best design at ± height_tolerance_um too"
    )
    finer_designs: int = Field(
        1,
        ge=0,
        le=100,
        description="designs that separate, best first, simulated once more on the next "
        "finer lattice at half the numerical Reynolds number; no other counts as separating",
    )
    exports: int = Field(
        1, ge=0, le=100, description="best verified designs whose files are written"
    )
    outcomes_max: int = Field(
        20, ge=2, le=10_000, description="outcomes at most, two for each array"
    )


class Fabrication(Section):
    """Fabrication errors whose consequences are asked of the surrogate."""

    radius_errors_um: list[Annotated[float, Field(gt=0, le=100)]] = Field(
        [0.25, 0.5, 1.0],
        min_length=1,
        description="standard deviations of the pillar radius at the pitch of the mask",
    )
    moved_deg: float = Field(
        0.5, gt=0, le=90, description="change of an angle that counts as moved"
    )


class Learning(Section):
    """What the surrogate learns from."""

    survey: bool = Field(
        True, description="the survey that comes with the package, beside the campaign's outcomes"
    )
