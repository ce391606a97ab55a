"""Outcomes at the campaign's numerics in; their comparison with the reference out."""

import sys
from pathlib import Path

from dldsim.app.job_log import job_log
from dldsim.app.reference_jobs import compare

with job_log(snakemake.log[0]):
    sentence = compare(
        [*map(Path, snakemake.input.rows)],
        snakemake.params.settings,
        table=Path(snakemake.output.table),
    )
sys.stderr.write(f"{sentence}\n")
