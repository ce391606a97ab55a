"""The graph of jobs: what runs, what reruns, what goes on after a failure."""

import json
import os
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from dldsim.config import campaign
from dldsim.config.presets import read_config
from dldsim.config.provenance import STAMP, stamp
from dldsim.evidence import reference_study
from dldsim.tables.parquet import read_rows

ROOT = Path(__file__).parents[1]
PARTS = ("Snakefile", "config.yaml", "workflow", "profiles")
AFTER_OUTCOMES = {"outcomes": 1, "anova": 1, "robustness_map": 1, "benchmark": 1, "surrogate": 1,
              "sensitivity": 1,
              "designs": 1, "learning_curve": 1, "search_regret": 1, "verify": 1,
              "verifications": 1, "report": 1, "all": 1}
VERIFIED = {"verify": 1, "verifications": 1, "report": 1, "all": 1}
AFTER_CONSTRICTION = {"constriction_runs": 1, "calibration": 1} | AFTER_OUTCOMES


def snakemake(folder, *argv, check=True):
    """Run snakemake on a copy of the workflow; returns the finished process."""
    done = subprocess.run(
        [sys.executable, "-m", "snakemake", "-j2", *argv],
        cwd=folder, env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert not check or done.returncode == 0, done.stdout + done.stderr
    return done


def planned(folder, *argv):
    """Number of jobs of each rule that a dry run announces."""
    done = snakemake(folder, "-n", *argv)
    lines = (done.stdout + done.stderr).splitlines()
    counts = {}
    for line in lines:
        words = line.split()
        if len(words) == 2 and words[1].isdecimal() and words[0] != "total":
            counts[words[0]] = int(words[1])
        elif words[:1] == ["total"]:
            break
    return counts


def copy_workflow(folder):
    for name in PARTS:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        copy(ROOT / name, folder / name)
    return folder


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A tiny campaign whose outputs Snakemake takes for finished; the files are empty shells."""
    folder = copy_workflow(tmp_path_factory.mktemp("campaign"))
    config = ["--config", "preset=tiny"]
    summary = snakemake(folder, "all", "--summary", *config).stdout.splitlines()
    for line in summary[1:]:
        path = folder / line.split("\t")[0]
        if path.parent.name == "designs":  # an output that is a folder
            path.mkdir(parents=True, exist_ok=True)
            continue
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("shell")
    (folder / "results" / STAMP).write_text(json.dumps(stamp()))
    snakemake(folder, "all", "--touch", "--forceall", *config)
    assert planned(folder, "all", *config) == {}
    return folder


@pytest.mark.parametrize(("preset", "geometries"), [("quick", 27), ("paper", 36), ("full", 210)])
def test_presets_plan_their_outcomes(preset, geometries, tmp_path):
    folder = copy_workflow(tmp_path)
    counts = planned(folder, "all", "--config", f"preset={preset}")
    config = read_config(ROOT / "config.yaml", {"preset": preset})
    assert counts["simulate_outcome"] == len(campaign.outcomes(config))
    assert counts["empty_flow"] == geometries
    assert counts["constrict"] == len(campaign.constrictions(config))
    assert counts["report"] == counts["all"] == 1


def test_named_target_runs_only_its_part(tmp_path):
    folder = copy_workflow(tmp_path)
    assert set(planned(folder, "calibration")) == {
        "constrict", "constriction_runs", "calibration"
    }
    counts = planned(folder, "robustness_map")
    assert counts["robustness_map"] == 1
    assert not {"report", "surrogate", "designs", "anova", "benchmark"} & set(counts)


GATHERED = {"runs": 1, "trajectories": 1}
SIMULATIONS = {"simulate_outcome": 16} | GATHERED
FLOWS = {"empty_flow": 8, "flows": 1}


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ("numerics={kernel: 4-point}", SIMULATIONS | {"constrict": 6} | AFTER_CONSTRICTION),
        ("numerics={rows: 3}", SIMULATIONS | FLOWS | AFTER_OUTCOMES),
        ("flow={mean_velocity_mm_s: 2}", SIMULATIONS | FLOWS | AFTER_OUTCOMES),
        ("run_control={records_per_row: 9}", SIMULATIONS | AFTER_OUTCOMES),
        ("run_control={release_gap_fractions: [0.5, 0.7]}", SIMULATIONS | AFTER_OUTCOMES),
        ('stiffness_sets={"5": {ks_uN_per_m: 6}}',
         {"simulate_outcome": 8} | GATHERED | AFTER_OUTCOMES),
        ("constriction_groups={G4: {velocity_mm_s: 2}}", {"constrict": 1} | AFTER_CONSTRICTION),
        ("constriction={release_positions_um: [0.0, 3.0]}", {"constrict": 6} | AFTER_CONSTRICTION),
        ("constriction={fixed_velocity_mm_s: 2.5}", {"constrict": 3} | AFTER_CONSTRICTION),
        ("sweep={gap_um: [15, 20, 21]}", {"empty_flow": 4, "flows": 1, "simulate_outcome": 8}
         | GATHERED | AFTER_OUTCOMES),
        ("sweep={gap_um: [20]}", {"flows": 1} | GATHERED | AFTER_OUTCOMES),
        ("sweep={safety_distance_um: 1}", {"designs": 1, "search_regret": 1} | VERIFIED),
        ("device={array_width_mm: 3}", {"designs": 1, "search_regret": 1} | VERIFIED),
        ("verification={rounds: 2}", VERIFIED),
        ("seed=3", {"anova": 1, "sensitivity": 1, "benchmark": 1,
                    "surrogate": 1, "designs": 1, "learning_curve": 1,
                    "search_regret": 1} | VERIFIED),
    ],
)
def test_a_changed_value_reruns_its_dependents_only(finished, change, expected):
    assert planned(finished, "all", "--config", "preset=tiny", change) == expected


def test_the_reference_is_a_target_of_its_own(tmp_path):
    folder = copy_workflow(tmp_path)
    counts = planned(folder, "reference")
    config = read_config(ROOT / "config.yaml")
    searches = reference_study.searches(config)
    assert counts == {
        "reference_pair": len(reference_study.pairs(config)),
        "critical_gap_point": reference_study.POINTS * len(searches),
        "reference_outcomes": 1, "critical_gaps": 1, "reference": 1,
    }  # fmt: skip
    for target in ("all", "accuracy"):
        assert not {"reference_pair", "critical_gap_point"} & set(planned(folder, target))


def test_a_finished_point_is_not_made_again(tmp_path):
    """The second point of a search, and what follows, but not the first."""
    folder = copy_workflow(tmp_path)
    config = read_config(ROOT / "config.yaml")
    first = reference_study.search_id(reference_study.searches(config)[0])
    files = [f"results/reference/searches/{first}--{number}.parquet" for number in range(3)]
    for name in files[:2]:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("shell")
    snakemake(folder, files[1], "--touch", "--forceall")
    assert planned(folder, files[2]) == {"critical_gap_point": 1}


def test_a_comparison_without_a_reference_is_refused_before_it_runs(tmp_path):
    """Where the package holds one, its pairs are simulated at the campaign's numerics."""
    folder = copy_workflow(tmp_path)
    if (reference_study.DATA / "reference_outcomes.parquet").exists():
        pairs = read_config(ROOT / "config.yaml").reference.pairs
        assert planned(folder, "reference_check") == {
            "reference_pair": len(pairs), "reference_check": 1}
    else:
        done = snakemake(folder, "-n", "reference_check", check=False)
        assert done.returncode != 0 and "holds no reference" in done.stdout + done.stderr


def test_the_spot_check_follows_the_campaign(finished):
    counts = planned(finished, "spot_check", "--config", "preset=tiny")
    assert counts == {"spot_check_plan": 1, "spot_check_run": 1, "spot_check": 1}


def test_a_crash_is_tried_again_once_per_start(finished):
    crashes = finished / "results" / "crashes"
    campaign.record_crash(crashes, "r05.0_g15.0_n04_s1", "out of memory")
    try:
        counts = planned(finished, "all", "--config", "preset=tiny")
        assert counts == {"simulate_outcome": 1} | GATHERED | AFTER_OUTCOMES
    finally:
        shutil.rmtree(crashes)


def test_results_of_other_physics_are_refused(finished):
    stamp = finished / "results" / STAMP
    ours = stamp.read_text()
    try:
        stamp.write_text('{"dldsim_version": "0.0.1", "physics_version": -1}')
        done = snakemake(finished, "-n", "all", "--config", "preset=tiny", check=False)
        assert done.returncode != 0
        assert "results holds results of physics version -1" in done.stdout + done.stderr
        assert planned(finished, "all", "--forceall", "--config", "preset=tiny")
    finally:
        stamp.write_text(ours)


@pytest.mark.parametrize(
    ("change", "part"),
    [("preset=papr", "Did you mean paper?"), ("flow={heigth_um: 3}", "Did you mean height_um?"),
     ("sweep={gap_um: []}", "sweep.gap_um"), ("preset=", "preset: no value is given"),
     ("numerics={rows: 100}", "numerics.rows = 100"),
     ("cell={release_gap_fraction: 0.3}", "run_control.release_gap_fractions")],
)
def test_bad_configuration_is_told(tmp_path, change, part):
    folder = copy_workflow(tmp_path)
    done = snakemake(folder, "-n", "all", "--config", change, check=False)
    assert done.returncode != 0 and part in done.stdout + done.stderr


def test_files_are_read_as_they_stand(tmp_path):
    """Snakemake's own reader would keep the last of two keys, and make 90 of 1:30."""
    folder = copy_workflow(tmp_path)
    extra = folder / "extra.yaml"
    extra.write_text("flow: {height_um: 20}\nflow: {height_um: 24}\n")
    argv = ("-n", "all", "--configfile", str(extra))
    done = snakemake(folder, *argv, check=False)
    assert "extra.yaml is not valid YAML, line 2" in done.stdout + done.stderr
    extra.write_text("flow: {height_um: 1:30}\n")
    done = snakemake(folder, *argv, check=False)
    assert "flow.height_um" in done.stdout + done.stderr and "'1:30'" in done.stdout + done.stderr
    extra.write_text("limits: {run_hours: 1}\nnumerics: {spacing_um: 2}\n")
    assert snakemake(folder, *argv).returncode == 0


@pytest.mark.campaign
def test_tiny_campaign_end_to_end(tmp_path):
    """Real simulations through to the report; then nothing is left to do."""
    folder = copy_workflow(tmp_path)
    config = ["--config", "preset=tiny"]
    done = snakemake(folder, "all", *config)
    results = folder / "results"
    assert "Done: results/" in done.stdout + done.stderr
    for kind, name in {
        "outcomes": "outcomes", "runs": "runs", "flows": "flows", "trajectory": "trajectories",
        "calibration": "calibration", "constriction_runs": "constriction_runs",
        "calibration_correlations": "calibration_correlations", "anova": "anova",
        "robustness": "robustness", "benchmark": "benchmark", "predictions": "predictions",
        "designs": "designs", "design_trials": "design_trials",
        "design_tolerances": "design_tolerances", "design_importance": "design_importance",
        "design_slices": "design_slices", "verifications": "verifications",
        "verified_designs": "verified_designs",
        "learning_curve": "learning_curve", "search_regret": "search_regret",
    }.items():
        assert read_rows(kind, results / f"{name}.parquet"), name
        assert name == "trajectories" or (results / f"{name}.csv").exists()
    outcomes = read_rows("outcomes", results / "outcomes.parquet")
    statuses = Counter(outcome["status"] for outcome in outcomes)
    assert len(outcomes) == 16 and not statuses["failed"], statuses
    assert all(outcome["deformation_index"] is not None for outcome in outcomes)
    runs = Counter(run["outcome_id"] for run in read_rows("runs", results / "runs.parquet"))
    assert {o["outcome_id"]: o["releases"] for o in outcomes} == runs
    assert not [*(results / "partial").glob("*")]
    assert "<html" in (results / "report.html").read_text(encoding="utf-8")[:500].lower()
    assert planned(folder, "all", *config) == {}


def test_after_a_failure_the_report_shows_what_there_is(tmp_path):
    """A rule fails while an older report lies there: it gives way to one that names the reason."""
    folder = copy_workflow(tmp_path)
    results = folder / "results"
    results.mkdir()
    shutil.copy(ROOT / "dldsim" / "data" / "campaign" / "flows.parquet", results)
    (results / "outcomes.parquet").write_bytes(b"PAR1 cut short")
    (results / "report.html").write_text("older")
    done = snakemake(folder, "anova", "--allowed-rules", "anova", check=False)
    assert done.returncode != 0
    assert "The report of what there is" in done.stdout + done.stderr
    page = (results / "report.html").read_text(encoding="utf-8")
    assert "<h2>Flow without a cell</h2>" in page and "outcomes.parquet is not a readable" in page
    assert "The log anova.log ends" in page
