"""When the API cannot answer, what it does not know, and whom it answers."""

import json
import re
import uuid
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from dldsim import PHYSICS_VERSION
from dldsim.app.web.api.app import make_app
from dldsim.app.web.api.problems import PREFIX
from dldsim.app.web.api.settings import Settings
from tests.app.web.api.asking import ASK, PLACE

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def idle(campaign, tmp_path_factory):
    """A service whose processes are never started: everything waits."""
    settings = Settings(
        results=campaign, state=tmp_path_factory.mktemp("idle"), queue_max=2, verify_workers=0
    )
    app = make_app(settings)
    app.state.service.pool.problems = list
    return TestClient(app, raise_server_exceptions=False)


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
