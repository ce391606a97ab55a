"""What runs again after a change, and what does not."""

import shutil

import pytest

from dldsim.config import campaign
from tests.workflow.snakemake_start import TINY, plan, planned

pytestmark = pytest.mark.slow
AFTER_OUTCOMES = {
    "outcomes": 1,
    "anova": 1,
    "robustness_map": 1,
    "benchmark": 1,
    "surrogate": 1,
    "sensitivity": 1,
    "designs": 1,
    "learning_curve": 1,
    "search_regret": 1,
    "verify": 1,
    "verifications": 1,
    "report": 1,
    "all": 1,
}
VERIFIED = {"verify": 1, "verifications": 1, "report": 1, "all": 1}
SEEDED = {
    rule: n for rule, n in AFTER_OUTCOMES.items() if rule not in ("outcomes", "robustness_map")
}
AFTER_CALIBRATION = {"calibration": 1} | AFTER_OUTCOMES
AFTER_ASSAYS = {"assays": 1} | AFTER_CALIBRATION


GATHERED = {"runs": 1, "trajectories": 1}
SIMULATIONS = {"simulate_outcome": 16} | GATHERED
FLOWS = {"empty_flow": 8, "flows": 1}


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ("numerics={kernel: 4-point}", SIMULATIONS | {"assay_point": 11} | AFTER_ASSAYS),
        ("numerics={rows: 3}", SIMULATIONS | FLOWS | AFTER_OUTCOMES),
        ("flow={mean_velocity_mm_s: 2}", SIMULATIONS | FLOWS | AFTER_OUTCOMES),
        ("run_control={records_per_row: 9}", SIMULATIONS | AFTER_OUTCOMES),
        ("run_control={release_gap_fractions: [0.5, 0.7]}", SIMULATIONS | AFTER_OUTCOMES),
        (
            'stiffness_sets={"5": {ks_uN_per_m: 6}}',
            {"simulate_outcome": 8, "assay_point": 1} | GATHERED | AFTER_ASSAYS,
        ),
        ("constriction_groups={G4: {velocity_mm_s: 3}}", {"assay_point": 1} | AFTER_ASSAYS),
        ("constriction={release_positions_um: [0.0, 3.0]}", {"assay_point": 6} | AFTER_ASSAYS),
        ("assays={fixed-velocity: {velocity_mm_s: 2.5}}", {"assay_point": 3} | AFTER_ASSAYS),
        ("assays={gauge: {stress_Pa: 1.5}}", {"assay_point": 5} | AFTER_ASSAYS),
        ("assays={source-table: {error: 0.01}}", AFTER_CALIBRATION),
        ("default_assay=group-velocity", AFTER_CALIBRATION),
        ("calibration_library={assays: []}", {}),
        (
            "sweep={gap_um: [15, 20, 21]}",
            {"empty_flow": 4, "flows": 1, "simulate_outcome": 8} | GATHERED | AFTER_OUTCOMES,
        ),
        ("sweep={gap_um: [20]}", {"flows": 1} | GATHERED | AFTER_OUTCOMES),
        ("sweep={safety_distance_um: 1}", {"designs": 1, "search_regret": 1} | VERIFIED),
        ("device={array_width_mm: 3}", {"designs": 1, "search_regret": 1} | VERIFIED),
        ("verification={rounds: 2}", VERIFIED),
        ("seed=3", SEEDED),
    ],
)
def test_a_changed_value_reruns_its_dependents_only(finished, change, expected):
    assert planned(finished, "all", config=[*TINY, change]) == expected


AXIS = "cell={axis: z}"


@pytest.fixture
def copied(finished, tmp_path):
    """The finished campaign on another machine, without Snakemake's records."""
    folder = tmp_path / "elsewhere"
    shutil.copytree(finished, folder, ignore=shutil.ignore_patterns(".snakemake"))
    return folder


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ("seed=1", {}),
        (AXIS, SIMULATIONS | AFTER_OUTCOMES),
        ("seed=3", SEEDED),
        ("sweep={gap_um: [20]}", {"flows": 1} | GATHERED | AFTER_OUTCOMES),
        ("assays={fixed-velocity: {velocity_mm_s: 2.5}}", {"assay_point": 3} | AFTER_ASSAYS),
    ],
)
def test_copied_results_are_judged_by_what_they_say(copied, change, expected):
    assert planned(copied, "all", config=[*TINY, change]) == expected


def test_stale_files_are_named_with_what_differs(copied):
    said = plan(copied, "trajectories", config=[*TINY, AXIS]).said
    assert said.count("They are made anew.") == 1
    assert "simulate_outcome: files made with cell.axis = y, now z. They are made anew." in said


def test_files_of_other_settings_are_not_mixed_whatever_triggers_a_rerun(finished):
    counts = planned(
        finished, "runs", config=[*TINY, AXIS, "sweep={gap_um: [15, 20, 21]}"], triggers=["mtime"]
    )
    assert counts == {"empty_flow": 4, "simulate_outcome": 24, "runs": 1}


def test_a_stale_file_is_not_made_for_a_target_that_does_not_need_it(copied):
    assert planned(copied, "results/calibration.parquet", config=[*TINY, AXIS]) == {}


def test_a_touched_script_and_a_fresh_checkout_rerun_nothing(finished):
    """No file of the checkout is an input, so that no time stamp of it counts."""
    jobs = plan(finished, "all", "reference_check", config=TINY).jobs
    assert all(str(file).startswith("results/") for job in jobs for file in job.input)
    for path in (finished / "workflow").rglob("*.*"):
        path.touch()
    assert planned(finished, "all", config=TINY) == {}


def test_a_crash_is_tried_again_once_per_start(finished):
    crashes = finished / "results" / "crashes"
    campaign.record_crash(crashes, "r05.0_g15.0_n04_s1", "out of memory")
    try:
        counts = planned(finished, "all", config=TINY)
        assert counts == {"simulate_outcome": 1} | GATHERED | AFTER_OUTCOMES
    finally:
        shutil.rmtree(crashes)
