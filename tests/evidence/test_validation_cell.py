"""The validation cases of a cell in a fluid, with stand-ins for the runs."""

from types import SimpleNamespace

import numpy as np
import pytest

from dldsim.errors import DldsimError
from dldsim.evidence import validation_cell
from dldsim.evidence.reference import read_reference
from dldsim.evidence.validation import run_case
from dldsim.evidence.validation_cell import LAST_STEP, Passage, critical_interval
from dldsim.experiments.shear import ShearRun
from dldsim.laws import critical_diameter
from dldsim.report import style, validation_figures
from dldsim.tables.parquet import read_table, write_table


def steady_capsule(law, ca, *, radius=6, **settings):
    """Stand-in for a run."""
    deformation = 0.4 * (1 + radius**-validation_cell.ORDER)
    return ShearRun(deformation, 25.0, 0.0, None, 1.0, 1.1, 0.01, 1e-3, 9, 9, 9, 1.0)


def test_capsules_are_compared_law_by_law(monkeypatch):
    monkeypatch.setattr(validation_cell, "shear_run", steady_capsule)
    rows = list(validation_cell.capsule_in_shear())
    keys = {(r.quantity, r.variant, r.parameter, r.resolution) for r in rows}
    assert len(keys) == len(rows)
    for row in rows:
        extrapolated = row.variant.endswith("extrapolated")
        if extrapolated:
            assert row.value == pytest.approx(0.4)
        assert (row.resolution is None) == extrapolated
        assert row.reference > 0 and row.source and row.parameter_of == "capillary number"
    assert sum(r.quantity == "inclination" for r in rows) == 2 * 9
    assert sum("extrapolated" in r.variant for r in rows) == 9 + 3
    assert sum("Huet" in r.variant for r in rows) == 10


# ------------------------------------------------------------------------------ rigid transition


def spheres_that_bump_from(critical, asked, monkeypatch):
    """Stand-in for the runs: one diameter divides zigzag and bump."""

    def passage(flow, diameter):
        asked.append(diameter)
        return Passage(diameter >= critical, 3, 0.05, 0.999)

    monkeypatch.setattr(validation_cell, "sphere_passage", passage)


def array(periodicity):
    return SimpleNamespace(geometry=SimpleNamespace(periodicity=periodicity))


@pytest.mark.parametrize("periodicity", [3, 10, 30])
@pytest.mark.parametrize("share", [0.75, 0.999, 1.001, 1.3])
def test_search_brackets_the_critical_diameter(monkeypatch, periodicity, share):
    asked, critical = [], share * critical_diameter(1, 1 / periodicity)
    spheres_that_bump_from(critical, asked, monkeypatch)
    low, high, passages = critical_interval(array(periodicity))
    assert low < critical <= high and high - low <= 1.01 * LAST_STEP
    assert {low, high} <= set(asked) and len(passages) == len(asked) == len(set(asked))


def test_transition_is_compared_with_law_and_bound(monkeypatch):
    spheres_that_bump_from(0.5, [], monkeypatch)
    monkeypatch.setattr(validation_cell, "sphere_flow", lambda n_p, pitch: array(n_p))
    rows = run_case("rigid-transition")
    marked = [row for row in rows if row["mark"] is not None]
    again = [row for row in rows if row["variant"] == "extrapolated"]
    assert len(marked) == len(validation_cell.TRANSITIONS) == (len(rows) - len(again)) / 4
    assert [row["parameter"] for row in again] == [5, 10]
    for row in marked:
        assert row["value"] == pytest.approx(0.5, abs=LAST_STEP / 2)
        assert row["reference"] == pytest.approx(1.4 * row["parameter"] ** -0.48)
        assert "deformation up to 0.050" in row["note"] and "0.10%" in row["note"]
    bounds = [r["reference"] for r in rows if r["quantity"].endswith("streamline bound")]
    laws = [critical_diameter(1, 1 / row["parameter"]) for row in marked]
    assert all(bound < law for bound, law in zip(bounds, laws, strict=True))


def test_a_small_sphere_zigzags_and_a_large_one_bumps():
    flow = validation_cell.sphere_flow(5, 20)
    small, large = (validation_cell.sphere_passage(flow, d) for d in (0.5, 0.8))
    assert (small.bumps, large.bumps) == (False, True)
    assert max(small.rows, large.rows) <= 6
    assert max(small.deformation, large.deformation) < 0.15
    assert small.volume_ratio == pytest.approx(1, abs=0.01)


# ---------------------------------------------------------------------------- constriction shape


def passing(status="converged", shift=0.0):
    """Stand-in for a run that passes the experiment's diameters, but for a factor 1 + shift."""

    def simulate(*args, **kwargs):
        rows = read_reference("constriction_diameters")
        d, h = (np.array([row[f"diameter_{axis}_um"] for row in rows]) for axis in "dh")
        between = np.array([[30.0], [6.0]])
        d, h = (np.insert(v * (1 + shift), 2, between[i]) for i, v in enumerate((d, h)))
        path = {
            "x_um": np.array([-30.0, -20, -9, 0, 30]),
            "diameter_d_um": d,
            "diameter_h_um": h,
            "area_ratio": np.full(5, 1.1),
        }
        return SimpleNamespace(row={"status": status, "stop_reason": "why"}, trajectory=path)

    return simulate


def test_positions_are_the_nearest_points_in_their_part_of_the_path(monkeypatch):
    monkeypatch.setattr(validation_cell, "simulate_constriction", passing(shift=0.1))
    rows = run_case("constriction-shape")
    marked = [row for row in rows if row["mark"] is not None]
    assert len(marked) == 8 * len(validation_cell.THROAT_NODES)
    assert [row["passed"] for row in marked] == [True] * len(marked)
    assert all(row["relative_error"] == pytest.approx(0.1) for row in rows)
    assert "at most +10%" in rows[0]["note"]
    assert [row["note"][:5] for row in rows[:8:2]] == ["-30.0", "-20.0", "+0.0 ", "+30.0"]
    monkeypatch.setattr(validation_cell, "simulate_constriction", passing(shift=0.12))
    assert not any(row["passed"] for row in run_case("constriction-shape"))


def test_a_cell_that_does_not_pass_fails_the_case(monkeypatch):
    monkeypatch.setattr(validation_cell, "simulate_constriction", passing("stuck"))
    with pytest.raises(DldsimError, match="G7, throat 7 µm, height 16 µm: why"):
        list(validation_cell.constriction_shape())
    [row] = run_case("constriction-shape")
    assert row["passed"] is False and "why" in row["note"]


# --------------------------------------------------------------------------------------- figures


@pytest.fixture
def table(monkeypatch, tmp_path):
    """Table `validation` of the three cases, with stand-ins for their runs."""
    monkeypatch.setattr(validation_cell, "shear_run", steady_capsule)
    monkeypatch.setattr(validation_cell, "simulate_constriction", passing(shift=0.02))
    monkeypatch.setattr(validation_cell, "sphere_flow", lambda n_p, pitch: array(n_p))
    spheres_that_bump_from(0.5, [], monkeypatch)
    rows = [
        row
        for name in ("capsule-in-shear", "rigid-transition", "constriction-shape")
        for row in run_case(name)
    ]
    write_table("validation", rows, tmp_path / "t.parquet", {"config_hash": "x", "seed": None})
    return read_table("validation", tmp_path / "t.parquet")


def test_rows_of_capsules_are_told_apart(table):
    rows = validation_figures.capsules(table)
    assert set(rows["law"]) == set(validation_cell.SMALL_DEFORMATION)
    counts = rows[rows["quantity"] == "Taylor deformation"]["kind"].value_counts()
    assert counts["resolved"] == 2 * counts["extrapolated"] == 24
    assert counts["published"] > 10 and counts["springs"] == 3 and counts["variant"] > 3


def test_figures_show_the_table(table):
    shape, *_ = validation_figures.draw_capsules(table).axes
    assert shape.get_xlim()[0] < 0.01
    [panel] = validation_figures.draw_transition(table).axes
    dots = [line for line in panel.lines if line.get_marker() == "o"]
    assert len(dots) == len(validation_cell.TRANSITIONS)
    at, value = dots[0].get_data()
    assert at[0] == pytest.approx(1 / validation_cell.TRANSITIONS[0][0], abs=0.01)
    assert value[0] == pytest.approx(0.5, abs=LAST_STEP)
    along, across = validation_figures.draw_constriction_shape(table).axes
    assert (along.get_ylabel(), across.get_ylabel()) == ("D [µm]", "H [µm]")
    for draw in ("capsules", "transition", "constriction_shape"):
        figure = getattr(validation_figures, f"draw_{draw}")(table)
        assert style.render(figure, "png").startswith(b"\x89PNG")
