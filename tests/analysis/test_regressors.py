"""Laws of the regressors: the curve, its limits, and what each learns."""

import json

import numpy as np
import pytest

from dldsim.analysis import features, regressors
from dldsim.analysis.regressors import BASELINE
from tests.analysis.made_outcomes import cell, make_outcomes, make_survey, share_by_law


@pytest.fixture(scope="module")
def surveyed():
    return features.inputs_and_angles(features.learnable(make_survey(120, 90)))


def test_every_regressor_learns():
    outcomes = make_outcomes(radii=(5.0, 10.0), gaps=(14.0, 22.0), indices=(0.5, 0.78))
    for name, (prototype, grid, by_index) in regressors.make_regressors(1).items():
        x, y = features.inputs_and_angles(outcomes, by_index)
        for settings in grid:
            error = prototype.set_params(**settings).fit(x, y).predict(x) - y
            assert name == BASELINE or np.std(error) < 0.9 * np.std(y)


def test_the_sources_form_is_among_them():
    found = regressors.make_regressors(1)
    twins = [name for name, regressor in found.items() if regressor.by_index]
    assert twins == ["bounded XGBoost on DI", "two-limit curve on DI", "XGBoost on DI"]
    assert all(found[name.removesuffix(regressors.ON_INDEX)] for name in twins)


def test_rule_by_hand():
    """2R = 15 µm: D_c = 14.4 µm at gap 20, N_p 4 bumps; 15.8 µm at gap 22 does not."""
    x = features.features(5, [20, 22], 4, cell())
    assert regressors.CriticalDiameterRule().predict(x) == pytest.approx([14.0362, 0], abs=1e-4)


def test_curve_recovers_a_known_transition(surveyed):
    """Outcomes drawn from the curve itself: the same shares come back."""
    x, _ = surveyed
    made = regressors.TwoLimitCurve()
    made.middle = -2.0
    made.centre = made.terms(x).mean(axis=0)
    rng = np.random.default_rng(2)
    made.coefficients = np.r_[-0.5, 6.0, rng.uniform(-0.4, 0.4, made.terms(x).shape[1] - 1)]
    truth = made.predict(x)
    found = regressors.TwoLimitCurve(penalty=1e-8).fit(x, truth)
    assert np.abs(found.predict(x) - truth).mean() < 0.02
    again = regressors.TwoLimitCurve.from_state(json.loads(json.dumps(found.state())))
    assert np.array_equal(again.predict(x), found.predict(x))


def test_curve_finds_the_least_critical_gap_of_discs(surveyed):
    """The law has it at Ca 0.17 for discs; the critical gap of spheres falls with Ca."""
    curve = regressors.TwoLimitCurve(0.3).fit(*surveyed)
    capillary = np.geomspace(0.03, 0.8, 60)
    # a gap between those: the less of it is critical, the smaller the share
    share = curve.share(features.features(7.5, 16.0, 8, cell(capillary)))
    assert 0.1 < capillary[share.argmin()] < 0.3
    bead = curve.share(features.features(7.5, 27.0, 8, cell(capillary, shape="sphere")))
    assert bead[0] > bead[-1]


def test_few_outcomes_give_the_law(surveyed):
    """Of eight spheres the transition is known to some per cent."""
    data = features.learnable(make_survey(120, 90)).query("cell_shape == 'sphere'").iloc[::11]
    curve = regressors.TwoLimitCurve().fit(*features.inputs_and_angles(data))
    gap = np.linspace(2.0, 6.0, 400)
    for rows in (5, 12):
        share = curve.share(features.features(7.5, 7.5 * gap, rows, cell(0.02, shape="sphere")))
        truth = share_by_law("sphere", 1.0, gap, rows, 0.02, 20 / 7.5)
        at = gap[np.abs(share - 0.5).argmin()] / gap[np.abs(truth - 0.5).argmin()]
        assert at == pytest.approx(1, abs=0.12)


@pytest.mark.parametrize("name", [regressors.SURROGATE, regressors.CURVE])
def test_both_limits_hold_whatever_the_input(surveyed, name):
    model = regressors.make_regressors(1)[name].prototype.fit(*surveyed)
    rng = np.random.default_rng(4)
    n = rng.integers(2, 60, 500)
    flying = cell(rng.uniform(1e-4, 10, 500), height_um=rng.uniform(3, 90, 500), shape="biconcave")
    x = features.features(rng.uniform(1, 60, 500), rng.uniform(1, 200, 500), n, flying)
    angle = model.predict(x)
    assert ((angle >= 0) & (angle <= np.degrees(np.arctan(1 / n)) + 1e-9)).all()
