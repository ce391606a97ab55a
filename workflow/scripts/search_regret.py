"""Surrogate, calibration and requests in, regret of the search methods out."""

from pathlib import Path

from dldsim.jobs import job_log, regret_job

with job_log(snakemake.log[0]):
    regret_job(
        snakemake.params.settings,
        model=Path(snakemake.input.model),
        card=Path(snakemake.input.card),
        calibration=Path(snakemake.input.calibration),
        table=Path(snakemake.output.table),
    )
