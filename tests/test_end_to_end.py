"""Real campaigns, tiny, from the configuration to the report."""

import shutil
from collections import Counter

import pytest

from dldsim.tables.parquet import read_rows
from tests.workflow.snakemake_start import ROOT, TINY, copy_workflow, planned, snakemake

pytestmark = pytest.mark.slow


def test_tiny_campaign_end_to_end(tmp_path):
    """Real simulations through to the report; then nothing is left to do."""
    folder = copy_workflow(tmp_path)
    half = [*TINY, "sweep={gap_um: null, gap_minus_radius_um: 10.0}"]
    done = snakemake(folder, "all", "--config", *half)
    results = folder / "results"
    assert "Done: results/" in done.stdout + done.stderr
    for kind, name in {
        "outcomes": "outcomes",
        "runs": "runs",
        "flows": "flows",
        "trajectory": "trajectories",
        "calibration": "calibration",
        "assay_runs": "assay_runs",
        "calibration_correlations": "calibration_correlations",
        "anova": "anova",
        "robustness": "robustness",
        "benchmark": "benchmark",
        "predictions": "predictions",
        "designs": "designs",
        "design_trials": "design_trials",
        "design_tolerances": "design_tolerances",
        "design_importance": "design_importance",
        "design_slices": "design_slices",
        "verifications": "verifications",
        "verified_designs": "verified_designs",
        "learning_curve": "learning_curve",
        "search_regret": "search_regret",
    }.items():
        assert read_rows(kind, results / f"{name}.parquet"), name
        assert name == "trajectories" or (results / f"{name}.csv").exists()
    outcomes = read_rows("outcomes", results / "outcomes.parquet")
    statuses = Counter(outcome["status"] for outcome in outcomes)
    assert len(outcomes) == 8 and not statuses["failed"], statuses
    assert all(outcome["deformation_index"] is not None for outcome in outcomes)
    runs = Counter(run["outcome_id"] for run in read_rows("runs", results / "runs.parquet"))
    assert {o["outcome_id"]: o["releases"] for o in outcomes} == runs
    assert not [*(results / "partial").glob("*")]
    assert "<html" in (results / "report.html").read_text(encoding="utf-8")[:500].lower()
    assert planned(folder, "all", config=half) == {}


def test_tiny_survey_end_to_end(tmp_path):
    """Two first points and one chosen from their outcomes; then nothing is left to do. A plan made
    anew with the same points costs no simulation."""
    folder = copy_workflow(tmp_path)
    done = snakemake(folder, "survey", "--config", *TINY)
    assert "point 0002, round 1: biconcave of R = 7.5 µm, Ca = " in done.stderr
    results = folder / "results" / "survey"
    points = read_rows("survey_plan", results / "plan.parquet")
    outcomes = read_rows("outcomes", results / "outcomes.parquet")
    assert [p["outcome_id"] for p in points] == [o["outcome_id"] for o in outcomes]
    assert [p["round"] for p in points] == [0, 0, 1]
    for point, outcome in zip(points, outcomes, strict=True):
        assert outcome["status"] not in ("failed", "unstable"), outcome["stop_reason"]
        same = ("height_um", "mean_velocity_mm_s", "ks_uN_per_m", "cell_shape", "gap_um")
        assert [point[name] for name in same] == [outcome[name] for name in same]
        assert outcome["capillary_number"] == pytest.approx(point["capillary_number"])
        assert outcome["sigma_num_basis"] != "not joined yet"
    assert {r["outcome_id"] for r in read_rows("runs", results / "runs.parquet")} == {
        o["outcome_id"] for o in outcomes
    }
    assert len(read_rows("flows", results / "flows.parquet")) == 3
    assert planned(folder, "survey", config=TINY) == {}
    shutil.rmtree(results / "points")
    snakemake(folder, "survey", "--config", *TINY)
    assert read_rows("outcomes", results / "outcomes.parquet") == outcomes  # wall times too


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
