"""The graph of jobs: what runs, what reruns, what goes on after a failure."""

import json
import os
import re
import shutil
import subprocess
import sys
import venv
from collections import Counter
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml
from snakemake.exceptions import WorkflowError

from dldsim.config import assays, campaign
from dldsim.config.configuration import Config
from dldsim.config.presets import read_config
from dldsim.config.provenance import STAMP, settings_hash, stamp
from dldsim.errors import DldsimError
from dldsim.evidence import critical_gaps, reference_study
from dldsim.evidence.validation import CASES
from dldsim.tables.parquet import METADATA_KEY
from tests.snakemake_start import ROOT, TINY, copy_workflow, plan, planned, snakemake, touch

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
AFTER_CALIBRATION = {"calibration": 1} | AFTER_OUTCOMES
AFTER_ASSAYS = {"assays": 1} | AFTER_CALIBRATION


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A tiny campaign whose outputs Snakemake takes for finished; the files are empty shells that
    say what they were made with."""
    folder = copy_workflow(tmp_path_factory.mktemp("campaign"))
    for job in plan(folder, "all", config=TINY).jobs:
        for file in job.output:
            write_shell(folder / file, job.params.get("settings"))
    (folder / "results" / STAMP).write_text(json.dumps(stamp()))
    touch(folder, "all", config=TINY)
    assert planned(folder, "all", config=TINY) == {}
    return folder


def write_shell(path, settings):
    """An output without content."""
    path.parent.mkdir(parents=True, exist_ok=True)
    about = {"config_hash": settings_hash(settings or {}), "settings": settings}
    if path.parent.name == "designs":  # an output that is a folder
        path.mkdir(exist_ok=True)
    elif path.suffix == ".parquet":
        pq.write_table(
            pa.table({}).replace_schema_metadata({METADATA_KEY: json.dumps(about).encode()}), path
        )
    else:
        path.write_text(json.dumps({"provenance": about}))


@pytest.mark.parametrize(("preset", "geometries"), [("quick", 27), ("paper", 36), ("full", 210)])
def test_presets_plan_their_outcomes(preset, geometries, tmp_path):
    folder = copy_workflow(tmp_path)
    counts = planned(folder, "all", config=[f"preset={preset}"])
    config = read_config(ROOT / "config.yaml", {"preset": preset})
    assert counts["simulate_outcome"] == len(campaign.outcomes(config))
    assert counts["empty_flow"] == geometries
    assert counts["assay_point"] == len(assays.points(config))
    assert counts["report"] == counts["all"] == 1


def test_named_target_runs_only_its_part(tmp_path):
    folder = copy_workflow(tmp_path)
    assert set(planned(folder, "calibration")) == {"assay_point", "assays", "calibration"}
    counts = planned(folder, "robustness_map")
    assert counts["robustness_map"] == 1
    assert not {"report", "surrogate", "designs", "anova", "benchmark"} & set(counts)


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
        (
            "seed=3",
            {
                "anova": 1,
                "sensitivity": 1,
                "benchmark": 1,
                "surrogate": 1,
                "designs": 1,
                "learning_curve": 1,
                "search_regret": 1,
            }
            | VERIFIED,
        ),
    ],
)
def test_a_changed_value_reruns_its_dependents_only(finished, change, expected):
    assert planned(finished, "all", config=[*TINY, change]) == expected


def test_a_survey_that_is_not_there_is_told_before_anything_runs(finished, monkeypatch, tmp_path):
    asked = [*TINY, "surrogate={survey: true}"]
    monkeypatch.setattr("dldsim.analysis.learning.SURVEY", tmp_path / "none.parquet")
    with pytest.raises(
        WorkflowError, match="No survey comes with this installation.*survey: false"
    ):
        planned(finished, "surrogate", config=asked)
    assert "surrogate" not in planned(finished, "outcomes", config=asked)  # nor asked for
    (tmp_path / "some.parquet").write_bytes(b"a survey")
    monkeypatch.setattr("dldsim.analysis.learning.SURVEY", tmp_path / "some.parquet")
    after = {"surrogate": 1, "benchmark": 1, "learning_curve": 1, "sensitivity": 1}
    assert planned(finished, "all", config=asked) == {
        **after,
        "designs": 1,
        "search_regret": 1,
        **VERIFIED,
    }


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
    snakemake(copy_workflow(tmp_path), "--lint")


def test_requirements_are_said_once():
    """The environment for conda names what pip installs, and what `snakemake --report` needs."""
    wanted = (ROOT / "requirements.txt").read_text().split()
    environment = yaml.safe_load((ROOT / "workflow" / "envs" / "dldsim.yaml").read_text())
    assert environment["dependencies"][-1]["pip"] == wanted
    assert "pygments" in {re.split("[<>=]", line)[0] for line in wanted}


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
        (
            "seed=3",
            {
                "anova": 1,
                "sensitivity": 1,
                "benchmark": 1,
                "surrogate": 1,
                "designs": 1,
                "learning_curve": 1,
                "search_regret": 1,
            }
            | VERIFIED,
        ),
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


EVERYTHING = (
    "all",
    "validation",
    "accuracy",
    "stability",
    "reference",
    "reference_check",
    "spot_check",
    "survey",
    "calibration_library",
    "assay_study",
)
OUTCOME = {"cell", "flow", "numerics", "run_control", "stiffness_sets"}
DESIGN = {"seed", "flow", "device", "design_requests", "sweep", "stiffness_sets"}
NOTHING = (
    "flows",
    "runs",
    "trajectories",
    "outcomes",
    "robustness_map",
    "validate_case",
    "validation",
    "stability",
    "reference_outcomes",
    "reference_check",
)
READS = {
    **dict.fromkeys(NOTHING, set()),
    **dict.fromkeys(("anova", "spot_check", "spot_check_plan"), {"seed"}),
    **dict.fromkeys(
        ("benchmark", "learning_curve", "surrogate", "verifications"), {"seed", "surrogate"}
    ),
    **dict.fromkeys(("simulate_outcome", "spot_check_release", "spot_check_run"), OUTCOME),
    **dict.fromkeys(
        ("reference_pair", "critical_gap_point", "critical_gaps"), OUTCOME | {"reference"}
    ),
    "designs": DESIGN | {"surrogate"},
    "search_regret": DESIGN,
    "survey_plan": {"seed", "cell", "flow", "numerics", "stiffness_sets", "survey"},
    "survey_point": {"cell", "flow", "numerics", "run_control"},
    "survey": {"survey"},
    "empty_flow": {"flow", "numerics"},
    "assays": {"cell"},
    "assay_point": {  # its cell is in its name
        "flow",
        "numerics",
        "stiffness_sets",
        "constriction",
        "constriction_groups",
        "assays",
        "assay_study",
    },
    "calibration": {"default_assay", "stiffness_sets"},
    "calibration_library": {"default_assay", "stiffness_sets", "calibration_library"},
    "assay_study": {"default_assay", "stiffness_sets"},
    "sensitivity": {"seed", "fabrication"},
    "verify": OUTCOME | DESIGN | {"verification", "surrogate"},
    "accuracy_run": OUTCOME | {"accuracy", "constriction", "constriction_groups"},
    "accuracy": {"accuracy", "cell", "numerics", "run_control", "constriction"},
    "stability_family": {"cell", "flow", "numerics", "stiffness_sets", "constriction_groups"},
    "report": {
        "preset",
        "seed",
        "cell",
        "flow",
        "numerics",
        "run_control",
        "constriction",
        "assays",
        "default_assay",
        "design_requests",
    },
}
"""Sections of which a rule's jobs depend on at least one value."""
CHANGES = {
    "seed": "seed=3",
    "sweep": "sweep={safety_distance_um: 1}",
    "cell": "cell={radius_um: 7.0}",
    "flow": "flow={viscosity_mPa_s: 1.0}",
    "numerics": "numerics={collision: bgk}",
    "run_control": "run_control={still_rows: 9}",
    "constriction": "constriction={width_um: 31}",
    "stiffness_sets": "stiffness_sets={'1': {ks_uN_per_m: 6}, '5': {ks_uN_per_m: 21}}",
    "constriction_groups": "constriction_groups={G1: {velocity_mm_s: 2}}",
    "assays": "assays={gauge: {stress_Pa: 1.5}}",
    "default_assay": "default_assay=group-velocity",
    "calibration_library": "calibration_library={cells: [{shape: sphere, radius_um: 8.0}]}",
    "assay_study": "assay_study={assays: {shear-low: {stress_Pa: 0.1}}}",
    "design_requests": "design_requests=[{name: soft-from-stiff, stiffness_set_1: '1', "
    "stiffness_set_2: '5', trials: 30}]",
    "verification": "verification={rounds: 2}",
    "device": "device={array_width_mm: 3}",
    "fabrication": "fabrication={moved_deg: 0.7}",
    "accuracy": "accuracy={migration_angle: {long_rows: 90}}",
    "reference": "reference={releases: [0.2, 0.5]}",
    "survey": "survey={shapes: {biconcave: {round_points: 2}}}",
    "limits": "limits={memory_GB: 15}",
    "surrogate": "surrogate={survey: true}",  # TINY has false
}


SMALL = {
    "assay_study": {
        "of_campaign": [],
        "cells": [{"shape": "sphere", "radius_um": 7.5}],
        "assays": dict.fromkeys(
            ("shear-middle", "shear-high", "channel-slow", "channel-fast", "slit-8", "slit-12")
        ),
    },
    "calibration_library": {"cells": [{"shape": "sphere", "radius_um": 6.0}]},
    "accuracy": {
        "migration_angle": {
            "cases": {"zigzag": None, "transition": None},
            "alternatives": None,
            "knobs": dict.fromkeys(
                (
                    "spacing_um",
                    "reynolds_max",
                    "kernel",
                    "axis",
                    "relaxation_time",
                    "coupling",
                    "rows",
                )
            ),
        },
        "deformation_index": {
            "cases": ["G1"],
            "alternatives": None,
            "knobs": dict.fromkeys(
                ("spacing_um", "reynolds_max", "kernel", "relaxation_time", "coupling")
            ),
        },
    },
    "reference": {
        "pairs": ["r04.0_g14.0_n10_s5"],
        "finest": [],
        "spacings_um": [],
        "reynolds_max": [0.3],
        "critical_diameters": {"periodicities": []},
        "critical_gaps": [
            {
                "pillar_radius_um": 8.0,
                "periodicity": 10,
                "stiffness_set": "1",
                "bracket_um": [15.0, 21.0],
            }
        ],
    },
}
"""Studies of a few jobs, so that the plans are quick."""


def handed_out(folder, *files, **options):
    """All parameters of each job, of all targets."""
    (folder / "small.yaml").write_text(yaml.safe_dump(SMALL))
    options["files"] = ["small.yaml", *files]
    return {
        (job.rule.name, str(job.wildcards_dict)): str(sorted(job.params.items()))
        for job in plan(folder, *EVERYTHING, **options).jobs
        if not job.rule.norun
    }


@pytest.fixture(scope="module")
def unchanged(finished):
    return handed_out(finished, config=TINY)


@pytest.mark.parametrize("section", [name for name in Config.model_fields if name != "preset"])
def test_a_rule_hands_out_what_its_jobs_read_and_nothing_more(
    finished, unchanged, section, monkeypatch, tmp_path
):
    (tmp_path / "some.parquet").write_bytes(b"a survey")
    monkeypatch.setattr("dldsim.analysis.learning.SURVEY", tmp_path / "some.parquet")
    changed = handed_out(finished, config=[*TINY, CHANGES[section]])
    differing = {job[0] for job, given in unchanged.items() if changed.get(job, given) != given}
    assert differing == {rule for rule, sections in READS.items() if section in sections}


def test_every_rule_is_looked_at_and_only_the_report_reads_the_name_of_the_preset(
    finished, unchanged
):
    assert {job[0] for job in unchanged} == set(READS)
    own = {
        "preset": "own",
        "presets": {"own": yaml.safe_load((ROOT / "config.yaml").read_text())["presets"]["tiny"]},
    }
    (finished / "own.yaml").write_text(yaml.safe_dump(own))
    renamed = handed_out(finished, "own.yaml")
    assert {job[0] for job in unchanged if renamed[job] != unchanged[job]} == {"report"}


def test_the_reference_is_a_target_of_its_own(tmp_path):
    folder = copy_workflow(tmp_path)
    counts = planned(folder, "reference")
    config = read_config(ROOT / "config.yaml")
    searches = critical_gaps.searches(config)
    assert counts == {
        "reference_pair": len(reference_study.pairs(config)),
        "critical_gap_point": critical_gaps.POINTS * len(searches),
        "reference_outcomes": 1,
        "critical_gaps": 1,
        "reference": 1,
    }
    for target in ("all", "accuracy"):
        assert not {"reference_pair", "critical_gap_point"} & set(planned(folder, target))


def test_a_finer_pair_goes_on_with_the_cells_of_the_coarser_one(tmp_path):
    folder = copy_workflow(tmp_path)
    run = read_config(ROOT / "config.yaml").reference.finest[0]
    wanted = f"results/reference/pairs/{run}--finest.cells.npz"
    jobs = {job.wildcards.numerics: job for job in plan(folder, wanted).jobs}
    assert set(jobs) == {"campaign", "reference", "finest"}
    assert not jobs["campaign"].input
    for finer, coarser in reference_study.COARSER.items():
        assert [*jobs[finer].input] == [jobs[coarser].output.cells]
        assert (
            jobs[finer].params.settings["coarser"]["numerics"]
            == (jobs[coarser].params.settings["numerics"])
        )


def test_a_finished_point_is_not_made_again(tmp_path):
    """The second point of a search, and what follows, but not the first."""
    folder = copy_workflow(tmp_path)
    config = read_config(ROOT / "config.yaml")
    first = critical_gaps.search_id(critical_gaps.searches(config)[0])
    files = [f"results/reference/searches/{first}--{number}.parquet" for number in range(3)]
    for name in files[:2]:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("shell")
    touch(folder, files[1])
    assert planned(folder, files[2]) == {"critical_gap_point": 1}


def test_a_comparison_without_a_reference_is_refused_before_it_runs(tmp_path):
    """Where the package holds one, its pairs are simulated at the campaign's numerics."""
    folder = copy_workflow(tmp_path)
    if (reference_study.DATA / "reference_outcomes.parquet").exists():
        pairs = read_config(ROOT / "config.yaml").reference.pairs
        assert planned(folder, "reference_check") == {
            "reference_pair": len(pairs),
            "reference_check": 1,
        }
    else:
        done = snakemake(folder, "-n", "reference_check", check=False)
        assert done.returncode != 0 and "holds no reference" in done.stdout + done.stderr


def test_validation_is_a_target_of_its_own(tmp_path):
    """The report takes it in where it is there."""
    folder = copy_workflow(tmp_path)
    assert planned(folder, "validation") == {"validate_case": len(CASES), "validation": 1}
    assert "validation" not in {job.rule.name for job in plan(folder, "all", config=TINY).jobs}
    (folder / "results").mkdir()
    (folder / "results" / "validation.parquet").write_text("made before")
    assert "validation" in {job.rule.name for job in plan(folder, "all", config=TINY).jobs}


def test_the_spot_check_follows_the_campaign(finished):
    counts = planned(finished, "spot_check", config=TINY)
    assert counts == {
        "spot_check_plan": 1,
        "spot_check_release": 1,
        "spot_check_run": 1,
        "spot_check": 1,
    }


def test_the_survey_knows_its_jobs_before_its_points(finished):
    """Of the survey's settings those of later rounds, and of the campaign's velocity and height,
    make no earlier round anew."""
    jobs = plan(finished, "survey", config=TINY).jobs
    counts = Counter(job.rule.name for job in jobs)
    assert counts == {"survey_plan": 2, "survey_point": 3, "survey": 1}
    given = {
        job.params.settings["survey"]["rounds"]: job for job in jobs if "plan" in job.rule.name
    }
    assert (len(given[0].input), len(given[1].input)) == (0, 2)
    for change in ("survey={rounds: 2}", "flow={mean_velocity_mm_s: 2, height_um: 30}"):
        changed = {
            str(job.wildcards_dict): job.params.settings
            for job in plan(finished, "survey", config=[*TINY, change]).jobs
            if job.rule.name != "survey"
        }
        assert all(
            changed[str(job.wildcards_dict)] == job.params.settings
            for job in jobs
            if job.rule.name != "survey"
        )
    more = plan(
        finished, "survey", config=[*TINY, "survey={shapes: {biconcave: {round_points: 2}}}"]
    )
    first, *_ = (
        job for job in more.jobs if str(job.wildcards_dict) == str(given[0].wildcards_dict)
    )
    assert first.params.settings == given[0].params.settings


def test_a_crash_is_tried_again_once_per_start(finished):
    crashes = finished / "results" / "crashes"
    campaign.record_crash(crashes, "r05.0_g15.0_n04_s1", "out of memory")
    try:
        counts = planned(finished, "all", config=TINY)
        assert counts == {"simulate_outcome": 1} | GATHERED | AFTER_OUTCOMES
    finally:
        shutil.rmtree(crashes)


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
