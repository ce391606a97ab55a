"""The cases of the assays, with stand-ins for the runs: what is set beside what."""

from types import SimpleNamespace

import numpy as np
import pytest

from dldsim.evidence import validation_assays
from dldsim.evidence.small_deformation import moduli
from dldsim.evidence.validation_assays import third_harmonic
from dldsim.solver.membrane import make_membrane
from dldsim.solver.mesh import icosphere


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


def test_third_harmonic_of_a_bullet():
    """1 + w P₃ has w, moved or not; P₂ and the mesh have none."""
    x, faces = icosphere(8)
    membrane = make_membrane(x, faces)
    along = x[:, :1]
    p2, p3 = (3 * along**2 - 1) / 2, (5 * along**3 - 3 * along) / 2
    assert third_harmonic(5 * x, membrane) == pytest.approx(0, abs=1e-12)
    assert third_harmonic(x * (1 + 0.01 * p2), membrane) == pytest.approx(0, abs=1e-4)
    moved = x * (1 + 0.01 * p3) + [3.0, 1.0, 0.0]
    assert third_harmonic(moved, membrane) == pytest.approx(0.01, rel=0.01)


def test_bullets_are_set_beside_the_theory(monkeypatch):
    """u = u_max − k ρ² of the duct and μka² of the row belong together: with nothing but springs
    and the local term, w is what the flow was set to, but for the hinges."""
    asked = []

    def stand_in(stiffness, nodes, velocity):
        asked.append((stiffness.kag_uN_per_m, velocity))
        return 0.01, SimpleNamespace(volume_ratio=1.0, step=2)

    monkeypatch.setattr(validation_assays, "bullet", stand_in)
    rows = list(validation_assays.bullet_in_channel())
    first, height = rows[0], validation_assays.BULLET_HEIGHTS[0]
    assert 0.8 * height < first.reference < height
    assert first.mark == validation_assays.thickness_mark(first.resolution)
    peak, curvature = validation_assays.square_duct()
    given = moduli(validation_assays.NETWORK, validation_assays.BULLET_RADIUS_UM)
    # k = curvature u_max/(4 h²), u_max = peak U
    k = curvature * peak * asked[0][1] / (4 * validation_assays.WIDTH_UM**2)
    load = validation_assays.BULLET_FLOW.viscosity_mPa_s * k * validation_assays.BULLET_RADIUS_UM**2
    assert load / given.shear == pytest.approx(first.parameter)
    assert {kag for kag, _ in asked} == {0.0, validation_assays.GLOBAL_AREA}


def test_spheres_in_shear_are_averaged_late(monkeypatch):
    strain = np.linspace(0, validation_assays.STRAIN, 9)
    late = strain > validation_assays.STRAIN / 2
    run = validation_assays.Sheared(
        strain,
        0 * strain,
        np.where(late, 0.04, 9.0),
        np.where(late, 43.0, 0.0),
        1 + 0 * strain,
        1 + 0 * strain,
    )
    monkeypatch.setattr(validation_assays, "sheared", lambda *given: run)
    rows = list(validation_assays.spheres_in_shear())
    by = {row.quantity: row.value for row in rows}
    assert by["Taylor deformation"] == pytest.approx(0.04)
    assert by["inclination"] == pytest.approx(43.0)
    # The softer membrane at the same Ca deforms less: its global area term is stiffer beside it.
    soft, stiff = (
        next(r.reference for r in rows if r.variant == f"k_s {ks} µN/m" and r.parameter == 0.05)
        for ks in ("5.1", "20.3")
    )
    assert soft < stiff
