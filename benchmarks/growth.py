"""How the cost of a step and of a run grows, and the memory; and two runs at a time against one.

``python -m benchmarks.growth [--json] [--figure growth.png] [--runs runs.parquet] [--any-load]``

One quantity is varied at a time about the shipped defaults, each point in a process of its own (so
that its peak memory is its own), the points in turns, several times over. Times are medians of
processor time. Exponents are slopes of straight lines through logarithms, errors those of the
slopes (one standard deviation). The cost of a step does not depend on the state of the flow, which
is therefore not made steady first.

Two at a time is wall time and means something on an idle machine only: it is left out where the
load is above a half, unless ``--any-load`` insists.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.kernels import GEOMETRY, STIFFNESS, median_times, without_cell
from dldsim.config.sections import Cell, Flow, Geometry, Numerics
from dldsim.experiments.array_scene import make_scene
from dldsim.report.style import render, styled
from dldsim.solver.flow import EmptyFlow, Fluid
from dldsim.solver.pillars import make_array
from dldsim.solver.scene import CellInFlow
from dldsim.solver.time_step import margins, refinement
from dldsim.vocabulary import SETTLED

SWEEPS = {
    "nodes": [{"rows": rows, "lanes": 1, "images": "aligned"} for rows in (1, 2, 4, 8)],
    "vertices": [{"edge_to_spacing": edge} for edge in (1.6, 1.0, 0.7, 0.5, 0.35)],
    "periodicity": [{"periodicity": n} for n in (4, 6, 8, 10, 12)],
    "resolution": [{"spacing_um": spacing} for spacing in (2.5, 1.25, 0.9, 0.65, 0.55)],
}
"""What each sweep changes of the default array and numerics; resolution is pitch over spacing."""
FIGURE = Path(__file__).parents[1] / "docs" / "images" / "growth.png"
LOAD = 0.5
"""Load of the machine above which two at a time is not measured."""
TURN = 5.0  # s, of a process that runs beside another
COLOURS = {"fluid": "#0072B2", "cell": "#D55E00", "step": "#000000", "memory": "#009E73"}


# ------------------------------------------------------------------ one point


def scene_of(change: dict) -> tuple[CellInFlow, Geometry, Numerics]:
    """The default scene but for ``change``, in a flow that has just been set in motion."""
    geometry = GEOMETRY.model_copy(
        update={k: v for k, v in change.items() if k in Geometry.model_fields}
    )
    numerics = Numerics(**{k: v for k, v in change.items() if k in Numerics.model_fields})
    flow = Flow()
    array = make_array(geometry, flow, numerics)
    fluid = Fluid.of(array.lattice, numerics)
    force = np.array([1e-5, 0.0])
    fluid.set_body_force([*force, 0.0])
    fluid.advance(100)
    mean = fluid.mean_velocity()[:2]
    start = EmptyFlow(
        geometry,
        flow,
        numerics,
        np.eye(2) * mean[0] / force[0],
        force,
        mean,
        fluid.f,
        array.spacing_um,
        array.pitch,
        array.lattice.nodes,
        fluid.steps,
        1.0,
    )
    return make_scene(array, start, STIFFNESS, Cell(), flow, numerics), geometry, numerics


def peak_bytes() -> int:
    """Peak memory of this process. What getrusage says begins with that of the parent."""
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    [peak] = [line.split()[1] for line in lines if line.startswith("VmHWM:")]
    return int(peak) * 1024


def measure(change: dict, rounds: int) -> dict:
    """Time of a step [µs] and peak memory of one scene; kernels are loaded on a small one first."""
    small, _, _ = scene_of({"rows": 1, "lanes": 1})
    small.advance(2)
    margins(small)
    before = peak_bytes()
    scene, geometry, numerics = scene_of(change)
    scene.advance(100)
    factor = refinement(margins(scene), numerics)
    alone = without_cell(scene)
    after = peak_bytes()
    us = median_times({"step": scene.advance, "fluid": alone.advance}, rounds)
    pitch = geometry.pitch_um / scene.units.spacing_um
    return {
        "nodes": scene.fluid.lattice.nodes,
        "vertices": scene.vertices,
        "periodicity": geometry.periodicity,
        "resolution": pitch,
        "step_us": 1e6 * us["step"],
        "fluid_us": 1e6 * us["fluid"],
        "steps_per_row": pitch / numerics.velocity_lu * factor,
        "peak_MB": after / 1e6,
        "more_MB": (after - before) / 1e6,
    }


def stay_busy() -> None:
    """Steps of the default scene for a while, from the moment a line is read; prints how many."""
    scene, _, _ = scene_of({})
    scene.advance(500)
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    sys.stdin.readline()
    start, steps = time.perf_counter(), 0
    while time.perf_counter() - start < TURN:
        scene.advance(200)
        steps += 200
    sys.stdout.write(f"{steps / (time.perf_counter() - start)}\n")


# ------------------------------------------------------------------ all of them


def child(*argv: str) -> list[str]:
    return [sys.executable, "-m", "benchmarks.growth", *argv]


def sweep(names, repeats: int, rounds: int) -> dict[str, list[dict]]:
    """Points of each sweep, medians over repeats in which all points take turns."""
    found = {(name, i): [] for name in names for i in range(len(SWEEPS[name]))}
    for _ in range(repeats):
        for (name, i), results in found.items():
            done = subprocess.run(
                child("--point", json.dumps(SWEEPS[name][i]), "--rounds", str(rounds)),
                capture_output=True,
                text=True,
                check=True,
            )
            results.append(json.loads(done.stdout))
    return {
        name: [
            {k: float(np.median([r[k] for r in found[name, i]])) for k in found[name, i][0]}
            for i in range(len(SWEEPS[name]))
        ]
        for name in names
    }


def two_at_once(repeats: int) -> dict[str, float]:
    """Steps per second of two processes together over that of one, in turns."""
    rates = {1: [], 2: []}
    for _ in range(repeats):
        for number, found in rates.items():
            busy = [
                subprocess.Popen(child("--busy"), stdin=-1, stdout=-1, text=True)
                for _ in range(number)
            ]
            for process in busy:
                process.stdout.readline()
            for process in busy:
                process.stdin.write("go\n")
                process.stdin.flush()
            found.append(sum(float(process.communicate()[0]) for process in busy))
    one, two = (float(np.median(rates[n])) for n in (1, 2))
    return {"one_steps_per_s": one, "two_steps_per_s": two, "ratio": two / one}


def power(x, y) -> dict[str, float]:
    """Exponent of y ∝ xᵖ, its standard error, and the factor."""
    x, y = np.log(np.asarray(x, float)), np.log(np.asarray(y, float))
    slope, offset = np.polyfit(x, y, 1)
    rest = y - slope * x - offset
    error = np.sqrt(np.sum(rest**2) / max(len(x) - 2, 1) / np.sum((x - x.mean()) ** 2))
    return {"exponent": float(slope), "error": float(error), "factor": float(np.exp(offset))}


def column(points: list[dict], name: str) -> np.ndarray:
    return np.array([point[name] for point in points])


def fits(points: dict[str, list[dict]]) -> dict[str, dict[str, float]]:
    """Exponents, named by what grows and with what."""
    nodes, vertices, fine = (points[n] for n in ("nodes", "vertices", "resolution"))
    cell = column(vertices, "step_us") - column(vertices, "fluid_us")
    row = column(fine, "step_us") * column(fine, "steps_per_row")
    every = [p for group in points.values() for p in group]
    large = [p for p in every if p["more_MB"] > 2]  # below, one cannot tell it from the rest
    return {
        "fluid step against nodes": power(column(nodes, "nodes"), column(nodes, "fluid_us")),
        "cell's part of a step against vertices": power(column(vertices, "vertices"), cell),
        "step against λ/Δx": power(column(fine, "resolution"), column(fine, "step_us")),
        "a row against λ/Δx": power(column(fine, "resolution"), row),
        "memory against nodes": power(column(large, "nodes"), column(large, "more_MB")),
    }


def runs_by_periodicity(path: Path) -> dict[str, list[float]]:
    """Steps, rows and cost of the runs of a campaign: medians for each N_p."""
    import pandas as pd

    runs = pd.read_parquet(path)
    runs = runs[runs["status"].isin([*SETTLED, "undecided"])]
    runs["updates"] = runs["steps"] * runs["nodes"]
    names = ["rows_completed", "steps", "updates"]
    group = runs.groupby("periodicity")[names].median()
    return {"periodicity": group.index.tolist(), **group.to_dict("list")}


# ------------------------------------------------------------------ text and figure


@styled
def draw(result: dict) -> Figure:
    """Costs on logarithmic axes, points and fitted lines; a panel more if runs were given."""
    panels = 5 if "runs" in result else 4
    figure = Figure(figsize=(10.4 if panels > 4 else 7.4, 6.2), layout="constrained")
    axes = figure.subplots(2, (panels + 1) // 2).ravel()
    for spare in axes[panels:]:
        spare.remove()
    axes = axes[:panels]
    points, fitted = result["points"], result["fits"]

    def line(ax, x, fit, colour):
        ends = np.array([min(x), max(x)])
        ax.plot(ends, fit["factor"] * ends ** fit["exponent"], color=colour, linewidth=1)

    def exponent(name):
        return f"exponent {fitted[name]['exponent']:.2f} ± {fitted[name]['error']:.2f}"

    def panel(ax, x, y, fit, colour, marker, label):
        ax.plot(x, y, marker, color=colour, label=f"{label}: {exponent(fit)}")
        line(ax, x, fitted[fit], colour)

    nodes, vertices, fine, period = (
        points[n] for n in ("nodes", "vertices", "resolution", "periodicity")
    )
    a, b, c, d = axes[:4]
    panel(
        a,
        column(nodes, "nodes"),
        column(nodes, "fluid_us"),
        "fluid step against nodes",
        COLOURS["fluid"],
        "o",
        "fluid",
    )
    a.plot(
        column(nodes, "nodes"),
        column(nodes, "step_us"),
        "s",
        color=COLOURS["step"],
        label=f"with {nodes[0]['vertices']:.0f} vertices",
    )
    a.set(title="(a) a step against fluid nodes", xlabel="fluid nodes", ylabel="time [µs]")
    cell = column(vertices, "step_us") - column(vertices, "fluid_us")
    panel(
        b,
        column(vertices, "vertices"),
        cell,
        "cell's part of a step against vertices",
        COLOURS["cell"],
        "^",
        "cell",
    )
    b.plot(
        column(vertices, "vertices"),
        column(vertices, "fluid_us"),
        "o",
        color=COLOURS["fluid"],
        label=f"fluid, {vertices[0]['nodes']:,.0f} nodes",
    )
    b.set(title="(b) a step against vertices", xlabel="vertices", ylabel="time [µs]")
    row = 1e-6 * column(fine, "step_us") * column(fine, "steps_per_row")
    c.plot(
        column(fine, "resolution"),
        row,
        "D",
        color=COLOURS["step"],
        label=exponent("a row against λ/Δx"),
    )
    line(
        c,
        column(fine, "resolution"),
        {**fitted["a row against λ/Δx"], "factor": 1e-6 * fitted["a row against λ/Δx"]["factor"]},
        COLOURS["step"],
    )
    row = 1e-6 * column(period, "step_us") * column(period, "steps_per_row")
    c.plot(column(period, "resolution"), row, "x", color=COLOURS["cell"], label=r"$N_p$ 4 to 12")
    c.set(
        title="(c) a row against resolution",
        xlabel=r"pitch / spacing $\lambda/\Delta x$",
        ylabel="time of a row [s]",
    )
    every = [p for group in points.values() for p in group]
    panel(
        d,
        column(every, "nodes"),
        column(every, "more_MB").clip(0.1),
        "memory against nodes",
        COLOURS["memory"],
        "v",
        "scene",
    )
    d.plot(
        column(every, "nodes"),
        column(every, "peak_MB"),
        "o",
        color=COLOURS["step"],
        fillstyle="none",
        label="process",
    )
    d.set(title="(d) peak memory", xlabel="fluid nodes", ylabel="memory [MB]")
    if panels > 4:
        runs, name = result["runs"], "steps of a run against N_p"
        panel(axes[4], runs["periodicity"], runs["steps"], name, COLOURS["step"], "s", "median run")
        axes[4].set(title="(e) a run against $N_p$", xlabel="periodicity $N_p$", ylabel="steps")
    for ax in axes:
        ax.set(xscale="log", yscale="log")
        ax.legend(loc="best")
    if panels > 4:
        axes[4].set_xticks(runs["periodicity"], [str(n) for n in runs["periodicity"]])
    return figure


def table(result: dict) -> str:
    """The results as text."""
    lines = []
    for name, points in result["points"].items():
        lines.append(f"{name}: fluid nodes, vertices, λ/Δx, N_p; step, fluid [µs]; memory [MB]")
        for p in points:
            lines.append(
                f"  {p['nodes']:9,.0f} {p['vertices']:6.0f} {p['resolution']:6.1f} "
                f"{p['periodicity']:3.0f} {p['step_us']:10.1f} {p['fluid_us']:9.1f} "
                f"{p['peak_MB']:7.0f} (+{p['more_MB']:.1f})"
            )
    for name, fit in result["fits"].items():
        lines.append(f"{name}: exponent {fit['exponent']:.2f} ± {fit['error']:.2f}")
    if "runs" in result:
        runs = result["runs"]
        for n, rows, steps in zip(
            runs["periodicity"], runs["rows_completed"], runs["steps"], strict=True
        ):
            lines.append(f"runs of N_p = {n}: medians {rows:.0f} rows, {steps:,.0f} steps")
        fit = result["fits"]["steps of a run against N_p"]
        lines.append(
            f"steps of a run against N_p: exponent {fit['exponent']:.2f} ± {fit['error']:.2f}"
        )
    if isinstance(result["two"], str):
        lines.append(result["two"])
    else:
        lines.append(f"two at a time: {result['two']['ratio']:.2f} times one")
    return "\n".join(lines) + "\n"


def collect(repeats: int, rounds: int, runs: Path | None, any_load: bool) -> dict:
    """All of it."""
    load = os.getloadavg()[0]
    two = f"two at a time: not measured, the load of the machine is {load:.1f} (at most {LOAD:g})"
    if load <= LOAD or any_load:
        two = two_at_once(repeats)
    points = sweep(SWEEPS, repeats, rounds)
    result = {"points": points, "fits": fits(points), "two": two}
    if runs:
        result["runs"] = found = runs_by_periodicity(runs)
        result["fits"]["steps of a run against N_p"] = power(found["periodicity"], found["steps"])
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--json", action="store_true", help="JSON instead of a table")
    parser.add_argument("--figure", type=Path, help=f"write the figure, such as {FIGURE.name}")
    parser.add_argument("--runs", type=Path, help="table of runs, for the cost against N_p")
    parser.add_argument("--repeats", type=int, default=3, help="processes for each point")
    parser.add_argument("--rounds", type=int, default=7, help="turns in each process")
    parser.add_argument("--any-load", action="store_true", help="two at a time on a busy machine")
    parser.add_argument("--point", type=json.loads, help=argparse.SUPPRESS)
    parser.add_argument("--busy", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.busy:
        return stay_busy()
    if given.point is not None:
        sys.stdout.write(json.dumps(measure(given.point, given.rounds)) + "\n")
        return None
    result = collect(given.repeats, given.rounds, given.runs, given.any_load)
    sys.stdout.write(json.dumps(result, indent=1) + "\n" if given.json else table(result))
    if given.figure:
        given.figure.write_bytes(render(draw(result), "png"))
    return None


if __name__ == "__main__":
    main()
