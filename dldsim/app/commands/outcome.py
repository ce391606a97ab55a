"""What comes out of a device: `outcome`."""

import argparse
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dldsim.app.commands.options import (
    add_command,
    add_config,
    add_option,
    add_seed,
    option_of,
    place,
    whole,
)
from dldsim.app.commands.output import Display, check_writable, in_columns, optional, records
from dldsim.app.commands.populations import add_populations, request_of
from dldsim.app.commands.settings import configuration, given_by, safety_distance_um, seed_of
from dldsim.config.design_sections import DesignRequest, Device
from dldsim.config.explain import validate
from dldsim.config.sections import Geometry
from dldsim.errors import DldsimError
from dldsim.files import atomic_path
from dldsim.vocabulary import GEOMETRY

if TYPE_CHECKING:
    from dldsim.app.asked import Asked
    from dldsim.app.outcome_answers import Design

DEVICE = ("array_length_mm", "array_width_mm", "sample_position_mm", "sample_width_um", "outlets")
"""Settings of the device that have options."""
ACTS = (*DEVICE, "divider_um", "outlet_walls_um")
"""Settings of the device that what comes out depends on."""


def outcome(args: argparse.Namespace) -> tuple[dict, Iterable[str]]:
    """Purity and recovery of two populations at the outlets of a device."""
    from dldsim.app import outcome_answers
    from dldsim.app.asked import ask
    from dldsim.app.design_answers import resolve_by
    from dldsim.design import finished_campaign
    from dldsim.design.device_outcome import tables_of, warnings_of
    from dldsim.design.populations import doubt

    config = configuration(args.config)
    designs = _designs(args, None if config is None else config.device)
    output = args.output
    if args.simulate is not None:
        output = output or Path(f"outcome-{designs[0].name}")
    if output is not None:
        check_writable(output / "outcome.html", "--output")
    if args.csv is not None:
        check_writable(args.csv, "--csv")
    values, measured = request_of(args, designs[0].request, GEOMETRY)
    request = validate(DesignRequest, {"name": designs[0].name} | values)
    request = finished_campaign.with_default_assay(config, request)
    seed = seed_of(config, args)
    known = finished_campaign.read_campaign(
        args.results or finished_campaign.packaged_campaign(),
        designs[0].device,
        safety_distance_um(config),
    )
    finished_campaign.check_settings(config, known, request, args.simulate is not None)
    asked = ask(request, resolve_by(known, request), known.tables, measured)
    found = outcome_answers.make_outcomes(asked, designs, known, seed, from_outlet=args.from_outlet)
    tables = tables_of(found)
    if args.simulate is not None:
        with Display() as progress:
            tables |= outcome_answers.check_by_simulation(
                asked, designs[0], found[0], known, args.simulate, seed, output / "cells", progress
            )
    files = []
    if args.csv is not None:
        with atomic_path(args.csv) as part:
            tables["device_outcomes"].to_csv(part, index=False)
        files.append(str(args.csv))
    if output is not None:
        about = outcome_answers.about_outcome(asked, known, designs, seed)
        files += [str(path) for path in outcome_answers.write_outcomes(tables, output, about)]
    summary = {
        "doubt": doubt(asked.populations),
        "request": request.model_dump(),
        "designs": [d.geometry.model_dump() | {"name": d.name} for d in designs],
        "device": designs[0].device.model_dump(),
        "learnt": known.model.holds_for,
        "notes": [*_notes(args, designs, asked), *asked.notes, *warnings_of(found)],
        "outcomes": records(tables["device_outcomes"]),
        "outlets": records(tables["device_outlets"]),
        "checks": records(tables["device_checks"]) if "device_checks" in tables else None,
        "seed": seed,
        "files": files,
    }
    return summary, _lines(summary)


def _designs(args: argparse.Namespace, device: Device | None) -> list:
    """The first design, and the second if there is one; options of the device over its own.

    ``device``: of the configuration, which must not contradict that of a design.
    """
    from dldsim.app.outcome_answers import Design, read_design

    place = given_by(Geometry, args)
    if (args.design is None) == (not place):
        raise DldsimError(
            "outcome: an array by --design FILE, or by --pillar-radius-um, --gap-um and "
            "--periodicity.",
            key=("design", "pillar_radius_um"),
            allowed="one of both",
        )
    if (args.then is None) != (args.from_outlet is None):
        raise DldsimError(
            "outcome: --then FILE and --from-outlet N go together: the outlet of the first device "
            "that feeds the second.",
            key=("then", "from_outlet"),
            allowed="both or none",
        )
    own = given_by(Device, args)
    if args.design is None:
        base = Device() if device is None else device
        first = Design("array", validate(Geometry, place), base, {})
    else:
        first = read_design(args.design)
        _check_device(device, first, own)
    given = first.device.model_dump() | own
    if args.design is not None and "outlets" in own:
        given["outlet_walls_um"] = None  # other outlets than those of the mask
    try:
        designs = [first._replace(device=validate(Device, given))]
    except DldsimError as error:
        if args.design is None or given["outlet_walls_um"] is None:
            raise
        raise DldsimError(
            f"{first.name} with {', '.join(map(option_of, own))}: {error}\nIts mask has walls at "
            f"{_places(given['outlet_walls_um'])}; --outlets places them anew.",
            key=error.keys,
            value=error.value,
            allowed=error.allowed,
        ) from error
    if args.then is None:
        return designs
    second = read_design(args.then)
    _check_device(device, second)
    return [*designs, second]


def _check_device(config: Device | None, design: "Design", own: Collection[str] = ()) -> None:
    """Refuse settings that a configuration names and a design was made without; ``own``: those that
    an option goes over. Raises DldsimError."""
    for key in ACTS if config is not None else ():
        value = getattr(config, key)
        made = [getattr(d, key) for d in (design.asked, design.device) if d is not None]
        if key == "outlets":
            made = [2 if v is None else v for v in made]
        if key not in config.model_fields_set or value is None or key in own or value in made:
            continue
        remedy = f"give {option_of(key)} to change the device, or " if key in DEVICE else ""
        raise DldsimError(
            f"device.{key} = {value} in the configuration, but {design.name} was made with "
            f"{made[0]}.",
            key=f"device.{key}",
            value=value,
            allowed=str(made[0]),
            remedy=f"To have the other, {remedy}design anew with this configuration; else take the "
            "setting out of it.",
        )


def _places(walls_um: Sequence[float]) -> str:
    return f"{', '.join(f'{wall:.0f}' for wall in walls_um)} µm"


def _notes(args: argparse.Namespace, designs: Sequence["Design"], asked: "Asked") -> list[str]:
    """What an answer must say of designs that are looked at otherwise than they were made."""
    from dldsim.design.task import CELL_TYPES

    notes = []
    first = designs[0]
    changed = [option_of(key) for key in given_by(Device, args) if key != "outlets"]
    if args.design is not None and changed and first.device.outlet_walls_um:
        notes.append(
            f"with {', '.join(changed)} the walls between the outlets stay where the mask of "
            f"{first.name} has them ({_places(first.device.outlet_walls_um)}); --outlets places "
            "them anew"
        )
    for second in designs[1:]:
        made = validate(DesignRequest, {"name": second.name} | second.request)
        flow = asked.populations[0].flow
        here = {"velocity_mm_s": flow.mean_velocity_mm_s, "height_um": flow.height_um}
        other = {
            key: (getattr(made, key), here.get(key, getattr(asked.request, key)))
            for key in (*CELL_TYPES, "assay", *here)
            if getattr(made, key) is not None or key not in here
        }
        other = {key: (a, b) for key, (a, b) in other.items() if a != b}
        if other:
            notes.append(
                f"{second.name} was made for "
                + ", ".join(f"{key} = {a}" for key, (a, _) in other.items())
                + "; here it is taken with the cells and the flow of the first device: "
                + ", ".join(f"{key} = {b}" for key, (_, b) in other.items())
            )
    return notes


def _lines(summary: Mapping) -> list[str]:
    lines = [
        *filter(None, [summary["doubt"]]),
        *outcome_lines(summary["outcomes"], summary["notes"]),
        "",
    ]
    lines += in_columns(
        {
            "stage": [str(o["stage"]) for o in summary["outlets"]],
            "outlet": [str(o["outlet"]) for o in summary["outlets"]],
            "from [µm]": [f"{o['low_um']:.0f}" for o in summary["outlets"]],
            "to [µm]": [f"{o['high_um']:.0f}" for o in summary["outlets"]],
            "collects": [f"type {o['collects']}" for o in summary["outlets"]],
            **{
                name: [_interval(o, key) for o in summary["outlets"]]
                for name, key in (
                    ("of type 1", "cells_1"),
                    ("of type 2", "cells_2"),
                    ("type 1 among its cells", "purity_1"),
                )
            },
        }
    )
    lines += ["", f"learnt: {summary['learnt']}"]
    if summary["checks"] is None:
        lines.append("Add --simulate 40 to simulate cells drawn from both populations.")
    else:
        lines += ["", *_check_lines(summary["checks"])]
    return lines + [f"written: {path}" for path in summary["files"]]


def _interval(row: Mapping, key: str) -> str:
    if row[key] is None:
        return "–"
    return f"{row[key]:.1%} ({row[f'{key}_low']:.1%} to {row[f'{key}_high']:.1%})"


def outcome_lines(rows: Sequence[Mapping], notes: Sequence[str]) -> list[str]:
    """Purity and recovery of devices, to be read."""
    if not rows:
        return list(notes)
    lines = ["At the outlets (predicted; median and 90 % interval over draws of the array):"]
    several = len({row["device"] for row in rows}) > 1
    lines += in_columns(
        {
            "device": [row["device"] if several else "" for row in rows],
            "stage": [str(row["stage"]) if rows[-1]["stage"] > 1 else "" for row in rows],
            "type": [str(row["population"]) for row in rows],
            "outlet": [row["outlet"] for row in rows],
            "purity": [_interval(row, "purity") for row in rows],
            "recovery": [_interval(row, "recovery") for row in rows],
            "enrichment": [optional(row["enrichment"], ".3g") for row in rows],
            "clogs": [optional(row["lost"], ".1%") for row in rows],
            "not learnt": [f"{row['extrapolated']:.0%}" for row in rows],
        }
    )
    lines.append("")
    lines += in_columns(
        {
            "device": [row["device"] if several else "" for row in rows[::2]],
            "stage": [str(row["stage"]) if rows[-1]["stage"] > 1 else "" for row in rows[::2]],
            "nine of ten exceed": [optional(row["purity_recovery"], ".1%") for row in rows[::2]],
            "wall at [µm]": [f"{row['cut_um']:.0f}" for row in rows[::2]],
            "90 % after [mm]": [optional(row["length_90_mm"], ".3g") for row in rows[::2]],
            "95 % after [mm]": [optional(row["length_95_mm"], ".3g") for row in rows[::2]],
            "array [mm]": [f"{row['array_length_mm']:.4g}" for row in rows[::2]],
            "sample [µL/h]": [f"{row['sample_uL_per_h']:.3g}" for row in rows[::2]],
        }
    )
    return [
        *lines,
        "",
        "purity: share of the type among the cells of its outlet; recovery: share of its cells "
        "that leave there; nine of ten exceed: smallest of both purities and both recoveries",
        *(f"note: {note}" for note in notes),
    ]


def _check_lines(rows: Sequence[Mapping]) -> list[str]:
    lines = ["Simulated cells beside the prediction for the nominal array:"]
    lines += in_columns(
        {
            "type": [str(r["population"]) for r in rows],
            "simulated": [str(r["simulated"]) for r in rows],
            "at its outlet": [str(r["own"]) for r in rows],
            "clog": [str(r["lost"]) for r in rows],
            "not settled": [str(r["open"]) for r in rows],
            "failed": [str(r["failed"]) for r in rows],
            "predicted": [_interval(r, "predicted") for r in rows],
            "simulated recovery": [_interval(r, "recovery") for r in rows],
            "chances": [f"{r['chance_outlet']:.2g}, {r['chance_exit']:.2g}" for r in rows],
            "agrees": ["yes" if r["agrees"] else "no" for r in rows],
        }
    )
    return [
        *lines,
        "chances: by the prediction with its error, of the count at the outlet and of the exits, "
        "and of all that is as unlikely; they do not agree below 0.05",
    ]


def add_outcome(commands) -> None:
    """The command `outcome`."""
    parser = add_command(
        commands,
        "outcome",
        outcome,
        "purity and recovery of two populations at the outlets of a device",
        "outcome --design mine/files/request-candidate-1.json --population1 a.csv --r2-cv 0.1",
    )
    array = parser.add_argument_group("array, by a file or by itself")
    array.add_argument(
        "--design",
        type=place,
        metavar="FILE",
        help="the .json file of a design: array, device and walls between outlets as its mask has "
        "them, and its cell types, which the options go over",
    )
    for key in Geometry.model_fields:
        add_option(array, Geometry, key)
    device = parser.add_argument_group("device")
    for key in DEVICE:
        add_option(device, Device, key)
    add_populations(parser)
    for key in ("tolerance_um", "draws", "cells"):
        add_option(parser, DesignRequest, key)
    parser.add_argument(
        "--then",
        type=place,
        metavar="FILE",
        help="the .json file of a second design, which an outlet of the first feeds",
    )
    parser.add_argument(
        "--from-outlet",
        type=whole,
        metavar="N",
        help="that outlet of the first device, counted from the lower side wall",
    )
    parser.add_argument(
        "--simulate",
        type=whole,
        metavar="CELLS",
        help="simulate so many cells, half of each population, in the first array (minutes); an "
        "interrupted check goes on where it stopped",
    )
    add_seed(parser)
    parser.add_argument(
        "--results",
        type=place,
        metavar="DIR",
        help="folder of a finished campaign; default: the campaign that comes with the package",
    )
    parser.add_argument(
        "--output",
        type=place,
        metavar="DIR",
        help="write tables (Parquet and CSV), outcome.png and outcome.html there; default with "
        "--simulate: outcome-NAME",
    )
    parser.add_argument(
        "--csv", type=place, metavar="FILE", help="write purity and recovery as CSV there"
    )
    add_config(parser)
