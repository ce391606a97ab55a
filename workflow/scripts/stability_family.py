"""One family of the stability sweep: its points out."""

from dldsim.app.jobs import job_log, provenance
from dldsim.config.configuration import Config
from dldsim.evidence.stability_sweep import run_family
from dldsim.tables.parquet import write_table

with job_log(snakemake.log[0]) as progress:
    rows = run_family(snakemake.wildcards.family, Config(**snakemake.params.config), progress)
    write_table(
        "stability", rows, snakemake.output.table, provenance(snakemake.params.settings)
    )
