"""One run: settings and empty flow in, run row and trajectory out."""

from pathlib import Path

from dldsim.jobs import job_log, run_job

with job_log(snakemake.log[0]) as progress:
    run_job(
        snakemake.wildcards.run,
        snakemake.params.settings,
        flow=Path(snakemake.input.flow),
        flow_row=Path(snakemake.input.flow_row),
        row=Path(snakemake.output.row),
        trajectory=Path(snakemake.output.trajectory),
        crashes=Path(snakemake.params.crash_directory),
        progress=progress,
    )
