"""Tables of made-up validation cases, an accuracy study and a stability sweep."""

import pandas as pd

from dldsim.tables.registry import COLUMNS


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
                    "processor_time_s": time,
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
            "reference_start": "settled",
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
            "check_start": "settled, release",
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


def validation_table() -> pd.DataFrame:
    """Three cases of four quantities, two variants, parameters and resolutions each."""
    return pd.DataFrame(
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
