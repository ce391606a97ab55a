"""Rows of the accuracy runs in, table of errors out."""

from dldsim.accuracy import parse_variant, table
from dldsim.config import Config
from dldsim.jobs import job_log, provenance
from dldsim.tables import read_rows, write_csv, write_table

with job_log(snakemake.log[0]):
    config = Config(**snakemake.params.config)
    rows = [
        (parse_variant(variant), read_rows("runs", path)[0])
        for variant, path in zip(snakemake.params.variants, snakemake.input.rows, strict=True)
    ]
    write_table(
        "accuracy", table(rows, config), snakemake.output.table,
        provenance(snakemake.params.settings),
    )  # fmt: skip
    write_csv("accuracy", snakemake.output.table)
