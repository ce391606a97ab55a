"""Last points of all searches in; critical gaps and their convergence out."""

from pathlib import Path

from dldsim.app.job_log import job_log
from dldsim.app.reference_jobs import gather_gaps

with job_log(snakemake.log[0]):
    gather_gaps(
        zip(snakemake.params.searches, map(Path, snakemake.input), strict=True),
        snakemake.params.settings,
        gaps=Path(snakemake.output.gaps),
        convergence=Path(snakemake.output.convergence),
    )
