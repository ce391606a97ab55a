"""Designs that the API is asked for: answers, files, refusals; on a made-up campaign."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from dldsim.app.web.api import answers
from dldsim.app.web.api.problems import PREFIX
from dldsim.config.design_sections import Device
from dldsim.design import finished_campaign
from tests.app.web.api.asking import ASK, PLACE, finished

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def designed(client):
    """A finished design and what was seen on the way."""
    answer = client.post(f"{PREFIX}/designs", json=ASK)
    assert answer.status_code == 202, answer.text
    return finished(client, answer.json()["url"])


def timeless(name, content):
    """Content without the time stamps and random identifiers that DXF asks for."""
    if not name.endswith(".dxf"):
        return content
    text = content.decode()
    text = re.sub(r"(\$TD\w+\n *40\n)[\d.]+", r"\1", text)
    text = re.sub(r"(\$(?:FINGERPRINT|VERSION)GUID\n *2\n)\{[-\w]+\}", r"\1", text)
    return re.sub(r"[\d.]+ @ [-\dT:.+]+", "", text)


def test_a_design_is_answered_in_full(designed):
    assert designed["state"] == "done", designed["error"]
    result = designed["result"]
    assert [d["design"] for d in result["designs"]] == [1, 2]
    for d in result["designs"]:
        for i in "12":
            assert d[f"angle_{i}_low_deg"] <= d[f"angle_{i}_deg"] <= d[f"angle_{i}_high_deg"]
    assert len(result["trials"]) == len(result["convergence"]) == ASK["trials"]
    known = [v for v in result["convergence"] if v is not None]
    assert known == sorted(known)
    best = max(t["value"] for t in result["trials"] if t["value"] is not None)
    assert max(known) == pytest.approx(best, rel=1e-12)
    assert {i["evaluator"] for i in result["importance"]} != {""}
    assert {t["parameter"] for t in result["tolerances"]} >= {"gap_um", "edge_um"}
    assert len({(s["x_parameter"], s["y_parameter"]) for s in result["slices"]}) == 3
    leaving = result["at_outlets"]["device_outcomes"]
    names = [f"request-candidate-{d}" for d in (1, 1, 2, 2)]
    assert [row["device"] for row in leaving] == names
    assert all(0 <= row["recovery"] <= 1 for row in leaving)
    assert designed["progress"]["stage"] == "done" and designed["progress"]["trial"] == 20
    assert set(result["seconds"]) == {"load", "search", "result", "files"}
    about = designed["provenance"]
    assert about["origin"] == "tracked" and len(about["model_sha256"]) == 64 and about["seed"] == 1
    assert designed["verification"]["state"] == "not-wanted"
    answers.DesignStatus.model_validate(designed)


def test_files_are_those_of_the_command(client, designed, campaign, tmp_path):
    options = [f"--{k.replace('_', '-')}".replace("stiffness-set-", "set") for k in ASK]
    argv = [x for pair in zip(options, map(str, ASK.values()), strict=True) for x in pair]
    # the service's configuration, with the moduli that the made-up campaign has
    config = yaml.safe_load(Path("config.yaml").read_text(encoding="utf-8"))
    known = finished_campaign.read_campaign(campaign, Device(), 2.0)
    config["stiffness_sets"] |= known.settings["stiffness_sets"]
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(config), encoding="utf-8")
    done = subprocess.run(  # a process of its own, whose hashes differ
        [
            sys.executable,
            "-m",
            "dldsim",
            "design",
            *argv,
            "--results",
            campaign,
            "--output",
            tmp_path,
        ],
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert len(designed["files"]) == 1 + 4 * 2
    for file in designed["files"]:
        answer = client.get(file["url"])
        assert answer.status_code == 200 and len(answer.content) == file["bytes"]
        assert f'filename="{file["name"]}"' in answer.headers["content-disposition"]
        local = (
            tmp_path / "report.html"
            if file["kind"] == "report"
            else tmp_path / "files" / file["name"]
        )
        same = timeless(file["name"], answer.content) == timeless(local.name, local.read_bytes())
        assert same, file["name"]
    url = f"{PREFIX}/designs/{designed['id']}/files"
    assert client.get(f"{url}/gds").content == client.get(f"{url}/gds?candidate=1").content
    assert b"<svg" not in client.get(f"{url}/report").content[:20]
    assert client.get(f"{url}/gds?candidate=3").status_code == 409
    assert client.get(f"{url}/gds?verified=1").json()["error"] == "not-available"
    assert client.get(f"{url}/passwd").status_code == 422


def test_a_report_stands_alone(client, designed):
    page = client.get(f"{PREFIX}/designs/{designed['id']}/files/report").text
    assert "href=" not in page and "<script" not in page
    assert page.count("data:image/") >= 5 and "Predicted, not simulated" in page
    assert designed["provenance"]["outcomes_sha256"][:16] in page


def test_optimize_waits_for_the_best(client):
    answer = client.post(f"{PREFIX}/optimize", json=ASK | {"objective": "separation"})
    assert answer.status_code == 200, answer.text
    found = answer.json()
    assert found["separation_deg"] == pytest.approx(
        abs(found["angle_1_deg"] - found["angle_2_deg"])
    )
    assert len(found["convergence"]) == 20 and len(found["importance"]) == 3
    status = client.get(found["url"]).json()
    assert status["result"]["designs"][0]["gap_um"] == found["gap_um"] and status["files"] == []


def test_a_failing_job_says_why_and_the_service_stays_up(client):
    answer = client.post(f"{PREFIX}/designs", json=ASK | {"pressure_max_kPa": 1e-9})
    found = finished(client, answer.json()["url"])
    assert found["state"] == "failed" and "none of 20 trials" in found["error"]
    assert found["result"] is None and found["files"] == []
    assert client.get(f"{PREFIX}/health").json()["status"] == "healthy"
    answer = client.post(f"{PREFIX}/optimize", json=ASK | {"pressure_max_kPa": 1e-9})
    assert answer.status_code == 422 and "pressure drop" in answer.json()["message"]


@pytest.mark.parametrize(
    ("change", "field", "parts"),
    [
        ({"trials": 0}, "trials", ["= 0", "whole number", "≥ 1", "up to 1000"]),
        ({"trials": 101}, "trials", ["= 101", "1 to 100"]),
        ({"trials": "many"}, "trials", ["'many'", "whole number"]),
        ({"radius_1_um": -3}, "radius_1_um", ["-3", "≥ 0.1"]),
        ({"radius_1_um": 1e-250}, "radius_1_um", ["1e-250", "≥ 0.1"]),
        ({"radius_1_um": 1e9}, "radius_1_um", ["1000000000.0", "up to 50"]),
        ({"gap_um": [20, 14]}, "gap_um", ["lowest bound first"]),
        ({"gap_um": [20]}, "gap_um", ["missing"]),
        ({"objective": "best"}, "objective", ["'best'", "separation, robust"]),
        ({"name": "../../etc/passwd"}, "name", ["etc/passwd", "text like"]),
        ({"colour": "red"}, "colour", ["no such field", "gap_um"]),
        ({"deformation_index_1": 0.6}, "", ["exactly one of deformation_index_1"]),
        ({"campaign": "1"}, "campaign", ["text like"]),
        (
            {"sampler": "grid", "grid_steps": 33, "draws": 512, "periodicity": [2, 100]},
            "grid_steps",
            ["values to compute", "up to 1500000"],
        ),
        ({"stiffness_set_1": "\ud800"}, "stiffness_set_1", []),
    ],
)
def test_bad_fields_are_told(client, change, field, parts):
    answer = client.post(
        f"{PREFIX}/designs",
        content=json.dumps(ASK | change),
        headers={"Content-Type": "application/json"},
    )
    problem = answer.json()
    assert answer.status_code == 422 and answers.Problem.model_validate(problem), problem
    assert any(f["field"].startswith(field) for f in problem["fields"]), problem
    assert all(part in problem["message"] for part in parts), problem["message"]


@pytest.mark.parametrize(
    ("change", "parts", "fields"),
    [
        (
            {"stiffness_set_2": "1"},
            ["both cell types", "no array separates equals"],
            [
                "stiffness_set_1",
                "stiffness_set_2",
                "shape_1",
                "shape_2",
                "radius_1_um",
                "radius_2_um",
            ],
        ),
        (
            {"gap_um": [5, 6]},
            ["no geometry within the bounds is feasible", "gap_um"],
            ["gap_um", "pillar_radius_um"],
        ),
        (
            {"stiffness_set_1": None, "deformation_index_1": 0.2},
            ["0.2", "0.5 to 0.78"],
            ["deformation_index_1"],
        ),
        ({"stiffness_set_1": "9"}, ["stiffness set 9", "known: 1, 2, 3"], ["stiffness_set_1"]),
        ({"velocity_mm_s": 5.0}, ["Ca = μU/k_s = 1.47"], ["stiffness_set_1", "velocity_mm_s"]),
        ({"shape_2": "sphere"}, ["shape_2 = sphere was not learnt"], ["shape_2"]),
    ],
)
def test_what_physics_forbids_is_explained(client, change, parts, fields):
    answer = client.post(f"{PREFIX}/designs", json=ASK | change)
    problem = answer.json()
    assert (answer.status_code, problem["error"]) == (422, "infeasible")
    assert all(part in problem["message"] for part in parts), problem["message"]
    assert [f["field"] for f in problem["fields"]] == fields
    assert problem["fields"][0]["value"] not in ("", "None")


@pytest.mark.parametrize(
    "body", [b"", b"{", b"[1]", b"nan", b"\xff\xfe", b'{"trials": NaN}', b"[" * 5000, b"1" * 6000]
)
def test_what_is_no_request_is_refused(client, body):
    answer = client.post(
        f"{PREFIX}/designs", content=body, headers={"Content-Type": "application/json"}
    )
    assert answer.status_code in (400, 422) and answers.Problem.model_validate(answer.json())


def test_large_bodies_are_refused(client):
    text = json.dumps(ASK | {"stiffness_set_1": "x" * 30_000})
    head = {"Content-Type": "application/json"}
    assert client.post(f"{PREFIX}/designs", content=text, headers=head).status_code == 413
    untold = client.post(f"{PREFIX}/designs", content=iter([text.encode()]), headers=head)
    assert untold.status_code == 413 and "20000 bytes" in untold.json()["message"]


def test_answers_say_what_they_hold_for(client, designed):
    words = "biconcave discs (Ca 0.0369 to 0.147, height/R 2.67)"
    for about in (
        designed["provenance"],
        client.post(f"{PREFIX}/predict", json=PLACE).json()["provenance"],
        client.get(f"{PREFIX}/model").json()["provenance"],
    ):
        assert about["holds_for"] == words
