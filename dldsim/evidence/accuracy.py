"""Error of migration angle and deformation index against run time.

Runs of known kind are repeated with one numerical setting changed, with whole settings changed,
and at a jointly finer reference. Array runs are repeated from other starts too: what their angles
differ by, the setting is not to blame for. Stopping earlier needs no run of its own: it is replayed
on one long run.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from statistics import mean, stdev, variance
from typing import Any, NamedTuple

from dldsim.config.assay_sections import ConstrictionAssay
from dldsim.config.assays import Membrane, settings_of_passages
from dldsim.config.configuration import Config
from dldsim.config.explain import check_value, validate
from dldsim.config.feasibility import check_array, check_channel, check_release
from dldsim.config.identifiers import OUTCOME_PATTERN, parse_outcome
from dldsim.config.sections import Cell, Constriction, Numerics, RunControl
from dldsim.errors import DldsimError
from dldsim.vocabulary import SETTLED

DEFAULT, LONG, SETTING, REFERENCE = "default", "long", "setting", "reference"
"""What a variant runs at, where it is not one value of a knob."""
ANGLE, INDEX = "migration_angle", "deformation_index"
SECTIONS = {ANGLE: ("numerics", "run_control", "cell"), INDEX: ("constriction", "numerics")}
"""Where a knob may live; the first that has it counts."""
REPLAYED = ("orbit_tolerance", "max_rows")
START, RELEASE = "release_gap_fraction", "release_position_um"


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
    return "runs" if quantity_of(variant.run) == ANGLE else "assay_runs"


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
                    f"accuracy.migration_angle.knobs.{START}: starts are varied in every run.",
                    key=f"accuracy.migration_angle.knobs.{START}",
                    value=values,
                    remedy="Name them in accuracy.migration_angle.other_starts.",
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
    return list(dict.fromkeys(wanted))


def section_of(knob: str, quantity: str, config: Config) -> str:
    """The section that holds a setting. Raises DldsimError for an unknown one."""
    for section in SECTIONS[quantity]:
        if knob in type(getattr(config, section)).model_fields:
            return section
    raise DldsimError(
        f"accuracy.{quantity} names {knob}, which is no key of {', '.join(SECTIONS[quantity])}.",
        key=f"accuracy.{quantity}",
        value=knob,
        allowed=f"a key of {', '.join(SECTIONS[quantity])}",
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
        DEFAULT: dict,
        LONG: lambda: {"min_rows": study.long_rows, "max_rows": study.long_rows},
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
    numerics = Numerics(**plain["numerics"])
    if quantity == ANGLE:
        geometry, name = parse_outcome(variant.run)
        check_array(geometry, config.flow, numerics)
        cell = Cell(**plain["cell"], release_gap_fraction=place)
        return {
            **plain,
            "cell": cell.model_dump(mode="json"),
            "flow": config.flow.model_dump(mode="json"),
            "geometry": geometry.model_dump(mode="json"),
            "stiffness_set": name,
            "stiffness": config.stiffness_sets[name].model_dump(mode="json"),
        }
    channel = Constriction(**plain["constriction"])
    [release] = check_value(Constriction, "release_positions_um", [release])
    check_channel(channel, numerics)
    check_release(release, channel, config.cell)
    channel = channel.model_copy(update={"release_positions_um": [release]})
    assay = ConstrictionAssay(kind="constriction", groups=True, channel=channel)
    group = config.constriction_groups[variant.run]
    membrane = Membrane(variant.run, group.stiffness, "", group.velocity_mm_s)
    return {
        "numerics": plain["numerics"],
        **settings_of_passages(assay, membrane, config.cell, config.flow),
    }


# --------------------------------------------------------------------------- error and run time


def replay(row: Mapping[str, Any], tolerance: float, max_rows: int) -> dict[str, Any]:
    """The row that the run would have given with another `orbit_tolerance` and `max_rows`.

    ``row``: a run that went at least as far, in which no depth of the bump lane was tried. Its
    processor time and steps are taken in proportion to the rows.
    """
    import numpy as np

    from dldsim.experiments.settling import analyse_path

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
        **row,
        "status": result.status,
        "mode": result.mode,
        "rows_completed": rows,
        "migration_angle_deg": result.migration_angle_deg,
        "angle_low_deg": result.angle_low_deg,
        "angle_high_deg": result.angle_high_deg,
        "processor_time_s": row["processor_time_s"] * share,
        "steps": round(row["steps"] * share),
    }


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
            points = [
                p | {"quantity": quantity, "case": case, "run": run}
                for p in _points(run, quantity, runs, config)
            ]
            result += _compared(points)
    return result


def half_width(row: Mapping[str, Any]) -> float | None:
    """Half of the 95 % interval of an angle [°] in a row of `runs` or `outcomes`."""
    ends = row.get("angle_low_deg"), row.get("angle_high_deg")
    return None if None in ends else (ends[1] - ends[0]) / 2


def in_words(value: Any) -> str:
    """A value as in a configuration file; of several settings, with their names."""
    if isinstance(value, Mapping):
        return ", ".join(f"{name} = {in_words(of)}" for name, of in value.items())
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.12g}" if isinstance(value, float) else str(value)


def _points(run: str, quantity: str, runs: Mapping, config: Config) -> list[dict]:
    """The points of one case, those of a knob in the order of its values."""
    study = getattr(config.accuracy, quantity)
    count = len(starts(config)) if quantity == ANGLE else 1

    def of(knob: str, rank: int = 0) -> list[Mapping]:
        return [runs[Variant(run, knob, rank, start)] for start in range(count)]

    def point(kind, knob, rank, value, rows, is_default, is_reference) -> dict:
        return {
            "kind": kind,
            "knob": knob,
            "rank": rank,
            "setting": in_words(value),
            "is_default": is_default,
            "is_reference": is_reference,
        } | _mean(rows, quantity)

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
            points.append(
                point("knob", knob, len(values), f"all {study.long_rows} rows", long, False, True)
            )
            continue
        for rank, value in enumerate(values):
            rows = of(DEFAULT) if value == default else of(knob, rank)
            points.append(
                point("knob", knob, rank, value, rows, value == default, rank == len(values) - 1)
            )
    whole = {DEFAULT: {}, **study.alternatives}
    for rank, (name, value) in enumerate(whole.items()):
        rows = of(SETTING, rank - 1) if rank else of(DEFAULT)
        points.append(point(SETTING, name, rank, value, rows, rank == 0, False))
    if study.reference:
        points.append(
            point(SETTING, REFERENCE, len(whole), study.reference, of(REFERENCE), False, True)
        )
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
        "rows": average("rows_completed"),
        "processor_time_s": average("processor_time_s"),
        "steps": whole("steps"),
        "nodes": whole("nodes"),
        "vertices": whole("vertices"),
        "spacing_um": average("spacing_um"),
    }


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
        result.append(
            {
                **point,
                **errors,
                "noise": noise,
                "noise_share": noise / scale if noise is not None and scale else None,
            }
        )
    return result
