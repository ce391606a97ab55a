"""The command `design` and the jobs of the workflow, on a made-up campaign."""

import json
import shutil
import time

import pandas as pd
import pytest

from dldsim import PHYSICS_VERSION
from dldsim.analysis import surrogate
from dldsim.app import design_jobs
from dldsim.config.design_sections import DesignRequest, Device
from dldsim.config.sections import Flow, Numerics, RunControl
from dldsim.errors import DldsimError
from dldsim.tables.parquet import read_rows, read_table, write_table
from dldsim.tables.registry import COLUMNS
from tests.analysis.test_surrogate import make_outcomes
from tests.app.test_cli import call
from tests.design.test_search import make_flows

SETS = {"1": 5.1, "2": 10.0, "3": 20.3}
ASK = ["--set1", "1", "--set2", "3", "--trials", "30", "--startup-trials", "15"]


def filled(kind, frame):
    """A table with every column: null, 0 or empty where the frame has none."""
    zero = {"string": "", "double": 0.0, "int64": 0}
    for column in COLUMNS[kind]:
        if column.name not in frame:
            empty = zero.get(str(column.type), [[]] * len(frame))
            frame[column.name] = None if column.nullable else empty
    return frame[[c.name for c in COLUMNS[kind]]]


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """Folder with the tables that a campaign leaves for designs."""
    folder = tmp_path_factory.mktemp("campaign")
    outcomes = make_outcomes()
    ks = outcomes["stiffness_set"].map(SETS)
    outcomes = outcomes.assign(
        ks_uN_per_m=ks, kb_pN_um=0.1, kal_uN_per_m=2 * ks, kag_uN_per_m=500.0, kv_Pa=900.0,
        kvisc_nN_s_per_m=1.5, mean_velocity_mm_s=0.5, capillary_number=1.5 * 0.5 / ks,
        numerics=json.dumps(Numerics().model_dump()), release_axis="y",
    )  # fmt: skip
    control = RunControl(max_rows=7).model_dump()
    write_table("outcomes", filled("outcomes", outcomes), folder / "outcomes.parquet",
                {"config_hash": "x", "seed": 1, "settings": {"run_control": control}})
    index = outcomes.groupby("stiffness_set")["deformation_index"].first()
    calibration = pd.DataFrame([
        {"design": "group-velocity", "group": f"G{name}", "stiffness_set": name,
         "ks_uN_per_m": k, "kb_pN_um": 0.1, "kal_uN_per_m": 2 * k, "velocity_mm_s": 1.0, "runs": 4,
         "deformation_index": index[name], "deformation_index_std": 0.01}
        for name, k in SETS.items()
    ])  # fmt: skip
    about = {"config_hash": "x", "seed": 1, "settings": {}}
    write_table("calibration", filled("calibration", calibration),
                folder / "calibration.parquet", about)
    write_table("flows", filled("flows", make_flows()), folder / "flows.parquet", about)
    write_table("runs", [], folder / "runs.parquet", about)
    model = surrogate.fit(read_table("outcomes", folder / "outcomes.parquet"), 1)
    model.save(folder / "surrogate.json", folder / "surrogate_card.json")
    return folder


def test_design_answers_within_a_minute(capsys, campaign, tmp_path):
    start = time.process_time()
    code, summary, _ = call(capsys, "design", *ASK, "--results", campaign, "--output", tmp_path)
    assert code == 0 and time.process_time() - start < 60
    first = summary["designs"][0]
    assert set(first) == {c.name for c in COLUMNS["designs"]}
    assert first["pressure_drop_kPa"] > 0 and "interpolated" in first["pressure_basis"]
    assert summary["request"]["deformation_index_std_1"] == 0.01  # the calibration's
    assert summary["verified_designs"] is None
    for kind in design_jobs.SEARCH:
        assert len(read_rows(kind, tmp_path / f"{kind}.parquet")) > 0
    written = read_rows("designs", tmp_path / "designs.parquet")
    assert [d["gap_um"] for d in summary["designs"]] == [d["gap_um"] for d in written]


def test_design_prints_a_summary_to_be_read(capsys, campaign):
    from dldsim.app import cli

    assert cli.main(["design", *ASK, "--results", str(campaign)]) == 0
    text = capsys.readouterr().out
    for words in ("predicted, not simulated", "one thing off", "importance (", "Add --verify",
                  "cell 1: deformation index 0.5 ± 0.01", "edge_um"):
        assert words in text


@pytest.mark.parametrize(
    ("argv", "parts"),
    [
        (["--di1", "0.3", "--di2", "0.7"], ["deformation_index_1 = 0.3", "0.5 to 0.78"]),
        (["--di1", "0.6", "--di2", "1.7"], ["deformation_index_2", "1.7", "≤ 1"]),
        (["--di1", "0.6", "--di2", "0.6"], ["both cell types", "Change one"]),
        (["--set1", "9", "--set2", "1"], ["stiffness set 9", "calibrated"]),
        ([*ASK, "--gap-um", "20", "14"], ["gap_um", "lowest bound first"]),
        ([*ASK, "--gap-um", "5", "6"], ["no geometry", "safety", "gap_um"]),
        ([*ASK, "--pillar-radius-um", "0.5", "1"], ["no geometry", "slender"]),
        ([*ASK, "--pressure-max-kpa", "1e-9"], ["none of 30 trials", "pressure drop"]),
        ([*ASK, "--r1", "-1"], ["radius_1_um", "-1", "number ≥ 0.1"]),
        ([*ASK, "--objective", "best"], ["--objective", "robust"]),
    ],
)  # fmt: skip
def test_impossible_requests_are_told(capsys, campaign, argv, parts):
    code, summary, message = call(capsys, "design", *argv, "--results", campaign)
    assert (code, summary) == (2, None)
    assert all(part in message for part in parts), message


@pytest.mark.parametrize(
    ("missing", "parts"),
    [("outcomes", ["outcomes.parquet", "does not exist"]), ("calibration", ["calibration.parquet"]),
     ("surrogate_card", ["surrogate_card.json", "does not exist"])],
)  # fmt: skip
def test_missing_files_are_told(capsys, campaign, tmp_path, missing, parts):
    folder = shutil.copytree(campaign, tmp_path / "copy")
    next(folder.glob(f"{missing}.*")).unlink()
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
    write_table("outcomes", outcomes, folder / "outcomes.parquet",
                {"config_hash": "x", "seed": 1, "settings": {}})
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
    monkeypatch.setattr("dldsim.app.design_jobs.CAMPAIGN_DATA", tmp_path / "none")
    code, _, message = call(capsys, "design", *ASK)
    assert code == 2 and "--results" in message


def test_a_campaign_of_another_physics_version_gives_no_answer(capsys, campaign, monkeypatch):
    monkeypatch.setattr("dldsim.app.design_jobs.CAMPAIGN_DATA", campaign)
    assert call(capsys, "design", *ASK)[0] == 0
    monkeypatch.setattr("dldsim.app.design_jobs.PHYSICS_VERSION", PHYSICS_VERSION + 1)
    code, _, message = call(capsys, "design", *ASK)
    assert code == 2 and f"is of physics version {PHYSICS_VERSION}, this is" in message
    code, _, message = call(capsys, "stiffness", "--di", 0.6)
    assert code == 2 and "--results" in message


def test_a_kept_campaign_answers_like_its_results(campaign, tmp_path):
    kept = tmp_path / "kept"
    design_jobs.keep_campaign(campaign, kept)
    first, second = (design_jobs.read_campaign(place, Device(), 2.0) for place in (campaign, kept))
    assert first.settings == second.settings and first.model.card == second.model.card
    for kind, table in first.tables.items():
        assert table.equals(second.tables[kind])
    (kept / "flows.parquet").unlink()
    with pytest.raises(DldsimError, match=r"flows\.parquet"):
        design_jobs.keep_campaign(kept, tmp_path / "again")


def test_settings_are_those_of_the_runs(campaign):
    known = design_jobs.read_campaign(campaign, Device(), 2.0)
    assert Flow(**known.settings["flow"]) == Flow()
    assert known.settings["flow"]["viscosity_mPa_s"] == 1.5
    assert Numerics(**known.settings["numerics"]) == Numerics()
    assert known.settings["run_control"]["max_rows"] == 7
    assert known.settings["stiffness_sets"]["3"]["ks_uN_per_m"] == 20.3
    scene = design_jobs.scene_of(known.settings)
    assert scene.cell.axis == "y" and scene.flow.height_um == 20.0


def test_runs_of_several_channels_are_refused(campaign):
    outcomes = read_table("outcomes", campaign / "outcomes.parquet")
    outcomes.loc[0, "height_um"] = 30.0
    with pytest.raises(DldsimError, match="mixes several values of height_um"):
        design_jobs.settings_of_outcomes(outcomes)


def test_spread_of_a_set_is_the_calibrations(campaign):
    calibration = read_table("calibration", campaign / "calibration.parquet")
    request = DesignRequest(name="r", stiffness_set_1="1", deformation_index_2=0.7,
                            deformation_index_std_2=0.02)
    resolved = design_jobs.by_deformation_index(request, calibration)
    assert resolved.deformation_index_1 == pytest.approx(0.5)
    assert resolved.deformation_index_std_1 == pytest.approx(0.01)
    assert resolved.deformation_index_std_2 == 0.02
    with pytest.raises(DldsimError, match="need a calibration"):
        design_jobs.by_deformation_index(request, None)
