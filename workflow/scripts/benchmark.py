"""Outcomes in, errors and predictions of each regressor out."""

from dldsim.analysis.regressors import benchmark
from dldsim.app.jobs import job_log
from dldsim.config.provenance import derive_seed, provenance
from dldsim.tables.parquet import read_table, write_csv, write_table

with job_log(snakemake.log[0]):
    seed = derive_seed(snakemake.params.settings["seed"], "benchmark")
    about = provenance(snakemake.params.settings, seed)
    scores, predictions = benchmark(read_table("outcomes", snakemake.input[0]), seed)
    write_table("benchmark", scores, snakemake.output.table, about)
    write_csv("benchmark", snakemake.output.table)
    write_table("predictions", predictions, snakemake.output.predictions, about)
    write_csv("predictions", snakemake.output.predictions)
