"""A run that costs too much is refused with the estimate, before it starts."""

import os

import pytest

from dldsim.config import limits
from dldsim.config.feasibility import check_array
from dldsim.config.limits import Limits
from dldsim.config.sections import Flow, Geometry, Numerics
from dldsim.errors import DldsimError

ARRAY = Geometry(pillar_radius_um=6, gap_um=18, periodicity=8), Flow()


@pytest.fixture(autouse=True)
def unlimited(monkeypatch):
    monkeypatch.delenv(limits.VARIABLE, raising=False)


def test_limits_hold_for_this_process_and_those_it_starts(monkeypatch):
    monkeypatch.setattr(os, "environ", {})
    assert limits.in_force() == Limits()
    limits.enforce(Limits(memory_GB=2, run_hours=1))
    assert limits.in_force() == Limits(memory_GB=2, run_hours=1)
    assert "run_hours" in os.environ[limits.VARIABLE]


def test_memory_is_estimated_before_a_lattice_is_made(monkeypatch):
    check_array(*ARRAY, Numerics())
    with pytest.raises(DldsimError, match=r"GB of memory; limits.memory_GB is 16") as caught:
        check_array(*ARRAY, Numerics(spacing_um=0.05))
    assert caught.value.key == "numerics.spacing_um"
    check_array(*ARRAY, Numerics(spacing_um=0.05), Limits(memory_GB=1e4))
    monkeypatch.setenv(limits.VARIABLE, Limits(memory_GB=0.001).model_dump_json())
    with pytest.raises(DldsimError, match="0.001"):
        check_array(*ARRAY, Numerics())


def test_time_is_estimated_from_steps_and_nodes():
    limits.check_time(30_000, 1e6, "")
    with pytest.raises(DldsimError) as caught:
        limits.check_time(30_000, 1e9, "time step shortened by 1e+03: a reason")
    text = str(caught.value)
    assert "1e+09 time steps of 30,000 nodes, about 4.2e+02 hours" in text
    assert "shortened by 1e+03: a reason." in text and "limits.run_hours" in caught.value.remedy
