"""Tables of a small made-up campaign, of every kind that the report reads."""

from pathlib import Path

import numpy as np
import pandas as pd

from dldsim.analysis.passages import calibrate, correlations
from dldsim.analysis.uncertainty import SIGMA
from dldsim.config.sections import Numerics
from dldsim.report import style
from dldsim.report.inputs import TABLES
from dldsim.tables.numerics import columns_of
from dldsim.tables.parquet import write_csv, write_table
from dldsim.tables.registry import COLUMNS
from tests.report.design_tables import make_design_tables
from tests.report.made_studies import accuracy_tables, stability_table

PROVENANCE = {"config_hash": "0123abcd", "seed": 7}
SETS = {  # k_s, k_b, k_α, DI
    "1": (5.1, 4.3e-2, 10.2, 0.51),
    "3": (15.24, 0.25, 30.0, 0.77),
    "5": (20.3, 0.35, 40.6, 0.78),
}
GROUPS = ("G1", "G2", "G3", "G4", "G5", "G6", "G7")
NASTY = "density 3.1 <b>& more</b>"


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
