"""Critical gaps by the surrogate are those of the law that made the outcomes."""

import numpy as np
import pandas as pd
import pytest

from dldsim.analysis import surrogate
from dldsim.analysis.transition import HEIGHT, transition_map
from dldsim.errors import DldsimError
from dldsim.laws import critical_diameter
from dldsim.report.transition_figures import draw_transition
from tests.analysis.made_outcomes import make_outcomes, make_survey, size_of


@pytest.fixture(scope="module")
def table():
    every = make_survey(150, 120)
    campaign, survey = every.iloc[::4], every.drop(every.index[::4])
    return transition_map(surrogate.fit(campaign, 1, survey))


def test_critical_gaps_are_those_of_the_law(table):
    known = table.dropna(subset="gap_over_2R")
    size = [
        2 * size_of(shape, ca, HEIGHT)
        for shape, ca in zip(known["cell_shape"], known["capillary_number"], strict=True)
    ]
    law = np.array(size) / critical_diameter(1, 1 / known["periodicity"].to_numpy())
    assert set(known["cell_shape"]) == {"biconcave", "sphere"}
    assert np.median(np.abs(2 * known["gap_over_2R"] / law - 1)) < 0.03
    assert (np.abs(2 * known["gap_over_2R"] / law - 1) < 0.12).mean() > 0.9


def test_the_interval_is_about_the_gap(table):
    known = table.dropna(subset="gap_over_2R")
    low, gap, high = (known[f"gap_over_2R{end}"] for end in ("_low", "", "_high"))
    assert ((low <= gap) & (gap <= high) & (low < high)).all()


def test_the_figure_has_a_panel_for_each_periodicity_and_a_line_for_each_shape(table):
    panels = draw_transition(table, 0.9).axes
    assert len(panels) == table["periodicity"].nunique()
    drawn = panels[0].lines[0].get_xydata()
    least = table["periodicity"].min()
    first = table[(table["periodicity"] == least) & (table["cell_shape"] == "biconcave")]
    np.testing.assert_allclose(drawn[:, 1], first["gap_over_2R"])


def test_a_height_that_was_not_learnt_is_refused():
    outcomes = make_outcomes().assign(height_um=15.0)
    with pytest.raises(DldsimError, match="2.67") as refusal:
        transition_map(surrogate.fit(pd.DataFrame(outcomes), 1))
    assert refusal.value.faults[0].key == "height/R"
