"""Laws of the regressors and of the surrogate's file."""

import json
from itertools import product

import numpy as np
import pandas as pd
import pytest

from dldsim.analysis import regressors, surrogate
from dldsim.analysis.regressors import BASELINE, CURVE, FEATURES, INPUTS, REPEATS, SURROGATE
from dldsim.errors import DldsimError
from dldsim.vocabulary import GEOMETRY


def bump_or_zigzag(r, g, n, d):
    """Sharp but smooth transition at D_c of a cell of effective diameter 15 µm (1 − DI/2)."""
    excess = 15 * (1 - d / 2) - 1.4 * g * n**-0.48
    return np.degrees(np.arctan(1 / n)) / (1 + np.exp(-excess / 0.8))


def make_outcomes(
    angle=bump_or_zigzag,
    radii=(5.0, 7.5, 10.0),
    gaps=(14.0, 18.0, 22.0),
    rows=(4, 6, 10),
    indices=(0.5, 0.65, 0.78),
):
    return pd.DataFrame(
        [
            {
                "outcome_id": f"r{r:04.1f}_g{g:04.1f}_n{n:02d}_s{s}",
                "pillar_radius_um": r,
                "gap_um": g,
                "periodicity": n,
                "stiffness_set": str(s),
                "deformation_index": d,
                "cell_radius_um": 7.5,
                "cell_shape": "biconcave",
                "height_um": 20.0,
                "migration_angle_deg": angle(r, g, n, d),
                "status": "decided",
            }
            for r, g, n, (s, d) in product(radii, gaps, rows, enumerate(indices, 1))
        ]
    )


@pytest.fixture(scope="module")
def fitted():
    return surrogate.fit(make_outcomes(), seed=3)


@pytest.fixture(scope="module")
def benchmarked():
    fast = [SURROGATE, CURVE, "XGBoost", "linear", BASELINE]
    return regressors.benchmark(make_outcomes(), seed=3, names=fast)


def test_features_by_hand():
    x = dict(zip(FEATURES, regressors.features(5, 20, 10, 0.6, 7.5)[0], strict=True))
    assert np.exp(x["log_size_over_critical_diameter"]) == pytest.approx(15 / (28 * 0.1**0.48))
    assert np.exp(x["log_confinement"]) == pytest.approx(0.75)
    assert np.exp(x["log_periodicity"]) == pytest.approx(10)
    assert np.exp(x["log_pillar_radius_over_cell_radius"]) == pytest.approx(2 / 3)
    assert np.exp(x["log_gap_over_pillar_diameter"]) == pytest.approx(2)
    assert x["bump_angle_deg"] == pytest.approx(5.7106, abs=1e-4)


def test_only_ratios_of_lengths_matter(fitted):
    small, large = fitted.predict(6, 18, 6, 0.6, 7.5), fitted.predict(12, 36, 6, 0.6, 15)
    assert small == large
    assert fitted.predict([6, 8], 18, 6, 0.6, 7.5).shape == (2,)


@pytest.mark.slow
def test_every_row_is_held_out_once_a_repeat(benchmarked):
    _, predictions = benchmarked
    counts = predictions.groupby(["split", "model", "outcome_id"]).size().groupby("split")
    assert counts.size().to_dict() == dict.fromkeys(regressors.SPLITS, 5 * 81)
    assert counts.agg(["min", "max"]).T.to_dict() == {
        "random": {"min": REPEATS, "max": REPEATS},
        "geometry": {"min": REPEATS, "max": REPEATS},
        "stiffness": {"min": 1, "max": 1},
    }


@pytest.mark.slow
def test_split_by_stiffness_keeps_sets_whole(benchmarked):
    one = benchmarked[1].query("model == 'linear' and split == 'stiffness'")
    assert (one.groupby("fold")["outcome_id"].agg(lambda r: r.str[-2:].nunique()) == 1).all()
    alone = regressors.benchmark(make_outcomes(indices=(0.5,)), seed=3, names=["linear"])[0]
    assert set(alone["split"]) == {"random", "geometry"}


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


def test_every_regressor_learns():
    outcomes = make_outcomes(radii=(5.0, 10.0), gaps=(14.0, 22.0), indices=(0.5,))
    x, y = regressors.inputs_and_angles(outcomes)
    for name, (prototype, grid) in regressors.make_regressors(1).items():
        for settings in grid:
            error = prototype.set_params(**settings).fit(x, y).predict(x) - y
            assert name == BASELINE or np.std(error) < 0.9 * np.std(y)


def test_nested_search_never_sees_the_test_rows():
    """Angles of the held-out rows are not passed on: changing them changes no prediction."""
    outcomes = make_outcomes()
    x, y = regressors.inputs_and_angles(outcomes)
    groups = regressors.groups_of(outcomes, "geometry")
    train, test = next(regressors.folds_of(groups, 5, 1))
    assert not set(groups[train]) & set(groups[test])
    prototype, grid = regressors.make_regressors(1)["XGBoost"]
    model, held_out = regressors.tune(prototype, grid, x[train], y[train], groups[train], 1)
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
    forest = {"forest": regressors.make_regressors(1)["random forest"]}
    error = {
        split: np.mean(
            [fold["rmse_deg"] for fold in regressors.cross_validate(outcomes, forest, split, 1)[0]]
        )
        for split in ("random", "geometry")
    }
    assert 2 * error["random"] < error["geometry"]


def test_rule_by_hand():
    """2R = 15 µm: D_c = 14.4 µm at gap 20, N_p 4 bumps; 15.8 µm at gap 22 does not."""
    x = np.vstack([regressors.features(5, g, 4, 0.5, 7.5) for g in (20, 22)])
    assert regressors.CriticalDiameterRule().predict(x) == pytest.approx([14.0362, 0], abs=1e-4)


def test_share_and_angle_are_inverse():
    assert regressors.share_of(np.degrees(np.arctan(1 / 6)), 6) == pytest.approx(1)
    angle = np.array([-0.1, 0.0, 2.0, 9.0])
    assert regressors.angle_of(regressors.share_of(angle, 6), 6) == pytest.approx(angle)


def test_curve_recovers_a_known_transition():
    """Runs drawn from the curve itself, finely: the same shares come back."""
    made = regressors.TwoLimitCurve()
    made.coefficients = np.array([-0.5, 6.0, -0.1, 0.5, 0.3, 0.2])
    made.centre = np.array([0.5, 13.0, 2.0, -0.1, -0.05])
    outcomes = make_outcomes()
    x, _ = regressors.inputs_and_angles(outcomes)
    truth = made.predict(x)
    found = regressors.TwoLimitCurve(penalty=1e-6).fit(x, truth)
    assert found.predict(x) == pytest.approx(truth, abs=0.02)
    again = regressors.TwoLimitCurve.from_state(json.loads(json.dumps(found.state())))
    assert np.array_equal(again.predict(x), found.predict(x))


def test_both_limits_hold_whatever_the_input(fitted):
    rng = np.random.default_rng(4)
    r, g, n = rng.uniform(1, 60, 500), rng.uniform(1, 200, 500), rng.integers(2, 60, 500)
    share = fitted.share(r, g, n, rng.uniform(0, 1, 500), 7.5)
    assert ((share >= 0) & (share <= 1)).all()
    angle = fitted.predict(r, g, n, 0.6, 7.5)
    assert ((angle >= 0) & (angle <= np.degrees(np.arctan(1 / n)) + 1e-9)).all()
    # far beyond the data: a cell twice as wide as the gap bumps, a speck does not
    assert fitted.share(7.5, 7.5, 10, 0.6, 7.5) > 0.95 and fitted.share(7.5, 90, 6, 0.6, 7.5) < 0.05


def test_surrogate_recovers_the_transition(fitted):
    """Arrays between those learnt from, against the law that made the outcomes."""
    rng = np.random.default_rng(9)
    r, g, n = rng.uniform(5, 10, 200), rng.uniform(14, 22, 200), rng.integers(4, 11, 200)
    d = rng.uniform(0.5, 0.78, 200)
    truth = np.array([bump_or_zigzag(*at) for at in zip(r, g, n, d, strict=True)])
    error = np.abs(fitted.predict(r, g, n, d, 7.5) - truth)
    assert np.median(error) < 0.3 and 1 - np.var(error) / np.var(truth) > 0.95


def test_conformal_factor_by_hand():
    """Three geometries and the unknown one weigh a quarter each."""
    scores = [[0.1, 0.2], [0.3], [0.4]]
    assert surrogate.conformal_factor(scores, 0.25) == 0.2
    assert surrogate.conformal_factor(scores, 0.5) == 0.3
    assert surrogate.conformal_factor(scores, 0.75) == 0.4
    assert surrogate.conformal_factor(scores, 0.76) == np.inf


@pytest.mark.parametrize("level", [0.5, 0.8, 0.9])
def test_conformal_coverage_on_clustered_noise(level):
    """Geometries with a common error: pooling all rows as if independent would cover too little."""
    rng = np.random.default_rng(2)

    def geometry():
        return np.abs(rng.normal() + 0.3 * rng.normal(size=4))

    covered = []
    for _ in range(400):
        factor = surrogate.conformal_factor([geometry() for _ in range(30)], level)
        covered.append((geometry() <= factor).mean())
    assert level - 0.03 < np.mean(covered) < level + 0.06


def test_intervals_hold_the_prediction_and_widen_with_the_level(fitted):
    at = ([6, 8, 9], [15, 17, 20], [5, 6, 9], 0.6, 7.5)
    centre = fitted.predict(*at)
    narrow, wide = (fitted.predict_interval(*at, level=level) for level in (0.68, 0.9))
    assert (wide[0] <= narrow[0]).all() and (narrow[0] <= centre).all()
    assert (centre <= narrow[1]).all() and (narrow[1] <= wide[1]).all()
    with pytest.raises(DldsimError, match="between 0 and 1"):
        fitted.predict_interval(*at, level=1.0)


def test_outside_the_domain_any_angle_is_possible(fitted):
    low, high = fitted.predict_interval([7, 7], [18, 40], 6, [0.95, 0.6], 7.5)
    assert not fitted.inside_domain([7, 7], [18, 40], 6, [0.95, 0.6], 7.5).any()
    assert (low <= 0).all() and high == pytest.approx([np.degrees(np.arctan(1 / 6))] * 2)


def test_measured_coverage_is_near_its_level(fitted):
    for measured in fitted.card["conformal"]["measured"]:
        assert measured["geometries"] == 27
        assert measured["coverage"] > measured["level"] - 3 * max(measured["coverage_error"], 0.05)
    assert fitted.card["target_by_geometry"]["reached"] in (True, False)


def test_inside_domain_is_the_distance(fitted):
    rng = np.random.default_rng(6)
    r, g, n = rng.uniform(4, 11, 60), rng.uniform(13, 23, 60), rng.integers(3, 12, 60)
    exact = [
        fitted.distance_outside(*p, 7.5) <= surrogate.DOMAIN_TOLERANCE
        for p in zip(r, g, n, strict=True)
    ]
    assert fitted.inside_domain(r, g, n, 0.6, 7.5).tolist() == exact
    assert 0 < sum(exact) < 60


def test_saved_model_predicts_the_same(fitted, tmp_path):
    model, card = tmp_path / "m.json", tmp_path / "c.json"
    fitted.save(model, card)
    back = surrogate.load(model, card)
    at = make_outcomes()[INPUTS].T.to_numpy()
    assert np.array_equal(fitted.predict(*at), back.predict(*at))
    back.save(tmp_path / "m2.json", tmp_path / "c2.json")
    assert (tmp_path / "m2.json").read_bytes() == model.read_bytes()
    assert (tmp_path / "c2.json").read_bytes() == card.read_bytes()


def test_card_says_what_the_model_is(fitted):
    card = fitted.card
    assert set(GEOMETRY) < set(INPUTS) and len(card["conformal"]["scores"]) == 27
    assert card["data"]["used"] == 81 and card["data"]["geometries"] == 27
    assert card["domain"]["ranges"]["deformation_index"] == [0.5, 0.78]
    assert fitted.deformation_index_range == (0.5, 0.78)
    assert 0 < fitted.rmse_deg < card["baseline_by_geometry"]["rmse_deg"]
    assert card["features"] == FEATURES and card["seed"] == 3
    assert {"dldsim", "physics", "xgboost"} <= set(card["versions"])
    outcomes = make_outcomes()
    outcomes.loc[0, "migration_angle_deg"] += 1e-6
    outcomes.loc[1, "status"] = "undecided"
    other = surrogate.fit(outcomes, seed=3).card["data"]
    assert other["sha256"] != card["data"]["sha256"] and other["undecided"] == 1


def edit(change):
    def spoil(model, card):
        content = json.loads(card.read_text())
        change(content)
        card.write_text(json.dumps(content))

    return spoil


@pytest.mark.parametrize(
    "spoil, words",
    [
        (lambda m, c: m.unlink(), "does not exist"),
        (lambda m, c: c.unlink(), "does not exist"),
        (lambda m, c: c.write_text("{"), "no card"),
        (lambda m, c: c.write_text("[]"), "no card"),
        (lambda m, c: m.write_bytes(m.read_bytes()[:-9]), "not the model"),
        (edit(lambda c: c.update(kind="other")), "another model"),
        (edit(lambda c: c["features"].pop()), "features"),
        (edit(lambda c: c["versions"].update(physics=-1)), "physics version -1"),
        (edit(lambda c: c["scores_by_geometry"].update(rmse_deg=0.0)), "was changed"),
        (edit(lambda c: c["domain"]["ranges"].update(deformation_index=[0, 1])), "was changed"),
    ],
)
def test_files_that_do_not_match_are_refused(fitted, tmp_path, spoil, words):
    model, card = tmp_path / "m.json", tmp_path / "c.json"
    fitted.save(model, card)
    spoil(model, card)
    with pytest.raises(DldsimError, match=words):
        surrogate.load(model, card)


def test_inside_the_hull_no_linear_programme_is_solved(fitted, monkeypatch):
    """Such a programme takes a thousand times longer than the half-spaces of the hull."""
    corners = np.array(list(product((5.0, 10.0), (14.0, 22.0), (4, 10))))
    middle = corners.mean(axis=0)
    monkeypatch.setattr("scipy.optimize.linprog", None)
    for r, g, n in [middle, *corners, *(corners + middle) / 2]:
        assert fitted.distance_outside(r, g, n, 7.5) == 0
    with pytest.raises(TypeError):
        fitted.distance_outside(10.1, 18.0, 6, 7.5)


def test_domain_is_the_hull_of_the_training_geometries(fitted):
    assert fitted.distance_outside(6, 17, 5, 7.5) == pytest.approx(0, abs=1e-9)
    assert fitted.distance_outside(10, 22, 10, 7.5) == pytest.approx(0, abs=1e-9)
    assert fitted.distance_outside(12.5, 18, 6, 7.5) == pytest.approx(0.5)
    # the same array is another one to a smaller cell
    assert fitted.distance_outside(10, 22, 6, 5.0) > 0.5


def test_domain_of_tied_gap_and_radius_is_not_a_box():
    outcomes = make_outcomes(gaps=(15.0, 17.5, 20.0))
    outcomes = outcomes[outcomes["gap_um"] == outcomes["pillar_radius_um"] + 10]
    tied = surrogate.fit(outcomes, seed=1)
    assert tied.distance_outside(6, 16, 5, 7.5) == pytest.approx(0, abs=1e-9)
    assert tied.distance_outside(5.5, 19.5, 5, 7.5) > 0.3
    fixed = surrogate.fit(make_outcomes(gaps=(18.0,)), seed=1)
    assert fixed.distance_outside(6, 19, 5, 7.5) == np.inf
    assert fixed.distance_outside(6, 18, 5, 7.5) == pytest.approx(0, abs=1e-9)


def test_unusable_runs_are_left_out():
    outcomes = make_outcomes()
    outcomes.loc[:3, "migration_angle_deg"] = np.nan
    outcomes.loc[4:5, "deformation_index"] = np.nan
    assert surrogate.fit(outcomes, seed=1).card["data"]["used"] == 75


@pytest.mark.parametrize(
    "spoil, words",
    [
        (lambda t: t.drop(columns="cell_radius_um"), "cell_radius_um"),
        (lambda t: t.assign(deformation_index=np.nan), "81 without deformation_index"),
        (lambda t: t.assign(migration_angle_deg=2.0), "different angles"),
        (lambda t: t.assign(height_um=np.arange(81)), "height_um"),
        (lambda t: t.iloc[:0], "0 of 0 outcomes"),
    ],
)
def test_unusable_tables_are_refused(spoil, words):
    with pytest.raises(DldsimError, match=words):
        surrogate.fit(spoil(make_outcomes()), seed=1)


def test_impossible_inputs_are_refused(fitted):
    with pytest.raises(DldsimError, match="gap_um must be positive"):
        fitted.predict(6, -1, 6, 0.6, 7.5)
    with pytest.raises(DldsimError, match="finite"):
        fitted.predict(6, np.nan, 6, 0.6, 7.5)


def test_tiny_table_gives_the_same_numbers_in_any_order(monkeypatch):
    outcomes = make_outcomes(radii=(5.0, 7.5), gaps=(15.0, 20.0), rows=(4, 6), indices=(0.5, 0.78))
    keys = ["model", "split", "repeat", "fold", "rmse_deg", "r2"]
    monkeypatch.setattr(regressors, "REPEATS", 1)
    names = ["linear", CURVE]
    a, b = (
        regressors.benchmark(t, seed=1, names=names)[0]
        for t in (outcomes, outcomes.sample(frac=1, random_state=5))
    )
    pd.testing.assert_frame_equal(a[keys], b[keys])
    assert np.isfinite(a["rmse_deg"]).all()


def test_learning_curve_holds_arrays_out_and_learns(monkeypatch):
    monkeypatch.setattr(regressors, "CURVE_REPEATS", 3)
    monkeypatch.setattr(regressors, "CURVE_SIZES", 4)
    curve = regressors.learning_curve(make_outcomes(), seed=2)
    assert set(curve["model"]) == set(regressors.CURVE_MODELS)
    assert (curve["outcomes"] == 3 * curve["geometries"]).all() and (curve["n_test"] == 15).all()
    assert curve["geometries"].min() == 3 and curve["geometries"].max() == 22
    error = curve.groupby(["model", "geometries"])["rmse_deg"].median()
    assert error["XGBoost", 22] < 0.5 * error["XGBoost", 3]
    assert error[SURROGATE, 3] < 0.5 * error["XGBoost", 3]  # it knows the law before any run
    rule = curve[curve["model"] == BASELINE].groupby("repeat")["rmse_deg"].nunique()
    assert (rule == 1).all()  # the rule learns nothing, and the arrays held out are the same
    assert np.isfinite(curve["rmse_deg"]).all()
    again = regressors.learning_curve(make_outcomes().assign(wall_time_s=2.0), seed=2)
    assert np.array_equal(curve["rmse_deg"], again["rmse_deg"])
    assert np.allclose(again["simulation_time_s"], 2.0 * again["outcomes"])


def test_numerical_uncertainty_of_predictions_is_that_of_the_runs():
    """By mode after the angle; a mode without outcomes gets the largest share."""
    outcomes = make_outcomes()
    bump = np.degrees(np.arctan(1 / outcomes["periodicity"]))
    share = outcomes["migration_angle_deg"] / bump
    sigma = np.where(share >= 0.9, 0.01 * bump, np.where(share <= 0.1, 0.05 * bump, np.nan))
    known = outcomes.assign(sigma_num_deg=sigma, sigma_num_kind="modelled")
    made = surrogate.fit(known, seed=1)
    angle = np.degrees(np.arctan(1 / 4))
    found = made.sigma_num_deg([0.0, 0.5 * angle, angle], [4, 4, 4])
    assert found == pytest.approx([0.05 * angle, 0.05 * angle, 0.01 * angle])
    assert made.card["numerical_uncertainty"]["basis"] == ["modelled"]
    assert surrogate.fit(outcomes, seed=1).sigma_num_deg([0.0], [4]) is None


def test_quick_look_at_the_domain_never_refuses_what_is_inside(fitted):
    """Against the exact distance, for a box and for the plane gap = radius + 10 µm."""
    rng = np.random.default_rng(5)
    r, g, n = rng.uniform(4, 12, 60), rng.uniform(13, 23, 60), rng.integers(4, 13, 60)
    plane = make_outcomes(gaps=(15.0, 17.5, 20.0))
    plane = plane[plane["gap_um"] == plane["pillar_radius_um"] + 10]
    for model in (fitted, surrogate.fit(plane, seed=1)):
        g = np.where(np.arange(60) % 2, g, r + 10)
        may = model.may_be_inside(r, g, n, 7.5)
        inside = [
            model.distance_outside(*p, 7.5) <= surrogate.DOMAIN_TOLERANCE
            for p in zip(r, g, n, strict=True)
        ]
        assert not (np.array(inside) & ~may).any() and 0 < may.sum() < 60
