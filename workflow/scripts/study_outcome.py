"""One outcome of the reference study or the spot check: settings in, its row out."""

from pathlib import Path

from dldsim.app.jobs import job_log
from dldsim.app.reference_jobs import outcome_job, simulator

with job_log(snakemake.log[0]) as progress:
    outcome_job(
        snakemake.wildcards.outcome,
        snakemake.params.settings,
        row=Path(snakemake.output.row),
        simulate=simulator(Path(snakemake.params.partial), progress),
    )
