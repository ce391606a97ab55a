"""Surrogate, calibration and requests in, ranked designs out."""

from pathlib import Path

from dldsim.jobs import design_job, job_log

with job_log(snakemake.log[0]):
    design_job(
        snakemake.params.settings,
        model=Path(snakemake.input.model),
        card=Path(snakemake.input.card),
        calibration=Path(snakemake.input.calibration),
        designs=Path(snakemake.output.table),
        trials=Path(snakemake.output.trials),
    )
