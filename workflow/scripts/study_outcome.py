"""One outcome of the reference study or the spot check: settings and settled cells in, row out."""

from pathlib import Path

from dldsim.app.job_log import job_log
from dldsim.app.reference_jobs import outcome_job, simulator

with job_log(snakemake.log[0]) as progress:
    simulate = simulator(
        Path(snakemake.params.partial),
        progress,
        coarser=snakemake.input.get("coarser"),
        cells=snakemake.output.get("cells"),
    )
    outcome_job(
        snakemake.wildcards.outcome,
        snakemake.params.settings,
        row=Path(snakemake.output.row),
        simulate=simulate,
    )
