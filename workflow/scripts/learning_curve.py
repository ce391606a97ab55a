"""Outcomes in, error of the surrogate against the number of outcomes out."""

from dldsim.analysis.regressors import learning_curve
from dldsim.app.jobs import job_log
from dldsim.config.provenance import derive_seed, provenance
from dldsim.tables.parquet import read_table, write_csv, write_table

with job_log(snakemake.log[0]):
    seed = derive_seed(snakemake.params.settings["seed"], "learning_curve")
    table = snakemake.output.table
    curve = learning_curve(read_table("outcomes", snakemake.input[0]), seed)
    write_table("learning_curve", curve, table, provenance(snakemake.params.settings, seed))
    write_csv("learning_curve", table)
