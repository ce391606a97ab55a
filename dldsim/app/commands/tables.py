"""Tables that are there: `anova`, `stiffness`, `transition`, `info`."""

import argparse
import math
from collections.abc import Iterable
from typing import Any

from dldsim.app.commands.options import add_command, number, place, seed
from dldsim.app.commands.output import check_writable, frame_lines, in_columns, listing, records
from dldsim.errors import DldsimError


def anova(args: argparse.Namespace) -> tuple[dict, Iterable[str]]:
    """Analysis of variance of anybody's table of outcomes."""
    from dldsim.analysis.anova import analyse
    from dldsim.analysis.table_sensitivity import sobol_of_table
    from dldsim.config.provenance import derive_seed
    from dldsim.tables.user_table import read_user_table

    frame, found, _ = read_user_table(args.table)
    result, residuals = analyse(frame, derive_seed(args.seed, "anova"))
    summary = {
        "table": str(args.table),
        "found": found,
        "rows": records(result),
        "diagnostics": records(residuals),
        "sobol": [],
        "sobol_notes": [],
    }
    lines = [
        *(f"{args.table}: {note}" for note in found),
        "Type II analysis of variance of migration_angle_deg",
        *frame_lines(result),
        "",
        "Residuals of the models",
        *frame_lines(residuals),
        "",
        "Sobol indices of a surrogate fitted to the table",
    ]
    try:
        indices, notes = sobol_of_table(frame, derive_seed(args.seed, "sensitivity"))
    except DldsimError as error:
        summary["sobol_refused"] = str(error)
        return summary, [*lines, f"none: {error}"]
    summary |= {"sobol": records(indices), "sobol_notes": notes}
    return summary, [*lines, *frame_lines(indices), *(f"note: {note}" for note in notes)]


def stiffness(args: argparse.Namespace) -> tuple[dict, Iterable[str]]:
    """Moduli of a cell with a measured deformation index."""
    from dldsim.analysis.calibration import stiffness_for, with_library
    from dldsim.design.finished_campaign import packaged_campaign
    from dldsim.tables.parquet import read_table
    from dldsim.tables.user_table import read_user_table

    shape, radius_um = args.shape, args.radius
    if args.calibration:
        table = read_user_table(args.calibration).frame
    else:
        folder = args.results or packaged_campaign()
        table = read_table("calibration", folder / "calibration.parquet")
        library = folder / "calibration_library.parquet"
        own = table[table["cell_shape"] != ""]
        if (shape, radius_um) != (None, None) and library.exists():
            table = with_library([table, read_table("calibration_library", library)])
        shape = _only(own["cell_shape"]) if shape is None else shape
        radius_um = _only(own["cell_radius_um"]) if radius_um is None else radius_um
    found = stiffness_for(args.di, table, args.error, args.assay, shape=shape, radius_um=radius_um)
    summary = {"deformation_index": args.di, "error": args.error} | found
    return summary, listing(summary)


def _only(values) -> Any:
    """The one value of a column, None where there are none or several."""
    return values.iloc[0] if values.nunique() == 1 else None


def transition(args: argparse.Namespace) -> tuple[dict, Iterable[str]]:
    """Critical gaps by the surrogate over the capillary number, by shape and N_p."""
    from dldsim.analysis.surrogate import LEVEL, load
    from dldsim.analysis.transition import HEIGHT, PILLAR_RADIUS, transition_map
    from dldsim.design.finished_campaign import packaged_campaign

    if args.figure:
        check_writable(args.figure, "--figure")
        if args.figure.suffix.lower() != ".png":
            raise DldsimError(
                f"--figure {args.figure}: figures are PNG files.",
                key="--figure",
                value=str(args.figure),
                allowed="a name that ends with .png",
            )
    folder = args.results or packaged_campaign()
    surrogate = load(folder / "surrogate.json", folder / "surrogate_card.json")
    table = transition_map(surrogate)
    summary = {
        "learnt": surrogate.holds_for,
        "level": LEVEL,
        "pillar_radius_over_cell_radius": PILLAR_RADIUS,
        "height_over_cell_radius": HEIGHT,
        "rows": records(table),
    }
    lines = [
        f"learnt: {surrogate.holds_for}",
        f"Critical gap P_g/2R beside pillars of {PILLAR_RADIUS:g} R in channels {HEIGHT:.3g} R "
        f"high, with where the {100 * LEVEL:g} % interval holds half of the bump displacement:",
        *in_columns(_transition_columns(table)),
    ]
    if args.figure:
        from dldsim.files import atomic_path
        from dldsim.report.style import render
        from dldsim.report.transition_figures import draw_transition

        with atomic_path(args.figure) as part:
            part.write_bytes(render(draw_transition(table, LEVEL), "png"))
        summary["figure"] = str(args.figure)
        lines.append(f"written: {args.figure}")
    return summary, lines


def _transition_columns(table) -> dict[str, list[str]]:
    """Of every shape and N_p the stiffest, the middle and the softest cell."""
    groups = [g for _, g in table.groupby(["cell_shape", "periodicity"])]

    def told(row) -> str:
        gaps = [row[f"gap_over_2R{end}"] for end in ("", "_low", "_high")]
        place = "{:.2f} ({:.2f} to {:.2f})".format(*gaps)
        if math.isnan(gaps[0]):
            place = "not in what was learnt"
        return f"{place} at Ca {row['capillary_number']:.3g}"

    return {
        "cells": [g["cell_shape"].iloc[0] for g in groups],
        "N_p": [str(g["periodicity"].iloc[0]) for g in groups],
    } | {
        name: [told(g.iloc[int(share * (len(g) - 1))]) for g in groups]
        for name, share in (("stiffest", 0), ("between", 0.5), ("softest", 1))
    }


def info(args: argparse.Namespace) -> tuple[dict, Iterable[str]]:
    """What a table holds and where it comes from."""
    from dldsim.tables.parquet import describe

    about = describe(args.file)
    origin = ", ".join(f"{k} {v}" for k, v in about["provenance"].items() if k != "settings")
    lines = [f"{about['file']}: {about['kind']}, {about['rows']} rows", f"made by: {origin}", ""]
    width = max(len(column["name"]) for column in about["columns"])
    lines += [
        f"{c['name']:{width}}  {c['unit']:8}  {c['description']}"
        f"{' (null: not measured)' if c['nullable'] else ''}"
        for c in about["columns"]
    ]
    return about, lines


def add_anova(commands) -> None:
    """The command `anova`."""
    parser = add_command(
        commands,
        "anova",
        anova,
        "analysis of variance of the migration angle",
        "anova results/outcomes.parquet",
    )
    parser.add_argument(
        "table",
        type=place,
        metavar="TABLE",
        help="CSV or Parquet with the columns pillar_radius_um, gap_um, "
        "periodicity, deformation_index and migration_angle_deg, and "
        "stiffness_set if there are sets",
    )

    parser.add_argument(
        "--seed",
        type=seed,
        default=1,
        metavar="N",
        help="of permutations and surrogate; default %(default)s",
    )


def add_stiffness(commands) -> None:
    """The command `stiffness`."""
    parser = add_command(
        commands,
        "stiffness",
        stiffness,
        "moduli for a measured deformation index",
        "stiffness --di 0.08 --error 0.005",
    )
    parser.add_argument(
        "--di",
        type=number,
        required=True,
        metavar="DI",
        help="deformation index, inside the calibrated range",
    )
    parser.add_argument(
        "--error",
        type=number,
        default=0.0,
        metavar="±DI",
        help="standard error of it; default %(default)s",
    )
    parser.add_argument(
        "--assay",
        metavar="NAME",
        help="how the index was measured: an assay of the calibration; default: its default one",
    )
    parser.add_argument(
        "--shape",
        choices=["biconcave", "sphere"],
        help="rest shape of the cell; default: the campaign's, or the only one of a file",
    )
    parser.add_argument(
        "--radius",
        type=number,
        metavar="µm",
        help="its largest radius at rest; default: the campaign's, or the only one of a file",
    )
    parser.add_argument(
        "--results",
        type=place,
        metavar="DIR",
        help="campaign whose calibration is taken; default: the campaign that "
        "comes with the package",
    )
    parser.add_argument(
        "--calibration",
        type=place,
        metavar="FILE",
        help="calibration, CSV or Parquet, instead of the one in the results folder",
    )


def add_transition(commands) -> None:
    """The command `transition`."""
    parser = add_command(
        commands,
        "transition",
        transition,
        "critical gaps by the surrogate over the capillary number",
        "transition --figure transition.png",
    )
    parser.add_argument(
        "--results",
        type=place,
        metavar="DIR",
        help="campaign whose surrogate is asked; default: the campaign that comes with the package",
    )
    parser.add_argument("--figure", type=place, metavar="FILE", help="draw them there, as PNG")


def add_info(commands) -> None:
    """The command `info`."""
    parser = add_command(
        commands,
        "info",
        info,
        "columns, units and provenance of a table",
        "info results/outcomes.parquet",
    )
    parser.add_argument("file", type=place, metavar="FILE", help="a Parquet table of dldsim")
