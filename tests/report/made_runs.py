"""Rows of made-up runs of every status, their paths, outcomes and flows."""

import numpy as np
import pandas as pd

from dldsim.analysis.uncertainty import SIGMA
from dldsim.config.sections import Numerics
from dldsim.report import style
from dldsim.tables.numerics import columns_of
from dldsim.tables.registry import COLUMNS

SETS = {  # k_s, k_b, k_α, DI
    "1": (5.1, 4.3e-2, 10.2, 0.51),
    "3": (15.24, 0.25, 30.0, 0.77),
    "5": (20.3, 0.35, 40.6, 0.78),
}
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
        "drive": "no-lateral-flux",
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
        "probe_offsets": [0.2, 0.1] if mode == "bump" else [],
        "probe_steps": [1.2, 1.1] if mode == "bump" else [],
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


def flow_table(arrays: list[tuple[float, float, int]]) -> pd.DataFrame:
    """`flows` of arrays of radius, gap and periodicity."""
    return pd.DataFrame(
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
