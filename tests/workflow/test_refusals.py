"""What is refused or told before any job runs, and where a start works."""

import json
import os
import re
import shutil
import subprocess
import sys
import venv
from pathlib import Path

import pyarrow as pa
import pytest
import yaml
from snakemake.exceptions import WorkflowError

from dldsim.config import campaign
from dldsim.config.provenance import STAMP
from dldsim.errors import DldsimError
from tests.workflow.snakemake_start import ROOT, TINY, copy_workflow, plan, planned, snakemake

pytestmark = pytest.mark.slow


def test_the_file_that_the_user_names_wins_over_the_preset(tmp_path):
    """Of a file with presets of its own, the preset in force wins over its shared sections."""
    folder = copy_workflow(tmp_path)
    (folder / "sweep.yaml").write_text(
        "sweep: {pillar_radius_um: [6.0], gap_um: [14.0], periodicity: [5], stiffness_sets: ['3']}"
    )
    found = plan(folder, "all", files=["sweep.yaml"], config=["seed=3"])
    assert found.counts["simulate_outcome"] == found.counts["empty_flow"] == 1
    assert (
        "Configuration: config.yaml, preset quick; over it sweep.yaml: sweep.pillar_radius_um, "
        "sweep.gap_um, sweep.periodicity, sweep.stiffness_sets; over it the command line: seed."
    ) in found.said
    assert (
        planned(folder, "flows", files=["sweep.yaml"], config=["sweep={gap_um: [14, 15]}"])[
            "empty_flow"
        ]
        == 2
    )
    own = yaml.safe_load((folder / "config.yaml").read_text())
    own["preset"], own["presets"]["tiny"]["sweep"]["gap_um"] = "tiny", [15.0, 20.0, 21.0]
    (folder / "own.yaml").write_text(yaml.safe_dump(own))
    found = plan(folder, "flows", files=["own.yaml"])
    assert found.counts["empty_flow"] == 12
    [settings] = {
        json.dumps(job.params.settings) for job in found.jobs if job.rule.name == "empty_flow"
    }
    assert json.loads(settings)["numerics"]["spacing_um"] == 2.0


def test_snakemake_has_no_note_on_the_workflow(tmp_path):
    """But that rules have no environments of their own: all share that of requirements.txt."""
    said = snakemake(copy_workflow(tmp_path), "--lint", check=False).stderr
    notes = set(re.findall(r"^ +\* (.*?)\.?:$", said, re.MULTILINE))
    assert notes == {"Specify a conda environment or container for each rule"}


def test_requirements_name_what_the_report_of_snakemake_needs():
    wanted = (ROOT / "requirements.txt").read_text().split()
    assert "pygments" in {re.split("[<>=]", line)[0] for line in wanted}


def test_results_of_other_physics_are_refused_unless_all_is_made_anew(finished, monkeypatch):
    stamp = finished / "results" / STAMP
    ours = stamp.read_text()
    try:
        stamp.write_text('{"dldsim_version": "0.0.1", "physics_version": -1}')
        monkeypatch.setattr(sys, "argv", ["snakemake", "-nj2"])
        with pytest.raises(WorkflowError, match="results holds results of physics version -1"):
            plan(finished, "all", config=TINY)
        monkeypatch.setattr(sys, "argv", ["snakemake", "-Fnj2"])
        assert plan(finished, "all", config=TINY).jobs
    finally:
        stamp.write_text(ours)


@pytest.mark.parametrize("place", [".", "results"])
def test_a_folder_that_cannot_be_written_is_refused_before_any_job(place, tmp_path, monkeypatch):
    folder = copy_workflow(tmp_path)
    (folder / "results").mkdir()

    def closed(path):
        if path == Path(place):
            raise DldsimError(f"Folder {path} cannot be written.")

    monkeypatch.setattr(campaign, "check_writable", closed)
    monkeypatch.setattr(sys, "argv", ["snakemake", "-j2"])
    with pytest.raises(WorkflowError, match="cannot be written"):
        plan(folder, "flows")
    monkeypatch.setattr(sys, "argv", ["snakemake", "-nj2"])
    assert planned(folder, "flows")


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ("preset=papr", "Did you mean paper?"),
        ("flow={heigth_um: 3}", "Did you mean height_um?"),
        ("sweep={gap_um: []}", "sweep.gap_um"),
        ("preset=", "preset: no value is given"),
        ("numerics={rows: 100}", "numerics.rows = 100"),
        ("cell={release_gap_fraction: 0.3}", "run_control.release_gap_fractions"),
    ],
)
def test_bad_configuration_is_told(tmp_path, change, part):
    folder = copy_workflow(tmp_path)
    with pytest.raises(WorkflowError, match=re.escape(part)):
        plan(folder, "all", config=[change])


def test_a_clone_and_an_environment_whose_path_has_a_blank(tmp_path):
    """Snakemake runs the interpreter through a shell, unquoted."""
    folder = tmp_path / "a clone's folder"
    venv.create(folder / ".venv", symlinks=True)
    [packages] = (folder / ".venv" / "lib").glob("*/site-packages")
    (packages / "ours.pth").write_text(f"{Path(pa.__file__).parents[1]}\n{ROOT}\n")
    (folder / "Snakefile").write_text(
        "from dldsim.config import campaign\ncampaign.quote_interpreter()\n"
        "rule all:\n    output: 'done.txt'\n    script: 'job.py'\n"
    )
    (folder / "job.py").write_text(
        "import sys\nopen(snakemake.output[0], 'w').write(sys.executable)\n"
    )
    python = folder / ".venv" / "bin" / "python"
    done = subprocess.run(
        [python, "-m", "snakemake", "-j1"], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert Path((folder / "done.txt").read_text()) == python


@pytest.mark.parametrize(
    ("home", "beside"),
    [
        ({"HOME": "/dev/null"}, True),
        ({}, True),
        ({"HOME": "{folder}"}, False),
        ({"XDG_CACHE_HOME": "{folder}"}, False),
    ],
)
def test_without_a_home_caches_lie_beside_the_environment(home, beside, tmp_path):
    """Snakemake cannot start without one."""
    shutil.copy(ROOT / "Makefile", tmp_path)
    environment = {name: value.format(folder=tmp_path) for name, value in home.items()}
    said = subprocess.run(
        ["make", "--silent", "--eval", 'show: ; @echo "$$XDG_CACHE_HOME"', "show"],
        cwd=tmp_path,
        env={"PATH": os.environ["PATH"], **environment},
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()
    assert (said == f"{tmp_path}/.venv/cache") == beside


def test_files_are_read_as_they_stand(tmp_path):
    """Snakemake's own reader would keep the last of two keys, and make 90 of 1:30."""
    folder = copy_workflow(tmp_path)
    extra = folder / "extra.yaml"
    for text, words in (
        ("flow: {height_um: 20}\nflow: {height_um: 24}\n", "extra.yaml is not valid YAML, line 2"),
        ("flow: {height_um: 1:30}\n", "flow.height_um(.|\n)*'1:30'"),
    ):
        extra.write_text(text)
        with pytest.raises(WorkflowError, match=words):
            plan(folder, "flows", files=["extra.yaml"])
    extra.write_text("limits: {run_hours: 1}\nnumerics: {spacing_um: 2}\n")
    assert planned(folder, "flows", files=["extra.yaml"])
