"""Deformable cells in deterministic lateral displacement arrays, from simulation to design."""

__version__ = "0.1.0"

PHYSICS_VERSION = 5
"""Raised whenever a change of the simulator changes trajectories; a raise reruns simulations."""
