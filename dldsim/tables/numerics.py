"""The settings of `Numerics` as columns of `runs` and `outcomes`: what was asked for."""

from collections.abc import Mapping
from typing import Any

from dldsim.config.sections import Numerics

COLUMN_OF = {name: name for name in Numerics.model_fields} | {
    "spacing_um": "wanted_spacing_um",
    "velocity_lu": "wanted_velocity_lu",
    "rows": "rows_in_domain",
    "lanes": "lanes_in_domain",
}
"""Column of each setting: its own name, but where that is the column of what was used in the end,
or says too little beside rows that a cell has passed."""


def columns_of(numerics: Numerics) -> dict[str, Any]:
    """Values by column."""
    return {COLUMN_OF[name]: value for name, value in numerics}


def settings_of(row: Mapping[str, Any]) -> dict[str, Any]:
    """Values by setting, of a row that has the columns."""
    return {name: row[column] for name, column in COLUMN_OF.items()}
