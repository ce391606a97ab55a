"""Critical gaps: at which gap the bump lane of an array and a cell vanishes, at several numerics.

The gap is searched on the transition distance d, the largest lateral step of a row in row shifts
minus one: d is continuous where the mode is not. The critical gap at one setting after another
shows whether and how fast it converges (:mod:`dldsim.evidence.convergence`).

One thing is changed at a time. The row shift must be a whole number of nodes, so that the lattice
spacing follows the gap; within a search the number of nodes per row shift is held, which keeps the
spacing in proportion to the pitch. The spacing at the critical gap is recorded, and is what orders
of convergence are computed with; likewise the numerical Reynolds number that the runs had. The
height on the lattice, a whole number of nodes, changes by up to half a node and is recorded too.

The plan is read by rule files: nothing heavy is imported at the top.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from dldsim.config.configuration import Config
from dldsim.config.identifiers import geometry_id
from dldsim.config.sections import Geometry
from dldsim.config.study_sections import CriticalGap, Reference
from dldsim.errors import DldsimError
from dldsim.evidence.reference_study import CAMPAIGN, Row, common_sections
from dldsim.laws import COARSER_ALLOWED, critical_diameter, whole_shift_spacing
from dldsim.vocabulary import ALIKE, BUMP

TOLERANCE = 0.01
"""Width of the final bracket over the critical gap."""
POINTS = 10
"""Gaps simulated in a search at most; four to seven are usual."""
SPHERE = "sphere"
"""Stands for the stiffness set of a stiff sphere."""
SPACING, REYNOLDS = "spacing_um", "reynolds_max"
BRACKET_OF_LAW = 0.75, 1.3
"""Bracket of a sphere's critical gap over that of the law, whose own scatter is ±10 %."""


class Search(NamedTuple):
    """A transition searched at one setting: array without its gap, membrane, knob, rank of value.

    The search at the campaign's own numerics has the knob "campaign".
    """

    pillar_radius_um: float
    periodicity: int
    stiffness_set: str
    knob: str = CAMPAIGN
    rank: int = 0

    @property
    def at_campaign(self) -> "Search":
        """The search of the same transition at the campaign's numerics."""
        return self._replace(knob=CAMPAIGN, rank=0)


def search_id(search: Search) -> str:
    """Identifier such as r08.0_n10_s1--spacing_um--2."""
    radius, _, periodicity = geometry_id(_array(search, 10.0)).split("_")
    return f"{radius}_{periodicity}_s{search.stiffness_set}--{search.knob}--{search.rank}"


SEARCH_PATTERN = r"r\d\d+\.\d+_n\d\d+_s[A-Za-z0-9-]+?--[a-z_]+--\d+"


def parse_search(text: str) -> Search:
    """The inverse of `search_id`."""
    case, knob, rank = text.split("--")
    radius, periodicity, stiffness_set = case.split("_", 2)
    return Search(float(radius[1:]), int(periodicity[1:]), stiffness_set[1:], knob, int(rank))


def transitions(study: Reference) -> list[CriticalGap]:
    """All transitions that are searched, those of stiff spheres last.

    The pillars of a sphere's array have half the radius of the gap that the law expects.
    """
    spheres = []
    for periodicity in study.critical_diameters.periodicities:
        gap = 2 * study.critical_diameters.radius_um / critical_diameter(1, 1 / periodicity)
        spheres.append(
            CriticalGap(
                pillar_radius_um=round(gap / 2, 1),
                periodicity=periodicity,
                stiffness_set=SPHERE,
                bracket_um=tuple(round(gap * share, 1) for share in BRACKET_OF_LAW),
            )
        )
    return [*study.critical_gaps, *spheres]


def searches(config: Config) -> list[Search]:
    """All searches: of each transition one at the campaign's numerics, and one per other value.

    Raises DldsimError if a transition is named twice.
    """
    study = config.reference
    wanted = []
    for gap in transitions(study):
        first = Search(gap.pillar_radius_um, gap.periodicity, gap.stiffness_set)
        wanted.append(first)
        for knob, values in knobs(study).items():
            own = getattr(config.numerics, knob)
            wanted += [first._replace(knob=knob, rank=i) for i, v in enumerate(values) if v != own]
    if len(set(wanted)) < len(wanted):
        raise DldsimError(
            "reference.critical_gaps names a transition twice.",
            key="reference.critical_gaps",
            remedy="Leave one out.",
        )
    return wanted


def knobs(study: Reference) -> dict[str, list[float]]:
    return {SPACING: study.spacings_um, REYNOLDS: study.reynolds_max}


def _array(search: Search, gap_um: float) -> Geometry:
    return Geometry(
        pillar_radius_um=search.pillar_radius_um, gap_um=gap_um, periodicity=search.periodicity
    )


def search_settings(search: Search, config: Config) -> dict[str, Any]:
    """Everything that a search depends on, as plain values."""
    study = config.reference
    [bracket] = [
        gap.bracket_um
        for gap in transitions(study)
        if (gap.pillar_radius_um, gap.periodicity, gap.stiffness_set) == search[:3]
    ]
    numerics = config.numerics.model_dump(mode="json")
    if search.knob != CAMPAIGN:
        numerics[search.knob] = knobs(study)[search.knob][search.rank]
    settings = {
        "bracket_um": list(bracket),
        "numerics": numerics,
        **common_sections(config),
        "stiffness_set": search.stiffness_set,
    }
    if search.stiffness_set == SPHERE:
        sphere = study.critical_diameters
        settings["cell"] |= {"shape": "sphere", "radius_um": sphere.radius_um}
        settings["flow"] |= {"height_um": sphere.height_um}
        settings["stiffness"] = sphere.stiffness.model_dump(mode="json")
    else:
        stiffness = config.stiffness_sets[search.stiffness_set]
        settings["stiffness"] = stiffness.model_dump(mode="json")
    return settings


def held_numerics(search: Search, gap_um: float, settings: Mapping[str, Any]) -> dict[str, Any]:
    """The numerics with the spacing at which this gap has as many nodes per row shift as the
    middle of the bracket."""

    numerics = dict(settings["numerics"])
    middle = _array(search, sum(settings["bracket_um"]) / 2)
    _, nodes = whole_shift_spacing(middle, numerics[SPACING])
    shift_um = _array(search, gap_um).pitch_um / search.periodicity
    numerics[SPACING] = shift_um / (COARSER_ALLOWED * (nodes - 0.5))
    return numerics


BUMPS, DOES_NOT, UNKNOWN = 1, -1, 0
"""Side of the transition on which a gap lies; unknown for a cell that stuck or a run that broke."""


def side_of(outcome: Row) -> int:
    """Side of the transition: by the mode of a decided outcome, else by the transition distance,
    else by the mode so far."""
    distance, mode = outcome["transition_distance"], outcome["mode"]
    if mode == "none":
        return UNKNOWN
    if outcome["status"] == ALIKE or distance is None:
        return BUMPS if mode == BUMP else DOES_NOT
    return BUMPS if distance > 0 else DOES_NOT


def ends(points: Sequence[Row]) -> tuple[Row | None, Row | None]:
    """The largest gap at which the cell bumps and the smallest at which it does not."""
    low = max((p for p in points if p["side"] == BUMPS), key=_gap, default=None)
    high = min((p for p in points if p["side"] == DOES_NOT), key=_gap, default=None)
    return low, high


def _gap(point: Row) -> float:
    return point["gap_um"]


class Start(NamedTuple):
    """Where a search begins that knows another's result: gap [µm], slope of d over the gap [1/µm],
    negative, or None."""

    gap_um: float
    slope: float | None


def next_gap(
    points: Sequence[Row], bracket: Sequence[float], start: Start | None = None
) -> float | None:
    """The next gap [µm] of a search, or None at its end.

    Regula falsi on the transition distance, truncated and projected (ITP, Oliveira & Takahashi
    2021, ACM Trans. Math. Softw. 47:5) so that it takes at most one point more than bisection, and
    overshooting by half the tolerance so that the bracket closes. With a start the bracket is found
    from there, by Newton's step and then twice as far each time, else its ends are simulated first.
    The search ends early where a side is unknown and where the bracket holds no transition.
    """
    if any(p["side"] == UNKNOWN for p in points):
        return None
    low, high = ends(points)
    if low is None or high is None:
        return _next_outward(points, bracket, start)
    if closed(low, high):
        return None
    middle, half = (low["gap_um"] + high["gap_um"]) / 2, (high["gap_um"] - low["gap_um"]) / 2
    tolerance = TOLERANCE * low["gap_um"]
    root = _root(low, high)
    inward = math.copysign(min(0.45 * tolerance, abs(middle - root)), middle - root)
    first, since = _first_bracket(points)
    bisections = math.ceil(math.log2(max(first / tolerance, 1.0)))
    reach = max(tolerance / 2 * 2.0 ** (bisections + 1 - since) - half, 0.0)
    return round(min(max(root + inward, middle - reach), middle + reach), 3)


def _first_bracket(points: Sequence[Row]) -> tuple[float, int]:
    """Width of the bracket when both sides had been seen first, and points simulated since."""
    count = next(n for n in range(2, len(points) + 1) if None not in ends(points[:n]))
    low, high = ends(points[:count])
    return high["gap_um"] - low["gap_um"], len(points) - count


def closed(low: Row, high: Row) -> bool:
    """Whether a bracket is as narrow as the tolerance."""
    return high["gap_um"] - low["gap_um"] <= TOLERANCE * (high["gap_um"] + low["gap_um"]) / 2


def _next_outward(points, bracket, start) -> float | None:
    """The next gap while the transition has been seen from one side at most."""
    if not points:
        return start.gap_um if start else bracket[0]
    last = points[-1]
    limit = bracket[1] if last["side"] == BUMPS else bracket[0]
    if last["gap_um"] == limit:
        return None
    if start is None:
        return limit
    distance, slope = last["transition_distance"], start.slope
    newton = abs(distance / slope) if slope and distance is not None else 0.0
    step = (newton + 0.75 * TOLERANCE * last["gap_um"]) * 2 ** (len(points) - 1) * last["side"]
    return round(min(max(last["gap_um"] + step, bracket[0]), bracket[1]), 3)


def _root(low: Row, high: Row) -> float:
    """Gap [µm] at which the line through both distances vanishes; the middle if one is unknown or
    at odds with its side."""
    at_low, at_high = low["transition_distance"], high["transition_distance"]
    if at_low is None or at_high is None or at_low <= 0 or at_high > 0:
        return (low["gap_um"] + high["gap_um"]) / 2
    share = at_low / (at_low - at_high)
    return low["gap_um"] + share * (high["gap_um"] - low["gap_um"])


def start_from(points: Sequence[Row]) -> Start | None:
    """What the points of one search tell another; None where they hold no transition."""
    low, high = ends(points)
    if low is None or high is None:
        return None
    distances = low["transition_distance"], high["transition_distance"]
    slope = None
    if None not in distances and distances[0] > distances[1]:
        slope = (distances[1] - distances[0]) / (high["gap_um"] - low["gap_um"])
    return Start(round(_root(low, high), 3), slope)


Simulate = Callable[[Geometry, Mapping[str, Any]], Row]
"""Row of `outcomes` of an array at the given numerics."""


def advance(
    search: Search,
    points: Sequence[Row],
    settings: Mapping[str, Any],
    simulate: Simulate,
    start: Start | None = None,
) -> list[Row]:
    """The points of a search and one more; as they are where the search has ended.

    A point is a row of `critical_gap_points`.
    """
    gap = next_gap(points, settings["bracket_um"], start)
    if gap is None:
        return list(points)
    outcome = simulate(_array(search, gap), held_numerics(search, gap, settings))
    height = settings["flow"]["height_um"]
    spacing = outcome["spacing_um"]
    return [
        *points,
        {
            "search": search_id(search),
            "number": len(points),
            "gap_um": gap,
            "side": side_of(outcome),
            "height_on_lattice_um": round(height / spacing) * spacing,
            **{key: outcome[key] for key in COPIED},
        },
    ]


COPIED = (
    "transition_distance",
    "status",
    "mode",
    "migration_angle_deg",
    "spacing_um",
    "lag_number",
    "releases",
    "wall_time_s",
)


def result(search: Search, points: Sequence[Row], settings: Mapping[str, Any]) -> dict[str, Any]:
    """Row of `critical_gaps` from the points of a search; gaps null where it found no transition.

    The critical gap is interpolated linearly between the ends of the last bracket, and so are the
    spacing, the height on the lattice and the numerical Reynolds number there.
    """
    low, high = ends(points)
    known = low is not None and high is not None
    gap = _root(low, high) if known else None

    def at_gap(name: str) -> float | None:
        if not known:
            return None
        share = (gap - low["gap_um"]) / (high["gap_um"] - low["gap_um"])
        return low[name] + share * (high[name] - low[name])

    cell = settings["cell"]
    return {
        "search": search_id(search),
        "pillar_radius_um": search.pillar_radius_um,
        "periodicity": search.periodicity,
        "stiffness_set": search.stiffness_set,
        "cell_shape": cell["shape"],
        "cell_radius_um": cell["radius_um"],
        "height_um": settings["flow"]["height_um"],
        "height_on_lattice_um": at_gap("height_on_lattice_um"),
        "knob": search.knob,
        "spacing_asked_um": settings["numerics"][SPACING],
        "spacing_um": at_gap("spacing_um"),
        "reynolds_max": settings["numerics"][REYNOLDS],
        "lag_number": at_gap("lag_number"),
        "critical_gap_um": gap,
        "low_um": low["gap_um"] if low else None,
        "high_um": high["gap_um"] if high else None,
        "diameter_over_gap": 2 * cell["radius_um"] / gap if known else None,
        "points": len(points),
        "runs": sum(p["releases"] for p in points),
        "wall_time_s": sum(p["wall_time_s"] or 0.0 for p in points),
        "note": _note(points, low, high),
    }


def _note(points: Sequence[Row], low: Row | None, high: Row | None) -> str:
    for point in points:
        if point["side"] == UNKNOWN:
            return f"ended: at a gap of {point['gap_um']:g} µm the outcome is {point['status']}"
    if low is None or high is None:
        gaps = ", ".join(f"{p['gap_um']:g}" for p in points)
        return (
            f"the bracket holds no transition: {'none' if low is None else 'all'} of the "
            f"gaps {gaps} µm bump"
        )
    remarks = [] if closed(low, high) else [f"bracket not closed after {len(points)} points"]
    if unsettled := sum(p["status"] != ALIKE for p in points):
        remarks.append(f"{unsettled} of {len(points)} outcomes are not decided")
    return "; ".join(remarks)
