"""The capsule in shear, with a stand-in for its runs."""

import pytest

from dldsim.evidence import validation_capsule
from dldsim.experiments.shear import ShearRun


def steady_capsule(law, ca, *, radius=6, **settings):
    """Stand-in for a run."""
    deformation = 0.4 * (1 + radius**-validation_capsule.ORDER)
    return ShearRun(deformation, 25.0, 0.0, None, 1.0, 1.1, 0.01, 1e-3, 9, 9, 9, 1.0)


def test_capsules_are_compared_law_by_law(monkeypatch):
    monkeypatch.setattr(validation_capsule, "shear_run", steady_capsule)
    rows = list(validation_capsule.capsule_in_shear())
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
