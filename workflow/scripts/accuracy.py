"""Rows of the accuracy runs in; table of errors out."""

from pathlib import Path

from dldsim.app.jobs import gather_accuracy, job_log
from dldsim.config.configuration import Config

with job_log(snakemake.log[0]):
    gather_accuracy(
        zip(snakemake.params.variants, map(Path, snakemake.input.rows), strict=True),
        Config(**snakemake.params.config), snakemake.params.settings,
        table=Path(snakemake.output.table),
    )  # fmt: skip
