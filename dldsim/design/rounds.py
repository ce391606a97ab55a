"""Candidates become designs: both cell types are simulated in the array that was searched for.

Prediction and simulation are compared, the outcomes are learnt from, and the search begins anew,
until they agree or the budget is spent.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import pandas as pd

from dldsim.analysis.surrogate import Surrogate
from dldsim.config import identifiers
from dldsim.config.design_sections import DesignRequest
from dldsim.config.design_sections import Verification as Budget
from dldsim.config.provenance import derive_seed
from dldsim.config.sections import Geometry
from dldsim.design.candidates import distinct, transition_geometries
from dldsim.design.cell_source import CellSource
from dldsim.design.chip import Chip
from dldsim.design.motion import UNKNOWN, History
from dldsim.design.populations import Population
from dldsim.design.search import search
from dldsim.design.task import Task
from dldsim.design.verdict import compare, difference_of, parts
from dldsim.design.verified import Stop, Verdicts, design_table
from dldsim.errors import DldsimError
from dldsim.experiments.outcome_files import Progress
from dldsim.tables.registry import COLUMNS, TABLES
from dldsim.vocabulary import GEOMETRY

Each = Callable[[Callable[[Population], dict], Sequence[Population]], Iterable[dict]]
"""`map`, or the like of it."""


def verify(
    surrogate: Surrogate,
    outcomes: pd.DataFrame,
    request: DesignRequest,
    chip: Chip,
    budget: Budget,
    populations: Sequence[Population],
    simulate: Callable[..., dict],
    seed: int,
    *,
    sources: Sequence[CellSource] | None = None,
    history: Sequence[History] = (UNKNOWN, UNKNOWN),
    fit: Callable[[pd.DataFrame, int], Surrogate] | None = None,
    resistance: Callable[[Geometry], Mapping[str, Any]] | None = None,
    each: Each = map,
    glance: Callable[..., dict] | None = None,
    progress: Progress | None = None,
) -> Verdicts:
    """Search, simulate, compare and learn, in rounds.

    A round searches on the surrogate, simulates both cell types in the best candidates that have
    not been simulated, and in arrays near a mode transition, and refits the surrogate to all.
    Rounds end when every new prediction of a candidate is confirmed and had told the order of the
    two cells, when the best candidates have all been simulated, or with the budget. A prediction is
    confirmed if the simulated value, with ± σ_num, meets its interval; it is compared only where
    the surrogate interpolates.

    The best designs in which the cells part are simulated once more on a finer lattice at half the
    numerical Reynolds number, with images of the cell farther off: only what parts them there as
    well counts as separating. Where both go alike there from the first place of release, as where
    both bump, they do not, and no other place is simulated (`denied`).

    ``populations``: the request's cell types, ``chip``: at its flow, ``sources`` and ``history`` as
    of `Task`. ``simulate(geometry, population, height_um, finer)`` returns a row of `outcomes`,
    ``glance`` the same from the first place of release, ``resistance`` one of `flows`; ``each``
    maps the simulation over the two cell types. The best verified design is simulated at
    ± height_tolerance_um too, and learnt from as well.

    Raises DldsimError as `search` does.
    """
    from dldsim.analysis import surrogate as model

    fit, cells = fit or model.fit, (sources, history)
    say = progress or (lambda sentence: None)
    records: list[dict] = []
    pairs: dict[int, dict] = {}
    rows: dict[str, dict] = {}
    learnt = surrogate
    stop, number = Stop.ROUNDS, budget.rounds
    spent = 0
    candidates = pd.DataFrame()
    for number in range(1, budget.rounds + 1):
        task = Task(
            learnt, request, populations, chip, derive_seed(seed, f"round {number}"), *cells
        )
        candidates = search(learnt, request, populations, chip, task.seed, None, *cells).designs
        best = candidates.head(budget.designs_per_round).to_dict("records")
        tried = [pair["place"] for pair in pairs.values()]
        new = [c for c in best if all(distinct(request, c, t) for t in tried)]
        if not new:
            stop = Stop.KNOWN
            break
        known = pd.concat([outcomes[GEOMETRY], pd.DataFrame(tried, columns=GEOMETRY)])
        near = transition_geometries(task, known, budget.transition_geometries)
        agreements, before = [], len(rows)
        for role, place in [*(("design", c) for c in new), *(("transition", g) for g in near)]:
            if spent + 2 > budget.outcomes_max:
                stop = Stop.BUDGET
                break
            array = len(pairs) + 1
            geometry = Geometry(**{name: place[name] for name in GEOMETRY})
            say(f"round {number}, {role} {identifiers.geometry_id(geometry)}")
            found = simulate_pair(simulate, geometry, populations, chip.flow.height_um, each=each)
            spent += 2
            compared = compare(task, populations, geometry, found)
            records += [
                {
                    "request": request.name,
                    "round": number,
                    "role": role,
                    "array": array,
                    "height_um": chip.flow.height_um,
                    **row,
                }
                for row in compared
            ]
            pairs[array] = {
                "place": geometry.model_dump(),
                "role": role,
                "round": number,
                "rows": found,
                "difference": compared[2],
                "design": place if role == "design" else None,
            }
            rows |= {row["outcome_id"]: row for row in found}
            if role == "design":
                agreements.append(settles(compared[2]))
        if len(rows) > before:
            learnt = fit(with_outcomes(outcomes, rows), derive_seed(seed, f"fit {number}"))
        if stop is Stop.BUDGET:
            break
        if agreements and all(agreements):
            stop = Stop.CONFIRMED
            break
    task = Task(learnt, request, populations, chip, seed, *cells)
    both = simulate, glance
    records += _finer_runs(task, pairs, populations, both, each, budget.finer_designs, say)
    designs = design_table(task, pairs, resistance, stop, stop.sentence(number, budget))
    if budget.height_runs and request.height_tolerance_um > 0 and len(designs):
        heights, found = _height_runs(task, designs, simulate, each, budget.outcomes_max - spent)
        records += heights
        rows |= {row["outcome_id"]: row for row in found}
        designs = _with_heights(designs, heights, chip.flow.height_um)
    return Verdicts(
        pd.DataFrame(records, columns=TABLES["verifications"].names),
        designs,
        with_outcomes(outcomes, rows),
        candidates,
        rows,
    )


def with_outcomes(outcomes: pd.DataFrame, rows: Mapping[str, Mapping]) -> pd.DataFrame:
    """The table of outcomes with the verifying ones that could start below."""
    done = [row for row in rows.values() if row["status"] != "failed"]
    if not done:
        return outcomes
    added = pd.DataFrame(done)[list(outcomes.columns)]
    for name, kind in outcomes.dtypes.items():
        if kind.kind in "fi":  # what a row does not know is null
            added[name] = pd.to_numeric(added[name])
    return pd.concat([outcomes, added], ignore_index=True)


def settles(difference: Mapping[str, Any]) -> bool:
    """Whether a prediction said which cell type goes further, and was confirmed."""
    return difference["agrees"] is True


def simulate_pair(
    simulate,
    geometry: Geometry,
    populations: Sequence[Population],
    height_um: float,
    finer: bool = False,
    each: Each = map,
    other_height: bool = False,
) -> list[dict]:
    """Rows of `outcomes` of both cell types; one that cannot start has status "failed".

    ``other_height``: not that of the design.
    """

    def one(population: Population) -> dict:
        try:
            return simulate(geometry, population, height_um, finer)
        except DldsimError as error:
            other = height_um if other_height else None
            name = identifiers.checked_outcome_id(geometry, population.name, finer, other)
            return _failed(name, geometry, population, height_um, str(error))

    return list(each(one, populations))


def _failed(
    name: str, geometry: Geometry, population: Population, height_um: float, reason: str
) -> dict:
    return {
        **{c.name: None for c in COLUMNS["outcomes"]},
        **geometry.model_dump(),
        **population.stiffness.model_dump(),
        "outcome_id": name,
        "stiffness_set": population.name,
        "pitch_um": geometry.pitch_um,
        "row_shift_fraction": geometry.row_shift_fraction,
        "height_um": height_um,
        "cell_shape": population.shape,
        "cell_radius_um": population.radius_um,
        "status": "failed",
        "stop_reason": reason,
        "mode": "none",
        "deformation_index": population.deformation_index,
    }


def denied(first: Sequence[Mapping]) -> bool:
    """Whether outcomes from the first place of release alone say that the cells do not part.

    Where both have one angle there, as where both bump, then whatever the other places give the
    means over the flux differ by no more than the spreads over the releases together, which is not
    parting (`verdict.parts`).
    """
    return difference_of(first) == 0 and all(row["status"] == "decided" for row in first)


def _finer_runs(
    task: Task, pairs: Mapping[int, dict], populations, ways, each, count: int, say: Progress
) -> list[dict]:
    """The best designs that part the cells, then those that may, once more at a finer setting.

    Fills `finer` of pairs. ``ways``: to simulate from all places, and from the first alone.
    Returns rows of `verifications`.
    """
    simulate, glance = ways
    parting = []
    for array, pair in pairs.items():
        difference = pair["difference"]
        known = parts(pair["rows"], difference["sigma_num_deg"])
        if pair["role"] == "design" and known is not False:
            parting.append((known is None, -abs(difference["simulated_deg"]), array))
    height, records = task.chip.flow.height_um, []
    for *_, array in sorted(parting)[:count]:
        pair = pairs[array]
        geometry = Geometry(**pair["place"])
        say(f"finer lattice, half the Reynolds number: {identifiers.geometry_id(geometry)}")
        found = glance and simulate_pair(glance, geometry, populations, height, True, each)
        if not found or not denied(found):
            found = simulate_pair(simulate, geometry, populations, height, True, each)
        pair["finer"] = found
        for row in compare(task, populations, geometry, pair["finer"]):
            # A check of the simulation; the surrogate has learnt from its outcome.
            row |= {"agrees": None, "verdict": "finer lattice: not predicted, only simulated"}
            records.append(
                {
                    "request": task.request.name,
                    "round": pair["round"],
                    "role": "finer",
                    "array": array,
                    "height_um": height,
                    **row,
                }
            )
    return records


def _height_runs(
    task: Task, designs: pd.DataFrame, simulate, each, left: int
) -> tuple[list[dict], list[dict]]:
    """The best design at both heights of the tolerance, as far as the budget goes.

    Rows of `verifications` and of `outcomes`.
    """
    best, request, flow = designs.iloc[0], task.request, task.chip.flow
    if pd.isna(best["separation_deg"]):
        return [], []
    geometry = Geometry(**{name: best[name] for name in GEOMETRY})
    records, outcomes = [], []
    for offset in (-request.height_tolerance_um, request.height_tolerance_um):
        if left < 2:
            break
        left -= 2
        changed = flow.model_copy(update={"height_um": flow.height_um + offset})
        populations = [population._replace(flow=changed) for population in task.populations]
        there = Task(
            task.surrogate, request, populations, task.chip.at(changed), task.seed, task.sources
        )
        height = changed.height_um
        found = simulate_pair(simulate, geometry, populations, height, each=each, other_height=True)
        outcomes += found
        records += [
            {
                "request": request.name,
                "round": int(best["round"]),
                "role": "height",
                "array": int(best["array"]),
                "height_um": changed.height_um,
                **row,
            }
            for row in compare(there, populations, geometry, found)
        ]
    return records, outcomes


def _with_heights(
    designs: pd.DataFrame, heights: Sequence[Mapping], height_um: float
) -> pd.DataFrame:
    """The table with the simulated separation of the best design at both heights."""
    if not heights:
        return designs
    designs = designs.copy()
    order = 1.0 if designs["angle_2_deg"].iloc[0] >= designs["angle_1_deg"].iloc[0] else -1.0
    for row in heights:
        if row["population"] == "difference" and row["simulated_deg"] is not None:
            side = "low" if row["height_um"] < height_um else "high"
            designs.loc[designs.index[0], f"separation_{side}_height_deg"] = (
                order * row["simulated_deg"]
            )
    return designs
