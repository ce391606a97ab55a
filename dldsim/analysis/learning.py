"""The survey that comes with the package, to be learnt from beside a campaign.

Its outcomes fill the space of arrays, capillary numbers, channel heights and shapes. They serve a
campaign that was simulated by the same physics and numerics, and no other.
"""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from dldsim.config.sections import CellShape, Flow, Numerics
from dldsim.errors import DldsimError
from dldsim.tables.numerics import COLUMN_OF, columns_of

if TYPE_CHECKING:
    import pandas as pd

SURVEY = Path(__file__).parents[1] / "data" / "survey" / "outcomes.parquet"
"""Outcomes of the survey that comes with the package."""
REMEDY = "Set surrogate.survey: false to learn from the campaign alone."
CAMPAIGN_SOURCE, SURVEY_SOURCE = "campaign", "survey"


def read_survey() -> "pd.DataFrame":
    """The survey's outcomes. Raises DldsimError if there are none, or of other physics."""
    if not SURVEY.exists():
        raise DldsimError(
            "No survey comes with this installation.",
            key="surrogate.survey",
            value=True,
            allowed="false",
            remedy=REMEDY,
        )
    from dldsim.tables.parquet import read_table

    try:
        return read_table("outcomes", SURVEY)
    except DldsimError as error:
        raise DldsimError(
            f"The survey cannot be learnt from: {error}",
            key="surrogate.survey",
            value=True,
            allowed="false",
            remedy=REMEDY,
        ) from error


def survey_of(settings: Mapping) -> "pd.DataFrame | None":
    """The survey where the section `surrogate` of a configuration asks for it, else None."""
    return read_survey() if settings["surrogate"]["survey"] else None


def survey_hash(numerics: Numerics, cell: CellShape, flow: Flow) -> str:
    """Hash of the survey's file: what was learnt from another is made anew.

    Raises DldsimError without one, and where it does not serve a campaign of these settings.
    """
    import pandas as pd

    made = columns_of(numerics) | {"release_axis": cell.axis, "drive": flow.drive}
    with_survey(pd.DataFrame([made]), read_survey())
    return hashlib.sha256(SURVEY.read_bytes()).hexdigest()[:16]


MADE_WITH = [*COLUMN_OF.values(), "release_axis", "drive"]
"""Columns of `outcomes` in which campaign and survey must agree."""


def with_survey(outcomes: "pd.DataFrame", survey: "pd.DataFrame | None") -> "pd.DataFrame":
    """Outcomes of a campaign and, below them, those of the survey, with a column `source`.

    Raises DldsimError if both were made with different numerics; what differs is named.
    """
    import pandas as pd

    outcomes = outcomes.assign(source=CAMPAIGN_SOURCE)
    if survey is None:
        return outcomes
    wanted = survey[MADE_WITH].iloc[0]
    made = outcomes[MADE_WITH].dropna().drop_duplicates()
    if other := [name for name in MADE_WITH if (made[name] != wanted[name]).any()]:
        told = ", ".join(
            f"{name} {' and '.join(map(str, made[name].unique()))} (survey: {wanted[name]})"
            for name in other
        )
        raise DldsimError(
            f"The survey was simulated with other numerics than this campaign: {told}.",
            key="surrogate.survey",
            value=True,
            allowed="false, or the survey's numerics",
            remedy=REMEDY,
        )
    return pd.concat([outcomes, survey.assign(source=SURVEY_SOURCE)], ignore_index=True)


def keep_survey(results: Path) -> None:
    """Make the survey of a results folder the one that comes with the package.

    Raises DldsimError as `read_table` does.
    """
    from dldsim.tables.parquet import describe, read_table, write_table

    made = Path(results) / "outcomes.parquet"
    write_table("outcomes", read_table("outcomes", made), SURVEY, describe(made)["provenance"])


if __name__ == "__main__":
    import sys

    keep_survey(Path(sys.argv[1]))
