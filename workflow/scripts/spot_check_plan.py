"""Outcomes of the campaign in; what checking those drawn will cost out."""

import sys
from pathlib import Path

from dldsim.app.job_log import job_log
from dldsim.app.reference_jobs import spot_check_cost

with job_log(snakemake.log[0]):
    sentence = spot_check_cost(
        Path(snakemake.input.outcomes), snakemake.params.drawn, len(snakemake.params.releases)
    )
    Path(snakemake.output[0]).write_text(f"{sentence}\n", encoding="utf-8")
sys.stderr.write(f"{sentence}\n")
