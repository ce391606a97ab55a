"""Regressors of the migration angle: comparison, the surrogate, its file and its card.

Lengths enter as ratios to the cell radius R (Stokes similarity: only ratios matter), so that runs
of one radius serve another. Channel height, velocity and cell shape are no inputs: runs must share
them, and a prediction for another radius assumes height/R and the capillary number unchanged.
"""

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from dldsim import PHYSICS_VERSION, __version__
from dldsim.errors import DldsimError
from dldsim.tables import atomic_path
from dldsim.trajectory import mode_of

if TYPE_CHECKING:
    from xgboost import Booster

FEATURES = [
    "pillar_radius_over_cell_radius", "gap_over_cell_radius", "periodicity", "row_shift_fraction",
    "deformation_index", "critical_diameter_over_cell_diameter", "bump_angle_deg",
]
GEOMETRY = ["pillar_radius_um", "gap_um", "periodicity"]
INPUTS = [*GEOMETRY, "deformation_index", "cell_radius_um"]
ANGLE = "migration_angle_deg"
CONDITIONS = ["cell_shape", "height_um", "mean_velocity_mm_s"]
"""Columns of `runs` that change the angle but are no features: one value each."""

KIND = "dldsim surrogate of the migration angle"
SURROGATE = "XGBoost"
BASELINE = "critical diameter rule"
FOLDS, REPEATS = 5, 2
NEGLIGIBLE = 1e-10
"""A term of less variance in standardised inputs is constant but for rounding."""
CURVE_REPEATS, CURVE_SIZES, CURVE_HELD_OUT = 10, 7, 0.2
CURVE_MODELS = (SURROGATE, "polynomial ridge", BASELINE)
DOMAIN_TOLERANCE = 0.02
"""How far outside the training geometries still counts as inside, in units of their range."""

BOOSTING = {
    "n_estimators": 300, "max_depth": 4, "learning_rate": 0.05, "subsample": 0.8,
    "colsample_bytree": 0.8, "n_jobs": 1, "verbosity": 0,
}


def critical_diameter_um(gap_um, periodicity):
    """D_c = 1.4 P_g ε^0.48 of rigid spheres [µm] (Davis's empirical fit; Inglis et al. 2006)."""
    return 1.4 * gap_um * (1 / periodicity) ** 0.48


def features(pillar_radius_um, gap_um, periodicity, deformation_index, cell_radius_um):
    """Features of runs, shape (n, len(FEATURES)); the arguments are broadcast to one length.

    Raises DldsimError for lengths that are not positive or values that are not finite.
    """
    columns = np.broadcast_arrays(
        *(np.atleast_1d(np.asarray(v, float)) for v in (
            pillar_radius_um, gap_um, periodicity, deformation_index, cell_radius_um))
    )
    if not all(np.isfinite(c).all() for c in columns):
        raise DldsimError(f"Surrogate: {', '.join(INPUTS)} must be finite numbers.")
    radius, gap, rows, index, cell = columns
    for name, values in zip(INPUTS, columns, strict=True):
        if name != "deformation_index" and (values <= 0).any():
            raise DldsimError(f"Surrogate: {name} must be positive, got {values.min():g}.")
    return np.column_stack([
        radius / cell, gap / cell, rows, 1 / rows, index,
        critical_diameter_um(gap, rows) / (2 * cell), np.degrees(np.arctan(1 / rows)),
    ])


def _learnable(runs: pd.DataFrame) -> pd.DataFrame:
    """Runs with an angle and a deformation index, in a fixed order; not converged ones included."""
    needed = ["run_id", *INPUTS, ANGLE, "status"]
    missing = [name for name in needed if name not in runs]
    if missing:
        raise DldsimError(f"Surrogate: the table of runs lacks {', '.join(missing)}.")
    data = runs.dropna(subset=[*INPUTS, ANGLE]).sort_values("run_id").reset_index(drop=True)
    if data.groupby(GEOMETRY).ngroups < 3 or data[ANGLE].nunique() < 2:
        causes = ", ".join(
            f"{int(runs[n].isna().sum())} without {n}" for n in (ANGLE, "deformation_index"))
        raise DldsimError(
            f"Surrogate: {len(data)} of {len(runs)} runs are usable ({causes}); at least three "
            "geometries with different angles are needed. Widen the sweep, or see why runs failed "
            "(columns status and stop_reason)."
        )
    mixed = [name for name in CONDITIONS if name in data and data[name].nunique() > 1]
    if mixed:
        raise DldsimError(
            f"Surrogate: the runs differ in {', '.join(mixed)}, which the surrogate does not "
            "know. Fit one surrogate per condition."
        )
    return data


class CriticalDiameterRule:
    """Baseline that learns nothing: a cell whose diameter 2R exceeds D_c bumps, any other does not.

    2R is the largest diameter at rest, so that flat or soft cells are expected to be overrated.
    """

    def fit(self, x: np.ndarray, y: np.ndarray) -> "CriticalDiameterRule":
        return self

    def predict(self, x: np.ndarray) -> np.ndarray:
        ratio = x[:, FEATURES.index("critical_diameter_over_cell_diameter")]
        return np.where(ratio < 1, x[:, FEATURES.index("bump_angle_deg")], 0.0)


def make_regressors(seed: int) -> dict[str, Any]:
    """The six regressors of the source paper with modest fixed settings, and the baseline."""
    from sklearn.compose import TransformedTargetRegressor
    from sklearn.ensemble import ExtraTreesRegressor, RandomForestRegressor
    from sklearn.feature_selection import SelectFromModel, VarianceThreshold
    from sklearn.linear_model import ElasticNet, LinearRegression, RidgeCV
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import PolynomialFeatures, StandardScaler
    from sklearn.svm import SVR
    from xgboost import XGBRegressor

    importance = ExtraTreesRegressor(30, random_state=seed, n_jobs=1)
    support_vectors = make_pipeline(
        StandardScaler(), SelectFromModel(importance, threshold="0.1*mean"),
        SVR(C=10, epsilon=0.02),
    )
    return {
        SURROGATE: XGBRegressor(**BOOSTING, random_state=seed),
        "SVR with feature selection": TransformedTargetRegressor(support_vectors,
                                                                 transformer=StandardScaler()),
        "random forest": RandomForestRegressor(100, random_state=seed, n_jobs=1),
        "polynomial ridge": make_pipeline(
            StandardScaler(), PolynomialFeatures(2, include_bias=False),
            VarianceThreshold(NEGLIGIBLE), StandardScaler(), RidgeCV(np.logspace(-3, 3, 13)),
        ),
        "elastic net": make_pipeline(StandardScaler(), ElasticNet(0.01, max_iter=100_000)),
        "linear": make_pipeline(StandardScaler(), LinearRegression()),
        BASELINE: CriticalDiameterRule(),
    }


def _splits(data: pd.DataFrame, split: str, seed: int):
    """Repeated folds (train, test): of rows, or of whole geometries."""
    from sklearn.model_selection import GroupKFold, KFold

    groups = data.groupby(GEOMETRY).ngroup()
    for repeat in range(REPEATS):
        state = seed + repeat
        if split == "random":
            yield from KFold(min(FOLDS, len(data)), shuffle=True, random_state=state).split(data)
        else:
            folds = GroupKFold(min(FOLDS, groups.nunique()), shuffle=True, random_state=state)
            yield from folds.split(data, groups=groups)


def _cross_validate(
    data: pd.DataFrame, regressors: dict[str, Any], split: str, seed: int
) -> tuple[list[dict[str, Any]], list[pd.DataFrame]]:
    from sklearn.base import clone

    x, y = features(*(data[name] for name in INPUTS)), data[ANGLE].to_numpy(float)
    converged = data["status"].isin(["converged", "periodic"]).to_numpy()
    scores, predictions = [], []
    for fold, (train, test) in enumerate(_splits(data, split, seed)):
        for name, prototype in regressors.items():
            regressor = clone(prototype) if hasattr(prototype, "get_params") else prototype
            start = perf_counter()
            regressor.fit(x[train], y[train])
            fitted = perf_counter()
            predicted = np.asarray(regressor.predict(x[test]), float)
            done = perf_counter()
            error = predicted - y[test]
            spread = np.sum((y[test] - y[test].mean()) ** 2)
            mse = np.mean(error**2)
            scores.append({
                "model": name, "split": split, "fold": fold,
                "n_train": len(train), "n_test": len(test),
                "mse_deg2": mse, "rmse_deg": np.sqrt(mse), "mae_deg": np.mean(np.abs(error)),
                "r2": 1 - np.sum(error**2) / spread if spread > 0 else np.nan,
                "fit_time_s": fitted - start, "predict_time_s": done - fitted,
            })
            predictions.append(pd.DataFrame({
                "run_id": data["run_id"].to_numpy()[test], "model": name, "split": split,
                "fold": fold, "observed_deg": y[test], "predicted_deg": predicted,
                "converged": converged[test],
            }))
    return scores, predictions


def benchmark(runs: pd.DataFrame, seed: int) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Scores per fold and held-out predictions [deg] of all regressors.

    Tables of kinds `benchmark` and `predictions`. Two repeats of five folds, once over rows
    (`random`, the source paper's way, which leaves other stiffness sets of the same array in the
    training data) and once over whole geometries (`geometry`, what a designer needs). Settings are
    fixed beforehand, so no fold has seen its test rows; only the ridge penalty is chosen, within
    the training rows. Same seed, same numbers, times apart.

    Raises DldsimError for missing columns or too few usable runs.
    """
    data = _learnable(runs)
    scores, predictions = [], []
    for split in ("random", "geometry"):
        found = _cross_validate(data, make_regressors(seed), split, seed)
        scores += found[0]
        predictions += found[1]
    return pd.DataFrame(scores), pd.concat(predictions, ignore_index=True)


def learning_curve(runs: pd.DataFrame, seed: int) -> pd.DataFrame:
    """Error [deg] on unseen arrays against the number of runs learnt from; kind `learning_curve`.

    In each of ten repeats a fifth of the arrays is held out; the others are learnt from in growing,
    nested numbers from three arrays on. A row also says what its training runs cost to simulate.

    Raises DldsimError as `benchmark` does.
    """
    data = _learnable(runs)
    group = data.groupby(GEOMETRY).ngroup().to_numpy()
    x, y = features(*(data[name] for name in INPUTS)), data[ANGLE].to_numpy(float)
    cost = data["wall_time_s"].to_numpy(float) if "wall_time_s" in data else np.full(len(y), np.nan)
    arrays = group.max() + 1
    held_out = max(1, min(round(CURVE_HELD_OUT * arrays), arrays - 2))
    sizes = np.geomspace(min(3, arrays - held_out), arrays - held_out, CURVE_SIZES)
    rng = np.random.default_rng(seed)
    rows = []
    for repeat in range(CURVE_REPEATS):
        order = rng.permutation(arrays)
        test = np.isin(group, order[:held_out])
        for size in np.unique(sizes.round().astype(int)):
            train = np.isin(group, order[held_out : held_out + size])
            regressors = make_regressors(seed + repeat)
            for name in CURVE_MODELS:
                start = perf_counter()
                regressors[name].fit(x[train], y[train])
                fitted = perf_counter() - start
                error = np.asarray(regressors[name].predict(x[test]), float) - y[test]
                rows.append({
                    "model": name, "repeat": repeat, "geometries": int(size),
                    "runs": int(train.sum()), "n_test": int(test.sum()),
                    "rmse_deg": np.sqrt(np.mean(error**2)), "mae_deg": np.mean(np.abs(error)),
                    "fit_time_s": fitted, "simulation_time_s": cost[train].sum(),
                })
    return pd.DataFrame(rows)


@dataclass
class Surrogate:
    """The regressor that designs are searched on, with the card that says what it is."""

    booster: "Booster"
    card: dict[str, Any]

    def predict(self, pillar_radius_um, gap_um, periodicity, deformation_index, cell_radius_um):
        """Migration angles [deg], shape (n,); the arguments are broadcast to one length."""
        x = features(pillar_radius_um, gap_um, periodicity, deformation_index, cell_radius_um)
        return np.asarray(self.booster.inplace_predict(x, validate_features=False), float)

    @property
    def deformation_index_range(self) -> tuple[float, float]:
        """Least and largest deformation index of the training data."""
        return tuple(self.card["domain"]["ranges"]["deformation_index"])

    @property
    def rmse_deg(self) -> float:
        """Root mean squared error [deg] on geometries never seen (cross-validated)."""
        return self.card["scores_by_geometry"]["rmse_deg"]

    def sigma_num_deg(self, angle_deg, periodicity) -> np.ndarray | None:
        """Numerical uncertainty [deg] of predicted angles; None if that of the runs is not known.

        That of the training runs in the same mode (bump, mixed or zigzag, after the angle), as a
        share of the bump angle; of a mode without runs, the largest share of any mode.
        """
        shares = self.card["numerical_uncertainty"]["share_by_mode"]
        if not shares:
            return None
        angles, rows = np.broadcast_arrays(np.atleast_1d(angle_deg), np.atleast_1d(periodicity))
        share = [shares.get(mode_of(a, 1 / n), max(shares.values()))
                 for a, n in zip(angles, rows, strict=True)]
        return np.array(share) * np.degrees(np.arctan(1 / rows))

    def may_be_inside(self, pillar_radius_um, gap_um, periodicity, cell_radius_um) -> np.ndarray:
        """False where `distance_outside` surely exceeds DOMAIN_TOLERANCE, (n,); quick.

        By the ranges of the training geometries, and by the plane or line that they may lie in.
        """
        known = np.array(self.card["domain"]["geometries"])
        points = np.column_stack([np.asarray(pillar_radius_um) / cell_radius_um,
                                  np.asarray(gap_um) / cell_radius_um, periodicity])
        span = np.ptp(known, axis=0)
        span[span < 1e-9 * np.abs(known).max(axis=0)] = 1e-6
        off = (points - known.mean(axis=0)) / span
        spread = (known - known.mean(axis=0)) / span
        _, sizes, axes = np.linalg.svd(spread, full_matrices=True)
        flat = axes[np.append(sizes, np.zeros(3 - len(sizes))) < 1e-9]
        reach = (DOMAIN_TOLERANCE + 1e-9) * np.abs(flat).sum(axis=1)
        return (
            (off >= spread.min(axis=0) - DOMAIN_TOLERANCE - 1e-9)
            & (off <= spread.max(axis=0) + DOMAIN_TOLERANCE + 1e-9)
        ).all(axis=1) & (np.abs(off @ flat.T) <= reach).all(axis=1)  # fmt: skip

    def distance_outside(self, pillar_radius_um: float, gap_um: float, periodicity: int,
                         cell_radius_um: float) -> float:
        """How far a geometry lies outside the convex hull of the training geometries.

        In units of the training range of (P_r/R, P_g/R, N_p), largest component; 0 inside. The hull
        tells what ranges do not: runs with gap = radius + 10 µm fill a plane, not a box. A
        parameter that never varied allows no distance at all: then infinity.
        """
        from scipy.optimize import linprog

        known = np.array(self.card["domain"]["geometries"])
        point = np.array([pillar_radius_um / cell_radius_um, gap_um / cell_radius_um, periodicity])
        span = np.ptp(known, axis=0)
        fixed = span < 1e-9 * np.abs(known).max(axis=0)
        if np.any(np.abs(point - known[0])[fixed] > 1e-6 * np.abs(known[0])[fixed]):
            return np.inf
        scaled = ((known - point)[:, ~fixed] / span[~fixed]).T
        if scaled.size == 0:
            return 0.0
        # least t with |Σ w_i (known_i − point)| ≤ t, w ≥ 0, Σ w = 1
        column = np.full((len(scaled), 1), -1.0)
        found = linprog(
            np.r_[np.zeros(len(known)), 1],
            A_ub=np.vstack([np.hstack([scaled, column]), np.hstack([-scaled, column])]),
            b_ub=np.zeros(2 * len(scaled)),
            A_eq=np.r_[np.ones(len(known)), 0][None], b_eq=[1.0],
        )
        return max(0.0, float(found.fun))

    def save(self, path: Path, card_path: Path) -> None:
        """Write the model in XGBoost's own JSON format and its card, each whole or not at all."""
        card = {key: value for key, value in self.card.items() if key != "model_sha256"}
        self.booster.set_attr(card_sha256=_card_hash(card))
        model = bytes(self.booster.save_raw("json"))
        card["model_sha256"] = hashlib.sha256(model).hexdigest()
        text = json.dumps(card, indent=1, allow_nan=False).encode()
        for target, content in ((path, model), (card_path, text)):
            with atomic_path(target) as part:
                part.write_bytes(content)


def fit(runs: pd.DataFrame, seed: int) -> Surrogate:
    """Fit the surrogate to all usable runs; its card holds its cross-validated error by geometry.

    Raises DldsimError as `benchmark` does.
    """
    import xgboost

    data = _learnable(runs)
    regressors = {SURROGATE: make_regressors(seed)[SURROGATE], BASELINE: CriticalDiameterRule()}
    _, held_out = _cross_validate(data, regressors, "geometry", seed)
    scores = {name: _pooled(part) for name, part in pd.concat(held_out).groupby("model")}
    x = features(*(data[name] for name in INPUTS))
    model = regressors[SURROGATE].fit(x, data[ANGLE].to_numpy(float))
    booster = model.get_booster()
    booster.feature_names = FEATURES
    ratios = x[:, [FEATURES.index(n) for n in
                   ("pillar_radius_over_cell_radius", "gap_over_cell_radius", "periodicity")]]
    card = {
        "kind": KIND,
        "response": ANGLE, "features": FEATURES, "seed": int(seed), "settings": BOOSTING,
        "data": {
            "sha256": _data_hash(data), "runs": len(runs), "used": len(data),
            "not_converged": int((~data["status"].isin(["converged", "periodic"])).sum()),
            "geometries": int(data.groupby(GEOMETRY).ngroups),
            "conditions": {n: _plain(data[n].iloc[0]) for n in CONDITIONS if n in data},
        },
        "scores_by_geometry": scores[SURROGATE],
        "baseline_by_geometry": {"model": BASELINE} | scores[BASELINE],
        "numerical_uncertainty": _numerical_uncertainty(data),
        "domain": {
            "ranges": {name: [float(c.min()), float(c.max())]
                       for name, c in zip(FEATURES, x.T, strict=True)},
            "geometries": np.unique(ratios, axis=0).tolist(),
        },
        "versions": {"dldsim": __version__, "physics": PHYSICS_VERSION,
                     "xgboost": xgboost.__version__, "numpy": np.__version__},
    }
    return Surrogate(_serial(booster), card)


def _numerical_uncertainty(data: pd.DataFrame) -> dict[str, Any]:
    """Root mean square of σ_num / bump angle of the runs learnt from, by mode after their angle."""
    if "sigma_num_deg" not in data or data["sigma_num_deg"].isna().all():
        bases = data["sigma_num_basis"].unique().tolist() if "sigma_num_basis" in data else []
        return {"share_by_mode": {}, "runs": 0, "basis": bases}
    known = data[data["sigma_num_deg"].notna()]
    mode = [mode_of(a, 1 / n) for a, n in zip(known[ANGLE], known["periodicity"], strict=True)]
    square = (known["sigma_num_deg"] / np.degrees(np.arctan(1 / known["periodicity"]))) ** 2
    shares = np.sqrt(square.groupby(np.array(mode)).mean())
    return {"share_by_mode": shares.to_dict(), "runs": len(known),
            "basis": sorted(known["sigma_num_basis"].str.partition(":")[0].unique())}


def _serial(booster: "Booster") -> "Booster":
    booster.set_param({"nthread": 1})
    return booster


def _plain(value: Any) -> Any:
    return value.item() if hasattr(value, "item") else value


def _data_hash(data: pd.DataFrame) -> str:
    """SHA-256 over the rows learnt from: inputs, angle and status, in order of run_id."""
    rows = data[["run_id", *INPUTS, ANGLE, "status"]]
    text = rows.astype(dict.fromkeys([*INPUTS, ANGLE], float)).to_csv(index=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _card_hash(card: dict[str, Any]) -> str:
    """SHA-256 of a card without the hash of its model; the model file keeps it."""
    content = {key: value for key, value in card.items() if key != "model_sha256"}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _pooled(predictions: pd.DataFrame) -> dict[str, float | int | None]:
    """Scores over all held-out predictions together."""
    error = (predictions["predicted_deg"] - predictions["observed_deg"]).to_numpy()
    observed = predictions["observed_deg"].to_numpy()
    return {
        "rmse_deg": float(np.sqrt(np.mean(error**2))), "mae_deg": float(np.mean(np.abs(error))),
        "median_absolute_error_deg": float(np.median(np.abs(error))),
        "r2": float(1 - np.sum(error**2) / np.sum((observed - observed.mean()) ** 2)),
        "predictions": len(error),
    }


def load(path: Path, card_path: Path) -> Surrogate:
    """Read a surrogate and check that the card belongs to the model.

    Raises DldsimError if a file is absent, damaged, of another kind, physics version or set of
    features, or if card and model do not match.
    """
    import xgboost

    path, card_path = Path(path), Path(card_path)
    remedy = "Fit it anew: `snakemake -j2 surrogate`."
    for file in (path, card_path):
        if not file.is_file():
            raise DldsimError(f"{file} does not exist. {remedy}")
    try:
        card = json.loads(card_path.read_text())
        kind, digest, physics = card["kind"], card["model_sha256"], card["versions"]["physics"]
    except (ValueError, KeyError, TypeError) as error:
        raise DldsimError(f"{card_path} is no card of a surrogate: {error!r}. {remedy}") from error
    if kind != KIND or card.get("features") != FEATURES:
        raise DldsimError(f"{card_path} describes another model or other features. {remedy}")
    if physics != PHYSICS_VERSION:
        raise DldsimError(
            f"{card_path}: learnt from physics version {physics}, this is {PHYSICS_VERSION}. "
            f"{remedy}"
        )
    model = path.read_bytes()
    if hashlib.sha256(model).hexdigest() != digest:
        raise DldsimError(f"{path} is not the model that {card_path} describes. {remedy}")
    booster = xgboost.Booster()
    try:
        booster.load_model(bytearray(model))
    except xgboost.core.XGBoostError as error:
        raise DldsimError(f"{path} is no XGBoost model: {error}. {remedy}") from error
    if booster.attr("card_sha256") != _card_hash(card):
        raise DldsimError(f"{card_path} was changed after {path} was written. {remedy}")
    return Surrogate(_serial(booster), card)
