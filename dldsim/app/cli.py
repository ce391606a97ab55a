"""Commands for one-off use: run, flow, constrict, anova, stiffness, design, validate, info, serve.

Summaries go to standard output, as text or as one JSON object; all else goes to standard error.
Keys of the summaries are the tables' column names.
"""

import argparse
import difflib
import json
import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from dldsim import PHYSICS_VERSION, __version__
from dldsim.config import limits
from dldsim.config.configuration import Partial, Sweep
from dldsim.config.design_sections import DesignRequest, Device, Verification
from dldsim.config.explain import check_value, validate
from dldsim.config.feasibility import check_gap, check_passable
from dldsim.config.presets import read_partial
from dldsim.config.sections import (
    Cell,
    Constriction,
    ConstrictionGroup,
    Flow,
    Geometry,
    Numerics,
    RunControl,
    Section,
)
from dldsim.errors import DldsimError

EXAMPLES = {
    "run": "python -m dldsim run --pillar-radius-um 10 --gap-um 20 --periodicity 6 --set 1 "
           "--out single",
    "flow": "python -m dldsim flow --pillar-radius-um 10 --gap-um 20 --periodicity 6 "
            "--drive axial --height-um 0 --json",
    "constrict": "python -m dldsim constrict --set 1 --json",
    "anova": "python -m dldsim anova results/outcomes.parquet",
    "stiffness": "python -m dldsim stiffness --di 0.7 --error 0.01",
    "design": "python -m dldsim design --set1 1 --set2 5 --r1 7.5 --r2 7.5 --gap-um 14 20 "
              "--objective robust",
    "validate": "python -m dldsim validate square-arrays membrane-forces --out validation.parquet",
    "info": "python -m dldsim info results/outcomes.parquet",
    "serve": "python -m dldsim serve both --results results",
}
UNITS = {
    "_um": "µm", "_mm_s": "mm/s", "_mPa_s": "mPa·s", "_nN_s_per_m": "nN·s/m", "_pg": "pg",
}  # fmt: skip
"""Unit suffixes of option names."""
DEFAULT_CONFIG = Path("config.yaml")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code.

    0; 1 (a validation case fails); 2 (bad input); 130 (interrupted).
    """
    args = _parser().parse_args(argv)
    try:
        for model, key in ((Partial, "seed"), (Sweep, "safety_distance_um")):
            if getattr(args, key, None) is not None:
                check_value(model, key, getattr(args, key))
        summary, lines, *code = args.command(args)
    except DldsimError as error:
        sys.stderr.write(f"dldsim {args.name}: {error}\n")
        return 2
    except KeyboardInterrupt:
        sys.stderr.write(
            f"\ndldsim {args.name}: interrupted. Nothing of this {args.name} was written; files "
            "that were complete before are untouched.\n"
        )
        return 130
    if args.json:
        lines = [json.dumps(summary, default=_plain, allow_nan=False)]
    try:
        sys.stdout.writelines(f"{line}\n" for line in lines)
        sys.stdout.flush()
    except BrokenPipeError:  # the reader, such as head, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return code[0] if code else 0


# ---------------------------------------------------------------------------------------- commands


def run(args: argparse.Namespace) -> tuple[dict, Iterable[str]]:
    """One cell through one array: from one place of release, or a whole outcome."""
    from dldsim.config import identifiers

    config = _campaign(args.config)
    geometry = _geometry(args)
    cell = validate(Cell, (config.cell.model_dump() if config else {}) | _given(Cell, args))
    flow, numerics = _section(Flow, config, args), _section(Numerics, config, args)
    control = _control(config, args)
    check_gap(geometry, _safety_distance(config))
    check_passable(geometry, cell, flow.height_um)
    stiffness = _named(config, "stiffness_sets", args.set, "--set")
    outcome = identifiers.outcome_id(identifiers.Pair(geometry, args.set))
    from dldsim.analysis.uncertainty import numerical_uncertainty, read_model
    from dldsim.app import jobs
    from dldsim.experiments.array_run import simulate_outcome, simulate_run

    sections = (geometry, stiffness, cell, flow, numerics, control)
    settings = {s.__class__.__name__: s.model_dump(mode="json") for s in sections}
    with _progress() as progress:
        if args.releases is None:
            name = identifiers.run_id(outcome, cell.release_gap_fraction)
            result = simulate_run(*sections, run_id=name, outcome_id=outcome,
                                  stiffness_set=args.set, progress=progress)
        else:
            name = outcome
            result = simulate_outcome(*sections, outcome_id=outcome, stiffness_set=args.set,
                                      progress=progress)
    sigma, basis = numerical_uncertainty(result.row, read_model())
    summary = {**result.row, "sigma_num_deg": sigma, "sigma_num_basis": basis}
    if args.out:
        trajectory = args.out / f"{name}.trajectory.parquet"
        if args.releases is None:
            files = [args.out / f"{name}.run.parquet", trajectory]
            jobs.write_run(result, *files, settings)
        else:
            files = jobs.OutcomeFiles(args.out / f"{name}.outcome.parquet",
                                      args.out / f"{name}.runs.parquet", trajectory)
            result.row.update(sigma_num_deg=sigma, sigma_num_basis=basis)
            jobs.write_outcome(result, files, settings)
        summary["files"] = [str(path) for path in files]
    return summary, _listing(summary)


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
    return validate(RunControl, base | _given(RunControl, args) | places)


def flow(args: argparse.Namespace) -> tuple[dict, Iterable[str]]:
    """Flow through an array without a cell."""
    config = _campaign(args.config)
    geometry = _geometry(args)
    sections = [_section(model, config, args) for model in (Flow, Numerics)]
    from dldsim.app import jobs
    from dldsim.solver.flow import solve_empty_array

    with _progress() as progress:
        result = solve_empty_array(geometry, *sections, progress)
    summary = jobs.flow_row(result)
    if args.out:
        result.save(args.out)
        summary["files"] = [str(args.out)]
    return summary, _listing(summary)


def constrict(args: argparse.Namespace) -> tuple[dict, Iterable[str]]:
    """One cell through the constriction channel."""
    config = _campaign(args.config)
    name, group = _constriction_group(config, args)
    channel = _section(Constriction, config, args)
    release = args.release_position_um
    if release is None:
        release = channel.release_positions_um[0]
    sections = [config.cell, config.flow, _channel_numerics(config, args)]
    from dldsim.app import jobs
    from dldsim.experiments.constriction import simulate_constriction

    with _progress() as progress:
        result = simulate_constriction(
            name, group, channel, *sections, release_position_um=release,
            run_id=f"{name}_at-{release:g}", progress=progress,
        )  # fmt: skip
    summary = dict(result.row)
    if args.out:
        settings = {
            section.__class__.__name__: section.model_dump(mode="json")
            for section in (group, channel, *sections)
        }
        row = args.out / f"{summary['run_id']}.run.parquet"
        trajectory = args.out / f"{summary['run_id']}.trajectory.parquet"
        jobs.write_constriction(result, row, trajectory, settings)
        summary["files"] = [str(row), str(trajectory)]
    return summary, _listing(summary)


def anova(args: argparse.Namespace) -> tuple[dict, Iterable[str]]:
    """Analysis of variance of anybody's table of outcomes."""
    from dldsim.analysis.statistics import analyse

    frame = _read_any(args.table)
    result, residuals = analyse(frame, args.seed)
    summary = {"table": str(args.table), "rows": _records(result),
               "diagnostics": _records(residuals), "sobol": []}
    lines = ["Type II analysis of variance of migration_angle_deg", *_frame_lines(result), "",
             "Residuals of the models", *_frame_lines(residuals), "",
             "Sobol indices of a surrogate fitted to the table"]
    from dldsim.analysis.sensitivity import sobol_of_table

    try:
        indices = sobol_of_table(frame, args.seed)
    except DldsimError as error:
        summary["sobol_refused"] = str(error)
        return summary, [*lines, f"none: {error}"]
    summary["sobol"] = _records(indices)
    return summary, [*lines, *_frame_lines(indices)]


def stiffness(args: argparse.Namespace) -> tuple[dict, Iterable[str]]:
    """Moduli of a cell with a measured deformation index."""
    from dldsim.analysis.calibration import stiffness_for
    from dldsim.app.design_jobs import packaged_campaign
    from dldsim.tables.parquet import read_table

    path = args.calibration or (args.results or packaged_campaign()) / "calibration.parquet"
    found = stiffness_for(args.di, read_table("calibration", path), args.error, args.design)
    summary = {"deformation_index": args.di, "error": args.error} | found
    return summary, _listing(summary)


def design(args: argparse.Namespace) -> tuple[dict, Iterable[str]]:
    """Geometries that separate two cell types best."""
    from dldsim.app import design_jobs

    request = validate(DesignRequest, _given(DesignRequest, args) | {"name": args.request_name})
    config = _campaign(args.config)
    safety = args.safety_distance_um
    if safety is None:
        safety = _safety_distance(config)
    known = design_jobs.read_campaign(
        args.results or design_jobs.packaged_campaign(),
        Device() if config is None else config.device, safety,
    )
    budget = Verification() if config is None else config.verification
    made = design_jobs.make_designs(request, known, args.seed, budget)
    resolved, found, verdicts, output, files = made.resolved, made.found, None, args.output, []
    if args.verify:
        output = output or Path(f"design-{request.name}")
        with _progress() as progress:
            verdicts = design_jobs.verify_request(
                request, made.settings, known.chip, known.model, known.tables,
                work=output / "outcomes", files=output / "files", progress=progress,
            )
        files += sorted(map(str, (output / "files").iterdir()))
    if output is not None:
        written = design_jobs.write_designs(made, known, output, verdicts)
        files = list(dict.fromkeys([*map(str, written), *files]))
    summary = {
        "request": resolved.model_dump(), "designs": _records(found.designs),
        "tolerances": _records(found.tolerances), "importance": _records(found.importance),
        "trials": len(found.trials), "seed": args.seed,
        "surrogate": {k: known.model.card[k] for k in ("data", "scores_by_geometry")},
        "verified_designs": None if verdicts is None else _records(verdicts.designs),
        "verifications": None if verdicts is None else _records(verdicts.verifications),
        "files": files,
    }  # fmt: skip
    return summary, _design_lines(summary)


def run_validation(args: argparse.Namespace) -> tuple[dict, Iterable[str], int]:
    """Validation cases; the exit code is 1 if one of them fails."""
    from dldsim.evidence.validation import CASES, check_cases, failures, run_case, verdicts

    names = check_cases(args.cases)
    if args.list:
        cases = {name: CASES[name]._asdict() for name in names if name in CASES}
        width = max(map(len, cases))
        lines = [f"{name:{width}}  {c['group']:8}  {c['title']}" for name, c in cases.items()]
        return cases, lines, 0
    rows = []
    with _progress() as progress:
        for name in names:
            progress(f"{name}: {CASES[name].title}" if name in CASES else f"{name}: unknown")
            rows += run_case(name, progress)
    summary = {"cases": verdicts(rows), "rows": rows}
    if args.out:
        from dldsim.app.jobs import provenance
        from dldsim.tables.parquet import write_csv, write_table

        write_table("validation", rows, args.out, provenance({"cases": names}))
        summary["files"] = [str(args.out), str(write_csv("validation", args.out))]
    failing = failures(rows)
    lines = [*_comparison_lines(rows), *_verdict_lines(summary["cases"])]
    lines += [f"fails: {sentence}" for sentence in failing]
    lines += [f"note: {note}" for note in dict.fromkeys(r["note"] for r in rows) if note]
    return summary, lines, int(bool(failing))


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


def serve(args: argparse.Namespace) -> tuple[dict, Iterable[str], int]:
    """The design service, until it is interrupted."""
    from dldsim.app.web import serve as parts
    from dldsim.app.web.api.settings import Settings

    settings = Settings.read(_given(Settings, args))
    if args.part == "api":
        parts.serve_api(settings)
        return {}, [], 0
    if args.part == "ui":
        return {}, [], parts.serve_page(settings.host, args.page_port, args.api)
    with _progress() as progress:
        return {}, [], parts.serve_both(settings, args.page_port, progress)


# ------------------------------------------------------------------------------------------- input

def _campaign(path: Path | None) -> Partial | None:
    """The configuration file, by default ./config.yaml; None if there is none."""
    if path is None and not DEFAULT_CONFIG.exists():
        return None
    config = read_partial(path or DEFAULT_CONFIG)
    limits.enforce(config.limits)
    return config


def _safety_distance(config: Partial | None) -> float:
    if config is None or config.sweep is None:
        return Sweep.model_fields["safety_distance_um"].default
    return config.sweep.safety_distance_um


def _given(model: type[Section], args: argparse.Namespace) -> dict:
    """The fields of a section that the command line names."""
    values = {key: getattr(args, key, None) for key in model.model_fields}
    return {key: value for key, value in values.items() if value is not None}


def _section(model: type[Section], config: Partial | None, args: argparse.Namespace) -> Any:
    """A section of the configuration with the command line over it."""
    base = {}
    if config is not None:
        [base] = [s.model_dump() for _, s in config if type(s) is model]
    return validate(model, base | _given(model, args))


NOT_IN_CHANNEL = ("spacing_um", "bounce_back", "rows", "lanes")
"""Numerics of arrays; the channel has a spacing of its own."""


def _channel_numerics(config: Partial, args: argparse.Namespace) -> Numerics:
    given = {k: v for k, v in _given(Numerics, args).items() if k not in NOT_IN_CHANNEL}
    return validate(Numerics, config.numerics.model_dump() | given)


def _geometry(args: argparse.Namespace) -> Geometry:
    return validate(Geometry, _given(Geometry, args))


def _named(config: Partial | None, section: str, name: str, option: str) -> Any:
    """An entry of a section by name."""
    if config is None:
        raise DldsimError(
            f"{option} {name}: {section} are read from a configuration file, and there is no "
            "config.yaml here. Name one with --config FILE."
        )
    entries = getattr(config, section)
    if not entries:
        raise DldsimError(
            f"{option} {name}: the configuration has no {section}.", key=section,
            allowed="entries by name", remedy="Add them, or name another file with --config FILE.",
        )  # fmt: skip
    if name not in entries:
        close = difflib.get_close_matches(name, entries, n=1)
        hint = f" Did you mean {close[0]}?" if close else ""
        raise DldsimError(
            f"{option} {name}: unknown, {section} has {', '.join(entries)}.{hint}"
        )
    return entries[name]


def _constriction_group(config: Partial | None, args: argparse.Namespace
                        ) -> tuple[str, ConstrictionGroup]:
    if args.group is not None:
        name = args.group
        group = _named(config, "constriction_groups", name, "--group")
    else:
        _named(config, "stiffness_sets", args.set, "--set")
        groups = config.constriction_groups
        found = [name for name, group in groups.items() if group.stiffness_set == args.set]
        if not found:
            raise DldsimError(
                f"--set {args.set}: no constriction group has this stiffness set. Name one with "
                f"--group: {', '.join(groups)}."
            )
        name, group = found[0], groups[found[0]]
    return name, validate(ConstrictionGroup, group.model_dump() | _given(ConstrictionGroup, args))


def _read_any(path: Path):
    """A CSV or Parquet table of any origin as a DataFrame."""
    import pandas as pd

    readers = {".csv": pd.read_csv, ".parquet": pd.read_parquet}
    if path.suffix not in readers:
        raise DldsimError(f"{path}: a table must be a .csv or .parquet file.")
    _check_physics(path)
    try:
        return readers[path.suffix](path)
    except FileNotFoundError as error:
        raise DldsimError(f"{path} does not exist.") from error
    except Exception as error:
        raise DldsimError(f"{path} is not a readable {path.suffix[1:]} file: {error}") from error


def _check_physics(path: Path) -> None:
    """Refuse a Parquet table that another physics version of this package wrote."""
    from dldsim.tables.parquet import describe

    try:
        version = describe(path)["provenance"]["physics_version"]
    except DldsimError:  # not a table of this package, or no Parquet at all
        return
    if version != PHYSICS_VERSION:
        raise DldsimError(
            f"{path} was made by physics version {version}; this is version {PHYSICS_VERSION}, "
            "whose angles differ. Simulate the campaign anew: snakemake -j2 all."
        )


# ------------------------------------------------------------------------------------------ output


class _progress:
    """Context: shows sentences on standard error, one over the other on a terminal."""

    def __enter__(self) -> Callable[[str], None]:
        self.terminal, self.open = sys.stderr.isatty(), False
        return self.show

    def show(self, sentence: str) -> None:
        sys.stderr.write(f"\r\x1b[K{sentence}" if self.terminal else f"{sentence}\n")
        sys.stderr.flush()
        self.open = self.terminal

    def __exit__(self, *exception) -> None:
        if self.open:
            sys.stderr.write("\n")


def _plain(value: Any) -> Any:
    """NumPy values as Python's."""
    return value.tolist()


def _listing(summary: Mapping[str, Any]) -> list[str]:
    width = max(map(len, summary))
    return [f"{key:{width}}  {_short(value)}" for key, value in summary.items()]


def _short(value: Any) -> str:
    if value is None:
        return "not measured"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        return ", ".join(map(_short, value)) or "none"
    return str(value)


def _columns(columns: Mapping[str, Sequence[str]]) -> list[str]:
    """Headings and cells in columns as wide as their widest entry, without empty columns."""
    columns = {heading: cells for heading, cells in columns.items() if any(cells)}
    widths = [max(map(len, (heading, *cells))) for heading, cells in columns.items()]
    rows = [columns, *zip(*columns.values(), strict=True)]
    return ["  ".join(f"{c:{w}}" for c, w in zip(r, widths, strict=True)).rstrip() for r in rows]


def _comparison_lines(rows: Sequence[Mapping]) -> list[str]:
    """A table of the comparisons of each case."""
    lines = []
    for name in dict.fromkeys(row["case"] for row in rows):
        of_case = [row for row in rows if row["case"] == name]

        def cells(key: str, form: str, of_case=of_case) -> list[str]:
            return ["" if row[key] is None else format(row[key], form) for row in of_case]

        def heading(key: str, of_case=of_case) -> str:
            """What the column counts, where that is the same in all rows."""
            meanings = {row[f"{key}_of"] for row in of_case} - {""}
            return meanings.pop() if len(meanings) == 1 else key

        lines += [f"{name} (reference: {of_case[0]['source']})"]
        lines += _columns({
            "quantity": cells("quantity", ""), "variant": cells("variant", ""),
            heading("parameter"): cells("parameter", "g"),
            heading("resolution"): cells("resolution", "g"),
            "reference": cells("reference", ".6g"), "value": cells("value", ".6g"),
            "unit": cells("unit", ""), "error": cells("relative_error", "+.2e"),
            "allowed": cells("mark", ".1e"), "order": cells("observed_order", ".1f"),
            "result": [{True: "passes", False: "FAILS", None: "shown"}[row["passed"]]
                       for row in of_case],
        }) + [""]  # fmt: skip
    return lines


def _verdict_lines(cases: Sequence[Mapping]) -> list[str]:
    return [*_columns({
        "case": [case["case"] for case in cases],
        "result": ["passes" if case["failed"] == 0 else "FAILS" for case in cases],
        "within marks": [f"{case['marked'] - case['failed']} of {case['marked']}"
                         for case in cases],
        "largest error / allowed": [
            "" if case["error_over_mark"] is None else f"{case['error_over_mark']:.2g}"
            for case in cases],
        "time [s]": [f"{case['wall_time_s']:.1f}" for case in cases],
    }), ""]  # fmt: skip


def _design_lines(summary: Mapping) -> list[str]:
    """What a search and its verification found, to be read."""
    request, designs = summary["request"], summary["designs"]
    data, scores = summary["surrogate"]["data"], summary["surrogate"]["scores_by_geometry"]
    lines = [
        f"cell {i}: deformation index {request[f'deformation_index_{i}']:.4g} ± "
        f"{request[f'deformation_index_std_{i}']:.2g}, radius {request[f'radius_{i}_um']:g} µm"
        for i in "12"
    ] + [
        f"learnt from {data['used']} outcomes in {data['geometries']} arrays; median error on "
        f"arrays never seen {scores['median_absolute_error_deg']:.2f}°",
        f"{summary['trials']} arrays tried, objective {request['objective']}", "",
        "Candidates (predicted, not simulated), lengths in µm, angles in degrees:",
    ]  # fmt: skip
    lines += _columns({
        "rank": [str(d["rank"]) for d in designs],
        "P_r": [f"{d['pillar_radius_um']:.2f}" for d in designs],
        "P_g": [f"{d['gap_um']:.2f}" for d in designs],
        "N_p": [str(d["periodicity"]) for d in designs],
        "cell 1": [f"{d['angle_1_deg']:.2f} {d['mode_1']}" for d in designs],
        "cell 2": [f"{d['angle_2_deg']:.2f} {d['mode_2']}" for d in designs],
        "separation": [f"{d['separation_deg']:.2f} ± {d['uncertainty_deg']:.2f}" for d in designs],
        "robust": [f"{d['robust_separation_deg']:.2f}" for d in designs],
        f"± {request['tolerance_um']:g} µm": [
            f"{d['separation_tolerance_min_deg']:.2f} to {d['separation_tolerance_max_deg']:.2f}"
            for d in designs],
        "length [mm]": [_optional(d["length_mm"], ".3g") for d in designs],
        "pressure [kPa]": [_optional(d["pressure_drop_kPa"], ".3g") for d in designs],
        "verdict": [d["verdict"].partition(";")[0] for d in designs],
    })  # fmt: skip
    notes = dict.fromkeys(note.strip() for d in designs for note in d["verdict"].split(";")[1:])
    lines += ["", *notes,
              "± uncertainty: half of the 90 % interval; robust: exceeded by nine of ten draws",
              f"pressure drop: {designs[0]['pressure_basis']}; throughput "
              f"{designs[0]['throughput_uL_per_h']:.3g} µL/h", "", "Best candidate, one thing off:"]
    first = [t for t in summary["tolerances"] if t["design"] == 1]
    lines += _columns({
        "off": [t["parameter"] for t in first], "by": [f"{t['offset']:+.2g}" for t in first],
        "separation": [f"{t['separation_deg']:.2f}" for t in first],
        "modes": [f"{t['mode_1']}, {t['mode_2']}" for t in first],
        "slope [° per unit]": [f"{t['sensitivity_deg_per_unit']:.2f}" for t in first],
    })  # fmt: skip
    known = [row for row in summary["importance"] if row["importance"] is not None]
    if known:
        lines += ["", f"importance ({known[0]['evaluator']}): "
                  + ", ".join(f"{r['parameter']} {r['importance']:.0%}" for r in known)]
    if summary["verified_designs"] is None:
        lines += ["", "Add --verify to simulate both cell types in the best designs."]
    else:
        lines += ["", *_verified_lines(summary)]
    return lines + [f"written: {path}" for path in summary["files"]]


def _verified_lines(summary: Mapping) -> list[str]:
    rows = [r for r in summary["verifications"] if r["population"] == "difference"]
    done = summary["verified_designs"]
    lines = ["Simulated differences (cell 2 − cell 1) in degrees, beside what was predicted:"]
    lines += _columns({
        "round": [str(r["round"]) for r in rows], "role": [r["role"] for r in rows],
        "P_r": [f"{r['pillar_radius_um']:.2f}" for r in rows],
        "P_g": [f"{r['gap_um']:.2f}" for r in rows], "N_p": [str(r["periodicity"]) for r in rows],
        "height": [f"{r['height_um']:g}" for r in rows],
        "predicted": [f"{r['predicted_low_deg']:.2f} to {r['predicted_high_deg']:.2f}"
                      for r in rows],
        "simulated": [_optional(r["simulated_deg"], ".2f") for r in rows],
        "sigma_num": [_optional(r["sigma_num_deg"], ".2f") for r in rows],
        "modes": [r["mode"] for r in rows], "verdict": [r["verdict"] for r in rows],
    })  # fmt: skip
    lines += ["", f"{done[0]['stopped']}." if done else "No design was simulated.", ""]
    return lines + [
        f"{d['name']} (rank {d['rank']}): P_r {d['pillar_radius_um']:.2f}, P_g {d['gap_um']:.2f}, "
        f"N_p {d['periodicity']}: {d['verdict']}" for d in done
    ]  # fmt: skip


def _optional(value: float | None, form: str) -> str:
    return "–" if value is None else format(value, form)


def _records(frame) -> list[dict]:
    return json.loads(frame.to_json(orient="records", double_precision=15))


def _frame_lines(frame) -> list[str]:
    """A table without its notes, and each different note below."""
    notes = frame["note"].unique() if "note" in frame else []
    numbers = frame.drop(columns="note", errors="ignore")
    lines = numbers.to_string(index=False, na_rep="", float_format="{:.4g}".format).splitlines()
    return lines + [f"note: {note}" for note in notes if note]


# ------------------------------------------------------------------------------------------ parser


class _Parser(argparse.ArgumentParser):
    """A parser that says what is wrong without the whole usage."""

    def error(self, message: str):
        self.exit(2, f"{self.prog}: {message}\nSee {self.prog} --help\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="python -m dldsim",
        description="Deformable cells in deterministic lateral displacement arrays. A whole "
                    "campaign is run by: snakemake -j2 all",
    )
    parser.add_argument("--version", action="version", version=f"dldsim {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    one = _command(commands, "run", run, "one cell through one array")
    _add_geometry(one)
    one.add_argument("--set", required=True, metavar="NAME",
                     help="stiffness set, a name from stiffness_sets in the configuration")
    _add_fields(one, "channel and flow", Flow)
    _add_fields(one, "cell", Cell)
    _add_fields(one, "numerics", Numerics)
    _add_fields(one, "when to stop", RunControl, without={"release_gap_fractions"})
    one.add_argument("--releases", type=float, nargs="*", metavar="X",
                     help="simulate a whole outcome: release at these places in the gap, in this "
                          "order, as many as it takes; none named: the configuration's")
    _add_config(one)
    one.add_argument("--out", type=Path, metavar="DIR",
                     help="write the run, or the outcome with its runs, and the trajectory there, "
                          "as Parquet")

    empty = _command(commands, "flow", flow, "flow through an array without a cell")
    _add_geometry(empty)
    _add_fields(empty, "channel and flow", Flow)
    _add_fields(empty, "numerics", Numerics)
    _add_config(empty)
    empty.add_argument("--out", type=Path, metavar="FILE.npz", help="save the flow there")

    channel = _command(commands, "constrict", constrict, "one cell through the constriction")
    which = channel.add_mutually_exclusive_group(required=True)
    which.add_argument("--set", metavar="NAME", help="the group that calibrates this stiffness set")
    which.add_argument("--group", metavar="NAME", help="a name from constriction_groups")
    channel.add_argument("--velocity-mm-s", type=float, metavar="mm/s",
                         help="mean velocity in the wide channel; default: the group's")
    channel.add_argument("--release-position-um", type=float, metavar="µm",
                         help="release along the flow, from the first possible position; "
                              "default: the first of constriction.release_positions_um")
    _add_fields(channel, "channel", Constriction, without={"release_positions_um"})
    _add_fields(channel, "numerics", Numerics, without={*NOT_IN_CHANNEL})
    _add_config(channel)
    channel.add_argument("--out", type=Path, metavar="DIR",
                         help="write its row and its trajectory there, as Parquet")

    variance = _command(commands, "anova", anova, "analysis of variance of the migration angle")
    variance.add_argument("table", type=Path, metavar="TABLE",
                          help="CSV or Parquet with the columns pillar_radius_um, gap_um, "
                               "periodicity, stiffness_set, deformation_index and "
                               "migration_angle_deg")

    variance.add_argument("--seed", type=int, default=1, metavar="N",
                          help="of permutations and surrogate; default %(default)s")

    inverse = _command(commands, "stiffness", stiffness, "moduli for a measured deformation index")
    inverse.add_argument("--di", type=float, required=True, metavar="DI",
                         help="deformation index, inside the calibrated range")
    inverse.add_argument("--error", type=float, default=0.0, metavar="±DI",
                         help="standard error of it; default %(default)s")
    inverse.add_argument("--design", default="group-velocity",
                         choices=["group-velocity", "fixed-velocity"],
                         help="calibration at the groups' own velocities (that of the campaign's "
                              "deformation indices), or at one velocity; default %(default)s")
    inverse.add_argument("--results", type=Path, metavar="DIR",
                         help="campaign whose calibration is taken; default: the campaign that "
                              "comes with the package")
    inverse.add_argument("--calibration", type=Path, metavar="FILE",
                         help="calibration file, instead of the one in the results folder")

    wanted = _command(commands, "design", design, "geometries that separate two cell types best")
    for i in "12":
        cell = wanted.add_mutually_exclusive_group(required=True)
        cell.add_argument(f"--di{i}", type=float, dest=f"deformation_index_{i}", metavar="DI",
                          help=f"deformation index of cell type {i}, 0 to 1")
        cell.add_argument(f"--set{i}", dest=f"stiffness_set_{i}", metavar="NAME",
                          help=f"stiffness set of cell type {i}, instead")
        wanted.add_argument(f"--di{i}-std", type=float, dest=f"deformation_index_std_{i}",
                            metavar="X", help=f"spread of it among cells of type {i}; default: the "
                                              "calibration's for a stiffness set, else 0")
        _add_option(wanted, DesignRequest, f"radius_{i}_um", f"--r{i}")
    for key, kind in (("pillar_radius_um", float), ("gap_um", float), ("periodicity", int)):
        low, high = DesignRequest.model_fields[key].default
        wanted.add_argument(_option(key), type=kind, nargs=2, metavar=("LOW", "HIGH"),
                            help=f"bounds of the search; default {low:g} {high:g}")
    for key in ("objective", "sampler", "trials", "startup_trials", "grid_steps", "draws",
                "candidates", "tolerance_um", "height_tolerance_um", "pillar_aspect_ratio_max",
                "lateral_separation_um"):
        _add_option(wanted, DesignRequest, key)
    wanted.add_argument("--pressure-max-kpa", type=float, dest="pressure_max_kPa", metavar="kPa",
                        help="largest pressure drop over the length which that takes; default: "
                             "no limit")
    wanted.add_argument("--safety-distance-um", type=float, metavar="µm",
                        help="a gap must exceed P_r + this; default: the configuration's, or "
                             f"{Sweep.model_fields['safety_distance_um'].default:g}")
    wanted.add_argument("--seed", type=int, default=1, metavar="N", help="default %(default)s")
    wanted.add_argument("--results", type=Path, metavar="DIR",
                        help="folder with the outcomes, calibration, surrogate (and flows) of a "
                             "campaign; default: the campaign that comes with the package")
    wanted.add_argument("--verify", action="store_true",
                        help="simulate both cell types in the best designs (minutes)")
    wanted.add_argument("--output", type=Path, metavar="DIR",
                        help="write tables, the candidates' files (mask, data) and a report "
                             "there, and with --verify those of the simulated designs; default "
                             "with --verify: design-NAME")
    wanted.add_argument("--request-name", default="request", metavar="NAME",
                        help="name of files; default %(default)s")
    _add_config(wanted)

    cases = _command(commands, "validate", run_validation, "cases beside reference values")
    cases.add_argument("cases", nargs="*", metavar="CASE", help="names of cases; default: all")
    cases.add_argument("--list", action="store_true", help="list the cases and run none")
    cases.add_argument("--out", type=Path, metavar="FILE.parquet",
                       help="write the comparisons there, with a CSV twin")

    service = _command(commands, "serve", serve, "the design service: API, page, or both")
    service.add_argument("part", choices=["api", "ui", "both"])
    service.add_argument("--results", type=Path, metavar="DIR",
                         help="campaign that answers come from; default: the one that comes with "
                              "the package")
    service.add_argument("--config", type=Path, metavar="FILE",
                         help="configuration for device, safety distance and verification; "
                              "default: ./config.yaml if present, else defaults")
    service.add_argument("--state", type=Path, metavar="DIR",
                         help="folder of queue and results; default: dldsim-web in "
                              "~/.local/state")
    service.add_argument("--host", metavar="ADDRESS", help="default 127.0.0.1")
    service.add_argument("--port", type=int, metavar="N", help="of the API; default 8000")
    service.add_argument("--page-port", type=int, default=8501, metavar="N",
                         help="default %(default)s")
    service.add_argument("--api", default="http://127.0.0.1:8000", metavar="URL",
                         help="API that a page alone asks; default %(default)s")
    service.add_argument("--workers", type=int, metavar="N",
                         help="processes that search; default 1")
    service.add_argument("--verify-workers", type=int, metavar="N",
                         help="processes that simulate; default 1")

    about = _command(commands, "info", info, "columns, units and provenance of a table")
    about.add_argument("file", type=Path, metavar="FILE", help="a Parquet table of dldsim")
    return parser


def _command(commands, name: str, function: Callable, purpose: str) -> argparse.ArgumentParser:
    parser = commands.add_parser(
        name, help=purpose, description=f"{purpose.capitalize()}.",
        epilog=f"example: {EXAMPLES[name]}",
    )
    parser.set_defaults(command=function, name=name)
    parser.add_argument("--json", action="store_true",
                        help="print the summary as one JSON object; keys are column names")
    return parser


def _option(key: str) -> str:
    return "--" + key.replace("_", "-")


def _add_geometry(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("geometry")
    for key in Geometry.model_fields:
        _add_option(group, Geometry, key, required=True)


def _add_config(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--config", type=Path, metavar="FILE",
                        help="configuration that the options go over; default: ./config.yaml if "
                             "present, else the defaults above")


def _add_fields(parser: argparse.ArgumentParser, title: str, model: type[Section],
                without: Iterable[str] = ()) -> None:
    group = parser.add_argument_group(title)
    for key in [key for key in model.model_fields if key not in without]:
        _add_option(group, model, key, "--cell-shape" if key == "shape" else None)


def _add_option(parser, model: type[Section], key: str, option: str | None = None,
                required: bool = False) -> None:
    """An option for one field of a section, with its unit, choices, meaning, range and default."""
    field = model.model_fields[key]
    kind, choices, unit = field.annotation, None, None
    if choices := getattr(kind, "__args__", None):  # Literal
        kind = type(choices[0])
    else:
        unit = next((text for end, text in UNITS.items() if key.endswith(end)),
                    "N" if kind is int else "X")
    signs = {"gt": "> ", "ge": "≥ ", "lt": "< ", "le": "≤ "}
    limits = [f"{sign}{getattr(m, name):g}" for m in field.metadata
              for name, sign in signs.items() if getattr(m, name, None) is not None]
    about = f"{field.description} ({', '.join(limits)})" if limits else field.description
    if not required:
        about += f"; default {field.default}"
    parser.add_argument(option or _option(key), dest=key, type=kind, choices=choices,
                        required=required, metavar=unit, help=about.replace("%", "%%"))
