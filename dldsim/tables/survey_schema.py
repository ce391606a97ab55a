"""Table of the points at which the survey is simulated."""

from dldsim.tables.column import ARRAY_AND_CELL, CAPILLARY, OUTCOME_ID, count, table, text

TABLES = {
    "survey_plan": table(
        "survey/plan.parquet",
        "survey",
        count("number", "number of the point"),
        count("round", "round; 0: the first points"),
        OUTCOME_ID,
        *ARRAY_AND_CELL,
        CAPILLARY,
        text("why", "why the point was chosen"),
    )
}
