"""Laws of the analysis of variance."""

from itertools import product

import numpy as np
import pandas as pd
import pytest
from scipy.stats import f, f_oneway

from dldsim.analysis.anova import analyse, anova
from dldsim.errors import DldsimError
from dldsim.vocabulary import GEOMETRY

DI = {"1": 0.50, "2": 0.60, "3": 0.78}


def factorial(angle, radii=(6, 8, 10), gaps=(18, 20, 22), rows=(4, 6, 8), sets=DI):
    """One row per geometry and set; angle(P_r, P_g, N_p, DI) in degrees."""
    return pd.DataFrame(
        [
            {
                "pillar_radius_um": r,
                "gap_um": g,
                "periodicity": n,
                "stiffness_set": s,
                "deformation_index": sets[s],
                "migration_angle_deg": angle(r, g, n, sets[s]),
            }
            for r, g, n, s in product(radii, gaps, rows, sets)
        ]
    )


def noisy(seed=0, **effects):
    rng = np.random.default_rng(seed)
    return lambda r, g, n, d: (
        effects.get("r", 0) * r
        + effects.get("g", 0) * g
        + effects.get("n", 0) * n
        + effects.get("d", 0) * d
        + effects.get("rd", 0) * r * d
        + effects.get("gn", 0) * g * n
        + rng.normal(scale=0.1)
    )


def pick(table, model, term):
    rows = table[(table["model"] == model) & (table["term"] == term)]
    assert len(rows) == 1, (model, term, table)
    return rows.iloc[0]


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


def test_rows_without_angle_are_counted():
    frame = factorial(noisy(r=1))
    frame.loc[[3, 5], "migration_angle_deg"] = np.nan
    row = pick(anova(frame), "main_effects", "rows")
    assert "2 of 81" in row["note"]
    assert pick(anova(frame), "main_effects", "residual")["df"] == 79 - 8


def test_every_row_that_is_left_out_is_counted_once():
    frame = factorial(noisy(r=1)).assign(status="decided")
    frame.loc[[3, 5], "migration_angle_deg"] = np.nan
    frame.loc[5, "status"] = "stuck"
    frame.loc[5, "gap_um"] = np.nan
    frame.loc[7, "migration_angle_deg"] = np.inf
    frame.loc[[9, 10, 11], "stiffness_set"] = [None, np.nan, ""]
    table = anova(frame)
    rows = table[(table["model"] == "hierarchical") & (table["term"] == "rows")]["note"].tolist()
    assert sorted(rows) == [
        "1 of 81 rows left out: infinite migration_angle_deg (status decided: 1)",
        "1 of 81 rows left out: no gap_um (status stuck: 1)",
        "1 of 81 rows left out: no migration_angle_deg (status decided: 1)",
        "3 of 81 rows left out: no stiffness_set (status decided: 3)",
    ]
    assert pick(table, "main_effects", "residual")["df"] == 75 - 8
    few = [f"row {n}" for n in anova(frame.sample(frac=1, random_state=1))["note"] if "rows" in n]
    assert len(few) == 3 * 4  # whatever the index of the frame


def test_rows_beyond_the_bound_are_counted(monkeypatch):
    monkeypatch.setattr("dldsim.analysis.anova_rows.ROWS_MOST", 60)
    frame = factorial(noisy(r=1))
    table = anova(frame)
    assert "21 of 81 rows left out: at most 60" in pick(table, "main_effects", "rows")["note"]
    assert pick(table, "main_effects", "residual")["df"] == 60 - 8
    monkeypatch.setattr(
        "dldsim.analysis.anova_rows.ROWS_MOST", 170
    )  # two of each cell stay balanced
    table = anova(
        pd.concat(
            [
                frame.assign(
                    replicate=i, migration_angle_deg=lambda t, i=i: t["migration_angle_deg"] + i
                )
                for i in range(3)
            ]
        )
    )
    assert "81 of 243 rows left out: at most 170" in pick(table, "main_effects", "rows")["note"]
    assert pick(table, "main_effects", "pillar_radius_um")["p_permutation"] <= 0.01


def test_many_levels_are_refused():
    frame = factorial(noisy(r=1)).assign(gap_um=np.linspace(10, 20, 81))
    with pytest.raises(DldsimError, match="gap_um has 81 different values.*bin it"):
        anova(frame)


def test_rows_that_are_there_twice_are_refused_but_repeats_are_not():
    frame = factorial(noisy(seed=1, r=1))
    with pytest.raises(DldsimError, match="rows 1 and 82 below the header.*replicate"):
        anova(pd.concat([frame, frame[:1]]))
    again = pd.concat(
        [
            frame.assign(
                replicate=i, migration_angle_deg=lambda t, i=i: t["migration_angle_deg"] + 0.01 * i
            )
            for i in range(3)
        ]
    )
    table = anova(again)
    note = pick(table, "hierarchical", "residual")["note"]
    assert "162 degrees of freedom" in note and "simulation" not in note
    scatter = float(note.partition("squares ")[2].split()[0])
    assert scatter == pytest.approx(81 * 2 * 0.01**2, rel=1e-3)


def test_measured_angles_need_no_stiffness_set():
    frame = factorial(noisy(seed=3, r=0.5))
    table = anova(frame.drop(columns="stiffness_set"))
    same = anova(frame)
    assert pick(table, "hierarchical", "pillar_radius_um").equals(
        pick(same, "hierarchical", "pillar_radius_um")
    )
    assert "deformation_index" in pick(table, "hierarchical", "stiffness_set")["note"]


@pytest.mark.parametrize("factor", [-1, np.radians(1), 0.5])
def test_f_and_p_depend_on_no_unit(factor):
    frame = factorial(noisy(seed=3, r=0.5, n=-0.3))
    numbers = ["f_value", "p_value", "p_robust", "p_permutation", "partial_eta_sq"]
    one = anova(frame)[["model", "term", *numbers]].dropna()
    other = anova(frame.assign(migration_angle_deg=factor * frame["migration_angle_deg"]))
    other = other[["model", "term", *numbers]].dropna()
    pd.testing.assert_frame_equal(one.reset_index(drop=True), other.reset_index(drop=True))


@pytest.mark.parametrize(
    ("angle", "word"),
    [
        (lambda f: -f, "against the row shift"),
        (lambda f: np.radians(f), "radians"),
        (lambda f: 3 * f, "no array moves cells so far"),
        (lambda f: f, None),
    ],
)
def test_a_doubtful_unit_is_said(angle, word):
    draw = np.random.default_rng(2)
    frame = factorial(lambda r, g, n, d: np.degrees(np.arctan(1 / n)) * draw.choice([0.02, 1]))
    notes = anova(frame.assign(migration_angle_deg=angle(frame["migration_angle_deg"])))
    notes = notes[notes["term"] == "migration_angle_deg"]["note"]
    assert notes.str.contains(word).all() and len(notes) == 3 if word else notes.empty


def test_other_conditions_in_the_table_are_said():
    frame = factorial(noisy(r=1)).assign(height_um=np.where(np.arange(81) % 2, 20.0, 30.0))
    assert "2 different values" in pick(anova(frame), "main_effects", "height_um")["note"]


@pytest.mark.parametrize("type_", ["category", "Float64", object, "string", "float32"])
def test_types_of_columns_do_not_matter(type_):
    frame = factorial(noisy(seed=1, r=1)).astype({"gap_um": float}).round(6)
    for name in ("gap_um", "periodicity", "stiffness_set"):
        if name != "stiffness_set" or type_ not in ("Float64", "float32"):
            frame[name] = frame[name].astype(type_)
    expected = anova(factorial(noisy(seed=1, r=1)).round(6))
    pd.testing.assert_frame_equal(anova(frame), expected)


@pytest.mark.parametrize(
    "spoil, words",
    [
        (lambda f: f.drop(columns=["gap_um", "periodicity"]), ["lacks gap_um, periodicity"]),
        (lambda f: f.assign(deformation_index=np.nan), ["deformation_index", "calibration"]),
        (lambda f: f.assign(migration_angle_deg=np.nan), ["migration_angle_deg"]),
        (lambda f: f.assign(migration_angle_deg=3.0), ["no variance"]),
        (lambda f: f.assign(gap_um="wide"), ["gap_um", "'wide' is no number"]),
        (lambda f: f.iloc[:0], ["none of the 0 rows"]),
        (lambda f: f.assign(pillar_radius_um=-5), ["pillar_radius_um", "-5", "0.1 to 1000"]),
        (lambda f: f.assign(gap_um=f["gap_um"] * 1e-6), ["gap_um", "In m it would be 1"]),
        (lambda f: f.assign(periodicity=4.5), ["periodicity", "4.5", "whole numbers"]),
        (lambda f: f.assign(deformation_index=7), ["deformation_index", "7", "0 to 1"]),
        (lambda f: f.assign(migration_angle_deg=9999), ["9999", "-90 to 90"]),
        (lambda f: f.assign(gap_um=f["gap_um"] > 18), ["gap_um", "true or false"]),
    ],
)
def test_unusable_tables_are_refused(spoil, words):
    with pytest.raises(DldsimError) as error:
        anova(spoil(factorial(noisy())))
    assert all(word in str(error.value) for word in words)


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


def test_permutation_knows_that_rows_of_a_geometry_are_not_independent():
    """An effect of the radius on rows is noise between geometries: F is fooled, they are not."""
    draw = np.random.default_rng(11)
    offset = {key: draw.normal() for key in product((6, 8, 10), (18, 20), (4, 6))}
    sets = {str(i): 0.5 + 0.01 * i for i in range(12)}
    frame = factorial(
        lambda r, g, n, d: offset[r, g, n] + 0.01 * draw.normal(),
        gaps=(18, 20),
        rows=(4, 6),
        sets=sets,
    )
    table, tests = analyse(frame)
    row = pick(table, "main_effects", "pillar_radius_um")
    assert row["p_value"] < 1e-3 and row["p_permutation"] > 0.05
    icc = tests.query("model == 'main_effects' and test == 'correlation within geometry'")
    assert icc["statistic"].iloc[0] > 0.9


def test_permutation_finds_what_is_there():
    table = anova(factorial(noisy(seed=3, r=0.5, n=-0.3, d=3, rd=0.4)))
    for term in ("pillar_radius_um", "periodicity", "deformation_index"):
        assert pick(table, "main_effects", term)["p_permutation"] <= 0.005
    assert (
        pick(table, "hierarchical", "deformation_index:pillar_radius_um")["p_permutation"] <= 0.005
    )
    assert pick(table, "hierarchical", "gap_um:periodicity")["p_permutation"] > 0.01


def why_no_p(table):
    """Notes on p by permutation, of the first model."""
    assert table[table["model"] == "main_effects"]["p_permutation"].isna().all()
    return pick(table, "main_effects", "p_permutation")["note"]


def test_without_a_p_by_permutation_the_reason_is_said(monkeypatch):
    full = factorial(noisy(seed=3, r=0.5))
    assert "hold 57 of 73 rows" in why_no_p(anova(full.drop(range(0, 24, 3))))
    assert "5 are needed" in why_no_p(anova(factorial(noisy(r=1), gaps=(18,), radii=(6,))))
    monkeypatch.setattr("dldsim.analysis.permutation.VALUES", 81 * 50)
    assert "81 cells allow 50 permutations" in why_no_p(anova(full))


def test_many_rows_get_fewer_permutations_and_say_so(monkeypatch):
    full = factorial(noisy(seed=3, r=0.5))
    monkeypatch.setattr("dldsim.analysis.permutation.VALUES", 81 * 199)
    table = anova(full)
    assert pick(table, "main_effects", "pillar_radius_um")["p_permutation"] == 1 / 200
    assert "199 permutations instead of 999" in pick(table, "main_effects", "p_permutation")["note"]


def test_repeats_that_agree_leave_p_as_it_is():
    """Three equal rows for one: the same permutations, the same ratios."""
    full = factorial(noisy(seed=3, r=0.05, d=0.3))
    one = anova(full)
    three = anova(pd.concat([full.assign(replicate=i) for i in range(3)]))
    for model in ("main_effects", "hierarchical"):
        p = [
            t[(t["model"] == model)].dropna(subset=["p_permutation"])["p_permutation"].tolist()
            for t in (one, three)
        ]
        assert p[0] == p[1] and len(set(p[0])) > 2


def test_repeats_are_permuted_with_their_cell():
    draw = np.random.default_rng(5)
    full = factorial(noisy(seed=3, r=0.5, d=3))
    repeated = pd.concat(
        [
            full.assign(
                migration_angle_deg=full["migration_angle_deg"] + 0.01 * draw.normal(size=81)
            )
            for _ in range(3)
        ]
    )
    table = anova(repeated)
    for term in ("pillar_radius_um", "deformation_index"):
        assert pick(table, "main_effects", term)["p_permutation"] == 0.001
    assert pick(table, "main_effects", "gap_um")["p_permutation"] == pytest.approx(
        pick(anova(full), "main_effects", "gap_um")["p_permutation"], abs=0.05
    )


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
