"""Where the time of a run goes, from the start of its process to its tables.

``python -m benchmarks.run_time [--json] [--scene 1.25:1:2:8] [--rows 12]``

Processor time, medians; the parts of a step take turns in one process, each start-up is a process
of its own with a warm kernel cache. Repeated by itself, a part finds its arrays in the processor's
cache: what the whole step takes beyond its parts is listed as such. A run is then done as a whole,
beside the sum of its parts.
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numba
import numpy as np

from benchmarks.kernels import (
    EXTENT,
    SCENES,
    STIFFNESS,
    cell_parts,
    median_times,
    parse_scene,
    unit_cell,
    without_cell,
)
from dldsim.config.sections import Cell, Flow, RunControl
from dldsim.experiments.array_run import simulate_run
from dldsim.experiments.outcome_files import write_run
from dldsim.experiments.recording import Record
from dldsim.solver.flow import Fluid, solve_empty_array
from dldsim.solver.stream_collide import stream_collide

COUPLING = ("locate", "clear force", "surround", "spread", "interpolate", "contact")
FIELDS = "force and velocity fields"
NOT_OF_A_RUN = ("(pandas, for comparison)", "lattice and scene, again")


def start_up(flow_file: Path, edge: float, rounds: int) -> dict[str, dict[str, float]]:
    """Median processor and wall time [s] of each stage of a start."""
    command = [sys.executable, "-m", "benchmarks.start_up", str(flow_file), str(edge)]
    found = []
    for _ in range(rounds + 1):
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        found.append(json.loads(done.stdout))
    found = found[1:]  # the first fills the kernel cache
    return {
        name: {k: statistics.median(f[name][k] for f in found) for k in found[0][name]}
        for name in found[0]
    }


@numba.njit
def _with_fields(steps, fluid):
    for step in range(steps):
        stream_collide(step, fluid.f, fluid.force, fluid.velocity, fluid.near[:0], fluid.scheme)


def with_fields(fluid: Fluid):
    """Steps of a fluid that reads a force and writes its velocity at every node, as beside a cell;
    alone it does neither.
    """
    return lambda steps: _with_fields(steps, fluid.state)


def account(text: str, rows: int, rounds: int) -> dict:
    """Where the processor time of a run of so many rows goes, in one scene."""
    geometry, numerics = parse_scene(text, "float32")
    with tempfile.TemporaryDirectory() as folder:
        flow_file = Path(folder) / "flow.npz"
        flow = solve_empty_array(geometry, Flow(), numerics)
        flow.save(flow_file)
        begin = start_up(flow_file, numerics.edge_to_spacing, max(3, rounds // 3))
        scene = unit_cell(geometry, numerics)
        alone, lattice = without_cell(scene), scene.fluid.lattice
        record = Record("benchmark", scene.units, np.zeros(3))

        def keep(repetitions: int) -> None:
            for _ in range(repetitions):
                record.samples.clear()
                record.energies.clear()
                record.add(scene.sample(), scene.energies())

        parts = {
            "step": scene.advance,
            "fluid": alone.advance,
            "with fields": with_fields(alone),
            **cell_parts(scene),
            "record": keep,
        }
        us = {name: 1e6 * t for name, t in median_times(parts, rounds).items()}
        clock = [time.process_time()]
        result = simulate_run(
            geometry,
            STIFFNESS,
            Cell(),
            Flow(),
            numerics,
            RunControl(max_rows=rows, min_rows=rows),
            run_id="r00.0_g00.0_n00_s0",
            stiffness_set="0",
            empty_flow=flow,
        )
        clock.append(time.process_time())
        write_run(result, Path(folder) / "row.parquet", Path(folder) / "path.parquet", {})
        clock.append(time.process_time())
    steps, records = result.row["steps"], len(result.trajectory["step"])
    first = sum(stage["cpu_s"] for name, stage in begin.items() if name not in NOT_OF_A_RUN)
    inside = {
        "fluid": us["fluid"],
        FIELDS: us["with fields"] - us["fluid"],
        **{name: us[name] for name in ("membrane", *COUPLING)},
    }
    seconds = {
        "start-up": first,
        **{name: steps * t / 1e6 for name, t in inside.items()},
        "step beyond its parts": steps * (us["step"] - sum(inside.values())) / 1e6,
        "recording": records * us["record"] / 1e6,
        "tables": clock[2] - clock[1],
    }
    return {
        "scene": "unit cell {}×{}×{}".format(*(getattr(lattice, n) for n in EXTENT)),
        "nodes": lattice.nodes,
        "vertices": scene.vertices,
        "rows": result.row["rows_completed"],
        "status": result.row["status"],
        "stop_reason": result.row["stop_reason"],
        "steps": steps,
        "us": us,
        "cell_over_fluid": us["step"] / us["fluid"] - 1,
        "start_up": begin,
        "start_up_s": first,
        "seconds": seconds,
        "sum_s": sum(seconds.values()),
        "measured_s": first + clock[2] - clock[0],
    }


def table(results: list[dict]) -> str:
    """The results as text."""
    lines = []
    for r in results:
        lines += [
            f"{r['scene']}, {r['nodes']:,} fluid nodes, {r['vertices']} vertices: {r['rows']} rows "
            f"({r['status']}), {r['steps']:,} steps of {r['us']['step']:.1f} µs",
            f"  {r['stop_reason']}",
            f"  the cell costs {r['cell_over_fluid']:.0%} of the fluid",
        ]
        for name, seconds in r["seconds"].items():
            lines.append(f"  {name:<26}{seconds:8.2f} s {seconds / r['sum_s']:6.1%}")
        lines.append(
            f"  {'sum':<26}{r['sum_s']:8.2f} s; start-up and the run as a whole "
            f"{r['measured_s']:.2f} s"
        )
        lines.append(f"  start-up, processor time (wall time): {r['start_up_s']:.2f} s")
        for name, stage in r["start_up"].items():
            lines.append(f"    {name:<28}{stage['cpu_s']:6.2f} s ({stage['wall_s']:.2f} s)")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--json", action="store_true", help="one JSON list instead of a table")
    parser.add_argument("--scene", nargs="*", default=SCENES, help="as in benchmarks.kernels")
    parser.add_argument("--rows", type=int, default=12, help="that the cell passes")
    parser.add_argument("--rounds", type=int, default=15)
    given = parser.parse_args()
    results = [account(scene, given.rows, given.rounds) for scene in given.scene]
    sys.stdout.write(json.dumps(results, indent=1) + "\n" if given.json else table(results))


if __name__ == "__main__":
    main()
