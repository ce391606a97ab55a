"""The sphere in a channel is set beside Faxén's law with the exact flow."""

import pytest

from dldsim.evidence import validation_assays


def test_the_law_is_that_of_the_duct(monkeypatch):
    """1 − 2.262 (a/h)², at 0.3 of the width 0.9491; the mean flow times 2.096 is the largest."""
    speed = 0.9491 * validation_assays.VELOCITY_MM_S * 2.09626
    row = {"deformation_index": 0.0, "steps": 1}
    monkeypatch.setattr(validation_assays, "carried_sphere", lambda radius, nodes: (speed, row))
    found = {c.parameter: c for c in validation_assays.sphere_in_channel()}
    assert found[0.3].reference == pytest.approx(0.9491, abs=1e-4)
    assert found[0.3].value == pytest.approx(found[0.3].reference, abs=1e-4)
    assert found[0.2].reference == pytest.approx(1 - 2.262 * 0.01, abs=1e-4)
    assert found[0.3].mark == validation_assays.MARK and found[0.5].mark is None
