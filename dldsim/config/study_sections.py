"""Settings of the studies of numerical error: accuracy and reference."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, Strict, model_validator

from dldsim.config.identifiers import parse_outcome
from dldsim.config.sections import Length, Name, Periodicity, Place, Places, Section, Stiffness
from dldsim.errors import DldsimError


def _outcome(text: str) -> str:
    """Refuse what is no identifier of an array and a cell."""
    try:
        parse_outcome(text)
    except DldsimError as error:
        raise ValueError(str(error)) from error
    return text


RunId = Annotated[str, AfterValidator(_outcome)]
Setting = bool | int | float | Annotated[str, Strict()]


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
    other_starts: list[Place] = Field(
        [], description="release_gap_fraction of the repetitions of each run"
    )
    long_rows: int = Field(
        100, ge=4, le=10_000, description="rows of the run that shows the error of stopping earlier"
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

    spacing_um: float = Field(ge=0.01, le=100, description="largest lattice spacing wanted")
    reynolds_max: float = Field(ge=1e-6, le=100, description="largest numerical Reynolds number")


class Domain(Section):
    """Domain of the lattice in which a cell has other periodic images."""

    rows: int = Field(ge=1, le=100, description="pillar rows in the domain")
    lanes: int = Field(ge=1, le=20, description="pillars per row in the domain")
    images: Literal["aligned", "dilute"] = Field(description="as in numerics")


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

    periodicities: list[Periodicity] = Field([], description="periodicities N_p")
    radius_um: float = Field(5.0, ge=0.1, le=1000, description="radius of the sphere")
    height_um: float = Field(30.0, gt=0, le=1000, description="channel height")
    stiffness: Stiffness = Field(
        Stiffness(
            ks_uN_per_m=150,
            kb_pN_um=0,
            kal_uN_per_m=150,
            kag_uN_per_m=3000,
            kv_Pa=1e6,
            kvisc_nN_s_per_m=0,
        ),
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
    domain: Domain | None = Field(
        None,
        description="of all pairs once more, at the campaign's numerics otherwise; null, or the "
        "campaign's own: none",
    )
    releases: Places = Field([0.2, 0.5, 0.8], description="places of release, as shares of the gap")
    rows: int = Field(
        100, ge=2, le=10_000, description="most rows that a cell is followed from a release"
    )
    critical_gaps: list[CriticalGap] = Field([], description="transitions that are searched")
    critical_diameters: CriticalDiameter = CriticalDiameter()
    spacings_um: list[Annotated[float, Field(ge=0.01, le=100)]] = Field(
        [1.25, 0.9, 0.63], description="lattice spacings of the searches, coarse to fine"
    )
    reynolds_max: list[Annotated[float, Field(ge=1e-6, le=100)]] = Field(
        [0.3, 0.15, 0.075], description="numerical Reynolds numbers of the searches, falling"
    )

    @model_validator(mode="after")
    def _finest_are_pairs(self) -> "Reference":
        if unknown := [run for run in self.finest if run not in self.pairs]:
            raise ValueError(f"finest must be among pairs; not there: {', '.join(unknown)}")
        return self
