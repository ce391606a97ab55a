"""The API of the design service, on a made-up campaign; what takes minutes is in tests/app/web."""

import io
import json
import pickle
import re
import subprocess
import sys
import time
import uuid
from pathlib import Path

import pyarrow.parquet as pq
import pytest
import yaml
from fastapi.testclient import TestClient

from dldsim import PHYSICS_VERSION
from dldsim.app.web.api import answers, specs
from dldsim.app.web.api.app import make_app
from dldsim.app.web.api.problems import PREFIX
from dldsim.app.web.api.settings import Settings
from dldsim.config.design_sections import DesignRequest, Device
from dldsim.design import finished_campaign
from dldsim.tables.parquet import read_table, write_csv, write_table
from dldsim.tables.registry import COLUMNS
from tests.app.conftest import filled

pytestmark = pytest.mark.slow

ASK = {
    "stiffness_set_1": "1",
    "stiffness_set_2": "3",
    "trials": 20,
    "startup_trials": 10,
    "candidates": 2,
}
PLACE = {"pillar_radius_um": 7.0, "gap_um": 16.0, "periodicity": 6, "deformation_index": 0.6}
LIMIT_S = 240


@pytest.fixture(scope="module")
def client(campaign, tmp_path_factory):
    settings = Settings(
        results=campaign,
        state=tmp_path_factory.mktemp("state"),
        trials_max=100,
        body_max_bytes=20_000,
        upload_rows_max=5000,
    )
    with TestClient(make_app(settings), raise_server_exceptions=False) as found:
        yield found


@pytest.fixture(scope="module")
def idle(campaign, tmp_path_factory):
    """A service whose processes are never started: everything waits."""
    settings = Settings(
        results=campaign, state=tmp_path_factory.mktemp("idle"), queue_max=2, verify_workers=0
    )
    app = make_app(settings)
    app.state.service.pool.problems = list
    return TestClient(app, raise_server_exceptions=False)


def finished(client, url, wanted=("done", "failed", "ready", "cancelled")):
    end = time.monotonic() + LIMIT_S
    while time.monotonic() < end:
        answer = client.get(url).json()
        if answer["state"] in wanted:
            return answer
        time.sleep(0.1)
    raise AssertionError(f"not finished after {LIMIT_S} s: {answer}")


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


def uploads(campaign, kinds, ending):
    if ending == "csv":
        for kind in kinds:
            write_csv(kind, campaign / f"{kind}.parquet")
    return {
        kind: (f"../{kind}.{ending}", (campaign / f"{kind}.{ending}").read_bytes())
        for kind in kinds
    }


@pytest.mark.parametrize(
    ("ending", "kinds"), [("csv", ("outcomes",)), ("parquet", ("outcomes", "calibration", "flows"))]
)
def test_a_campaign_can_be_brought(client, campaign, ending, kinds):
    answer = client.post(
        f"{PREFIX}/campaigns", files=uploads(campaign, kinds, ending), data={"name": "mine"}
    )
    assert answer.status_code == 202, answer.text
    early = client.post(f"{PREFIX}/predict", json=PLACE | {"campaign": answer.json()["id"]})
    assert early.status_code in (200, 409)
    found = finished(client, answer.json()["url"])
    assert found["state"] == "ready", found["error"]
    assert found["provenance"]["origin"] == "uploaded"
    own = client.post(f"{PREFIX}/predict", json=PLACE).json()
    place = {k: v for k, v in PLACE.items() if k != "deformation_index"} | {"stiffness_set": "2"}
    mine = client.post(f"{PREFIX}/predict", json=place | {"campaign": found["id"]}).json()
    assert mine["provenance"]["campaign_name"] == "mine"
    # the same outcomes; the seed of the fit is another
    assert mine["provenance"]["outcomes_sha256"] == own["provenance"]["outcomes_sha256"]
    sets = client.post(f"{PREFIX}/optimize", json=ASK | {"campaign": found["id"]})
    indices = {
        "deformation_index_1": 0.55,
        "deformation_index_2": 0.7,
        "trials": 15,
        "campaign": found["id"],
    }
    assert sets.status_code == 200  # their k_s is known from the outcomes
    by_index = client.post(f"{PREFIX}/optimize", json=indices)
    if "calibration" in kinds:
        assert by_index.status_code == 200
    else:
        assert by_index.status_code == 422
        assert "needs a calibration" in by_index.json()["message"]
        assert (
            client.get(f"{PREFIX}/campaign/calibration?campaign={found['id']}").status_code == 409
        )
    assert client.delete(f"{PREFIX}/campaigns/{found['id']}").status_code == 204
    assert (
        client.post(f"{PREFIX}/predict", json=PLACE | {"campaign": found["id"]}).status_code == 404
    )


def broken_tables(campaign, tmp_path):
    """Uploads that must be refused, and what the answer names."""
    outcomes = read_table("outcomes", campaign / "outcomes.parquet")
    text = write_csv("outcomes", campaign / "outcomes.parquet").read_text().splitlines()
    raw = (campaign / "outcomes.parquet").read_bytes()

    def table(frame):
        write_table("outcomes", filled("outcomes", frame.copy()), tmp_path / "x.parquet", {})
        return (tmp_path / "x.parquet").read_bytes()

    old = pq.read_table(campaign / "outcomes.parquet")
    about = json.loads(old.schema.metadata[b"dldsim"]) | {"physics_version": 0}
    stream = io.BytesIO()
    pq.write_table(old.replace_schema_metadata({b"dldsim": json.dumps(about)}), stream)
    return [
        (b"", "is empty"),
        (pickle.dumps(outcomes), "neither"),
        (raw[:400], "not a readable Parquet"),
        (b"PK\x03\x04" + raw, "Excel"),
        ((text[0] + "\n").encode(), "no rows"),
        (b"a,b\n1,2\n", "missing outcome_id"),
        ("\n".join(line.partition(",")[2] for line in text).encode(), "missing outcome_id"),
        ("\n".join(["extra," + text[0], *("1," + x for x in text[1:])]).encode(), "extra"),
        ((campaign / "calibration.parquet").read_bytes(), "kind calibration"),
        (stream.getvalue(), "physics version 0"),
        (table(outcomes.iloc[[0, 0, 0]]), "more than once"),
        (table(outcomes.iloc[:2]), "usable"),
        (table(outcomes.assign(deformation_index=7.0)), "0 to 1"),
        (table(outcomes.assign(status="measured")), "/measurements"),
        (table(outcomes.assign(kernel="round")), "column kernel gives kernel = round"),
        (table(outcomes.assign(rows_in_domain=0)), "column rows_in_domain gives rows = 0"),
        (table(outcomes.assign(height_um=[20.0, *[21.0] * (len(outcomes) - 1)])), "height_um"),
        ("\n".join([text[0], *text[1:2] * 6000]).encode(), "at most 5000"),
    ]


def test_bad_uploads_are_told(client, campaign, tmp_path):
    for content, part in broken_tables(campaign, tmp_path):
        answer = client.post(f"{PREFIX}/campaigns", files={"outcomes": ("x.parquet", content)})
        problem = answer.json()
        assert answer.status_code == 422, (part, problem)
        assert part in problem["message"] and problem["fields"][0]["field"] == "outcomes", problem


def measured(**change):
    return {
        "pillar_radius_um": 7.2,
        "gap_um": 15.5,
        "periodicity": 6,
        "deformation_index": 0.6,
        "cell_radius_um": 7.5,
        "migration_angle_deg": 9.0,
        "error_deg": 0.4,
    } | change


def test_measured_angles_are_learnt_from(client):
    own = client.get(f"{PREFIX}/model").json()
    flow = {k: own["flow"][k] for k in ("height_um", "mean_velocity_mm_s")}
    many = [measured(gap_um=15.5 + 0.01 * i) for i in range(8)]
    answer = client.post(f"{PREFIX}/measurements", json={"measurements": many, **flow})
    found = finished(client, answer.json()["url"])
    assert found["state"] == "ready", found["error"]
    about = found["provenance"]
    assert about["measured"] == 8 and about["used"] == own["provenance"]["used"] + 8
    assert any("measured on fabricated devices" in w for w in about["warnings"])
    place = measured() | {"campaign": found["id"]}
    place = {k: place[k] for k in specs.PredictSpec.model_fields if k in place}
    new = client.post(f"{PREFIX}/predict", json=place).json()["angle_deg"]
    old = client.post(f"{PREFIX}/predict", json=place | {"campaign": None}).json()["angle_deg"]
    assert abs(new - 9.0) < abs(old - 9.0)
    more = client.post(
        f"{PREFIX}/measurements", json={"measurements": many[:1], **flow, "campaign": found["id"]}
    )
    assert more.json()["rows"] == own["provenance"]["outcomes"] + 9
    rows = client.get(f"{PREFIX}/campaign/outcomes?campaign={found['id']}").json()["rows"]
    assert sum(r["status"] == "measured" for r in rows) == 8
    search = {**ASK, "campaign": found["id"], "candidates": 1}
    assert client.post(f"{PREFIX}/optimize", json=search).status_code == 200
    for change, part in (
        ({"measurements": [measured(deformation_index=0.3)]}, "calibrated range"),
        ({"measurements": [measured(deformation_index=None)]}, "exactly one of"),
        ({"measurements": [measured(migration_angle_deg=30)]}, "full bump"),
    ):
        answer = client.post(f"{PREFIX}/measurements", json={"measurements": many, **flow} | change)
        assert answer.status_code == 422 and part.lower() in answer.json()["message"].lower()


def test_missing_data_are_unhealthy(campaign, tmp_path):
    for folder in (tmp_path / "none", tmp_path / "some"):
        folder.mkdir()
    content = (campaign / "outcomes.parquet").read_bytes()
    (tmp_path / "some" / "outcomes.parquet").write_bytes(content)
    for name in ("none", "some"):
        app = make_app(Settings(results=tmp_path / name, state=tmp_path / f"state-{name}"))
        found = TestClient(app)
        health = found.get(f"{PREFIX}/health")
        assert health.status_code == 503 and "surrogate.json" in " ".join(health.json()["problems"])
        for answer in (
            found.post(f"{PREFIX}/designs", json=ASK),
            found.get(f"{PREFIX}/model"),
            found.post(f"{PREFIX}/predict", json=PLACE),
        ):
            assert answer.status_code == 503 and "Retry-After" in answer.headers
            assert answer.json()["error"] == "unhealthy"


def test_packaged_data_of_another_physics_version_give_no_answer(campaign, tmp_path, monkeypatch):
    monkeypatch.setattr("dldsim.design.finished_campaign.CAMPAIGN_DATA", campaign)
    monkeypatch.setattr("dldsim.design.finished_campaign.PHYSICS_VERSION", PHYSICS_VERSION + 1)
    found = TestClient(make_app(Settings(state=tmp_path)))
    health = found.get(f"{PREFIX}/health")
    words = f"of physics version {PHYSICS_VERSION}, this is version {PHYSICS_VERSION + 1}"
    assert health.status_code == 503 and words in " ".join(health.json()["problems"])
    answer = found.post(f"{PREFIX}/predict", json=PLACE)
    assert answer.status_code == 503 and words in answer.json()["message"]


def test_a_broken_pool_is_unhealthy(campaign, tmp_path):
    found = TestClient(make_app(Settings(results=campaign, state=tmp_path)))
    health = found.get(f"{PREFIX}/health")  # its processes were never started
    assert health.status_code == 503 and "pool" in health.json()["problems"][0]
    assert found.post(f"{PREFIX}/designs", json=ASK).status_code == 503


def test_a_full_queue_says_when_to_come_back(idle):
    first = [idle.post(f"{PREFIX}/designs", json=ASK).json() for _ in range(2)]
    assert [a["queue_position"] for a in first] == [0, 1]
    refused = idle.post(f"{PREFIX}/designs", json=ASK)
    assert refused.status_code == 429 and int(refused.headers["Retry-After"]) >= 1
    assert refused.json()["retry_after_s"] == int(refused.headers["Retry-After"])
    second = idle.get(first[1]["url"]).json()
    assert (second["state"], second["queue_position"]) == ("queued", 1)
    cancelled = idle.delete(first[0]["url"]).json()
    assert cancelled["state"] == "cancelled"
    assert idle.get(first[1]["url"]).json()["queue_position"] == 0
    assert idle.get(f"{first[1]['url']}/files/gds").status_code == 409
    assert idle.post(f"{PREFIX}/designs", json=ASK).status_code == 202
    refused = idle.post(f"{PREFIX}/designs", json=ASK | {"verify": True})
    assert refused.status_code == 422 and "does not simulate" in refused.json()["message"]


def test_every_address_is_in_the_docs(idle):
    """And so in the document that is fuzzed: both are compared with each other."""
    text = Path("docs/web.md").read_text(encoding="utf-8")
    rows = [line.split(" | ")[0] for line in text.splitlines() if re.match(r"\| `[A-Z]", line)]
    told = {
        (method, path)
        for row in rows
        for path in re.findall(r"/[\w/{}]+", row)
        for method in re.findall(r"GET|POST|DELETE", row)
    }
    paths = idle.get("/openapi.json").json()["paths"]
    known = {(m.upper(), p.removeprefix(PREFIX)) for p, methods in paths.items() for m in methods}
    assert told == known


def test_unknown_ids_and_paths_are_not_found(idle):
    for path in (
        f"designs/{uuid.uuid4()}",
        f"campaigns/{uuid.uuid4()}",
        f"designs/{uuid.uuid4()}/files/gds",
        "nothing",
        "designs/..%2f..%2fetc%2fpasswd",
    ):
        answer = idle.get(f"{PREFIX}/{path}")
        assert answer.status_code in (404, 422) and answer.json()["error"] in (
            "not-found",
            "invalid",
        )
    assert idle.put(f"{PREFIX}/designs").status_code == 405


def test_other_pages_are_kept_out(idle, campaign, tmp_path):
    head = {"Origin": "https://elsewhere.example"}
    assert "access-control-allow-origin" not in idle.get(f"{PREFIX}/health", headers=head).headers
    opened = TestClient(
        make_app(
            Settings(results=campaign, state=tmp_path, cors_origins=("https://elsewhere.example",))
        )
    )
    answer = opened.get(f"{PREFIX}/health", headers=head)
    assert answer.headers["access-control-allow-origin"] == "https://elsewhere.example"


def test_behind_a_prefix_documents_and_addresses_know_it(campaign, tmp_path):
    for strips in (True, False):  # proxies do either
        settings = Settings(
            results=campaign,
            state=tmp_path / str(strips),
            body_max_bytes=1024,
            root_path="/lab/dldsim/",
        )
        app = make_app(settings)
        app.state.service.pool.problems = list
        outside = TestClient(app, raise_server_exceptions=False)
        base = "" if strips else "/lab/dldsim"
        assert "'/lab/dldsim/openapi.json'" in outside.get(f"{base}/docs").text
        schema = outside.get(f"{base}/openapi.json").json()
        assert schema["servers"] == [{"url": "/lab/dldsim"}]
        accepted = outside.post(f"{base}{PREFIX}/designs", json=ASK).json()
        assert accepted["url"].startswith("/lab/dldsim/api/v1/designs/")
        assert outside.get(base + accepted["url"].removeprefix("/lab/dldsim")).status_code == 200
        large = outside.post(f"{base}{PREFIX}/campaigns", files={"outcomes": b"a,b\n" * 1000})
        assert large.status_code == 422, large.text
        told = outside.post(f"{base}{PREFIX}/predict", json=PLACE | {"gap_um": "wide"})
        assert "number ≥ 0.1" in told.json()["message"]


@pytest.mark.parametrize("path", ["/campaigns", "/campaigns/"])
def test_an_upload_may_be_large_whatever_its_address_ends_with(client, path):
    answer = client.post(PREFIX + path, files={"outcomes": b"a,b\n" + b"1,%d\n" % 10**30 * 4000})
    assert answer.status_code == 422 and "missing outcome_id" in answer.json()["message"]


@pytest.mark.parametrize(
    ("path", "given", "wanted"),
    [
        ("/predict", None, "application/json"),
        ("/predict", "text/plain", "application/json"),
        ("/designs", "application/x-www-form-urlencoded", "application/json"),
        ("/campaigns", None, "multipart/form-data"),
        ("/campaigns", "text/csv", "multipart/form-data"),
    ],
)
def test_a_body_must_say_what_it_is(client, path, given, wanted):
    answer = client.post(
        PREFIX + path, content=json.dumps(PLACE), headers={"Content-Type": given} if given else {}
    )
    problem = answer.json()
    assert answer.status_code == 422 and problem["fields"][0]["field"] == "Content-Type"
    shown = repr(given) if given else "missing"
    assert f"Content-Type = {shown}: allowed: {wanted}" in problem["message"]


def test_answers_say_what_they_hold_for(client, designed):
    words = "biconcave discs (Ca 0.0369 to 0.147, height/R 2.67)"
    for about in (
        designed["provenance"],
        client.post(f"{PREFIX}/predict", json=PLACE).json()["provenance"],
        client.get(f"{PREFIX}/model").json()["provenance"],
    ):
        assert about["holds_for"] == words
