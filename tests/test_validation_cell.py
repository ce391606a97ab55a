"""The validation cases of a cell in a fluid, with stand-ins for the runs."""

import pytest

from dldsim import validation_cell
from dldsim.shear import ShearRun


def test_capsules_are_compared_law_by_law(monkeypatch):
    def from_reference(law, ca, *, radius=6, **settings):
        deformation = 0.4 * (1 + radius**-validation_cell.ORDER)
        return ShearRun(deformation, 25.0, 0.0, None, 1.0, 1.1, 0.01, 1e-3, 9, 9, 9, 1.0)

    monkeypatch.setattr(validation_cell, "shear_run", from_reference)
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
