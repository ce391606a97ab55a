"""Verifications of all requests in, their tables and the refitted surrogate out."""

from pathlib import Path

from dldsim.app.design_jobs import gather_verified
from dldsim.app.job_log import job_log

with job_log(snakemake.log[0]):
    gather_verified(
        snakemake.params.settings,
        verifications=map(Path, snakemake.input.verifications),
        designs=map(Path, snakemake.input.designs),
        added=map(Path, snakemake.input.added),
        requests=map(Path, snakemake.input.requests),
        outcomes=Path(snakemake.input.outcomes),
        tables={
            "verifications": Path(snakemake.output.verifications),
            "verified_designs": Path(snakemake.output.designs),
            "verified_requests": Path(snakemake.output.requests),
            "outcomes": Path(snakemake.output.outcomes),
        },
        model=Path(snakemake.output.model),
        card=Path(snakemake.output.card),
    )
