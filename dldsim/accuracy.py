"""Error of the migration angle against run time, one numerical setting at a time.

A few runs of known kind (bump, zigzag, near the transition) are repeated with one setting changed
through a list of values that ends with the finest. The error of a value is the difference of its
angle from that of the finest value of the same setting, everything else at its default; settings
interact, so the errors do not simply add.
"""

import json
import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from dldsim.config import Config, validate
from dldsim.errors import DldsimError

SECTIONS = ("numerics", "run_control", "cell")
"""Where a setting of the study may live."""
DEFAULT = "default"


class Variant(NamedTuple):
    """One run of the study: a case, and a setting at its ``rank``-th value."""

    case: str
    knob: str
    rank: int


def variant_id(variant: Variant) -> str:
    """Identifier such as bump--spacing_um--0."""
    return "--".join(map(str, variant))


def parse_variant(text: str) -> Variant:
    """The inverse of `variant_id`."""
    case, knob, rank = text.split("--")
    return Variant(case, knob, int(rank))


def variants(config: Config) -> list[Variant]:
    """All runs of the study; the default settings once per case."""
    study = config.accuracy
    changed = [
        (knob, rank)
        for knob, values in study.knobs.items()
        for rank, value in enumerate(values)
        if value != _default(knob, config)
    ]
    return [Variant(case, *k) for case in study.cases for k in [(DEFAULT, 0), *changed]]


def section_of(knob: str, config: Config) -> str:
    """The section that holds a setting. Raises DldsimError for an unknown one."""
    for section in SECTIONS:
        if knob in type(getattr(config, section)).model_fields:
            return section
    raise DldsimError(
        f"accuracy.knobs names {knob}, which is no key of {', '.join(SECTIONS)}."
    )


def settings_for(variant: Variant, config: Config) -> dict[str, Any]:
    """Everything that one run of the study depends on, as plain values."""
    case = config.accuracy.cases[variant.case]
    sections = {name: getattr(config, name) for name in (*SECTIONS, "flow")}
    value = None
    if variant.knob != DEFAULT:
        section = section_of(variant.knob, config)
        value = config.accuracy.knobs[variant.knob][variant.rank]
        model = type(sections[section])
        sections[section] = validate(
            model, sections[section].model_dump() | {variant.knob: value}
        )
    return {
        **{name: section.model_dump(mode="json") for name, section in sections.items()},
        "geometry": case.geometry.model_dump(mode="json"),
        "stiffness_set": case.stiffness_set,
        "stiffness": config.stiffness_sets[case.stiffness_set].model_dump(mode="json"),
    }


def table(rows: Iterable[tuple[Variant, Mapping[str, Any]]], config: Config) -> list[dict]:
    """Rows of `accuracy` from the runs of the study (variant, row of `runs`).

    The run at default settings stands for the default value of every setting.
    """
    runs = dict(rows)
    result = []
    for case in config.accuracy.cases:
        default = runs[Variant(case, DEFAULT, 0)]
        for knob, values in config.accuracy.knobs.items():
            study = [runs.get(Variant(case, knob, rank), default) for rank in range(len(values))]
            reference = study[-1]["migration_angle_deg"]
            for rank, (value, row) in enumerate(zip(values, study, strict=True)):
                angle = row["migration_angle_deg"]
                known = angle is not None and reference is not None
                result.append(
                    {
                        "case": case,
                        "knob": knob,
                        "setting": json.dumps(value),
                        "rank": rank,
                        "is_default": value == _default(knob, config),
                        "is_reference": rank == len(values) - 1,
                        "error_deg": abs(angle - reference) if known else None,
                        **{key: row[key] for key in COPIED},
                    }
                )
    return result


COPIED = (
    "migration_angle_deg", "bump_angle_deg", "mode", "status", "sigma_num_deg", "wall_time_s",
    "steps", "nodes", "vertices",
)  # fmt: skip


def _default(knob: str, config: Config):
    return getattr(getattr(config, section_of(knob, config)), knob)


def spread_deg(rows: Iterable[Mapping[str, Any]], case: str) -> float:
    """Root mean square deviation of a case's angles from that at default settings [°]."""
    rows = [r for r in rows if r["case"] == case and r["migration_angle_deg"] is not None]
    default = next(r["migration_angle_deg"] for r in rows if r["is_default"])
    others = [r["migration_angle_deg"] - default for r in rows if not r["is_default"]]
    return math.sqrt(sum(d * d for d in others) / len(others))
