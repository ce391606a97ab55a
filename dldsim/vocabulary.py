"""Words that several floors share: statuses, modes, and names of groups of columns."""

from collections.abc import Sequence

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


def together(bases: Sequence[str]) -> str:
    """What is said of candidates one by one, as one: with their numbers where it differs."""
    numbers: dict[str, list[str]] = {}
    for number, basis in enumerate(bases, start=1):
        numbers.setdefault(basis, []).append(str(number))
    if len(numbers) == 1:
        return bases[0]
    return "; ".join(f"{basis}: candidates {', '.join(own)}" for basis, own in numbers.items())
