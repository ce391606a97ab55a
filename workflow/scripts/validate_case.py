"""One validation case: its comparisons with the reference out."""

from pathlib import Path

from dldsim.app.evidence_jobs import validation_job
from dldsim.app.job_log import job_log

with job_log(snakemake.log[0]) as progress:
    validation_job(
        snakemake.wildcards.case,
        snakemake.params.settings,
        table=Path(snakemake.output.table),
        crashes=Path(snakemake.params.crash_directory),
        progress=progress,
    )
