"""Settings of the survey: outcomes that fill the space of arrays and cells, to learn from."""

from typing import Annotated, Literal, NamedTuple

from pydantic import AfterValidator, Field

from dldsim.config.sections import Periodicity, Section


def _rising(ends: tuple) -> tuple:
    """Refuse a range whose ends are swapped."""
    if ends[0] > ends[1]:
        raise ValueError("the lower end first")
    return ends


Ratio = Annotated[float, Field(gt=0, le=1000)]
Range = Annotated[tuple[Ratio, Ratio], AfterValidator(_rising)]
SurveyedShape = Literal["biconcave", "sphere"]


class SurveyShape(Section):
    """What is drawn for cells of one shape; R is the campaign's cell.radius_um."""

    pillar_radius_to_radius: Range = Field(description="range of P_r/R")
    gap_to_radius: Range = Field(description="range of P_g/R")
    periodicity: Annotated[tuple[Periodicity, Periodicity], AfterValidator(_rising)] = Field(
        description="range of N_p"
    )
    capillary_number: Range = Field(description="range of Ca = μU/k_s")
    height_to_radius: Range = Field(description="range of the channel height / R")
    transition_band: Range = Field(
        description="range of 2R/D_c for half of the first points, D_c = 1.4 G ε^0.48"
    )
    first_points: int = Field(ge=1, le=100_000, description="points of the first round")
    round_points: int = Field(ge=0, le=100_000, description="points of each refining round")


class Member(NamedTuple):
    """Round and cell shape of one point of the survey."""

    round: int
    shape: str


class Survey(Section):
    """Points at which the survey is simulated: not part of a campaign, see docs/survey.md."""

    rounds: int = Field(3, ge=0, le=100, description="refining rounds after the first")
    shapes: dict[SurveyedShape, SurveyShape] = Field({}, description="what is drawn by cell shape")

    def members(self) -> list[Member]:
        """Round and shape of every point; its place in the list is its number."""
        return [
            Member(number, shape)
            for number in range(self.rounds + 1)
            for shape, drawn in self.shapes.items()
            for _ in range(drawn.round_points if number else drawn.first_points)
        ]
