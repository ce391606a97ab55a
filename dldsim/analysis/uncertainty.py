"""Numerical uncertainty σ_num of a migration angle, from the distance to the transition.

Where the bump lane is far from appearing or vanishing, the numerics change an angle by a small
share of the bump angle. Near the transition they decide the mode. How near is told by the
transition distance d (largest lateral step of a row in row shifts minus one) against the error σ_d
that it was seen to have on that side of the transition: in the bump lane d is its depth, on the
other side the peaks of the row map that a path has seen. The mode is wrong with probability
p = Φ(−|d|/σ_d), and

    σ_num² = (h/1.96)² + (c θ_bump)² + v Δ²,

h half the 95 % interval of the angle, c the share seen in pairs on the same side of the transition,
Δ the difference of the angle from that of the other side: the bump angle for a cell that does not
bump; for one that does, zero degrees, the farthest it can fall. v is the variance p (1 − p) of a
step of one. A step that is taken is then always 2 standard deviations or more, whatever p: where
the other mode is within the 95 % that 2 σ stand for, p ≥ 0.05, the mode is open, and v = 1/4, so
that 2 σ_num reach it.
"""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from dldsim import PHYSICS_VERSION, __version__
from dldsim.config.provenance import settings_hash
from dldsim.errors import DldsimError
from dldsim.tables.numerics import settings_of
from dldsim.vocabulary import ALIKE, BUMP, COEXISTING, RELEASED, SETTLED

Row = Mapping[str, Any]
Pair = tuple[Row, Row]
"""Rows of `outcomes` of one pair: at the campaign's numerics, at the reference's."""

KIND = "dldsim model of the numerical uncertainty by transition distance"
STUDIES = Path(__file__).parents[1] / "data" / "reference_outcomes"
"""Studies that come with the package, a folder for each shape of cells."""
MODEL = "sigma_num.json"
USUAL_SHAPE = "biconcave"
"""Of whose study σ_num is where a shape has none of its own, and then called extrapolated."""
ONE_SIGMA = 0.6827
OF_95_PERCENT = 1.96
"""Half width of a normal 95 % interval over its standard deviation."""
OPEN_FROM = 0.05
"""Probability of the other mode from which on the mode is open: less is what 2 σ leave out."""
LEAST_SHARE = 0.002
"""Of the bump angle: a lateral position resolved to 0.03 row shifts, after the fifteen rows or so
that a cell is followed. Pairs that repeat alike have the same angle to rounding."""
CONDITIONS = (
    "cell_shape",
    "aspect_ratio",
    "cell_radius_um",
    "release_axis",
    "height_um",
    "mean_velocity_mm_s",
    "drive",
)
RANGES = ("pillar_radius_um", "gap_um", "periodicity")
MODELLED, EXTRAPOLATED, NOT_STUDIED = "modelled", "extrapolated", "not studied"
SPANS, NO_ANGLE = "spans the modes", "no angle"
"""Kinds of σ_num, column `sigma_num_kind`."""
OPEN = ("undecided", COEXISTING)
"""Outcomes whose mode depends on what was not seen, or on the place of entry."""
SIDES = "bump lane", "no bump lane"
KNOWN = (ALIKE, *SETTLED)
"""Statuses of an outcome, and of a run, whose motion is known."""


def mode_probability(distance: float, sigma_distance: float) -> float:
    """Probability p = Φ(−|d|/σ_d) that the mode is the other one, ½ at d = 0."""
    return 0.5 * math.erfc(abs(distance) / sigma_distance / math.sqrt(2))


def step_variance(probability: float) -> float:
    """Factor v on the square of a step that is taken with a probability p up to ½."""
    return 0.25 if probability >= OPEN_FROM else probability * (1 - probability)


def confidence_factor(pairs: int) -> float:
    """Student's t at one standard deviation (68.27 %, two-sided) with ``pairs`` degrees of freedom.

    The errors' mean is taken as zero, not estimated, so that all pairs are degrees of freedom.
    """
    from scipy.stats import t

    return float(t.ppf(0.5 + ONE_SIGMA / 2, pairs))


def spread(errors: Sequence[float]) -> dict[str, Any]:
    """Root mean square of errors, Student's factor for so few of them, and the product; null
    without any."""
    if not errors:
        return {"pairs": 0, "rms": None, "confidence_factor": None, "value": None}
    rms = math.sqrt(sum(e * e for e in errors) / len(errors))
    factor = confidence_factor(len(errors))
    return {"pairs": len(errors), "rms": rms, "confidence_factor": factor, "value": rms * factor}


def fit_model(pairs: Sequence[Pair], domain: Mapping[str, Row] | None = None) -> dict[str, Any]:
    """Model of σ_num from outcomes at the campaign's and at finer numerics.

    ``domain``: of pairs, by identifier, at the campaign's numerics in the other domain. How far an
    outcome there is from that of the campaign is what periodic images do; small errors add up, so
    that it is added to that beside the finer lattice, which has the same images.

    ``distance``: σ_d from the pairs whose transition distance is known each time, from releases,
    by the side on which they are at the campaign's numerics. What goes on from a settled cell lacks
    the passes on the way there, so that its distance is another. ``share``: c from pairs that are
    decided each time, on the same side of the transition. ``lattice`` and ``images``: the root mean
    squares of both parts of either. What the intervals of the angles account for is not taken out
    of c, which is on the safe side. Raises DldsimError for pairs whose numerics differ, without
    pairs, and for a reference on no finer lattice, whose error would be none.
    """
    made_with: list[dict[str, Any]] = []
    for row, _ in pairs:
        if (numerics := settings_of(row)) not in made_with:
            made_with.append(numerics)
    if len(made_with) != 1:
        raise DldsimError(
            f"σ_num: {len(pairs)} pairs with {len(made_with)} different numerics; "
            "allowed: pairs of one campaign, at least one. Check reference.pairs."
        )
    distances: dict[str, list[Errors]] = {side: [] for side in SIDES}
    shares: list[Errors] = []
    ratios = []
    for row, reference in pairs:
        others = [reference]
        if domain:
            if row["outcome_id"] not in domain:
                raise DldsimError(
                    f"σ_num: {row['outcome_id']} was not simulated in the other domain."
                )
            others.append(domain[row["outcome_id"]])
        off = [_distance_error(row, other) for other in others]
        if None not in off:
            distances[_side(row)].append(off)
        off = [_share_error(row, other) for other in others]
        if None not in off:
            shares.append(off)
        if row["spacing_um"] and reference["spacing_um"]:
            ratios.append(row["spacing_um"] / reference["spacing_um"])
            if ratios[-1] <= 1:
                raise DldsimError(
                    f"σ_num: the reference of {row['outcome_id']} has a spacing of "
                    f"{reference['spacing_um']:.3g} µm; it must be below the campaign's "
                    f"{row['spacing_um']:.3g} µm. Lower reference.numerics.spacing_um."
                )
    rows = [row for row, _ in pairs]
    return {
        "kind": KIND,
        "dldsim_version": __version__,
        "physics_version": PHYSICS_VERSION,
        "distance": {side: _spread(errors, domain) for side, errors in distances.items()},
        "share": _spread(shares, domain),
        "numerics": made_with[0],
        "spacing_ratio": [min(ratios), max(ratios)] if ratios else None,
        "conditions": {key: rows[0][key] for key in CONDITIONS},
        "ranges": {key: [min(r[key] for r in rows), max(r[key] for r in rows)] for key in RANGES},
        "pairs": [row["outcome_id"] for row in rows],
        "pairs_hash": settings_hash(
            {
                "pairs": [
                    [row["migration_angle_deg"], ref["migration_angle_deg"]] for row, ref in pairs
                ]
            }
        ),
    }


Errors = Sequence[Any]
"""Of one outcome: beside a finer lattice and, if it was simulated, beside the other domain."""


def _distance_error(row: Row, other: Row) -> float | None:
    """Error of the transition distance; None where that is not known twice from releases."""
    known = row["transition_distance"], other["transition_distance"]
    return None if None in known or other["start"] != RELEASED else known[0] - known[1]


def _share_error(row: Row, other: Row) -> float | None:
    """Error of the angle over the bump angle; None but for decided outcomes on one side."""
    error = error_of(row, other)
    decided = row["status"] == other["status"] == ALIKE
    if error is None or not decided or _bumps(row) != _bumps(other):
        return None
    return error / row["bump_angle_deg"]


def _spread(errors: Sequence[Errors], domain: Mapping | None) -> dict[str, Any]:
    """`spread` of the sums, and the root mean squares of their parts."""
    parts = [spread([one[part] for one in errors])["rms"] for part in range(2 if domain else 1)]
    return {
        **spread([sum(one) for one in errors]),
        "lattice": parts[0],
        "images": parts[1] if domain else None,
    }


def _bumps(row: Row) -> bool:
    return row["mode"] == BUMP


def _side(row: Row) -> str:
    return SIDES[0] if _bumps(row) else SIDES[1]


def error_of(row: Row, reference: Row) -> float | None:
    """Angle minus that of the reference [°]; None where one has none."""
    angles = row["migration_angle_deg"], reference["migration_angle_deg"]
    return None if None in angles else angles[0] - angles[1]


def numerical_uncertainty(row: Row, model: Mapping[str, Any] | None) -> dict[str, Any]:
    """σ_num [°] of a row of `outcomes`, or of `runs`, and on what it rests: columns SIGMA.

    Where the outcome is not decided it is half the interval and half the bump angle, whatever is
    known of the numerics. Otherwise None without an angle or a model, for another physics version,
    for numerics other than those studied, and where the study has too few pairs. Under conditions
    or in arrays beyond the study's there is a value that is called extrapolated. Where the
    transition distance is unknown or at odds with the mode, p = ½ and Δ is the bump angle.
    """
    if row["migration_angle_deg"] is None:
        return _found(None, NO_ANGLE)
    bump, low, high = (row[key] for key in ("bump_angle_deg", "angle_low_deg", "angle_high_deg"))
    interval = 0.0 if None in (low, high) else (high - low) / 2 / OF_95_PERCENT
    if row["status"] not in KNOWN:
        return _found(math.hypot(interval, bump / 2), SPANS, row["status"], True)
    if model is None:
        return _found(None, NOT_STUDIED, "no reference is installed")
    if model["physics_version"] != PHYSICS_VERSION:
        return _found(
            None,
            NOT_STUDIED,
            f"the study is of physics version {model['physics_version']}, this is "
            f"{PHYSICS_VERSION}",
        )
    if other := _differing(model["numerics"], settings_of(row)):
        return _found(None, NOT_STUDIED, ", ".join(other))
    studied, share = model["distance"][_side(row)], model["share"]["value"]
    sigma_distance = studied["value"]
    if not sigma_distance or share is None:
        return _found(None, NOT_STUDIED, f"the study has too few pairs with {_side(row)}")
    share = max(share, LEAST_SHARE)
    distance = row["transition_distance"]
    if distance is None:
        chance, step, why = 0.5, bump, "its distance from the transition is unknown"
    elif distance > 0 and not _bumps(row) or distance < 0 and _bumps(row):
        chance, step = 0.5, bump
        why = f"mode {row['mode']} contradicts the transition distance {distance:.2g}"
    else:
        chance = mode_probability(distance, sigma_distance)
        angle = row["migration_angle_deg"]
        step = angle if _bumps(row) else bump - angle
        why = (
            f"{abs(distance) / sigma_distance:.1f} σ from the transition, "
            f"{studied['pairs']} studied pairs with {_side(row)}"
        )
    if is_open := chance >= OPEN_FROM:
        why = f"{SPANS}, {why}"
    sigma = math.sqrt(interval**2 + (share * bump) ** 2 + step_variance(chance) * step**2)
    beyond = _differing(model["conditions"], row) + [
        f"{key} = {row[key]:g} (studied {low:g} to {high:g})"
        for key, (low, high) in model["ranges"].items()
        if not low <= row[key] <= high
    ]
    if beyond:
        return _found(sigma, EXTRAPOLATED, f"{', '.join(beyond)}; {why}", is_open)
    return _found(sigma, MODELLED, why, is_open)


SIGMA = ("sigma_num_deg", "sigma_num_kind", "mode_open", "sigma_num_basis")
"""Columns of `outcomes` about σ_num."""


def _found(
    sigma_deg: float | None, kind: str, why: str = "", mode_open: bool | None = None
) -> dict[str, Any]:
    basis = f"{kind}: {why}" if why else kind
    return dict(zip(SIGMA, (sigma_deg, kind, mode_open, basis), strict=True))


def _differing(studied: Mapping, found: Mapping) -> list[str]:
    return [
        f"{key} = {found.get(key)} (studied {value})"
        for key, value in studied.items()
        if found.get(key) != value
    ]


def model_of(row: Row, models: Mapping[str, Mapping[str, Any]]) -> Mapping[str, Any] | None:
    """Of ``models``, by shape of cells, that which a row of `outcomes` or `runs` is judged by."""
    return models.get(row["cell_shape"], models.get(USUAL_SHAPE))


def with_uncertainty(outcomes, models: Mapping[str, Mapping[str, Any]]):
    """A DataFrame of `outcomes` with its columns SIGMA filled; ``models``: as of `read_models`."""
    rows = outcomes.astype(object).where(outcomes.notna(), None).to_dict("records")
    found = [numerical_uncertainty(row, model_of(row, models)) for row in rows]
    columns = {name: [values[name] for values in found] for name in SIGMA}
    columns["sigma_num_deg"] = [
        float("nan") if sigma is None else sigma for sigma in columns["sigma_num_deg"]
    ]
    return outcomes.assign(**columns)


# ------------------------------------------------------------------------------------ is it true?

BEYOND = 2.0
"""σ_num by which an angle differs that disagrees."""
COVERAGE_MARK = 0.9
"""Least share of pairs not fitted to that must be within BEYOND σ_num of their reference."""


def check_row(row: Row, reference: Row, model: Mapping[str, Any] | None) -> dict[str, Any]:
    """Row of `reference_check`: an outcome beside its reference."""
    error = error_of(row, reference)
    found = numerical_uncertainty(row, model)
    sigma, basis = found["sigma_num_deg"], found["sigma_num_basis"]
    ratio = abs(error) / sigma if error is not None and sigma else None
    return {
        **{key: row[key] for key in COPIED},
        **{f"reference_{key}": reference[key] for key in REFERENCE_COPIED},
        "reference_angle_deg": reference["migration_angle_deg"],
        "reference_distance": reference["transition_distance"],
        "error_deg": error,
        "sigma_num_deg": sigma,
        "sigma_num_basis": basis,
        "error_over_sigma": ratio,
        "verdict": verdict(ratio, ("agrees", "disagrees"), basis),
    }


COPIED = (
    "outcome_id",
    *RANGES,
    "stiffness_set",
    "mode",
    "status",
    "bump_angle_deg",
    "migration_angle_deg",
    "transition_distance",
    "spacing_um",
)
REFERENCE_COPIED = ("mode", "status", "start", "spacing_um")


def verdict(ratio: float | None, words: tuple[str, str], basis: str) -> str:
    """Whether a difference over σ_num stays within BEYOND, in the words for yes and no."""
    if ratio is None:
        return f"cannot be told: {basis}" if basis else "cannot be told"
    return f"{words[ratio > BEYOND]}: {ratio:.1f} σ_num"


def cross_validated(
    pairs: Sequence[Pair], domain: Mapping[str, Row] | None = None
) -> list[dict[str, Any]]:
    """Rows of `reference_check` in which no pair is judged by a model that has seen its array.

    ``domain``: as of `fit_model`. Raises DldsimError for pairs of one array only.
    """

    def array(pair: Pair) -> tuple:
        return tuple(pair[0][key] for key in RANGES)

    result = []
    for pair in pairs:
        others = [p for p in pairs if array(p) != array(pair)]
        result.append(check_row(*pair, fit_model(others, domain)))
    return result


def coverage(rows: Iterable[Row]) -> dict[str, Any]:
    """How many errors are within one and two σ_num, and whether those suffice."""
    ratios = [r["error_over_sigma"] for r in rows if r["error_over_sigma"] is not None]
    within = sum(r <= BEYOND for r in ratios)
    return {
        "pairs": len(ratios),
        "within_1_sigma": sum(r <= 1 for r in ratios),
        "within_2_sigma": within,
        "holds": bool(ratios) and within >= COVERAGE_MARK * len(ratios),
    }


def closing_sentence(rows: Sequence[Row]) -> str:
    """Who disagrees with the reference by how many σ_num."""
    seen = coverage(rows)
    apart = [
        f"{r['outcome_id']} ({r['error_over_sigma']:.1f} σ_num, {r['error_deg']:+.2f}°)"
        for r in rows
        if r["error_over_sigma"] is not None and r["error_over_sigma"] > BEYOND
    ]
    untold = len(rows) - seen["pairs"]
    sentence = (
        f"{seen['within_2_sigma']} of {seen['pairs']} pairs are within {BEYOND:g} σ_num of "
        f"the reference; {COVERAGE_MARK:.0%} must be."
    )
    if apart:
        sentence += f" Apart: {', '.join(apart)}."
    return sentence + (f" Of {untold} it cannot be told." if untold else "")


# ------------------------------------------------------------------------------------------ files


def read_models(studies: Path = STUDIES) -> dict[str, dict[str, Any]]:
    """The models that come with the package, by shape of cells.

    Raises DldsimError for a file that is no such model.
    """
    return {path.parent.name: read_model(path) for path in sorted(Path(studies).glob(f"*/{MODEL}"))}


def read_model(path: Path) -> dict[str, Any]:
    """The model of one study. Raises DldsimError for a file that is none."""
    try:
        model = json.loads(Path(path).read_text(encoding="utf-8"))
        kind = model["kind"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DldsimError(f"{path} is damaged: {error!r}. {REMEDY}") from error
    if kind != KIND:
        raise DldsimError(f"{path} is no {KIND}. {REMEDY}")
    return model


def models_hash(studies: Path = STUDIES) -> str | None:
    """Hash of the installed models: outcomes are gathered anew when another is installed."""
    models = read_models(studies)
    return settings_hash(models) if models else None


REMEDY = "Make it anew with `snakemake -j2 reference` and `make reference`, or take it away."
