"""Made-up tables of a design search and its verification."""

import numpy as np
import pandas as pd

GEOMETRY = ("pillar_radius_um", "gap_um", "periodicity")


def make_design_tables(request: str, folder=None) -> dict[str, pd.DataFrame]:
    """One request: four candidates, sixty trials, two verified designs of which one is stuck."""
    rng = np.random.default_rng(4)
    designs = pd.DataFrame(
        [
            {
                "request": request,
                "design": i + 1,
                "rank": i + 1,
                "pillar_radius_um": 6.0 + i,
                "gap_um": 14.3 + i,
                "periodicity": 8,
                "objective": "robust",
                "value": 2.0 - 0.3 * i,
                "separation_deg": 4.0 - 0.8 * i,
                "angle_1_deg": 1.0,
                "angle_2_deg": 5.0 - 0.8 * i,
                "angle_1_low_deg": 0.2,
                "angle_1_high_deg": 1.9,
                "angle_2_low_deg": 3.1 - 0.8 * i,
                "angle_2_high_deg": 6.4 - 0.8 * i,
                "mode_1": "zigzag",
                "mode_2": "mixed",
                "separation_tolerance_min_deg": 2.5 - 0.7 * i,
                "separation_tolerance_max_deg": 4.4 - 0.8 * i,
                "robust_separation_deg": 2.0 - 0.3 * i,
                "mode_change_probability": 0.25,
                "uncertainty_deg": 1.7,
                "sigma_num_deg": 0.3 if i else None,
                "length_mm": 1.4,
                "pressure_drop_kPa": 0.2,
                "pressure_basis": "interpolated",
                "throughput_uL_per_h": 72.0,
                "verdict": "resolved" if i < 3 else "not resolved: separation below uncertainty",
                "notes": ["extrapolated: outside the training geometries"] * (i == 1),
                "inside_training_domain": i != 1,
                "mode_open": i == 2,
            }
            for i in range(4)
        ]
    )
    trials = pd.DataFrame(
        {
            "request": request,
            "trial": np.arange(60),
            "pillar_radius_um": rng.uniform(5, 9, 60),
            "gap_um": rng.uniform(12, 20, 60),
            "periodicity": rng.integers(4, 13, 60),
            "feasible": np.arange(60) % 5 != 0,
        }
    )
    value = np.where(trials["feasible"], 4 * (1 - np.exp(-np.arange(60) / 15)), np.nan)
    trials = trials.assign(
        angle_1_deg=value * 0,
        angle_2_deg=value,
        separation_deg=value,
        value=value,
        reason=np.where(trials["feasible"], "", "gap below P_r + 2 µm"),
    )
    tolerances = pd.DataFrame(
        [
            {
                "request": request,
                "design": 1,
                "parameter": name,
                "offset": offset,
                "angle_1_deg": 1.0,
                "angle_2_deg": 5.0 + offset,
                "separation_deg": 4.0 + offset,
                "mode_1": "zigzag",
                "mode_2": "mixed",
                "sensitivity_deg_per_unit": 1.0,
            }
            for name in ("pillar_radius_um", "gap_um", "edge_um")
            for offset in (-0.5, 0.5)
        ]
    )
    importance = pd.DataFrame(
        {
            "request": request,
            "parameter": GEOMETRY,
            "importance": [0.2, 0.1, 0.7],
            "evaluator": "PED-ANOVA",
        }
    )
    x, y = (v.ravel() for v in np.meshgrid(np.linspace(5, 9, 5), np.linspace(12, 20, 5)))
    slices = pd.concat(
        [
            pd.DataFrame(
                {
                    "request": request,
                    "x_parameter": a,
                    "y_parameter": b,
                    "x": x,
                    "y": y,
                    "difference_deg": x - 7,
                    "feasible": y > 13,
                    "inside_training_domain": x < 9,
                }
            )
            for a, b in (("pillar_radius_um", "gap_um"), ("periodicity", "gap_um"))
        ],
        ignore_index=True,
    )
    refused = pd.DataFrame(
        {
            "request": [request, "dead"],
            "status": ["answered", "failed"],
            "reason": ["", "no <range> left"],
        }
    )
    return {
        "design_requests": refused,
        "verified_requests": refused,
        "design_populations": make_cell_types(request),
        "designs": designs,
        "design_trials": trials,
        "design_tolerances": tolerances,
        "design_importance": importance,
        "design_slices": slices,
        "verifications": make_verifications(request),
        "verified_designs": make_verified(request),
    }


def make_cell_types(request: str) -> pd.DataFrame:
    """A disc by an index, a bead; the assay tells nothing of the latter."""
    common = {
        "request": request,
        "height_um": 20.0,
        "mean_velocity_mm_s": 0.5,
        "narrowest_width_um": 6.6,
        "narrowest_width_basis": "width in the assay",
        "told_apart": False,
        "doubt": "The assay mine does not tell the two cell types apart.",
    }
    disc = {
        "population": "1",
        "cell_shape": "biconcave",
        "cell_radius_um": 5.0,
        "rigid": False,
        "assay": "mine",
        "deformation_index": 0.7,
        "deformation_index_std": 0.02,
        "ks_uN_per_m": 10.0,
        "ks_low_uN_per_m": 8.0,
        "ks_high_uN_per_m": 14.0,
        "capillary_number": 0.075,
        "capillary_number_low": 0.054,
        "capillary_number_high": 0.094,
        "stiffness_basis": "inverse of the calibration mine",
    }
    bead = {
        "population": "2",
        "cell_shape": "sphere",
        "cell_radius_um": 9.0,
        "rigid": True,
        "assay": "",
        "deformation_index": None,
        "deformation_index_std": 0.0,
        **dict.fromkeys(("ks_uN_per_m", "ks_low_uN_per_m", "ks_high_uN_per_m"), 75.0),
        **dict.fromkeys([f"capillary_number{end}" for end in ("", "_low", "_high")], 0.01),
        "stiffness_basis": "bead",
    }
    return pd.DataFrame([common | disc, common | bead])


def make_verifications(request: str) -> pd.DataFrame:
    """Rounds 1 and 2: a design that is confirmed, one that is stuck, one missed, finer, height."""
    arrays = [
        (1, "design", 1, 20.0, 3.0),
        (1, "transition", 2, 20.0, 9.0),
        (2, "design", 3, 20.0, None),
        (1, "finer", 1, 20.0, 2.8),
        (1, "height", 1, 19.0, 2.5),
    ]
    rows = []
    for number, role, array, height, simulated in arrays:
        for population in ("1", "2", "difference"):
            first = population == "1"
            value = None if simulated is None else (1.0 if first else simulated)
            compared = value is not None and role not in ("height", "finer")
            agrees = abs(value - 4.0) < 3.5 if compared else None
            rows.append(
                {
                    "request": request,
                    "round": number,
                    "role": role,
                    "array": array,
                    "population": population,
                    "pillar_radius_um": 6.0 + array,
                    "gap_um": 14.3,
                    "periodicity": 8,
                    "height_um": height,
                    "outcome_id": f"r{array}_s{population}",
                    "mean_velocity_mm_s": 0.5,
                    "cell_shape": None if population == "difference" else "biconcave",
                    "cell_radius_um": 7.5,
                    "deformation_index": 0.7,
                    "ks_uN_per_m": 5.1,
                    "capillary_number": 0.147,
                    "stiffness_basis": "stiffness set 1",
                    "predicted_deg": 4.0,
                    "predicted_low_deg": 0.5,
                    "predicted_high_deg": 7.5,
                    "simulated_deg": value,
                    "sigma_num_deg": None if first else 0.3,
                    "predicted_mode": "mixed",
                    "mode": "none" if value is None else "mixed",
                    "status": "stuck" if value is None else "decided",
                    "wall_time_s": 3.0,
                    "agrees": agrees,
                    "verdict": "prediction confirmed" if agrees else "other",
                    "note": "" if value else "the cell stopped",
                }
            )
    return pd.DataFrame(rows).astype({"agrees": "boolean"})


def make_verified(request: str) -> pd.DataFrame:
    """The confirmed design and the one that is stuck."""
    known = {
        "separation_deg": 3.0,
        "sigma_num_deg": 0.3,
        "angle_1_deg": 1.0,
        "angle_2_deg": 4.0,
        "separation_low_height_deg": 2.5,
        "separation_high_height_deg": None,
        "length_mm": 1.9,
        "separation_finer_deg": 2.8,
        "finer_spacing_um": 0.85,
        "finer_lag_number": 0.07,
        "pressure_drop_kPa": 0.3,
        "permeability_over_pitch2": 0.012,
    }
    common = {
        "request": request,
        "pillar_radius_um": 7.0,
        "gap_um": 14.3,
        "periodicity": 8,
        "mode_1": "zigzag",
        "mode_2": "mixed",
        "status_1": "decided",
        "status_2": "decided",
        "predicted_separation_deg": 4.0,
        "uncertainty_deg": 3.5,
        "separation_tolerance_min_deg": 2.0,
        "separation_tolerance_max_deg": 4.5,
        "robust_separation_deg": 1.0,
        "mode_change_probability": 0.1,
        "pressure_basis": "flow without a cell",
        "throughput_uL_per_h": 72.0,
        "stop": "rounds",
        "stopped": "2 rounds done",
    }
    rows = [
        {
            **common,
            **known,
            "rank": 1,
            "name": "made-up-1",
            "array": 1,
            "round": 1,
            "agrees": True,
            "separates": True,
            "verdict": "separates by 3.00 ± 0.30°; prediction confirmed",
        },
        {
            **common,
            **dict.fromkeys(known),
            "rank": 2,
            "name": "made-up-2",
            "array": 3,
            "round": 2,
            "agrees": None,
            "separates": None,
            "verdict": "no separation measured",
        },
    ]
    return pd.DataFrame(rows).astype({"agrees": "boolean", "separates": "boolean"})
