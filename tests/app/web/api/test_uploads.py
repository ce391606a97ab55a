"""Uploaded tables in the shapes that spreadsheets and other programs give them."""

import io

import pandas as pd
import pytest

from dldsim.app.web.api import specs
from dldsim.app.web.api.data import check_sets, read_upload
from dldsim.errors import DldsimError
from dldsim.tables.parquet import read_table, write_csv

ROWS = 5000


@pytest.fixture(scope="module")
def frame(campaign):
    path = write_csv("outcomes", campaign / "outcomes.parquet")
    return pd.read_csv(path, dtype=str, keep_default_na=False)


def written(frame, encoding="utf-8", **options) -> bytes:
    return frame.to_csv(index=options.pop("index", False), **options).encode(encoding)


def read_back(upload, tmp_path, kind="outcomes"):
    (tmp_path / "x.parquet").write_bytes(upload.content)
    return read_table(kind, tmp_path / "x.parquet")


def with_commas(frame):
    return frame.map(
        lambda v: v.replace(".", ",") if v.replace(".", "", 1).replace("-", "", 1).isdigit() else v
    )


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (lambda f: written(f, quoting=1), ""),
        (lambda f: written(f, index=True), "row numbers"),
        (lambda f: written(f, "utf-16"), "UTF-16"),
        (lambda f: written(f, sep="\t"), "tabs"),
        (lambda f: written(with_commas(f), sep=";"), "decimal commas"),
        (lambda f: written(f.rename(columns={"gap_um": "Gap_um "})), "'Gap_um '"),
        (lambda f: written(f.assign(stiffness_set=f["stiffness_set"] + ".0")), ""),
        (lambda f: written(f.assign(coexisting="NA", settled_row="NaN", sigma_num_deg="null")), ""),
    ],
)
def test_tables_of_other_programs_are_the_same_table(frame, campaign, tmp_path, content, found):
    upload = read_upload("outcomes", content(frame), ROWS)
    expected = read_table("outcomes", campaign / "outcomes.parquet")
    pd.testing.assert_frame_equal(read_back(upload, tmp_path), expected)
    assert upload.rows == len(expected)
    assert any(found in note for note in upload.found) or not found
    assert upload.found or not found


@pytest.mark.parametrize("type_", ["float64", "int32", "category"])
def test_sets_of_a_parquet_file_are_text(campaign, tmp_path, type_):
    table = read_table("outcomes", campaign / "outcomes.parquet")
    buffer = io.BytesIO()
    table.assign(stiffness_set=table["stiffness_set"].astype(float).astype(type_)).to_parquet(
        buffer
    )
    upload = read_upload("outcomes", buffer.getvalue(), ROWS)
    assert read_back(upload, tmp_path)["stiffness_set"].tolist() == table["stiffness_set"].tolist()


def test_a_table_of_another_kind_is_named(campaign):
    content = write_csv("calibration", campaign / "calibration.parquet").read_bytes()
    with pytest.raises(DldsimError, match="missing outcome_id.*kind calibration"):
        read_upload("outcomes", content, ROWS)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("pillar_radius_um", "-5", ["-5", "0.1 to 1000"]),
        ("periodicity", "4.5", ["4.5", "whole number"]),
        ("periodicity", "0", ["0", "2 to 100"]),
        ("deformation_index", "7", ["7", "0 to 1"]),
        ("gap_um", "True", ["true or false"]),
        ("migration_angle_deg", "9999", ["9999"]),
        ("migration_angle_deg", "inf", ["finite"]),
        ("ks_uN_per_m", "-1", ["-1"]),
        ("capillary_number", "0", ["0", "1e-12 to 1e+06"]),
        ("gap_um", "12 um", ["'12 um' is no number"]),
        ("releases", "1.5", ["whole number"]),
        ("outcome_id", "", ["outcome_id"]),
        ("gap_um", "", ["gap_um", "must have a value"]),
    ],
)
def test_nonsense_in_a_table_is_refused(frame, name, value, words):
    spoilt = frame.copy()
    spoilt.loc[1, name] = value
    if name == "outcome_id":
        spoilt[name] = value
    with pytest.raises(DldsimError) as error:
        read_upload("outcomes", written(spoilt), ROWS)
    text = str(error.value)
    assert text.startswith("uploaded table outcomes") and name in text
    assert all(word in text for word in words), text


def test_a_set_that_is_calibrated_by_nothing_is_refused(frame, campaign):
    calibration = (campaign / "calibration.parquet").read_bytes()
    text = written(frame.assign(stiffness_set=frame["stiffness_set"] + ".0"))
    check_sets(
        {"outcomes": read_upload("outcomes", text, ROWS).content, "calibration": calibration}
    )
    text = written(frame.assign(stiffness_set="soft " + frame["stiffness_set"]))
    with pytest.raises(DldsimError, match="table calibration: .*stiffness set soft 1.*1, 2, 3"):
        check_sets(
            {"outcomes": read_upload("outcomes", text, ROWS).content, "calibration": calibration}
        )


@pytest.mark.parametrize("field", ["pillar_radius_um", "periodicity", "deformation_index"])
def test_true_is_no_number(field):
    given = {"pillar_radius_um": 7, "gap_um": 16, "periodicity": 6, "deformation_index": 0.6}
    specs.PredictSpec(**given)
    with pytest.raises(ValueError, match="not true or false"):
        specs.PredictSpec(**given | {field: True})
    with pytest.raises(ValueError, match="not true or false"):
        specs.DesignSpec(stiffness_set_1="1", stiffness_set_2="3", gap_um=(True, 20))
    assert specs.DesignSpec(stiffness_set_1="1", stiffness_set_2="3", verify=True).verify
