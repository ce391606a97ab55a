"""Processor time of answers to design requests, outcomes at the outlets included.

``python -m benchmarks.design_time [--json] [--rounds 3]``

Each answer is a process of its own, as the command starts it: interpreter, imports, reading of the
campaign, search, outcomes of the candidates, and files. Processor time is that of all its threads,
so that other work on the machine changes it little; the number of threads is the package's own.
"""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

ANSWER = 5.0
"""Target [s] for the processor time of an answer."""
CELLS = ("--set1", "3", "--set2", "3", "--r1", "6", "--r2", "9")
REQUESTS = {
    "design": ("design", *CELLS),
    "design, scatter": ("design", *CELLS, "--r1-cv", "0.05", "--r2-cv", "0.05"),
    "design, files": ("design", *CELLS, "--output", "."),
    "design by outcome": ("design", *CELLS, "--objective", "purity-recovery"),
    "outcome": (
        *("outcome", *CELLS, "--pillar-radius-um", "9", "--gap-um", "12", "--periodicity", "10"),
        *("--output", "."),
    ),
}
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Variables that would take the choice from the package."""


def measure(command: Sequence[str], folder: Path) -> dict[str, float]:
    """Processor and wall time [s] of a process in a folder. Raises CalledProcessError."""
    environment = {k: v for k, v in os.environ.items() if k not in THREADS}
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, cwd=folder, env=environment, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return {
        "cpu_s": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        "wall_s": time.perf_counter() - start,
    }


def answers(rounds: int) -> list[dict]:
    """Medians of each of REQUESTS; the first turn, which fills caches, does not count."""
    found = {name: [] for name in REQUESTS}
    for turn in range(rounds + 1):
        for name, words in REQUESTS.items():
            with tempfile.TemporaryDirectory() as folder:
                taken = measure([sys.executable, "-m", "dldsim", *words], Path(folder))
            found[name] += [taken] if turn else []
    return [
        {"request": name}
        | {key: statistics.median(t[key] for t in turns) for key in ("cpu_s", "wall_s")}
        for name, turns in found.items()
    ]


def table(found: list[dict]) -> str:
    lines = [f"{'an answer':<22}{'processor [s]':>14}{'wall [s]':>10}"]
    lines += [f"{r['request']:<22}{r['cpu_s']:14.2f}{r['wall_s']:10.2f}" for r in found]
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--json", action="store_true", help="print everything that was measured")
    parser.add_argument("--rounds", type=int, default=3, help="default %(default)s")
    given = parser.parse_args()
    found = answers(given.rounds)
    sys.stdout.write(json.dumps(found) + "\n" if given.json else table(found))


if __name__ == "__main__":
    main()
