"""A cell in shear as an assay: similarity, and what stress does."""

import numpy as np
import pytest

from dldsim.config.assay_sections import ShearAssay
from dldsim.config.sections import Cell, Flow, Numerics, Stiffness
from dldsim.experiments.passage import sight
from dldsim.experiments.shear import capsule_in_shear, inertia_ellipse
from dldsim.experiments.sheared import simulate_shear
from tests.experiments.test_constriction import SOFT

ASSAY = ShearAssay(
    kind="shear", stress_Pa=0.3, nodes_per_radius=4, strain_window=1.5, steady_change=0.05
)


def shear(assay=ASSAY, radius=6.0, stiffness=SOFT, viscosity=1.5):
    cell = Cell(shape="sphere", radius_um=radius, axis="z")
    flow = Flow(viscosity_mPa_s=viscosity)
    # No contact and no dashpots, whose lengths and times do not scale along.
    numerics = Numerics(contact_range_um=0, precision="float64")
    stiffness = stiffness.model_copy(update={"kvisc_nN_s_per_m": 0.0})
    return simulate_shear(stiffness, assay, cell, flow, numerics, run_id="a").row


@pytest.fixture(scope="module")
def row():
    return shear()


def test_a_sphere_is_drawn_out_along_the_flow(row):
    assert row["status"] == "converged"
    assert row["diameter_d_um"] > row["diameter_h_um"]
    d, h = row["diameter_d_um"], row["diameter_h_um"]
    assert row["deformation_index"] == pytest.approx((d - h) / (d + h))
    # Ca = μγ̇R/k_s: 0.3 · 6/5.1.
    assert row["capillary_number"] == pytest.approx(0.3 * 6 / 5.1)


def test_only_the_stress_counts_not_viscosity_and_rate(row):
    assert shear(viscosity=3.0)["deformation_index"] == pytest.approx(
        row["deformation_index"], rel=1e-9
    )


def test_half_the_size_at_twice_the_stress_is_the_same(row):
    """Surface moduli as they are; k_b scales with the area, k_v with the curvature."""
    small = SOFT.model_copy(update={"kb_pN_um": SOFT.kb_pN_um / 4, "kv_Pa": SOFT.kv_Pa * 2})
    found = shear(ASSAY.model_copy(update={"stress_Pa": 0.6}), radius=3.0, stiffness=small)
    assert found["deformation_index"] == pytest.approx(row["deformation_index"], rel=1e-9)


def test_the_scene_is_that_of_the_capsule_beside_the_boundary_integral(monkeypatch):
    """The same membrane of springs at Ca = σR/G_s = 0.3, by either way in: `capsule_in_shear` is
    what validation compares with others."""
    modulus = 3**0.5 / 4 * 20  # G_s [µN/m]
    bending = 0.01 * modulus * 6**2 / (3**0.5 / 2)  # k_b [pN µm] of κ = 0.01 G_s R²
    springs = Stiffness(
        ks_uN_per_m=20,
        kb_pN_um=bending,
        kal_uN_per_m=0,
        kag_uN_per_m=0,
        kv_Pa=1e9,
        kvisc_nN_s_per_m=0,
    )
    seen = []

    def look(scene):
        a, b, _ = inertia_ellipse(scene.positions(), scene.surface[0].faces)
        seen.append((a - b) / (a + b))
        return sight(scene)

    monkeypatch.setattr("dldsim.experiments.passage.sight", look)
    assay = ASSAY.model_copy(update={"stress_Pa": 0.3 * modulus / 6, "strain_max": 5.0})
    assay = assay.model_copy(update={"steady_change": 1e-6})
    shear(assay, stiffness=springs)
    expected = capsule_in_shear("springs", 0.3, radius=4)
    assert np.mean(seen[-5:]) == pytest.approx(expected.taylor_deformation, rel=0.03)


def test_less_stress_draws_out_less(row):
    assert (
        shear(ASSAY.model_copy(update={"stress_Pa": 0.1}))["deformation_index"]
        < row["deformation_index"]
    )
