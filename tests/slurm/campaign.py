"""The tiny campaign through a Slurm of its own on this machine, and what Slurm costs it.

``python tests/slurm/campaign.py FOLDER [--single] [--kill] [--cpus 2]``

Needs slurm-wlm, munge and snakemake-executor-plugin-slurm (docs/scale.md); not part of the tests.
FOLDER gets a copy of the workflow with its results, and the cluster's files. ``--single`` leaves
out the batches of profiles/slurm. ``--kill`` cuts the time limit of the first batch of runs while
it runs: it must be killed by Slurm, and run again with a longer limit, without any help.
"""

import argparse
import csv
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from datetime import datetime
from pathlib import Path

ROOT = Path(__file__).parents[2]
PARTS = ("Snakefile", "config.yaml", "workflow", "profiles", "dldsim")
CLUSTER = Path(__file__).with_name("cluster.sh")


def command(profile: str, *argv: str) -> list[str]:
    return [
        sys.executable,
        "-m",
        "snakemake",
        "--profile",
        profile,
        "--slurm-status-command",
        "squeue",  # no accounting database, hence no sacct
        "all",
        *argv,
        "--config",
        "preset=tiny",
    ]


def kill_by_limit(process: subprocess.Popen, env: dict) -> str:
    """Cut the time limit of the first batch of runs to a minute; returns its number."""
    while process.poll() is None:
        time.sleep(2)
        lines = subprocess.run(
            ["squeue", "-h", "-t", "RUNNING", "-o", "%i %k"],
            env=env,
            capture_output=True,
            text=True,
            check=True,
        ).stdout.splitlines()
        for line in lines:
            number, comment = line.split(maxsplit=1)
            if "simulate_outcome" in comment:
                subprocess.run(
                    ["scontrol", "update", f"JobId={number}", "TimeLimit=1"], env=env, check=True
                )
                return number
    sys.exit("No batch of runs was seen running.")


def slurm_jobs(path: Path) -> list[dict]:
    """What Slurm's plain-text log of finished jobs says of each."""
    jobs = []
    for line in path.read_text().splitlines():
        job = dict(re.findall(r"(\w+)=(\S*)", line))
        for name in ("SubmitTime", "StartTime", "EndTime"):
            job[name] = datetime.fromisoformat(job[name])
        jobs.append(job)
    return jobs


def work(results: Path) -> tuple[int, float, float]:
    """Number of jobs, and the wall and processor seconds of their scripts."""
    rows = []
    for path in (results / "benchmarks").rglob("*.tsv"):
        with path.open() as file:
            rows.append(next(csv.DictReader(file, delimiter="\t")))
    seconds = [
        [float(row[k]) for row in rows if row[k] not in ("-", "NA")] for k in ("s", "cpu_time")
    ]
    return len(rows), *map(sum, seconds)


def table(jobs: list[dict]) -> str:
    lines = [f"{'job':>5} {'state':<10} {'waited s':>8} {'ran s':>6}  limit min"]
    for job in jobs:
        waited = (job["StartTime"] - job["SubmitTime"]).total_seconds()
        ran = (job["EndTime"] - job["StartTime"]).total_seconds()
        lines.append(
            f"{job['JobId']:>5} {job['JobState']:<10} {waited:8.0f} {ran:6.0f}  {job['TimeLimit']}"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--single", action="store_true", help="every job by itself, no batches")
    parser.add_argument("--kill", action="store_true", help="have Slurm kill a batch of runs")
    parser.add_argument("--cpus", type=int, default=os.cpu_count(), help="of the cluster")
    given = parser.parse_args()
    folder = given.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    for name in PARTS:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        copy(ROOT / name, folder / name)
    profile = folder / "profiles" / "slurm" / "config.yaml"
    if given.single:
        text = profile.read_text()
        start, end = text.index("groups:"), text.index("default-resources:")
        profile.write_text(text[:start] + text[end:])

    cluster = folder / "cluster"
    subprocess.run([CLUSTER, "start", cluster, str(given.cpus)], check=True)
    env = os.environ | {
        "SLURM_CONF": str(cluster / "slurm.conf"),
        "PATH": f"{cluster / 'bin'}:{os.environ['PATH']}",
        "PYTHONPATH": str(folder),
    }
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("stopped"))
    run = command("profiles/slurm", "--cores", str(given.cpus))
    start = time.monotonic()
    process = subprocess.Popen(run, cwd=folder, env=env)
    try:
        killed = kill_by_limit(process, env) if given.kill else None
        if process.wait():
            sys.exit("Snakemake failed.")
        wall = time.monotonic() - start
        jobs = slurm_jobs(cluster / "jobs.txt")
        again = subprocess.run(
            [*run, "-n"], cwd=folder, env=env, capture_output=True, text=True, check=True
        )
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)  # cancels its jobs
            process.wait()
        subprocess.run([CLUSTER, "stop", cluster], check=True)

    number, seconds, processor = work(folder / "results")
    ran = sum((job["EndTime"] - job["StartTime"]).total_seconds() for job in jobs)
    sys.stdout.write(
        f"{table(jobs)}\n{number} jobs as {len(jobs)} Slurm jobs in {wall:.0f} s on "
        f"{given.cpus} CPUs\nSlurm jobs ran {ran:.0f} s, their scripts {seconds:.0f} s "
        f"({processor:.0f} s of processor time)\n"
    )
    if "Nothing to be done" not in again.stdout + again.stderr:
        sys.exit("The campaign is not complete.")
    if killed:
        [state] = [job["JobState"] for job in jobs if job["JobId"] == killed]
        if state != "TIMEOUT":
            sys.exit(f"Job {killed} should have been killed by its time limit, but: {state}")
        sys.stdout.write(f"Slurm killed job {killed}; the campaign recovered by itself.\n")


if __name__ == "__main__":
    main()
