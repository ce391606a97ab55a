"""The command `design`, on a made-up campaign: answers, refusals, and what the campaign lacks."""

import re
import shutil
import time
from pathlib import Path

import pytest

from dldsim import PHYSICS_VERSION
from dldsim.app import cli, design_answers
from dldsim.tables.parquet import read_rows, read_table, write_table
from dldsim.tables.registry import COLUMNS
from tests.app.conftest import SETS
from tests.app.test_cli import call
from tests.design.known_surrogate import Known
from tests.design.test_verification import Nature, summit
from tests.design.test_verification import check as check_designs

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("nowhere")]

ASK = ["--set1", "1", "--set2", "3", "--trials", "30", "--startup-trials", "15"]
CONFIG = (Path(__file__).parents[2] / "config.yaml").read_text(encoding="utf-8")


def test_design_answers_within_a_minute(capsys, campaign, tmp_path):
    start = time.process_time()
    code, summary, _ = call(capsys, "design", *ASK, "--results", campaign, "--output", tmp_path)
    assert code == 0 and time.process_time() - start < 60
    first = summary["designs"][0]
    assert set(first) == {c.name for c in COLUMNS["designs"]}
    assert first["pressure_drop_kPa"] > 0 and "interpolated" in first["pressure_basis"]
    first, second = summary["populations"]
    assert (first["ks_uN_per_m"], first["deformation_index"]) == (5.1, 0.5)
    assert first["ks_low_uN_per_m"] == first["ks_high_uN_per_m"] == 5.1  # a set is exact
    assert second["capillary_number"] == pytest.approx(0.75 / 20.3) and summary["doubt"] == ""
    assert summary["verified_designs"] is None
    for kind in design_answers.SEARCH:
        assert len(read_rows(kind, tmp_path / f"{kind}.parquet")) > 0
    written = read_rows("designs", tmp_path / "designs.parquet")
    assert [d["gap_um"] for d in summary["designs"]] == [d["gap_um"] for d in written]


def test_design_prints_a_summary_to_be_read(capsys, campaign):
    assert cli.main(["design", *ASK, "--results", str(campaign)]) == 0
    text = capsys.readouterr().out
    for words in (
        "predicted, not simulated",
        "one thing off",
        "importance (",
        "Add --verify",
        "cell 1: biconcave, radius 7.5 µm",
        "k_s 5.1 µN/m, Ca = μU/k_s 0.147: stiffness set 1",
        "mean velocity 0.5 mm/s, channel height 20 µm",
        "edge_um",
    ):
        assert words in text


@pytest.mark.parametrize(
    ("argv", "parts"),
    [
        (["--di1", "0.3", "--di2", "0.7"], ["deformation_index_1 = 0.3", "0.5 to 0.78"]),
        (["--di1", "0.6", "--di2", "1.7"], ["deformation_index_2", "1.7", "≤ 1"]),
        (["--di1", "0.6", "--di2", "0.6"], ["both cell types", "Change one"]),
        (["--set1", "9", "--set2", "1"], ["stiffness set 9", "known: 1, 2, 3"]),
        (["--ks1", "5", "--set2", "3", "--velocity", "5"], ["Ca = μU/k_s = 1.5", "velocities of"]),
        (["--shape1", "sphere", "--ks1", "9", "--set2", "1"], ["sphere was not learnt", "survey"]),
        (["--rigid1", "--set2", "1"], ["rigid_1 with shape_1", "sphere"]),
        (["--di1", "0.6", "--set2", "1", "--assay", "mine"], ["no assay 'mine'", "group-velocity"]),
        ([*ASK, "--gap-um", "20", "14"], ["gap_um", "lowest bound first"]),
        ([*ASK, "--gap-um", "5", "6"], ["no geometry", "safety", "gap_um"]),
        ([*ASK, "--pillar-radius-um", "0.5", "1"], ["no geometry", "slender"]),
        ([*ASK, "--pressure-max-kpa", "1e-9"], ["none of 30 trials", "pressure drop"]),
        ([*ASK, "--r1", "-1"], ["radius_1_um", "-1", "number ≥ 0.1"]),
        ([*ASK, "--objective", "best"], ["--objective", "robust"]),
    ],
)
def test_impossible_requests_are_told(capsys, campaign, argv, parts):
    code, summary, message = call(capsys, "design", *argv, "--results", campaign)
    assert (code, summary) == (2, None)
    assert all(part in message for part in parts), message


def test_a_design_with_a_fixed_dimension_is_written(capsys, campaign, tmp_path):
    for bounds in (["--gap-um", 16, 16], ["--gap-um", 16, 16, "--pillar-radius-um", 6, 6]):
        code, summary, _ = call(
            capsys,
            "design",
            *ASK,
            *bounds,
            "--candidates",
            1,
            "--results",
            campaign,
            "--output",
            tmp_path / "made",
        )
        assert code == 0 and summary["designs"][0]["gap_um"] == 16
        assert (tmp_path / "made" / "report.html").exists()


def test_verified_designs_are_printed_and_written(capsys, campaign, tmp_path, monkeypatch):
    """With what a simulation would say, from a formula."""
    asked = {}

    def verify_request(request, settings, chip, model, tables, *, work, files, **options):
        asked.update(work=work, sets=settings["stiffness_sets"])
        files.mkdir(parents=True, exist_ok=True)
        return check_designs(Known(summit), Nature(summit), rounds=1, designs_per_round=1)

    monkeypatch.setattr("dldsim.app.design_answers.verify_request", verify_request)
    code, summary, _ = call(capsys, "design", *ASK, "--results", campaign, "--verify")
    assert code == 0 and summary["verified_designs"][0]["verdict"].startswith("separates by")
    folder = tmp_path / "design-request"
    assert asked["work"] == Path("design-request/outcomes") and set(asked["sets"]) == {*SETS}
    assert len(read_rows("verified_designs", folder / "verified_designs.parquet")) == 1
    assert (folder / "report.html").exists()
    argv = ["design", *ASK, "--results", campaign, "--verify", "--candidates", 1]
    assert cli.main(list(map(str, argv))) == 0
    text = capsys.readouterr().out
    assert "Simulated differences" in text and "predictions confirmed." in text
    assert "Add --verify" not in text


@pytest.mark.parametrize(
    ("argv", "parts"),
    [
        (["--seed", "-1"], ["--seed", "'-1'", "0 to 9223372036854775807"]),
        (["--seed", str(2**63)], ["--seed", str(2**63)]),
        (["--tolerance-um", "nan"], ["--tolerance-um", "'nan'", "finite"]),
        (["--gap-um", "14", "inf"], ["--gap-um", "'inf'"]),
        (["--safety-distance-um", "-1"], ["safety_distance_um", "-1.0", "≥ 0"]),
        (["--trials", "1000000000"], ["trials", "1000000000", "≤ 10000"]),
        (["--candidates", "1000000000"], ["candidates", "≤ 100"]),
        (["--request-name", "a" * 250], ["name", "64 at most"]),
        (["--output", "file"], ["--output", "cannot be written", "Nothing was calculated"]),
    ],
)
def test_what_no_search_can_serve_is_told_before_it(
    capsys, campaign, tmp_path, monkeypatch, argv, parts
):
    monkeypatch.setattr("dldsim.app.design_answers.search", None)
    (tmp_path / "file").write_text("")
    code, summary, message = call(capsys, "design", *ASK, *argv, "--results", campaign)
    assert (code, summary) == (2, None)
    assert all(part in message for part in parts), message
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_the_largest_seed_is_served(capsys, campaign):
    code, summary, _ = call(capsys, "design", *ASK, "--seed", 2**63 - 1, "--results", campaign)
    assert code == 0 and summary["seed"] == 2**63 - 1


def test_an_assay_that_does_not_tell_is_told_first(capsys, campaign):
    argv = ["design", "--di1", "0.6", "--di2", "0.61", "--di1-std", "0.05", *ASK[4:]]
    argv += ["--results", str(campaign)]
    assert cli.main(argv) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("The assay group-velocity does not tell the two cell types apart")
    assert "deformation index 0.6 ± 0.05 by group-velocity" in lines[1]
    assert re.search(r"k_s .* µN/m \(.* to .*\), Ca = μU/k_s .* \(.* to .*\): inverse", lines[2])
    code, summary, _ = call(capsys, *argv)
    assert code == 0 and summary["doubt"] == lines[0]
    first = summary["designs"][0]
    assert first["angle_1_low_deg"] <= first["angle_1_deg"] <= first["angle_1_high_deg"]


def test_another_velocity_is_another_capillary_number(capsys, campaign):
    """Membranes twice as stiff at twice the velocity are the same cells."""
    argv = ["design", "--set1", "1", "--set2", "3", *ASK[4:], "--results", campaign]
    _, own, _ = call(capsys, *argv)
    fast = ["design", "--ks1", 10.2, "--ks2", 40.6, "--velocity", 1.0, *ASK[4:]]
    _, other, _ = call(capsys, *fast, "--results", campaign)
    for name in ("gap_um", "angle_1_deg", "angle_2_deg"):
        assert other["designs"][0][name] == pytest.approx(own["designs"][0][name], rel=1e-6)
    ratio = other["designs"][0]["pressure_drop_kPa"] / own["designs"][0]["pressure_drop_kPa"]
    assert ratio == pytest.approx(2)


def test_another_height_is_told_and_has_no_pressure_drop(capsys, campaign):
    code, summary, _ = call(capsys, "design", *ASK, "--height", 30, "--results", campaign)
    first = summary["designs"][0]
    assert code == 0 and not first["inside_training_domain"]
    assert any("height/R 4 of cell type 1 was not learnt" in note for note in first["notes"])
    assert first["pressure_drop_kPa"] is None and "height 20 µm" in first["pressure_basis"]


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        (
            "mean_velocity_mm_s: 0.5",
            "mean_velocity_mm_s: 5",
            ["flow.mean_velocity_mm_s = 5.0", "the request takes 0.5", "--velocity"],
        ),
        ("height_um: 20.0", "height_um: 30.0", ["flow.height_um = 30.0", "20.0", "--height"]),
        (
            "viscosity_mPa_s: 1.5",
            "viscosity_mPa_s: 1.0",
            ["flow.viscosity_mPa_s = 1.0", "campaign with 1.5", "--results"],
        ),
        ("shape: biconcave", "shape: sphere", ["cell.shape = sphere", "--shape1 and --shape2"]),
        ("radius_um: 7.5", "radius_um: 6", ["cell.radius_um = 6.0", "--r1 and --r2"]),
        ("ks_uN_per_m: 5.1", "ks_uN_per_m: 9.1", ["stiffness_sets.1.ks_uN_per_m = 9.1", "5.1"]),
    ],
)
def test_settings_that_the_campaign_cannot_serve_are_refused(capsys, tmp_path, old, new, parts):
    ask = ["design", "--set1", "1", "--set2", "5", "--trials", "3", "--startup-trials", "2"]
    assert old in CONFIG
    (tmp_path / "config.yaml").write_text(CONFIG, encoding="utf-8")
    code, summary, _ = call(capsys, *ask)
    assert code == 0 and summary["learnt"].startswith("biconcave discs (Ca ")
    (tmp_path / "config.yaml").write_text(CONFIG.replace(old, new, 1), encoding="utf-8")
    code, summary, message = call(capsys, *ask)
    assert (code, summary) == (2, None)
    assert all(part in message for part in parts), message


def test_what_the_request_names_goes_over_the_configuration(capsys, tmp_path):
    ask = ["design", "--set1", "1", "--set2", "5", "--trials", "3", "--startup-trials", "2"]
    text = CONFIG.replace("mean_velocity_mm_s: 0.5", "mean_velocity_mm_s: 5", 1)
    (tmp_path / "config.yaml").write_text(text, encoding="utf-8")
    code, summary, _ = call(capsys, *ask, "--velocity", "0.5")
    assert code == 0 and summary["request"]["velocity_mm_s"] == 0.5


@pytest.mark.parametrize(
    ("missing", "parts"),
    [
        ("outcomes", ["outcomes.parquet", "does not exist"]),
        ("calibration", ["calibration.parquet"]),
        ("surrogate_card", ["surrogate_card.json", "does not exist"]),
    ],
)
def test_missing_files_are_told(capsys, campaign, tmp_path, missing, parts):
    folder = shutil.copytree(campaign, tmp_path / "copy")
    for path in folder.glob(f"{missing}.*"):
        path.unlink()
    code, _, message = call(capsys, "design", *ASK, "--results", folder)
    assert code == 2 and all(part in message for part in parts), message


def test_a_table_without_its_columns_is_refused(capsys, campaign, tmp_path):
    folder = shutil.copytree(campaign, tmp_path / "copy")
    shutil.copy(folder / "calibration.parquet", folder / "outcomes.parquet")
    code, _, message = call(capsys, "design", *ASK, "--results", folder)
    assert code == 2 and "kind calibration, not outcomes" in message


def test_a_model_of_other_runs_is_refused(capsys, campaign, tmp_path):
    folder = shutil.copytree(campaign, tmp_path / "copy")
    outcomes = read_table("outcomes", folder / "outcomes.parquet")
    outcomes.loc[3, "migration_angle_deg"] += 0.5
    write_table(
        "outcomes",
        outcomes,
        folder / "outcomes.parquet",
        {"config_hash": "x", "seed": 1, "settings": {}},
    )
    code, _, message = call(capsys, "design", *ASK, "--results", folder)
    assert code == 2 and "learnt from other outcomes" in message


def test_without_flows_there_is_no_pressure_drop(capsys, campaign, tmp_path):
    folder = shutil.copytree(campaign, tmp_path / "copy")
    (folder / "flows.parquet").unlink()
    code, summary, _ = call(capsys, "design", *ASK, "--results", folder)
    assert code == 0 and summary["designs"][0]["pressure_drop_kPa"] is None
    code, _, message = call(capsys, "design", *ASK, "--results", folder, "--pressure-max-kpa", 1)
    assert code == 2 and "flows.parquet" in message


def test_without_a_campaign_the_remedy_is_told(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr("dldsim.design.finished_campaign.CAMPAIGN_DATA", tmp_path / "none")
    code, _, message = call(capsys, "design", *ASK)
    assert code == 2 and "--results" in message


def test_a_campaign_of_another_physics_version_gives_no_answer(capsys, campaign, monkeypatch):
    monkeypatch.setattr("dldsim.design.finished_campaign.CAMPAIGN_DATA", campaign)
    assert call(capsys, "design", *ASK)[0] == 0
    monkeypatch.setattr("dldsim.design.finished_campaign.PHYSICS_VERSION", PHYSICS_VERSION + 1)
    code, _, message = call(capsys, "design", *ASK)
    assert code == 2 and f"is of physics version {PHYSICS_VERSION}, this is" in message
    code, _, message = call(capsys, "stiffness", "--di", 0.6)
    assert code == 2 and "--results" in message
