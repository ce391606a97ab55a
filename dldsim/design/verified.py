"""Designs that were simulated: their table and their files."""

import json
import math
from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from dldsim.config.design_sections import DesignRequest
from dldsim.config.design_sections import Verification as Budget
from dldsim.config.sections import Geometry
from dldsim.design.candidates import over_tolerance, ranks_of
from dldsim.design.chip import Chip
from dldsim.design.device_outcome import DeviceOutcome
from dldsim.design.export import export_design
from dldsim.design.outlet_task import OutletTask
from dldsim.design.simulator import Simulator
from dldsim.design.task import Task
from dldsim.design.verdict import design_verdict, difference_of, parts, separated, towards
from dldsim.experiments.migration import mode_of
from dldsim.tables.registry import TABLES
from dldsim.vocabulary import GEOMETRY


class Stop(StrEnum):
    """What ended the rounds of a request."""

    ROUNDS = "rounds"
    KNOWN = "known"
    BUDGET = "budget"
    CONFIRMED = "confirmed"

    def sentence(self, number: int, budget: Budget) -> str:
        """The same in words, for the round of this number."""
        return {
            Stop.ROUNDS: f"{budget.rounds} round{'s' * (budget.rounds != 1)} done",
            Stop.KNOWN: f"round {number}: the best candidates have been simulated before",
            Stop.BUDGET: f"round {number}: budget of {budget.outcomes_max} outcomes spent",
            Stop.CONFIRMED: f"round {number}: predictions confirmed",
        }[self]


class Verdicts(NamedTuple):
    """Of one request: rows of `verifications` and `verified_designs`, the outcomes to learn from,
    the candidates (`designs`) of the last search, and the rows of `outcomes` by identifier."""

    verifications: pd.DataFrame
    designs: pd.DataFrame
    outcomes: pd.DataFrame
    candidates: pd.DataFrame
    rows: dict[str, dict]
    devices: list[DeviceOutcome] = []
    """What comes out of the best designs, by their simulated motion."""


def design_table(
    task: Task, pairs: Mapping[int, dict], resistance, stop: Stop, stopped: str
) -> pd.DataFrame:
    """The simulated designs, best first, of one rank the surest first; columns of
    `verified_designs`."""
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
                    chip.pressure_kPa(flow["drag_over_mu_U"], geometry.pitch_um, length)
                )
        finer = pair.get("finer")
        there = difference_of(finer)
        separates = separated(pair["rows"], sigma, finer)
        rows.append(
            {
                "request": request.name,
                "array": array,
                "round": pair["round"],
                **geometry.model_dump(),
                "separation_deg": None if simulated is None else abs(simulated),
                "sigma_num_deg": sigma,
                **{
                    f"{key}_{i}": row[name]
                    for i, row in ((1, first), (2, second))
                    for key, name in (("mode", "mode"), ("status", "status"))
                },
                "angle_1_deg": first["migration_angle_deg"],
                "angle_2_deg": second["migration_angle_deg"],
                "predicted_separation_deg": abs(difference["predicted_deg"]),
                "uncertainty_deg": design["uncertainty_deg"],
                "length_mm": length,
                "pressure_drop_kPa": pressure,
                "permeability_over_pitch2": permeability,
                "pressure_basis": basis,
                "throughput_uL_per_h": chip.throughput_uL_per_h,
                "agrees": difference["agrees"],
                "separates": separates,
                "standing": {True: 0, None: 1, False: 3}[separates]
                + (parts(pair["rows"], sigma) is not True),
                "separation_finer_deg": None if there is None else towards(simulated, there),
                "finer_spacing_um": finer and finer[0]["spacing_um"],
                "finer_lag_number": finer and max(r["lag_number"] or 0.0 for r in finer),
                "verdict": design_verdict(difference, pair["rows"], finer, separates),
                "stop": stop.value,
                "stopped": stopped,
                "separation_low_height_deg": None,
                "separation_high_height_deg": None,
            }
        )
    names = TABLES["verified_designs"].names
    table = pd.DataFrame(rows, columns=[*(c for c in names if c not in LATER), "standing"])
    if table.empty:
        return table.reindex(columns=names)
    place = [table[name].to_numpy() for name in GEOMETRY]
    angles = task.angles(*place)
    predicted = table.assign(angle_1_deg=angles[0], angle_2_deg=angles[1])
    least, largest = over_tolerance(task, predicted)
    drawn = task.drawn(*place)
    shift = np.array(
        [
            [
                [mode_of(a, 1 / n) != mode_of(at, 1 / n) for a in row]
                for row, n, at in zip(cell, place[2], nominal, strict=True)
            ]
            for cell, nominal in zip(drawn, angles, strict=True)
        ]
    )
    table = table.assign(
        separation_tolerance_min_deg=least,
        separation_tolerance_max_deg=largest,
        robust_separation_deg=task.robust(*place)[0],
        mode_change_probability=shift.any(axis=0).mean(axis=1),
    )
    value = table["separation_deg"].astype(float).fillna(-1.0)
    table = table.assign(value=value, inside_training_domain=value >= 0).sort_values(
        "value", ascending=False, kind="stable", ignore_index=True
    )
    sigma = table["sigma_num_deg"].astype(float)
    table["rank"] = ranks_of(table.assign(sigma_num_deg=sigma), "value")
    # Of equals first what separates, then what does so at this setting, then what is open, then
    # what a finer setting denies.
    table = table.sort_values(["rank", "standing"], kind="stable", ignore_index=True)
    table["name"] = [f"{request.name}-{k}" for k in range(1, len(table) + 1)]
    return table[names]


LATER = (
    "rank",
    "name",
    "separation_tolerance_min_deg",
    "separation_tolerance_max_deg",
    "robust_separation_deg",
    "mode_change_probability",
)


def export(
    verdicts: Verdicts,
    request: DesignRequest,
    chip: Chip,
    simulator: Simulator,
    count: int,
    directory: Path,
    about: Mapping[str, Any],
    card: Mapping[str, Any],
) -> dict[str, dict[str, Path]]:
    """Files of the best verified designs, by name; those without both angles have none."""
    written = {}
    table = verdicts.verifications
    for _, design in verdicts.designs.head(count).iterrows():
        if pd.isna(design["separation_deg"]):
            continue
        of_design = table[(table["array"] == design["array"]) & (table["role"] == "design")]
        predicted = of_design.set_index("population")["predicted_deg"]
        passages = [simulator.passage(row) for row in rows_of(verdicts, design["array"])]
        values = {key: value for key, value in design.items() if key not in ("name", "array")} | {
            "angle_1_deg": predicted["1"],
            "angle_2_deg": predicted["2"],
            "simulated_angle_1_deg": design["angle_1_deg"],
            "simulated_angle_2_deg": design["angle_2_deg"],
        }
        written[design["name"]] = export_design(
            design["name"],
            values,
            request,
            chip.device,
            directory,
            about=about,
            card=card,
            verified=passages,
            outcome=next((d for d in verdicts.devices if d.name == design["name"]), None),
        )
    return written


def rows_of(verdicts: Verdicts, array: int) -> list[dict]:
    """Rows of `outcomes` of both cell types in an array simulated as a design."""
    table = verdicts.verifications
    own = table[(table["array"] == array) & (table["role"] == "design")]
    return [verdicts.rows[name] for name in own["outcome_id"][own["population"] != "difference"]]


def devices_of(verdicts: Verdicts, task: OutletTask, count: int) -> list[DeviceOutcome]:
    """What comes out of the best verified designs that have both angles.

    Raises DldsimError if the device is too small for array or cells.
    """
    done = verdicts.designs.head(count).dropna(subset="separation_deg")
    return [
        task.outcome(
            design["name"],
            Geometry(**{name: design[name] for name in GEOMETRY}),
            rows_of(verdicts, design["array"]),
        )
        for design in done.to_dict("records")
    ]


def plain(table: pd.DataFrame) -> list[dict]:
    """Rows for `write_table`: NaN and missing values as None, NumPy's numbers as Python's."""
    rows = table.astype(object).where(table.notna(), None).to_dict("records")
    return json.loads(json.dumps(rows, default=lambda v: v.item()))
