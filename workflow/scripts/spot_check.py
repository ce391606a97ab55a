"""Outcomes of the campaign and of the check in; their comparison out."""

import sys
from pathlib import Path

from dldsim.app.job_log import job_log
from dldsim.app.reference_jobs import gather_spot_check

with job_log(snakemake.log[0]):
    sentence = gather_spot_check(
        Path(snakemake.input.outcomes),
        [*map(Path, snakemake.input.checks)],
        snakemake.params.settings,
        table=Path(snakemake.output.table),
    )
sys.stderr.write(f"{sentence}\n")
