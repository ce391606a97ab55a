"""One run of the accuracy study: settings in, run row out."""

from pathlib import Path

from dldsim.app.evidence_jobs import accuracy_job
from dldsim.app.job_log import job_log

with job_log(snakemake.log[0]) as progress:
    accuracy_job(
        snakemake.wildcards.variant,
        snakemake.params.settings,
        row=Path(snakemake.output.row),
        crashes=Path(snakemake.params.crash_directory),
        progress=progress,
    )
