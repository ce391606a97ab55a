"""All ratios in one table, each beside its target.

``python -m benchmarks [--quick] [--json FILE] [--figure FILE]``: kernels and limits of the
core, where the time of a run goes, growth, answers to design requests, and lbmpy if it is
installed.
``--quick`` takes fewer turns. Nothing here fails: a target that is missed says so.
"""

import argparse
import importlib.util
import json
import sys
from pathlib import Path

from benchmarks import design_time, growth, kernels, peers, run_time

LEVEL, CELL, START, RATIO, MEMORY = 1.0, 0.5, 1.5, 1.8, 1024.0
"""Targets: against lbmpy; cell over fluid; start-up [s]; two at once over one; peak [MiB]."""
LINEAR = 0.1
"""An exponent is that of linear growth if it exceeds 1 by no more."""


def row(what: str, value: float, target: float, least: bool, unit: str = "") -> dict:
    met = value >= target if least else value <= target
    return {
        "what": what,
        "value": value,
        "target": target,
        "least": least,
        "unit": unit,
        "met": bool(met),
    }


def rows(found: dict) -> list[dict]:
    """Every ratio that has a target."""
    table = [
        row(
            f"cell over fluid, {r['scene']}, {r['vertices']} vertices",
            r["cell_over_fluid"],
            CELL,
            False,
        )
        for r in found["run_time"]
    ]
    table += [
        row(f"start-up, processor time, {r['scene']}", r["start_up_s"], START, False, "s")
        for r in found["run_time"]
    ]
    table += [
        row(f"fluid over lbmpy, {r['scene']}, {r['precision']}", r["ratio"], LEVEL, True)
        for r in found["peers"]
    ]
    table += [
        row(
            f"processor time of an answer, {r['request']}",
            r["cpu_s"],
            design_time.ANSWER,
            False,
            "s",
        )
        for r in found["answers"]
    ]
    fits = found["growth"]["fits"]
    for name in ("fluid step against nodes", "cell's part of a step against vertices"):
        table.append(row(f"exponent, {name}", fits[name]["exponent"], 1 + LINEAR, False))
    [default] = [
        p for p in found["growth"]["points"]["nodes"] if p["nodes"] == found["run_time"][0]["nodes"]
    ]
    table.append(row("peak memory of a job", default["peak_MB"] / 1.048576, MEMORY, False, "MiB"))
    if isinstance(found["growth"]["two"], dict):
        table.append(row("two at a time over one", found["growth"]["two"]["ratio"], RATIO, True))
    return table


def text(table: list[dict]) -> str:
    lines = []
    for r in table:
        bound = "at least" if r["least"] else "at most"
        lines.append(
            f"{r['what']:<58}{r['value']:8.2f} {r['unit']:<4}{bound:>9} {r['target']:g}"
            f"{'' if r['met'] else '   MISSED'}"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="fewer turns, wider scatter")
    parser.add_argument("--json", type=Path, help="write everything that was measured")
    parser.add_argument("--figure", type=Path, help="write the figure of growth")
    given = parser.parse_args()
    rounds, repeats = (5, 1) if given.quick else (15, 3)
    write = sys.stdout.write
    found = {"peers": []}
    found["kernels"] = [
        kernels.measure_cell(*kernels.parse_scene(scene, precision), rounds)
        for precision in ("float32", "float64")
        for scene in kernels.SCENES
    ] + [kernels.measure_box((96, 96, 96), precision, 3) for precision in ("float32", "float64")]
    write(kernels.table(found["kernels"]) + "\n")
    found["run_time"] = [run_time.account(scene, 12, rounds) for scene in kernels.SCENES]
    write(run_time.table(found["run_time"]) + "\n")
    found["growth"] = growth.collect(repeats, max(5, rounds // 2), None, False)
    write(growth.table(found["growth"]) + "\n")
    found["answers"] = design_time.answers(repeats)
    write(design_time.table(found["answers"]) + "\n")
    if given.figure:
        given.figure.write_bytes(growth.render(growth.draw(found["growth"]), "png"))
    if importlib.util.find_spec("lbmpy"):
        found["peers"] = peers.measure(("float32", "float64"), [96], max(5, rounds - 4))
        write(peers.table(found["peers"]) + "\n")
    else:
        write("lbmpy is not installed: no comparison with it (benchmarks/README.md)\n\n")
    if isinstance(found["growth"]["two"], str):
        write(found["growth"]["two"] + "\n\n")
    write(text(rows(found)))
    if given.json:
        given.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
