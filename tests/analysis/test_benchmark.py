"""Laws of the cross-validation: what is held out, what is learnt from, what is scored."""

from itertools import product

import numpy as np
import pandas as pd
import pytest

from dldsim.analysis import benchmark
from dldsim.analysis.benchmark import REPEATS
from dldsim.analysis.features import inputs_and_angles
from dldsim.analysis.regressors import BASELINE, CURVE, SURROGATE, make_regressors
from dldsim.tables.registry import COLUMNS
from tests.analysis.made_outcomes import make_outcomes, make_survey


@pytest.fixture(scope="module")
def benchmarked():
    fast = [SURROGATE, CURVE, "XGBoost", "linear", BASELINE]
    return benchmark.benchmark(make_outcomes(), seed=3, names=fast)


@pytest.fixture(scope="module")
def with_survey():
    """Campaign and survey of one law, the campaign's rows with a deformation index."""
    survey = make_survey(60, 40)
    return benchmark.benchmark(
        make_outcomes(), 3, [CURVE, f"{CURVE} on DI", BASELINE], survey=survey
    )[1]


@pytest.mark.slow
def test_every_row_is_held_out_once_a_repeat(benchmarked):
    _, predictions = benchmarked
    counts = predictions.groupby(["split", "model", "outcome_id"]).size().groupby("split")
    assert counts.size().to_dict() == dict.fromkeys(benchmark.SPLITS, 5 * 81)
    assert counts.agg(["min", "max"]).T.to_dict() == {
        "random": {"min": REPEATS, "max": REPEATS},
        "geometry": {"min": REPEATS, "max": REPEATS},
        "stiffness": {"min": 1, "max": 1},
    }
    assert set(predictions) == {c.name for c in COLUMNS["predictions"]}


@pytest.mark.slow
def test_split_by_stiffness_keeps_sets_whole(benchmarked):
    one = benchmarked[1].query("model == 'linear' and split == 'stiffness'")
    assert (one.groupby("fold")["outcome_id"].agg(lambda r: r.str[-2:].nunique()) == 1).all()
    alone = benchmark.benchmark(make_outcomes(indices=(0.5,)), seed=3, names=["linear"])[0]
    assert set(alone["split"]) == {"random", "geometry"}


@pytest.mark.slow
def test_points_of_the_survey_are_held_out_by_geometry_and_no_sets(with_survey):
    counts = with_survey[with_survey["model"] == CURVE].groupby(["split", "source"]).size()
    assert counts["geometry", "survey"] == 2 * 100 and counts["geometry", "campaign"] == 2 * 81
    assert ("stiffness", "survey") not in counts.index
    assert counts["stiffness", "campaign"] == 81
    spheres = with_survey[with_survey["cell_shape"] == "sphere"]
    assert set(spheres["source"]) == {"survey"} and spheres["capillary_number"].notna().all()


@pytest.mark.slow
def test_the_sources_form_sees_rows_with_an_index_alone(with_survey):
    by_index = with_survey[with_survey["model"] == f"{CURVE} on DI"]
    assert set(by_index["source"]) == {"campaign"}
    assert len(by_index.query("split == 'geometry'")) == 2 * 81
    without = make_outcomes().assign(deformation_index=np.nan)
    _, none = benchmark.benchmark(without, 3, [CURVE, f"{CURVE} on DI"])
    assert set(none["model"]) == {CURVE}


@pytest.mark.slow
def test_split_by_geometry_keeps_arrays_whole(benchmarked):
    scores, predictions = benchmarked
    one = predictions[(predictions["model"] == "linear")].assign(
        geometry=lambda t: t["outcome_id"].str.rsplit("_s").str[0]
    )
    together = one.groupby(["split", "geometry"])["fold"].nunique()
    assert (together["geometry"] == REPEATS).all()
    assert together["random"].max() > REPEATS
    assert (scores["n_train"] + scores["n_test"] == 81).all()


@pytest.mark.slow
def test_scores_are_those_of_the_predictions(benchmarked):
    scores, predictions = benchmarked
    error = predictions["predicted_deg"] - predictions["observed_deg"]
    mse = (error**2).groupby([predictions[n] for n in ("model", "split", "fold")]).mean()
    found = scores.set_index(["model", "split", "fold"])
    pd.testing.assert_series_equal(found["mse_deg2"].sort_index(), mse, check_names=False)
    assert np.allclose(found["rmse_deg"] ** 2, found["mse_deg2"])
    assert (found["mae_deg"] <= found["rmse_deg"] + 1e-12).all()


@pytest.mark.slow
def test_learners_beat_the_rule_that_learns_nothing(benchmarked):
    rmse = benchmarked[0].groupby(["split", "model"])["rmse_deg"].mean()
    assert rmse["geometry", SURROGATE] < rmse["geometry", "XGBoost"] < rmse["geometry", "linear"]
    assert rmse["geometry", "linear"] < rmse["geometry", BASELINE]
    assert rmse["geometry", CURVE] < 0.5 * rmse["geometry", "linear"]


def test_nested_search_never_sees_the_test_rows():
    """Angles of the held-out rows are not passed on: changing them changes no prediction."""
    outcomes = make_outcomes()
    x, y = inputs_and_angles(outcomes)
    groups = benchmark.groups_of(outcomes, "geometry")
    train, test = next(benchmark.folds_of(groups, 5, 1))
    assert not set(groups[train]) & set(groups[test])
    prototype, grid, _ = make_regressors(1)["XGBoost"]
    model, held_out = benchmark.tune(prototype, grid, x[train], y[train], groups[train], 1)
    assert np.isfinite(held_out).all() and held_out.shape == (len(train),)
    assert {k: model.get_params()[k] for k in grid[0]} in grid


@pytest.mark.slow
def test_random_split_flatters_what_only_remembers():
    """Angles drawn per array, nothing to learn from geometry: only leakage can score."""
    draw = np.random.default_rng(0)
    angle = {
        key: draw.normal() for key in product((5.0, 7.5, 10.0), (14.0, 18.0, 22.0), (4, 6, 10))
    }
    outcomes = make_outcomes(lambda r, g, n, d: angle[r, g, n])
    forest = {"forest": make_regressors(1)["random forest"]}
    error = {
        split: np.mean(
            [fold["rmse_deg"] for fold in benchmark.cross_validate(outcomes, forest, split, 1)[0]]
        )
        for split in ("random", "geometry")
    }
    assert 2 * error["random"] < error["geometry"]


def test_tiny_table_gives_the_same_numbers_in_any_order(monkeypatch):
    outcomes = make_outcomes(radii=(5.0, 7.5), gaps=(15.0, 20.0), rows=(4, 6), indices=(0.5, 0.78))
    keys = ["model", "split", "repeat", "fold", "rmse_deg", "r2"]
    monkeypatch.setattr(benchmark, "REPEATS", 1)
    names = ["linear", CURVE]
    a, b = (
        benchmark.benchmark(t, seed=1, names=names)[0]
        for t in (outcomes, outcomes.sample(frac=1, random_state=5))
    )
    pd.testing.assert_frame_equal(a[keys], b[keys])
    assert np.isfinite(a["rmse_deg"]).all()


def test_progress_is_told():
    said = []
    benchmark.benchmark(make_outcomes(), 1, [BASELINE], progress=said.append)
    assert len(said) == 10 + 10 + 3 and said[0] == "random split, fold 1 of 10"


def test_learning_curve_holds_arrays_out_and_learns(monkeypatch):
    monkeypatch.setattr(benchmark, "CURVE_REPEATS", 3)
    monkeypatch.setattr(benchmark, "CURVE_SIZES", 4)
    curve = benchmark.learning_curve(make_outcomes(), seed=2)
    assert set(curve["model"]) == set(benchmark.CURVE_MODELS)
    assert (curve["outcomes"] == 3 * curve["geometries"]).all() and (curve["n_test"] == 15).all()
    assert curve["geometries"].min() == 3 and curve["geometries"].max() == 22
    error = curve.groupby(["model", "geometries"])["rmse_deg"].median()
    assert error["XGBoost", 22] < 0.5 * error["XGBoost", 3]
    assert error[SURROGATE, 3] < 0.5 * error["XGBoost", 3]  # it knows the law before any run
    rule = curve[curve["model"] == BASELINE].groupby("repeat")["rmse_deg"].nunique()
    assert (rule == 1).all()  # the rule learns nothing, and the arrays held out are the same
    assert np.isfinite(curve["rmse_deg"]).all()
    again = benchmark.learning_curve(make_outcomes().assign(wall_time_s=2.0), seed=2)
    assert np.array_equal(curve["rmse_deg"], again["rmse_deg"])
    assert np.allclose(again["simulation_time_s"], 2.0 * again["outcomes"])


def test_learning_curve_tells_what_more_of_the_survey_buys(monkeypatch):
    monkeypatch.setattr(benchmark, "CURVE_REPEATS", 2)
    monkeypatch.setattr(benchmark, "CURVE_SIZES", 3)
    curve = benchmark.learning_curve(make_survey(90, 60), seed=2)
    error = curve[curve["model"] == CURVE].groupby("geometries")["rmse_deg"].mean()
    assert error.iloc[-1] < 0.5 * error.iloc[0] and curve["geometries"].max() == 120
