"""Laws of the surrogate: what it learns, its intervals, its domain, and its file."""

import json

import numpy as np
import pytest

from dldsim.analysis import surrogate
from dldsim.analysis.features import CELL, FEATURES, INPUTS, CellInFlow, cells_of
from dldsim.errors import DldsimError
from dldsim.vocabulary import GEOMETRY
from tests.analysis.made_outcomes import (
    CAPILLARY,
    bump_or_zigzag,
    cell,
    make_outcomes,
    make_survey,
    share_by_law,
)


@pytest.fixture(scope="module")
def fitted():
    return surrogate.fit(make_outcomes(), seed=3)


@pytest.fixture(scope="module")
def surveyed():
    """Learnt from discs and spheres of any velocity and height, beside a campaign of the same
    law."""
    campaign = make_survey(64, 0, seed=5).assign(height_um=20.0)
    share = share_by_law(
        "biconcave",
        campaign["pillar_radius_um"] / 7.5,
        campaign["gap_um"] / 7.5,
        campaign["periodicity"],
        campaign["capillary_number"],
        20 / 7.5,
    )
    campaign["migration_angle_deg"] = np.degrees(np.arctan(share / campaign["periodicity"]))
    campaign["outcome_id"] = [f"c{i:04d}" for i in range(len(campaign))]
    return surrogate.fit(campaign, 1, make_survey(150, 120))


def test_only_ratios_and_ca_matter(fitted):
    small = fitted.predict(6, 18, 6, CellInFlow("biconcave", 7.5, 20.0, 0.1))
    large = fitted.predict(12, 36, 6, CellInFlow("biconcave", 15.0, 40.0, 0.1))
    assert small == pytest.approx(large, rel=1e-6)
    assert fitted.predict([6, 8], 18, 6, cell()).shape == (2,)


def test_surrogate_recovers_the_transition(fitted):
    """Arrays between those learnt from, against the law that made the outcomes."""
    rng = np.random.default_rng(9)
    r, g, n = rng.uniform(5, 10, 200), rng.uniform(14, 22, 200), rng.integers(4, 11, 200)
    d = rng.choice(list(CAPILLARY), 200)
    truth = np.array([bump_or_zigzag(*at) for at in zip(r, g, n, d, strict=True)])
    found = fitted.predict(r, g, n, cell(np.array([CAPILLARY[x] for x in d])))
    assert np.median(np.abs(found - truth)) < 0.3
    assert 1 - np.var(found - truth) / np.var(truth) > 0.95


@pytest.mark.parametrize(("shape", "radius"), [("biconcave", 6.0), ("sphere", 9.0)])
def test_other_velocities_heights_and_radii_are_learnt_from_the_survey(surveyed, shape, radius):
    """On points of another seed than those learnt from, in another radius."""
    held = make_survey(400, 400, seed=11)
    held = held[held["cell_shape"] == shape]
    scale = radius / 7.5
    at = *(held[n].to_numpy() for n in GEOMETRY), cells_of(held)
    larger = at[3]._replace(radius_um=radius, height_um=scale * held["height_um"].to_numpy())
    found = surveyed.predict(scale * at[0], scale * at[1], at[2], larger)
    error, truth = found - held["migration_angle_deg"], held["migration_angle_deg"]
    assert 1 - np.var(error) / np.var(truth) > 0.95 and np.median(np.abs(error)) < 0.2
    low, high = surveyed.predict_interval(*at)
    inside = surveyed.inside_domain(*at)
    assert ((low <= truth) & (truth <= high))[inside].mean() > 0.85 and inside.mean() > 0.6


def test_beads_join_the_law_of_the_critical_diameter(surveyed, fitted):
    """The made-up law is within 1 % of it in the stiff limit, what 120 of its spheres teach within
    5 %."""
    beads = surveyed.card["beads"]
    assert [b["periodicity"] for b in beads] == [4, 5, 6, 8, 12]
    assert all(b["over_law"] == pytest.approx(1, abs=0.05) for b in beads)
    assert all(b["within_scatter"] for b in beads)
    assert fitted.card["beads"] == []
    # pillars narrower than half of the gap at the transition, as in the survey that is packaged
    state = surveyed.card["domain"]
    slim = [g for g in state["sphere"]["geometries"] if g[0] < 0.3 * g[1]]
    learnt = state | {"sphere": state["sphere"] | {"geometries": slim}}
    found = surrogate.beads(
        surrogate.Surrogate(surveyed.booster, surveyed.card | {"domain": learnt})
    )
    assert [b["pillar_radius_over_cell_radius"] for b in found] == [
        np.median(slim, axis=0)[0]
    ] * len(found)
    assert {5, 8} <= {b["periodicity"] for b in found} and all(b["within_scatter"] for b in found)


def test_shapes_have_domains_of_their_own(surveyed):
    disc, sphere = cell(0.1), cell(0.1, shape="sphere")
    wide = 8.0, 36.0, 8  # beyond the discs' gaps, inside the spheres'
    assert not surveyed.inside_domain(*wide, disc)[0] and surveyed.inside_domain(*wide, sphere)[0]
    assert surveyed.distance_outside(*wide, disc)[0] > 0.1
    assert np.isinf(surveyed.distance_outside(*wide, cell(shape="ellipsoid"))[0])
    both = CellInFlow(np.array(["biconcave", "sphere"]), 7.5, 20.0, 0.1)
    assert surveyed.inside_domain([8, 8], [36, 36], 8, both).tolist() == [False, True]
    assert surveyed.holds_for.startswith("biconcave discs (Ca 0.02")
    # Ca and height beyond what was learnt
    assert not surveyed.inside_domain(8, 18, 8, cell([1.5, 0.001])).any()
    assert not surveyed.inside_domain(8, 18, 8, cell(height_um=40.0))[0]


def test_both_sources_are_counted_and_scored_by_shape(surveyed):
    card = surveyed.card
    assert card["data"]["used"] == 64 + 270 and card["data"]["survey"] == 270
    assert {k: v["predictions"] for k, v in card["scores_by_shape"].items()} == {
        "biconcave": 214,
        "sphere": 120,
    }
    assert card["scores_by_shape"]["sphere"]["r2"] > 0.9
    measured = {(m["shape"], m["level"]): m["coverage"] for m in card["conformal"]["measured"]}
    assert set(measured) == {(s, x) for s in ("biconcave", "sphere") for x in surrogate.LEVELS}
    assert all(abs(found - level) < 0.12 for (_, level), found in measured.items())


def test_a_shape_of_few_outcomes_has_wide_intervals():
    few = make_survey(60, 6)
    model = surrogate.fit(few, 1)
    at = cells_of(few[few["cell_shape"] == "sphere"].iloc[:1])
    row = few[few["cell_shape"] == "sphere"].iloc[0]
    low, high = model.predict_interval(*(row[n] for n in GEOMETRY), at)
    assert high[0] - low[0] >= 0.999 * np.degrees(np.arctan(1 / row["periodicity"]))


def test_intervals_hold_the_prediction_and_widen_with_the_level(fitted):
    at = ([6, 8, 9], [15, 17, 20], [5, 6, 9], cell())
    centre = fitted.predict(*at)
    narrow, wide = (fitted.predict_interval(*at, level=level) for level in (0.68, 0.9))
    assert (wide[0] <= narrow[0]).all() and (narrow[0] <= centre).all()
    assert (centre <= narrow[1]).all() and (narrow[1] <= wide[1]).all()
    with pytest.raises(DldsimError, match="between 0 and 1"):
        fitted.predict_interval(*at, level=1.0)


def test_outside_the_domain_any_angle_is_possible(fitted):
    low, high = fitted.predict_interval(7, [18, 40], 6, cell([0.5, 0.075]))
    assert not fitted.inside_domain(7, [18, 40], 6, cell([0.5, 0.075])).any()
    assert (low <= 0).all() and high == pytest.approx([np.degrees(np.arctan(1 / 6))] * 2)


def test_measured_coverage_is_near_its_level(fitted):
    for measured in fitted.card["conformal"]["measured"]:
        assert measured["geometries"] == 27
        assert measured["coverage"] > measured["level"] - 3 * max(measured["coverage_error"], 0.05)
    assert fitted.card["target_by_geometry"]["reached"] in (True, False)


def test_saved_model_predicts_the_same(fitted, tmp_path):
    model, card = tmp_path / "m.json", tmp_path / "c.json"
    fitted.save(model, card)
    back = surrogate.load(model, card)
    outcomes = make_outcomes()
    at = *(outcomes[name] for name in GEOMETRY), cells_of(outcomes)
    assert np.array_equal(fitted.predict(*at), back.predict(*at))
    back.save(tmp_path / "m2.json", tmp_path / "c2.json")
    assert (tmp_path / "m2.json").read_bytes() == model.read_bytes()
    assert (tmp_path / "c2.json").read_bytes() == card.read_bytes()


def test_card_says_what_the_model_is(fitted):
    card = fitted.card
    assert [*GEOMETRY, *CELL] == INPUTS and len(card["conformal"]["scores"]["biconcave"]) == 27
    assert card["data"]["used"] == 81 and card["data"]["geometries"] == 27
    assert card["data"]["survey"] is None
    assert fitted.domains["biconcave"].capillary_number == (0.0369, 0.147)
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
        (edit(lambda c: c["domain"]["biconcave"].update(capillary_number=[0, 1])), "was changed"),
        (edit(lambda c: c["shapes"].pop()), "other features"),
    ],
)
def test_files_that_do_not_match_are_refused(fitted, tmp_path, spoil, words):
    model, card = tmp_path / "m.json", tmp_path / "c.json"
    fitted.save(model, card)
    spoil(model, card)
    with pytest.raises(DldsimError, match=words):
        surrogate.load(model, card)


def test_unusable_runs_are_left_out():
    outcomes = make_outcomes()
    outcomes.loc[:3, "migration_angle_deg"] = np.nan
    outcomes.loc[4:5, "capillary_number"] = np.nan
    assert surrogate.fit(outcomes, seed=1).card["data"]["used"] == 75


@pytest.mark.slow
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


def test_a_survey_of_other_numerics_is_refused():
    with pytest.raises(DldsimError, match="wanted_spacing_um"):
        surrogate.fit(make_outcomes().assign(wanted_spacing_um=2.0), 1, make_survey(8, 8))
