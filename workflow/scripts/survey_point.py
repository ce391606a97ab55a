"""One point of the survey: plan in, outcome, runs, trajectories and flow without a cell out."""

import sys
from pathlib import Path

from dldsim.app.job_log import job_log
from dldsim.app.survey_jobs import point_job, point_of, sentence
from dldsim.experiments.outcome_files import OutcomeFiles

with job_log(snakemake.log[0]) as progress:
    point = point_of(int(snakemake.wildcards.number), Path(snakemake.input.plan))
    progress(sentence(point))
    sys.__stderr__.write(f"{sentence(point)}\n")
    point_job(
        point,
        snakemake.params.settings,
        files=OutcomeFiles(*(Path(snakemake.output[kind]) for kind in OutcomeFiles._fields)),
        flow=Path(snakemake.output.flow),
        releases=Path(snakemake.params.releases),
        crashes=Path(snakemake.params.crash_directory),
        progress=progress,
    )
