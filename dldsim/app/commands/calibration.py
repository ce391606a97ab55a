"""An assay of one's own: `calibrate`."""

import argparse
from collections.abc import Iterable
from pathlib import Path

from dldsim.app.commands.options import add_command, add_config, number, place
from dldsim.app.commands.output import Display, check_writable, frame_lines, listing, records
from dldsim.app.commands.settings import configuration
from dldsim.config.assay_sections import AssayCell, Shape, TableAssay
from dldsim.config.assays import points_of, settings_of_point
from dldsim.config.configuration import Partial
from dldsim.config.explain import validate
from dldsim.config.feasibility import check_points
from dldsim.config.identifiers import point_id
from dldsim.errors import DldsimError


def calibrate(args: argparse.Namespace) -> tuple[dict, Iterable[str]]:
    """Simulate the passages of an assay for the stiffness sets, and write its calibration."""
    config = configuration(args.config) or Partial()
    name, config = _with_assay(args.assay, config)
    if not config.stiffness_sets:
        raise DldsimError(
            "calibrate: the membranes are the stiffness_sets of a configuration; there are none.",
            key="stiffness_sets",
            allowed="membranes by name",
            remedy="Name a configuration that has some with --config FILE.",
        )
    if args.shape or args.radius:
        cells = [
            validate(AssayCell, {"shape": shape, "radius_um": radius})
            for shape in args.shape or [config.cell.shape]
            for radius in args.radius or [config.cell.radius_um]
        ]
        own = config.assays[name].model_copy(update={"cells": cells})
        config = config.model_copy(update={"assays": {**config.assays, name: own}})
    points = points_of(name, config)
    check_points(points, config)
    output = args.output or Path(f"calibration-{name}")
    check_writable(output / "calibration.parquet", "--output")
    settings = {point_id(point): settings_of_point(point, config) for point in points}
    from dldsim.app.calibration_run import run_calibration

    with Display() as progress:
        table, files = run_calibration(name, settings, output, progress)
    shown = table[["assay", "cell_shape", "cell_radius_um", "group", "ks_uN_per_m", *RESULTS]]
    summary = {"assay": name, "rows": records(table), "files": [*map(str, files)]}
    return summary, [*frame_lines(shown), *listing({"files": summary["files"]})]


RESULTS = ("deformation_index", "deformation_index_std", "resolving_power", "resolving_power_all")


def _with_assay(given: str, config: Partial) -> tuple[str, Partial]:
    """Name of the assay, and the configuration with it: a file brings its own."""
    path = Path(given)
    if path.suffix not in (".yaml", ".yml"):
        from dldsim.config.assays import assay_of

        assay = assay_of(given, config)
        if isinstance(assay, TableAssay):
            raise DldsimError(
                f"Assay {given} is a published table: {assay.label}. There is nothing to simulate.",
                key="assay",
                value=given,
                allowed="a simulated assay",
            )
        return given, config.model_copy(update={"assays": {**config.assays, given: assay}})
    from dldsim.config.presets import read_layer

    name = path.stem
    found = validate(Partial, {"assays": {name: read_layer(path)}})
    return _with_assay(name, config.model_copy(update={"assays": found.assays}))


def add_calibrate(commands) -> None:
    """The command `calibrate`."""
    parser = add_command(
        commands,
        "calibrate",
        calibrate,
        "simulate an assay for the stiffness sets and write its calibration",
        "calibrate --assay mine.yaml --shape sphere --radius 6",
    )
    parser.add_argument(
        "--assay",
        required=True,
        metavar="NAME|FILE",
        help="a name from assays in the configuration, or a YAML file that holds the settings of "
        "one, whose name it has",
    )
    parser.add_argument(
        "--shape",
        nargs="+",
        choices=Shape.__args__,
        help="rest shapes; default: the cells of the assay, or the configuration's",
    )
    parser.add_argument(
        "--radius",
        type=number,
        nargs="+",
        metavar="µm",
        help="largest radii at rest; default: the cells of the assay, or the configuration's",
    )
    add_config(parser)
    parser.add_argument(
        "--output",
        type=place,
        metavar="DIR",
        help="folder of the passages, the calibration and its figure; started again, it goes on "
        "with what is there; default: calibration-NAME",
    )
