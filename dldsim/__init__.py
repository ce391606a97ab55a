"""Deformable cells in deterministic lateral displacement arrays, from simulation to design."""

import os

# One process is one core's work: threads of the numerical libraries do not make it faster, and on a
# machine with other work they wait for each other most of the time. The libraries read this when
# they are loaded, hence here; what the user has set is left as it is.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

__version__ = "0.1.0"

PHYSICS_VERSION = 7
"""Raised whenever a change of the simulator changes trajectories, or what is measured on them; a
raise reruns simulations."""
