"""The loop of a scene: its drive, towards a target or none, and what it leaves out."""

import numpy as np
import pytest

from dldsim.solver.images import images_share
from dldsim.solver.immersed_boundary import locate, spread, surround
from dldsim.solver.stream_collide import stream_collide
from dldsim.solver.streaming import BLOCK
from dldsim.solver.time_loop import CONTROL_INTERVAL, CONTROL_TIME, make_drive
from tests.solver.test_scene import make_cell

MOBILITY = np.array([[50.0, 0.0], [10.0, 40.0]])
TARGET = (0.02, -0.01)


def body_force(scene):
    return scene.fluid.parameters.body_force.copy()


def test_without_a_drive_the_body_force_stays():
    scene = make_cell()
    scene.fluid.set_body_force((1e-6, 2e-6, 0.0))
    scene.advance(2 * CONTROL_INTERVAL)
    assert np.array_equal(body_force(scene), [1e-6, 2e-6, 0.0])


@pytest.mark.parametrize("coupling", ["no-slip", "dissipative"])
def test_the_body_force_is_corrected_by_what_the_mean_velocity_lacks(coupling):
    scene = make_cell(coupling)
    scene.drive = make_drive(scene.fluid.lattice, MOBILITY, TARGET)
    scene.advance(CONTROL_INTERVAL - 2)
    assert not body_force(scene).any()
    scene.advance(2)
    # At rest all of the target is lacking.
    share = CONTROL_INTERVAL / CONTROL_TIME
    expected = share * np.linalg.solve(MOBILITY, TARGET)
    np.testing.assert_allclose(body_force(scene), [*expected, 0.0], rtol=1e-9)


def test_of_dilute_images_the_flow_that_meets_a_cell_is_controlled():
    """What the force drives without a cell, and the images' part of what the cells do; along axes
    that are controlled."""
    force = np.array([2e-6, 1e-6])
    share = CONTROL_INTERVAL / CONTROL_TIME
    for axial in (False, True):
        scene = make_cell()
        lattice = scene.fluid.lattice
        scene.fluid.set_body_force((*force, 0.0))
        scene.drive = make_drive(lattice, MOBILITY, TARGET, axial=axial, dilute=True)
        scene.drive.mean[:] = np.nan  # is measured
        scene.advance(CONTROL_INTERVAL)
        images = images_share((lattice.nx, lattice.row_shift), (0, lattice.ny), MOBILITY)
        met = MOBILITY @ force + images @ (scene.drive.mean - MOBILITY @ force)
        lacking = np.array(TARGET) - met
        driven = [lacking[0] / MOBILITY[0, 0], 0] if axial else np.linalg.solve(MOBILITY, lacking)
        expected = force + share * np.array(driven)
        np.testing.assert_allclose(body_force(scene)[:2], expected, rtol=1e-9)
        assert abs(scene.drive.mean).max() > 1e-6
    assert body_force(scene)[1] == force[1]


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("inertia", ["stokes", "navier-stokes"])
@pytest.mark.parametrize("collision", ["trt", "bgk"])
def test_a_fluid_with_fields_near_the_membrane_only_goes_the_same_way(
    precision, inertia, collision
):
    # Across both periodic sides. Velocities of far blocks stay as they were, others are the same.
    scenes = [
        make_cell(
            precision=precision,
            inertia=inertia,
            collision=collision,
            box=(24, 20, 13),
            place=(1.0, 19.0, 6.5),
        )
        for _ in range(2)
    ]
    for scene in scenes:
        scene.body.x[:, 0] += 0.2 * (scene.body.x[:, 0] - 1.0)
        scene.advance(10)
    few, every = (scene.fluid for scene in scenes)
    body, domain, stencil = scenes[0].body, scenes[0].domain, scenes[0].stencil
    locate(body.x, domain, stencil)
    surround(domain, stencil, few.near)
    assert 0 < few.near.mean() < 0.8
    push = np.random.default_rng(0).normal(size=body.force.shape) * 1e-4
    for fluid in (few, every):
        fluid.force[:] = 0
        spread(push, stencil, fluid.force)
    few.velocity[:] = 7.0
    for step in range(2):
        stream_collide(step, *few.state)
        stream_collide(step, every.f, every.force, every.velocity, every.near[:0], every.scheme)
    assert np.array_equal(few.f, every.f)
    ours, theirs = (
        fluid.velocity.reshape(3, -1)[:, : few.near.size * int(BLOCK)].reshape(3, -1, int(BLOCK))
        for fluid in (few, every)
    )
    near = few.near.astype(bool)
    assert np.array_equal(ours[:, near], theirs[:, near])
    assert (ours[:, ~near] == 7.0).all()


@pytest.mark.parametrize("coupling", ["no-slip", "dissipative"])
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_in_parts_a_cell_goes_the_same_way(coupling, precision):
    parts, whole = (make_cell(coupling, precision, box=(24, 20, 13)) for _ in range(2))
    for scene in (parts, whole):
        scene.fluid.set_body_force((1e-5, 0.0, 0.0))
    for steps in (2, 18, 4, 40, 12):
        parts.advance(steps)
    whole.advance(76)
    for ours, theirs in zip(parts.body, whole.body, strict=True):
        assert np.array_equal(ours, theirs)
    assert np.array_equal(parts.fluid.f, whole.fluid.f)
    assert np.array_equal(parts.fluid.velocity, whole.fluid.velocity)


def test_the_last_step_leaves_the_velocity_of_all_nodes():
    scene = make_cell(box=(24, 20, 13))
    scene.fluid.velocity[:] = 7.0
    scene.advance(2)
    assert not scene.fluid.near.all()
    assert np.abs(scene.fluid.velocity_field()).max() < 1e-3
