"""Regressors of the migration angle, their features, and what they score on unseen outcomes.

Lengths enter as ratios to the cell radius R (Stokes similarity: only ratios matter), so that
outcomes of one radius serve another. Channel height, velocity and cell shape are no inputs:
outcomes must share them, and a prediction for another radius assumes height/R and the capillary
number unchanged.
"""

import copy
from collections.abc import Collection, Iterator
from time import perf_counter
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import least_squares
from scipy.special import logit

from dldsim.errors import DldsimError
from dldsim.laws import critical_diameter
from dldsim.vocabulary import DECIDED, GEOMETRY

FEATURES = [
    "log_size_over_critical_diameter",
    "log_confinement",
    "log_periodicity",
    "log_pillar_radius_over_cell_radius",
    "log_gap_over_pillar_diameter",
    "deformation_index",
    "bump_angle_deg",
]
INPUTS = [*GEOMETRY, "deformation_index", "cell_radius_um"]
ANGLE = "migration_angle_deg"
CONDITIONS = ["cell_shape", "height_um", "mean_velocity_mm_s"]
"""Columns of `outcomes` that change the angle but are no features: one value each."""

SURROGATE = "bounded XGBoost"
CURVE = "two-limit curve"
BASELINE = "critical diameter rule"
SPLITS = ("random", "geometry", "stiffness")
FOLDS, REPEATS, INNER_FOLDS = 5, 2, 3
NEGLIGIBLE = 1e-10
"""A term of less variance in standardised inputs is constant but for rounding."""
CURVE_REPEATS, CURVE_SIZES, CURVE_HELD_OUT = 10, 7, 0.2
CURVE_MODELS = (SURROGATE, "XGBoost", CURVE, BASELINE)
ETA = (-30.0, 5.0)
"""Beyond these the share is 0 or 1 in double precision."""
INDEX_SCALE, TYPICAL_ROWS = 0.05, 8
LEAST_SHARE = 1e-4
"""Shares nearer to 0 or 1 start the trees from there: the logarithm of the odds must be finite."""


def features(pillar_radius_um, gap_um, periodicity, deformation_index, cell_radius_um):
    """Features of outcomes, shape (n, len(FEATURES)); the arguments are broadcast to one length.

    Size over critical diameter is 2R/D_c with the largest radius R of the cell at rest, confinement
    2R/P_g. Another measure of size, of a cell of the same shape, only shifts the logarithm.
    Raises DldsimError for lengths that are not positive or values that are not finite.
    """
    columns = np.broadcast_arrays(
        *(
            np.atleast_1d(np.asarray(v, float))
            for v in (pillar_radius_um, gap_um, periodicity, deformation_index, cell_radius_um)
        )
    )
    if not all(np.isfinite(c).all() for c in columns):
        raise DldsimError(f"Surrogate: {', '.join(INPUTS)} must be finite numbers.")
    radius, gap, rows, index, cell = columns
    for name, values in zip(INPUTS, columns, strict=True):
        if name != "deformation_index" and (values <= 0).any():
            raise DldsimError(f"Surrogate: {name} must be positive, got {values.min():g}.")
    return np.column_stack(
        [
            np.log(2 * cell / critical_diameter(gap, 1 / rows)),
            np.log(2 * cell / gap),
            np.log(rows),
            np.log(radius / cell),
            np.log(gap / (2 * radius)),
            index,
            np.degrees(np.arctan(1 / rows)),
        ]
    )


def share_of(angle_deg, periodicity) -> np.ndarray:
    """Share of the bump displacement, tan(θ) N_p: 0 zigzag, 1 bump."""
    return np.tan(np.radians(angle_deg)) * periodicity


def angle_of(share, periodicity) -> np.ndarray:
    """Angle [deg] of a share of the bump displacement, the inverse of `share_of`."""
    return np.degrees(np.arctan(np.asarray(share) / periodicity))


def learnable(outcomes: pd.DataFrame) -> pd.DataFrame:
    """Outcomes with an angle and a deformation index, in a fixed order; undecided ones included.

    Raises DldsimError for missing columns, too few usable outcomes, or mixed conditions.
    """
    needed = ["outcome_id", *INPUTS, ANGLE, "status"]
    missing = [name for name in needed if name not in outcomes]
    if missing:
        raise DldsimError(f"Surrogate: the table of outcomes lacks {', '.join(missing)}.")
    data = outcomes.dropna(subset=[*INPUTS, ANGLE])
    data = data.sort_values("outcome_id").reset_index(drop=True)
    if data.groupby(GEOMETRY).ngroups < 3 or data[ANGLE].nunique() < 2:
        causes = ", ".join(
            f"{int(outcomes[n].isna().sum())} without {n}" for n in (ANGLE, "deformation_index")
        )
        raise DldsimError(
            f"Surrogate: {len(data)} of {len(outcomes)} outcomes are usable ({causes}); at least "
            "three geometries with different angles are needed. Widen the sweep, or see why the "
            "others failed (columns status and stop_reason)."
        )
    mixed = [name for name in CONDITIONS if name in data and data[name].nunique() > 1]
    if mixed:
        raise DldsimError(
            f"Surrogate: the outcomes differ in {', '.join(mixed)}, which the surrogate does not "
            "know. Fit one surrogate per condition."
        )
    return data


def inputs_and_angles(data: pd.DataFrame) -> tuple[np.ndarray, np.ndarray]:
    """Features (n, len(FEATURES)) and angles [deg] (n,) of learnable outcomes."""
    return features(*(data[name] for name in INPUTS)), data[ANGLE].to_numpy(float)


# -------------------------------------------------------------------------------------- regressors


class _Settable:
    def set_params(self, **settings) -> "_Settable":
        self.__dict__.update(settings)
        return self


class CriticalDiameterRule(_Settable):
    """Baseline that learns nothing: a cell whose diameter 2R exceeds D_c bumps, any other does not.

    2R is the largest diameter at rest, so that flat or soft cells are expected to be overrated.
    """

    def fit(self, x: np.ndarray, y: np.ndarray) -> "CriticalDiameterRule":
        return self

    def predict(self, x: np.ndarray) -> np.ndarray:
        return np.where(x[:, 0] > 0, x[:, FEATURES.index("bump_angle_deg")], 0.0)


class TwoLimitCurve(_Settable):
    """Share of the bump displacement s = 1 − exp(−exp η), with η linear in five terms.

    η holds x = ln 2R/D_c, the law of rigid spheres; DI, which moves the transition; and what may be
    wrong with the law's exponent and prefactor: ln N_p, ln P_r/R and their product. Below the
    transition s dies out gradually (mixed motion), above it the bump is soon complete, hence this
    link and not the symmetric logistic one. Least squares in degrees with a ridge [deg²] that
    hardly touches x, holds DI lightly (its levels may lie so close that a slope says nothing beyond
    them) and the corrections by ``penalty``, so that few outcomes give the law and many
    its correction.
    The two limits, 0 and the bump angle, are kept whatever the data.
    """

    def __init__(self, penalty: float = 3.0):
        self.penalty = penalty

    @staticmethod
    def terms(x: np.ndarray) -> np.ndarray:
        """(n, 5); DI and ln N_p in units and from a level that make their slopes comparable."""
        size, _, rows, pillar, _, index, _ = x.T
        return np.column_stack(
            [size, index / INDEX_SCALE, rows, pillar, (rows - np.log(TYPICAL_ROWS)) * pillar]
        )

    def fit(self, x: np.ndarray, y: np.ndarray) -> "TwoLimitCurve":
        terms, rows = self.terms(x), np.exp(x[:, FEATURES.index("log_periodicity")])
        self.centre = terms.mean(axis=0)
        design = np.column_stack([np.ones(len(y)), terms - self.centre])
        target, bump = np.clip(share_of(y, rows), 0, 1), x[:, FEATURES.index("bump_angle_deg")]
        ridge = np.diag(np.sqrt([0, 0.01, 0.1, self.penalty, self.penalty, self.penalty]))[1:]

        def misfit(b: np.ndarray) -> np.ndarray:
            return np.r_[bump * (_gompertz(design @ b) - target), ridge @ b]

        def slope(b: np.ndarray) -> np.ndarray:
            eta = np.clip(design @ b, *ETA)
            return np.vstack([(bump * np.exp(eta - np.exp(eta)))[:, None] * design, ridge])

        start = np.r_[-1.0, 3.0, np.zeros(terms.shape[1] - 1)]
        self.coefficients = least_squares(misfit, start, slope).x
        return self

    def share(self, x: np.ndarray) -> np.ndarray:
        """Predicted share of the bump displacement, 0 to 1, shape (n,)."""
        terms = self.terms(x) - self.centre
        return _gompertz(self.coefficients[0] + terms @ self.coefficients[1:])

    def predict(self, x: np.ndarray) -> np.ndarray:
        return angle_of(self.share(x), np.exp(x[:, FEATURES.index("log_periodicity")]))

    def state(self) -> dict[str, list[float]]:
        """All numbers of a fitted curve; `from_state` is the inverse."""
        return {"coefficients": self.coefficients.tolist(), "centre": self.centre.tolist()}

    @classmethod
    def from_state(cls, state: dict[str, list[float]]) -> "TwoLimitCurve":
        curve = cls()
        curve.coefficients, curve.centre = (np.array(state[n]) for n in ("coefficients", "centre"))
        return curve


def _gompertz(eta: np.ndarray) -> np.ndarray:
    """1 − exp(−exp η), the inverse of the complementary log-log link."""
    return -np.expm1(-np.exp(np.clip(eta, *ETA)))


def odds(share: np.ndarray) -> np.ndarray:
    """Logarithm of the odds of a share, where the trees of `BoundedXGBoost` start."""
    return logit(np.clip(share, LEAST_SHARE, 1 - LEAST_SHARE))


class BoundedXGBoost(_Settable):
    """A `TwoLimitCurve`, and boosted trees that learn what it leaves over.

    The trees add to the logarithm of the odds of the curve's share (XGBoost's logistic objective
    with the curve as base margin), so that no prediction leaves the range from 0 to the bump angle.
    """

    def __init__(self, seed: int, penalty: float = 3.0, trees: int = 60, depth: int = 2):
        self.seed, self.penalty, self.trees, self.depth = seed, penalty, trees, depth

    def fit(self, x: np.ndarray, y: np.ndarray) -> "BoundedXGBoost":
        import xgboost

        self.curve = TwoLimitCurve(self.penalty).fit(x, y)
        rows = np.exp(x[:, FEATURES.index("log_periodicity")])
        matrix = xgboost.DMatrix(
            x, np.clip(share_of(y, rows), 0, 1), base_margin=odds(self.curve.share(x))
        )
        settings = BOOSTING | {"max_depth": self.depth, "seed": self.seed}
        self.booster = xgboost.train(settings, matrix, self.trees)
        return self

    def predict(self, x: np.ndarray) -> np.ndarray:
        rows = np.exp(x[:, FEATURES.index("log_periodicity")])
        return angle_of(bounded_share(self.booster, self.curve, x), rows)


BOOSTING = {
    "objective": "reg:logistic",
    "base_score": 0.5,
    "eta": 0.05,
    "subsample": 0.8,
    "colsample_bytree": 0.8,
    "min_child_weight": 0.2,
    "lambda": 1.0,
    "nthread": 1,
    "verbosity": 0,
}


def bounded_share(booster, curve: TwoLimitCurve, x: np.ndarray) -> np.ndarray:
    """Share of the bump displacement after trees and curve, 0 to 1, shape (n,)."""
    found = booster.inplace_predict(x, base_margin=odds(curve.share(x)), validate_features=False)
    return np.asarray(found, float)


def make_regressors(seed: int) -> dict[str, tuple[Any, list[dict[str, Any]]]]:
    """Regressors by name, each with the settings to choose from by cross-validation.

    The source paper's six on the angle, the two that know both limits, and the rule that learns
    nothing.
    """
    from sklearn.compose import TransformedTargetRegressor
    from sklearn.ensemble import ExtraTreesRegressor, RandomForestRegressor
    from sklearn.feature_selection import SelectFromModel, VarianceThreshold
    from sklearn.linear_model import ElasticNet, LinearRegression, Ridge
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import PolynomialFeatures, StandardScaler
    from sklearn.svm import SVR
    from xgboost import XGBRegressor

    importance = ExtraTreesRegressor(10, random_state=seed, n_jobs=1)
    support_vectors = make_pipeline(
        StandardScaler(), SelectFromModel(importance, threshold="0.1*mean"), SVR(epsilon=0.02)
    )
    boosted = XGBRegressor(
        learning_rate=0.1,
        subsample=0.8,
        colsample_bytree=0.8,
        n_jobs=1,
        verbosity=0,
        random_state=seed,
    )
    polynomial = make_pipeline(
        StandardScaler(),
        PolynomialFeatures(2, include_bias=False),
        VarianceThreshold(NEGLIGIBLE),
        StandardScaler(),
        Ridge(),
    )
    return {
        SURROGATE: (
            BoundedXGBoost(seed),
            [
                {"penalty": 30, "trees": 5, "depth": 2},
                {"penalty": 3, "trees": 15, "depth": 2},
                {"penalty": 3, "trees": 60, "depth": 2},
                {"penalty": 0.3, "trees": 100, "depth": 3},
            ],
        ),
        CURVE: (TwoLimitCurve(), [{"penalty": p} for p in (30, 3, 0.3)]),
        "XGBoost": (
            boosted,
            [{"n_estimators": n, "max_depth": d} for n, d in ((60, 2), (60, 4), (150, 4))],
        ),
        "SVR with feature selection": (
            TransformedTargetRegressor(support_vectors, transformer=StandardScaler()),
            [{"regressor__svr__C": c} for c in (1, 10, 100)],
        ),
        "random forest": (
            RandomForestRegressor(30, random_state=seed, n_jobs=1),
            [{"min_samples_leaf": n} for n in (1, 3)],
        ),
        "polynomial ridge": (polynomial, [{"ridge__alpha": a} for a in (0.01, 0.1, 1, 10, 100)]),
        "elastic net": (
            make_pipeline(StandardScaler(), ElasticNet(max_iter=100_000)),
            [{"elasticnet__alpha": a} for a in (0.001, 0.01, 0.1)],
        ),
        "linear": (make_pipeline(StandardScaler(), LinearRegression()), [{}]),
        BASELINE: (CriticalDiameterRule(), [{}]),
    }


# -------------------------------------------------------------------------------- cross-validation


def groups_of(data: pd.DataFrame, split: str) -> np.ndarray:
    """What is kept together in a fold: rows by themselves, whole geometries, or stiffness sets."""
    if split == "random":
        return np.arange(len(data))
    keys = GEOMETRY if split == "geometry" else ["stiffness_set"]
    return data.groupby(keys).ngroup().to_numpy()


def folds_of(groups: np.ndarray, count: int, seed: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Train and test rows of up to `count` shuffled folds that keep groups together."""
    from sklearn.model_selection import GroupKFold

    folds = GroupKFold(min(count, len(np.unique(groups))), shuffle=True, random_state=seed)
    yield from folds.split(groups, groups=groups)


def tune(
    prototype, grid: list[dict], x: np.ndarray, y: np.ndarray, groups: np.ndarray, seed: int
) -> tuple[Any, np.ndarray]:
    """The prototype with the best settings of the grid, unfitted, and its held-out predictions.

    Least squared error over folds that keep groups together. Without choice or with one group the
    first settings are taken, and the predictions are NaN.
    """
    held_out = np.full((len(grid), len(y)), np.nan)
    if len(np.unique(groups)) > 1:
        for train, test in folds_of(groups, INNER_FOLDS, seed):
            for i, settings in enumerate(grid):
                model = copy.deepcopy(prototype).set_params(**settings).fit(x[train], y[train])
                held_out[i, test] = model.predict(x[test])
    error = np.nan_to_num(((held_out - y) ** 2).sum(axis=1), nan=0.0)
    best = int(np.argmin(error))
    return copy.deepcopy(prototype).set_params(**grid[best]), held_out[best]


def cross_validate(
    data: pd.DataFrame, regressors: dict[str, tuple[Any, list[dict]]], split: str, seed: int
) -> tuple[list[dict[str, Any]], list[pd.DataFrame]]:
    """Nested cross-validation: rows of `benchmark` and parts of `predictions`.

    Settings are chosen within the training rows, over folds of the same kind as the outer ones.
    """
    x, y = inputs_and_angles(data)
    groups = groups_of(data, split)
    decided = data["status"].isin(DECIDED).to_numpy()
    scores, predictions = [], []
    folds = [
        (repeat, *fold)
        for repeat in range(REPEATS)
        for fold in folds_of(groups, FOLDS, seed + repeat)
    ]
    if split == "stiffness":
        folds = folds[: len(folds) // REPEATS]  # few sets: the folds of a repeat are the same
    for number, (repeat, train, test) in enumerate(folds):
        for name, (prototype, grid) in regressors.items():
            regressor = copy.deepcopy(prototype).set_params(**grid[0])
            if len(grid) > 1:
                regressor, _ = tune(prototype, grid, x[train], y[train], groups[train], seed)
            start = perf_counter()
            regressor.fit(x[train], y[train])
            fitted = perf_counter()
            predicted = np.asarray(regressor.predict(x[test]), float)
            done = perf_counter()
            error = predicted - y[test]
            spread = np.sum((y[test] - y[test].mean()) ** 2)
            mse = np.mean(error**2)
            scores.append(
                {
                    "model": name,
                    "split": split,
                    "repeat": repeat,
                    "fold": number,
                    "n_train": len(train),
                    "n_test": len(test),
                    "mse_deg2": mse,
                    "rmse_deg": np.sqrt(mse),
                    "mae_deg": np.mean(np.abs(error)),
                    "r2": 1 - np.sum(error**2) / spread if spread > 0 else np.nan,
                    "fit_time_s": fitted - start,
                    "predict_time_s": done - fitted,
                }
            )
            predictions.append(
                pd.DataFrame(
                    {
                        "outcome_id": data["outcome_id"].to_numpy()[test],
                        "model": name,
                        "split": split,
                        "repeat": repeat,
                        "fold": number,
                        "observed_deg": y[test],
                        "predicted_deg": predicted,
                        "decided": decided[test],
                    }
                )
            )
    return scores, predictions


def benchmark(
    outcomes: pd.DataFrame, seed: int, names: Collection[str] | None = None
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Scores per fold and held-out predictions [deg] of all regressors, or of those named.

    Tables of kinds `benchmark` and `predictions`. Two repeats of five folds over rows (`random`,
    the source paper's way, which leaves other stiffness sets of the same array in the training
    data) and over whole geometries (`geometry`, what a designer needs), and one over stiffness sets
    (`stiffness`, cells of a deformability never seen), where there are several. Settings are chosen
    within the training rows. Same seed, same numbers, times apart.

    Raises DldsimError as `learnable` does.
    """
    data = learnable(outcomes)
    regressors = {n: r for n, r in make_regressors(seed).items() if names is None or n in names}
    scores, predictions = [], []
    for split in SPLITS:
        if split == "stiffness" and data.get("stiffness_set", pd.Series(dtype=str)).nunique() < 2:
            continue
        found = cross_validate(data, regressors, split, seed)
        scores += found[0]
        predictions += found[1]
    return pd.DataFrame(scores), pd.concat(predictions, ignore_index=True)


def learning_curve(outcomes: pd.DataFrame, seed: int) -> pd.DataFrame:
    """Error [deg] on unseen arrays against the outcomes learnt from; kind `learning_curve`.

    In each of ten repeats a fifth of the arrays is held out; the others are learnt from in growing,
    nested numbers from three arrays on, with the middle settings. A row also says what its training
    outcomes cost to simulate.

    Raises DldsimError as `benchmark` does.
    """
    data = learnable(outcomes)
    group = groups_of(data, "geometry")
    x, y = inputs_and_angles(data)
    cost = data["wall_time_s"].to_numpy(float) if "wall_time_s" in data else np.full(len(y), np.nan)
    arrays = group.max() + 1
    held_out = max(1, min(round(CURVE_HELD_OUT * arrays), arrays - 2))
    sizes = np.geomspace(min(3, arrays - held_out), arrays - held_out, CURVE_SIZES)
    rng = np.random.default_rng(seed)
    rows = []
    for repeat in range(CURVE_REPEATS):
        order = rng.permutation(arrays)
        test = np.isin(group, order[:held_out])
        regressors = make_regressors(seed + repeat)
        for size in np.unique(sizes.round().astype(int)):
            train = np.isin(group, order[held_out : held_out + size])
            for name in CURVE_MODELS:
                prototype, grid = regressors[name]
                regressor = copy.deepcopy(prototype).set_params(**grid[len(grid) // 2])
                start = perf_counter()
                regressor.fit(x[train], y[train])
                fitted = perf_counter() - start
                error = np.asarray(regressor.predict(x[test]), float) - y[test]
                rows.append(
                    {
                        "model": name,
                        "repeat": repeat,
                        "geometries": int(size),
                        "outcomes": int(train.sum()),
                        "n_test": int(test.sum()),
                        "rmse_deg": np.sqrt(np.mean(error**2)),
                        "mae_deg": np.mean(np.abs(error)),
                        "fit_time_s": fitted,
                        "simulation_time_s": cost[train].sum(),
                    }
                )
    return pd.DataFrame(rows)


def pooled(predictions: pd.DataFrame) -> dict[str, float | int | None]:
    """Scores over all held-out predictions together; R² is null where all observations agree."""
    error = (predictions["predicted_deg"] - predictions["observed_deg"]).to_numpy(float)
    observed = predictions["observed_deg"].to_numpy(float)
    spread = np.sum((observed - observed.mean()) ** 2)
    return {
        "rmse_deg": float(np.sqrt(np.mean(error**2))),
        "mae_deg": float(np.mean(np.abs(error))),
        "median_absolute_error_deg": float(np.median(np.abs(error))),
        "r2": float(1 - np.sum(error**2) / spread) if spread > 0 else None,
        "predictions": len(error),
    }
