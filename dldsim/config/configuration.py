"""The whole configuration of a campaign, and its sweep."""

import types
from collections import Counter
from collections.abc import Collection, Mapping
from typing import Any

from pydantic import Field, TypeAdapter, field_validator, model_validator

from dldsim.config.assay_sections import (
    CIRCULARITY,
    Assay,
    AssayStudy,
    CalibrationLibrary,
    ChannelAssay,
    ConstrictionAssay,
    TableAssay,
)
from dldsim.config.design_sections import DesignRequest, Device, Fabrication, Learning, Verification
from dldsim.config.limits import Limits
from dldsim.config.sections import (
    CellShape,
    Constriction,
    ConstrictionGroup,
    Flow,
    Length,
    Name,
    Numerics,
    Periodicity,
    RunControl,
    Section,
    Stiffness,
    Unfit,
    thousandths,
)
from dldsim.config.study_sections import Accuracy, Reference
from dldsim.config.survey_section import Survey

SEED_MAX = 2**63 - 1


class Sweep(Section):
    """The geometries and stiffness sets of a campaign: every combination is one run."""

    pillar_radius_um: list[Length] = Field(min_length=1, description="pillar radii P_r")
    gap_um: list[Length] | None = Field(
        None, min_length=1, description="gaps P_g, combined with every radius"
    )
    gap_minus_radius_um: float | None = Field(
        None,
        gt=0,
        le=1000,
        description="instead of gap_um: one gap P_g = P_r + this for each radius",
    )
    periodicity: list[Periodicity] = Field(min_length=1, description="periodicities N_p")
    stiffness_sets: list[str] = Field(min_length=1, description="names from stiffness_sets")
    safety_distance_um: float = Field(
        2.0, ge=0, le=1000, description="d_safety: a gap must exceed P_r + d_safety"
    )
    skip_infeasible: bool = Field(
        False, description="leave out combinations with too small a gap instead of refusing them"
    )

    @field_validator("pillar_radius_um", "gap_um", "periodicity", "stiffness_sets")
    @classmethod
    def _no_duplicates(cls, values: list | None) -> list | None:
        repeated = sorted(v for v, count in Counter(values).items() if count > 1)
        if repeated:
            raise ValueError(f"each value once; repeated: {', '.join(map(str, repeated))}")
        return values

    @model_validator(mode="after")
    def _one_kind_of_gap(self) -> "Sweep":
        if (self.gap_um is None) == (self.gap_minus_radius_um is None):
            raise Unfit(
                "exactly one of gap_um and gap_minus_radius_um", "gap_um", "gap_minus_radius_um"
            )
        return self

    def gaps_for(self, pillar_radius_um: float) -> list[float]:
        """Gaps combined with one pillar radius [µm]."""
        if self.gap_um is not None:
            return self.gap_um
        assert self.gap_minus_radius_um is not None  # one of the two is given
        return [thousandths(pillar_radius_um + self.gap_minus_radius_um)]


class Partial(Section):
    """Settings that need not hold a whole campaign; what is left out has its default."""

    limits: Limits = Limits()
    preset: str = Field("quick", description="name of the preset in force")
    seed: int = Field(1, ge=0, le=SEED_MAX, description="seed of everything random")
    sweep: Sweep | None = None
    cell: CellShape = CellShape()
    flow: Flow = Flow()
    numerics: Numerics = Numerics()
    run_control: RunControl = RunControl()
    constriction: Constriction = Constriction()
    assays: dict[Name, Assay] = Field({}, description="ways to measure deformability by name")
    default_assay: str = Field(
        "gauge", description="name from assays: its index is that of the campaign's outcomes"
    )
    calibration_library: CalibrationLibrary = CalibrationLibrary()
    assay_study: AssayStudy = AssayStudy()
    stiffness_sets: dict[Name, Stiffness] = Field(
        {}, description="membranes of the campaign by name"
    )
    constriction_groups: dict[Name, ConstrictionGroup] = Field(
        {}, description="stiffness groups of the calibration by name"
    )
    design_requests: list[DesignRequest] = Field([], description="separations to design for")
    verification: Verification = Verification()
    device: Device = Device()
    fabrication: Fabrication = Fabrication()
    surrogate: Learning = Learning()
    accuracy: Accuracy = Accuracy()
    reference: Reference = Reference()
    survey: Survey = Survey()

    @field_validator("cell", mode="before")
    @classmethod
    def _no_place(cls, cell: Any) -> Any:
        if isinstance(cell, Mapping) and "release_gap_fraction" in cell:
            raise ValueError(
                "no release_gap_fraction here: a campaign releases its cells at "
                "run_control.release_gap_fractions"
            )
        return cell


class Config(Partial):
    """One campaign, every setting in place."""

    sweep: Sweep
    stiffness_sets: dict[Name, Stiffness] = Field(
        min_length=1, description="membranes of the campaign by name"
    )
    assays: dict[Name, Assay] = Field(
        min_length=1, description="ways to measure deformability by name"
    )

    @model_validator(mode="after")
    def _known_names(self) -> "Config":
        uses: list[tuple[str, str | None]] = [
            ("sweep.stiffness_sets", name) for name in self.sweep.stiffness_sets
        ]
        uses += [
            (f"constriction_groups.{group}.stiffness_set", value.stiffness_set)
            for group, value in self.constriction_groups.items()
        ]
        uses += [
            (f"accuracy.migration_angle.cases.{case}", run.rpartition("_s")[2])
            for case, run in self.accuracy.migration_angle.cases.items()
        ]
        uses += [("reference.pairs", run.rpartition("_s")[2]) for run in self.reference.pairs]
        uses += [
            ("reference.critical_gaps", gap.stiffness_set) for gap in self.reference.critical_gaps
        ]
        for i, request in enumerate(self.design_requests):
            uses += [
                (f"design_requests.{i}.stiffness_set_1", request.stiffness_set_1),
                (f"design_requests.{i}.stiffness_set_2", request.stiffness_set_2),
            ]
        unknown = {
            key: name for key, name in uses if name is not None and name not in self.stiffness_sets
        }
        if unknown:
            named = "; ".join(f"{key} names {name}" for key, name in unknown.items())
            raise Unfit(
                f"unknown stiffness set: {named}; known: " + ", ".join(self.stiffness_sets),
                *unknown,
            )
        calibrated = [g.stiffness_set for g in self.constriction_groups.values() if g.stiffness_set]
        repeated = sorted({name for name in calibrated if calibrated.count(name) > 1})
        if repeated:
            raise Unfit(
                f"one constriction group per stiffness set; several for {', '.join(repeated)}",
                "constriction_groups",
            )
        self._check_assays(calibrated)
        names = [request.name for request in self.design_requests]
        repeated = sorted({name for name in names if names.count(name) > 1})
        if repeated:
            raise Unfit(
                f"design request names must differ; repeated: {', '.join(repeated)}",
                "design_requests",
            )
        for group in self.accuracy.deformation_index.cases:
            if group not in self.constriction_groups:
                raise Unfit(
                    f"accuracy.deformation_index.cases names {group}; name some of the "
                    f"constriction_groups {', '.join(self.constriction_groups)}, or none: []",
                    "accuracy.deformation_index.cases",
                )
        return self

    def _check_assays(self, in_groups: Collection[str]) -> None:
        """Refuse assays that do not know their membranes, or leave a set of the sweep without an
        index. ``in_groups``: stiffness sets that a constriction group stands for."""
        if self.default_assay not in self.assays:
            raise Unfit(f"one of the assays {', '.join(self.assays)}", "default_assay")
        for key, names in (
            ("assay_study.of_campaign", self.assay_study.of_campaign),
            ("calibration_library.assays", self.calibration_library.assays),
        ):
            if wrong := [name for name in names if name not in self.assays]:
                raise Unfit(f"names from assays; {', '.join(wrong)}", key)
        if both := self.assay_study.assays.keys() & self.assays.keys():
            raise Unfit(f"names that assays has not; {', '.join(both)}", "assay_study.assays")
        for section, assays in (("", self.assays), ("assay_study.", self.assay_study.assays)):
            for name, assay in assays.items():
                key = f"{section}assays.{name}"
                if isinstance(assay, TableAssay):
                    unknown = [s for s in assay.indices if s not in self.stiffness_sets]
                    if unknown:
                        known = ", ".join(self.stiffness_sets)
                        raise Unfit(f"stiffness sets {known}; {unknown[0]}", f"{key}.indices")
                elif getattr(assay, "groups", False) and not self.constriction_groups:
                    raise Unfit("constriction_groups, which groups: true takes", f"{key}.groups")
        calibrated = {*self.assays} | {
            name + CIRCULARITY for name, a in self.assays.items() if isinstance(a, ChannelAssay)
        }
        for i, request in enumerate(self.design_requests):
            if request.assay not in (None, *calibrated):
                known = ", ".join(sorted(calibrated))
                raise Unfit(f"one of the assays {known}", f"design_requests.{i}.assay")
        default = self.assays[self.default_assay]
        own = self.cell.shape, self.cell.radius_um
        cells = [] if isinstance(default, TableAssay) else default.cells
        if cells and own not in [(cell.shape, cell.radius_um) for cell in cells]:
            raise Unfit(
                f"among the cells of the default assay the campaign's, {own[0]} of {own[1]:g} µm; "
                "or none",
                f"assays.{self.default_assay}.cells",
            )
        measured: Collection[str] = self.stiffness_sets
        if isinstance(default, TableAssay):
            measured = default.indices
        elif isinstance(default, ConstrictionAssay) and default.groups:
            measured = () if default.velocity_mm_s else in_groups
        missing = [name for name in self.sweep.stiffness_sets if name not in measured]
        if missing:
            raise Unfit(
                f"no membrane of assay {self.default_assay} stands for stiffness set "
                f"{', '.join(missing)}",
                "default_assay",
                "sweep.stiffness_sets",
            )


def sections_from(settings: Mapping[str, Any]) -> types.SimpleNamespace:
    """The sections of a configuration that a job was handed out; there are no others."""
    wanted: dict[str, Any] = {name: field.annotation for name, field in Config.model_fields.items()}
    return types.SimpleNamespace(
        **{
            name: TypeAdapter(wanted[name]).validate_python(value)
            for name, value in settings.items()
            if name in wanted
        }
    )
