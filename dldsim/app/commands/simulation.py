"""Simulations: `run`, `flow`, `constrict`."""

import argparse
from collections.abc import Iterable, Mapping
from pathlib import Path

from dldsim.app.commands.options import (
    add_command,
    add_config,
    add_fields,
    add_geometry,
    add_option,
    number,
    place,
)
from dldsim.app.commands.output import Display, check_writable, listing
from dldsim.app.commands.settings import (
    configuration,
    entry_of,
    geometry_of,
    given_by,
    refuse_idle,
    safety_distance_um,
    section_of,
)
from dldsim.config.assay_sections import GROUP_VELOCITY, ConstrictionAssay
from dldsim.config.assays import NOT_IN_ASSAYS, Membrane, passages_of
from dldsim.config.configuration import Partial
from dldsim.config.explain import validate
from dldsim.config.feasibility import check_gap, check_images, check_passable
from dldsim.config.sections import (
    CELL_NUMERICS,
    Cell,
    CellShape,
    Constriction,
    ConstrictionGroup,
    Flow,
    Numerics,
    RunControl,
)
from dldsim.errors import DldsimError


def run(args: argparse.Namespace) -> tuple[dict, Iterable[str]]:
    """One cell through one array: from one place of release, or a whole outcome."""
    from dldsim.config import identifiers

    config = configuration(args.config)
    geometry = geometry_of(args)
    cell = validate(Cell, (config.cell.model_dump() if config else {}) | given_by(Cell, args))
    flow, numerics = section_of(Flow, config, args), section_of(Numerics, config, args)
    control = _control(config, args)
    if cell.shape != "ellipsoid":
        refuse_idle(args, "for a cell that is no ellipsoid", "aspect_ratio")
    if numerics.coupling == "no-slip":
        refuse_idle(args, "with the no-slip coupling", "friction_nN_s_per_m")
    check_gap(geometry, safety_distance_um(config))
    check_passable(geometry, cell, flow.height_um)
    check_images(geometry, cell, numerics)
    stiffness = entry_of(config, "stiffness_sets", args.set, "--set")
    outcome = identifiers.outcome_id(identifiers.Pair(geometry, args.set))
    shown = [f"--{name}" for name in ("movie", "vtk") if getattr(args, name)]
    if shown and (args.out is None or args.releases is not None):
        raise DldsimError(
            f"{shown[0]} is of one release and is written to --out: give --out DIR, "
            "and no --releases."
        )
    if args.out:
        check_writable(args.out / f"{outcome}_y0.000.trajectory.parquet", "--out")
    from dldsim.analysis.uncertainty import model_of, numerical_uncertainty, read_models
    from dldsim.experiments import outcome_files
    from dldsim.experiments.array_outcome import simulate_outcome
    from dldsim.experiments.array_run import simulate_run
    from dldsim.experiments.vtk import Recorder

    recorder = Recorder() if shown else None
    sections = (geometry, stiffness, cell, flow, numerics, control)
    settings = {s.__class__.__name__: s.model_dump(mode="json") for s in sections}
    with Display() as progress:
        if args.releases is None:
            name = identifiers.run_id(outcome, cell.release_gap_fraction)
            result = simulate_run(
                *sections,
                run_id=name,
                outcome_id=outcome,
                stiffness_set=args.set,
                observe=recorder,
                progress=progress,
            )
        else:
            name = outcome
            result = simulate_outcome(
                *sections, outcome_id=outcome, stiffness_set=args.set, progress=progress
            )
    sigma = numerical_uncertainty(result.row, model_of(result.row, read_models()))
    summary = {**result.row, **sigma}
    if args.out:
        trajectory = args.out / f"{name}.trajectory.parquet"
        if args.releases is None:
            files = [args.out / f"{name}.run.parquet", trajectory]
            outcome_files.write_run(result, *files, settings)
            if shown:
                files += _show(args, recorder.shapes(geometry, result), result.row, settings)
        else:
            files = outcome_files.OutcomeFiles(
                args.out / f"{name}.outcome.parquet", args.out / f"{name}.runs.parquet", trajectory
            )
            result.row.update(sigma)
            outcome_files.write_outcome(result, files, settings)
        summary["files"] = [str(path) for path in files]
    return summary, listing(summary)


def _show(args: argparse.Namespace, shapes, row: Mapping, settings: Mapping) -> list[Path]:
    """Animation and VTKHDF files of one run, as asked for; returns what was written."""
    from dldsim.experiments.vtk import write_pillars, write_vtkhdf
    from dldsim.report.movie import write_animation

    name, files = row["run_id"], []
    if args.movie:
        angle = row["migration_angle_deg"]
        result = row["status"] if angle is None else f"{angle:.2f}°, {row['mode']}"
        files.append(args.out / f"{name}.passage.gif")
        write_animation(
            {f"set {args.set}, R {row['cell_radius_um']:g} µm: {result}": shapes}, files[-1]
        )
    if args.vtk:
        files += [args.out / f"{name}.vtkhdf", args.out / f"{name}.pillars.vtkhdf"]
        write_vtkhdf(shapes, files[-2], settings)
        write_pillars([shapes], files[-1])
    return files


def _control(config: Partial | None, args: argparse.Namespace) -> RunControl:
    """`run_control` with the command line over it; places of release are those of --releases."""
    base = config.run_control.model_dump() if config else {}
    for given, option, with_releases in (
        (args.outcome_rows_max, "--outcome-rows-max", False),
        (args.release_gap_fraction, "--release-gap-fraction", True),
    ):
        if given is not None and (args.releases is not None) == with_releases:
            raise DldsimError(
                f"{option} {given:g} has no effect {'with' if with_releases else 'without'} "
                f"--releases. Leave it out{'' if with_releases else ', or give --releases'}."
            )
    places = {"release_gap_fractions": args.releases} if args.releases else {}
    return validate(RunControl, base | given_by(RunControl, args) | places)


def flow(args: argparse.Namespace) -> tuple[dict, Iterable[str]]:
    """Flow through an array without a cell."""
    config = configuration(args.config)
    geometry = geometry_of(args)
    sections = [section_of(model, config, args) for model in (Flow, Numerics)]
    if args.out:
        check_writable(args.out, "--out")
    from dldsim.experiments import outcome_files
    from dldsim.solver.flow import solve_empty_array

    with Display() as progress:
        result = solve_empty_array(geometry, *sections, progress)
    summary = outcome_files.flow_row(result)
    if args.out:
        result.save(args.out)
        summary["files"] = [str(args.out)]
    return summary, listing(summary)


def constrict(args: argparse.Namespace) -> tuple[dict, Iterable[str]]:
    """One cell through the source's slit."""
    config = configuration(args.config)
    name, group = _constriction_group(config, args)
    channel = section_of(Constriction, config, args)
    release = args.release_position_um
    if release is None:
        release = channel.release_positions_um[0]
    given = {k: v for k, v in given_by(CellShape, args).items() if k != "axis"}  # the channel's
    cell = validate(CellShape, config.cell.model_dump() | given)
    flow = validate(
        Flow,
        config.flow.model_dump()
        | {k: v for k, v in given_by(Flow, args).items() if k == "viscosity_mPa_s"},
    )
    sections = [cell, flow, _channel_numerics(config, args)]
    if args.out:
        check_writable(args.out / f"{name}_at-{release:g}.trajectory.parquet", "--out")
    from dldsim.experiments import outcome_files
    from dldsim.experiments.assays import simulate_passage

    own = group.velocity_mm_s
    assay = ConstrictionAssay(kind="constriction", groups=True, channel=channel)
    first = passages_of(assay, cell.shape)[0]
    with Display() as progress:
        result = simulate_passage(
            GROUP_VELOCITY,
            assay,
            Membrane(name, group.stiffness, group.stiffness_set or "", own),
            *sections,
            first._replace(release_position_um=release),
            run_id=f"{name}_at-{release:g}",
            progress=progress,
        )
    summary = dict(result.row)
    if args.out:
        settings = {
            section.__class__.__name__: section.model_dump(mode="json")
            for section in (group, channel, *sections)
        }
        row = args.out / f"{summary['run_id']}.run.parquet"
        trajectory = args.out / f"{summary['run_id']}.trajectory.parquet"
        outcome_files.write_assay_runs([result], row, trajectory, settings)
        summary["files"] = [str(row), str(trajectory)]
    return summary, listing(summary)


def _channel_numerics(config: Partial, args: argparse.Namespace) -> Numerics:
    given = {k: v for k, v in given_by(Numerics, args).items() if k not in NOT_IN_ASSAYS}
    return validate(Numerics, config.numerics.model_dump() | given)


def _constriction_group(
    config: Partial | None, args: argparse.Namespace
) -> tuple[str, ConstrictionGroup]:
    if args.group is not None:
        name = args.group
        group = entry_of(config, "constriction_groups", name, "--group")
    else:
        entry_of(config, "stiffness_sets", args.set, "--set")
        groups = config.constriction_groups
        found = [name for name, group in groups.items() if group.stiffness_set == args.set]
        if not found:
            raise DldsimError(
                f"--set {args.set}: no constriction group has this stiffness set. Name one with "
                f"--group: {', '.join(groups)}."
            )
        name, group = found[0], groups[found[0]]
    return name, validate(ConstrictionGroup, group.model_dump() | given_by(ConstrictionGroup, args))


def add_run(commands) -> None:
    """The command `run`."""
    parser = add_command(
        commands,
        "run",
        run,
        "one cell through one array",
        "run --pillar-radius-um 10 --gap-um 20 --periodicity 6 --set 1 --out single",
    )
    add_geometry(parser)
    parser.add_argument(
        "--set",
        required=True,
        metavar="NAME",
        help="stiffness set, a name from stiffness_sets in the configuration",
    )
    add_fields(parser, "channel and flow", Flow)
    add_fields(parser, "cell", Cell)
    add_fields(parser, "numerics", Numerics)
    add_fields(parser, "when to stop", RunControl, without={"release_gap_fractions"})
    parser.add_argument(
        "--releases",
        type=number,
        nargs="*",
        metavar="X",
        help="simulate a whole outcome: release at these places in the gap, in "
        "this order, as many as it takes; none named: the configuration's",
    )
    add_config(parser)
    parser.add_argument(
        "--out",
        type=place,
        metavar="DIR",
        help="write the run, or the outcome with its runs, and the trajectory there, as Parquet",
    )
    parser.add_argument(
        "--movie", action="store_true", help="write an animation of the passage (GIF) there, too"
    )
    parser.add_argument(
        "--vtk",
        action="store_true",
        help="write membrane over time and pillars for ParaView (VTKHDF) there, too",
    )


def add_flow(commands) -> None:
    """The command `flow`."""
    parser = add_command(
        commands,
        "flow",
        flow,
        "flow through an array without a cell",
        "flow --pillar-radius-um 10 --gap-um 20 --periodicity 6 --drive axial --height-um 0 --json",
    )
    add_geometry(parser)
    add_fields(parser, "channel and flow", Flow)
    add_fields(parser, "numerics", Numerics, without=CELL_NUMERICS)
    add_config(parser)
    parser.add_argument("--out", type=place, metavar="FILE.npz", help="save the flow there")


def add_constrict(commands) -> None:
    """The command `constrict`."""
    parser = add_command(
        commands,
        "constrict",
        constrict,
        "one cell through the source's slit",
        "constrict --set 1 --json",
    )
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("--set", metavar="NAME", help="the group that calibrates this stiffness set")
    which.add_argument("--group", metavar="NAME", help="a name from constriction_groups")
    parser.add_argument(
        "--velocity-mm-s",
        type=number,
        metavar="mm/s",
        help="mean velocity in the wide channel; default: the group's",
    )
    parser.add_argument(
        "--release-position-um",
        type=number,
        metavar="µm",
        help="release along the flow, from the first possible position; "
        "default: the first of constriction.release_positions_um",
    )
    add_fields(parser, "channel", Constriction, without={"release_positions_um"})
    add_fields(parser, "cell", CellShape, without={"axis"})
    add_option(parser, Flow, "viscosity_mPa_s")
    add_fields(parser, "numerics", Numerics, without={*NOT_IN_ASSAYS})
    add_config(parser)
    parser.add_argument(
        "--out",
        type=place,
        metavar="DIR",
        help="write its row and its trajectory there, as Parquet",
    )
