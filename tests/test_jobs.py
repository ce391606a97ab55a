"""A crash becomes a row with its reason, so that the campaign goes on."""

from pathlib import Path

import pytest

from dldsim import campaign, jobs
from dldsim.config import read_config
from dldsim.errors import DldsimError
from dldsim.tables import read_rows

GEOMETRY = "r05.0_g20.0_n04"
CONFIG = read_config(Path(__file__).parents[1] / "config.yaml", {"preset": "tiny"})
SETTINGS = CONFIG.model_dump(mode="json")


@pytest.fixture
def files(tmp_path):
    return {"flow": tmp_path / "f.npz", "row": tmp_path / "f.parquet", "crashes": tmp_path / "c"}


def crash(error):
    def simulate(*arguments, **options):
        raise error

    return simulate


def test_crashed_flow_becomes_a_row_and_so_do_its_runs(files, monkeypatch, tmp_path):
    monkeypatch.setattr("dldsim.flow.solve_empty_array", crash(MemoryError("no room")))
    said = []
    jobs.flow_job(GEOMETRY, SETTINGS, **files, progress=said.append)
    [row] = read_rows("flows", files["row"])
    assert (row["status"], row["stop_reason"]) == ("failed", "MemoryError: no room")
    assert row["nodes"] is None and files["flow"].exists()
    assert "Traceback" in said[-1] and campaign.count_crashes(files["crashes"], GEOMETRY) == 1

    run = f"{GEOMETRY}_s1"
    settings = SETTINGS | {"stiffness": SETTINGS["stiffness_sets"]["1"]}
    out = {"row": tmp_path / "r.parquet", "trajectory": tmp_path / "t.parquet"}
    jobs.run_job(run, settings, flow=files["flow"], flow_row=files["row"], **out,
                 crashes=files["crashes"], progress=said.append)
    [row] = read_rows("runs", out["row"])
    assert row["status"] == "failed" and "no room" in row["stop_reason"]
    assert (row["run_id"], row["migration_angle_deg"], row["mode"]) == (run, None, "none")
    assert read_rows("trajectory", out["trajectory"]) == []
    assert campaign.count_crashes(files["crashes"], run) == 1


def test_crashed_constriction_becomes_a_row(tmp_path, monkeypatch):
    monkeypatch.setattr("dldsim.constriction.simulate_constriction", crash(DldsimError("too fast")))
    settings = SETTINGS | {"group": SETTINGS["constriction_groups"]["G1"],
                           "release_position_um": 3.0}
    out = {"row": tmp_path / "r.parquet", "trajectory": tmp_path / "t.parquet"}
    said = []
    jobs.constriction_job("G1_1", settings, **out, crashes=tmp_path, progress=said.append)
    [row] = read_rows("constriction_runs", out["row"])
    assert (row["status"], row["stop_reason"]) == ("failed", "too fast")
    assert (row["group"], row["stiffness_set"], row["release_position_um"]) == ("G1", "1", 3.0)
    assert said == ["too fast"]


def test_interruption_is_no_crash(files, monkeypatch):
    monkeypatch.setattr("dldsim.flow.solve_empty_array", crash(KeyboardInterrupt()))
    with pytest.raises(KeyboardInterrupt):
        jobs.flow_job(GEOMETRY, SETTINGS, **files, progress=print)
    assert not files["row"].exists() and not files["crashes"].exists()


def test_log_takes_everything_and_bad_input_has_no_traceback(tmp_path, capsys):
    log = tmp_path / "logs" / "a.log"
    with pytest.raises(SystemExit) as stop, jobs.job_log(log) as progress:
        progress("step 1 of 2")
        raise DldsimError("gap too small")
    assert stop.value.code == 1
    text = log.read_text(encoding="utf-8")
    assert "step 1 of 2" in text and "gap too small" in text and "Traceback" not in text
    assert "gap too small" in capsys.readouterr().err
    with pytest.raises(ValueError), jobs.job_log(log):
        raise ValueError("odd")
    assert "Traceback" in log.read_text(encoding="utf-8")
