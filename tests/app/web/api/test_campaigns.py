"""Campaigns that users bring to the API, and angles that they have measured."""

import io
import json
import pickle

import pyarrow.parquet as pq
import pytest

from dldsim.app.web.api import specs
from dldsim.app.web.api.problems import PREFIX
from dldsim.tables.parquet import read_table, write_csv, write_table
from tests.app.conftest import filled
from tests.app.web.api.asking import ASK, PLACE, finished

pytestmark = pytest.mark.slow


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


@pytest.mark.parametrize("path", ["/campaigns", "/campaigns/"])
def test_an_upload_may_be_large_whatever_its_address_ends_with(client, path):
    answer = client.post(PREFIX + path, files={"outcomes": b"a,b\n" + b"1,%d\n" % 10**30 * 4000})
    assert answer.status_code == 422 and "missing outcome_id" in answer.json()["message"]
