"""Tables of one kind into one, with its CSV twin."""

from dldsim.app.job_log import job_log
from dldsim.config.provenance import provenance
from dldsim.tables.parquet import concatenate, write_csv

with job_log(snakemake.log[0]):
    kind, table = snakemake.params.kind, snakemake.output.table
    concatenate(kind, snakemake.input, table, provenance(snakemake.params.settings))
    write_csv(kind, table)
