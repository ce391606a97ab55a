"""What the explicit step bears, predicted before a run."""

import numpy as np
import pytest

from dldsim.config.sections import Cell, Flow, Geometry, Numerics, Stiffness
from dldsim.solver import time_step as stability
from dldsim.solver.flow import Fluid, solve_empty_array
from dldsim.solver.immersed_boundary import interpolate, locate, spread
from dldsim.solver.lattice import make_lattice
from dldsim.solver.membrane_forces import elastic_forces
from dldsim.solver.scene import CellInFlow
from dldsim.solver.units import Units

SET_5 = Stiffness(
    ks_uN_per_m=20.3,
    kb_pN_um=0.35,
    kal_uN_per_m=40.6,
    kag_uN_per_m=500,
    kv_Pa=900,
    kvisc_nN_s_per_m=1.5,
)


def make_scene(stiffness=SET_5, edge_to_spacing=2.0, **numerics):
    numerics = Numerics(edge_to_spacing=edge_to_spacing, precision="float64", **numerics)
    lattice = make_lattice(np.zeros((20, 20), bool), 20, walls=False, dtype=np.float64)
    scene = CellInFlow(
        Fluid.of(lattice, numerics),
        Units.of(1.25, Flow(), numerics),
        Cell(shape="sphere", radius_um=5),
        stiffness,
        numerics,
        {},
    )
    scene.place((10.2, 9.7, 10.4))
    return scene


def dense_matrices(scene):
    """Stiffness K and mobility W of all vertex components, column by column."""
    x, size = scene.body.x, scene.body.x.size
    moduli = scene.moduli._replace(kb=5 * scene.moduli.kb, kv=0.0, kvisc=0.0)
    locate(x, scene.domain, scene.stencil)
    stiffness, mobility = np.empty((size, size)), np.empty((size, size))
    ahead, behind, velocity = (np.empty_like(x) for _ in range(3))
    for column in range(size):
        unit = np.zeros(size)
        unit[column] = 1
        unit = unit.reshape(x.shape)
        for force, sign in ((ahead, 1), (behind, -1)):
            elastic_forces(
                x + sign * 1e-5 * unit, 0 * x, scene.membrane, moduli, scene.scratch, force
            )
        stiffness[:, column] = (behind - ahead).ravel() / 2e-5
        density = np.zeros_like(scene.fluid.force)
        spread(unit, scene.stencil, density)
        interpolate(density, 0 * density, 0.0, scene.stencil, velocity)
        mobility[:, column] = velocity.ravel()
    return stiffness, mobility


@pytest.mark.parametrize("kernel", ["compact", "4-point"])
def test_frequency_is_the_largest_eigenvalue_of_mobility_times_stiffness(kernel):
    scene = make_scene(kernel=kernel)
    stiffness, mobility = dense_matrices(scene)
    exact = np.abs(np.linalg.eigvals(mobility @ stiffness)).max()
    # The spectrum is dense at its end: fifty iterations come within some per cent, from below,
    # where SAFETY leaves a factor of two.
    assert 0.93 * exact < stability.elastic_frequency(scene) < exact * (1 + 1e-6)


@pytest.mark.parametrize("coupling", ["no-slip", "dissipative"])
def test_margins_are_in_proportion_to_the_time_step(coupling):
    given = stability.margins(make_scene(coupling=coupling, velocity_lu=0.02))
    half = stability.margins(make_scene(coupling=coupling, velocity_lu=0.01))
    np.testing.assert_allclose(half, np.array(given) / 2, rtol=1e-9)


def test_a_refined_step_is_safe():
    stiff = SET_5.model_copy(update={"ks_uN_per_m": 5000.0, "kvisc_nN_s_per_m": 200.0})
    scene = make_scene(stiff)
    factor = stability.refinement(stability.margins(scene), scene.numerics)
    assert factor > 10
    finer = stability.refined(scene.numerics, factor)
    margins = stability.margins(make_scene(stiff, velocity_lu=finer.velocity_lu))
    assert max(margins) == pytest.approx(1, abs=1e-9)
    as_given = scene.numerics.model_copy(update={"time_step": "as-given"})
    assert stability.refinement(margins, as_given) == 1


@pytest.mark.parametrize("kernel", ["compact", "linear"])
def test_the_limit_falls_with_little_viscosity(kernel):
    taus = [0.505, 0.52, 0.55, 0.65, 0.8, 1.25]
    limits = [stability.frequency_limit(tau, kernel) for tau in taus]
    assert np.all(np.diff(limits) > 0)
    assert limits[0] == pytest.approx(limits[1] / 4)  # in proportion to the viscosity


def test_membrane_twice_as_stiff_as_the_threshold_blows_up_and_a_quarter_as_stiff_holds():
    threshold = stability.THRESHOLDS[1.25]
    for ratio, holds in ((2.0, False), (0.25, True)):
        scene = make_scene(edge_to_spacing=1.0, kernel="compact")
        factor = ratio * threshold / stability.elastic_frequency(scene)
        scaled = {name: factor * getattr(scene.moduli, name) for name in ("ks", "kal", "kag")}
        scene.moduli = scene.moduli._replace(**scaled)
        scene.body.x[:, 0] += 0.05 * (scene.body.x[:, 0] - 10.2)
        scene.advance(400)
        assert (scene.sample().trouble() is None) == holds


def test_a_slower_empty_flow_is_the_one_solved_at_that_velocity():
    geometry = Geometry(pillar_radius_um=5, gap_um=12, periodicity=4)
    flow, numerics = Flow(height_um=12.0), Numerics(velocity_lu=0.02, precision="float64")
    slower = solve_empty_array(geometry, flow, numerics).slower(4)
    solved = solve_empty_array(geometry, flow, stability.refined(numerics, 4))
    assert slower.numerics == solved.numerics
    np.testing.assert_allclose(slower.body_force, solved.body_force, rtol=1e-7)
    np.testing.assert_allclose(slower.populations, solved.populations, atol=1e-8)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({}, None),
        ({"kv_Pa": 0}, "volume term"),
        ({"kb_pN_um": 2000}, "hinges"),
        ({"ks_uN_per_m": 0, "kal_uN_per_m": 0, "kag_uN_per_m": 1, "kb_pN_um": 0}, "stretches"),
    ],
)
def test_what_no_time_step_cures_is_said(change, words):
    found = stability.incurable(make_scene(SET_5.model_copy(update=change)))
    assert len(found) == (words is not None)
    assert words is None or words in found[0]
