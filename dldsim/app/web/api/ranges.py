"""What requests may cost at most: ranges beside those of the configuration."""

from typing import Any

from pydantic import BaseModel, field_validator

LARGEST = {
    "radius_1_um": 50.0,
    "radius_2_um": 50.0,
    "deformation_index_std_1": 1.0,
    "deformation_index_std_2": 1.0,
    "pillar_radius_um": 100.0,
    "gap_um": 200.0,
    "periodicity": 100,
    "tolerance_um": 10.0,
    "height_tolerance_um": 10.0,
    "pillar_aspect_ratio_max": 100.0,
    "lateral_separation_um": 1e5,
    "pressure_max_kPa": 1e5,
    "startup_trials": 1000,
    "trials": 1000,
    "grid_steps": 33,
    "draws": 1024,
    "cells": 1024,
    "candidates": 10,
    "radius_std_1_um": 25.0,
    "radius_std_2_um": 25.0,
    "concentration_ratio": 1e6,
    "footprint_max_mm2": 1e4,
    "sample_min_uL_per_h": 1e6,
}
"""Largest values that the service takes, beside the ranges of the configuration: they bound what a
request can cost. The number of trials may be limited further by the settings of the service."""
SMALLEST = {
    "radius_1_um": 0.1,
    "radius_2_um": 0.1,
    "pillar_radius_um": 0.1,
    "gap_um": 0.1,
    "pillar_aspect_ratio_max": 0.01,
    "lateral_separation_um": 0.1,
    "pressure_max_kPa": 1e-9,
    "concentration_ratio": 1e-6,
    "footprint_max_mm2": 1e-6,
    "sample_min_uL_per_h": 1e-9,
}
"""Smallest values: positive ones below make numbers that overflow."""


def _no_flag(cls: type[BaseModel], value: Any, info: Any) -> Any:
    """Refuse true and false where a number is asked for, which they would count as."""
    given = value if isinstance(value, list | tuple) else [value]
    if cls.model_fields[info.field_name].annotation is not bool and any(
        isinstance(v, bool) for v in given
    ):
        raise ValueError("a value of this field, not true or false")
    return value


def no_flags() -> Any:
    """Validator of a request's fields against true and false in place of numbers."""
    return field_validator("*", mode="before")(classmethod(_no_flag))


def _in_range(cls: type[BaseModel], value: Any, info: Any) -> Any:
    """Refuse what costs too much or overflows."""
    least, most = SMALLEST.get(info.field_name), LARGEST[info.field_name]
    for number in value if isinstance(value, tuple) else (value,):
        if number is not None and number > most:
            raise ValueError(f"this service takes up to {most:g}")
        if number is not None and least is not None and number < least:
            raise ValueError(f"this service takes {least:g} or more, up to {most:g}")
    return value


def in_range(*names: str) -> Any:
    """Validator of a request's fields against LARGEST and SMALLEST."""
    return field_validator(*names)(classmethod(_in_range))
