"""What comes out of a device, and measured cells in requests, over the API."""

import pytest
from fastapi.testclient import TestClient

from dldsim.app.web.api import answers, specs
from dldsim.app.web.api.app import make_app
from dldsim.app.web.api.problems import PREFIX
from dldsim.app.web.api.settings import Settings

pytestmark = pytest.mark.slow

PLACE = {
    "pillar_radius_um": 7.0,
    "gap_um": 14.0,
    "periodicity": 6,
    "stiffness_set_1": "1",
    "stiffness_set_2": "3",
    "draws": 16,
    "cells": 32,
}
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


def test_measured_cells_take_the_place_of_mean_and_spread(client):
    found = ask(client, population_1_csv=TABLE, radius_1_um=20).json()
    assert found["request"]["radius_1_um"] == pytest.approx(7.1)
    assert found["request"]["radius_std_1_um"] == pytest.approx(0.2)
    named = ask(client, population_2_csv=WITH_INDEX).json()
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
            {"population_2_csv": "radius_um,deformation_index\n7.5,0.1\n7.5,0.2\n"},
            "deformation_index_2",
            "0.5 to 0.78",
        ),
        (
            {"population_2_csv": WITH_INDEX.replace("0.58", "0.45")},
            "population_2_csv",
            "outside the calibration",
        ),
        ({"population_1_csv": 5}, "population_1_csv", "text"),
        ({"population_1_csv": "x" * 100_001}, "population_1_csv", "text"),
        ({"draws": 512, "cells": 1024}, "draws", "at most 131,072"),
        ({"radius_cv_1": 0.9}, "radius_cv_1", "negative"),
        ({"radius_cv_1": 0.1, "radius_std_1_um": 1}, "radius_cv_1", "one of"),
        ({"stiffness_set_1": None, "ks_1_uN_per_m": 1e6}, "ks_1_uN_per_m", "kal_uN_per_m"),
        ({"rigid_1": True}, "stiffness_set_1", "exactly one of"),
        ({"stiffness_set_2": "1"}, "stiffness_set_1", "no array separates equals"),
        ({"sample_position_mm": 5.0}, "sample_position_mm", "lie inside the channel"),
        ({"array_length_mm": 0.05}, "array_length_mm", "fewer than one period"),
        ({"outlets": 1}, "outlets", "≥ 2"),
        ({"trials": 3}, "trials", "no such field"),
        ({"radius_1_um": 51}, "radius_1_um", "up to 50"),
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
