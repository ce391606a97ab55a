"""Designs: `design`."""

import argparse
import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from dldsim.app.commands.options import (
    add_command,
    add_config,
    add_option,
    add_seed,
    number,
    option_of,
    place,
    whole,
)
from dldsim.app.commands.outcome import outcome_lines
from dldsim.app.commands.output import Display, check_writable, in_columns, optional, records
from dldsim.app.commands.populations import add_populations, request_of
from dldsim.app.commands.settings import configuration, refuse_idle, safety_distance_um, seed_of
from dldsim.config.configuration import Sweep
from dldsim.config.design_sections import DesignRequest, Device, Verification
from dldsim.config.explain import check_value, validate
from dldsim.vocabulary import together

LENGTH_LIMITS = ("footprint_max_mm2", "pressure_max_kPa")
"""What limits the length of an array beside the device, with the objective purity-recovery."""


def design(args: argparse.Namespace) -> tuple[dict, Iterable[str]]:
    """Geometries that separate two cell types best."""
    from dldsim.app import design_answers
    from dldsim.design import finished_campaign
    from dldsim.design.device_outcome import SUMMED_UP, tables_of
    from dldsim.design.populations import doubt

    values, measured = request_of(args)
    request = validate(DesignRequest, values | {"name": args.request_name})
    if request.sampler == "grid":
        refuse_idle(args, "on a grid", "trials", "startup_trials")
    else:
        refuse_idle(args, "without --sampler grid", "grid_steps")
    config = configuration(args.config)
    request = finished_campaign.with_default_assay(config, request)
    seed = seed_of(config, args)
    output = args.output
    if args.verify:
        output = output or Path(f"design-{request.name}")
    if output is not None:
        check_writable(
            output / "files" / f"{request.name}-candidate-{request.candidates}.json", "--output"
        )
    safety = safety_distance_um(config)
    if args.safety_distance_um is not None:
        safety = check_value(Sweep, "safety_distance_um", args.safety_distance_um)
    known = finished_campaign.read_campaign(
        args.results or finished_campaign.packaged_campaign(),
        Device() if config is None else config.device,
        safety,
    )
    finished_campaign.check_settings(config, known, request, args.verify)
    budget = Verification() if config is None else config.verification
    made = design_answers.make_designs(request, known, seed, budget, measured=measured)
    found, verdicts, files, removed = made.found, None, [], []
    if args.verify:
        with Display() as progress:
            verdicts = design_answers.verify_request(
                request,
                made.settings,
                known.chip,
                known.model,
                known.tables,
                work=output / "outcomes",
                files=output / "files",
                progress=progress,
                measured=measured,
                threads=min(2, os.cpu_count() or 1),
            )
    if output is not None:
        removed = design_answers.remove_stale(made, output, verdicts)
        own = (output / "files").glob(f"{request.name}-*")
        files = sorted(map(str, own)) if args.verify else []
        written = design_answers.write_designs(made, known, output, verdicts)
        files = list(dict.fromkeys([*map(str, written), *files]))
    summary = {
        "doubt": doubt(made.populations),
        "request": request.model_dump(),
        "populations": records(found.populations),
        "learnt": known.model.holds_for,
        "device": known.chip.device.model_dump(),
        "designs": records(found.designs),
        "tolerances": records(found.tolerances),
        "importance": records(found.importance),
        "outcomes": records(tables_of(made.devices, SUMMED_UP)["device_outcomes"]),
        "outcome_notes": made.notes,
        "trials": len(found.trials),
        "seed": seed,
        "surrogate": {k: known.model.card[k] for k in ("data", "scores_by_geometry")},
        "verified_designs": None if verdicts is None else records(verdicts.designs),
        "verifications": None if verdicts is None else records(verdicts.verifications),
        "files": files,
        "removed": list(map(str, removed)),
    }
    return summary, _design_lines(summary)


def _design_lines(summary: Mapping) -> list[str]:
    """What a search and its verification found, to be read."""
    request, designs = summary["request"], summary["designs"]
    data, scores = summary["surrogate"]["data"], summary["surrogate"]["scores_by_geometry"]
    populations = summary["populations"]
    lines = [
        *filter(None, [summary["doubt"]]),
        *(line for cell in populations for line in _population_lines(cell)),
        f"mean velocity {populations[0]['mean_velocity_mm_s']:g} mm/s, channel height "
        f"{populations[0]['height_um']:g} µm",
        f"learnt: {summary['learnt']}",
        f"learnt from {data['used']} outcomes in {data['geometries']} arrays; median error on "
        f"arrays never seen {scores['median_absolute_error_deg']:.2f}°",
        f"{summary['trials']} arrays tried, objective {request['objective']}",
        "",
        "Candidates (predicted, not simulated), lengths in µm, angles in degrees:",
    ]
    lines += in_columns(
        {
            "rank": [str(d["rank"]) for d in designs],
            "P_r": [f"{d['pillar_radius_um']:.2f}" for d in designs],
            "P_g": [f"{d['gap_um']:.2f}" for d in designs],
            "N_p": [str(d["periodicity"]) for d in designs],
            **{
                f"cell {i}": [
                    f"{d[f'angle_{i}_deg']:.2f} ({d[f'angle_{i}_low_deg']:.2f} to "
                    f"{d[f'angle_{i}_high_deg']:.2f}) {d[f'mode_{i}']}"
                    for d in designs
                ]
                for i in (1, 2)
            },
            "separation": [
                f"{d['separation_deg']:.2f} ± {d['uncertainty_deg']:.2f}" for d in designs
            ],
            "robust": [f"{d['robust_separation_deg']:.2f}" for d in designs],
            f"± {request['tolerance_um']:g} µm": [
                f"{d['separation_tolerance_min_deg']:.2f} to "
                f"{d['separation_tolerance_max_deg']:.2f}"
                for d in designs
            ],
            "length [mm]": [optional(d["length_mm"], ".3g") for d in designs],
            "pressure [kPa]": [optional(d["pressure_drop_kPa"], ".3g") for d in designs],
            "verdict": [d["verdict"] for d in designs],
        }
    )
    notes = dict.fromkeys(note for d in designs for note in d["notes"])
    pressure = together([d["pressure_basis"] for d in designs])
    lines += [
        "",
        *notes,
        "in brackets: 90 % intervals anywhere in the interval of k_s; ± uncertainty: half of the "
        "90 % interval; robust: exceeded by nine of ten draws",
        f"length: of array that parts the two by {request['lateral_separation_um']:g} µm "
        f"(lateral_separation_um); {_mask_line(summary)}",
        f"pressure drop over that length: {pressure}; throughput "
        f"{designs[0]['throughput_uL_per_h']:.3g} µL/h",
        "",
        *outcome_lines(summary["outcomes"], summary["outcome_notes"]),
        "",
        "Best candidate, one thing off:",
    ]
    first = [t for t in summary["tolerances"] if t["design"] == 1]
    lines += in_columns(
        {
            "off": [t["parameter"] for t in first],
            "by": [f"{t['offset']:+.2g}" for t in first],
            "separation": [f"{t['separation_deg']:.2f}" for t in first],
            "modes": [f"{t['mode_1']}, {t['mode_2']}" for t in first],
            "slope [° per unit]": [f"{t['sensitivity_deg_per_unit']:.2f}" for t in first],
        }
    )
    known = [row for row in summary["importance"] if row["importance"] is not None]
    if known:
        lines += [
            "",
            f"importance ({known[0]['evaluator']}): "
            + ", ".join(f"{r['parameter']} {r['importance']:.0%}" for r in known),
        ]
    if summary["verified_designs"] is None:
        lines += ["", "Add --verify to simulate both cell types in the best designs."]
    else:
        lines += ["", *_verified_lines(summary)]
    lines += [f"removed, of an earlier request: {path}" for path in summary["removed"]]
    return lines + [f"written: {path}" for path in summary["files"]]


def _mask_line(summary: Mapping) -> str:
    """How long the array of the masks is, and why."""
    request = summary["request"]
    setting = f"device.array_length_mm, {summary['device']['array_length_mm']:g} mm"
    limits = [key for key in LENGTH_LIMITS if request[key] is not None]
    if request["objective"] != "purity-recovery" or not limits:
        return f"the mask's array is as long as {setting}, in whole rows"
    return (
        f"the mask's array is as long as {' and '.join(limits)} and {setting}, allow, in whole "
        "rows: array [mm] below"
    )


def _population_lines(cell: Mapping) -> list[str]:
    """From what was measured of a cell type to what acts, step by step."""
    what = "bead" if cell["rigid"] else cell["cell_shape"]
    lines = [f"cell {cell['population']}: {what}, radius {cell['cell_radius_um']:g} µm"]
    if cell["assay"]:
        lines[0] += (
            f", deformation index {cell['deformation_index']:.4g} ± "
            f"{cell['deformation_index_std']:.2g} by {cell['assay']}"
        )
    spans = (("k_s", "ks", "_uN_per_m", " µN/m"), ("Ca = μU/k_s", "capillary_number", "", ""))
    steps = [
        f"{name} {cell[f'{key}{end}']:.3g}{unit}"
        + f" ({cell[f'{key}_low{end}']:.3g} to {cell[f'{key}_high{end}']:.3g})"
        * bool(cell["assay"])
        for name, key, end, unit in spans
    ]
    return [
        *lines,
        f"  {', '.join(steps)}: {cell['stiffness_basis']}",
        f"  gaps from {cell['narrowest_width_um']:.3g} µm: {cell['narrowest_width_basis']}",
    ]


def _verified_lines(summary: Mapping) -> list[str]:
    rows = [r for r in summary["verifications"] if r["population"] == "difference"]
    done = summary["verified_designs"]
    lines = ["Simulated differences (cell 2 − cell 1) in degrees, beside what was predicted:"]
    lines += in_columns(
        {
            "round": [str(r["round"]) for r in rows],
            "role": [r["role"] for r in rows],
            "P_r": [f"{r['pillar_radius_um']:.2f}" for r in rows],
            "P_g": [f"{r['gap_um']:.2f}" for r in rows],
            "N_p": [str(r["periodicity"]) for r in rows],
            "height": [f"{r['height_um']:g}" for r in rows],
            "predicted": [
                f"{r['predicted_low_deg']:.2f} to {r['predicted_high_deg']:.2f}" for r in rows
            ],
            "simulated": [optional(r["simulated_deg"], ".2f") for r in rows],
            "sigma_num": [optional(r["sigma_num_deg"], ".2f") for r in rows],
            "modes": [r["mode"] for r in rows],
            "verdict": [r["verdict"] for r in rows],
        }
    )
    lines += ["", f"{done[0]['stopped']}." if done else "No design was simulated.", ""]
    return lines + [
        f"{d['name']} (rank {d['rank']}): P_r {d['pillar_radius_um']:.2f}, P_g {d['gap_um']:.2f}, "
        f"N_p {d['periodicity']}: {d['verdict']}"
        for d in done
    ]


def add_design(commands) -> None:
    """The command `design`."""
    parser = add_command(
        commands,
        "design",
        design,
        "geometries that separate two cell types best",
        "design --shape1 sphere --ks1 10 --r1 6 --shape2 sphere --ks2 10 --r2 8 --height 19",
    )
    add_populations(parser)
    for key, kind in (("pillar_radius_um", number), ("gap_um", number), ("periodicity", whole)):
        low, high = DesignRequest.model_fields[key].default
        parser.add_argument(
            option_of(key),
            type=kind,
            nargs=2,
            metavar=("LOW", "HIGH"),
            help=f"bounds of the search; default {low:g} {high:g}",
        )
    for key in (
        "objective",
        "sampler",
        "trials",
        "startup_trials",
        "grid_steps",
        "draws",
        "cells",
        "candidates",
        "tolerance_um",
        "height_tolerance_um",
        "pillar_aspect_ratio_max",
        "lateral_separation_um",
        "footprint_max_mm2",
    ):
        add_option(parser, DesignRequest, key)
    add_option(parser, DesignRequest, "sample_min_uL_per_h", "--sample-min-ul-per-h")
    parser.add_argument(
        "--pressure-max-kpa",
        type=number,
        dest="pressure_max_kPa",
        metavar="kPa",
        help="largest pressure drop over the length which that takes, or that the array may be "
        "long by; default: no limit",
    )
    parser.add_argument(
        "--safety-distance-um",
        type=number,
        metavar="µm",
        help="a gap must exceed P_r + this; default: the configuration's, or "
        f"{Sweep.model_fields['safety_distance_um'].default:g}",
    )
    add_seed(parser)
    parser.add_argument(
        "--results",
        type=place,
        metavar="DIR",
        help="folder with the outcomes, calibration, surrogate (and flows) of a "
        "campaign; default: the campaign that comes with the package",
    )
    parser.add_argument(
        "--verify",
        action="store_true",
        help="simulate both cell types in the best designs (minutes)",
    )
    parser.add_argument(
        "--output",
        type=place,
        metavar="DIR",
        help="write tables, the candidates' files (mask, data) and a report "
        "there, and with --verify those of the simulated designs; default "
        "with --verify: design-NAME",
    )
    parser.add_argument(
        "--request-name",
        default="request",
        metavar="NAME",
        help="name of files; default %(default)s",
    )
    add_config(parser)
