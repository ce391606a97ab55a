"""Predictions, stiffnesses, the model and the tables that the API answers with."""

import pytest

from dldsim.app.web.api.problems import PREFIX
from dldsim.app.web.api.specs import PredictSpec, StiffnessSpec
from dldsim.config.design_sections import DesignRequest
from dldsim.design.finished_campaign import packaged_campaign
from dldsim.tables.parquet import read_table
from dldsim.tables.registry import COLUMNS
from tests.app.web.api.asking import PLACE

pytestmark = pytest.mark.slow


def test_a_prediction_carries_its_interval(client):
    found = client.post(f"{PREFIX}/predict", json=PLACE).json()
    assert (
        found["low_deg"] <= found["angle_deg"] <= found["high_deg"] <= 1.5 * found["bump_angle_deg"]
    )
    assert found["inside_domain"] and found["mode"] in ("bump", "mixed", "zigzag")
    far = client.post(f"{PREFIX}/predict", json=PLACE | {"gap_um": 150}).json()
    assert not far["inside_domain"] and any(
        "outside what was simulated" in w for w in far["warnings"]
    )
    assert far["high_deg"] - far["low_deg"] > found["high_deg"] - found["low_deg"]


@pytest.mark.parametrize("spec", [PredictSpec, StiffnessSpec])
def test_examples_have_an_index_of_the_campaign_that_comes_with_the_package(spec):
    known = read_table("outcomes", packaged_campaign() / "outcomes.parquet")["deformation_index"]
    for example in spec.model_config["json_schema_extra"]["examples"]:
        assert known.min() <= example["deformation_index"] <= known.max()


def test_a_prediction_tells_what_acts_on_the_cell(client):
    """Twice the velocity of a membrane twice as stiff is the same prediction."""
    place = {k: v for k, v in PLACE.items() if k != "deformation_index"}
    slow = client.post(f"{PREFIX}/predict", json=place | {"ks_uN_per_m": 10}).json()
    fast = client.post(
        f"{PREFIX}/predict", json=place | {"ks_uN_per_m": 20, "velocity_mm_s": 1.0}
    ).json()
    assert fast["angle_deg"] == pytest.approx(slow["angle_deg"], rel=1e-9)
    assert slow["cell"]["capillary_number"] == pytest.approx(0.075)
    named = client.post(f"{PREFIX}/predict", json=PLACE | {"deformation_index_std": 0.02}).json()
    cell = named["cell"]
    assert cell["ks_low_uN_per_m"] < cell["ks_uN_per_m"] < cell["ks_high_uN_per_m"]


@pytest.mark.parametrize(
    ("change", "field", "part"),
    [
        ({"rigid": True, "cell_shape": "sphere"}, "rigid", "no spheres"),
        ({"ks_uN_per_m": 10, "velocity_mm_s": 9}, "velocity_mm_s", "velocities of"),
        ({"ks_uN_per_m": 10, "rigid": True}, "rigid", "exactly one of"),
        ({}, "deformation_index", "exactly one of deformation_index"),
        ({"ks_uN_per_m": 5e-324}, "ks_uN_per_m", "≥ 0.001"),
        ({"stiffness_set": "9"}, "stiffness_set", "stiffness_set: stiffness set 9 is not known"),
        ({"deformation_index": 0.99}, "deformation_index", "deformation_index = 0.99 is outside"),
        ({"ks_uN_per_m": 10, "height_um": 1}, "height_um", "cell type 1 needs"),
    ],
)
def test_what_cannot_be_predicted_is_told_at_its_field(client, change, field, part):
    place = {k: v for k, v in PLACE.items() if k != "deformation_index"}
    answer = client.post(f"{PREFIX}/predict", json=place | change)
    assert answer.status_code == 422 and part in answer.json()["message"], answer.json()
    assert field in [f["field"] for f in answer.json()["fields"]], answer.json()


def test_a_vanishing_cell_is_refused(client):
    answer = client.post(f"{PREFIX}/predict", json=PLACE | {"cell_radius_um": 6.7e-256})
    assert answer.status_code == 422 and "≥ 0.1" in answer.json()["message"]


def test_a_measured_index_becomes_a_stiffness(client):
    found = client.post(f"{PREFIX}/stiffness", json={"deformation_index": 0.6, "error": 0.02})
    found = found.json()
    assert found["ks_uN_per_m_low"] < found["ks_uN_per_m"] < found["ks_uN_per_m_high"]
    outside = client.post(f"{PREFIX}/stiffness", json={"deformation_index": 0.1})
    assert outside.status_code == 422 and "calibrated range" in outside.json()["message"]


def test_the_model_tells_domain_and_ranges(client):
    found = client.get(f"{PREFIX}/model").json()
    assert found["card"]["model_sha256"] == found["provenance"]["model_sha256"]
    assert {s["stiffness_set"] for s in found["stiffness_sets"]} == {"1", "2", "3"}
    ranges = {f["name"]: f for f in found["fields"]}
    assert set(DesignRequest.model_fields) < set(ranges)
    assert ranges["radius_1_um"] | {"description": ""} == {
        "name": "radius_1_um",
        "minimum": 0.1,
        "exclusive_minimum": False,
        "maximum": 50,
        "default": 7.5,
        "unit": "µm",
        "description": "",
        "choices": None,
    }
    assert found["limits"]["trials_max"] == 100 and found["domain"]["arrays"]


def test_tables_come_with_units(client, campaign):
    for kind in ("outcomes", "calibration"):
        table = client.get(f"{PREFIX}/campaign/{kind}").json()
        assert len(table["rows"]) == len(read_table(kind, campaign / f"{kind}.parquet"))
        assert [c["name"] for c in table["columns"]] == [c.name for c in COLUMNS[kind]]
        assert {c["name"]: c["unit"] for c in table["columns"]}["ks_uN_per_m"] == "µN/m"
