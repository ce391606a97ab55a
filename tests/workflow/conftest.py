"""A finished campaign to plan on."""

import json

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from dldsim.config.provenance import STAMP, settings_hash, stamp
from dldsim.tables.parquet import METADATA_KEY
from tests.workflow.snakemake_start import TINY, copy_workflow, plan, planned, touch


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    """A tiny campaign whose outputs Snakemake takes for finished; the files are empty shells that
    say what they were made with."""
    folder = copy_workflow(tmp_path_factory.mktemp("campaign"))
    for job in plan(folder, "all", config=TINY).jobs:
        for file in job.output:
            write_shell(folder / file, job.params.get("settings"))
    (folder / "results" / STAMP).write_text(json.dumps(stamp()))
    touch(folder, "all", config=TINY)
    assert planned(folder, "all", config=TINY) == {}
    return folder


def write_shell(path, settings):
    """An output without content."""
    path.parent.mkdir(parents=True, exist_ok=True)
    about = {"config_hash": settings_hash(settings or {}), "settings": settings}
    if path.parent.name == "designs":  # an output that is a folder
        path.mkdir(exist_ok=True)
    elif path.suffix == ".parquet":
        pq.write_table(
            pa.table({}).replace_schema_metadata({METADATA_KEY: json.dumps(about).encode()}), path
        )
    else:
        path.write_text(json.dumps({"provenance": about}))
