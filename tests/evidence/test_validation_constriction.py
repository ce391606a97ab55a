"""The cell in a constriction, with a stand-in for its runs."""

from types import SimpleNamespace

import numpy as np
import pytest

from dldsim.errors import DldsimError
from dldsim.evidence import validation_constriction
from dldsim.evidence.reference import read_reference
from dldsim.evidence.validation import run_case


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
    monkeypatch.setattr(validation_constriction, "simulate_constriction", passing(shift=0.1))
    rows = run_case("constriction-shape")
    marked = [row for row in rows if row["mark"] is not None]
    assert len(marked) == 8 * len(validation_constriction.THROAT_NODES)
    assert [row["passed"] for row in marked] == [True] * len(marked)
    assert all(row["relative_error"] == pytest.approx(0.1) for row in rows)
    assert "at most +10%" in rows[0]["note"]
    assert [row["note"][:5] for row in rows[:8:2]] == ["-30.0", "-20.0", "+0.0 ", "+30.0"]
    monkeypatch.setattr(validation_constriction, "simulate_constriction", passing(shift=0.12))
    assert not any(row["passed"] for row in run_case("constriction-shape"))


def test_a_cell_that_does_not_pass_fails_the_case(monkeypatch):
    monkeypatch.setattr(validation_constriction, "simulate_constriction", passing("stuck"))
    with pytest.raises(DldsimError, match="G7, throat 7 µm, height 16 µm: why"):
        list(validation_constriction.constriction_shape())
    [row] = run_case("constriction-shape")
    assert row["passed"] is False and "why" in row["note"]
