"""Starts of Snakemake on a copy of the workflow: dry ones in this process, real ones in another."""

import contextlib
import io
import logging
import os
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import yaml
from snakemake.api import SnakemakeApi
from snakemake.cli import parse_config
from snakemake.settings.enums import Quietness, RerunTrigger
from snakemake.settings.types import (
    ConfigSettings,
    DAGSettings,
    ExecutionSettings,
    OutputSettings,
    ResourceSettings,
)

from dldsim.config.presets import read_config
from dldsim.tables.numerics import columns_of
from dldsim.tables.parquet import write_table
from tests.analysis.made_outcomes import make_survey
from tests.app.conftest import filled

ROOT = Path(__file__).parents[2]
PARTS = ("Snakefile", "config.yaml", "workflow", "profiles")


def snakemake(folder, *argv, check=True):
    """Run snakemake on a copy of the workflow; returns the finished process."""
    done = subprocess.run(
        [sys.executable, "-m", "snakemake", "-j2", *argv],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert not check or done.returncode == 0, done.stdout + done.stderr
    return done


def write_survey(path, **changes):
    """A made-up survey of the numerics of the preset tiny, but for the changes."""
    numerics = read_config(ROOT / "config.yaml", {"preset": "tiny"}).numerics
    made = make_survey(8, 8).assign(**columns_of(numerics) | changes)
    write_table("outcomes", filled("outcomes", made), path, {})


def profile(name="default"):
    return yaml.safe_load((ROOT / "profiles" / name / "config.yaml").read_text())


class Plan(NamedTuple):
    """What a start would do: rule and wildcards of each job that is needed, all jobs, the log."""

    needed: list
    jobs: list
    said: str

    @property
    def counts(self):
        """Number of needed jobs of each rule."""
        return Counter(job.rule.name for job in self.needed)


@contextlib.contextmanager
def started(folder, *targets, config=None, files=(), triggers=None, **options):
    """A start in this process, with the triggers of the profile; `config` as on the command line.

    Gives the workflow, its graph, and the log so far.
    """
    said, listener = io.StringIO(), logging.getLogger("snakemake.logging")
    handler, level = logging.StreamHandler(said), listener.level
    triggers = RerunTrigger.parse_choices_set(triggers or profile()["rerun-triggers"])
    with contextlib.chdir(folder), SnakemakeApi(OutputSettings(quiet={Quietness.ALL})) as api:
        listener.addHandler(handler)
        listener.setLevel(logging.INFO)
        try:
            steps = api.workflow(
                ResourceSettings(cores=1),
                snakefile=Path("Snakefile"),
                config_settings=ConfigSettings(
                    config=parse_config(config) if config else {}, configfiles=[*map(Path, files)]
                ),
            )
            graph = steps.dag(
                DAGSettings(targets=frozenset(targets), rerun_triggers=triggers, **options)
            )
            yield steps._workflow, graph, said
        finally:
            listener.removeHandler(handler)
            listener.setLevel(level)


def plan(folder, *targets, **options):
    """A dry run."""
    with started(folder, *targets, **options) as (workflow, _, said):
        workflow._prepare_dag(
            forceall=False, ignore_incomplete=True, lock_warn_only=True, nolock=True
        )
        workflow._build_dag()
        return Plan([*workflow.dag.needrun_jobs()], [*workflow.dag.jobs], said.getvalue())


def touch(folder, *targets, **options):
    """Let Snakemake take what is there for just made."""
    with started(folder, *targets, forceall=True, **options) as (_, graph, _):
        graph.execute_workflow(executor="touch", execution_settings=ExecutionSettings(lock=False))


def planned(folder, *targets, **options):
    """Number of jobs of each rule that a dry run announces."""
    return dict(plan(folder, *targets, **options).counts)


def copy_workflow(folder):
    for name in PARTS:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        copy(ROOT / name, folder / name)
    return folder


TINY = ["preset=tiny"]
