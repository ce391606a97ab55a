"""Figures of validation cases, drawn from stand-ins for their runs."""

import pytest

from dldsim.evidence import validation_capsule, validation_constriction, validation_transition
from dldsim.evidence.validation import run_case
from dldsim.evidence.validation_transition import LAST_STEP
from dldsim.report import style, validation_cell_figures
from dldsim.tables.parquet import read_table, write_table
from tests.evidence.test_validation_capsule import steady_capsule
from tests.evidence.test_validation_constriction import passing
from tests.evidence.test_validation_transition import array, spheres_that_bump_from


@pytest.fixture
def table(monkeypatch, tmp_path):
    """Table `validation` of the three cases, with stand-ins for their runs."""
    monkeypatch.setattr(validation_capsule, "shear_run", steady_capsule)
    monkeypatch.setattr(validation_constriction, "simulate_constriction", passing(shift=0.02))
    monkeypatch.setattr(
        validation_transition, "sphere_flow", lambda n_p, *rest, **height: array(n_p)
    )
    monkeypatch.setattr(validation_transition, "critical_follower", lambda flow: 0.3)
    spheres_that_bump_from(0.5, [], monkeypatch)
    rows = [
        row
        for name in ("capsule-in-shear", "rigid-transition", "constriction-shape")
        for row in run_case(name)
    ]
    write_table("validation", rows, tmp_path / "t.parquet", {"config_hash": "x", "seed": None})
    return read_table("validation", tmp_path / "t.parquet")


def test_rows_of_capsules_are_told_apart(table):
    rows = validation_cell_figures.capsules(table)
    assert set(rows["law"]) == set(validation_capsule.SMALL_DEFORMATION)
    counts = rows[rows["quantity"] == "Taylor deformation"]["kind"].value_counts()
    assert counts["resolved"] == 2 * counts["extrapolated"] == 24
    assert counts["published"] > 10 and counts["springs"] == 3 and counts["variant"] > 3


def test_figures_show_the_table(table):
    shape, *_ = validation_cell_figures.draw_capsules(table).axes
    assert shape.get_xlim()[0] < 0.01
    [panel] = validation_cell_figures.draw_transition(table).axes
    dots = [line for line in panel.lines if line.get_marker() == "o"]
    assert len(dots) == len(validation_transition.TRANSITIONS)
    at, value = dots[0].get_data()
    assert at[0] == pytest.approx(1 / validation_transition.TRANSITIONS[0][0], abs=0.01)
    assert value[0] == pytest.approx(0.5, abs=LAST_STEP)
    along, across = validation_cell_figures.draw_constriction_shape(table).axes
    assert (along.get_ylabel(), across.get_ylabel()) == ("D [µm]", "H [µm]")
    for draw in ("capsules", "transition", "constriction_shape"):
        figure = getattr(validation_cell_figures, f"draw_{draw}")(table)
        assert style.render(figure, "png").startswith(b"\x89PNG")
