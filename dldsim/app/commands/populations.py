"""Options that name two cell types and their scatter, and the request that they make."""

import argparse
from collections.abc import Collection, Mapping
from typing import Any

from dldsim.app.commands.options import add_option, number, option_of, place
from dldsim.app.commands.settings import given_by
from dldsim.config.design_sections import DEFORMABILITIES, DesignRequest, is_given
from dldsim.errors import DldsimError

SPREADS = ("deformation_index_std_{}", "ks_cv_{}")
ONE_OF = (DEFORMABILITIES, ("radius_std_{}_um", "radius_cv_{}"), SPREADS)
"""Fields of a cell type of which one excludes the others."""
OPTIONS = {
    "shape_{}": "--shape{}",
    "deformation_index_{}": "--di{}",
    "stiffness_set_{}": "--set{}",
    "ks_{}_uN_per_m": "--ks{}",
    "rigid_{}": "--rigid{}",
    "deformation_index_std_{}": "--di{}-std",
    "radius_{}_um": "--r{}",
    "radius_std_{}_um": "--r{}-std",
    "radius_cv_{}": "--r{}-cv",
    "ks_cv_{}": "--ks{}-cv",
}
"""Options of a cell type by the field that they set."""


def add_populations(parser: argparse.ArgumentParser) -> None:
    """Options of both cell types: shape, deformability, radius, scatter, measured cells."""
    for i in "12":
        add_option(parser, DesignRequest, f"shape_{i}", f"--shape{i}")
        cell = parser.add_mutually_exclusive_group()
        cell.add_argument(
            f"--di{i}",
            type=number,
            dest=f"deformation_index_{i}",
            metavar="DI",
            help=f"deformation index of cell type {i} by the assay, 0 to 1",
        )
        cell.add_argument(
            f"--set{i}",
            dest=f"stiffness_set_{i}",
            metavar="NAME",
            help=f"stiffness set of cell type {i}, instead",
        )
        cell.add_argument(
            f"--ks{i}",
            type=number,
            dest=f"ks_{i}_uN_per_m",
            metavar="µN/m",
            help=f"spring constant k_s of cell type {i}, instead",
        )
        cell.add_argument(
            f"--rigid{i}",
            action="store_const",
            const=True,
            dest=f"rigid_{i}",
            help=f"cell type {i} is a bead, instead; with --shape{i} sphere",
        )
        parser.add_argument(
            f"--di{i}-std",
            type=number,
            dest=f"deformation_index_std_{i}",
            metavar="X",
            help=f"spread of the deformation index among cells of type {i}; default 0",
        )
        add_option(parser, DesignRequest, f"radius_{i}_um", f"--r{i}")
        add_option(parser, DesignRequest, f"radius_std_{i}_um", f"--r{i}-std")
        add_option(parser, DesignRequest, f"radius_cv_{i}", f"--r{i}-cv")
        add_option(parser, DesignRequest, f"ks_cv_{i}", f"--ks{i}-cv")
        parser.add_argument(
            f"--population{i}",
            type=place,
            metavar="CSV",
            help=f"measured cells of type {i}: columns radius_um and, where it was measured, "
            "deformation_index or ks_uN_per_m; instead of the options for these and their spread",
        )
    add_option(parser, DesignRequest, "radius_distribution")
    add_option(parser, DesignRequest, "concentration_ratio")
    add_option(parser, DesignRequest, "assay")
    add_option(parser, DesignRequest, "velocity_mm_s", "--velocity")
    add_option(parser, DesignRequest, "height_um", "--height")


def _option(key: str) -> str:
    """The option that sets a field of a cell type."""
    for field, option in OPTIONS.items():
        for i in "12":
            if key == field.format(i):
                return option.format(i)
    return option_of(key)


def request_of(
    args: argparse.Namespace, base: Mapping[str, Any] | None = None, without: Collection[str] = ()
) -> tuple[dict[str, Any], tuple]:
    """Fields of a request, and measured cells of both types: the command line over ``base``, then
    mean and scatter of the measured cells over both. ``without``: options that mean something
    else. Raises DldsimError if nothing is said of how deformable a cell type is."""
    from dldsim.app.asked import check_measured, with_measured
    from dldsim.design.measured_cells import read_measured

    given = given_by(DesignRequest, args)
    given = {key: value for key, value in given.items() if key not in without}
    values = dict(base or {})
    for i in "12":
        for group in ONE_OF:
            keys = [key.format(i) for key in group]
            if any(key in given for key in keys):
                if group is DEFORMABILITIES:  # the spread was of what it replaces
                    keys += [key.format(i) for key in SPREADS]
                values = {key: value for key, value in values.items() if key not in keys}
    paths = [getattr(args, f"population{i}") for i in "12"]
    measured = tuple(None if path is None else read_measured(path) for path in paths)
    check_measured(given, measured, values, _option)
    values = with_measured(values | given, measured)
    for i, cells in zip("12", measured, strict=True):
        said = [values.get(key.format(i)) for key in DEFORMABILITIES]
        if not any(is_given(value) for value in said):
            options = f"--di{i}, --set{i}, --ks{i}, --rigid{i}"
            raise DldsimError(
                f"Nothing is said of how deformable cell type {i} is.",
                key=tuple(key.format(i) for key in DEFORMABILITIES),
                value=None,
                allowed=f"one of {options}",
                remedy=f"Give one of {options}, or measured cells with --population{i}"
                + (f" ({cells.source}: {cells.unused})." if cells and cells.unused else "."),
            )
    return values, measured
