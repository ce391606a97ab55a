"""Tables of made-up analyses of outcomes: variance, sensitivity, robustness, benchmark."""

import numpy as np
import pandas as pd

from dldsim.report import style

FACTORS = ["pillar_radius_um", "gap_um", "periodicity", "deformation_index"]


def anova_tables() -> dict[str, pd.DataFrame]:
    """Terms of three models, and what their residuals are tested for."""
    terms = [*FACTORS, *(f"deformation_index:{name}" for name in FACTORS[:3])]
    anova = pd.DataFrame(
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
    diagnostics = pd.DataFrame(
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
    return {"anova": anova, "anova_diagnostics": diagnostics}


def sensitivity_tables(outcomes: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Sobol indices, partial dependence with a gap, and errors of fabrication."""
    sobol = pd.DataFrame(
        [
            {"factor": name, "points": 64, "inside_share": 0.8}
            | {
                f"{order}_order{end}": value * (i + 1)
                for order, value in (("first", 0.1), ("total", 0.2))
                for end, value in (("", value), ("_low", 0.9 * value), ("_high", 1.1 * value))
            }
            for i, name in enumerate(FACTORS)
        ]
    )
    dependence = pd.DataFrame(
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
    fabrication = pd.concat(
        [
            outcomes[names].assign(
                radius_error_um=error,
                moved_limit_deg=0.5,
                predicted_angle_deg=2.0,
                predicted_mode="bump",
                simulated_mode=outcomes["mode"],
                mode_change_probability=error / 2,
                moved_probability=0.3,
                angle_std_deg=0.4,
                inside_share=0.4 if error > 0.5 else 0.9,
            )
            for error in (0.25, 1.0)
        ]
    )
    return {"sobol": sobol, "partial_dependence": dependence, "fabrication": fabrication}


def robustness_table(outcomes: pd.DataFrame) -> pd.DataFrame:
    """Arrays of outcomes, the second of them robust."""
    mean = (
        outcomes.groupby(["pillar_radius_um", "gap_um", "periodicity"])["migration_angle_deg"]
        .mean()
        .reset_index()
    )
    return mean.rename(columns={"migration_angle_deg": "mean_migration_angle_deg"}).assign(
        robustness_score_deg2=lambda t: 0.2 * 1.7 ** np.arange(len(t)),
        neighbours=3,
        robust=lambda t: np.arange(len(t)) == 1,
        modes="bump 2, zigzag 1",
    )


def benchmark_tables(outcomes: pd.DataFrame, rng: np.random.Generator) -> dict[str, pd.DataFrame]:
    """Folds of four models in three splits, and the predictions of each."""
    learnt = style.measured(outcomes)
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
    return {"benchmark": pd.DataFrame(benchmark), "predictions": pd.DataFrame(predictions)}
