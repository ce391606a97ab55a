"""Settings as columns: each once, with unit and meaning, and the way back."""

import pytest

from dldsim.analysis.uncertainty import STUDIES
from dldsim.config.sections import Numerics
from dldsim.design.finished_campaign import CAMPAIGN_DATA
from dldsim.laws import COARSER_ALLOWED
from dldsim.tables.column import NUMERICS
from dldsim.tables.numerics import COLUMN_OF, columns_of, settings_of
from dldsim.tables.parquet import read_rows
from dldsim.tables.registry import COLUMNS


def test_every_setting_is_one_column_of_its_type_unit_and_meaning():
    assert [c.name for c in NUMERICS] == [COLUMN_OF[name] for name in Numerics.model_fields]
    found = {c.name: (str(c.type), c.unit) for c in NUMERICS}
    assert found["wanted_spacing_um"] == ("double", "µm")
    assert found["friction_nN_s_per_m"] == ("double", "nN·s/m")
    assert found["reynolds_max"] == ("double", "1")
    assert found["rows_in_domain"] == ("int64", "1")
    assert found["half_scene"] == ("bool", "")
    assert found["kernel"] == ("string", "")
    assert all(c.description and not c.nullable for c in NUMERICS)


@pytest.mark.parametrize("kind", ["runs", "outcomes"])
def test_no_column_has_two_meanings(kind):
    names = [c.name for c in COLUMNS[kind]]
    assert len(set(names)) == len(names) and {c.name for c in NUMERICS} < set(names)


def test_settings_come_back():
    numerics = Numerics(spacing_um=0.9, rows=3, kernel="4-point", half_scene=False)
    row = columns_of(numerics) | {"spacing_um": 0.85, "velocity_lu": 0.01}  # as used
    assert Numerics(**settings_of(row)) == numerics


@pytest.mark.parametrize(
    ("kind", "path"),
    [
        ("runs", CAMPAIGN_DATA / "runs.parquet"),
        ("outcomes", CAMPAIGN_DATA / "outcomes.parquet"),
        ("outcomes", CAMPAIGN_DATA.parent / "paper" / "outcomes.parquet"),
        ("outcomes", CAMPAIGN_DATA.parent / "survey" / "outcomes.parquet"),
        *(("reference_outcomes", path) for path in sorted(STUDIES.glob("*/*.parquet"))),
    ],
)
def test_tables_of_the_package_tell_the_settings(kind, path):
    for row in read_rows(kind, path):
        assert row["spacing_um"] <= COARSER_ALLOWED * Numerics(**settings_of(row)).spacing_um
