"""Laws of the analysis of variance."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import f, f_oneway

from dldsim.analysis.anova import analyse, anova
from dldsim.vocabulary import GEOMETRY
from tests.analysis.made_factorial import factorial, noisy, pick


def residual_sum(data, categories, numbers=(), crossed=()):
    """Residual sum of squares by plain least squares: the slow twin."""
    blocks = [np.ones((len(data), 1))]
    indicators = {c: pd.get_dummies(data[c]).to_numpy(float) for c in categories}
    blocks += [*indicators.values(), *(data[[n]].to_numpy(float) for n in numbers)]
    for a, b in crossed:
        left = indicators[a] if a in indicators else data[[a]].to_numpy(float)
        blocks.append(np.einsum("ij,ik->ijk", left, indicators[b]).reshape(len(data), -1))
    matrix, y = np.hstack(blocks), data["migration_angle_deg"].to_numpy()
    return float(((y - matrix @ np.linalg.lstsq(matrix, y)[0]) ** 2).sum())


def test_one_factor_is_one_way_analysis():
    rng = np.random.default_rng(1)
    frame = factorial(
        lambda r, g, n, d: r + rng.normal(),
        gaps=(20,),
        rows=(6,),
        sets=dict.fromkeys("abcdefg", 0.5),
    )
    row = pick(anova(frame), "main_effects", "pillar_radius_um")
    groups = [g["migration_angle_deg"] for _, g in frame.groupby("pillar_radius_um")]
    expected = f_oneway(*groups)
    assert row["f_value"] == pytest.approx(expected.statistic)
    assert row["p_value"] == pytest.approx(expected.pvalue)
    assert row["df"] == 2


def test_single_levels_are_dropped_with_a_note():
    frame = factorial(noisy(r=1), gaps=(20,))
    table = anova(frame)
    assert "one level" in pick(table, "main_effects", "gap_um")["note"]
    assert np.isnan(pick(table, "main_effects", "gap_um")["sum_sq"])
    assert "gap_um:periodicity" not in set(table["term"])


def test_known_effects_are_found_and_absent_ones_are_not():
    table = anova(factorial(noisy(seed=3, r=0.5, n=-0.3, rd=0.4)))
    assert pick(table, "main_effects", "pillar_radius_um")["p_value"] < 1e-10
    assert pick(table, "main_effects", "gap_um")["p_value"] > 0.01
    assert pick(table, "hierarchical", "deformation_index:pillar_radius_um")["p_value"] < 1e-6
    assert pick(table, "hierarchical", "deformation_index:gap_um")["p_value"] > 0.01
    assert pick(table, "hierarchical", "gap_um:periodicity")["p_value"] > 0.01


@pytest.mark.parametrize("drop", [0, 9])
def test_type_two_is_nested_least_squares(drop):
    """Unbalanced too: SS(A) = RSS(terms without A) − RSS(those and A)."""
    frame = factorial(noisy(seed=5, r=0.4, g=-0.2, d=2, rd=0.3, gn=0.02))
    frame = frame.sample(len(frame) - drop, random_state=1)
    table = anova(frame)
    a, b, c = GEOMETRY
    d = "deformation_index"
    main = residual_sum(frame, GEOMETRY, [d])
    for name in GEOMETRY:
        without = residual_sum(frame, [f for f in GEOMETRY if f != name], [d])
        row = pick(table, "main_effects", name)
        assert row["sum_sq"] == pytest.approx(without - main)
        assert row["partial_eta_sq"] == pytest.approx((without - main) / without)
    row = pick(table, "main_effects", d)
    assert row["sum_sq"] == pytest.approx(residual_sum(frame, GEOMETRY) - main)

    every = [(d, a), (d, b), (d, c), (a, b), (a, c), (b, c)]
    full = residual_sum(frame, GEOMETRY, [d], every)
    assert pick(table, "hierarchical", "residual")["sum_sq"] == pytest.approx(full)
    for x, y in every:
        less = residual_sum(frame, GEOMETRY, [d], [p for p in every if p != (x, y)])
        assert pick(table, "hierarchical", f"{x}:{y}")["sum_sq"] == pytest.approx(less - full)
    # a main effect beside all terms that do not contain it
    others = [p for p in every if a not in p]
    rest = residual_sum(frame, [b, c], [d], others)
    with_a = residual_sum(frame, GEOMETRY, [d], others)
    assert pick(table, "hierarchical", a)["sum_sq"] == pytest.approx(rest - with_a)


def test_seed_model_hands_main_effects_to_the_interactions():
    """An angle without any interaction gets significant "interactions" from the seed's model."""
    table = anova(factorial(noisy(seed=2, r=0.5, n=-0.5)))
    seed = pick(table, "seed_interactions", "deformation_index:periodicity")
    assert seed["p_value"] < 1e-6 and seed["df"] == 2 and "comparison" in seed["note"]
    assert pick(table, "seed_interactions", "deformation_index:pillar_radius_um")["df"] == 3
    assert pick(table, "hierarchical", "deformation_index:periodicity")["p_value"] > 0.01


def test_the_parts_of_a_model_and_its_residual_make_up_all_rows():
    """Degrees of freedom of statsmodels' terms, intercept and residual; the seed's interactions
    have all levels of what has no main effect."""
    data = factorial(noisy(seed=2, r=0.5, n=-0.5))
    table = anova(data)
    for model in ("main_effects", "seed_interactions", "hierarchical"):
        parts = table[table["model"] == model]["df"].dropna().sum()
        assert parts == len(data) - 1, model


def test_gap_tied_to_radius_is_named_and_tested_as_one():
    """The source paper's design: gap = radius + 10 µm."""
    frame = factorial(noisy(seed=4, r=0.3, n=-0.4), gaps=(16, 18, 20))
    frame = frame[frame["gap_um"] == frame["pillar_radius_um"] + 10]
    table = anova(frame)
    for name in ("pillar_radius_um", "gap_um"):
        for model in ("main_effects", "seed_interactions", "hierarchical"):
            row = pick(table, model, name)
            assert np.isnan(row["f_value"]) and np.isnan(row["sum_sq"])
            assert "gap_um is a function of pillar_radius_um" in row["note"]
    joint = pick(table, "main_effects", "pillar_radius_um & gap_um")
    expected = residual_sum(frame, ["periodicity"], ["deformation_index"])
    expected -= residual_sum(frame, ["pillar_radius_um", "periodicity"], ["deformation_index"])
    assert joint["df"] == 2 and joint["sum_sq"] == pytest.approx(expected)
    assert pick(table, "main_effects", "periodicity")["p_value"] < 1e-6
    assert pick(table, "hierarchical", "(pillar_radius_um & gap_um):periodicity")["df"] == 4


def test_index_that_follows_from_geometry_is_not_separable():
    frame = factorial(noisy(seed=6, r=1), sets={"1": 0.5})
    frame["deformation_index"] = frame["pillar_radius_um"].map({6: 0.5, 8: 0.6, 10: 0.8})
    row = pick(anova(frame), "main_effects", "deformation_index")
    assert "pillar_radius_um" in row["note"] and np.isnan(row["f_value"])


def test_unfilled_cells_leave_their_interaction_out():
    frame = factorial(noisy(seed=7, r=1, g=1))
    frame = frame[~((frame["pillar_radius_um"] == 10) & (frame["gap_um"] == 18))]
    table = anova(frame)
    row = pick(table, "hierarchical", "pillar_radius_um:gap_um")
    assert np.isnan(row["df"]) and "cells" in row["note"]
    assert pick(table, "hierarchical", "pillar_radius_um:periodicity")["df"] == 4


def test_few_rows_get_the_models_they_can_carry():
    frame = factorial(noisy(seed=8, r=1), radii=(6, 8), gaps=(18, 20), rows=(4, 6), sets={"1": 0.5})
    table = anova(frame)
    assert pick(table, "hierarchical", "residual")["df"] == 4
    assert "residual degrees" in pick(table, "hierarchical", "gap_um:periodicity")["note"]
    saturated = anova(frame.iloc[[0, 3, 5, 6]])
    assert "no residual" in pick(saturated, "main_effects", "all")["note"]
    assert saturated["f_value"].isna().all()


def test_exact_fit_has_no_f():
    row = pick(anova(factorial(lambda r, g, n, d: 2.0 * r)), "main_effects", "pillar_radius_um")
    assert np.isnan(row["f_value"]) and row["sum_sq"] > 0 and "exactly" in row["note"]


@pytest.mark.parametrize("factor", [-1, np.radians(1), 0.5])
def test_f_and_p_depend_on_no_unit(factor):
    frame = factorial(noisy(seed=3, r=0.5, n=-0.3))
    numbers = ["f_value", "p_value", "p_robust", "p_permutation", "partial_eta_sq"]
    one = anova(frame)[["model", "term", *numbers]].dropna()
    other = anova(frame.assign(migration_angle_deg=factor * frame["migration_angle_deg"]))
    other = other[["model", "term", *numbers]].dropna()
    pd.testing.assert_frame_equal(one.reset_index(drop=True), other.reset_index(drop=True))


def test_omega_and_eta_by_hand():
    """One factor, balanced: ω² = (SS − df MSE) / (SS + (N − df) MSE)."""
    frame = factorial(noisy(seed=3, r=0.05), gaps=(20,), rows=(4,), sets={"1": 0.5})
    frame = pd.concat(
        [
            frame.assign(
                stiffness_set=str(i),
                migration_angle_deg=lambda t, i=i: (
                    t["migration_angle_deg"] + 0.1 * (i % 3) * (-1) ** i
                ),
            )
            for i in range(7)
        ]
    )
    row, rest = (pick(anova(frame), "main_effects", t) for t in ("pillar_radius_um", "residual"))
    error = rest["sum_sq"] / rest["df"]
    assert row["partial_omega_sq"] == pytest.approx(
        (row["sum_sq"] - 2 * error) / (row["sum_sq"] + (21 - 2) * error)
    )
    assert row["partial_omega_sq"] < row["partial_eta_sq"]


def test_robust_p_is_the_wald_test_with_hc3():
    """Two levels, one degree of freedom: (b/se)² with se from the sandwich written out."""
    frame = factorial(noisy(seed=5, r=0.1, n=0.2), radii=(6, 8), gaps=(20,), sets={"1": 0.5})
    frame = pd.concat(
        [
            frame,
            frame.assign(
                stiffness_set="2",
                migration_angle_deg=lambda t: (
                    t["migration_angle_deg"] + np.linspace(-1, 1, len(t)) ** 3
                ),
            ),
        ]
    )
    row = pick(anova(frame), "main_effects", "pillar_radius_um")
    x = np.column_stack(
        [
            np.ones(len(frame)),
            frame["pillar_radius_um"] == 8,
            pd.get_dummies(frame["periodicity"]).to_numpy(float)[:, 1:],
        ]
    ).astype(float)
    y = frame["migration_angle_deg"].to_numpy()
    bread = np.linalg.inv(x.T @ x)
    beta = bread @ x.T @ y
    leverage = np.einsum("ij,jk,ik->i", x, bread, x)
    meat = (x * ((y - x @ beta) / (1 - leverage))[:, None]).T
    covariance = bread @ (meat @ meat.T) @ bread
    p = f.sf(beta[1] ** 2 / covariance[1, 1], 1, len(y) - x.shape[1])
    assert row["p_robust"] == pytest.approx(p)


def test_diagnostics_tell_modes_from_noise():
    """Normal noise passes; two modes fail; unequal variance fails."""

    def of(angle, test):
        tests = analyse(factorial(angle))[1].set_index(["model", "test"])
        return tests.loc[("main_effects", test)]

    draw = np.random.default_rng(4)
    assert of(noisy(seed=1, r=1), "Shapiro–Wilk W")["p_value"] > 0.01
    modes = of(lambda r, g, n, d: draw.choice([0, 5]) + 0.1 * draw.normal(), "Shapiro–Wilk W")
    assert modes["p_value"] < 0.01
    unequal = of(lambda r, g, n, d: draw.normal() * (n - 3) ** 2, "Breusch–Pagan LM")
    assert unequal["p_value"] < 0.01


def test_ca_stands_beside_the_index():
    """An angle in ln Ca, which the index of three sets follows not: Ca tells more of it."""
    capillary = {"1": 0.1, "2": 0.4, "3": 0.037}
    frame = factorial(lambda r, g, n, d: 0.2 * r)
    frame["capillary_number"] = frame["stiffness_set"].map(capillary)
    rng = np.random.default_rng(3)
    frame["migration_angle_deg"] += np.log(frame["capillary_number"]) + rng.normal(
        scale=0.1, size=81
    )
    table, tests = analyse(frame)
    models = ["main_effects", "seed_interactions", "hierarchical"]
    assert list(dict.fromkeys(table["model"])) == [*models, "main_effects_ca", "hierarchical_ca"]
    assert set(tests["model"]) == set(table["model"])
    by_index = pick(table, "main_effects", "deformation_index")
    by_ca = pick(table, "main_effects_ca", "log_capillary_number")
    assert by_ca["partial_eta_sq"] > 0.95 > 0.8 > by_index["partial_eta_sq"] and by_ca["df"] == 1
    assert by_ca["p_permutation"] <= 0.01
    crossed = pick(table, "hierarchical_ca", "log_capillary_number:gap_um")
    assert crossed["p_value"] > 0.01
    # the models of the source's form do not notice it
    alone, _ = analyse(frame.drop(columns="capillary_number"))
    pd.testing.assert_frame_equal(alone, table[table["model"].isin(models)].reset_index(drop=True))


@pytest.mark.parametrize("spoil", [lambda c: c.where(c.index > 0), lambda c: 0 * c + 0.1])
def test_without_ca_in_each_row_or_a_difference_there_are_no_such_models(spoil):
    frame = factorial(noisy(r=1.0, d=2.0))
    frame["capillary_number"] = spoil(1 - frame["deformation_index"])
    assert not anova(frame)["model"].str.endswith("_ca").any()


def test_velocity_is_in_ca_and_no_doubt_of_its_models():
    frame = factorial(noisy(r=1.0, d=2.0)).assign(
        capillary_number=lambda t: 0.1 + 0.01 * (t.index % 5),
        mean_velocity_mm_s=lambda t: 1.0 + t.index % 2,
    )
    noted = anova(frame).query("term == 'mean_velocity_mm_s'")
    assert set(noted["model"]) == {"main_effects", "seed_interactions", "hierarchical"}
