"""One outcome: settings and empty flow in, its row, its runs and their trajectories out."""

from pathlib import Path

from dldsim.app.job_log import job_log
from dldsim.app.jobs import outcome_job
from dldsim.experiments.outcome_files import OutcomeFiles

with job_log(snakemake.log[0]) as progress:
    outcome_job(
        snakemake.wildcards.outcome,
        snakemake.params.settings,
        flow=Path(snakemake.input.flow),
        flow_row=Path(snakemake.input.flow_row),
        files=OutcomeFiles(*(Path(snakemake.output[kind]) for kind in OutcomeFiles._fields)),
        partial=Path(snakemake.params.partial),
        crashes=Path(snakemake.params.crash_directory),
        progress=progress,
    )
