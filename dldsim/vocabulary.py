"""Words that several floors share: statuses, modes, and names of groups of columns."""

SETTLED = ("converged", "periodic", "stationary")
"""Statuses of a motion whose angle is known."""
ALIKE, COEXISTING = "decided", "coexisting"
DECIDED = (ALIKE, COEXISTING)
"""Statuses of an outcome whose releases have all settled: in one motion, or in several."""
STUCK, UNSTABLE = "stuck", "unstable"
BROKEN = (STUCK, UNSTABLE, "failed")
"""Statuses of a run that broke off, and of an outcome without an angle."""
RELEASED, GONE_ON = "release", "settled"
"""How a run begins: with a release, or with the settled cell of a coarser run."""
BUMP = "bump"
MODES = (BUMP, "mixed", "zigzag", "none")
GEOMETRY = ["pillar_radius_um", "gap_um", "periodicity"]
"""The columns, and settings, that name an array."""
