"""Laws of Sobol indices, partial dependence and fabrication risk, on a surrogate by hand."""

import numpy as np
import pytest

from dldsim.analysis import sensitivity, surrogate
from dldsim.analysis.regressors import angle_of
from dldsim.errors import DldsimError
from dldsim.tables.registry import COLUMNS
from tests.analysis.made_outcomes import CAPILLARY, make_outcomes


class Law:
    """Stands for a surrogate: any share of the bump displacement, inside everywhere."""

    def __init__(self, share):
        self.law = share

    def share(self, radius, gap, rows, cell):
        values = radius, gap, rows, cell.capillary_number
        return np.asarray(self.law(*np.broadcast_arrays(*map(np.atleast_1d, values))), float)

    def predict(self, *at):
        share = self.share(*at)
        return angle_of(share, np.broadcast_to(np.atleast_1d(at[2]), share.shape))

    def inside_domain(self, radius, gap, rows, cell):
        values = radius, gap, rows, cell.capillary_number
        return np.ones(np.broadcast(*map(np.atleast_1d, values)).shape, bool)


def test_sobol_indices_of_a_sum_by_hand():
    """tan θ = a r + b g: variances a² Δr²/12 and b² Δg²/12, no interaction, nothing else counts."""
    law = Law(lambda r, g, n, d: n * (0.002 * r + 0.001 * g))  # small: tan θ is θ
    outcomes = make_outcomes()
    table = sensitivity.sobol(law, outcomes, seed=1).set_index("factor")
    r, g = (0.002 * 5) ** 2, (0.001 * 8) ** 2
    assert table.loc["pillar_radius_um", "first_order"] == pytest.approx(r / (r + g), abs=0.03)
    assert table.loc["gap_um", "first_order"] == pytest.approx(g / (r + g), abs=0.03)
    for name in ("periodicity", "capillary_number"):
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
        "capillary_number",
    ]
    maps = sensitivity.partial_dependence(law, outcomes)
    assert ("pillar_radius_um", "gap_um") not in set(
        zip(maps["x_name"], maps["y_name"], strict=True)
    )
    assert max(asked) < 1e-9


def test_one_factor_alone_has_no_map():
    outcomes = make_outcomes(radii=(5.0,), rows=(6,), indices=(0.5,))
    maps = sensitivity.partial_dependence(Law(lambda r, g, n, d: 0.01 * g), outcomes)
    assert maps.empty and set(maps) == {c.name for c in COLUMNS["partial_dependence"]}


def test_partial_dependence_averages_over_the_runs():
    law = Law(lambda r, g, n, d: g / 100 + (r == 5) * 0.06 + d)
    maps = sensitivity.partial_dependence(law, make_outcomes())
    here = maps[(maps["x_name"] == "periodicity") & (maps["y_name"] == "gap_um")]
    expected = here["y"] / 100 + 0.02 + np.mean(list(CAPILLARY.values()))
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


def test_ca_is_spread_evenly_in_its_logarithm_and_shapes_each_as_often():
    outcomes = make_outcomes(radii=(5.0, 10.0)).assign(height_um=lambda t: 20.0 + t.index % 2)
    outcomes["cell_shape"] = np.where(np.arange(len(outcomes)) % 5, "biconcave", "sphere")
    seen = []

    class Seen(Law):
        def predict(self, radius, gap, rows, cell):
            seen.append(cell)
            return super().predict(radius, gap, rows, cell)

    table = sensitivity.sobol(Seen(lambda r, g, n, d: 0.01 * n * np.log(d)), outcomes, seed=1)
    assert {"capillary_number", "height_um", "cell_shape"} <= set(table["factor"])
    first = table.set_index("factor")["first_order"]
    assert first["capillary_number"] == pytest.approx(1, abs=0.03)
    middle = np.exp(np.mean(np.log([min(CAPILLARY.values()), max(CAPILLARY.values())])))
    assert np.median(seen[0].capillary_number) == pytest.approx(middle, rel=0.02)
    assert (seen[0].shape == "sphere").mean() == pytest.approx(0.5, abs=0.02)


def test_a_surrogate_that_does_not_vary_has_no_indices():
    with pytest.raises(DldsimError, match="same angle everywhere"):
        sensitivity.sobol(Law(lambda r, g, n, d: 0 * r), make_outcomes(), seed=1)
