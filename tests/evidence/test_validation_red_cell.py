"""Red cells in flow: what the runs are set beside, and the tube they are carried through."""

import numpy as np
import pytest

from dldsim.evidence import validation_red_cell as cases
from dldsim.evidence.reference import read_reference
from dldsim.evidence.validation_assays import Sheared
from dldsim.solver.flow import Fluid, advance_to_steady


def test_angles_are_those_of_the_donors():
    """At a shear rate that was measured its own row; none where nothing was."""
    row = read_reference(cases.ANGLES)[4]
    mean, low, high, source = cases.angles(row["shear_rate_per_s"] * 10.7e-3)
    assert (mean, low, high) == pytest.approx(
        (row["mean_deg"], row["lowest_deg"], row["highest_deg"])
    )
    assert "Fischer" in source and low < mean < high
    assert cases.angles(0.01) is None and cases.angles(30.0) is None


def test_red_cells_in_shear_are_marked_on_the_plateau_only(monkeypatch):
    strain = np.linspace(0, cases.STRAIN, 81)
    late = strain > cases.STRAIN - cases.AVERAGED
    run = Sheared(
        strain,
        np.where(late, 0.5, 0.0),
        0 * strain,
        np.where(late, 12.0, 0.0),
        1 + 0 * strain,
        1 + 0 * strain,
    )
    monkeypatch.setattr(cases, "sheared", lambda *given: run)
    rows = list(cases.red_cell_in_shear())
    indices = {row.parameter: row for row in rows if row.quantity == "elongation index"}
    assert indices[30.0].reference == pytest.approx(0.605, abs=1e-3)
    assert indices[0.95].reference == pytest.approx(0.270, abs=1e-3)
    assert all(row.value == pytest.approx(0.5) for row in indices.values())
    assert [row.mark is not None for row in indices.values()] == [
        stress > cases.PLATEAU_PA for stress in indices
    ]
    angles = [row for row in rows if row.quantity == "inclination"]
    assert {row.parameter for row in angles} == {0.95, 3.0}
    assert all(row.value == pytest.approx(12.0) and row.mark < 0.4 for row in angles)


def test_lengths_in_the_tube_are_taken_at_the_velocity_of_the_cell(monkeypatch):
    first = read_reference(cases.LENGTHS)[0]
    seen = cases.Carried(7.4, first["cell_velocity_mm_s"], 0.0, 1.0, 2)
    monkeypatch.setattr(cases, "in_tube", lambda *given: seen)
    row = next(cases.red_cell_in_tube())
    assert row.reference == pytest.approx(first["length_um"])
    assert row.mark == pytest.approx(first["length_hi_um"] / first["length_um"] - 1)


def test_flow_in_the_tube_is_poiseuilles():
    """Mean velocity G R²/(8 ν) of the round section."""
    diameter = 12.4
    lattice, _ = cases.make_tube(diameter, 2, np.float64)
    fluid = Fluid(lattice, 1.25, "trt", False, np.dtype("float64"))
    force = 1e-5
    fluid.set_body_force((0.0, 0.0, force))
    advance_to_steady(fluid, diameter / 2)
    flux = fluid.velocity_field()[2].sum() / lattice.nz
    radius = diameter / 2
    assert flux == pytest.approx(np.pi * force * radius**4 / (8 * 0.25), rel=0.01)


def test_membrane_has_the_moduli_of_the_literature():
    given = cases.red_cell(kag_uN_per_m=7.0)
    assert given.ks_uN_per_m == pytest.approx(5.3 * 4 / 3**0.5)
    assert given.kb_pN_um == pytest.approx(0.2 * 2 / 3**0.5)
    assert given.kag_uN_per_m == 7.0
