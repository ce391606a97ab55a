"""What an outcome costs, beside as many releases without what makes them cheap.

``python -m benchmarks.outcome_cost [--json] [--arrays 10]``

Processor time. Now: the outcome of one cell in each array as a campaign simulates it: half a scene,
one flow for all releases, each followed until its motion is certain. Beside it the same releases in
whole scenes, each with a flow of its own and followed for ``max_rows`` rows: flow, start and step
of these are measured, and their steps are those that the releases took for a row. The arrays are
ten of the quick campaign, of all modes, that cost little.
"""

import argparse
import json
import sys
import time
from pathlib import Path

from benchmarks.kernels import median_times
from dldsim.config.identifiers import parse_outcome
from dldsim.config.presets import read_config
from dldsim.config.sections import Cell
from dldsim.experiments.array_outcome import simulate_outcome
from dldsim.experiments.array_scene import make_scene
from dldsim.solver.flow import solve_empty_array
from dldsim.solver.pillars import make_array
from dldsim.solver.time_step import margins
from dldsim.vocabulary import DECIDED

CONFIG = Path(__file__).parents[1] / "config.yaml"
OUTCOMES = (
    "r05.0_g12.0_n04_s1",
    "r07.0_g12.0_n10_s1",
    "r05.0_g16.0_n04_s5",
    "r05.0_g12.0_n06_s3",
    "r09.0_g12.0_n06_s5",
    "r07.0_g16.0_n04_s1",
    "r09.0_g12.0_n04_s1",
    "r09.0_g12.0_n04_s5",
    "r07.0_g12.0_n10_s3",
    "r05.0_g20.0_n04_s5",
)


def measure(identifier: str, rounds: int) -> dict:
    """Processor time [s] of one outcome, and of its releases without what makes them cheap."""
    config, pair = read_config(CONFIG), parse_outcome(identifier)
    geometry, stiffness = pair.geometry, config.stiffness_sets[pair.stiffness_set]
    cell, flow, numerics = config.cell, config.flow, config.numerics
    control = config.run_control
    begin = time.process_time()
    found = simulate_outcome(
        geometry,
        stiffness,
        cell,
        flow,
        numerics,
        control,
        outcome_id=identifier,
        stiffness_set=pair.stiffness_set,
    )
    clock = [begin, time.process_time()]
    whole = numerics.model_copy(update={"half_scene": False})
    start = solve_empty_array(geometry, flow, whole)
    clock.append(time.process_time())
    array = make_array(geometry, flow, whole)
    scene = make_scene(array, start, stiffness, Cell(**cell.model_dump()), flow, whole)
    margins(scene)
    clock.append(time.process_time())
    step = median_times({"step": scene.advance}, rounds)["step"]
    now, flow_s, start_s = (b - a for a, b in zip(clock, clock[1:], strict=False))
    row = found.row
    steps = row["steps"] / row["rows_total"] * control.max_rows
    return {
        "outcome": identifier,
        "mode": row["mode"],
        "decided": row["status"] in DECIDED,
        "releases": row["releases"],
        "rows": row["rows_total"],
        "now_s": now,
        "without_s": row["releases"] * (flow_s + start_s + steps * step),
    }


def table(results: list[dict]) -> str:
    """The results as text."""
    lines = [
        f"{r['outcome']}: {r['mode']}, {'decided' if r['decided'] else 'undecided'}, "
        f"{r['releases']} releases, {r['rows']} rows: {r['now_s']:.1f} s, without "
        f"{r['without_s']:.1f} s, ratio {r['without_s'] / r['now_s']:.1f}"
        for r in results
    ]
    now, without = (sum(r[name] for r in results) for name in ("now_s", "without_s"))
    decided = max(1, sum(r["decided"] for r in results))
    lines.append(
        f"{decided} of {len(results)} decided: {now / decided:.1f} s for each, without "
        f"{without / decided:.1f} s, ratio {without / now:.2f}"
    )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--json", action="store_true", help="one JSON list instead of a table")
    parser.add_argument("--arrays", type=int, default=len(OUTCOMES), help="as many of the ten")
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    # Kernels are loaded, or compiled, before anything is timed.
    results = [measure(name, given.rounds) for name in OUTCOMES[:1] + OUTCOMES[: given.arrays]][1:]
    sys.stdout.write(json.dumps(results, indent=1) + "\n" if given.json else table(results))


if __name__ == "__main__":
    main()
