"""One family of the stability sweep: its points out."""

from dldsim.config import Config
from dldsim.jobs import job_log, provenance
from dldsim.stability_sweep import run_family
from dldsim.tables import write_table

with job_log(snakemake.log[0]) as progress:
    rows = run_family(snakemake.wildcards.family, Config(**snakemake.params.config), progress)
    write_table(
        "stability", rows, snakemake.output.table, provenance(snakemake.params.settings)
    )
