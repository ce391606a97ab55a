"""The flow that runs and outcomes of these tests start from."""

import pytest

from dldsim.solver.flow import solve_empty_array
from tests.experiments.small_array import FLOW, GEOMETRY, NUMERICS


@pytest.fixture(scope="module")
def empty():
    """Flow through a small array of 16 nodes pitch."""
    return solve_empty_array(GEOMETRY, FLOW, NUMERICS)
