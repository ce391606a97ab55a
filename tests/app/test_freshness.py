"""What a file on disk says of its making."""

import pyarrow.parquet as pq

from dldsim.app.freshness import difference
from dldsim.config.provenance import provenance
from dldsim.tables.parquet import write_table

SETTINGS = {"sweep": {"gap_um": 12.0}}


def test_a_table_that_lacks_a_column_of_its_kind_is_stale(tmp_path):
    path = tmp_path / "flows.parquet"
    write_table("flows", [], path, provenance(SETTINGS))
    assert difference(path, SETTINGS) is None
    assert "gap_um = 12.0, now 14.0" in difference(path, {"sweep": {"gap_um": 14.0}})
    table = pq.read_table(path)
    pq.write_table(table.drop_columns(["gap_um"]), path)
    assert difference(path, SETTINGS) == "columns of an older version, without gap_um"
