"""Which jobs a target asks for."""

from collections import Counter

import pytest
from snakemake.exceptions import WorkflowError

from dldsim.analysis import uncertainty
from dldsim.config import assays, campaign
from dldsim.config.presets import read_config
from dldsim.evidence import critical_gaps, reference_study
from dldsim.evidence.validation import CASES
from tests.workflow.snakemake_start import (
    ROOT,
    TINY,
    copy_workflow,
    plan,
    planned,
    snakemake,
    touch,
    write_survey,
)

pytestmark = pytest.mark.slow


VERIFIED = {"verify": 1, "verifications": 1, "report": 1, "all": 1}


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


def test_a_survey_that_is_not_there_is_told_before_anything_runs(finished, monkeypatch, tmp_path):
    asked = [*TINY, "surrogate={survey: true}"]
    monkeypatch.setattr("dldsim.analysis.learning.SURVEY", tmp_path / "none.parquet")
    with pytest.raises(
        WorkflowError, match="No survey comes with this installation.*survey: false"
    ):
        planned(finished, "surrogate", config=asked)
    assert "surrogate" not in planned(finished, "outcomes", config=asked)  # nor asked for
    write_survey(tmp_path / "some.parquet")
    monkeypatch.setattr("dldsim.analysis.learning.SURVEY", tmp_path / "some.parquet")
    after = {"surrogate": 1, "benchmark": 1, "learning_curve": 1, "sensitivity": 1}
    assert planned(finished, "all", config=asked) == {
        **after,
        "designs": 1,
        "search_regret": 1,
        **VERIFIED,
    }


def test_a_survey_of_other_numerics_is_told_before_anything_runs(finished, monkeypatch, tmp_path):
    write_survey(tmp_path / "other.parquet", lanes_in_domain=4)
    monkeypatch.setattr("dldsim.analysis.learning.SURVEY", tmp_path / "other.parquet")
    with pytest.raises(WorkflowError, match=r"lanes_in_domain \d \(survey: 4\)"):
        planned(finished, "surrogate", config=[*TINY, "surrogate={survey: true}"])


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
    assert set(jobs) == {"reference", "finest"}
    assert not jobs["reference"].input
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
    if (uncertainty.STUDIES / "biconcave" / "reference_outcomes.parquet").exists():
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
