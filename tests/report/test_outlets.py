"""What comes out of a device, as the pages show it."""

import numpy as np
import pandas as pd
import pytest

from dldsim.design.device_outcome import tables_of
from dldsim.report import outlet_figures
from dldsim.report.outcome_page import write_outcome_page
from dldsim.tables.parquet import write_table
from tests.design.test_device_outcome import BETWEEN, ask, outcome
from tests.report.html_page import Page

ABOUT = {
    "config_hash": "0123abcd",
    "seed": 7,
    "settings": {
        "design_requests": [{"name": "t", "radius_1_um": 6.0}],
        "arrays": [{"pillar_radius_um": 7.0}],
        "device": {"array_length_mm": 5.0},
        "holds_for": "discs of Ca 0.1",
    },
}


@pytest.fixture(scope="module")
def cascade():
    """Tables of two stages, the second fed by the upper outlet of the first."""
    request = ask(radius_2_um=7.5, radius_std_2_um=0.5, radius_std_1_um=0.5)
    first = outcome(request, device=BETWEEN)
    return tables_of([first, outcome(request, device=BETWEEN, inflow=first.inflow(2))])


def checked():
    checks = pd.DataFrame(
        [
            {
                "request": "t",
                "device": "d",
                "stage": 1,
                "population": k,
                "simulated": 10,
                "own": 9,
                "lost": 0,
                "open": 1,
                "failed": 0,
                "predicted": 0.95,
                "predicted_low": 0.9,
                "predicted_high": 1.0,
                "recovery": 0.9,
                "recovery_low": 0.6,
                "recovery_high": 0.99,
                "chance_outlet": 0.7,
                "chance_exit": 0.4 if k == 1 else 0.01,
                "agrees": k == 1,
            }
            for k in (1, 2)
        ]
    )
    cells = pd.DataFrame(
        [
            {
                "request": "t",
                "device": "d",
                "stage": 1,
                "cell": i,
                "population": 1 + i % 2,
                "radius_um": 6.0,
                "ks_uN_per_m": 15.0,
                "start_um": 400.0,
                "release_gap_fraction": 0.5,
                "status": "converged" if i else "stuck",
                "mode": "bump",
                "rows_completed": 20,
                "exit_um": 400.0 + 40 * i if i else None,
            }
            for i in range(10)
        ]
    )
    return {"device_checks": checks, "checked_cells": cells}


def page_of(tables, folder):
    for kind, table in tables.items():
        write_table(kind, table, folder / f"{kind}.parquet", ABOUT)
    write_outcome_page(folder, folder / "outcome.html")
    return Page(folder / "outcome.html")


def test_page_of_a_cascade_has_both_stages(cascade, tmp_path):
    page = page_of(cascade, tmp_path)
    assert "Stage 1" in page.text and "Stage 2" in page.text
    assert "Learnt: discs of Ca 0.1." in page.text and "“d”" in page.text
    results = [row for row in page.rows if row[2:3] in (["lower"], ["upper"])]
    assert [row[0] for row in results] == ["1", "1", "2", "2"]
    assert "Does the simulation agree" not in page.text
    assert page.sources and all(source.startswith("data:image/") for source in page.sources)


def test_page_shows_the_simulated_check(cascade, tmp_path):
    first = {kind: table[table["stage"] == 1] for kind, table in cascade.items()}
    page = page_of(first | checked(), tmp_path)
    assert "Does the simulation agree" in page.text
    agreement = [row for row in page.rows if len(row) == 11 and row[1] == "10"]
    assert [row[-1] for row in agreement] == ["yes", "no"]


def test_fan_has_the_cut_and_both_populations(cascade):
    first = {kind: table[table["stage"] == 1] for kind, table in cascade.items()}
    figure = outlet_figures.draw_fan(first)
    fan, histogram = figure.axes
    heights = [line.get_ydata()[0] for line in fan.lines if len(set(line.get_ydata())) == 1]
    assert 650.0 in heights
    assert fan.get_ylim()[0] < 400 < 900 < fan.get_ylim()[1]
    share = sum(bar.get_width() for bar in histogram.patches)
    assert share == pytest.approx(2.0, abs=1e-6)  # all cells of both types
    assert any("purity" in text.get_text() for text in fan.texts)


def test_check_shows_every_cell_that_leaves(cascade):
    tables = checked()
    first = cascade["device_outcomes"][cascade["device_outcomes"]["stage"] == 1]
    exits = cascade["device_exits"][cascade["device_exits"]["stage"] == 1]
    figure = outlet_figures.draw_check(exits, tables["checked_cells"], first)
    shown = np.concatenate([axes.lines[0].get_xdata() for axes in figure.axes])
    np.testing.assert_allclose(np.sort(shown), 400 + 40 * np.arange(1, 10))
