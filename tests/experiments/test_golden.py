"""Trajectories are those of the physics version; see golden.py for the rule of changing them."""

import pytest

from dldsim import PHYSICS_VERSION
from dldsim.solver import scene, time_loop
from tests.experiments.golden import RUNS, SET_3, array_path, read_golden

ACROSS_PROCESSORS = {"zigzag": 1e-7}
"""µm by which processors may differ, 1e-9 where nothing else is said; on one machine runs are equal
bit for bit. Seen, between vectors of 256 and 512 bits: 1.5e-8 in the zigzag run, close to pillars,
2e-11 in the others."""
CHANGED = 1e-6
"""µm by which a run must move if a constant of the physics changes by a tenth."""


def test_golden_runs_are_of_this_version():
    assert read_golden()["physics_version"] == PHYSICS_VERSION, (
        "PHYSICS_VERSION was raised: python -m tests.experiments.golden writes the golden runs anew"
    )


@pytest.mark.parametrize("name", RUNS)
def test_a_golden_run_is_what_it_was(name):
    bound = ACROSS_PROCESSORS.get(name, 1e-9)
    assert RUNS[name]() == pytest.approx(read_golden()[name], rel=0, abs=bound), (
        "trajectories have changed: raise PHYSICS_VERSION, or find out why"
    )


def test_a_run_is_repeated_bit_for_bit():
    assert array_path("bump", rows=2) == array_path("bump", rows=2)


def moved(**changes) -> float:
    """How far a change moves the first row of the golden run "bump" [µm]."""
    return abs(array_path("bump", rows=2, **changes)[0] - read_golden()["bump"][0])


@pytest.mark.parametrize("name", sorted({*type(SET_3).model_fields} - {"kv_Pa"}))
def test_a_membrane_modulus_shows(name):
    assert moved(stiffness=SET_3.model_copy(update={name: 1.1 * getattr(SET_3, name)})) > CHANGED


def test_volume_stiffness_shows_below_what_the_step_carries():
    assert moved(stiffness=SET_3.model_copy(update={"kv_Pa": 990.0})) == 0
    assert moved(stiffness=SET_3.model_copy(update={"kv_Pa": 50.0})) > CHANGED


@pytest.mark.parametrize("name", ["CONTACT_STRENGTH", "CONTACT_EXPONENT"])
def test_a_constant_of_the_contact_shows(name, monkeypatch):
    monkeypatch.setattr(scene, name, 1.1 * getattr(scene, name))
    assert moved() > CHANGED


def test_the_slip_shows(monkeypatch):
    along, across = time_loop.MEMBRANE_SLIP["compact"]
    for changed in ((1.1 * along, across), (along, 1.1 * across)):
        monkeypatch.setitem(time_loop.MEMBRANE_SLIP, "compact", changed)
        assert moved() > CHANGED


def test_reach_and_friction_show():
    assert moved(contact_range_um=1.65) > CHANGED
    golden = read_golden()["dissipative"][0]
    dragged = array_path(
        "bump", rows=2, coupling="dissipative", kernel="4-point", friction_nN_s_per_m=1.1 * 1.56
    )
    assert abs(dragged[0] - golden) > CHANGED
