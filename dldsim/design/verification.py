"""Candidates become designs: both cell types are simulated in the array that was searched for.

Prediction and simulation are compared, the outcomes are learnt from, and the search begins anew,
until they agree or the budget is spent.
"""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from dldsim.analysis import uncertainty
from dldsim.analysis.calibration import stiffness_for
from dldsim.analysis.surrogate import Surrogate
from dldsim.app.jobs import (
    OutcomeFiles,
    Partial,
    Progress,
    flow_row,
    made_with,
    provenance,
    write_outcome,
)
from dldsim.config import identifiers
from dldsim.config.design_sections import DesignRequest
from dldsim.config.design_sections import Verification as Budget
from dldsim.config.provenance import derive_seed, settings_hash
from dldsim.config.sections import CellShape, Flow, Geometry, Numerics, RunControl, Stiffness
from dldsim.design.export import Verified, export_design
from dldsim.design.search import (
    Chip,
    Task,
    _over_tolerance,
    distinct,
    ranks_of,
    search,
    transition_geometries,
)
from dldsim.errors import DldsimError
from dldsim.experiments.migration import mode_of
from dldsim.tables.parquet import read_columns, read_rows, write_table
from dldsim.tables.registry import COLUMNS, TABLES
from dldsim.vocabulary import GEOMETRY

SHAPES_EVERY = 2
"""Samples of a run from one recorded shape to the next."""
CONFIRMED, MISSED = "prediction confirmed", "prediction missed"
SIGMAS = 2
"""Numerical uncertainties that a simulated separation must exceed to count as one."""


class Stop(StrEnum):
    """What ended the rounds of a request."""

    ROUNDS = "rounds"
    KNOWN = "known"
    BUDGET = "budget"
    CONFIRMED = "confirmed"

    def sentence(self, number: int, budget: Budget) -> str:
        """The same in words, for the round of this number."""
        return {
            Stop.ROUNDS: f"{budget.rounds} rounds done",
            Stop.KNOWN: f"round {number}: the best candidates have been simulated before",
            Stop.BUDGET: f"round {number}: budget of {budget.outcomes_max} outcomes spent",
            Stop.CONFIRMED: f"round {number}: predictions confirmed",
        }[self]


class Population(NamedTuple):
    """One cell type as it is simulated; ``basis`` says where its moduli come from."""

    number: int
    name: str
    deformation_index: float
    deformation_index_std: float
    radius_um: float
    stiffness: Stiffness
    basis: str


def make_populations(
    request: DesignRequest, resolved: DesignRequest, calibration: pd.DataFrame,
    sets: Mapping[str, Stiffness],
) -> list[Population]:
    """Both cell types of a request; ``resolved``: the same request by deformation indices.

    A stiffness set named in the request is simulated as it is. Else k_s follows from the
    deformation index, and the other moduli are those that the campaign's sets have at this k_s,
    linear between sets: the calibration's groups have other bending moduli, which no array run has.

    Raises DldsimError outside the calibrated range and beyond the sets.
    """
    found = []
    for i in (1, 2):
        index = getattr(resolved, f"deformation_index_{i}")
        named = getattr(request, f"stiffness_set_{i}")
        if named is not None:
            stiffness, basis = sets[named], f"stiffness set {named}"
        else:
            key = f"deformation_index_{i}"
            inverse = stiffness_for(index, calibration, key=key)
            stiffness = stiffness_at(inverse["ks_uN_per_m"], sets, key)
            basis = (f"inverse of the calibration, k_s {inverse['ks_uN_per_m']:.3g} µN/m between "
                     + " and ".join(inverse["between"]))
        found.append(Population(
            i, f"{request.name}-{i}", index, getattr(resolved, f"deformation_index_std_{i}") or 0.0,
            getattr(request, f"radius_{i}_um"), stiffness, basis,
        ))  # fmt: skip
    return found


def stiffness_at(ks_uN_per_m: float, sets: Mapping[str, Stiffness], key: str) -> Stiffness:
    """Moduli at a spring constant, linear between the campaign's stiffness sets."""
    curve = sorted((s.ks_uN_per_m, s) for s in sets.values())
    ks = [k for k, _ in curve]
    if not ks[0] <= ks_uN_per_m <= ks[-1]:
        raise DldsimError(
            f"{key}: its stiffness k_s = {ks_uN_per_m:.4g} µN/m is outside the stiffness sets, "
            f"{ks[0]:g} to {ks[-1]:g} µN/m.", key=key, value=ks_uN_per_m,
            allowed=f"k_s of {ks[0]:g} to {ks[-1]:g} µN/m",
            remedy="Choose a deformation index between theirs.",
        )  # fmt: skip
    return Stiffness(**{
        name: float(np.interp(ks_uN_per_m, ks, [getattr(s, name) for _, s in curve]))
        for name in Stiffness.model_fields
    })


class Scene(NamedTuple):
    """What the campaign simulates with."""

    cell: CellShape
    flow: Flow
    numerics: Numerics
    control: RunControl


class Simulator:
    """Outcomes of a verification, each release kept on disk as soon as it is done, and used again.

    Called with geometry, population and channel height [µm] it returns the row of `outcomes`. An
    outcome is found again if everything it depends on is the same. The cell has its real radius:
    what similarity assumes (height/R and membrane numbers unchanged) is part of what is checked.
    """

    def __init__(self, directory: Path, scene: Scene, progress: Progress | None = None):
        self.directory, self.scene, self.progress = Path(directory), scene, progress
        self.model = uncertainty.read_model()
        self._flow: tuple[Any, Any] = (None, None)

    def __call__(
        self, geometry: Geometry, population: Population, height_um: float, finer: bool = False
    ) -> dict:
        scene = self._at(geometry, height_um, finer)
        settings = {
            **{name: getattr(scene, name).model_dump(mode="json")
               for name in ("flow", "numerics", "control")},
            "cell": self._cell(population).model_dump(mode="json"),
            "stiffness": population.stiffness.model_dump(mode="json"),
            "geometry": geometry.model_dump(mode="json"),
        }
        name = self.name(geometry, population, height_um, finer)
        files, shapes = self._files(name)
        digest = settings_hash(settings)
        if not (shapes.exists() and made_with(files.outcome, digest)):
            self._simulate(geometry, population, scene, name, settings)
        [row] = read_rows("outcomes", files.outcome)
        sigma, basis = uncertainty.numerical_uncertainty(row, self.model)
        return {
            **row, "deformation_index": population.deformation_index,
            "deformation_index_std": population.deformation_index_std,
            "sigma_num_deg": sigma, "sigma_num_basis": basis,
        }  # fmt: skip

    def name(self, geometry: Geometry, population: Population, height_um: float, finer: bool = False
             ) -> str:
        """Identifier of an outcome; another height than the campaign's is part of it, in nm, and
        so is a finer lattice."""
        name = population.name + "-finer" * finer
        if height_um != self.scene.flow.height_um:
            name += f"-h{1e3 * height_um:.0f}"
        return identifiers.outcome_id(identifiers.Pair(geometry, name))

    def passage(self, row: Mapping[str, Any]) -> Verified:
        """A finished outcome with trajectory and recorded shapes of its first release."""
        from dldsim.experiments.vtk import read_vtkhdf

        files, shapes = self._files(row["outcome_id"])
        columns = read_columns("trajectory", files.trajectory).to_pydict()
        columns = {k: np.array(v) for k, v in columns.items()}
        first = columns["run_id"] == columns["run_id"][0]
        return Verified(row, {k: v[first] for k, v in columns.items()}, read_vtkhdf(shapes))

    def resistance(self, geometry: Geometry) -> dict[str, Any]:
        """Row of `flows` of an array at the campaign's height, from the solver."""
        path = self.directory / f"{identifiers.geometry_id(geometry)}.flow.parquet"
        scene = self.scene
        settings = {"flow": scene.flow.model_dump(), "numerics": scene.numerics.model_dump()}
        if not made_with(path, settings_hash(settings)):
            row = flow_row(self._empty_flow(geometry, scene))
            write_table("flows", [row], path, provenance(settings))
        [row] = read_rows("flows", path)
        return row

    def _simulate(self, geometry, population, scene: Scene, name: str, settings: Mapping) -> None:
        from dldsim.experiments.array_run import simulate_outcome
        from dldsim.experiments.vtk import Recorder, write_vtkhdf

        files, shapes = self._files(name)
        kept = Partial(self.directory / name, name, settings)
        places = scene.control.release_gap_fractions
        finished = kept.finished(places) if shapes.exists() else {}
        recorder = Recorder(SHAPES_EVERY)

        def keep(place: float, result) -> None:
            if place == places[0]:
                write_vtkhdf(recorder.shapes(geometry, result), shapes, provenance(settings))
            kept.keep(place, result)

        result = simulate_outcome(
            geometry, population.stiffness, self._cell(population), scene.flow, scene.numerics,
            scene.control, outcome_id=name, stiffness_set=name.rpartition("_s")[2],
            empty_flow=self._empty_flow(geometry, scene), finished=finished, keep=keep,
            observe=recorder, progress=self.progress,
        )  # fmt: skip
        write_outcome(result, files, settings)
        kept.remove()

    def _at(self, geometry: Geometry, height_um: float, finer: bool) -> Scene:
        from dldsim.solver.pillars import next_finer

        flow = self.scene.flow.model_copy(update={"height_um": height_um})
        numerics = self.scene.numerics
        return self.scene._replace(
            flow=flow, numerics=next_finer(geometry, numerics) if finer else numerics
        )

    def _cell(self, population: Population) -> CellShape:
        return self.scene.cell.model_copy(update={"radius_um": population.radius_um})

    def _files(self, name: str) -> tuple[OutcomeFiles, Path]:
        """Tables of an outcome, and the shapes of its first release."""
        tables = (self.directory / f"{name}.{kind}.parquet" for kind in OutcomeFiles._fields)
        return OutcomeFiles(*tables), self.directory / f"{name}.vtkhdf"

    def _empty_flow(self, geometry: Geometry, scene: Scene):
        """Flow without a cell; the last one is kept, which both cell types share."""
        from dldsim.solver.flow import solve_empty_array

        key = geometry, scene.flow, scene.numerics
        if self._flow[0] != key:
            self._flow = key, solve_empty_array(geometry, scene.flow, scene.numerics)
        return self._flow[1]


class Verdicts(NamedTuple):
    """Of one request: rows of `verifications` and `verified_designs`, the outcomes to learn from,
    the candidates (`designs`) of the last search, and the rows of `outcomes` by identifier."""

    verifications: pd.DataFrame
    designs: pd.DataFrame
    outcomes: pd.DataFrame
    candidates: pd.DataFrame
    rows: dict[str, dict]


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
    fit: Callable[[pd.DataFrame, int], Surrogate] | None = None,
    resistance: Callable[[Geometry], Mapping[str, Any]] | None = None,
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
    numerical Reynolds number: only what parts them there as well counts as separating.

    ``request``: by deformation indices. ``simulate(geometry, population, height_um, finer)``
    returns a row of `outcomes`; ``resistance`` one of `flows`. The best verified design is
    simulated at ± height_tolerance_um too.

    Raises DldsimError as `search` does.
    """
    from dldsim.analysis import surrogate as model

    fit = fit or model.fit
    say = progress or (lambda sentence: None)
    records: list[dict] = []
    pairs: dict[int, dict] = {}
    rows: dict[str, dict] = {}
    learnt = surrogate
    stop, number = Stop.ROUNDS, budget.rounds
    spent = 0
    candidates = pd.DataFrame()
    for number in range(1, budget.rounds + 1):
        task = Task(learnt, request, chip, derive_seed(seed, f"round {number}"))
        candidates = search(learnt, request, chip, task.seed).designs
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
            found = _simulate_pair(simulate, geometry, populations, chip.flow.height_um)
            spent += 2
            compared = compare(task, populations, geometry, found)
            records += [{"request": request.name, "round": number, "role": role, "array": array,
                         "height_um": chip.flow.height_um, **row} for row in compared]
            pairs[array] = {"place": geometry.model_dump(), "role": role, "round": number,
                            "rows": found, "difference": compared[2],
                            "design": place if role == "design" else None}
            rows |= {row["outcome_id"]: row for row in found}
            if role == "design":
                agreements.append(_settles(compared[2]))
        if len(rows) > before:
            learnt = fit(_with(outcomes, rows), derive_seed(seed, f"fit {number}"))
        if stop is Stop.BUDGET:
            break
        if agreements and all(agreements):
            stop = Stop.CONFIRMED
            break
    task = Task(learnt, request, chip, seed)
    records += _finer_runs(task, pairs, populations, simulate, budget.finer_designs, say)
    designs = _verified(task, pairs, resistance, stop, stop.sentence(number, budget))
    if budget.height_runs and request.height_tolerance_um > 0 and len(designs):
        heights = _height_runs(task, designs, populations, simulate, budget.outcomes_max - spent)
        records += heights
        designs = _with_heights(designs, heights, chip.flow.height_um)
    return Verdicts(pd.DataFrame(records, columns=TABLES["verifications"].names), designs,
                    _with(outcomes, rows), candidates, rows)


def _with(outcomes: pd.DataFrame, rows: Mapping[str, Mapping]) -> pd.DataFrame:
    """The table of outcomes with the verifying ones that could start below."""
    done = [row for row in rows.values() if row["status"] != "failed"]
    if not done:
        return outcomes
    numbers = {name: kind for name, kind in outcomes.dtypes.items() if kind.kind in "fi"}
    added = pd.DataFrame(done)[list(outcomes.columns)].astype(numbers)
    return pd.concat([outcomes, added], ignore_index=True)


def _settles(difference: Mapping[str, Any]) -> bool:
    """Whether a prediction said which cell type goes further, and was confirmed."""
    low, high = difference["predicted_low_deg"], difference["predicted_high_deg"]
    return difference["agrees"] is True and not low < 0 < high


def _simulate_pair(simulate, geometry: Geometry, populations: Sequence[Population],
                   height_um: float, finer: bool = False) -> list[dict]:
    """Rows of `outcomes` of both cell types; one that cannot start has status "failed"."""
    found = []
    for population in populations:
        try:
            found.append(simulate(geometry, population, height_um, finer))
        except DldsimError as error:
            found.append(_failed(geometry, population, height_um, str(error)))
    return found


def _failed(geometry: Geometry, population: Population, height_um: float, reason: str) -> dict:
    return {
        **{c.name: None for c in COLUMNS["outcomes"]}, **geometry.model_dump(),
        **population.stiffness.model_dump(),
        "outcome_id": identifiers.outcome_id(identifiers.Pair(geometry, population.name)),
        "stiffness_set": population.name, "pitch_um": geometry.pitch_um,
        "row_shift_fraction": geometry.row_shift_fraction, "height_um": height_um,
        "cell_radius_um": population.radius_um, "status": "failed", "stop_reason": reason,
        "mode": "none", "deformation_index": population.deformation_index,
    }  # fmt: skip


def compare(task: Task, populations: Sequence[Population], geometry: Geometry,
            found: Sequence[Mapping]) -> list[dict]:
    """Prediction and simulation of both cell types and of their difference; `verifications`."""
    place = [getattr(geometry, name) for name in GEOMETRY]
    angles = [float(a[0]) for a in task.angles(*place)]
    half = [float(h[0]) for h in task.half_widths(*place)]
    inside = [
        bool(task.surrogate.inside_domain(*place, *cell)[0]) for cell in task.cells
    ]  # fmt: skip
    rows = []
    for k, population in enumerate(populations):
        row = found[k]
        rows.append(_judged({
            "population": str(population.number), **geometry.model_dump(),
            "outcome_id": row["outcome_id"], "deformation_index": population.deformation_index,
            "cell_radius_um": population.radius_um, "ks_uN_per_m": population.stiffness.ks_uN_per_m,
            "stiffness_basis": population.basis, "predicted_deg": angles[k],
            "simulated_deg": row["migration_angle_deg"], "sigma_num_deg": row["sigma_num_deg"],
            "predicted_mode": mode_of(angles[k], geometry.row_shift_fraction), "mode": row["mode"],
            "status": row["status"], "wall_time_s": row["wall_time_s"],
            "note": _note(row),
        }, half[k], inside[k]))  # fmt: skip
    first, second = found
    known = [r["migration_angle_deg"] is not None for r in found]
    sigmas = [r["sigma_num_deg"] for r in found]
    rows.append(_judged({
        "population": "difference", **geometry.model_dump(),
        "outcome_id": f"{first['outcome_id']}, {second['outcome_id']}", "deformation_index": None,
        "cell_radius_um": None, "ks_uN_per_m": None, "stiffness_basis": "",
        "predicted_deg": angles[1] - angles[0],
        "simulated_deg":
            second["migration_angle_deg"] - first["migration_angle_deg"] if all(known) else None,
        "sigma_num_deg": None if None in sigmas else math.hypot(*sigmas),
        "predicted_mode": ", ".join(r["predicted_mode"] for r in rows),
        "mode": ", ".join(r["mode"] for r in found),
        "status": ", ".join(r["status"] for r in found),
        "wall_time_s": sum(r["wall_time_s"] or 0.0 for r in found),
        "note": "; ".join(dict.fromkeys(r["note"] for r in rows if r["note"])),
    }, math.hypot(*half), all(inside)))  # fmt: skip
    return rows


def _judged(row: dict, half_width_deg: float, inside: bool) -> dict:
    """The row with its interval and whether the simulated value meets it."""
    low, high = row["predicted_deg"] - half_width_deg, row["predicted_deg"] + half_width_deg
    simulated, sigma = row["simulated_deg"], row["sigma_num_deg"] or 0.0
    agrees = None
    if simulated is None:
        verdict = "no angle to compare with"
    elif not inside:
        verdict = "not compared: outside the training geometries"
    else:
        agrees = low - sigma <= simulated <= high + sigma
        off = simulated - row["predicted_deg"]
        verdict = f"{CONFIRMED} (± {half_width_deg:.2f}°)" if agrees else f"{MISSED} by {off:+.2f}°"
        if agrees and row["population"] == "difference" and low < 0 < high:
            verdict += ", which left the order open"
    return {**row, "predicted_low_deg": low, "predicted_high_deg": high, "agrees": agrees,
            "verdict": verdict}


def _note(row: Mapping[str, Any]) -> str:
    """What a reader must know of an outcome that is not decided."""
    if row["status"] in uncertainty.OPEN:
        return f"{row['status']}: {row['stop_reason']}"
    return "" if row["status"] == "decided" else row["stop_reason"]


def _verified(
    task: Task, pairs: Mapping[int, dict], resistance, stop: Stop, stopped: str
) -> pd.DataFrame:
    """The simulated designs, best first; columns of `verified_designs`."""
    request, chip = task.request, task.chip
    rows = []
    for array, pair in pairs.items():
        if pair["role"] != "design":
            continue
        first, second = pair["rows"]
        difference, design = pair["difference"], pair["design"]
        simulated, sigma = difference["simulated_deg"], difference["sigma_num_deg"]
        geometry = Geometry(**pair["place"])
        length = pressure = permeability = None
        if simulated:
            slopes = [math.tan(math.radians(r["migration_angle_deg"])) for r in pair["rows"]]
            length = request.lateral_separation_um / abs(slopes[1] - slopes[0]) / 1e3
        basis = "not known"
        if resistance is not None:
            flow = resistance(geometry)
            permeability = flow["permeability_over_pitch2"]
            basis = "flow without a cell, solved for this array"
            if length is not None:
                pressure = float(
                    chip.pressure_kPa(flow["drag_over_mu_U"], geometry.pitch_um, length))
        finer = pair.get("finer")
        separates = separated(pair["rows"], sigma, finer)
        rows.append({
            "request": request.name, "array": array, "round": pair["round"],
            **geometry.model_dump(),
            "separation_deg": None if simulated is None else abs(simulated),
            "sigma_num_deg": sigma,
            **{f"{key}_{i}": row[name] for i, row in ((1, first), (2, second))
               for key, name in (("mode", "mode"), ("status", "status"))},
            "angle_1_deg": first["migration_angle_deg"],
            "angle_2_deg": second["migration_angle_deg"],
            "predicted_separation_deg": abs(difference["predicted_deg"]),
            "uncertainty_deg": design["uncertainty_deg"],
            "length_mm": length, "pressure_drop_kPa": pressure,
            "permeability_over_pitch2": permeability, "pressure_basis": basis,
            "throughput_uL_per_h": chip.throughput_uL_per_h,
            "agrees": difference["agrees"], "separates": separates,
            "separation_finer_deg": _difference(finer) and _towards(simulated, _difference(finer)),
            "finer_spacing_um": finer and finer[0]["spacing_um"],
            "finer_lag_number": finer and max(r["lag_number"] or 0.0 for r in finer),
            "verdict": _design_verdict(difference, pair["rows"], finer, separates),
            "stop": stop.value, "stopped": stopped,
            "separation_low_height_deg": None, "separation_high_height_deg": None,
        })  # fmt: skip
    names = TABLES["verified_designs"].names
    table = pd.DataFrame(rows, columns=[c for c in names if c not in LATER])
    if table.empty:
        return table.reindex(columns=names)
    place = [table[name].to_numpy() for name in GEOMETRY]
    angles = task.angles(*place)
    predicted = table.assign(angle_1_deg=angles[0], angle_2_deg=angles[1])
    least, largest = _over_tolerance(task, predicted)
    drawn = task.drawn(*place)
    shift = np.array([
        [[mode_of(a, 1 / n) != mode_of(at, 1 / n) for a in row]
         for row, n, at in zip(cell, place[2], nominal, strict=True)]
        for cell, nominal in zip(drawn, angles, strict=True)
    ])  # fmt: skip
    table = table.assign(
        separation_tolerance_min_deg=least, separation_tolerance_max_deg=largest,
        robust_separation_deg=task.robust(*place)[0],
        mode_change_probability=shift.any(axis=0).mean(axis=1),
    )
    value = table["separation_deg"].astype(float).fillna(-1.0)
    table = table.assign(value=value, inside_training_domain=value >= 0).sort_values(
        "value", ascending=False, kind="stable", ignore_index=True)
    sigma = table["sigma_num_deg"].astype(float)
    table["rank"] = ranks_of(table.assign(sigma_num_deg=sigma), "value")
    table["name"] = [f"{request.name}-{k}" for k in range(1, len(table) + 1)]
    return table[names]


LATER = ("rank", "name", "separation_tolerance_min_deg", "separation_tolerance_max_deg",
         "robust_separation_deg", "mode_change_probability")


def _difference(found: Sequence[Mapping] | None) -> float | None:
    """Angle of the second cell type minus that of the first [°]; None where one is not known."""
    angles = [row["migration_angle_deg"] for row in found or [{"migration_angle_deg": None}]]
    return None if None in angles else angles[1] - angles[0]


def _towards(order: float, difference: float) -> float:
    """A difference with the sign that says whether it has the same order."""
    return math.copysign(difference, difference * order)


def parts(found: Sequence[Mapping], sigma_deg: float | None) -> bool | None:
    """Whether two outcomes part the cells from every place of release.

    Decided outcomes part if the angles differ by more than SIGMAS σ_num and by more than both
    spreads of the releases together. Where one is undecided, its bounds decide: they part the cells
    if they do not overlap. None where they do overlap, or σ_num is not known.
    """
    difference = _difference(found)
    if difference is None or any(row["status"] not in ("decided", "undecided") for row in found):
        return False
    if any(row["status"] == "undecided" for row in found):
        apart = max(r["angle_low_deg"] for r in found) > min(r["angle_high_deg"] for r in found)
        return True if apart else None
    if abs(difference) <= sum(row["angle_spread_deg"] or 0.0 for row in found):
        return False
    return None if sigma_deg is None else abs(difference) > SIGMAS * sigma_deg


def separated(
    found: Sequence[Mapping], sigma_deg: float | None, finer: Sequence[Mapping] | None
) -> bool | None:
    """Whether a design separates: at the campaign's setting and, in the same order, at a finer one.

    None where that is open, or the finer setting was not simulated.
    """
    known = parts(found, sigma_deg)
    if not known or finer is None:
        return False if known is False else None
    same = parts(finer, sigma_deg)
    if same and _towards(_difference(found), _difference(finer)) < 0:
        return False
    return same


def _finer_runs(
    task: Task, pairs: Mapping[int, dict], populations, simulate, count: int, say: Progress
) -> list[dict]:
    """The best designs that part the cells once more, at a finer setting; fills `finer` of pairs.

    Returns rows of `verifications`.
    """
    parting = [(array, pair) for array, pair in pairs.items() if pair["role"] == "design"
               and parts(pair["rows"], pair["difference"]["sigma_num_deg"])]
    parting.sort(key=lambda item: -abs(item[1]["difference"]["simulated_deg"]))
    height, records = task.chip.flow.height_um, []
    for array, pair in parting[:count]:
        geometry = Geometry(**pair["place"])
        say(f"finer lattice, half the Reynolds number: {identifiers.geometry_id(geometry)}")
        pair["finer"] = _simulate_pair(simulate, geometry, populations, height, finer=True)
        for row in compare(task, populations, geometry, pair["finer"]):
            # A check of the simulation; the surrogate has learnt from its outcome.
            row |= {"agrees": None, "verdict": "finer lattice: not predicted, only simulated"}
            records.append({"request": task.request.name, "round": pair["round"], "role": "finer",
                            "array": array, "height_um": height, **row})
    return records


def _design_verdict(
    difference: Mapping[str, Any], found: Sequence[Mapping], finer: Sequence[Mapping] | None,
    separates: bool | None,
) -> str:
    """Whether it separates, at which settings, whether that was predicted, and what is open."""
    simulated, sigma = difference["simulated_deg"], difference["sigma_num_deg"]
    if simulated is None:
        return f"no separation measured: {difference['note']}"
    size = f"{abs(simulated):.2f}°" if sigma is None else f"{abs(simulated):.2f} ± {sigma:.2f}°"
    if separates:
        words = f"separates by {size}, {_settings(finer)} as well"
    elif finer is not None:
        words = (f"open: {abs(simulated):.2f}°, {_settings(finer)}, undecided" if separates is None
                 else f"does not separate: {abs(simulated):.2f}° but {_settings(finer)}")
    elif separates is None and parts(found, sigma) is None:
        why = _undecided(found) or "numerical uncertainty not studied"
        words = f"open, {abs(simulated):.2f}°: {why}"
    elif separates is None:
        words = f"separates by {size} at this setting; not confirmed at a finer one"
    else:
        words = f"does not separate: {_why_not(found, simulated, sigma)}"
    said = [words, difference["verdict"]]
    if separates is not False and simulated * difference["predicted_deg"] < 0:
        said.append("in the opposite order")
    return "; ".join([*said, *filter(None, [difference["note"]])])


def _settings(finer: Sequence[Mapping]) -> str:
    """What a finer setting gave, in words."""
    value = _difference(finer)
    outcome = "no angle" if value is None else f"{abs(value):.2f}°"
    lag = max(row["lag_number"] or 0.0 for row in finer)
    return f"{outcome} at spacing {finer[0]['spacing_um'] or math.nan:.2f} µm and Re {lag:.2f}"


def _undecided(found: Sequence[Mapping]) -> str:
    """Which of two outcomes are not decided, in words; empty: none."""
    return " and ".join(f"cell type {i} is {row['status']}" for i, row in enumerate(found, 1)
                        if row["status"] != "decided")


def _why_not(found: Sequence[Mapping], simulated: float, sigma: float | None) -> str:
    """Why two outcomes do not part, in words."""
    if open_ := _undecided(found):
        return open_
    if sigma is not None and abs(simulated) <= SIGMAS * sigma:
        return f"{abs(simulated):.2f}° is within {SIGMAS} σ_num of zero"
    spread = sum(row["angle_spread_deg"] or 0.0 for row in found)
    return f"{abs(simulated):.2f}° is within the spread of the releases, {spread:.2f}°"


def _height_runs(task: Task, designs: pd.DataFrame, populations, simulate, left: int) -> list[dict]:
    """The best design at both heights of the tolerance, as far as the budget goes."""
    best, request = designs.iloc[0], task.request
    if pd.isna(best["separation_deg"]):
        return []
    geometry = Geometry(**{name: best[name] for name in GEOMETRY})
    found = []
    for offset in (-request.height_tolerance_um, request.height_tolerance_um):
        if left < 2:
            break
        left -= 2
        height = task.chip.flow.height_um + offset
        rows = compare(task, populations, geometry,
                       _simulate_pair(simulate, geometry, populations, height))
        for row in rows:  # the surrogate knows one height: nothing was predicted for this one
            row |= {"agrees": None, "verdict": "height off: not predicted, only simulated"}
        found += [{"request": request.name, "round": int(best["round"]), "role": "height",
                   "array": int(best["array"]), "height_um": height, **row} for row in rows]
    return found


def _with_heights(designs: pd.DataFrame, heights: Sequence[Mapping], height_um: float
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
                order * row["simulated_deg"])
    return designs


def export(
    verdicts: Verdicts, request: DesignRequest, chip: Chip, simulator: Simulator, count: int,
    directory: Path, about: Mapping[str, Any], card: Mapping[str, Any],
) -> dict[str, dict[str, Path]]:
    """Files of the best verified designs, by name; those without both angles have none."""
    written = {}
    table = verdicts.verifications
    for _, design in verdicts.designs.head(count).iterrows():
        if pd.isna(design["separation_deg"]):
            continue
        of_design = table[(table["array"] == design["array"]) & (table["role"] == "design")]
        predicted = of_design.set_index("population")["predicted_deg"]
        passages = [simulator.passage(verdicts.rows[name])
                    for name in of_design["outcome_id"][of_design["population"] != "difference"]]
        values = {key: value for key, value in design.items() if key not in ("name", "array")} | {
            "angle_1_deg": predicted["1"], "angle_2_deg": predicted["2"],
            "simulated_angle_1_deg": design["angle_1_deg"],
            "simulated_angle_2_deg": design["angle_2_deg"],
        }  # fmt: skip
        written[design["name"]] = export_design(
            design["name"], values, request, chip.device, directory, about=about, card=card,
            verified=passages,
        )  # fmt: skip
    return written


def plain(table: pd.DataFrame) -> list[dict]:
    """Rows for `write_table`: NaN and missing values as None, NumPy's numbers as Python's."""
    rows = table.astype(object).where(table.notna(), None).to_dict("records")
    return json.loads(json.dumps(rows, default=lambda v: v.item()))


def conditions(outcomes: pd.DataFrame, scene: Scene) -> None:
    """Refuse a table of outcomes made under other conditions than the scene's.

    Raises DldsimError that names what differs.
    """
    wanted = {"cell_shape": scene.cell.shape, "height_um": scene.flow.height_um,
              "mean_velocity_mm_s": scene.flow.mean_velocity_mm_s}
    for name, value in wanted.items():
        if name not in outcomes:
            raise DldsimError(f"The table of outcomes lacks the column {name}.")
        other = sorted(set(outcomes[name]) - {value})
        if other:
            made = ", ".join(map(str, other))
            raise DldsimError(
                f"The outcomes were made with {name} = {made}, the configuration has {value}. A "
                "design holds only for what was simulated.", key=name, value=value, allowed=made,
                remedy="Give the configuration of that campaign with --config.",
            )  # fmt: skip
