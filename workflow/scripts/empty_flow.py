"""One geometry: its flow without a cell."""

from pathlib import Path

from dldsim.app.job_log import job_log
from dldsim.app.jobs import flow_job

with job_log(snakemake.log[0]) as progress:
    flow_job(
        snakemake.wildcards.geometry,
        snakemake.params.settings,
        flow=Path(snakemake.output.flow),
        row=Path(snakemake.output.row),
        crashes=Path(snakemake.params.crash_directory),
        progress=progress,
    )
