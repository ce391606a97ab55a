"""What the regressors of the migration angle score on outcomes that they have not seen."""

import copy
from collections.abc import Callable, Collection, Iterator, Mapping
from time import perf_counter
from typing import Any

import numpy as np
import pandas as pd

from dldsim.analysis.features import INDEX, cells_of, inputs_and_angles, learnable
from dldsim.analysis.learning import CAMPAIGN_SOURCE, with_survey
from dldsim.analysis.regressors import BASELINE, CURVE, SURROGATE, Regressor, make_regressors
from dldsim.experiments.migration import mode_of
from dldsim.vocabulary import DECIDED, GEOMETRY

Progress = Callable[[str], None]
SPLITS = ("random", "geometry", "stiffness")
FOLDS, REPEATS, INNER_FOLDS = 5, 2, 3
CURVE_REPEATS, CURVE_SIZES, CURVE_HELD_OUT = 10, 7, 0.2
CURVE_MODELS = (SURROGATE, "XGBoost", CURVE, BASELINE)


def groups_of(data: pd.DataFrame, split: str) -> np.ndarray:
    """What is kept together in a fold: rows by themselves, whole geometries, or stiffness sets."""
    if split == "random":
        return np.arange(len(data))
    keys = GEOMETRY if split == "geometry" else ["stiffness_set"]
    return data.groupby(keys).ngroup().to_numpy()


def held_out_rows(data: pd.DataFrame, split: str) -> np.ndarray:
    """Rows that a split holds out in turn; others, none of whose like is left, are always learnt.

    Of stiffness sets those of several geometries: a point of the survey is a set of its own.
    """
    if split != "stiffness":
        return np.arange(len(data))
    arrays = data.groupby(GEOMETRY).ngroup().groupby(data["stiffness_set"]).transform("nunique")
    return np.flatnonzero(arrays > 1)


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
    data: pd.DataFrame,
    regressors: Mapping[str, Regressor],
    split: str,
    seed: int,
    progress: Progress | None = None,
) -> tuple[list[dict[str, Any]], list[pd.DataFrame]]:
    """Nested cross-validation: rows of `benchmark` and parts of `predictions`.

    Settings are chosen within the training rows, over folds of the same kind as the outer ones.
    Regressors in the source's form learn from and predict the rows with a deformation index.
    """
    told = data[INDEX].notna().to_numpy() if INDEX in data else np.zeros(len(data), bool)
    x, y = inputs_and_angles(data)
    by_index = np.full_like(x, np.nan)
    if told.any():
        by_index[told], _ = inputs_and_angles(data[told], by_index=True)
    groups, held = groups_of(data, split), held_out_rows(data, split)
    about = pd.DataFrame(
        {
            "outcome_id": data["outcome_id"],
            "source": data["source"] if "source" in data else CAMPAIGN_SOURCE,
            "cell_shape": data["cell_shape"],
            "periodicity": data["periodicity"],
            "capillary_number": data["capillary_number"],
            "vertical_confinement": cells_of(data).vertical_confinement,
            "decided": data["status"].isin(DECIDED),
            "mode": [mode_of(a, 1 / n) for a, n in zip(y, data["periodicity"], strict=True)],
        }
    )
    scores, predictions = [], []
    folds = [
        (repeat, held[test])
        for repeat in range(REPEATS)
        for _, test in folds_of(groups[held], FOLDS, seed + repeat)
    ]
    if split == "stiffness":
        folds = folds[: len(folds) // REPEATS]  # few sets: the folds of a repeat are the same
    for number, (repeat, left_out) in enumerate(folds):
        if progress is not None:
            progress(f"{split} split, fold {number + 1} of {len(folds)}")
        others = np.setdiff1d(np.arange(len(data)), left_out)
        for name, (prototype, grid, source_form) in regressors.items():
            train, test, seen = others, left_out, x
            if source_form:
                train, test, seen = others[told[others]], left_out[told[left_out]], by_index
            if not len(train) or not len(test):
                continue
            regressor = copy.deepcopy(prototype).set_params(**grid[0])
            if len(grid) > 1:
                regressor, _ = tune(prototype, grid, seen[train], y[train], groups[train], seed)
            start = perf_counter()
            regressor.fit(seen[train], y[train])
            fitted = perf_counter()
            predicted = np.asarray(regressor.predict(seen[test]), float)
            done = perf_counter()
            error = predicted - y[test]
            spread = np.sum((y[test] - y[test].mean()) ** 2)
            mse = np.mean(error**2)
            fold = {"model": name, "split": split, "repeat": repeat, "fold": number}
            scores.append(
                {
                    **fold,
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
                about.iloc[test].assign(**fold, observed_deg=y[test], predicted_deg=predicted)
            )
    return scores, predictions


def benchmark(
    outcomes: pd.DataFrame,
    seed: int,
    names: Collection[str] | None = None,
    survey: pd.DataFrame | None = None,
    progress: Progress | None = None,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Scores per fold and held-out predictions [deg] of all regressors, or of those named.

    Tables of kinds `benchmark` and `predictions`. Two repeats of five folds over rows (`random`,
    the source paper's way, which leaves other stiffness sets of the same array in the training
    data) and over whole geometries (`geometry`, what a designer needs), and one over stiffness sets
    (`stiffness`, cells of a deformability never seen in the campaign), where there are several.
    Settings are chosen within the training rows. Regressors in the source's form see the rows with
    a deformation index alone. Same seed, same numbers, times apart.

    Raises DldsimError as `with_survey` and `learnable` do.
    """
    data = learnable(with_survey(outcomes, survey))
    told = data.dropna(subset=[INDEX]) if INDEX in data else data[:0]
    enough = told.groupby(GEOMETRY).ngroups >= 3
    regressors = {
        name: regressor
        for name, regressor in make_regressors(seed).items()
        if (names is None or name in names) and (enough or not regressor.by_index)
    }
    scores, predictions = [], []
    for split in SPLITS:
        if split == "stiffness":
            held = held_out_rows(data, split) if "stiffness_set" in data else []
            if data.loc[held, "stiffness_set"].nunique() < 2:
                continue
        found = cross_validate(data, regressors, split, seed, progress)
        scores += found[0]
        predictions += found[1]
    return pd.DataFrame(scores), pd.concat(predictions, ignore_index=True)


def learning_curve(
    outcomes: pd.DataFrame,
    seed: int,
    survey: pd.DataFrame | None = None,
    progress: Progress | None = None,
) -> pd.DataFrame:
    """Error [deg] on unseen arrays against the outcomes learnt from; kind `learning_curve`.

    In each of ten repeats a fifth of the arrays is held out; the others are learnt from in growing,
    nested numbers from three arrays on, with the middle settings. A row also says what its training
    outcomes cost to simulate.

    Raises DldsimError as `benchmark` does.
    """
    data = learnable(with_survey(outcomes, survey))
    group = groups_of(data, "geometry")
    x, y = inputs_and_angles(data)
    cost = data["wall_time_s"].to_numpy(float) if "wall_time_s" in data else np.full(len(y), np.nan)
    arrays = group.max() + 1
    held_out = max(1, min(round(CURVE_HELD_OUT * arrays), arrays - 2))
    sizes = np.geomspace(min(3, arrays - held_out), arrays - held_out, CURVE_SIZES)
    rng = np.random.default_rng(seed)
    rows = []
    for repeat in range(CURVE_REPEATS):
        if progress is not None:
            progress(f"repeat {repeat + 1} of {CURVE_REPEATS}")
        order = rng.permutation(arrays)
        test = np.isin(group, order[:held_out])
        regressors = make_regressors(seed + repeat)
        for size in np.unique(sizes.round().astype(int)):
            train = np.isin(group, order[held_out : held_out + size])
            for name in CURVE_MODELS:
                prototype, grid, _ = regressors[name]
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
