"""Laws of Sobol indices, partial dependence and fabrication risk, on a surrogate by hand."""

import numpy as np
import pandas as pd
import pytest

from dldsim.analysis import sensitivity, surrogate
from dldsim.analysis.regressors import angle_of
from dldsim.errors import DldsimError
from dldsim.tables.registry import COLUMNS
from tests.analysis.test_surrogate import make_outcomes


class Law:
    """Stands for a surrogate: any share of the bump displacement, inside everywhere."""

    def __init__(self, share):
        self.law = share

    def share(self, *at):
        radius, gap, rows, index, _ = np.broadcast_arrays(*map(np.atleast_1d, at))
        return np.asarray(self.law(radius, gap, rows, index), float)

    def predict(self, *at):
        share = self.share(*at)
        return angle_of(share, np.broadcast_to(np.atleast_1d(at[2]), share.shape))

    def inside_domain(self, *at):
        return np.ones(np.broadcast(*map(np.atleast_1d, at)).shape, bool)


def test_sobol_indices_of_a_sum_by_hand():
    """tan θ = a r + b g: variances a² Δr²/12 and b² Δg²/12, no interaction, nothing else counts."""
    law = Law(lambda r, g, n, d: n * (0.002 * r + 0.001 * g))  # small: tan θ is θ
    outcomes = make_outcomes()
    table = sensitivity.sobol(law, outcomes, seed=1).set_index("factor")
    r, g = (0.002 * 5) ** 2, (0.001 * 8) ** 2
    assert table.loc["pillar_radius_um", "first_order"] == pytest.approx(r / (r + g), abs=0.03)
    assert table.loc["gap_um", "first_order"] == pytest.approx(g / (r + g), abs=0.03)
    for name in ("periodicity", "deformation_index"):
        assert table.loc[name, "total_order"] == pytest.approx(0, abs=0.01)
    assert table["first_order"].to_numpy() == pytest.approx(table["total_order"], abs=0.05)
    assert (table["total_order_low"] <= table["total_order"] + 1e-9).all()
    assert set(table.reset_index()) == {c.name for c in COLUMNS["sobol"]}


def test_tied_parameters_are_one_factor():
    outcomes = make_outcomes(gaps=(15.0, 17.5, 20.0))
    outcomes = outcomes[outcomes["gap_um"] == outcomes["pillar_radius_um"] + 10]
    asked = []
    law = Law(lambda r, g, n, d: asked.append(np.abs(g - r - 10).max()) or 0.01 * g)
    table = sensitivity.sobol(law, outcomes, seed=1)
    assert table["factor"].tolist() == [
        "pillar_radius_um & gap_um",
        "periodicity",
        "deformation_index",
    ]
    maps = sensitivity.partial_dependence(law, outcomes)
    assert ("pillar_radius_um", "gap_um") not in set(
        zip(maps["x_name"], maps["y_name"], strict=True)
    )
    assert max(asked) < 1e-9


def test_partial_dependence_averages_over_the_runs():
    law = Law(lambda r, g, n, d: g / 100 + (r == 5) * 0.06 + d)
    maps = sensitivity.partial_dependence(law, make_outcomes())
    here = maps[(maps["x_name"] == "periodicity") & (maps["y_name"] == "gap_um")]
    expected = here["y"] / 100 + 0.02 + np.mean((0.5, 0.65, 0.78))
    assert here["share"].to_numpy() == pytest.approx(expected.to_numpy())
    assert sorted(here["x"].unique()) == [4, 5, 6, 7, 8, 9, 10]
    assert set(maps) == {c.name for c in COLUMNS["partial_dependence"]}


def test_fabrication_keeps_the_pitch_and_counts_by_hand():
    """Bump where P_r > 7.5: an array at 7.5 ± … has even odds, one five errors away none."""
    pitches = []

    def law(r, g, n, d):
        pitches.append(2 * r + g)
        return np.where(r > 7.6, 1.0, 0.0)

    outcomes = make_outcomes(gaps=(20.0, 22.0))
    table = sensitivity.fabrication(Law(law), outcomes, [0.1, 0.5], seed=3, moved_deg=0.5)
    kept = {round(p, 6) for p in np.concatenate(pitches)}
    assert kept == {2 * r + g for r in (5.0, 7.5, 10.0) for g in (20.0, 22.0)}
    risk = table.groupby(["pillar_radius_um", "radius_error_um"])["mode_change_probability"].mean()
    assert risk[7.5, 0.1] == pytest.approx(0.159, abs=0.03)  # beyond one standard deviation
    assert risk[7.5, 0.5] == pytest.approx(0.421, abs=0.03)
    assert risk[5.0, 0.5] == risk[10.0, 0.1] == 0
    assert (table["moved_probability"] == table["mode_change_probability"]).all()
    assert set(table) == {c.name for c in COLUMNS["fabrication"]}


def test_all_tables_of_a_fitted_surrogate():
    outcomes = make_outcomes(radii=(5.0, 10.0), indices=(0.5, 0.78)).assign(mode="bump")
    tables = sensitivity.examine(
        surrogate.fit(outcomes, seed=1),
        outcomes,
        {"radius_errors_um": [0.5], "moved_deg": 0.5},
        seed=1,
    )
    assert tables["sobol"].set_index("factor")["first_order"].idxmax() in ("gap_um", "periodicity")
    assert tables["sobol"]["inside_share"].iloc[0] == 1
    assert tables["fabrication"]["inside_share"].between(0, 1).all()
    # thin pillars at the edge of the domain: half of the errors lead out
    edge = tables["fabrication"].query("pillar_radius_um == 5")["inside_share"]
    assert edge.mean() < 0.75


NEEDED = [
    "pillar_radius_um",
    "gap_um",
    "periodicity",
    "stiffness_set",
    "deformation_index",
    "migration_angle_deg",
]


@pytest.fixture(scope="module")
def anybodys():
    return make_outcomes(radii=(5.0, 10.0), indices=(0.5, 0.78))[NEEDED]


@pytest.fixture
def learnt(monkeypatch):
    """What the surrogate of a table learns from, lengths over the cell radius, and the notes."""
    monkeypatch.setattr(sensitivity, "fit", lambda means, seed: means)
    monkeypatch.setattr(sensitivity, "sobol", lambda model, means, seed: means)

    def of(frame):
        means, notes = sensitivity.sobol_of_table(frame, seed=2)
        for name in ("pillar_radius_um", "gap_um"):
            means[name] /= means["cell_radius_um"]
        return means.drop(columns="cell_radius_um"), notes

    return of


@pytest.mark.parametrize(
    ("change", "note"),
    [
        (lambda f: f.assign(migration_angle_deg=-f["migration_angle_deg"]), "turned"),
        (lambda f: f.assign(migration_angle_deg=np.radians(f["migration_angle_deg"])), None),
        (lambda f: f.assign(migration_angle_deg=-0.37 * f["migration_angle_deg"]), "turned"),
        (
            lambda f: f.assign(pillar_radius_um=2 * f["pillar_radius_um"], gap_um=2 * f["gap_um"]),
            None,
        ),
        (lambda f: f.drop(columns="stiffness_set"), "stiffness_set"),
        (lambda f: f.astype({"periodicity": str}).astype({"periodicity": "category"}), None),
        (
            lambda f: pd.concat([f, f.assign(migration_angle_deg=np.nan, stiffness_set="x")[:3]]),
            "3 of 39 rows left out: no migration_angle_deg",
        ),
        (lambda f: pd.concat([f.assign(replicate=i) for i in (1, 2)]), "are repeats of 36"),
    ],
)
def test_what_is_learnt_of_a_table_depends_on_no_unit_sign_or_type(anybodys, learnt, change, note):
    expected, none = learnt(anybodys)
    found, notes = learnt(change(anybodys))
    pd.testing.assert_frame_equal(found, expected, rtol=1e-12)
    assert not none and (any(note in n for n in notes) if note else notes == [])


def test_indices_of_a_table_depend_on_no_sign_or_radius(anybodys):
    plain, _ = sensitivity.sobol_of_table(anybodys, seed=2)
    turned = anybodys.assign(migration_angle_deg=-anybodys["migration_angle_deg"])
    pd.testing.assert_frame_equal(sensitivity.sobol_of_table(turned, seed=2)[0], plain)
    other, _ = sensitivity.sobol_of_table(anybodys.assign(cell_radius_um=3.0), seed=2)
    pd.testing.assert_frame_equal(plain, other, rtol=1e-2, atol=1e-2)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda f: f.assign(cell_radius_um="7.5 um"), ["cell_radius_um", "'7.5 um' is no number"]),
        (lambda f: f.assign(cell_radius_um=7.5e-6), ["cell_radius_um", "In m it would be 7.5 µm"]),
        (lambda f: f.assign(height_um=np.arange(len(f)) % 2), ["differ in height_um"]),
    ],
)
def test_tables_that_no_surrogate_can_learn_are_refused(anybodys, change, words):
    with pytest.raises(DldsimError) as error:
        sensitivity.sobol_of_table(change(anybodys), seed=2)
    assert all(word in str(error.value) for word in words), error.value


def test_many_arrays_are_drawn_from_and_counted(anybodys, learnt, monkeypatch):
    monkeypatch.setattr(sensitivity, "LEARNT", 10)
    means, notes = learnt(anybodys)
    assert any("arrays: 8 of 18 left out" in note for note in notes), notes
    assert len(means) == 20


def test_a_surrogate_that_does_not_vary_has_no_indices():
    with pytest.raises(DldsimError, match="same angle everywhere"):
        sensitivity.sobol(Law(lambda r, g, n, d: 0 * r), make_outcomes(), seed=1)
