"""What a form needs to know of the fields of a request: range, unit, default and meaning."""

from functools import cache
from typing import Any

from pydantic import BaseModel

from dldsim.app.web.api.ranges import LARGEST, SMALLEST


class FieldLimit(BaseModel):
    """What a form needs to know of one field of a request."""

    name: str
    minimum: float | None
    exclusive_minimum: bool
    maximum: float | None
    default: Any
    unit: str
    description: str
    choices: list[str] | None = None


@cache
def limits_of(model: type[BaseModel]) -> list[FieldLimit]:
    """Ranges, units, defaults and meanings of the fields of a request."""
    units = {"_um": "µm", "_deg": "°", "_kPa": "kPa", "_mm_s": "mm/s", "_uN_per_m": "µN/m"}
    units |= {"_mm": "mm", "_mm2": "mm²", "_uL_per_h": "µL/h"}
    found, properties = [], model.model_json_schema()["properties"]
    for name, field in model.model_fields.items():
        schema = properties[name]
        parts = [schema, *schema.get("anyOf", []), *schema.get("prefixItems", [])]
        at = {
            key: part[key]
            for part in reversed(parts)
            for key in ("minimum", "exclusiveMinimum", "maximum")
            if key in part
        }
        most = min(filter(None, (at.get("maximum"), LARGEST.get(name))), default=None)
        low = SMALLEST.get(name, at.get("minimum", at.get("exclusiveMinimum")))
        default = None if field.is_required() else field.default
        stem = name[:-2] if name[-2:] in ("_1", "_2") else name
        found.append(
            FieldLimit(
                name=name,
                minimum=low,
                maximum=most,
                exclusive_minimum="exclusiveMinimum" in at and name not in SMALLEST,
                default=default,
                description=field.description or "",
                unit=next((u for end, u in units.items() if stem.endswith(end)), ""),
                choices=schema.get("enum"),
            )
        )
    return found
