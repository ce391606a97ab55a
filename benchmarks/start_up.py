"""One start of a run in a fresh process, stage by stage; a part of benchmarks.run_time.

``python -m benchmarks.start_up FLOW.npz [EDGE_TO_SPACING]`` prints processor and wall time [s] of
each stage as JSON. Imports are inside, because they are what is measured.
"""

import json
import sys
import time

BEGIN = time.perf_counter()
STAGES = [("interpreter", time.process_time(), 0.0)]


def stage(name: str) -> None:
    """The stage that ends here."""
    STAGES.append((name, time.process_time(), time.perf_counter() - BEGIN))


def start(path: str, edge: float) -> None:
    """What `dldsim.app.jobs.outcome_job` does until the first step, and one row of steps."""
    import dldsim.app.jobs  # noqa: F401

    stage("imports of a job")
    import pandas  # noqa: F401, not needed by a run, beside it for comparison

    stage("(pandas, for comparison)")
    from benchmarks.kernels import STIFFNESS
    from dldsim.config.sections import Cell
    from dldsim.experiments.array_scene import make_scene
    from dldsim.solver.flow import EmptyFlow
    from dldsim.solver.pillars import make_array
    from dldsim.solver.time_step import margins

    stage("imports of the kernels")
    flow = EmptyFlow.load(path)
    numerics = flow.numerics.model_copy(update={"edge_to_spacing": edge})
    stage("read the flow")
    for name in ("lattice and scene, first", "lattice and scene, again"):
        array = make_array(flow.geometry, flow.flow, numerics)
        scene = make_scene(array, flow, STIFFNESS, Cell(), flow.flow, numerics)
        stage(name)
    margins(scene)
    stage("time step")
    scene.advance(2)
    scene.sample()
    scene.energies()
    stage("first step and record")


if __name__ == "__main__":
    start(sys.argv[1], float(sys.argv[2]))
    ends = [("", 0.0, 0.0), *STAGES]
    taken = {
        name: {"cpu_s": cpu - before[1], "wall_s": wall - before[2]}
        for before, (name, cpu, wall) in zip(ends, STAGES, strict=False)
    }
    sys.stdout.write(json.dumps(taken) + "\n")
