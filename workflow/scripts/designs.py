"""Surrogate, calibration, flows and requests in, ranked candidates out."""

from pathlib import Path

from dldsim.app.design_jobs import design_job
from dldsim.app.job_log import job_log

with job_log(snakemake.log[0]) as progress:
    design_job(
        snakemake.params.settings,
        tables={
            "design_populations": Path(snakemake.output.populations),
            "designs": Path(snakemake.output.table),
            "design_trials": Path(snakemake.output.trials),
            "design_tolerances": Path(snakemake.output.tolerances),
            "design_importance": Path(snakemake.output.importance),
            "design_slices": Path(snakemake.output.slices),
            "design_requests": Path(snakemake.output.requests),
        },
        progress=progress,
        **{name: Path(path) for name, path in snakemake.input.items() if path},
    )
