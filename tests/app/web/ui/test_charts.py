"""Figures of the page."""

import pytest

from dldsim.app.web.api import answers, field_limits, specs
from dldsim.app.web.ui import candidate_charts, chart_style, domain_charts, search_charts
from dldsim.app.web.ui.parts import allowed
from tests.app.web.ui import made_answers
from tests.app.web.ui.made_answers import HIGH, LOW


def test_toolbar_of_charts_stays_in_the_margin():
    layout = chart_style.TEMPLATE.layout
    assert layout.modebar.orientation == "v" and layout.margin.r >= 45
    assert layout.legend.x == 0 and layout.legend.orientation == "h"
    assert domain_charts.index_strip((0.5, 0.7), {1: (0.6, 0.01)}).layout.margin.r >= 45


def test_hull_holds_all_points():
    square = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0), (1.0, 1.0), (1.0, 0.0)]
    assert set(domain_charts.hull(square)) == set(square[:4])
    assert domain_charts.hull(square)[0] == domain_charts.hull(square)[-1]


def test_array_is_drawn_to_scale_with_rows_shifted():
    design = {"pillar_radius_um": 5.0, "gap_um": 10.0, "periodicity": 4, "mode_1": "bump"} | {
        f"angle_1_{s}deg": 14.036 for s in ("", "low_", "high_")
    }
    figure = candidate_charts.array(design, [7.5])
    pillars = [s for s in figure.layout.shapes if s.fillcolor == chart_style.PILLAR]
    assert all(abs(s.x1 - s.x0 - 10) < 1e-9 for s in pillars)
    lowest = {s.x0 + 5: (s.y0 + 5) % 20 for s in pillars}
    assert lowest[20.0] == pytest.approx(5.0) and lowest[0.0] == pytest.approx(0.0)
    line = next(t for t in figure.data if t.mode == "lines")
    assert line.y[1] - line.y[0] == pytest.approx(20.0, abs=0.01)  # one pitch in N_p rows
    assert figure.layout.yaxis.scaleanchor == "x"


def test_surface_turns_its_axes():
    spec = specs.DesignSpec(deformation_index_1=LOW, deformation_index_2=HIGH)
    found = made_answers.result(spec)
    slices = [s.model_dump() for s in found.slices]
    designs = [d.model_dump() for d in found.designs]
    one = search_charts.surface(slices, "periodicity", "gap_um", designs).data[0]
    two = search_charts.surface(slices, "gap_um", "periodicity", designs).data[0]
    assert [list(r) for r in zip(*one.z, strict=True)] == [list(r) for r in two.z]


def test_parallel_lines_cover_every_feasible_trial():
    spec = specs.DesignSpec(deformation_index_1=LOW, deformation_index_2=HIGH)
    trials = [t.model_dump() for t in made_answers.result(spec).trials]
    figure = search_charts.parallel(trials, "robust")
    lines = sum(x is None for t in figure.data for x in t.x)
    assert lines == sum(t["feasible"] for t in trials)


@pytest.mark.parametrize(
    ("low", "high", "open_", "words"),
    [
        (0.0, 50.0, True, "above 0 to 50 µm"),
        (2.0, 100.0, False, "2 to 100 µm"),
        (0.0, None, False, "from 0 µm"),
        (None, None, False, "any"),
    ],
)
def test_allowed_range_in_words(low, high, open_, words):
    limit = field_limits.FieldLimit(
        name="x",
        minimum=low,
        exclusive_minimum=open_,
        maximum=high,
        default=None,
        unit="µm",
        description="",
    )
    assert allowed(limit) == words


def test_fan_has_both_populations_the_walls_and_the_cut():
    from dldsim.app.web.ui import outlet_charts

    found = answers.AtOutlets(**made_answers.at_outlets(["array"]))
    rows = (found.device_positions, found.device_exits, found.device_outlets)
    figure = outlet_charts.fan(*([r.model_dump() for r in part] for part in rows), 500.0)
    lines = [t for t in figure.data if t.type == "scatter" and t.name]
    assert [list(t.x) for t in lines] == [[0.0, 2.5, 5.0]] * 2
    assert lines[1].y[-1] == 400 + 5 * 2 * 40 + 50
    assert [sum(t.x) for t in figure.data if t.type == "bar"] == [1.0, 1.0]
    assert {s.y0 for s in figure.layout.shapes} == {500.0}
    low, high = figure.layout.yaxis.range
    assert low < 405 and high > 895


def test_predicted_and_simulated_exits_have_a_panel_each():
    from dldsim.app.web.ui import outlet_charts

    exits = [r.model_dump() for r in made_answers.at_outlets(["array"])["device_exits"]]
    cells = [{"population": 1, "exit_um": 480.0}, {"population": 2, "exit_um": None}]
    figure = outlet_charts.checked(exits, cells, 500.0)
    sums = [sum(trace.y) for trace in figure.data]
    assert sums == [1.0, 1.0, 1.0, 0.0]  # of the cells of type 2 none leaves
    assert {s.x0 for s in figure.layout.shapes} == {500.0}
