"""What of the configuration a rule hands to its jobs."""

import pytest
import yaml

from dldsim.config.configuration import Config
from tests.workflow.snakemake_start import ROOT, TINY, plan, write_survey

pytestmark = pytest.mark.slow


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
    "robustness_map",
    "validate_case",
    "validation",
    "stability",
    "reference_outcomes",
    "reference_check",
)
READS = {
    **dict.fromkeys(NOTHING, set()),
    "outcomes": {"run_control"},
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
    write_survey(tmp_path / "some.parquet")
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
