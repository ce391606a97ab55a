"""Compile every kernel once and stamp the results folder."""

from pathlib import Path

from dldsim.jobs import job_log, warm_cache

with job_log(snakemake.log[0]) as progress:
    warm_cache(snakemake.params.settings, Path(snakemake.output.stamp), progress)
