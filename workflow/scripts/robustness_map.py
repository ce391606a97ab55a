"""Outcomes in, robustness of each geometry out."""

from dldsim.analysis.robustness import robustness
from dldsim.app.job_log import job_log
from dldsim.config.provenance import provenance
from dldsim.tables.parquet import read_table, write_csv, write_table

with job_log(snakemake.log[0]):
    table, about = snakemake.output.table, provenance(snakemake.params.settings)
    write_table("robustness", robustness(read_table("outcomes", snakemake.input[0])), table, about)
    write_csv("robustness", table)
