"""One family of the stability sweep: its points out."""

from dldsim.app.job_log import job_log
from dldsim.config.configuration import sections_from
from dldsim.config.provenance import provenance
from dldsim.evidence.stability_sweep import run_family
from dldsim.tables.parquet import write_table

with job_log(snakemake.log[0]) as progress:
    settings = snakemake.params.settings
    rows = run_family(snakemake.wildcards.family, sections_from(settings), progress)
    write_table("stability", rows, snakemake.output.table, provenance(settings))
