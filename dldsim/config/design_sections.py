"""Settings of the search for designs, of their check by simulation, and of the chip."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from dldsim.config.sections import Fraction, Name, Periodicity, Section, Unfit
from dldsim.errors import DldsimError


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
    wall_gap_fraction: float = Field(
        0.5, gt=0, le=1, description="least gap between a pillar and a side wall / P_g"
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
        if not half < middle < width - half:
            raise Unfit(
                f"sample_position_mm between {half / 1e3:g} and {(width - half) / 1e3:g}: the "
                "sample stream and its two dividers lie inside the channel",
                "sample_position_mm",
                "sample_width_um",
                "divider_um",
                "array_width_mm",
            )
        layers = [value for key, value in self if key.startswith("layer_")]
        if len(set(layers)) < len(layers):
            raise ValueError("every layer_… another number")
        return self


Bound = Annotated[float, Field(gt=0, lt=1000)]
Bounds = tuple[Bound, Bound]


class DesignRequest(Section):
    """Two cell types to be separated, and the bounds of the search.

    Each cell type is named either by its deformation index or by a stiffness set, whose calibrated
    deformation index is then taken.
    """

    name: Name = Field(description="letters, digits and hyphens, 64 at most")
    deformation_index_1: Fraction | None = Field(None, description="of the first cell type")
    deformation_index_2: Fraction | None = Field(None, description="of the second cell type")
    deformation_index_std_1: Annotated[float, Field(ge=0, le=1)] | None = Field(
        None, description="spread among cells of the first type; default: the calibration's, or 0"
    )
    deformation_index_std_2: Annotated[float, Field(ge=0, le=1)] | None = Field(
        None, description="spread among cells of the second type; default: the calibration's, or 0"
    )
    stiffness_set_1: str | None = Field(None, description="instead of deformation_index_1")
    stiffness_set_2: str | None = Field(None, description="instead of deformation_index_2")
    radius_1_um: float = Field(7.5, ge=0.1, le=1000, description="radius of the first cell type")
    radius_2_um: float = Field(7.5, ge=0.1, le=1000, description="radius of the second cell type")
    pillar_radius_um: Bounds = Field((4.0, 12.0), description="lowest and highest pillar radius")
    gap_um: Bounds = Field((12.0, 22.0), description="lowest and highest gap")
    periodicity: tuple[Periodicity, Periodicity] = Field(
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
    tolerance_um: float = Field(
        0.5, ge=0, le=100, description="± on P_r and P_g in the tolerance analysis"
    )
    height_tolerance_um: float = Field(
        1.0, ge=0, le=100, description="± on the channel height, which only a simulation can judge"
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
                both = f"deformation_index_{i}", f"stiffness_set_{i}"
                raise Unfit(f"exactly one of {both[0]} and {both[1]}", *both)
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
                calibrated = ", ".join(sorted(by_set)) or "none"
                raise DldsimError(
                    f"design request {self.name}: stiffness_set_{i} = {name} has no calibrated "
                    f"deformation index (calibrated: {calibrated}).",
                    key=f"stiffness_set_{i}",
                    value=name,
                    allowed=calibrated,
                    remedy=f"Let the default assay measure it, or give deformation_index_{i}.",
                )
            update |= {f"deformation_index_{i}": by_set[name], f"stiffness_set_{i}": None}
        return self.model_copy(update=update)


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
