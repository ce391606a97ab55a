"""What a campaign costs on N nodes, from the results of another one.

``python -m benchmarks.campaign_cost results [--preset paper full] [--outcomes N] [--nodes 1 4]``

From ``results``: rows that a cell needs per N_p, steps of flows and passages, time of the analysis.
From the command line, or the defaults as measured (docs/scale.md): speed of the kernels, start of
a job, start of a Slurm job, wait in the queue. The rest follows:

    t_job  = start + steps (nodes / speed + vertices · vertex time)
    steps  = rows per N_p · N_p · pitch / velocity, at most max_rows rows
    batch  = start of a Slurm job + sum of t_job of its geometries / cores of the batch
    wall   = wait + batches / (batches at a time), rounded up, · (batch + poll) + wait + analysis

A long job's processor time in results/benchmarks is too small, since Snakemake looks at it twice a
second for a quarter of a minute and every half a minute from then on; hence the number of steps.
"""

import argparse
import csv
import json
import math
import sys
from dataclasses import dataclass, replace
from pathlib import Path

from dldsim.config import assays, campaign
from dldsim.config.configuration import Config
from dldsim.config.presets import read_config
from dldsim.config.sections import Geometry
from dldsim.laws import viscosity, whole_shift_spacing
from dldsim.solver.mesh import area, frequency_for_edge, make_shape
from dldsim.tables.parquet import read_rows

CONFIG = Path(__file__).parents[1] / "config.yaml"
SIMULATIONS = ("empty_flow", "simulate_outcome", "assay_point", "verify")


@dataclass(frozen=True)
class Speed:
    """Measured constants: see docs/scale.md."""

    mlups: float
    ns_per_vertex: float
    start_s: float
    slurm_start_s: float
    wait_s: float
    poll_s: float

    def loop_s(self, updates: float, vertex_steps: float) -> float:
        return updates / self.mlups / 1e6 + vertex_steps * self.ns_per_vertex / 1e9


def scene_size(geometry: Geometry, config: Config) -> tuple[float, int, float]:
    """Fluid nodes, vertices and steps per row of a run whose time step the fluid's lag decides."""
    numerics, cell = config.numerics, config.cell
    spacing, shift = whole_shift_spacing(geometry, numerics.spacing_um)
    pitch, radius = shift * geometry.periodicity, cell.radius_um / spacing
    solid = math.pi * (geometry.pillar_radius_um / spacing) ** 2
    height = max(1, round(config.flow.height_um / spacing))
    layers = -(-height // 2) if numerics.half_scene else height
    nodes = numerics.rows * numerics.lanes * (pitch**2 - solid) * layers
    probe = area(*make_shape(cell.shape, radius, 8))
    n = frequency_for_edge(probe, numerics.edge_to_spacing)
    vertices = 10 * n**2 + 2
    if numerics.half_scene:  # 4 n of them on the mirror
        vertices = (vertices + 4 * n) // 2
    lag = numerics.reynolds_max * viscosity(numerics.relaxation_time) / (2 * radius)
    return nodes, vertices, pitch / min(numerics.velocity_lu, lag)


@dataclass(frozen=True)
class Work:
    """Processor seconds of the parts of a campaign, and numbers of their jobs."""

    geometries: int
    outcomes: int
    passages: int
    flow_s: float
    outcome_s: float
    passage_s: float
    analysis_s: float
    verify_s: float
    requests: int

    @property
    def core_s(self) -> float:
        return (
            self.geometries * self.flow_s
            + self.outcomes * self.outcome_s
            + self.passages * self.passage_s
            + self.analysis_s
            + self.verify_s
        )


def measured(results: Path) -> dict[str, float]:
    """What the results of a campaign say that carries over to others."""
    runs = read_rows("runs", results / "runs.parquet")
    outcomes = read_rows("outcomes", results / "outcomes.parquet")
    verified = read_rows("outcomes", results / "outcomes_verified.parquet")
    flows = read_rows("flows", results / "flows.parquet")
    moved = [r for r in runs if r["rows_completed"]]
    analysis = 0.0
    for path in (results / "benchmarks").rglob("*.tsv"):
        if path.parent.name in SIMULATIONS:
            continue
        with path.open() as file:
            analysis += float(next(csv.DictReader(file, delimiter="\t"))["cpu_time"])
    return {
        "rows_per_period": sum(r["rows_completed"] for r in moved)
        / sum(r["periodicity"] for r in moved),
        "run_updates": sum(r["steps"] * r["nodes"] for r in runs) / len(runs),
        "run_vertex_steps": sum(r["steps"] * r["vertices"] for r in runs) / len(runs),
        "flow_updates_per_node": sum(f["steps"] for f in flows) / len(flows),
        "outcomes": len(outcomes),
        "releases": len(runs) / len(outcomes),
        "verifying_outcomes": len(verified) - len(outcomes),
        "analysis_s": analysis,
    }


def predict(config: Config, found: dict, speed: Speed, passage_s: float) -> Work:
    """Work of a campaign of this configuration."""
    geometries, sets = campaign.geometries(config), len(config.sweep.stiffness_sets)
    flows = runs = 0.0
    for geometry in geometries:
        nodes, vertices, per_row = scene_size(geometry, config)
        rows = min(found["rows_per_period"] * geometry.periodicity, config.run_control.max_rows)
        flows += speed.loop_s(found["flow_updates_per_node"] * nodes, 0)
        steps = rows * per_row
        runs += speed.loop_s(steps * nodes, steps * vertices)
    n = len(geometries)
    outcome_s = speed.start_s + found["releases"] * runs / n
    return Work(
        n,
        n * sets,
        len(assays.points(config)),
        speed.start_s + flows / n,
        outcome_s,
        passage_s,
        found["analysis_s"],
        found["verifying_outcomes"] * outcome_s,
        len(config.design_requests),
    )


def on_slurm(work: Work, speed: Speed, nodes: int, cores: int, batch: int, width: int) -> dict:
    """Slurm jobs, reserved core-hours and wall time [h] on ``nodes`` × ``cores``.

    ``batch`` geometries in a Slurm job of ``width`` cores; passages and analysis run beside and
    after.
    """
    per_geometry = work.flow_s + work.outcomes / work.geometries * work.outcome_s
    batches = math.ceil(work.geometries / batch)
    batch_s = speed.slurm_start_s + batch * per_geometry / width
    at_once = max(1, nodes * cores // width)
    waves = math.ceil(batches / at_once)
    verify_s = work.verify_s / min(width, work.requests)
    wall = (
        speed.wait_s
        + waves * (batch_s + speed.poll_s)
        + speed.wait_s
        + speed.slurm_start_s
        + work.analysis_s
        + verify_s
    )
    single = (work.geometries + work.outcomes) * speed.slurm_start_s
    return {
        "nodes": nodes,
        "slurm_jobs": batches + 2,
        "batch_min": batch_s / 60,
        "core_h": (batches * batch_s * width + work.passages * work.passage_s + work.analysis_s)
        / 3600,
        "wall_h": wall / 3600,
        "core_h_of_starts_batched": batches * speed.slurm_start_s * width / 3600,
        "core_h_of_starts_single": single / 3600,
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", type=Path, help="folder of a finished campaign")
    parser.add_argument("--preset", nargs="*", default=["quick", "paper", "full"])
    parser.add_argument(
        "--outcomes",
        nargs="*",
        type=int,
        default=[20_000],
        help="campaigns like the last preset with so many outcomes",
    )
    parser.add_argument("--nodes", nargs="*", type=int, default=[1, 4, 16])
    parser.add_argument("--cores", type=int, default=32, help="of a node")
    parser.add_argument("--batch", type=int, default=8, help="geometries in a Slurm job")
    parser.add_argument("--width", type=int, default=4, help="cores of a Slurm job")
    parser.add_argument("--mlups", type=float, default=150.0)
    parser.add_argument("--ns-per-vertex", type=float, default=165.0)
    parser.add_argument("--start", type=float, default=2.0, help="of a job in a batch [s]")
    parser.add_argument("--slurm-start", type=float, default=10.0, help="of a Slurm job [s]")
    parser.add_argument("--wait", type=float, default=60.0, help="in the queue [s]")
    parser.add_argument("--poll", type=float, default=30.0, help="until an end is seen [s]")
    parser.add_argument(
        "--passage",
        type=float,
        default=4.0,
        help="of the passages of a cell and membrane through an assay [s]",
    )
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    speed = Speed(
        given.mlups, given.ns_per_vertex, given.start, given.slurm_start, given.wait, given.poll
    )
    found = measured(given.results)
    works = {
        name: predict(read_config(CONFIG, {"preset": name}), found, speed, given.passage)
        for name in given.preset
    }
    last = works[given.preset[-1]]
    for outcomes in given.outcomes:
        geometries = round(last.geometries * outcomes / last.outcomes)
        works[f"{outcomes:,} outcomes"] = replace(last, geometries=geometries, outcomes=outcomes)
    rows = [
        {
            "campaign": name,
            "outcomes": work.outcomes,
            "outcome_s": work.outcome_s,
            "core_h": work.core_s / 3600,
            "slurm": [
                on_slurm(work, speed, n, given.cores, given.batch, given.width) for n in given.nodes
            ],
        }
        for name, work in works.items()
    ]
    if given.json:
        sys.stdout.write(json.dumps({"measured": found, "campaigns": rows}, indent=1) + "\n")
        return
    loop = speed.loop_s(found["run_updates"], found["run_vertex_steps"])
    here = speed.start_s + found["releases"] * loop
    sys.stdout.write(
        f"{given.results}: {found['outcomes']} outcomes of {here:.1f} s on an idle core, "
        f"{found['releases']:.2f} releases each, {found['rows_per_period']:.1f} rows per N_p\n"
    )
    for row in rows:
        sys.stdout.write(
            f"{row['campaign']}: {row['outcomes']:,} outcomes of {row['outcome_s']:.1f} s, "
            f"{row['core_h']:.2f} core-hours\n"
        )
        for s in row["slurm"]:
            sys.stdout.write(
                f"  {s['nodes']:3} nodes of {given.cores} cores: {s['slurm_jobs']} Slurm jobs of "
                f"{s['batch_min']:.1f} min, {s['core_h']:.1f} core-hours reserved, wall "
                f"{s['wall_h'] * 60:.0f} min; starts {s['core_h_of_starts_batched']:.2f} "
                f"core-hours (one by one {s['core_h_of_starts_single']:.2f})\n"
            )


if __name__ == "__main__":
    main()
