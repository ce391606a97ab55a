"""p by permutation: of cells and of geometries, not of rows."""

from itertools import product

import numpy as np
import pandas as pd
import pytest

from dldsim.analysis.anova import analyse, anova
from tests.analysis.made_factorial import factorial, noisy, pick


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
