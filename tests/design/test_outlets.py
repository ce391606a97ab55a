"""Laws of the outlets: closed forms for normal populations, walls, lags, mixtures, clogging."""

import numpy as np
import pytest
from scipy.stats import norm

from dldsim.design.outlets import (
    MODES,
    Array,
    Cells,
    Devices,
    Predictor,
    best_split,
    course,
    first_reached,
    make_paths,
    middle_of_best,
    qualities,
    selected,
    value_of,
)

ARRAY = Array(7.0, 16.0, 10, 5000.0, 2000.0)
NO_LAG = dict.fromkeys(MODES, np.zeros(1))


def predictor(share, off=lambda s, u: s, **others):
    given = {"gap_error": 0.0, "range": (-9.0, 9.0), "lags": NO_LAG, "coexisting": 0.0} | others
    return Predictor(share, off, **given)


def cells(radius=7.0, start=500.0, count=4096, squeezed=0.0):
    """Cells whose stiffness is their place in line, 0 to 1."""
    level = (np.arange(count) + 0.5) / count
    return Cells(
        np.full(count, radius),
        level,
        np.full(count, squeezed),
        np.full(count, start),
        level[::-1],
        np.full(count, 0.5),
    )


def devices(count=1, **changes):
    still = Devices(np.zeros(count), np.zeros(count), *(np.zeros((2, count)) for _ in range(3)))
    return still._replace(**changes)


def normal_shares(mean, std):
    return predictor(lambda r, g, size, ks: mean + std * norm.ppf(ks))


def test_two_normal_populations_follow_the_error_function():
    """Displacements N(d1, σ1²), N(d2, σ2²): recoveries and purities at a cut are those of erf."""
    (d1, s1), (d2, s2) = (0.2, 0.1), (0.5, 0.15)
    paths = tuple(
        make_paths(ARRAY, cells(), devices(), k, normal_shares(d, s))
        for k, (d, s) in enumerate(((d1, s1), (d2, s2)))
    )
    cuts = np.array([600.0, 650.0, 700.0])
    purity, recovery = qualities(paths, (0.25, 0.75), cuts, ARRAY.length_um)
    share = (cuts - 500) / 500
    below_1, above_2 = norm.cdf((share - d1) / s1), norm.sf((share - d2) / s2)
    np.testing.assert_allclose(recovery[0, 1, 0], below_1, atol=5e-4)
    np.testing.assert_allclose(recovery[1, 1, 0], above_2, atol=5e-4)
    pure = 0.25 * below_1 / (0.25 * below_1 + 0.75 * (1 - above_2))
    np.testing.assert_allclose(purity[0, 1, 0], pure, atol=1e-3)


def test_equal_scatter_is_cut_in_the_middle():
    paths = tuple(
        make_paths(ARRAY, cells(), devices(), k, normal_shares(d, 0.1))
        for k, d in enumerate((0.6, 0.3))
    )
    split = best_split(paths, (0.5, 0.5), np.linspace(0, 2000, 2001))
    assert split.upper == 0
    assert split.cut_um == pytest.approx(500 + 500 * 0.45, abs=2)
    expected = norm.cdf(0.15 / 0.1)
    assert split.robust == pytest.approx(expected, abs=2e-3)
    np.testing.assert_allclose(split.purity, expected, atol=2e-3)


def test_robust_is_what_nine_of_ten_devices_exceed():
    """The error of the prediction moves all cells of a population: a device gives all or half."""
    off = devices(20, deviate=np.array([[0.0] * 20, [-1.0] * 3 + [1.0] * 17]))
    shifted = predictor(lambda r, g, size, ks: 0.5 + 0 * ks, off=lambda s, u: s + 0.3 * u)
    paths = (
        make_paths(ARRAY, cells(), off, 0, normal_shares(0.0, 0.01)),
        make_paths(ARRAY, cells(), off, 1, shifted),
    )
    split = best_split(paths, (0.5, 0.5), np.array([700.0]))
    np.testing.assert_allclose(split.value, [0.0] * 3 + [1.0] * 17)
    assert split.robust == 0.0
    assert best_split(paths, (0.5, 0.5), np.array([550.0])).robust == pytest.approx(1.0)


def test_numerical_error_is_a_gap_that_a_device_shares():
    two = devices(2, numerical=np.array([[1.0, -1.0], [0.0, 0.0]]))
    known = predictor(lambda r, g, size, ks: g / 100, gap_error=0.1)
    path = make_paths(ARRAY, cells(squeezed=15.9), two, 0, known)
    np.testing.assert_allclose(path.share[0], 0.16 * np.exp(0.1))
    np.testing.assert_allclose(path.share[1], 0.16 * np.exp(-0.1))
    assert not path.lost.any()  # the gap itself is as wide as it is


def test_fabrication_reaches_the_prediction_and_the_pitch_stays():
    two = devices(2, off_radius_um=np.array([0.5, 0.0]), off_gap_um=np.array([0.0, -1.0]))
    asked = predictor(lambda r, g, size, ks: (r + g) / 100)
    path = make_paths(ARRAY, cells(), two, 0, asked)
    np.testing.assert_allclose(path.share[:, 0], [0.235, 0.22])
    np.testing.assert_allclose(path.lateral_um(1000.0)[:, 0], [523.5, 522.0])


def test_a_lag_is_made_in_the_first_period_and_kept():
    lags = dict(NO_LAG, bump=np.array([0.4]))
    path = make_paths(
        ARRAY, cells(), devices(), 0, predictor(lambda r, g, size, ks: 1 + 0 * ks, lags=lags)
    )
    period = ARRAY.periodicity * ARRAY.pitch_um
    for x, behind in ((0.0, 0.0), (period / 2, 6.0), (period, 12.0), (5000.0, 12.0)):
        assert path.lateral_um(x)[0, 0] == pytest.approx(500 + x / 10 - behind)


def test_a_lag_belongs_to_the_mode_of_the_cell():
    lags = {mode: np.array([value]) for mode, value in zip(MODES, (0.0, 0.2, 0.4), strict=True)}
    asked = predictor(lambda r, g, size, ks: ks, lags=lags)
    path = make_paths(ARRAY, cells(count=3), devices(), 0, asked)
    np.testing.assert_allclose(path.lag, [[0.2, 0.2, 0.2]])
    path = make_paths(ARRAY, cells(count=20), devices(), 0, asked)
    assert set(path.lag.ravel()) == {0.0, 0.2, 0.4}


def test_cells_stay_at_the_side_walls():
    high = make_paths(ARRAY, cells(start=1800), devices(), 0, normal_shares(1.0, 0.0))
    low = make_paths(ARRAY, cells(start=100), devices(), 0, normal_shares(-1.0, 0.0))
    assert high.lateral_um(5000.0).max() == 2000 - 7 and low.lateral_um(5000.0).min() == 7


def test_motions_that_coexist_are_a_mixture():
    """Half of the devices: a share of 0.3 is 30 % of cells that bump; the others: one motion."""
    two = devices(2, coexist=np.array([[0.2, 0.8], [0.2, 0.8]]))
    asked = predictor(lambda r, g, size, ks: 0.3 + 0 * ks, coexisting=0.5)
    path = make_paths(ARRAY, cells(count=1000), two, 0, asked)
    assert set(path.share[0]) == {0.0, 1.0} and path.share[0].mean() == pytest.approx(0.3)
    np.testing.assert_allclose(path.share[1], 0.3)


def test_a_cell_wider_than_the_gap_is_lost():
    """Neither outlet recovers it, it makes no outlet impure, and one that nothing else reaches has
    no purity."""
    two = devices(2, off_gap_um=np.array([0.0, -2.0]))
    wide = make_paths(ARRAY, cells(squeezed=15.0), two, 0, normal_shares(0.0, 0.0))
    thin = make_paths(ARRAY, cells(), two, 1, normal_shares(1.0, 0.0))
    split = best_split((wide, thin), (0.5, 0.5), np.array([700.0]))
    np.testing.assert_allclose(split.recovery, [[1.0, 0.0], [1.0, 1.0]])
    np.testing.assert_allclose(split.purity, [[1.0, np.nan], [1.0, 1.0]])
    assert split.value.tolist() == [1.0, 0.0]


def test_populations_that_are_the_same_are_not_parted():
    same = tuple(make_paths(ARRAY, cells(), devices(), k, normal_shares(0.3, 0.1)) for k in (0, 1))
    split = best_split(same, (0.5, 0.5), np.linspace(0, 2000, 2001))
    assert split.robust == pytest.approx(0.5, abs=2e-3)


def test_length_at_which_a_value_is_reached():
    """Without scatter the populations part as soon as their edges pass the cut."""
    apart = tuple(
        make_paths(
            ARRAY._replace(length_um=900.0),
            cells()._replace(start_um=np.linspace(470, 530, 4096)),
            devices(),
            k,
            normal_shares(s, 0.0),
        )
        for k, s in enumerate((0.0, 1.0))
    )
    found = course(apart, (0.5, 0.5), np.linspace(400, 1100, 1401), upper=1)
    assert found.value[0, 0] == pytest.approx(0.5, abs=0.01)
    assert found.value[-1, 0] == pytest.approx(1.0)
    # two bands 60 µm wide that are d apart: the value is 1/2 + d/120 until d = 60, x = 10 d
    np.testing.assert_allclose(found.lengths_um[:, 0], [480, 540], atol=5)


def test_first_reached_interpolates():
    value = np.array([[0.0, 1.0], [0.5, 1.0], [1.0, 1.0]])
    np.testing.assert_allclose(first_reached(np.array([0.0, 1.0, 2.0]), value, 0.75), [1.5, 0.0])


def test_middle_of_the_best_run():
    assert middle_of_best(np.array([0, 1, 1, 1, 0, 1.0])) == 2
    assert middle_of_best(np.array([0, 0, 2.0])) == 2


def test_a_second_stage_gets_what_leaves_the_first():
    """Recovery there is of what enters it; the mixture is that of the first outlet."""
    first = tuple(
        make_paths(ARRAY, cells(), devices(), k, normal_shares(d, 0.1))
        for k, d in enumerate((0.2, 0.6))
    )
    weights = [selected(p, 700.0, 2000.0) for p in first]
    entering = [w.mean() for w in weights]
    assert entering[0] == pytest.approx(norm.sf(2.0), abs=1e-3)
    second = tuple(
        make_paths(ARRAY, cells(), devices(), k, normal_shares(d, 0.0), w)
        for k, (d, w) in enumerate(zip((0.0, 1.0), weights, strict=True))
    )
    purity, recovery = qualities(second, (0.5, 0.5), np.array([200.0]), ARRAY.length_um)
    np.testing.assert_allclose(recovery[:, 1, 0, 0], [0.0, 1.0])
    mixed = entering[1] / sum(entering)
    assert purity[1, 1, 0, 0] == pytest.approx(mixed)
    assert value_of(purity, recovery)[1, 0, 0] == 0.0


def test_a_population_that_never_enters_has_no_recovery():
    """The other is then as pure as it can be; a device that nothing enters counts for nothing."""
    weight = np.array([[0.0], [1.0], [0.0]]) * np.ones(100)
    both = np.array([[1.0], [1.0], [0.0]]) * np.ones(100)
    three = devices(3)
    paths = (
        make_paths(ARRAY, cells(count=100), three, 0, normal_shares(0.0, 0.0), weight),
        make_paths(ARRAY, cells(count=100), three, 1, normal_shares(1.0, 0.0), both),
    )
    split = best_split(paths, (0.5, 0.5), np.array([700.0]))
    np.testing.assert_array_equal(split.purity, [[np.nan, 1, np.nan], [1, 1, np.nan]])
    np.testing.assert_array_equal(split.recovery, [[np.nan, 1, np.nan], [1, 1, np.nan]])
    np.testing.assert_array_equal(
        split.value, [np.nan, 1, np.nan]
    )  # of one type alone there is none
    assert split.robust == 1.0


def test_where_both_never_enter_nothing_is_the_smallest_of_both():
    weight = np.zeros((2, 100)), np.ones((2, 100))
    paths = tuple(
        make_paths(ARRAY, cells(count=100), devices(2), k, normal_shares(1.0 * k, 0.0), weight[k])
        for k in (0, 1)
    )
    split = best_split(paths, (0.5, 0.5), np.array([700.0, 800.0]))
    assert np.isnan(split.robust) and np.isnan(split.value).all() and split.score == 0.0
    assert split.upper == 1 and (split.recovery[1] == 1.0).all()


def test_a_wall_is_judged_by_other_draws_than_it_was_placed_by():
    """The best of many walls for some draws is not the best for others: theirs tell what it is."""

    def drawn(seed):
        rng = np.random.default_rng(seed)
        off = devices(16, deviate=rng.uniform(-1, 1, (2, 16)))
        move = {"off": lambda s, u: s + 0.5 * u}
        asked = [predictor(lambda *at, k=k: 0.5 * k + at[3], **move) for k in (0, 1)]
        return tuple(make_paths(ARRAY, cells(count=16), off, k, asked[k]) for k in (0, 1))

    cuts = np.linspace(300, 1500, 121)
    placing, telling = drawn(1), drawn(2)
    own = best_split(placing, (0.5, 0.5), cuts)
    told = best_split(telling, (0.5, 0.5), cuts, placing)
    assert told.cut_um == own.cut_um and told.upper == own.upper
    there = best_split(telling, (0.5, 0.5), np.array([own.cut_um]))
    np.testing.assert_array_equal(told.value, there.value)
    assert told.robust < best_split(telling, (0.5, 0.5), cuts).robust


def test_the_error_of_what_was_not_learnt_is_as_large_as_the_range():
    """As the interval of the angle is: between its ends nothing is more likely than they."""
    off = devices(201, deviate=np.stack([np.linspace(-1, 1, 201)] * 2))
    known = predictor(
        lambda *at: 1 + 0 * at[3], range=(-0.1, 1.0), learnt=lambda c: c.ks_uN_per_m < 0.5
    )
    path = make_paths(ARRAY, cells(count=100), off, 0, known)
    assert (path.share[:, :50] == 1.0).all()
    np.testing.assert_array_equal(path.share[:100, 50:], -0.1)
    np.testing.assert_array_equal(path.share[101:, 50:], 1.0)
