"""One constriction run: settings in, run row and trajectory out."""

from pathlib import Path

from dldsim.app.jobs import constriction_job, job_log

with job_log(snakemake.log[0]) as progress:
    constriction_job(
        snakemake.wildcards.constriction,
        snakemake.params.settings,
        row=Path(snakemake.output.row),
        trajectory=Path(snakemake.output.trajectory),
        crashes=Path(snakemake.params.crash_directory),
        progress=progress,
    )
