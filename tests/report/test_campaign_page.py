"""The report against a small made-up campaign: numbers, labels, escapes, links, missing tables."""

import json
import os
import re
import shutil
import tomllib
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from markupsafe import Markup

import dldsim
from dldsim.analysis.passages import calibrate, correlations
from dldsim.analysis.regressors import SURROGATE
from dldsim.analysis.uncertainty import SIGMA
from dldsim.config.sections import Numerics
from dldsim.errors import DldsimError
from dldsim.report import (
    angle_figures,
    calibration_figures,
    campaign_page,
    style,
    surrogate_figures,
    trajectory_figures,
)
from dldsim.report import page as report_page
from dldsim.report.formats import duration, number, probability
from dldsim.report.inputs import CARD, STUDIES, TABLES
from dldsim.report.sections import summary
from dldsim.tables.numerics import columns_of
from dldsim.tables.parquet import write_csv, write_table
from dldsim.tables.registry import COLUMNS
from dldsim.vocabulary import SETTLED
from tests.report.design_tables import make_design_tables

pytestmark = pytest.mark.slow

PROVENANCE = {"config_hash": "0123abcd", "seed": 7}
SETS = {  # k_s, k_b, k_α, DI
    "1": (5.1, 4.3e-2, 10.2, 0.51),
    "3": (15.24, 0.25, 30.0, 0.77),
    "5": (20.3, 0.35, 40.6, 0.78),
}
GROUPS = ("G1", "G2", "G3", "G4", "G5", "G6", "G7")
NASTY = "density 3.1 <b>& more</b>"
CONFIG = {
    "preset": "tiny",
    "seed": 7,
    "cell": {"shape": "biconcave", "radius_um": 7.5},
    "run_control": {"max_rows": 12},
    "constriction": {"width_um": 30.0},
}


def lateral_steps(mode: str, periodicity: int, rows: int, pitch: float) -> np.ndarray:
    """Per-row steps [µm]: a transient, then bump, zigzag (sum 0 per period) or half of each."""
    shift = pitch / periodicity
    ramp = 1 - 0.5 * np.exp(-np.arange(rows) / 3)
    if mode == "bump":
        return shift * ramp
    drop = {"zigzag": 1.0, "mixed": 0.5}[mode]
    steps = np.full(rows, shift * (1 - drop / periodicity))
    steps[periodicity - 1 :: periodicity] -= drop * (pitch - shift)
    return steps * np.where(np.arange(rows) < 2, 0.7, 1.0)


def make_run(radius, gap, periodicity, name, rng, status=None, place=0.5) -> tuple[dict, dict]:
    """One row of `runs` and its trajectory columns; the mode follows D_c."""
    pitch = 2 * radius + gap
    ks, kb, kal, di = SETS[name]
    size = 10.8 * (1.05 - 0.3 * (0.8 - di)) / (1.4 * gap * periodicity**-0.48)
    mode = "bump" if size > 1.05 else "zigzag" if size < 0.95 else "mixed"
    broken = status in ("stuck", "unstable", "failed")
    mode = "none" if broken else mode
    status = status or {"bump": "converged", "zigzag": "periodic", "mixed": "undecided"}[mode]
    rows = {"stuck": 4, "unstable": 1, "failed": 0}.get(status, 2 * periodicity)
    steps = lateral_steps("bump" if broken else mode, periodicity, rows, pitch)
    bump_angle = np.degrees(np.arctan(1 / periodicity))
    tail, first = steps[-periodicity:].sum(), steps[:periodicity].sum()
    angles = [np.degrees(np.arctan(s / (pitch * periodicity))) for s in (tail, first)]
    outcome_id = f"r{radius:04.1f}_g{gap:04.1f}_n{periodicity:02d}_s{name}"
    run_id = f"{outcome_id}_y{place:.2f}"
    failed = status == "failed"
    row = {
        "run_id": run_id,
        "outcome_id": outcome_id,
        "release_axis": "y",
        "release_gap_fraction": place,
        "pillar_radius_um": radius,
        "gap_um": gap,
        "pitch_um": pitch,
        "periodicity": periodicity,
        "row_shift_fraction": 1 / periodicity,
        "stiffness_set": name,
        "cell_shape": "biconcave",
        "cell_radius_um": 7.5,
        "height_um": 20.0,
        "ks_uN_per_m": ks,
        "kb_pN_um": kb,
        "kal_uN_per_m": kal,
        "kag_uN_per_m": 500.0,
        "kv_Pa": 900.0,
        "kvisc_nN_s_per_m": 1.5,
        "mean_velocity_mm_s": 1.0,
        "status": status,
        "stop_reason": NASTY if broken else "the orbit repeats",
        "mode": mode,
        "migration_angle_deg": None if broken else angles[0],
        "first_period_angle_deg": None if broken else angles[1],
        "angle_low_deg": None if broken else angles[0] - 0.1,
        "angle_high_deg": None if broken else angles[0] + 0.1,
        "settled_row": None if broken or status == "undecided" else 3,
        "row_map_peak": None if broken else 1.1,
        "capture_chance": None if broken else 0.0,
        "transition_distance": None if broken else 0.1,
        "bump_angle_deg": bump_angle,
        "rows_completed": rows,
        "orbit_rows": {"converged": 1, "periodic": periodicity}.get(status, 0),
        "lateral_steps_um": list(steps),
        "steps": 1300 * rows,
        "nodes": 30_000,
        "vertices": 642,
        "spacing_um": 1.25,
        "time_step_us": 0.26,
        "velocity_lu": 0.01,
        "height_on_lattice_um": 20.0,
        "wall_time_s": 0.7 * rows + rng.uniform(0, 1),
        "ms_per_step": None if failed else 0.55 + rng.uniform(0, 0.1),
        "mlups": None if failed else 52.0,
        "capillary_number": 1.5 / ks,
        "reynolds_number": 0.3,
        "lag_number": 0.14,
        "mach_max": 0.06,
        "confinement": 15 / gap,
        "lateral_flux_ratio": 3e-5,
        "volume_drift_max": None if failed else rng.uniform(1e-4, 4e-3),
        "area_drift_max": None if failed else rng.uniform(1e-3, 1e-2),
        "min_clearance_um": None if failed else 0.8,
        "mean_deformation_index": 0.3,
        "left_out": "solid columns; outer viscosity field",
        **columns_of(Numerics(rows=1)),
    }
    row = dict.fromkeys(c.name for c in COLUMNS["runs"]) | row
    count = 30 * rows + 1
    along = np.linspace(0, rows, count)
    y = np.interp(along, np.arange(rows + 1), np.concatenate([[0], np.cumsum(steps)]))
    index = 0.3 + 0.1 * np.sin(2 * np.pi * along) ** 2
    ones = np.ones(count)
    track = {c.name: np.zeros(count) for c in COLUMNS["trajectory"]} | {
        "run_id": [run_id] * count,
        "step": np.arange(count),
        "t_ms": along,
        "x_um": (along + 0.4) * pitch,
        "y_um": pitch / 2 + y,
        "z_um": 10 * ones,
        "deformation_index": index,
        "axis_a_um": 15 * (1 + index),
        "axis_b_um": 15 * (1 - index),
        "volume_ratio": ones,
        "area_ratio": ones,
        "clearance_um": ones,
        "vx_mm_s": ones,
    }
    return row, track


def make_outcome(runs: list[dict]) -> dict:
    """Row of `outcomes` of the runs of one array and cell; runs in several modes coexist."""
    first = runs[0]
    status = {"converged": "decided", "periodic": "decided"}.get(first["status"], first["status"])
    modes = [run["mode"] for run in runs]
    coexisting = len(set(modes)) > 1
    known = first["migration_angle_deg"] is not None
    shares = {f"share_{m}": modes.count(m) / len(modes) for m in (*style.MODES[:3], "none")}
    names = {c.name for c in COLUMNS["outcomes"]}
    sigma = (None, "no angle", None, "no angle")
    if known and status == "decided":
        sigma = (0.1, "modelled", False, "modelled: bump, 4 studied runs")
    elif known:
        sigma = (None, "not studied", None, "not studied: <few> runs")
    return (
        {name: value for name, value in first.items() if name in names}
        | shares
        | {
            "status": "coexisting" if coexisting else status,
            "coexisting": coexisting,
            "deformation_index": SETS[first["stiffness_set"]][3],
            "deformation_index_std": 0.03,
            "angle_spread_deg": 0.0 if known else None,
            "releases": len(runs),
            "source_angle_deg": first["first_period_angle_deg"],
            **dict(zip(SIGMA, sigma, strict=True)),
            "rows_total": sum(run["rows_completed"] for run in runs),
        }
    )


def make_results(folder: Path, radii=(6.0, 10.0), gaps=(16.0, 20.0), periodicities=(5, 10)) -> dict:
    """All tables of a small campaign with every status; returns the tables by kind."""
    rng = np.random.default_rng(1)
    arrays = [(r, g, n) for r in radii for g in gaps for n in periodicities]
    ends = {(arrays[0], "1"): "stuck", (arrays[0], "3"): "unstable", (arrays[1], "1"): "failed"}
    made = [make_run(*a, s, rng, ends.get((a, s))) for a in arrays for s in SETS]
    pairs = [[row] for row, _ in made]
    known = next(i for i, [row] in enumerate(pairs) if row["mode"] == "bump")
    again, track = make_run(
        *(
            made[known][0][k]
            for k in ("pillar_radius_um", "gap_um", "periodicity", "stiffness_set")
        ),
        rng,
        place=0.2,
    )
    pairs[known].append(again | {"mode": "zigzag", "status": "stationary", "orbit_rows": 0})
    made.insert(known + 1, (pairs[known][1], track))
    runs = [row for rows in pairs for row in rows]
    outcomes = pd.DataFrame([make_outcome(rows) for rows in pairs])
    tables = {
        "outcomes": outcomes,
        "runs": pd.DataFrame(runs),
        "trajectory": pd.concat(
            [pd.DataFrame(track) for row, track in made if row["status"] != "failed"]
        ),
    }
    tables["flows"] = pd.DataFrame(
        [
            dict.fromkeys((c.name for c in COLUMNS["flows"]), 0.01)
            | {
                "pillar_radius_um": r,
                "gap_um": g,
                "periodicity": n,
                "pitch_um": 2 * r + g,
                "drive": "no-lateral-flux",
                "status": "steady",
                "stop_reason": "steady",
                "permeability_over_pitch2": 0.05 * (g / (2 * r + g)) ** 3,
                "tilt_deg": 20 / n * r / 10,
                "lateral_flux_ratio": 2e-5,
                "nodes": 30_000,
                "steps": 2000,
            }
            for r, g, n in arrays
        ]
    )
    moduli = {g: (5 + 2.5 * i, 0.04 + 0.05 * i, 10 + 5 * i) for i, g in enumerate(GROUPS)}
    set_of = {"G1": "1", "G2": "2", "G5": "3", "G6": "4", "G7": "5"}
    constriction, paths = [], []
    for i, group in enumerate(GROUPS):
        for j in range(3):
            ks, kb, kal = moduli[group]
            index = 0.5 + 0.04 * i + 0.02 * j
            lost = (group, j) == ("G4", 2)
            row = dict.fromkeys((c.name for c in COLUMNS["assay_runs"]), 0.1) | {
                "run_id": f"group-velocity_{group}_{j}",
                "assay": "group-velocity",
                "kind": "constriction",
                "cell_shape": "biconcave",
                "cell_radius_um": 7.5,
                "varied": "release" if j else "nothing",
                "axis": "z",
                "group": group,
                "stiffness_set": set_of.get(group, ""),
                "ks_uN_per_m": ks,
                "kb_pN_um": kb,
                "kal_uN_per_m": kal,
                "velocity_mm_s": 1.095 + 0.33 * i,
                "release_position_um": 3.0 * j,
                "status": "stuck" if lost else "passed",
                "stop_reason": "clogged the throat" if lost else "left the channel",
                "deformation_index": None if lost else index,
                "steps": 9000,
            }
            constriction.append(row)
            x = np.linspace(8 + 3 * j, 110, 120)
            squeeze = index * np.exp(-(((x - 60) / 18) ** 4))
            paths.append(
                pd.DataFrame(
                    {c.name: np.ones(120) for c in COLUMNS["assay_trajectory"]}
                    | {
                        "run_id": [row["run_id"]] * 120,
                        "step": np.arange(120),
                        "x_um": x,
                        "diameter_d_um": 15 * (1 + squeeze),
                        "diameter_h_um": 15 * (1 - squeeze),
                        "deformation_index": squeeze,
                    }
                )
            )
    own = pd.DataFrame(constriction)
    fixed = own.assign(
        assay="fixed-velocity",
        stiffness_set="",
        velocity_mm_s=2.0,
        run_id=lambda t: t["run_id"].str.replace("group", "fixed"),
        deformation_index=lambda t: 1.2 - t["deformation_index"],
    )
    passages = pd.concat([own, fixed])
    tables["assay_runs"] = passages
    tables["calibration"] = calibrate(passages, "group-velocity")
    tables |= dict.fromkeys(("assay_study", "calibration_library"), tables["calibration"])
    tables["calibration_correlations"] = correlations(passages)
    factors = ["pillar_radius_um", "gap_um", "periodicity", "deformation_index"]
    terms = [*factors, *(f"deformation_index:{name}" for name in factors[:3])]
    tables["anova"] = pd.DataFrame(
        [
            {
                "model": model,
                "term": term,
                "sum_sq": 40.0 / (i + 1),
                "df": 1.0 + i % 3,
                "f_value": 60.0 / (i + 1) ** 2,
                "p_value": 10.0 ** (i - 7) / 2,
                "partial_eta_sq": 0.9 / (i + 1),
                "partial_omega_sq": 0.8 / (i + 1) - 0.2,
                "p_robust": None if i else 0.02,
                "p_permutation": 0.2 * i,
                "note": "",
            }
            for model, part in (
                ("hierarchical", terms),
                ("main_effects", terms[:4]),
                ("seed_interactions", terms[4:]),
            )
            for i, term in enumerate(part)
        ]
        + [
            {
                "model": "main_effects",
                "term": "residual",
                "sum_sq": 11.0,
                "df": 14.0,
                "note": "lack of fit",
            },
            {"model": "hierarchical", "term": "rows", "note": "3 of 24 rows left out"},
        ]
    )
    tables["anova_diagnostics"] = pd.DataFrame(
        [
            {
                "model": model,
                "test": test,
                "statistic": 0.9,
                "p_value": p,
                "meaning": f"about {test}",
            }
            for model in ("main_effects", "hierarchical")
            for test, p in (("R²", None), ("Shapiro–Wilk W", 1e-5))
        ]
        + [
            {
                "model": "hierarchical",
                "test": "skewness",
                "statistic": None,
                "p_value": None,
                "meaning": "0 for normal residuals",
            }
        ]
    )
    tables["sobol"] = pd.DataFrame(
        [
            {"factor": name, "points": 64, "inside_share": 0.8}
            | {
                f"{order}_order{end}": value * (i + 1)
                for order, value in (("first", 0.1), ("total", 0.2))
                for end, value in (("", value), ("_low", 0.9 * value), ("_high", 1.1 * value))
            }
            for i, name in enumerate(factors)
        ]
    )
    tables["partial_dependence"] = pd.DataFrame(
        [
            {
                "x_name": "periodicity",
                "y_name": name,
                "x": x,
                "y": y,
                "inside_share": 0.5,
                "angle_deg": None if (x, y) == (5, 1) else x + y,
                "share": None if y == 1 else 0.5,
            }
            for name in ("gap_um", "pillar_radius_um")
            for x in (5, 7, 10)
            for y in (1, 2, 3)
        ]
    )
    names = [
        "pillar_radius_um",
        "gap_um",
        "periodicity",
        "stiffness_set",
        "capillary_number",
        "cell_radius_um",
    ]
    tables["fabrication"] = pd.concat(
        [
            tables["outcomes"][names].assign(
                radius_error_um=error,
                moved_limit_deg=0.5,
                predicted_angle_deg=2.0,
                predicted_mode="bump",
                simulated_mode=tables["outcomes"]["mode"],
                mode_change_probability=error / 2,
                moved_probability=0.3,
                angle_std_deg=0.4,
                inside_share=0.4 if error > 0.5 else 0.9,
            )
            for error in (0.25, 1.0)
        ]
    )
    mean = (
        tables["outcomes"]
        .groupby(["pillar_radius_um", "gap_um", "periodicity"])["migration_angle_deg"]
        .mean()
        .reset_index()
    )
    tables["robustness"] = mean.rename(
        columns={"migration_angle_deg": "mean_migration_angle_deg"}
    ).assign(
        robustness_score_deg2=lambda t: 0.2 * 1.7 ** np.arange(len(t)),
        neighbours=3,
        robust=lambda t: np.arange(len(t)) == 1,
        modes="bump 2, zigzag 1",
    )
    learnt = style.measured(tables["outcomes"])
    errors = {"XGBoost": 0.3, "Random forest": 0.5, "Linear": 1.6, "XGBoost on DI": 0.4}
    benchmark, predictions = [], []
    for model, error in errors.items():
        for split, factor in (("random", 1), ("geometry", 3), ("stiffness", 2)):
            for fold in range(3):
                test = learnt.iloc[fold::3]
                guess = test["migration_angle_deg"] + rng.normal(0, error * factor, len(test))
                off = guess - test["migration_angle_deg"]
                benchmark.append(
                    {
                        "model": model,
                        "split": split,
                        "repeat": 0,
                        "fold": fold,
                        "n_train": 14,
                        "n_test": len(test),
                        "mse_deg2": (off**2).mean(),
                        "rmse_deg": (off**2).mean() ** 0.5,
                        "mae_deg": off.abs().mean(),
                        "r2": None,
                        "fit_time_s": 0.02,
                        "predict_time_s": 0.001,
                    }
                )
                predictions += [
                    {
                        "outcome_id": r["outcome_id"],
                        "source": "campaign",
                        "cell_shape": r["cell_shape"],
                        "periodicity": r["periodicity"],
                        "capillary_number": r["capillary_number"],
                        "vertical_confinement": 0.75,
                        "mode": r["mode"],
                        "model": model,
                        "split": split,
                        "repeat": 0,
                        "fold": fold,
                        "observed_deg": r["migration_angle_deg"],
                        "predicted_deg": p,
                        "decided": r["status"] != "undecided",
                    }
                    for (_, r), p in zip(test.iterrows(), guess, strict=True)
                ]
    tables["benchmark"] = pd.DataFrame(benchmark)
    tables["predictions"] = pd.DataFrame(predictions)
    tables |= make_design_tables("soft <from> stiff")
    tables["validation"] = pd.DataFrame(
        [
            dict.fromkeys((c.name for c in COLUMNS["validation"]), "")
            | {
                "case": case,
                "group": "fluid",
                "quantity": quantity,
                "variant": variant,
                "unit": "1",
                "parameter": parameter,
                "parameter_of": "periodicity N_p",
                "resolution": resolution,
                "resolution_of": "nodes per pitch",
                "reference": 2.0,
                "value": 2.0 + 20 / resolution**2,
                "relative_error": 10 / resolution**2,
                "mark": 0.01,
                "passed": resolution > 32,
                "observed_order": 2.0 if resolution > 24 else None,
                "wall_time_s": 0.5,
            }
            for case, quantity in (
                ("square-arrays", "permeability"),
                ("row-shifted-arrays", "tilt"),
                ("erythrocyte-stretching", "axial diameter"),
                ("erythrocyte-stretching", "transverse diameter"),
            )
            for variant in ("half-way", "interpolated")
            for parameter in (4.0, 10.0)
            for resolution in (24.0, 48.0)
        ]
    )
    tables |= accuracy_tables() | {"stability": stability_table()}
    for kind, table in tables.items():
        path = folder / TABLES[kind][0]
        write_table(kind, table, path, PROVENANCE)
        if kind != "trajectory":
            write_csv(kind, path)
    for track in paths:
        name = f"{track['run_id'].iloc[0]}.trajectory.parquet"
        write_table("assay_trajectory", track, folder / "assays" / name, PROVENANCE)
    return tables


def accuracy_tables() -> dict[str, pd.DataFrame]:
    """Two cases, one knob, two whole settings; a point without a value; what σ_num is judged
    by."""
    blank = dict.fromkeys(c.name for c in COLUMNS["accuracy"])
    points = []
    for quantity, case in (
        ("migration_angle", "bump"),
        ("migration_angle", "edge"),
        ("deformation_index", "G1"),
    ):
        for kind, knob, setting, rank, error, time in (
            ("knob", "spacing_um", "2", 0, 0.05, 2),
            ("knob", "spacing_um", "1", 1, 0.0, 9),
            ("knob", "coupling", "dissipative", 0, None, 3),
            ("setting", "default", "", 0, 0.05, 2),
            ("setting", "reference", "spacing_um = 0.9", 1, 0.0, 9),
        ):
            points.append(
                blank
                | {
                    "quantity": quantity,
                    "kind": kind,
                    "case": case,
                    "run": "r",
                    "knob": knob,
                    "setting": setting,
                    "rank": rank,
                    "is_default": error == 0.05,
                    "is_reference": error == 0.0,
                    "values": [] if error is None else [error],
                    "value": error,
                    "error": error,
                    "error_share": error,
                    "error_to_reference": error,
                    "error_to_reference_share": error,
                    "noise": 0.01,
                    "noise_share": 0.01,
                    "bump_angle_deg": 5.0,
                    "mode": "bump",
                    "status": "unstable" if error is None else "periodic/undecided",
                    "settled": case != "edge" and error is not None,
                    "wall_time_s": time,
                    "rows": 20.0,
                }
            )
    blank = dict.fromkeys(c.name for c in COLUMNS["reference_check"])
    check = [
        blank
        | {
            "outcome_id": f"o{i}",
            "pillar_radius_um": 5.0,
            "gap_um": 20.0,
            "periodicity": 8,
            "stiffness_set": "1",
            "mode": mode,
            "reference_mode": "bump",
            "status": "decided",
            "reference_status": "decided",
            "bump_angle_deg": 7.1,
            "migration_angle_deg": angle,
            "reference_angle_deg": 7.1,
            "error_deg": angle and angle - 7.1,
            "sigma_num_deg": 0.15,
            "error_over_sigma": angle and (7.1 - angle) / 0.15,
            "sigma_num_basis": "modelled: far",
            "verdict": "so <and> so",
        }
        for i, (mode, angle) in enumerate((("bump", 7.0), ("mixed", 2.0), ("none", None)))
    ]
    blank = dict.fromkeys(c.name for c in COLUMNS["spot_check"])
    spot = [
        blank
        | {
            "outcome_id": "o0",
            "pillar_radius_um": 5.0,
            "gap_um": 20.0,
            "periodicity": 8,
            "stiffness_set": "1",
            "mode": "bump",
            "check_mode": "mixed",
            "status": "decided",
            "check_status": "decided",
            "change_over_sigma": 3.0,
            "verdict": "changes",
        }
    ]
    convergence = [
        {
            "pillar_radius_um": 8.0,
            "periodicity": 10,
            "stiffness_set": "3",
            "cell_shape": "biconcave",
            "cell_radius_um": 7.5,
            "knob": "spacing_um",
            "steps": [1.1, 0.8, 0.6],
            "critical_gaps_um": [17.0, 17.2, 17.3],
            "range_um": 0.3,
            "observed_order": None,
            "extrapolated_gap_um": None,
            "error_um": None,
            "note": "no order",
        }
    ]
    curve = [
        {
            "model": model,
            "repeat": k,
            "geometries": n,
            "outcomes": 3 * n,
            "n_test": 6,
            "rmse_deg": error * (1 + 1 / n) + 0.01 * k,
            "mae_deg": 0.1,
            "fit_time_s": 0.1,
            "simulation_time_s": 12.0 * n,
        }
        for model, error in (("XGBoost", 0.4), ("rule", 3.0))
        for k in range(3)
        for n in (3, 6, 9)
    ]
    regret = [
        {
            "request": "soft <from> stiff",
            "method": method,
            "repeat": 0,
            "evaluations": n,
            "best_deg": 3 - 1 / n,
            "regret_deg": 1 / n,
            "time_s": 0.01 * n,
        }
        for method in ("tpe", "random", "grid")
        for n in (1, 10, 100)
    ]
    return {
        "accuracy": pd.DataFrame(points),
        "reference_check": pd.DataFrame(check),
        "spot_check": pd.DataFrame(spot),
        "convergence": pd.DataFrame(convergence),
        "learning_curve": pd.DataFrame(curve),
        "search_regret": pd.DataFrame(regret),
    }


def stability_table() -> pd.DataFrame:
    """A point that ran, one that was refused, and a stiff one with either time step."""
    blank = dict.fromkeys(c.name for c in COLUMNS["stability"])
    about = {
        "family": "stiffness-10",
        "title": "Stiffness × 10",
        "label": "set 1",
        "parameter": 10.0,
        "parameter_of": "multiplier",
        "stiffness_set": "1",
        "reason": "",
        "time_step": "automatic",
        "outcome": "ran",
    }
    return pd.DataFrame(
        [
            blank | about | row
            for row in (
                {"predicted_safe": True, "margin": 3.0, "refinement": 3.0},
                {
                    "predicted_safe": False,
                    "margin": 3.0,
                    "refinement": 1.0,
                    "time_step": "as-given",
                    "outcome": "unstable",
                    "reason": "too fast",
                },
                {
                    "family": "gap",
                    "title": "Gap",
                    "label": "4",
                    "outcome": "refused",
                    "reason": "too few",
                },
            )
        ]
    )


class Page(HTMLParser):
    """Links, image sources, tables (rows of cell texts) and the text of a report."""

    def __init__(self, path: Path):
        super().__init__()
        self.links, self.sources, self.tags, self.rows, self.words = [], [], set(), [], []
        self.in_cell = False
        self.path, self.raw = path, path.read_text(encoding="utf-8")
        self.feed(self.raw)
        self.text = " ".join(" ".join(self.words).split())

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        self.tags.add(tag)
        if "href" in attrs:
            self.links.append(attrs["href"])
        if "src" in attrs:
            self.sources.append(attrs["src"])
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
            self.in_cell = True

    def handle_endtag(self, tag):
        self.in_cell = self.in_cell and tag not in ("td", "th")

    def handle_data(self, data):
        if self.lasttag != "style":
            self.words.append(data)
        if self.in_cell:
            self.rows[-1][-1] += data

    def row(self, first: str) -> list[str]:
        """The first table row that begins with this cell."""
        return next([cell.strip() for cell in row] for row in self.rows if row[0] == first)


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaign") / "results"
    tables = make_results(folder)
    campaign_page.make_report(folder, folder / "report.html", CONFIG)
    return tables, Page(folder / "report.html")


def test_status_table_counts_the_outcomes(campaign):
    tables, page = campaign
    outcomes = tables["outcomes"]
    statuses = outcomes["status"].value_counts()
    # the made-up campaign has them all
    assert set(statuses.index) == set(summary.STATUS_MEANING)
    head = page.row("status")
    for status, count in statuses.items():
        row = dict(zip(head, page.row(status), strict=True))
        assert row["all"] == str(count)
        of_status = outcomes[outcomes["status"] == status]["mode"]
        for mode in ("bump", "mixed", "zigzag"):
            assert row[mode] == str((of_status == mode).sum())
    statuses = tables["runs"]["status"].value_counts()
    assert set(statuses.index) == set(summary.RUN_MEANING)
    for status in ("converged", "periodic", "stationary"):
        assert page.row(status)[1] == str(statuses[status])


def test_every_outcome_and_every_release_has_a_row(campaign):
    tables, page = campaign
    for _, outcome in tables["outcomes"].iterrows():
        if outcome["mode"] != "none":
            assert page.row(outcome["outcome_id"])[1] == outcome["status"]
    for _, run in tables["runs"].iterrows():
        assert page.row(run["run_id"])[1] == run["status"]
    [coexisting] = tables["outcomes"].query("status == 'coexisting'").to_dict("records")
    row = page.row(coexisting["outcome_id"])
    assert "50, 0, 50" in row and "2" in row  # shares of the flux, releases


def test_outcomes_without_an_angle_are_listed_with_their_reason(campaign):
    tables, page = campaign
    broken = tables["outcomes"].query("mode == 'none'")
    assert len(broken) == 3
    for _, outcome in broken.iterrows():
        row = page.row(outcome["outcome_id"])
        assert row[1] == outcome["status"] and row[-1] == NASTY


def test_text_from_tables_is_escaped(campaign):
    _, page = campaign
    assert "density 3.1 &lt;b&gt;&amp; more&lt;/b&gt;" in page.raw
    assert "<b>& more" not in page.raw
    assert "soft &lt;from&gt; stiff" in page.raw and "<from>" not in page.raw


def test_page_shows_no_missing_number_as_such(campaign):
    _, page = campaign
    assert not re.search(r"\b(nan|null|inf)\b", page.text, re.I)
    bare = [
        row for row in page.rows if {"", "none", "<na>", "nat"} & {c.strip().lower() for c in row}
    ]
    assert not bare


def test_page_loads_nothing(campaign):
    _, page = campaign
    assert page.sources and all(source.startswith("data:image/") for source in page.sources)
    assert not page.tags & {"link", "script", "iframe", "object"}
    assert not re.search(r"url\(|@import|https?:", re.sub(r'src="data:[^"]*"', "", page.raw))
    assert page.path.stat().st_size < 8e6


def test_every_link_leads_somewhere(campaign):
    _, page = campaign
    inside = [link[1:] for link in page.links if link.startswith("#")]
    files = [link for link in page.links if not link.startswith("#")]
    assert len(inside) >= len(campaign_page.SECTIONS)
    assert all(f'id="{anchor}"' in page.raw for anchor in inside)
    assert all((page.path.parent / link).exists() for link in files)
    linked = {link for link in files if link.endswith(".parquet")}
    assert linked == {name for name, _ in TABLES.values()}


def test_each_figure_is_saved_as_png_and_svg(campaign):
    _, page = campaign
    names = re.findall(r'<figure id="figure-(\w+)"', page.raw)
    assert len(names) == len(set(names)) == 46
    for name in names:
        assert (page.path.parent / "figures" / f"{name}.png").read_bytes()[:4] == b"\x89PNG"
        assert b"<svg" in (page.path.parent / "figures" / f"{name}.svg").read_bytes()


def test_benchmark_table_keeps_the_splits_apart(campaign):
    tables, page = campaign
    folds = tables["benchmark"]
    of_model = folds[folds["model"] == "XGBoost"].groupby("split")["rmse_deg"]
    rows = [row for row in page.rows if row[0] == "XGBoost" and len(row) == 10]
    for row, split in zip(rows, ("geometry", "random", "stiffness"), strict=True):
        mean, spread = of_model.mean()[split], of_model.std()[split]
        assert row[3] == f"{number(mean, 2)} ± {number(spread, 2)}"


def test_design_table_shows_separation_with_uncertainty(campaign):
    _, page = campaign
    [row] = [row for row in page.rows if "2.50 to 4.40" in row]
    assert row[5:8] == ["4.00 ± 1.70", "–", "2.50 to 4.40"]
    assert page.rows[page.rows.index(row) + 1] == ["resolved"]


def test_a_failed_request_gets_its_reason(campaign):
    _, page = campaign
    for what in ("candidates", "simulated designs"):
        assert f"{what} of the request dead" in page.text
    assert page.raw.count("no &lt;range&gt; left") >= 2


def test_verified_designs_show_simulation_beside_prediction(campaign):
    _, page = campaign
    row, checks = (r for r in page.rows if "made-up-1" in r)
    assert "3.00 ± 0.30" in row and "7.00" in row and "14.30" in row and "8" in row
    assert checks[2:] == [
        "4.00 ± 3.50",
        "confirmed",
        "3.00 ± 0.30",
        "2.80",
        "2.00 to 4.50",
        "2.50, –",
    ]
    verdict = page.rows[page.rows.index(row) + 1]
    assert verdict == ["separates by 3.00 ± 0.30°; prediction confirmed"]
    stuck = next(r for r in page.rows if "made-up-2" in r)
    assert page.rows[page.rows.index(stuck) + 1] == ["no separation measured"]


@pytest.fixture
def blank_figures(monkeypatch):
    """Figures are drawn and not rendered, which is most of the time that a page takes."""
    monkeypatch.setattr(style, "render", lambda figure, kind: b"<svg/>")


def write_campaign(folder, rows):
    """The tables of outcomes and runs of made-up runs, one of each outcome."""
    write_table(
        "outcomes", [make_outcome([row]) for row in rows], folder / "outcomes.parquet", PROVENANCE
    )
    write_table("runs", rows, folder / "runs.parquet", PROVENANCE)


def test_report_of_broken_outcomes_alone_says_what_is_missing(tmp_path, blank_figures):
    """No optional table and no angle: sentences and rules, no crash."""
    rng = np.random.default_rng(0)
    rows = [make_run(6.0, 18.0, 5, name, rng, "failed")[0] for name in SETS]
    blank = {c.name: None for c in COLUMNS["outcomes"] if c.nullable}
    outcomes = [make_outcome([row]) | blank | {"releases": 0} for row in rows]
    write_table("outcomes", outcomes, tmp_path / "outcomes.parquet", PROVENANCE)
    write_table("runs", [], tmp_path / "runs.parquet", PROVENANCE)
    campaign_page.make_report(tmp_path, tmp_path / "page" / "report.html", {})
    page = Page(tmp_path / "page" / "report.html")
    studies = [TABLES[kind][1] for kind in STUDIES]
    assert f"snakemake -j2 {' '.join(studies)}" in page.text
    for chapter in ("Validation", "Stability", "Analysis of variance"):
        assert f"<h2>{chapter}</h2>" not in page.raw
    assert "No outcome of this campaign has a migration angle" in page.text
    for name, rule in TABLES.values():
        if name != "outcomes.parquet" and name != "runs.parquet" and rule not in studies:
            row = page.row(name)
            assert row[1] == f"snakemake -j2 {rule}"
            assert page.rows[page.rows.index(row) + 1] == ["It does not exist."]
    assert all((page.path.parent / link).exists() for link in page.links if link[0] != "#")


def test_one_mode_alone_is_called_out(tmp_path, blank_figures):
    rng = np.random.default_rng(0)
    rows = [make_run(6.0, 12.0, n, name, rng)[0] for name in SETS for n in (8, 12)]
    assert {row["mode"] for row in rows} == {"bump"}
    write_campaign(tmp_path, rows)
    campaign_page.make_report(tmp_path, tmp_path / "report.html", CONFIG)
    text = Page(tmp_path / "report.html").text
    assert "Every measured outcome has the same mode (bump)" in text


def test_nothing_to_show_is_refused_with_the_reasons(tmp_path):
    write_table("outcomes", [], tmp_path / "outcomes.parquet", PROVENANCE)
    (tmp_path / "runs.parquet").write_bytes(b"PAR1 cut short")
    with pytest.raises(DldsimError, match="nothing to report") as refused:
        campaign_page.make_report(tmp_path, tmp_path / "report.html", CONFIG)
    for reason in (
        "outcomes.parquet: It has no row",
        "runs.parquet is not a readable Parquet",
        "flows.parquet: It does not exist",
    ):
        assert reason in str(refused.value)
    assert not (tmp_path / "report.html").exists()


def lacking(page, what):
    """Command and reason that a page gives for what it lacks."""
    row = page.row(what)
    return row[1], page.rows[page.rows.index(row) + 1][0]


def test_a_report_is_made_of_what_there_is(tmp_path, blank_figures):
    """Damaged, absent and older tables, a chapter that fails, requests that failed."""
    rng = np.random.default_rng(0)
    write_campaign(tmp_path, [make_run(6.0, 14.0, 8, name, rng)[0] for name in SETS])
    tables = make_design_tables("first")
    for kind in ("designs", "design_trials"):
        write_table(kind, tables[kind], tmp_path / TABLES[kind][0], PROVENANCE)
    told = [
        {"request": "first", "status": "answered", "reason": ""},
        {"request": "second", "status": "failed", "reason": "second: no array is feasible"},
    ]
    write_table("design_requests", told, tmp_path / TABLES["design_requests"][0], PROVENANCE)
    (tmp_path / "anova.parquet").write_bytes(b"PAR1 cut short")
    (tmp_path / "surrogate_card.json").write_text("{")
    os.utime(tmp_path / "designs.parquet", (1, 1))
    config = {**CONFIG, "design_requests": [{"name": "first"}, {"name": "second"}]}
    campaign_page.make_report(tmp_path, tmp_path / "report.html", config)
    page = Page(tmp_path / "report.html")
    assert "<h2>Designs</h2>" in page.raw and "<h2>Migration angle</h2>" in page.raw
    assert "This report is not complete" in page.text
    assert "made from earlier ones: designs.parquet." in page.text
    assert "not a readable Parquet file" in lacking(page, "anova.parquet")[1]
    assert "not readable as JSON" in lacking(page, "chapter “Summary”")[1]
    command, why = lacking(page, "candidates of the request second")
    assert command == "snakemake -j2 designs" and "second: no array is feasible" in why
    assert "request first" not in page.text


def test_after_a_failure_no_older_report_is_left(tmp_path, blank_figures):
    old = tmp_path / "report.html"
    old.write_text("old")
    assert "nothing to report" in campaign_page.renew_report(tmp_path, CONFIG)
    assert not old.exists()
    old.write_text("old")
    rng = np.random.default_rng(0)
    write_campaign(tmp_path, [make_run(6.0, 14.0, 8, name, rng)[0] for name in SETS])
    assert str(old) in campaign_page.renew_report(tmp_path, CONFIG)
    assert "designs.parquet" in Page(old).text


def test_designs_come_first_with_the_array(campaign):
    _, page = campaign
    assert page.raw.index("<h2>Designs</h2>") < page.raw.index("<h2>Summary</h2>")
    head, answer, verdict = page.rows[:3]
    assert answer[:4] == ["soft <from> stiff", "7.00", "14.30", "8"]
    assert head[1:4] == ["Pr [µm]", "Pg [µm]", "Np"] and "3.00 ± 0.30" in answer
    assert verdict == ["separates by 3.00 ± 0.30°; prediction confirmed"]
    assert re.search(
        r"largest simulated separation of a design \(soft <from> stiff\): "
        r"P_r 7\.00 µm, P_g 14\.3 µm, N_p 8",
        page.text,
    )


def test_first_lines_say_what_the_designs_hold_for(campaign):
    text = campaign[1].text
    assert text.index(
        "Holds for biconcave discs of radius 5 µm at rest in a channel 20 µm high "
        "at a mean velocity of 0.5 mm/s."
    ) < text.index("Table 1.")
    assert text.index("biconcave disc of that radius, 10 µm across, not a bead") < text.index(
        "Table 1."
    )


def test_tables_outside_folds_fit_the_page(campaign):
    """Twelve columns fit a column of text of 55 rem; verdicts run below over the whole width."""
    open_parts = re.sub(r"<details>.*?</details>", "", campaign[1].raw, flags=re.S)
    heads = re.findall(r"<thead>(.*?)</thead>", open_parts, flags=re.S)
    assert len(heads) > 15 and max(head.count("<th>") for head in heads) <= 12
    assert not [head for head in heads if "<th>verdict</th>" in head and head.count("<th>") > 6]


def test_internal_tables_are_folded(campaign):
    open_parts = re.sub(r"<details>.*?</details>", "", campaign[1].raw, flags=re.S)
    for caption in ("Settings and provenance.", "Numerics over all runs."):
        assert caption in campaign[1].raw and caption not in open_parts


def test_conditions_that_the_source_does_not_vary_are_drawn(campaign):
    predictions = campaign[0]["predictions"]
    predictions = predictions.assign(
        cell_shape=np.where(predictions.index % 2, "sphere", "biconcave")
    )
    figure = surrogate_figures.draw_conditions(predictions, "XGBoost")
    left, right = figure.axes
    assert (left.get_xscale(), right.get_xscale()) == ("log", "linear")
    assert [t.get_text() for t in figure.legends[0].get_texts()] == ["biconcave", "sphere"]


def test_error_of_the_surrogate_is_one_number_and_the_other_is_explained(
    tmp_path, blank_figures, campaign
):
    tables, _ = campaign
    for kind in ("outcomes", "benchmark", "predictions"):
        renamed = tables[kind].replace({"model": {"XGBoost": SURROGATE}})
        write_table(kind, renamed, tmp_path / TABLES[kind][0], PROVENANCE)
    card = Path(dldsim.__file__).parent / "data" / "campaign" / "surrogate_card.json"
    shutil.copy(card, tmp_path)
    error = number(json.loads(card.read_text())["scores_by_geometry"]["rmse_deg"], 2)
    campaign_page.make_report(tmp_path, tmp_path / "report.html", CONFIG)
    text = Page(tmp_path / "report.html").text
    assert f"± {error}° error of the surrogate ({SURROGATE})" in re.sub(" +", " ", text)
    assert f"The {error}° of the surrogate and the 0.99° of {SURROGATE} in the table" in text


def rules_of(selector, text):
    """Declarations of a selector in a part of a style sheet."""
    return " ".join(
        body
        for names, body in re.findall(r"([^{}]+)\{([^{}]*)\}", text)
        if selector in [name.strip() for name in names.split(",")]
    )


def test_the_text_column_is_wide_and_printing_keeps_headings(campaign):
    style = re.search(r"<style>(.*?)</style>", campaign[1].raw, flags=re.S)[1]
    screen, printed = style.split("@media print")
    assert "max-width: 61rem" in rules_of(".page", screen)
    assert "grid" not in rules_of(".page", screen)
    assert "minmax(0, 58rem)" in rules_of(".page.with-contents", screen)
    for heading in ("h2", "h3", "caption"):
        assert "break-after: avoid" in rules_of(heading, printed)
    for block in ("figure", "tr", ".table"):
        assert "break-inside: avoid" in rules_of(block, printed)
    assert "break-inside: auto" in rules_of(".table.long", printed)


def test_a_page_without_contents_has_no_column_for_them(tmp_path):
    page = report_page.Page(tmp_path, tmp_path / "a.html", {}, {})
    for contents in (True, False):
        report_page.write_page(
            page,
            title="t",
            heading="<h>",
            lead="",
            contents=contents,
            scope=[],
            notices=[],
            sections=[("a", "A", Markup("<p>body</p>"))],
        )
        raw = page.output.read_text()
        assert ("<nav" in raw) == ('with-contents"' in raw) == contents
        assert "<h1>&lt;h&gt;</h1>" in raw and "<p>body</p>" in raw


def test_templates_come_with_the_package():
    root = Path(dldsim.__file__).parent
    project = tomllib.loads((root.parent / "pyproject.toml").read_text())
    patterns = project["tool"]["setuptools"]["package-data"]["dldsim"]
    packaged = {path for pattern in patterns for path in root.glob(pattern)}
    files = {path for path in (root / "report").rglob("*") if path.suffix in (".html", ".css")}
    assert len(files) > 20 and files <= packaged


def test_rules_named_for_missing_tables_make_them():
    rules = {}
    for path in (Path(__file__).parents[2] / "workflow" / "rules").glob("*.smk"):
        _, *blocks = re.split(r"^rule (\w+):", path.read_text(), flags=re.M)
        rules |= dict(zip(blocks[::2], blocks[1::2], strict=True))
    for name, rule in (*TABLES.values(), CARD):
        assert f"/{name}" in rules[rule].split("output:")[1]


@pytest.mark.parametrize(
    ("value", "digits", "shown"),
    [
        (0.0, 3, "0"),
        (1234567, 3, "1 234 567"),
        (0.98765, 3, "0.988"),
        (9.996, 3, "10.0"),
        (12345.6, 3, "12 346"),
        (-2.5, 2, "−2.5"),
        (3.2e-5, 2, "3.2 × 10⁻⁵"),
        (None, 3, "–"),
        (float("nan"), 3, "–"),
        (True, 3, "yes"),
        (2.5e7, 3, "2.50 × 10⁷"),
    ],
)
def test_number_format(value, digits, shown):
    assert number(value, digits).replace("\u202f", " ") == shown


def test_probability_and_duration_format():
    assert [probability(p) for p in (0.25, 4.4e-12, 0.0, None)] == [
        "0.250",
        "4.4 × 10⁻¹²",
        "< 10⁻³⁰⁰",
        "–",
    ]
    assert [duration(s) for s in (47.0, 930.0, 12000.0)] == ["47 s", "16 min", "3.33 h"]


# --------------------------------------------------------------------- data computed for figures


def test_critical_size_ratio():
    assert angle_figures.critical_size_ratio(0.1) == pytest.approx(1.4 * 0.1**0.48)
    assert angle_figures.critical_size_ratio([0.05, 0.2]) == pytest.approx([0.3324, 0.6466], 1e-3)


def test_volume_equivalent_diameter():
    volume = np.pi / 6 * angle_figures.volume_equivalent_diameter("biconcave", 3.91, 1.0) ** 3
    assert volume == pytest.approx(94.1, abs=0.1)  # µm³, Evans & Fung 1972
    assert angle_figures.volume_equivalent_diameter("sphere", 7.5, 0.3) == pytest.approx(15)
    assert angle_figures.volume_equivalent_diameter("ellipsoid", 4.0, 0.125) == pytest.approx(4)


def test_cumulated_row_shifts_of_a_full_bump_count_rows():
    run = {"pitch_um": 36.0, "row_shift_fraction": 0.125, "lateral_steps_um": [4.5] * 6}
    total = trajectory_figures.cumulated_row_shifts(run)
    assert total.tolist() == pytest.approx([0, 1, 2, 3, 4, 5, 6])


def test_row_map_of_a_bump_is_a_point_and_of_a_straight_path_a_line():
    run = {
        "pitch_um": 36.0,
        "row_shift_fraction": 0.125,
        "pillar_radius_um": 9.0,
        "gap_um": 18.0,
        "release_gap_fraction": 0.5,
    }
    height, steps = trajectory_figures.row_map({**run, "lateral_steps_um": [4.5] * 6})
    assert height.tolist() == pytest.approx([0.5] * 6) and steps.tolist() == pytest.approx([1] * 6)
    # Straight on, the pillars climb by a quarter of the gap per row.
    height, steps = trajectory_figures.row_map({**run, "lateral_steps_um": [0.0] * 9})
    expected = [0.5, 0.25, 0.0, -0.25, -0.5, -0.75, -1.0, 0.75, 0.5]
    assert (height - expected) % 2 == pytest.approx(0, abs=1e-9)
    assert ((-1 <= height) & (height <= 1)).all() and not steps.any()


def test_row_maps_show_every_row_of_every_run():
    row = {
        "pitch_um": 36.0,
        "row_shift_fraction": 0.125,
        "pillar_radius_um": 9.0,
        "gap_um": 18.0,
        "periodicity": 8,
        "stiffness_set": "1",
        "release_gap_fraction": 0.5,
    }
    steps = [1.0, 2.0, 4.5]
    runs = [
        {**row, "run_id": "a", "lateral_steps_um": steps},
        {**row, "run_id": "b", "lateral_steps_um": steps[:2]},
        {**row, "run_id": "c", "gap_um": 20.0, "lateral_steps_um": steps},
    ]
    figure = trajectory_figures.draw_row_maps(pd.DataFrame(runs))
    points = [[len(line.get_xdata()) for line in axes.lines[1:]] for axes in figure.axes]
    assert points == [[3, 2], [3]]


def test_gap_height_is_constant_when_the_cell_follows_the_rows():
    run = {"pitch_um": 36.0, "row_shift_fraction": 0.125, "pillar_radius_um": 9.0, "gap_um": 18.0}
    x = np.linspace(12.0, 300.0, 500)
    track = pd.DataFrame({"x_um": x, "y_um": 9.0 + 4.5 + 4.5 * x / 36.0})
    rows, heights = trajectory_figures.gap_heights(track, run)
    assert rows.tolist() == list(range(1, 9))
    assert heights == pytest.approx(np.full(8, 0.25))


def test_pillars_stand_on_the_shifted_lattice():
    run = {"pitch_um": 30.0, "row_shift_fraction": 0.2, "pillar_radius_um": 5.0}
    centres = trajectory_figures.pillars_in(run, (-1.0, 61.0), (0.0, 40.0))
    rows = np.round(centres[:, 0] / 30.0)
    lanes = (centres[:, 1] - 6.0 * rows) / 30.0
    assert centres[:, 0] == pytest.approx(30.0 * rows) and lanes == pytest.approx(np.round(lanes))
    assert sorted(set(rows)) == [0, 1, 2]
    assert [0.0, 0.0] in centres.tolist() and [30.0, 36.0] in centres.tolist()


def test_picked_trajectories_show_each_mode_and_prefer_settled_runs(campaign):
    runs = campaign[0]["runs"]
    picked = dict(trajectory_figures.pick_trajectories(runs))
    for mode in ("bump", "zigzag"):
        [run_id] = picked[f"{mode} mode"]
        run = runs.set_index("run_id").loc[run_id]
        assert run["mode"] == mode and run["status"] in SETTLED


@pytest.mark.parametrize("status", ["converged", "undecided"])
def test_sets_are_shown_to_part_only_if_settled_from_every_place(status):
    runs = pd.DataFrame(
        [
            {
                "run_id": f"s{name}_y{place}",
                "outcome_id": f"s{name}",
                "stiffness_set": name,
                "pillar_radius_um": 5.0,
                "gap_um": 16.0,
                "periodicity": 10,
                "mode": mode,
                "migration_angle_deg": angle,
                "bump_angle_deg": 5.71,
                "status": status if (name, place) == ("5", 0.2) else "periodic",
            }
            for name, mode, angle in (("1", "bump", 5.71), ("5", "mixed", 1.0))
            for place in (0.5, 0.2)
        ]
    )
    picked = trajectory_figures.pick_trajectories(runs)
    pairs = [ids for heading, ids in picked if "apart" in heading]
    assert pairs == ([["s1_y0.5", "s5_y0.5"]] if status == "converged" else [])


def test_trajectory_panel_shows_a_period_in_true_proportion(campaign):
    tables, _ = campaign
    runs, tracks = tables["runs"], tables["trajectory"]
    run = runs[runs["mode"] == "bump"].iloc[0]
    panel = trajectory_figures.trajectory_panel("bump", [run["run_id"]], runs, tracks)
    assert np.ptp(panel.paths[0]["x"]) >= run["periodicity"] * run["pitch_um"]
    axes = trajectory_figures.draw_trajectories([panel]).axes[0]
    box = axes.get_window_extent()
    scale = box.width / np.ptp(panel.xlim) / (box.height / np.ptp(panel.ylim))
    assert scale == pytest.approx(1, rel=1e-3)


def test_mode_points_place_outcomes_against_the_critical_diameter(campaign):
    points = angle_figures.mode_points(campaign[0]["outcomes"], 1.0)
    assert len(points) == len(style.measured(campaign[0]["outcomes"]))
    run = points.iloc[0]
    law = 1.4 * run["gap_um"] * run["periodicity"] ** -0.48
    assert run["size_over_critical"] == pytest.approx(run["size_um"] / law)


def test_pooled_scores():
    predictions = pd.DataFrame(
        {
            "model": ["A"] * 4 + ["B"] * 2,
            "split": "geometry",
            "repeat": 0,
            "observed_deg": [0.0, 2.0, 4.0, 6.0, 1.0, 3.0],
            "predicted_deg": [1.0, 1.0, 5.0, 5.0, 1.5, 3.5],
        }
    )
    scores = surrogate_figures.pooled_scores(predictions).set_index("model")
    assert list(scores.index) == ["B", "A"]  # best by geometry first
    assert scores.loc["A", ["rmse_deg", "mae_deg", "r2"]].tolist() == pytest.approx([1, 1, 0.8])
    assert scores.loc["B", "rmse_deg"] == pytest.approx(0.5)


def test_the_sources_form_is_compared_on_the_same_rows():
    """The second model on Ca has an outcome more, which the one on DI could not see."""
    rows = [("A", "x", 0.1), ("A", "y", 3.0), ("A on DI", "x", 0.4), ("B", "x", 1.0)]
    predictions = pd.DataFrame(rows, columns=["model", "outcome_id", "predicted_deg"]).assign(
        split="geometry", repeat=0, observed_deg=0.0
    )
    [row] = surrogate_figures.on_same_rows(predictions).to_dict("records")
    assert (row["model"], row["n"]) == ("A", 1)
    assert (row["rmse_deg_ca"], row["rmse_deg_index"]) == pytest.approx((0.1, 0.4))


def test_errors_by_shape_and_source():
    predictions = pd.DataFrame(
        {
            "model": "A",
            "split": ["geometry"] * 3 + ["random"],
            "cell_shape": ["sphere", "sphere", "biconcave", "sphere"],
            "source": ["survey", "survey", "campaign", "survey"],
            "observed_deg": 0.0,
            "predicted_deg": [1.0, -1.0, 2.0, 9.0],
        }
    )
    found = surrogate_figures.by_kind(predictions, "A").set_index(["cell_shape", "source"])
    assert found["rmse_deg"].to_dict() == {("biconcave", "campaign"): 2, ("sphere", "survey"): 1}


def test_correlation_matrix_is_symmetric():
    pairs = pd.DataFrame(
        {"variable_a": ["x", "x"], "variable_b": ["y", "z"], "pearson_r": [0.5, None]}
    )
    matrix = calibration_figures.correlation_matrix(pairs)
    assert matrix.loc["y", "x"] == matrix.loc["x", "y"] == 0.5
    assert matrix.loc["z", "z"] == 1 and np.isnan(matrix.loc["y", "z"])


def test_angles_of_an_aliased_sweep_are_drawn_against_periodicity():
    rng = np.random.default_rng(0)
    rows = [make_run(r, r + 10, n, s, rng)[0] for r in (4.0, 8.0) for n in (4, 8) for s in SETS]
    figure = angle_figures.draw_angles(pd.DataFrame([make_outcome([row]) for row in rows]))
    assert [axes.get_xlabel() for axes in figure.axes] == ["periodicity $N_p$"] * 2


def test_equal_figures_give_equal_files(campaign):
    scores = surrogate_figures.pooled_scores(campaign[0]["predictions"])
    first, second = (
        style.render(surrogate_figures.draw_benchmark(scores, campaign[0]["benchmark"]), "svg")
        for _ in range(2)
    )
    assert first == second


def test_both_files_of_a_figure_are_laid_out_alike(campaign):
    scores = surrogate_figures.pooled_scores(campaign[0]["predictions"])
    figure = surrogate_figures.draw_benchmark(scores, campaign[0]["benchmark"])
    places = []
    for kind in ("svg", "png"):
        style.render(figure, kind)
        places.append([axes.get_position().bounds for axes in figure.axes])
    assert places[0] == places[1]


def test_a_short_run_beside_a_long_one_is_seen_whole_in_the_window(campaign):
    tables, _ = campaign
    runs, trajectories = tables["runs"], tables["trajectory"]
    measured = runs[runs["migration_angle_deg"].notna()]
    array = next(
        a for _, a in measured.groupby(["pillar_radius_um", "gap_um", "periodicity"]) if len(a) > 1
    )
    long, short = array["run_id"].iloc[:2]
    whole = trajectories[trajectories["run_id"] == short]
    cut = whole["x_um"].min() + 0.2 * np.ptp(whole["x_um"])
    kept = (trajectories["run_id"] != short) | (trajectories["x_um"] <= cut)
    panel = trajectory_figures.trajectory_panel("two", [long, short], runs, trajectories[kept])
    assert all(len(path["x"]) > 1 for path in panel.paths)
    assert all(path["x"].max() <= cut for path in panel.paths)
