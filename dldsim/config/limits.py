"""What a run may cost at most. Limits change no result, so they are no setting of a run: they hold
for a process and those that it starts."""

import os

from pydantic import Field

from dldsim.config.explain import validate
from dldsim.config.sections import Section
from dldsim.errors import DldsimError

VARIABLE = "DLDSIM_LIMITS"
"""Environment variable that hands the limits to the processes of the jobs."""
NODE_BYTES = {"float32": 900, "float64": 1050}
"""Peak of memory per node of the box while a lattice is made, measured with 2e5 to 5e5 nodes."""
NODE_UPDATES_PER_S = 2e7
"""Of one core, for the estimate of a run's time."""


class Limits(Section):
    """What a run may cost at most by its estimate; beyond, it is refused before it starts."""

    memory_GB: float = Field(16.0, gt=0, le=1e6, description="memory of one run")
    run_hours: float = Field(48.0, gt=0, le=1e6, description="time of one run on one core")


def enforce(limits: Limits) -> None:
    """Let these limits hold in this process and in those that it starts."""
    os.environ[VARIABLE] = limits.model_dump_json()


def in_force() -> Limits:
    """The limits that hold here."""
    text = os.environ.get(VARIABLE)
    if not text:
        return Limits()
    import json

    return validate(Limits, json.loads(text))


def check_memory(
    nodes: float, precision: str, key: str, value: float, limits: Limits | None = None
) -> None:
    """Refuse a lattice that needs more memory than is allowed, by default by those in force."""
    needed, most = nodes * NODE_BYTES[precision] / 1e9, (limits or in_force()).memory_GB
    if needed > most:
        raise DldsimError(
            f"{key} = {value:g} asks for about {nodes:.2g} nodes and {needed:.2g} GB of memory; "
            f"limits.memory_GB is {most:g}.",
            key=key,
            value=value,
            allowed=f"what needs up to {most:g} GB",
            remedy=f"Raise {key} or make the domain smaller, or raise limits.memory_GB.",
        )


def check_time(nodes: int, steps: float, reason: str) -> None:
    """Refuse a run whose time steps take longer than is allowed; ``reason``: of a short step."""
    hours, most = nodes * steps / NODE_UPDATES_PER_S / 3600, in_force().run_hours
    if hours > most:
        raise DldsimError(
            f"This run would take up to {steps:.2g} time steps of {nodes:,} nodes, about "
            f"{hours:.2g} hours; limits.run_hours is {most:g}.{f' {reason}.' if reason else ''}",
            key="limits.run_hours",
            value=most,
            allowed=f"{hours:.2g} or more for this run",
            remedy="Take a softer membrane, a coarser lattice, a larger velocity or viscosity, or "
            "fewer rows; or raise limits.run_hours.",
        )
