"""Jobs of the workflow that make and verify designs, on a made-up campaign."""

import pytest

from dldsim.app import design_answers, design_jobs
from dldsim.config.design_sections import Device, Verification
from dldsim.design import finished_campaign
from dldsim.errors import DldsimError
from dldsim.tables.parquet import read_rows, read_table, write_table
from tests.design.known_surrogate import Known, ask, hill, run

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("nowhere")]


def job_settings(campaign, *requests):
    known = finished_campaign.read_campaign(campaign, Device(), 2.0)
    return {
        **known.settings,
        "seed": 1,
        "design_requests": list(requests),
        "verification": Verification(rounds=1).model_dump(),
        "surrogate": {"survey": False},
    }


GOOD = {
    "name": "good",
    "stiffness_set_1": "1",
    "stiffness_set_2": "3",
    "trials": 20,
    "startup_trials": 10,
}


def inputs_of(campaign):
    return {
        "model": campaign / "surrogate.json",
        "card": campaign / "surrogate_card.json",
        "calibration": campaign / "calibration.parquet",
        "flows": campaign / "flows.parquet",
    }


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        ({"stiffness_set_1": "dead"}, "stiffness set dead"),
        ({"shape_1": "sphere"}, "shape_1 = sphere was not learnt"),
        ({"gap_um": (5.0, 6.0)}, "no geometry within the bounds"),
    ],
)
def test_a_failed_request_takes_no_other_with_it(campaign, tmp_path, bad, reason):
    settings = job_settings(campaign, {**GOOD, **bad, "name": "bad"}, GOOD)
    kinds = (*design_answers.SEARCH, "design_requests")
    tables = {kind: tmp_path / f"{kind}.parquet" for kind in kinds}
    said = []
    design_jobs.design_job(
        settings,
        tables=tables,
        outcomes=campaign / "outcomes.parquet",
        progress=said.append,
        **inputs_of(campaign),
    )
    bad_row, good_row = read_rows("design_requests", tables["design_requests"])
    assert bad_row["status"] == "failed" and reason in bad_row["reason"] and reason in said[0]
    assert good_row == {"request": "good", "status": "answered", "reason": ""}
    for kind in design_answers.SEARCH:
        assert {row["request"] for row in read_rows(kind, tables[kind])} == {"good"}
    design_jobs.regret_job(
        settings, table=tmp_path / "regret.parquet", progress=said.append, **inputs_of(campaign)
    )
    found = read_rows("search_regret", tmp_path / "regret.parquet")
    assert {row["request"] for row in found} == {"good"}


def test_indices_of_other_cells_are_read_where_the_library_has_them(campaign, tmp_path):
    """By k_s of the same cells; the surrogate has learnt discs of one height over radius alone."""
    own = read_rows("calibration", campaign / "calibration.parquet")
    radius = own[0]["cell_radius_um"] * 1.01
    library = tmp_path / "calibration_library.parquet"
    rows = [row | {"cell_radius_um": radius} for row in own]
    write_table("calibration_library", rows, library, {})
    index = sorted(row["deformation_index"] for row in own if row["default"])[0]
    request = {
        **{k: v for k, v in GOOD.items() if k != "stiffness_set_1"},
        "deformation_index_1": index,
        "radius_1_um": radius,
    }
    settings = job_settings(campaign, request)
    for further, known in (({}, False), ({"library": library}, True)):
        inputs = design_jobs._inputs(settings, **inputs_of(campaign), **further)
        if known:
            assert inputs.populations(inputs.requests[0])[0].radius_um == radius
        else:
            with pytest.raises(DldsimError, match="is calibrated for"):
                inputs.populations(inputs.requests[0])


def test_a_campaign_of_failed_requests_only_has_empty_tables(campaign, tmp_path):
    settings = job_settings(campaign, {**GOOD, "stiffness_set_1": "dead"})
    kinds = (*design_answers.SEARCH, "design_requests")
    tables = {kind: tmp_path / f"{kind}.parquet" for kind in kinds}
    design_jobs.design_job(
        settings,
        tables=tables,
        outcomes=campaign / "outcomes.parquet",
        progress=print,
        **inputs_of(campaign),
    )
    assert not any(read_rows(kind, tables[kind]) for kind in design_answers.SEARCH)
    out = {
        name: tmp_path / f"{name}.parquet"
        for name in ("verifications", "designs", "added", "requests")
    }
    design_jobs.verify_job(
        "good",
        settings,
        outcomes=campaign / "outcomes.parquet",
        **out,
        files=tmp_path / "files",
        work=tmp_path / "work",
        threads=1,
        progress=print,
        **inputs_of(campaign),
    )
    [row] = read_rows("verified_requests", out["requests"])
    assert row["status"] == "failed" and "dead" in row["reason"]
    assert not read_rows("verified_designs", out["designs"]) and (tmp_path / "files").is_dir()
    tables = {
        kind: tmp_path / f"all-{kind}.parquet"
        for kind in ("verifications", "verified_designs", "verified_requests", "outcomes")
    }
    design_jobs.gather_verified(
        settings,
        verifications=[out["verifications"]],
        designs=[out["designs"]],
        added=[out["added"]],
        requests=[out["requests"]],
        tables=tables,
        outcomes=campaign / "outcomes.parquet",
        model=tmp_path / "m.json",
        card=tmp_path / "c.json",
    )
    assert read_rows("verified_requests", tables["verified_requests"]) == [row]


def test_too_few_flows_leave_the_pressure_unknown_and_say_why(campaign, tmp_path):
    settings = job_settings(campaign, GOOD)
    flows = read_table("flows", campaign / "flows.parquet").head(3)
    chip = finished_campaign.make_chip(settings, flows)
    [basis] = chip.pressure_basis(7.0, 16.0, 8)
    assert basis.startswith("not known: 3 flows are too few")
    with pytest.raises(DldsimError, match="pressure_max_kPa = 1 .*3 flows are too few"):
        run(Known(hill), ask(pressure_max_kPa=1.0), chip)
