"""Where the survey is simulated: first points that fill the space, then points of refining rounds.

A point is an array, a cell and a flow. What acts in Stokes flow is P_r/R, P_g/R, N_p, Ca = μU/k_s,
height/R and the shape (docs/survey.md); k_s is drawn as well, since k_ag and the contact do not
scale with it. All are drawn evenly in the logarithm, by a scrambled Sobol sequence.

A refining round looks for points at which the outcomes so far disagree: s is the standard deviation
over the trees of a random forest for the share of bump displacement N_p tan θ_m, d the distance to
the nearest point that is known or chosen, and the candidate of the largest (s + LEAST_SPREAD) d is
chosen, one after the other.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dldsim import laws
from dldsim.analysis.features import share_of
from dldsim.analysis.stiffness import stiffness_at
from dldsim.config.feasibility import check_array, check_images, check_passable
from dldsim.config.identifiers import Pair, outcome_id
from dldsim.config.provenance import derive_seed
from dldsim.config.sections import CellShape, Flow, Geometry, Numerics, Stiffness
from dldsim.config.survey_section import SurveyShape
from dldsim.errors import DldsimError

Row = Mapping[str, Any]

FEATURES = (
    "pillar_radius_to_radius",
    "gap_to_radius",
    "periodicity",
    "capillary_number",
    "height_to_radius",
)
"""What is drawn, in the order of the coordinates; k_s is the last coordinate."""
CANDIDATES = 4096
"""Points from which a refining round chooses."""
BAND_POOL = 64
"""Points of the sequence for each one that is asked for, among which those in the band are."""
TREES = 300
LEAST_SPREAD = 0.05
"""Share of bump displacement: where the trees agree better, the distance decides."""


def plan(
    round_: int, settings: Any, outcomes: Sequence[Row] = (), seed: int = 1
) -> list[dict[str, Any]]:
    """Rows of `survey_plan` of one round; ``outcomes``: rows of all earlier rounds.

    ``settings`` has the sections survey, cell, flow, numerics and stiffness_sets. Raises
    DldsimError for a point that no lattice carries or whose cell does not pass, for a band without
    points, and for a round after others of which no outcome has an angle.
    """
    members = settings.survey.members()
    rows = []
    for shape, drawn in settings.survey.shapes.items():
        numbers = [n for n, member in enumerate(members) if member == (round_, shape)]
        name = f"survey, {shape}, round {round_}"
        if not numbers:
            continue
        if round_ == 0:
            points, why = _first_points(drawn, len(numbers), derive_seed(seed, name), shape)
        else:
            known = [row for row in outcomes if row["cell_shape"] == shape]
            points, why = _refining_points(
                drawn, len(numbers), derive_seed(seed, name), shape, known, settings.flow
            )
        rows += [
            _row(number, round_, shape, point, reason, settings)
            for number, point, reason in zip(numbers, points, why, strict=True)
        ]
    return rows


def sobol(exponent: int, seed: int) -> np.ndarray:
    """2^exponent scrambled Sobol points (points, 6) in the unit cube."""
    from scipy.stats import qmc

    return qmc.Sobol(len(FEATURES) + 1, rng=seed).random_base2(exponent)


def values_at(points: np.ndarray, drawn: SurveyShape) -> np.ndarray:
    """FEATURES (points, 5) at unit coordinates: even in the logarithm, N_p whole."""
    columns = []
    for name, share in zip(FEATURES, points.T, strict=False):
        low, high = getattr(drawn, name)
        if name == "periodicity":  # every whole number with its share of the logarithm
            low, high = low - 0.5, high + 0.5
        value = low * (high / low) ** share
        columns.append(np.rint(value) if name == "periodicity" else value)
    return np.column_stack(columns)


def coordinates(values: np.ndarray, drawn: SurveyShape) -> np.ndarray:
    """Logarithms of FEATURES (points, 5), 0 at the lower and 1 at the upper end of the range."""
    ends = np.log([getattr(drawn, name) for name in FEATURES])
    widths = np.where(ends[:, 1] > ends[:, 0], ends[:, 1] - ends[:, 0], 1.0)
    return (np.log(values) - ends[:, 0]) / widths


def critical_ratio(values: np.ndarray) -> np.ndarray:
    """2R/D_c (points) of a stiff sphere of the same radius, by D_c = 1.4 G ε^0.48."""
    return 2 / laws.critical_diameter(values[:, 1], 1 / values[:, 2])


def _first_points(drawn: SurveyShape, count: int, seed: int, shape: str):
    """Half of the points anywhere, the others the next of the sequence in the band."""
    pool = sobol(math.ceil(math.log2(BAND_POOL * count)), seed)
    low, high = drawn.transition_band
    anywhere = (count + 1) // 2
    ratio = critical_ratio(values_at(pool, drawn))
    inside = [i for i in range(anywhere, len(pool)) if low <= ratio[i] <= high]
    if len(inside) < count - anywhere:
        raise DldsimError(
            f"survey.shapes.{shape}.transition_band: of {len(pool)} points drawn {len(inside)} "
            f"have 2R/D_c of {low:g} to {high:g}, {count - anywhere} are needed.",
            key=f"survey.shapes.{shape}.transition_band",
            value=drawn.transition_band,
            allowed=f"what the ranges reach, {ratio.min():.2g} to {ratio.max():.2g}",
            remedy="Widen the band, or the ranges of gap_to_radius and periodicity.",
        )
    why = ["fills the space"] * anywhere
    why += [
        f"fills the band around the critical diameter: 2R/D_c = {ratio[i]:.2f}"
        for i in inside[: count - anywhere]
    ]
    return pool[[*range(anywhere), *inside[: count - anywhere]]], why


def _refining_points(
    drawn: SurveyShape, count: int, seed: int, shape: str, known: Sequence[Row], flow: Flow
):
    """Candidates where the forest's trees disagree, away from each other and from what is known."""
    values = np.array([_values_of(row, flow) for row in known]).reshape(-1, len(FEATURES))
    share = np.array([bump_share(row) for row in known])
    told = ~np.isnan(share)
    if not told.any():
        raise DldsimError(
            f"survey: none of {len(known)} outcomes of shape {shape} has an angle to learn from.",
            key=f"survey.shapes.{shape}",
            value=f"{len(known)} outcomes without an angle",
            allowed="at least one outcome with an angle",
            remedy="Look at stop_reason in results/survey/points, or set survey.rounds to 0.",
        )
    pool = sobol(round(math.log2(CANDIDATES)), seed)
    candidates = values_at(pool, drawn)
    spread = forest_spread(values[told], share[told], candidates, seed)
    where, done = coordinates(candidates, drawn), coordinates(values, drawn)
    distance = np.min(np.linalg.norm(where[:, None] - done, axis=2), axis=1)
    chosen, why = [], []
    for _ in range(count):
        best = int(np.argmax((spread + LEAST_SPREAD) * distance))
        chosen.append(best)
        why.append(
            f"trees of the forest differ by {spread[best]:.2f} of bump displacement (standard "
            f"deviation), {distance[best]:.2f} from the nearest point"
        )
        distance = np.minimum(distance, np.linalg.norm(where - where[best], axis=1))
    return pool[chosen], why


def forest_spread(
    values: np.ndarray, share: np.ndarray, candidates: np.ndarray, seed: int
) -> np.ndarray:
    """Standard deviation over the trees (candidates) of a forest fitted to shares (points).

    Inputs are the logarithms of FEATURES and of 2R/D_c, along which the mode changes.
    """
    from sklearn.ensemble import RandomForestRegressor

    def inputs(rows: np.ndarray) -> np.ndarray:
        return np.log(np.column_stack([rows, critical_ratio(rows)]))

    forest = RandomForestRegressor(TREES, random_state=seed, n_jobs=1)
    forest.fit(inputs(values), share)
    asked = inputs(candidates)
    return np.std([tree.predict(asked) for tree in forest.estimators_], axis=0)


def bump_share(row: Row) -> float:
    """N_p tan θ_m of an outcome, 1 in full bump mode; NaN without an angle."""
    angle = row["migration_angle_deg"]
    return math.nan if angle is None else float(share_of(angle, row["periodicity"]))


def _values_of(row: Row, flow: Flow) -> list[float]:
    """FEATURES of an outcome, also of one that failed."""
    radius = row["cell_radius_um"]
    return [
        row["pillar_radius_um"] / radius,
        row["gap_um"] / radius,
        row["periodicity"],
        flow.viscosity_mPa_s * row["mean_velocity_mm_s"] / row["ks_uN_per_m"],
        row["height_um"] / radius,
    ]


def _row(
    number: int, round_: int, shape: str, point: np.ndarray, why: str, settings: Any
) -> dict[str, Any]:
    """Row of `survey_plan` at unit coordinates (6): the point as it can be simulated."""
    radius = settings.cell.radius_um
    [values] = values_at(point[None], settings.survey.shapes[shape])
    geometry = Geometry(
        pillar_radius_um=round(float(values[0]) * radius, 3),
        gap_um=round(float(values[1]) * radius, 3),
        periodicity=int(values[2]),
    )
    height = lattice_height_um(float(values[4]) * radius, geometry, settings.numerics)
    stiffness = _stiffness(float(point[-1]), settings.stiffness_sets)
    velocity = float(values[3]) * stiffness.ks_uN_per_m / settings.flow.viscosity_mPa_s
    cell = settings.cell.model_copy(update={"shape": shape})
    name = f"{NAMES.get(shape, shape)}-{number:04d}"
    _check(name, geometry, cell, height, settings)
    return {
        "number": number,
        "round": round_,
        "outcome_id": outcome_id(Pair(geometry, name)),
        **geometry.model_dump(),
        "pitch_um": geometry.pitch_um,
        "row_shift_fraction": geometry.row_shift_fraction,
        "stiffness_set": name,
        "cell_shape": shape,
        "cell_radius_um": radius,
        "height_um": height,
        **stiffness.model_dump(),
        "mean_velocity_mm_s": velocity,
        "capillary_number": float(values[3]),
        "why": why,
    }


NAMES = {"biconcave": "disc"}
"""What a shape is called in identifiers, if not by its name."""


def lattice_height_um(height_um: float, geometry: Geometry, numerics: Numerics) -> float:
    """The next height that is a whole number of the array's nodes, so that it is what is simulated
    [µm, thousandths]."""
    spacing, _ = laws.whole_shift_spacing(geometry, numerics.spacing_um)
    return round(math.ceil(height_um / spacing - 1e-6) * spacing, 3)


def _stiffness(share: float, sets: Mapping[str, Stiffness]) -> Stiffness:
    """Moduli at k_s between those of the softest and the stiffest set, even in the logarithm."""
    ks = [s.ks_uN_per_m for s in sets.values()]
    least, most = min(ks), max(ks)
    if not least > 0:
        raise DldsimError(
            key="stiffness_sets",
            value=f"k_s = {least:g} µN/m",
            allowed="k_s above 0, since Ca = μU/k_s",
            remedy="Leave that stiffness set out of the survey's configuration.",
        )
    return stiffness_at(min(least * (most / least) ** share, most), sets, "stiffness_sets")


def _check(name: str, geometry: Geometry, cell: CellShape, height_um: float, settings: Any) -> None:
    """Refuse a point that cannot be simulated, before anything is."""
    flow = settings.flow.model_copy(update={"height_um": height_um})
    try:
        check_passable(geometry, cell, height_um)
        check_array(geometry, flow, settings.numerics)
        check_images(geometry, cell, settings.numerics)
    except DldsimError as error:
        raise DldsimError(
            f"survey, point {name}: {error}",
            key=error.keys,
            value=error.value,
            allowed=error.allowed,
            remedy="Or change the ranges of the section survey.",
        ) from None
