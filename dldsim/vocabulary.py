"""Words that several floors share."""

SETTLED = ("converged", "periodic", "stationary")
"""Statuses of a motion whose angle is known."""
