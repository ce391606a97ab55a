"""One point of a calibration: settings in, rows and trajectories of its passages out."""

from pathlib import Path

from dldsim.app.assay_jobs import assay_job
from dldsim.app.job_log import job_log

with job_log(snakemake.log[0]) as progress:
    assay_job(
        snakemake.wildcards.point,
        snakemake.params.settings,
        rows=Path(snakemake.output.rows),
        trajectory=Path(snakemake.output.trajectory),
        crashes=Path(snakemake.params.crash_directory),
        progress=progress,
    )
