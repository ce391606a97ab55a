"""One point of a search for a critical gap: points so far in, one more out."""

from pathlib import Path

from dldsim.app.job_log import job_log
from dldsim.app.reference_jobs import point_job, simulator

with job_log(snakemake.log[0]) as progress:
    point_job(
        snakemake.wildcards.search,
        snakemake.params.settings,
        before=snakemake.input.get("before"),
        start=snakemake.input.get("start"),
        table=Path(snakemake.output.table),
        simulate=simulator(Path(snakemake.params.partial), progress),
    )
