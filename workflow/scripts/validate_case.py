"""One validation case: its comparisons with the reference out."""

from pathlib import Path

from dldsim.app.jobs import job_log, validation_job

with job_log(snakemake.log[0]) as progress:
    validation_job(
        snakemake.wildcards.case,
        snakemake.params.settings,
        table=Path(snakemake.output.table),
        crashes=Path(snakemake.params.crash_directory),
        progress=progress,
    )
