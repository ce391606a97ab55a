"""Passages of some assays in, their calibrations out, and a figure where one is asked for."""

from pathlib import Path

from dldsim.app.assay_jobs import write_curves
from dldsim.app.job_log import job_log

with job_log(snakemake.log[0]):
    write_curves(
        snakemake.params.kind,
        snakemake.input,
        snakemake.params.settings,
        table=Path(snakemake.output.table),
        figure=snakemake.output.get("figure"),
    )
