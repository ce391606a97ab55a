"""Rows of the accuracy runs in; table of errors out."""

from pathlib import Path

from dldsim.app.evidence_jobs import gather_accuracy
from dldsim.app.job_log import job_log

with job_log(snakemake.log[0]):
    gather_accuracy(
        zip(snakemake.params.variants, map(Path, snakemake.input.rows), strict=True),
        snakemake.params.settings,
        table=Path(snakemake.output.table),
    )
