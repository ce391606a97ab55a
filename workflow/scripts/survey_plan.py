"""Outcomes of the earlier rounds of the survey in, points of the next round out."""

from pathlib import Path

from dldsim.app.job_log import job_log
from dldsim.app.survey_jobs import plan_job

with job_log(snakemake.log[0]):
    plan_job(
        int(snakemake.wildcards.round),
        snakemake.params.settings,
        outcomes=snakemake.input,
        table=Path(snakemake.output.table),
    )
