"""The whole configuration of a campaign, and its sweep."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field, field_validator, model_validator

from dldsim.config.design_sections import DesignRequest, Device, Fabrication, Verification
from dldsim.config.sections import (
    CellShape,
    Constriction,
    ConstrictionGroup,
    Flow,
    Length,
    Name,
    Numerics,
    RunControl,
    Section,
    Stiffness,
    thousandths,
)
from dldsim.config.study_sections import Accuracy, Reference


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
        return [thousandths(pillar_radius_um + self.gap_minus_radius_um)]


class Config(Section):
    """One campaign, every setting in place."""

    preset: str = Field("quick", description="name of the preset in force")
    seed: int = Field(1, ge=0, description="seed of everything random")
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
        uses += [
            ("reference.critical_gaps", gap.stiffness_set) for gap in self.reference.critical_gaps
        ]
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
