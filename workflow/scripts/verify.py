"""One design request: surrogate and outcomes in, verified designs and their files out."""

from pathlib import Path

from dldsim.app.design_jobs import verify_job
from dldsim.app.job_log import job_log

with job_log(snakemake.log[0]) as progress:
    verify_job(
        snakemake.wildcards.request,
        snakemake.params.settings,
        work=Path(snakemake.params.work),
        threads=snakemake.threads,
        progress=progress,
        **{name: Path(path) for name, path in snakemake.output.items()},
        **{name: Path(path) for name, path in snakemake.input.items() if path},
    )
