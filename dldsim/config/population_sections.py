"""Scatter among the cells of two populations, their mixture, and how finely it is drawn."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from dldsim.config.sections import Section, Unfit

Variation = Annotated[float, Field(ge=0, le=1)]  # a fraction; above 1 it is a percentage
DRAWS_MAX = 4_000_000
"""Draws of devices times cells: some minutes and 1 GB."""


OUTLET_DRAWS, ANGLE_DRAWS = 1024, 64
"""Draws of an array unless a request says how many: what nine of ten exceed at the outlets has then
a standard deviation of two per cent. Angles are compared by fewer, in many more arrays."""


class CellScatter(Section):
    """How the cells of both types scatter about the radius and the stiffness that a request names.

    Without anything said here, all cells of a type are alike.
    """

    radius_std_1_um: Annotated[float, Field(ge=0, le=1000)] | None = Field(
        None,
        description="standard deviation of the radius among cells of the first type; default 0",
    )
    radius_std_2_um: Annotated[float, Field(ge=0, le=1000)] | None = Field(
        None,
        description="standard deviation of the radius among cells of the second type; default 0",
    )
    radius_cv_1: Variation | None = Field(
        None, description="the same over the mean (0.1: 10 %), instead of radius_std_1_um"
    )
    radius_cv_2: Variation | None = Field(
        None, description="the same over the mean (0.1: 10 %), instead of radius_std_2_um"
    )
    radius_distribution: Literal["normal", "lognormal"] = Field(
        "normal", description="distribution of the radii; a normal one is cut off at zero"
    )
    ks_cv_1: Variation | None = Field(
        None,
        description="coefficient of variation (0.1: 10 %) of k_s among cells of the first type, "
        "lognormal; default: what the spread of the deformation index gives, or 0",
    )
    ks_cv_2: Variation | None = Field(
        None,
        description="coefficient of variation (0.1: 10 %) of k_s among cells of the second type, "
        "lognormal; default: what the spread of the deformation index gives, or 0",
    )
    concentration_ratio: float = Field(
        1.0,
        gt=0,
        le=1e9,
        description="cells of the first type for each of the second, in the sample",
    )
    draws: Annotated[int, Field(ge=8, le=4096)] | None = Field(
        None,
        description="Monte Carlo draws of an array: fabrication, and error of the prediction; "
        f"default {OUTLET_DRAWS} at the outlets and {ANGLE_DRAWS} where angles are compared",
    )
    cells: int = Field(
        64, ge=16, le=65_536, description="cells of each type that are drawn in each of these"
    )

    @model_validator(mode="after")
    def _scatter_once(self) -> "CellScatter":
        for i in "12":
            both = f"radius_std_{i}_um", f"radius_cv_{i}"
            if None not in (getattr(self, both[0]), getattr(self, both[1])):
                raise Unfit(f"one of {both[0]} and {both[1]}", *both)
        if self.outlet_draws * self.cells > DRAWS_MAX:
            raise Unfit(
                f"draws times cells at most {DRAWS_MAX:,}, not {self.outlet_draws * self.cells:,}",
                "draws",
                "cells",
            )
        return self

    @property
    def outlet_draws(self) -> int:
        """Draws of an array for what comes out of a device."""
        return OUTLET_DRAWS if self.draws is None else self.draws

    @property
    def angle_draws(self) -> int:
        """Draws of an array in which angles are compared."""
        return ANGLE_DRAWS if self.draws is None else self.draws
