"""Points of the survey into one table of each kind, with the numerical uncertainty."""

from pathlib import Path

from dldsim.app.job_log import job_log
from dldsim.app.survey_jobs import gather

KINDS = {"plan": "survey_plan", "outcomes": "outcomes", "runs": "runs", "flows": "flows"}

with job_log(snakemake.log[0]):
    gather(
        {kind: snakemake.input[name] for name, kind in KINDS.items()},
        snakemake.params.settings,
        tables={kind: Path(snakemake.output[name]) for name, kind in KINDS.items()},
    )
