"""Orders of convergence of critical gaps."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dldsim.evidence import convergence, critical_gaps
from dldsim.evidence.critical_gaps import REYNOLDS, SPACING
from tests.evidence.test_critical_gaps import SEARCH


def test_the_campaigns_own_value_need_not_be_named(config):
    """A campaign on another lattice compares its own critical gap with those of the finer ones."""
    numerics = config.numerics.model_copy(update={"spacing_um": 2.0})
    coarse = config.model_copy(update={"numerics": numerics})
    found = [
        s.rank for s in critical_gaps.searches(coarse) if s[:3] == SEARCH[:3] and s.knob == SPACING
    ]
    assert found == [0, 1, 2]
    rows = convergence.convergence_table(
        gaps_of(coarse, lambda h, re: 17 + 0.4 * h**2 - 3 * re), coarse
    )
    for row in rows:
        if row["knob"] == SPACING:
            assert len(row["steps"]) == 4 and row["observed_order"] == pytest.approx(2, rel=1e-6)
            assert row["error_um"] == pytest.approx(0.4 * 2.0**2)


@given(st.floats(0.3, 4), st.floats(-3, 3).filter(lambda c: abs(c) > 1e-2), st.floats(5, 30))
def test_the_order_of_a_power_is_observed(order, factor, limit):
    steps = (1.15, 0.86, 0.57)
    values = [limit + factor * h**order for h in steps]
    assert convergence.observed_order(steps, values) == pytest.approx(order, rel=1e-4)
    assert convergence.extrapolate(steps, values, order) == pytest.approx(limit, rel=1e-6)


@pytest.mark.parametrize("values", [(1.0, 2.0, 1.5), (1.0, 1.0, 1.0), (1.0, 2.0, 4.0)])
def test_no_order_where_values_oscillate_rest_or_diverge(values):
    assert convergence.observed_order((4.0, 2.0, 1.0), values) is None


def gaps_of(config, gap):
    """Rows of `critical_gaps` of the plan, the critical gap a function of spacing and Re."""
    rows = []
    for one in critical_gaps.searches(config):
        numerics = critical_gaps.search_settings(one, config)["numerics"]
        spacing, lag = numerics["spacing_um"], numerics["reynolds_max"]
        rows.append(
            {
                "search": critical_gaps.search_id(one),
                "pillar_radius_um": one.pillar_radius_um,
                "periodicity": one.periodicity,
                "stiffness_set": one.stiffness_set,
                "cell_shape": "biconcave",
                "cell_radius_um": 7.5,
                "spacing_um": spacing,
                "lag_number": lag,
                "critical_gap_um": gap(spacing, lag),
                "low_um": 16.99,
                "high_um": 17.01,
            }
        )
    return rows


def test_convergence_of_a_made_up_study(config):
    """Second order in the spacing, first in the numerical Reynolds number, each seen alone."""
    rows = convergence.convergence_table(
        gaps_of(config, lambda h, re: 17 + 0.4 * h**2 - 3 * re), config
    )
    assert len(rows) == 2 * len(critical_gaps.transitions(config.reference))
    for row in rows:
        order, error = {SPACING: (2, 0.4 * 1.25**2), REYNOLDS: (1, -3 * 0.15)}[row["knob"]]
        assert row["observed_order"] == pytest.approx(order, rel=1e-6)
        assert row["error_um"] == pytest.approx(error)
        assert row["range_um"] == pytest.approx(
            max(row["critical_gaps_um"]) - min(row["critical_gaps_um"])
        )


def test_a_missing_gap_leaves_no_order(config):
    rows = gaps_of(config, lambda h, re: None if h < 0.7 else 17.0)
    by_knob = itertools.groupby(
        convergence.convergence_table(rows, config), key=lambda row: row["knob"]
    )
    for knob, group in by_knob:
        for row in group:
            assert row["observed_order"] is None and row["note"], knob


def test_an_order_within_the_brackets_is_called_uncertain(config):
    rows = convergence.convergence_table(
        gaps_of(config, lambda h, re: 17 + 0.001 * h + 0.001 * re), config
    )
    assert all("uncertain" in row["note"] for row in rows)
