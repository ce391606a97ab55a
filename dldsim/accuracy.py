"""Error of migration angle and deformation index against run time, and the model of σ_num.

Runs of known kind are repeated with one numerical setting changed, with whole settings changed,
and at a jointly finer reference. Array runs are repeated from other starts too: what their angles
differ by, the setting is not to blame for. Stopping earlier needs no run of its own: it is replayed
on one long run. The module also holds what a run's numerical uncertainty is taken to be, fitted to
the errors of runs against their reference.
"""

import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from statistics import mean, stdev, variance
from typing import Any, NamedTuple

from dldsim import PHYSICS_VERSION, __version__
from dldsim.campaign import OUTCOME_PATTERN, parse_outcome, settings_hash
from dldsim.config import Cell, Config, RunControl, validate
from dldsim.errors import DldsimError

DEFAULT, LONG, SETTING, REFERENCE = "default", "long", "setting", "reference"
"""What a variant runs at, where it is not one value of a knob."""
ANGLE, INDEX = "migration_angle", "deformation_index"
SECTIONS = {ANGLE: ("numerics", "run_control", "cell"), INDEX: ("constriction", "numerics")}
"""Where a knob may live; the first that has it counts."""
REPLAYED = ("orbit_tolerance", "max_rows")
START, RELEASE = "release_gap_fraction", "release_position_um"
SETTLED = ("converged", "periodic", "stationary")


class Variant(NamedTuple):
    """One run of the study: an array run or constriction group, a setting, a start."""

    run: str
    knob: str
    rank: int = 0
    start: int = 0


def variant_id(variant: Variant) -> str:
    """Identifier such as r05.0_g20.0_n04_s1--spacing_um--0--1."""
    return "--".join(map(str, variant))


def parse_variant(text: str) -> Variant:
    """The inverse of `variant_id`."""
    run, knob, rank, start = text.split("--")
    return Variant(run, knob, int(rank), int(start))


def quantity_of(run: str) -> str:
    """What is measured: the angle of an array run, the index of a constriction group."""
    return ANGLE if re.fullmatch(OUTCOME_PATTERN, run) else INDEX


def kind_of(variant: Variant) -> str:
    """Kind of table that holds the variant's row."""
    return "runs" if quantity_of(variant.run) == ANGLE else "constriction_runs"


def starts(config: Config) -> list[float]:
    """Starts of the array runs, the campaign's own first, as `release_gap_fraction`."""
    others = config.accuracy.migration_angle.other_starts
    return list(dict.fromkeys([config.run_control.release_gap_fractions[0], *others]))


def variants(config: Config) -> list[Variant]:
    """All runs of the study, each once."""
    study = config.accuracy
    wanted = []
    for quantity in (ANGLE, INDEX):
        part = getattr(study, quantity)
        points = [(DEFAULT, 0)]
        for knob, values in part.knobs.items():
            if knob == START and quantity == ANGLE:
                raise DldsimError(
                    f"accuracy.migration_angle.knobs.{START}: starts are varied in every run; name "
                    "them in accuracy.migration_angle.other_starts."
                )
            default = default_of(knob, quantity, config)
            if quantity == ANGLE and knob in REPLAYED:
                points.append((LONG, 0))
            else:
                points += [(knob, i) for i, value in enumerate(values) if value != default]
        points += [(SETTING, i) for i in range(len(part.alternatives))]
        points += [(REFERENCE, 0)] if part.reference else []
        runs = part.cases.values() if quantity == ANGLE else part.cases
        repeats = range(len(starts(config)) if quantity == ANGLE else 1)
        wanted += [Variant(run, *p, start) for run in runs for p in points for start in repeats]
    if (study.model_runs or study.check_runs) and not study.migration_angle.reference:
        raise DldsimError("accuracy.model_runs need accuracy.migration_angle.reference.")
    for run in (*study.model_runs, *study.check_runs):
        wanted += [Variant(run, DEFAULT), Variant(run, REFERENCE)]
    return list(dict.fromkeys(wanted))


def section_of(knob: str, quantity: str, config: Config) -> str:
    """The section that holds a setting. Raises DldsimError for an unknown one."""
    for section in SECTIONS[quantity]:
        if knob in type(getattr(config, section)).model_fields:
            return section
    raise DldsimError(
        f"accuracy.{quantity} names {knob}, which is no key of {', '.join(SECTIONS[quantity])}."
    )


def default_of(knob: str, quantity: str, config: Config) -> Any:
    """The campaign's own value of a setting."""
    if knob == RELEASE and quantity == INDEX:
        return config.constriction.release_positions_um[0]
    return getattr(getattr(config, section_of(knob, quantity, config)), knob)


def changes(variant: Variant, config: Config) -> dict[str, Any]:
    """Settings in which a variant differs from the campaign."""
    quantity = quantity_of(variant.run)
    study = getattr(config.accuracy, quantity)
    changed = {
        DEFAULT: dict, LONG: lambda: {"min_rows": study.long_rows, "max_rows": study.long_rows},
        SETTING: lambda: dict([*study.alternatives.values()][variant.rank]),
        REFERENCE: lambda: dict(study.reference),
    }.get(variant.knob, lambda: {variant.knob: study.knobs[variant.knob][variant.rank]})()
    if quantity == ANGLE:
        changed[START] = starts(config)[variant.start]
    return changed


def settings_for(variant: Variant, config: Config) -> dict[str, Any]:
    """Everything that one run of the study depends on, as plain values."""
    quantity = quantity_of(variant.run)
    changed = changes(variant, config)
    release = changed.pop(RELEASE, config.constriction.release_positions_um[0])
    place = changed.pop(START, None)
    sections = {name: getattr(config, name).model_dump() for name in SECTIONS[quantity]}
    for key, value in changed.items():
        sections[section_of(key, quantity, config)][key] = value
    plain = {
        name: validate(type(getattr(config, name)), values).model_dump(mode="json")
        for name, values in sections.items()
    }
    if quantity == ANGLE:
        geometry, name = parse_outcome(variant.run)
        cell = Cell(**plain["cell"], release_gap_fraction=place)
        return {
            **plain,
            "cell": cell.model_dump(mode="json"),
            "flow": config.flow.model_dump(mode="json"),
            "geometry": geometry.model_dump(mode="json"),
            "stiffness_set": name,
            "stiffness": config.stiffness_sets[name].model_dump(mode="json"),
        }
    return {
        **plain,
        "group": config.constriction_groups[variant.run].model_dump(mode="json"),
        "release_position_um": release,
        "cell": config.cell.model_dump(mode="json", exclude={"axis"}),
        "flow": config.flow.model_dump(mode="json", include={"viscosity_mPa_s"}),
    }


# --------------------------------------------------------------------------- error and run time


def replay(row: Mapping[str, Any], tolerance: float, max_rows: int) -> dict[str, Any]:
    """The row that the run would have given with another `orbit_tolerance` and `max_rows`.

    ``row``: a run that went at least as far. Its wall time and steps are taken in proportion to the
    rows.
    """
    import numpy as np

    from dldsim.trajectory import analyse_path

    lateral = np.concatenate([[0.0], np.cumsum(row["lateral_steps_um"])])
    last, result = len(lateral) - 1, None
    control = RunControl(max_rows=max_rows, orbit_tolerance=tolerance)
    for rows in range(1, last + 1):
        result = analyse_path(lateral[: rows + 1], row["pitch_um"], row["periodicity"], control)
        if result.status in SETTLED or rows >= max_rows:
            break
    if result is None or row["status"] not in (*SETTLED, "undecided"):
        return dict(row)
    share = rows / last
    return {
        **row, "status": result.status, "mode": result.mode, "rows_completed": rows,
        "migration_angle_deg": result.migration_angle_deg,
        "angle_low_deg": result.angle_low_deg, "angle_high_deg": result.angle_high_deg,
        "wall_time_s": row["wall_time_s"] * share, "steps": round(row["steps"] * share),
    }  # fmt: skip


def table(rows: Iterable[tuple[Variant, Mapping[str, Any]]], config: Config) -> list[dict]:
    """Rows of `accuracy` from the runs of the study (variant, its row).

    A point is one case at one setting: the mean over its starts. ``error``: difference from the
    finest value of the same knob, everything else at its default. ``error_to_reference``:
    difference from the combined reference. ``noise``: standard deviation of such a difference that
    comes of the starts alone, pooled over the case's points; a smaller error is none that the study
    resolves.
    """
    runs = dict(rows)
    result = []
    for quantity in (ANGLE, INDEX):
        cases = getattr(config.accuracy, quantity).cases
        named = cases.items() if quantity == ANGLE else [(group, group) for group in cases]
        for case, run in named:
            points = [p | {"quantity": quantity, "case": case, "run": run}
                      for p in _points(run, quantity, runs, config)]
            result += _compared(points)
    return result


def _points(run: str, quantity: str, runs: Mapping, config: Config) -> list[dict]:
    """The points of one case, those of a knob in the order of its values."""
    study = getattr(config.accuracy, quantity)
    count = len(starts(config)) if quantity == ANGLE else 1

    def of(knob: str, rank: int = 0) -> list[Mapping]:
        return [runs[Variant(run, knob, rank, start)] for start in range(count)]

    def point(kind, knob, rank, value, rows, is_default, is_reference) -> dict:
        return {"kind": kind, "knob": knob, "rank": rank, "setting": json.dumps(value),
                "is_default": is_default, "is_reference": is_reference} | _mean(rows, quantity)

    points = []
    for knob, values in study.knobs.items():
        default = default_of(knob, quantity, config)
        if quantity == ANGLE and knob in REPLAYED:
            control = {key: getattr(config.run_control, key) for key in REPLAYED}
            long = of(LONG)
            for rank, value in enumerate(values):
                stop = control | {knob: value}
                seen = [replay(r, stop["orbit_tolerance"], stop["max_rows"]) for r in long]
                points.append(point("knob", knob, rank, value, seen, value == default, False))
            points.append(point("knob", knob, len(values), f"all {study.long_rows} rows", long,
                                False, True))
            continue
        for rank, value in enumerate(values):
            rows = of(DEFAULT) if value == default else of(knob, rank)
            points.append(point("knob", knob, rank, value, rows, value == default,
                                rank == len(values) - 1))
    whole = {DEFAULT: {}, **study.alternatives}
    for rank, (name, value) in enumerate(whole.items()):
        rows = of(SETTING, rank - 1) if rank else of(DEFAULT)
        points.append(point(SETTING, name, rank, value, rows, rank == 0, False))
    if study.reference:
        points.append(point(SETTING, REFERENCE, len(whole), study.reference, of(REFERENCE), False,
                            True))
    return points


def _mean(rows: Sequence[Mapping], quantity: str) -> dict:
    """Mean over the starts of one setting; null where a run gives no value."""
    key = {ANGLE: "migration_angle_deg", INDEX: "deformation_index"}[quantity]
    values = [row[key] for row in rows]
    known = all(v is not None for v in values)

    def average(name: str) -> float | None:
        numbers = [row.get(name) for row in rows]
        return None if None in numbers else mean(numbers)

    def whole(name: str) -> int | None:
        number = average(name)
        return None if number is None else round(number)

    widths = [half_width(row) for row in rows]
    return {
        "values": [v for v in values if v is not None],
        "value": mean(values) if known else None,
        "spread": stdev(values) if known and len(values) > 1 else None,
        "bump_angle_deg": rows[0].get("bump_angle_deg"),
        "mode": "/".join(dict.fromkeys(row.get("mode", "") for row in rows)),
        "status": "/".join(dict.fromkeys(row["status"] for row in rows)),
        "settled": all(row["status"] in SETTLED for row in rows),
        "half_width_deg": None if None in widths else mean(widths),
        "rows": average("rows_completed"), "wall_time_s": average("wall_time_s"),
        "steps": whole("steps"), "nodes": whole("nodes"), "vertices": whole("vertices"),
        "spacing_um": average("spacing_um"),
    }  # fmt: skip


def _compared(points: list[dict]) -> list[dict]:
    """Points of one case with their errors, in the quantity's unit and as a share.

    The share is of the bump angle, or of the reference's deformation index: a cell that takes the
    wrong side of a pillar in every row is wrong by the bump angle, and no error can exceed it by
    much.
    """
    variances = [variance(p["values"]) for p in points if len(p["values"]) > 1]
    starts_ = max(len(p["values"]) for p in points)
    noise = math.sqrt(2 * mean(variances) / starts_) if variances else None
    [*_, whole] = [p["value"] for p in points if p["knob"] == REFERENCE] or [None]
    finest = {p["knob"]: p["value"] for p in points if p["kind"] == "knob" and p["is_reference"]}
    result = []
    for point in points:
        own = finest.get(point["knob"]) if point["kind"] == "knob" else whole
        scale = point["bump_angle_deg"] or whole
        errors = {}
        for name, target in (("error", own), ("error_to_reference", whole)):
            known = point["value"] is not None and target is not None
            errors[name] = abs(point["value"] - target) if known else None
            errors[f"{name}_share"] = errors[name] / scale if known and scale else None
        result.append({**point, **errors, "noise": noise,
                       "noise_share": noise / scale if noise is not None and scale else None})
    return result


# ------------------------------------------------------------------------ numerical uncertainty

KIND = "dldsim model of the numerical uncertainty"
MODEL_PATH = Path(__file__).parent / "data" / "sigma_num.json"
OPEN = ("undecided", "coexisting")
"""Outcomes whose mode depends on what was not seen, or on the place of entry."""
NORMAL_95 = 1.96
"""Half width of a 95 % interval in standard deviations."""
CLASSES = ("bump", "mixed", "zigzag")
ONE_SIGMA = 0.6827
CONDITIONS = ("cell_shape", "cell_radius_um", "height_um", "mean_velocity_mm_s")
RANGES = ("pillar_radius_um", "gap_um", "periodicity")
STUDIED_CONTROL = ("max_rows", "orbit_tolerance")
MODELLED, NOT_STUDIED, EXTRAPOLATED, SPANS = (
    "modelled", "not studied", "extrapolated", "spans the modes")
"""How the text beside a σ_num begins."""


def half_width(row: Mapping[str, Any]) -> float | None:
    """Half of the 95 % interval of an angle [°] in a row of `runs` or `outcomes`."""
    ends = row.get("angle_low_deg"), row.get("angle_high_deg")
    return None if None in ends else (ends[1] - ends[0]) / 2


def class_of(mode: str, status: str) -> str | None:
    """Class of the model, the mode, of a run or an outcome that is settled; else None."""
    return mode if status in (*SETTLED, "decided") else None


def confidence_factor(runs: int) -> float:
    """Student's t at one standard deviation (68.27 %, two-sided) with ``runs`` degrees of freedom.

    The errors' mean is taken as zero, not estimated, so that all runs are degrees of freedom.
    """
    from scipy.stats import t

    return float(t.ppf(0.5 + ONE_SIGMA / 2, runs))


def fit_model(pairs: Sequence[tuple[Mapping, Mapping]], config: Config) -> dict[str, Any]:
    """Model of σ_num from rows of `runs` at default settings and at the reference.

    σ_num² = (half width of the 95 % interval / 1.96)² + (c θ_bump)². For each class c is the root
    mean square of error / θ_bump times Student's factor for so few runs. The error's own share of
    the interval is not taken out of c, which is on the safe side. A class without runs has no c.
    """
    shares: dict[str, list[float]] = {name: [] for name in CLASSES}
    used = []
    for row, reference in pairs:
        name = class_of(row["mode"], row["status"])
        error = _error(row, reference)
        if name is None or error is None:
            continue
        shares[name].append(error / row["bump_angle_deg"])
        used.append((row, reference))
    classes = {}
    for name, values in shares.items():
        if values:
            rms = math.sqrt(mean(v * v for v in values))
            factor = confidence_factor(len(values))
            classes[name] = {"runs": len(values), "rms_share": rms, "confidence_factor": factor,
                             "share": rms * factor}
    ratios = [row["spacing_um"] / reference["spacing_um"] for row, reference in used]
    return {
        "kind": KIND,
        "dldsim_version": __version__,
        "physics_version": PHYSICS_VERSION,
        "classes": classes,
        "numerics": config.numerics.model_dump(mode="json"),
        "run_control": {key: getattr(config.run_control, key) for key in STUDIED_CONTROL},
        "reference": dict(config.accuracy.migration_angle.reference),
        "spacing_ratio": [min(ratios), max(ratios)] if ratios else None,
        "conditions": {key: used[0][0][key] for key in CONDITIONS} if used else {},
        "ranges": {
            key: [min(row[key] for row, _ in used), max(row[key] for row, _ in used)]
            for key in RANGES
        } if used else {},
        "runs": [row["run_id"].partition("--")[0] for row, _ in used],
        "study_hash": settings_hash(config.accuracy.model_dump(mode="json")),
    }  # fmt: skip


def _error(row: Mapping, reference: Mapping) -> float | None:
    angles = row["migration_angle_deg"], reference["migration_angle_deg"]
    return None if None in angles else angles[0] - angles[1]


def numerical_uncertainty(
    row: Mapping[str, Any], run_control: Mapping[str, Any], model: Mapping[str, Any] | None
) -> tuple[float | None, str]:
    """σ_num [°] of a row of `outcomes` (or `runs`), and on what it rests.

    Half a bump angle, beside the interval, for what is undecided or coexisting: σ spans the modes.
    Else None without a model, for another physics version, for numerics or stop criteria
    other than those studied, and for a class without studied runs: no error was measured there.
    Under conditions or in arrays beyond the study's there is a value that is called extrapolated.
    """
    half = half_width(row)
    if row["migration_angle_deg"] is None or half is None:
        return None, "no angle"
    interval = half / NORMAL_95
    if row["status"] in OPEN:
        sigma = math.hypot(interval, row["bump_angle_deg"] / 2)
        return sigma, f"{SPANS}: {row['status']}"
    if model is None:
        return None, f"{NOT_STUDIED}: no accuracy study is installed"
    if model["physics_version"] != PHYSICS_VERSION:
        return None, (f"{NOT_STUDIED}: the study is of physics version "
                      f"{model['physics_version']}, this is {PHYSICS_VERSION}")
    numerics = json.loads(row["numerics"])
    other = _differing(model["numerics"], numerics) + _differing(model["run_control"], run_control)
    if other:
        return None, f"{NOT_STUDIED}: {', '.join(other)}"
    name = class_of(row["mode"], row["status"])
    if name not in model["classes"]:
        return None, f"{NOT_STUDIED}: no run of the study is {name}"
    sigma = math.hypot(interval, model["classes"][name]["share"] * row["bump_angle_deg"])
    beyond = _differing(model["conditions"], row) + [
        f"{key} = {row[key]:g} (studied {low:g} to {high:g})"
        for key, (low, high) in model["ranges"].items() if not low <= row[key] <= high
    ]
    if beyond:
        return sigma, f"{EXTRAPOLATED}: {', '.join(beyond)}"
    return sigma, f"{MODELLED}: {name}, {model['classes'][name]['runs']} studied runs"


def _differing(studied: Mapping, found: Mapping) -> list[str]:
    return [f"{key} = {found.get(key)} (studied {value})" for key, value in studied.items()
            if found.get(key) != value]


def with_uncertainty(outcomes, run_control: Mapping[str, Any], model: Mapping[str, Any] | None):
    """A DataFrame of `outcomes` with its columns sigma_num_deg and sigma_num_basis filled."""
    rows = outcomes.astype(object).where(outcomes.notna(), None).to_dict("records")
    found = [numerical_uncertainty(row, run_control, model) for row in rows]
    return outcomes.assign(
        sigma_num_deg=[float("nan") if sigma is None else sigma for sigma, _ in found],
        sigma_num_basis=[basis for _, basis in found],
    )


def check_rows(
    pairs: Iterable[tuple[Mapping, Mapping]], model: Mapping[str, Any], config: Config
) -> list[dict]:
    """Rows of `sigma_num_runs`: the error of each run of the study beside the model's σ_num."""
    control = config.run_control.model_dump()
    checks = set(config.accuracy.check_runs)
    result = []
    for row, reference in pairs:
        run = row["run_id"].partition("--")[0]
        error = _error(row, reference)
        sigma, basis = numerical_uncertainty(row, control, model)
        known = error is not None and sigma is not None
        result.append({
            "run_id": run, "role": "check" if run in checks else "model",
            "class": class_of(row["mode"], row["status"]) or "none",
            **{key: row[key] for key in COPIED},
            "reference_angle_deg": reference["migration_angle_deg"],
            "reference_mode": reference["mode"], "reference_status": reference["status"],
            "half_width_deg": half_width(row),
            "reference_half_width_deg": half_width(reference),
            "reference_wall_time_s": reference["wall_time_s"],
            "reference_spacing_um": reference["spacing_um"],
            "error_deg": error, "sigma_num_deg": sigma, "sigma_num_basis": basis,
            "error_over_sigma": abs(error) / sigma if known and sigma > 0 else None,
        })  # fmt: skip
    return result


COPIED = (
    "pillar_radius_um", "gap_um", "periodicity", "stiffness_set", "mode", "status",
    "migration_angle_deg", "bump_angle_deg", "wall_time_s", "spacing_um",
)  # fmt: skip


def coverage(rows: Iterable[Mapping], role: str) -> dict[str, int]:
    """How many errors of the runs of one role are within one and two σ_num."""
    ratios = [r["error_over_sigma"] for r in rows
              if r["role"] == role and r["error_over_sigma"] is not None]
    return {"runs": len(ratios), "within_1_sigma": sum(r <= 1 for r in ratios),
            "within_2_sigma": sum(r <= 2 for r in ratios)}


def class_rows(model: Mapping[str, Any]) -> list[dict]:
    """Rows of `sigma_num`: the coefficients of the model, null for a class without runs."""
    blank = {"runs": 0, "rms_share": None, "confidence_factor": None, "share": None}
    return [{"class": name, **model["classes"].get(name, blank)} for name in CLASSES]


def study(
    rows: Iterable[tuple[Variant, Mapping[str, Any]]], config: Config
) -> tuple[list[dict], dict[str, Any], list[dict]]:
    """Rows of `accuracy`, the model of σ_num, and rows of `sigma_num_runs`."""
    runs = dict(rows)

    def pairs(names: Iterable[str]) -> list[tuple[Mapping, Mapping]]:
        return [(runs[Variant(n, DEFAULT)], runs[Variant(n, REFERENCE)]) for n in names]

    model = fit_model(pairs(config.accuracy.model_runs), config)
    both = pairs([*config.accuracy.model_runs, *config.accuracy.check_runs])
    checked = check_rows(both, model, config)
    model |= {"check": coverage(checked, "check")}
    return table(runs.items(), config), model, checked


def read_model(path: Path = MODEL_PATH) -> dict[str, Any] | None:
    """The model that comes with the package; None where no study has been installed.

    Raises DldsimError for a file that is no such model.
    """
    if not Path(path).exists():
        return None
    try:
        model = json.loads(Path(path).read_text(encoding="utf-8"))
        kind = model["kind"]
    except (ValueError, KeyError, TypeError) as error:
        raise DldsimError(f"{path} is damaged: {error!r}. {REMEDY}") from error
    if kind != KIND:
        raise DldsimError(f"{path} is no {KIND}. {REMEDY}")
    return model


def model_hash(path: Path = MODEL_PATH) -> str | None:
    """Hash of the installed model: the outcomes are gathered anew when another is installed."""
    model = read_model(path)
    return model and settings_hash(model)


REMEDY = "Put results/sigma_num.json of `snakemake -j2 accuracy` in its place, or take it away."
