"""A red cell in shear: what the runs are set beside."""

import numpy as np
import pytest

from dldsim.config.sections import Cell, Flow, Numerics
from dldsim.evidence import validation_red_cell as cases
from dldsim.evidence.reference import read_reference
from dldsim.evidence.validation_assays import Sheared, sheared
from dldsim.solver import membrane as mb
from dldsim.solver.units import Units


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
    assert {row.variant for row in rows} == set(cases.MEMBRANES)
    rows = [row for row in rows if row.variant == "network"]
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


def test_membrane_has_the_moduli_of_the_literature():
    assert cases.RED_CELL.ks_uN_per_m == pytest.approx(5.3 * 4 / 3**0.5)
    assert cases.RED_CELL.kb_pN_um == pytest.approx(0.2 * 2 / 3**0.5)


def test_skalak_membranes_have_the_moduli_that_are_named():
    units = Units.of(0.5, Flow(), Numerics())
    network = units.stiffness(cases.RED_CELL)
    same, softer = (
        make(units) for name, make in cases.MEMBRANES.items() if name.startswith("Skalak")
    )
    assert same.skalak == pytest.approx(mb.shear_modulus(network["ks"]))
    assert softer.skalak / same.skalak == pytest.approx(2.5 / 5.3)
    for moduli in (same, softer):
        area = moduli.skalak * (1 + 2 * moduli.skalak_c)
        assert area == pytest.approx(units.surface_modulus(cases.SKALAK_AREA_MODULUS))
        assert moduli.kb == network["kb"]


def test_a_membrane_may_follow_from_the_units():
    cell = Cell(shape="biconcave", radius_um=cases.RADIUS_UM, axis="z")
    run = sheared(cases.MEMBRANES["Skalak, G 2.5 µN/m"], 3.0, cell, 4, 0.2, Flow())
    assert run.volume == pytest.approx(1, abs=1e-3) and run.area == pytest.approx(1, abs=1e-2)


def test_area_forces_reach_the_membrane():
    """Area terms that resist shear hold the cell together; isotropic ones let it be drawn out."""
    cell = Cell(shape="biconcave", radius_um=cases.RADIUS_UM, axis="z")
    elongation = {
        forces: sheared(cases.RED_CELL, 9.49, cell, 4, 8.0, Flow(), Numerics(area_forces=forces))
        .elongation[-10:]
        .mean()
        for forces in ("to-centroid", "gradient")
    }
    assert elongation["gradient"] > elongation["to-centroid"] + 0.05
