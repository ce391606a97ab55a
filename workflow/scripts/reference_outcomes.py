"""Outcomes of all pairs in; reference, model of the numerical uncertainty and its check out."""

import sys
from pathlib import Path

from dldsim.app.job_log import job_log
from dldsim.app.reference_jobs import gather_pairs

with job_log(snakemake.log[0]):
    files = map(Path, snakemake.input)
    sentence = gather_pairs(
        [(*pair, file) for pair, file in zip(snakemake.params.pairs, files, strict=True)],
        snakemake.params.settings,
        outcomes=Path(snakemake.output.outcomes),
        campaign=Path(snakemake.output.campaign),
        domain=Path(snakemake.output.domain),
        model=Path(snakemake.output.model),
        check=Path(snakemake.output.check),
    )
sys.stderr.write(f"{sentence}\n")
