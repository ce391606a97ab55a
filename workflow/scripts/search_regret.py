"""Surrogate, calibration, flows and requests in, regret of the search methods out."""

from pathlib import Path

from dldsim.app.design_jobs import regret_job
from dldsim.app.job_log import job_log

with job_log(snakemake.log[0]) as progress:
    regret_job(
        snakemake.params.settings,
        table=Path(snakemake.output.table),
        progress=progress,
        **{name: Path(path) for name, path in snakemake.input.items() if path},
    )
