"""What comes out of a device, and measured cells in requests, over the API."""

from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from dldsim.app import outcome_answers
from dldsim.app.web.api import answers, specs
from dldsim.app.web.api.app import make_app
from dldsim.app.web.api.problems import PREFIX
from dldsim.app.web.api.settings import Settings
from dldsim.app.web.api.store import VERIFICATION
from dldsim.app.web.api.worker import Worker

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("nowhere")]

PLACE = {
    "pillar_radius_um": 7.0,
    "gap_um": 14.0,
    "periodicity": 6,
    "stiffness_set_1": "1",
    "stiffness_set_2": "3",
    "draws": 16,
    "cells": 32,
}
THEN = {"pillar_radius_um": 6.0, "gap_um": 15.0, "periodicity": 5}
CASCADE = {"then": THEN, "from_outlet": 1}
TABLE = "radius_um\n6.9\n7.1\n7.3\n"
WITH_INDEX = "radius_um,deformation_index\n7.5,0.58\n7.5,0.60\n7.5,0.62\n"


@pytest.fixture(scope="module")
def client(campaign, tmp_path_factory):
    app = make_app(Settings(results=campaign, state=tmp_path_factory.mktemp("state")))
    app.state.service.pool.problems = list
    return TestClient(app, raise_server_exceptions=False)


def ask(client, **changes):
    spec = {k: v for k, v in (PLACE | changes).items() if v is not None}
    return client.post(f"{PREFIX}/outcome", json=spec)


def test_outcome_has_shares_with_intervals_and_their_places(client):
    answer = ask(client, radius_cv_1=0.05)
    assert answer.status_code == 200, answer.text
    found = answers.OutcomeAnswer.model_validate(answer.json())
    assert {row.population for row in found.device_outcomes} == {1, 2}
    for row in found.device_outcomes:
        assert 0 <= row.recovery_low <= row.recovery <= row.recovery_high <= 1
    for i in "12":  # what enters leaves, or is lost
        left = sum(getattr(outlet, f"cells_{i}") for outlet in found.device_outlets)
        assert left <= 1 + 1e-9
    walls = [outlet.low_um for outlet in found.device_outlets][1:]
    assert walls == [found.device_outcomes[0].cut_um]
    assert {row.population for row in found.device_positions} == {1, 2}
    assert sum(row.cells for row in found.device_exits) == pytest.approx(2, abs=0.05)
    assert [cell.cell_radius_um for cell in found.populations] == [7.5, 7.5]


def test_outcome_is_the_same_for_the_same_seed_alone(client):
    first, again, other = (ask(client, seed=s).json()["device_exits"] for s in (1, 1, 2))
    assert first == again != other


def test_device_and_mixture_are_those_of_the_request(client):
    found = ask(client, outlets=4, array_width_mm=1.0, concentration_ratio=9.0).json()
    assert len(found["device_outlets"]) == 4
    assert found["device"]["array_width_mm"] == 1.0 and found["device"]["array_length_mm"] == 5.0
    assert found["request"]["concentration_ratio"] == 9.0


def test_walls_of_a_mask_can_be_asked_for(client):
    found = ask(client, outlet_walls_um=[700.0]).json()
    assert [row["low_um"] for row in found["device_outlets"]] == [0.0, 700.0]
    assert found["device"]["outlet_walls_um"] == [700.0]


def test_measured_cells_take_the_place_of_mean_and_spread(client):
    found = ask(client, population_1_csv=TABLE).json()
    assert found["request"]["radius_1_um"] == pytest.approx(7.1)
    assert found["request"]["radius_std_1_um"] == pytest.approx(0.2)
    named = ask(client, population_2_csv=WITH_INDEX, stiffness_set_2=None).json()
    assert named["request"]["stiffness_set_2"] is None
    assert named["request"]["deformation_index_2"] == pytest.approx(0.6)


def test_a_request_with_measured_cells_survives_the_queue():
    spec = specs.DesignSpec(
        stiffness_set_1="1", population_1_csv=TABLE, population_2_csv=WITH_INDEX
    )
    again = specs.DesignSpec(**spec.model_dump(mode="json"))
    assert again == spec and spec.request.deformation_index_2 == pytest.approx(0.6)
    first, second = again.measured
    assert list(first.radius_um) == [6.9, 7.1, 7.3] and len(second.deformation_index) == 3


@pytest.mark.parametrize(
    ("changes", "field", "words"),
    [
        ({"population_1_csv": "radius_mm\n1\n2\n"}, "population_1_csv", "lacks radius_um"),
        ({"population_2_csv": "radius_um\n5\n"}, "population_2_csv", "no population"),
        (
            {"population_2_csv": "radius_um,deformation_index\n5,60\n6,70\n"},
            "population_2_csv",
            "per cent",
        ),
        (
            {
                "population_2_csv": "radius_um,deformation_index\n7.5,0.1\n7.5,0.2\n",
                "stiffness_set_2": None,
            },
            "deformation_index_2",
            "0.5 to 0.78",
        ),
        (
            {"population_2_csv": WITH_INDEX.replace("0.58", "0.45"), "stiffness_set_2": None},
            "population_2_csv",
            "outside the calibration",
        ),
        ({"population_1_csv": TABLE, "radius_1_um": 20}, "radius_1_um", "change nothing"),
        ({"population_1_csv": TABLE, "radius_cv_1": 0.1}, "radius_cv_1", "change nothing"),
        ({"population_2_csv": WITH_INDEX}, "stiffness_set_2", "change nothing"),
        (
            {"population_1_csv": TABLE, "radius_distribution": "lognormal"},
            "radius_distribution",
            "radii as they are",
        ),
        ({"population_1_csv": 5}, "population_1_csv", "text"),
        ({"population_1_csv": "x" * 100_001}, "population_1_csv", "text"),
        ({"draws": 512, "cells": 1024}, "draws", "at most 131,072"),
        ({"radius_cv_1": 0.9}, "radius_cv_1", "negative"),
        ({"radius_cv_1": 0.1, "radius_std_1_um": 1}, "radius_cv_1", "one of"),
        ({"stiffness_set_1": None, "ks_1_uN_per_m": 1e6}, "ks_1_uN_per_m", "kal_uN_per_m"),
        ({"stiffness_set_1": None, "ks_1_uN_per_m": 5e-324}, "ks_1_uN_per_m", "≥ 0.001"),
        ({"height_um": 0.1}, "height_um", "cell type 1 needs"),
        ({"radius_1_um": 50}, "radius_1_um", "height_um = 20"),
        ({"radius_cv_1": 1, "radius_distribution": "lognormal"}, "sample_width_um", "= 60 µm"),
        ({"rigid_1": True}, "stiffness_set_1", "exactly one of"),
        ({"stiffness_set_2": "1"}, "stiffness_set_1", "no array separates equals"),
        ({"sample_position_mm": 5.0}, "sample_position_mm", "lie inside the channel"),
        ({"array_length_mm": 0.05}, "array_length_mm", "fewer than one period"),
        ({"outlets": 1}, "outlets", "≥ 2"),
        ({"trials": 3}, "trials", "no such field"),
        ({"radius_1_um": 51}, "radius_1_um", "up to 50"),
        ({"radius_cv_1": -0.1}, "radius_cv_1", "≥ 0"),
        ({"then": THEN}, "then", "go together"),
        ({"then": THEN, "from_outlet": 3}, "from_outlet", "the first device has 2 outlets"),
        (CASCADE | {"then": THEN | {"array_length_mm": 0.05}}, "then.array_length_mm", "second"),
        (CASCADE | {"then": THEN | {"sample_position_mm": 5}}, "then.sample_position_mm", "second"),
        (CASCADE | {"then": THEN | {"gap_um": -1}}, "then.gap_um", "≥ 0.1"),
        (CASCADE | {"then": THEN | {"trials": 3}}, "then.trials", "pillar_radius_um"),
    ],
)
def test_what_has_no_outcome_is_told_at_its_field(client, changes, field, words):
    answer = ask(client, **changes)
    problem = answer.json()
    assert answer.status_code == 422, problem
    assert words in problem["message"], problem["message"]
    assert field in [f["field"] for f in problem["fields"]], problem


def test_a_design_whose_measured_cells_do_not_fit_is_refused_before_the_queue(client):
    bad = {"stiffness_set_1": "1", "population_2_csv": WITH_INDEX.replace("0.58", "0.45")}
    answer = client.post(f"{PREFIX}/designs", json=bad)
    assert answer.status_code == 422 and "outside the calibration" in answer.json()["message"]
    assert [f["field"] for f in answer.json()["fields"]] == ["population_2_csv"]


def test_two_outcomes_at_once_are_enough(client):
    gate = client.app.state.service.outcomes
    assert gate.acquire(blocking=False) and gate.acquire(blocking=False)
    try:
        answer = ask(client)
        assert answer.status_code == 429 and "Retry-After" in answer.headers
    finally:
        gate.release()
        gate.release()
    assert ask(client).status_code == 200


# ---------------------------------------------------------------------------------------- cascades


def test_a_cascade_has_both_devices_and_less_of_the_sample(client):
    one = ask(client).json()
    fed = [o["cells_1"] + o["cells_2"] for o in one["device_outlets"]]
    found = ask(client, then=THEN | {"outlets": 3}, from_outlet=1 + fed.index(max(fed))).json()
    assert [row["stage"] for row in found["device_outcomes"]] == [1, 1, 2, 2]
    assert {row["device"] for row in found["device_outcomes"]} == {"array", "second array"}
    assert found["device_outcomes"][:2] == one["device_outcomes"]
    assert len(found["device_outlets"]) == 2 + 3
    assert found["then"]["outlets"] == 3 and one["then"] is None
    second = [row for row in found["device_outcomes"][2:] if row["recovery"] is not None]
    assert second and all(r["recovery_of_sample"] <= r["recovery"] + 1e-9 for r in second)


# ------------------------------------------------------------------------------- simulated checks


@pytest.fixture
def worker(client):
    """The process that simulates, in this one."""
    return Worker(client.app.state.service.settings, VERIFICATION, "here")


def check(client, **changes):
    answer = client.post(f"{PREFIX}/checks", json=PLACE | {"simulate": 6} | changes)
    assert answer.status_code == 202, answer.text
    return answer.json()


def work(worker):
    worker._do(worker.store.claim(VERIFICATION, worker.name))


def row_of(one):
    return {
        "status": "converged",
        "stop_reason": "",
        "mode": "zigzag",
        "migration_angle_deg": 0.0,
        "lateral_steps_um": [0.0] * 6,
        "cell_radius_um": one.cell.radius_um,
        "rows_completed": 6,
    }


def test_a_check_has_predicted_and_simulated_cells(client, worker, monkeypatch):
    seen = {}

    def simulate(drawn, setting, directory, progress, processes):
        seen.update(directory=directory, processes=processes)
        directory.mkdir(parents=True)
        progress("cell 1 of 6")
        status = client.get(url).json()
        assert (status["state"], status["message"]) == ("running", "cell 1 of 6")
        return [row_of(one) for one in drawn]

    monkeypatch.setattr(outcome_answers, "simulate_cells", simulate)
    accepted = check(client)
    assert (accepted["state"], accepted["queue_position"]) == ("queued", 0)
    url = f"{PREFIX}/checks/{accepted['id']}"
    work(worker)
    found = answers.CheckStatus.model_validate(client.get(url).json())
    assert found.state == "done", found.error
    result = found.result
    assert [row.simulated for row in result.device_checks] == [3, 3]
    assert [cell.population for cell in result.checked_cells] == [1, 1, 1, 2, 2, 2]
    assert all(cell.exit_um == pytest.approx(cell.start_um) for cell in result.checked_cells)
    predicted = ask(client).json()  # the same seed: the outcome as it is predicted without it
    assert [row.model_dump() for row in result.device_outcomes] == predicted["device_outcomes"]
    assert seen["processes"] == 1 and not seen["directory"].exists()


def test_an_interrupted_check_goes_on_with_its_cells(client, worker, monkeypatch):
    folders = []

    def dies(drawn, setting, directory, progress, processes):
        directory.mkdir(parents=True, exist_ok=True)
        folders.append(directory)
        if len(folders) == 1:
            (directory / "cell-0001.parquet").write_text("kept")
            raise KeyboardInterrupt  # as a process that is killed: nothing is written
        assert (directory / "cell-0001.parquet").read_text() == "kept"
        return [row_of(one) for one in drawn]

    monkeypatch.setattr(outcome_answers, "simulate_cells", dies)
    accepted = check(client)
    with pytest.raises(KeyboardInterrupt):
        work(worker)
    worker.store.release(worker.name, "it ended")
    work(worker)
    found = client.get(f"{PREFIX}/checks/{accepted['id']}").json()
    assert (found["state"], found["attempts"]) == ("done", 2)
    assert folders[0] == folders[1] and not folders[0].exists()


def test_a_cancelled_check_ends_with_its_cell_and_leaves_nothing(client, worker, monkeypatch):
    def simulate(drawn, setting, directory, progress, processes):
        directory.mkdir(parents=True)
        Path(directory, "cell-0001.parquet").touch()
        seen.append(directory)
        client.delete(f"{PREFIX}/checks/{accepted['id']}")
        progress("cell 1 of 6")
        raise AssertionError("goes on")

    seen = []
    monkeypatch.setattr(outcome_answers, "simulate_cells", simulate)
    accepted = check(client)
    work(worker)
    assert client.get(f"{PREFIX}/checks/{accepted['id']}").json()["state"] == "cancelled"
    assert not seen[0].exists()


def test_a_check_that_no_cell_survives_says_why(client, worker, monkeypatch):
    monkeypatch.setattr(
        outcome_answers,
        "simulate_cells",
        lambda drawn, *rest: [{"status": "failed", "stop_reason": "too fast"} for _ in drawn],
    )
    accepted = check(client)
    work(worker)
    found = client.get(f"{PREFIX}/checks/{accepted['id']}").json()
    assert found["state"] == "failed" and "too fast" in found["error"]


@pytest.mark.parametrize(
    ("changes", "field", "words"),
    [
        ({"simulate": 1}, "simulate", "≥ 2"),
        ({"simulate": 201}, "simulate", "≤ 200"),
        ({"then": THEN, "from_outlet": 1}, "then", "no such field"),
        ({"array_length_mm": 0.05}, "array_length_mm", "fewer than one period"),
        ({"stiffness_set_2": "1"}, "stiffness_set_1", "no array separates equals"),
    ],
)
def test_what_cannot_be_checked_is_refused_before_the_queue(client, changes, field, words):
    answer = client.post(f"{PREFIX}/checks", json=PLACE | {"simulate": 6} | changes)
    problem = answer.json()
    assert answer.status_code == 422 and words in problem["message"], problem
    assert field in [f["field"] for f in problem["fields"]]


def test_a_check_with_other_numerics_than_what_was_learnt_is_refused(client, tmp_path):
    (tmp_path / "config.yaml").write_text("run_control: {max_rows: 9}\n", encoding="utf-8")
    answer = client.post(f"{PREFIX}/checks", json=PLACE | {"simulate": 6})
    assert answer.status_code == 422 and "run_control.max_rows = 9" in answer.json()["message"]
    assert ask(client).status_code == 200  # what is predicted has none


def test_a_service_without_simulating_processes_refuses_checks(campaign, tmp_path):
    app = make_app(Settings(results=campaign, state=tmp_path, verify_workers=0))
    app.state.service.pool.problems = list
    answer = TestClient(app).post(f"{PREFIX}/checks", json=PLACE | {"simulate": 6})
    assert answer.status_code == 422 and "does not simulate" in answer.json()["message"]


def test_an_unknown_check_is_not_found(client):
    answer = client.get(f"{PREFIX}/checks/66666666-7777-8888-9999-000000000000")
    assert answer.status_code == 404 and "there is none" in answer.json()["message"]
