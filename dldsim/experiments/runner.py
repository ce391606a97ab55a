"""One loop for every experiment: advance a scene, look at it, stop when there is a reason."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

from dldsim.config.sections import Numerics
from dldsim.solver.observe import Sample
from dldsim.solver.scene import CellInFlow
from dldsim.vocabulary import STUCK, UNSTABLE

Progress = Callable[[str], None] | None

CURES = (
    "usual cures: finer numerics.spacing_um, lower numerics.velocity_lu, or numerics.kernel 4-point"
)


class Stop(NamedTuple):
    """Why a run has ended: ``status``, a word of the `vocabulary`, and ``reason``, a sentence."""

    status: str
    reason: str


class Patience(NamedTuple):
    """A cell is stuck that gains less than ``distance`` along x in ``steps``; lattice units."""

    distance: float
    steps: float


def advance_until(
    scene: CellInFlow,
    chunk: int,
    watch: Callable[[Sample], Stop | None],
    *,
    patience: Patience | None = None,
    cures: str = CURES,
    progress: Progress = None,
    where: Callable[[Sample], tuple[str, float]] | None = None,
) -> Stop:
    """Advance a scene by ``chunk`` steps, an even number, at a time, until it stops; says why.

    ``watch`` is shown every sound sample, the start included, and ends the run with a Stop. A scene
    that has left its safe range (`Sample.trouble`) ends it as unstable, with the ``cures`` in the
    reason, and a cell that outlasts the ``patience`` as stuck. ``where`` tells ``progress``, at
    most once a second, the place in words and the share of the way that is done.
    """
    first = farthest = scene.sample()
    stop = watch(first)
    begun = told = time.perf_counter()
    while stop is None:
        scene.advance(chunk)
        sample = scene.sample()
        if trouble := sample.trouble():
            return Stop(UNSTABLE, f"{trouble} at step {sample.step}; {cures}")
        stop = watch(sample)
        if patience:
            if sample.centre[0] > farthest.centre[0] + patience.distance:
                farthest = sample
            elif sample.step - farthest.step > patience.steps:
                stop = Stop(STUCK, _no_headway(patience, scene))
        now = time.perf_counter()
        if progress and now - told > 1:
            told = now
            updates = scene.fluid.lattice.nodes * (sample.step - first.step)
            said = [f"step {sample.step:,}", f"{updates / (now - begun) / 1e6:.0f} MLUPS"]
            if where:
                words, done = where(sample)
                left = (now - begun) * (1 / max(done, 1e-3) - 1)
                said += [words, f"about {max(left, 0):.0f} s left"]
            progress(", ".join(said))
    return stop


def _no_headway(patience: Patience, scene: CellInFlow) -> str:
    units = scene.units
    return (
        f"the cell moved less than {patience.distance * units.spacing_um:.1f} µm while the mean "
        f"flow moved {patience.steps * units.velocity_lu * units.spacing_um:.0f} µm "
        f"(step {scene.steps})"
    )


def again_if_unstable(
    attempt: Callable[[float], Any], numerics: Numerics, progress: Progress
) -> Any:
    """The result of ``attempt(factor)``: of one more with half the step where the first, of factor
    1, left its safe range, if the step is ours to choose.

    The margins are those of a scene at rest. A membrane that is squeezed to a third of its edges'
    length has more vertices at a node, and answers of elasticity and dashpots grow with their
    number (seen: dashpots 0.45 at rest, 1.5 when it diverged). The result has a ``row`` with
    `status`.
    """
    result = attempt(1.0)
    if result.row["status"] != UNSTABLE or numerics.time_step != "automatic":
        return result
    if progress:
        progress(f"{result.row['stop_reason']}; once more with half the time step")
    return attempt(2.0)
