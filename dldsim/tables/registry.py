"""All tables by kind: columns, file in results/, and the rule that makes it."""

import pyarrow as pa

from dldsim.errors import DldsimError
from dldsim.tables import (
    analysis_schema,
    calibration_schema,
    design_schema,
    evidence_schema,
    outlet_schema,
    simulation_schema,
    survey_schema,
)
from dldsim.tables.column import Column, Table

TABLES: dict[str, Table] = {
    **simulation_schema.TABLES,
    **calibration_schema.TABLES,
    **analysis_schema.TABLES,
    **design_schema.TABLES,
    **outlet_schema.TABLES,
    **evidence_schema.TABLES,
    **survey_schema.TABLES,
}
COLUMNS: dict[str, tuple[Column, ...]] = {kind: table.columns for kind, table in TABLES.items()}


def rule_of(kind: str | None) -> str:
    """The rule that makes a table; for a part of others, that which makes everything."""
    table = TABLES.get(kind or "")
    return table.rule if table and table.rule else "all"


def schema(kind: str) -> pa.Schema:
    """Arrow schema of one kind of table, with unit and description on each field."""
    if kind not in COLUMNS:
        known = ", ".join(COLUMNS)
        raise DldsimError(
            f"Unknown kind of table {kind!r}. Known: {known}.", value=kind, allowed=known
        )
    return pa.schema(
        pa.field(c.name, c.type, c.nullable, {"unit": c.unit, "description": c.description})
        for c in COLUMNS[kind]
    )
