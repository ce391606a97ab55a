"""Regressors of the migration angle.

All work on the features of :mod:`dldsim.analysis.features`. The source's form has the deformation
index where the others have the capillary number: `by_index`.
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.special import logit

from dldsim.analysis.features import COLUMN, SHAPES, angle_of, share_of

SURROGATE = "bounded XGBoost"
CURVE = "two-limit curve"
BASELINE = "critical diameter rule"
ON_INDEX = " on DI"
"""How the name of a regressor in the source's form ends."""
NEGLIGIBLE = 1e-10
"""A term of less variance in standardised inputs is constant but for rounding."""
ETA = (-30.0, 5.0)
"""Beyond these the share is 0 or 1 in double precision."""
TYPICAL_ROWS = 8
OWN_LAW = 3.0
"""Ridge on a shape's own correction of the law over that on the common one."""
LEAST_SHARE = 1e-4
"""Shares nearer to 0 or 1 start the trees from there: the logarithm of the odds must be finite."""


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
        return np.where(x[:, 0] > 0, x[:, COLUMN["bump_angle_deg"]], 0.0)


class TwoLimitCurve(_Settable):
    """Share of the bump displacement s = 1 − exp(−exp η), with η linear in a few terms.

    η holds x = ln 2R/D_c, the law of rigid spheres; what may be wrong with the law's exponent and
    prefactor: ln N_p, ln P_r/R and their product; and for each cell shape an offset, another slope
    in x, the deformability c = ln Ca (or the deformation index) and its square, since the critical
    gap is least at some Ca, the vertical confinement 2R/height, and what differs from the common
    law's correction, held more firmly. Below the transition s dies out gradually (mixed motion),
    above it the bump is soon complete, hence this link and not the symmetric logistic one. Least
    squares in degrees with a ridge [deg²] that hardly touches x, holds what belongs to a shape
    lightly (levels of c may lie so close that a slope says nothing beyond them) and the corrections
    by ``penalty``, so that few outcomes give the law and many its correction. The two limits, 0 and
    the bump angle, are kept whatever the data.
    """

    def __init__(self, penalty: float = 3.0):
        self.penalty = penalty

    def terms(self, x: np.ndarray) -> np.ndarray:
        """(n, 4 + 8 · shapes); ln N_p and c from levels that make their slopes comparable."""
        size, rows, pillar = (
            x[:, COLUMN[name]]
            for name in (
                "log_size_over_critical_diameter",
                "log_periodicity",
                "log_pillar_radius_over_cell_radius",
            )
        )
        c = x[:, COLUMN["log_capillary_number"]] - self.middle
        array = np.stack([rows, pillar, (rows - np.log(TYPICAL_ROWS)) * pillar])
        upright = x[:, COLUMN["vertical_confinement"]]
        own = np.stack([np.ones_like(c), size, c, c * c, upright, *array])
        shape = x[:, COLUMN["shape"]] == np.arange(len(SHAPES))[:, None]
        return np.vstack([np.stack([size, *array]), (shape[:, None] * own).reshape(-1, len(x))]).T

    def fit(self, x: np.ndarray, y: np.ndarray) -> "TwoLimitCurve":
        self.middle = float(x[:, COLUMN["log_capillary_number"]].mean())
        terms, rows = self.terms(x), np.exp(x[:, COLUMN["log_periodicity"]])
        self.centre = terms.mean(axis=0)
        design = np.column_stack([np.ones(len(y)), terms - self.centre])
        target, bump = np.clip(share_of(y, rows), 0, 1), x[:, COLUMN["bump_angle_deg"]]
        held = self.penalty
        own = [0.1, 1.0, 1.0, held, held, *[OWN_LAW * held] * 3]
        weights = [0.01, held, held, held, *own * len(SHAPES)]
        ridge = np.diag(np.sqrt([0.0, *weights]))[1:]

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
        return angle_of(self.share(x), np.exp(x[:, COLUMN["log_periodicity"]]))

    def state(self) -> dict[str, Any]:
        """All numbers of a fitted curve; `from_state` is the inverse."""
        return {
            "coefficients": self.coefficients.tolist(),
            "centre": self.centre.tolist(),
            "middle": self.middle,
        }

    @classmethod
    def from_state(cls, state: dict[str, Any]) -> "TwoLimitCurve":
        curve = cls()
        curve.coefficients, curve.centre = (np.array(state[n]) for n in ("coefficients", "centre"))
        curve.middle = state["middle"]
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
        rows = np.exp(x[:, COLUMN["log_periodicity"]])
        matrix = xgboost.DMatrix(
            x, np.clip(share_of(y, rows), 0, 1), base_margin=odds(self.curve.share(x))
        )
        settings = BOOSTING | {"max_depth": self.depth, "seed": self.seed}
        self.booster = xgboost.train(settings, matrix, self.trees)
        return self

    def predict(self, x: np.ndarray) -> np.ndarray:
        rows = np.exp(x[:, COLUMN["log_periodicity"]])
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


class Regressor(NamedTuple):
    """A regressor with the settings to choose from by cross-validation.

    ``by_index``: the source's form, with the deformation index in place of the capillary number.
    """

    prototype: Any
    grid: list[dict[str, Any]]
    by_index: bool = False


def make_regressors(seed: int) -> dict[str, Regressor]:
    """Regressors by name.

    The source paper's six on the angle, the two that know both limits, and the rule that learns
    nothing; the source's best and those two also in the source's form.
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
    found = {
        SURROGATE: Regressor(
            BoundedXGBoost(seed),
            [
                {"penalty": 30, "trees": 5, "depth": 2},
                {"penalty": 3, "trees": 15, "depth": 2},
                {"penalty": 3, "trees": 60, "depth": 2},
                {"penalty": 0.3, "trees": 100, "depth": 3},
                {"penalty": 0.05, "trees": 100, "depth": 3},
            ],
        ),
        CURVE: Regressor(TwoLimitCurve(), [{"penalty": p} for p in (30, 3, 0.3, 0.05)]),
        "XGBoost": Regressor(
            boosted, [{"n_estimators": n, "max_depth": d} for n, d in ((60, 2), (60, 4), (150, 4))]
        ),
        "SVR with feature selection": Regressor(
            TransformedTargetRegressor(support_vectors, transformer=StandardScaler()),
            [{"regressor__svr__C": c} for c in (1, 10, 100)],
        ),
        "random forest": Regressor(
            RandomForestRegressor(30, random_state=seed, n_jobs=1),
            [{"min_samples_leaf": n} for n in (1, 3)],
        ),
        "polynomial ridge": Regressor(
            polynomial, [{"ridge__alpha": a} for a in (0.01, 0.1, 1, 10, 100)]
        ),
        "elastic net": Regressor(
            make_pipeline(StandardScaler(), ElasticNet(max_iter=100_000)),
            [{"elasticnet__alpha": a} for a in (0.001, 0.01, 0.1)],
        ),
        "linear": Regressor(make_pipeline(StandardScaler(), LinearRegression()), [{}]),
        BASELINE: Regressor(CriticalDiameterRule(), [{}]),
    }
    by_index = {
        n + ON_INDEX: found[n]._replace(by_index=True) for n in (SURROGATE, CURVE, "XGBoost")
    }
    return found | by_index
