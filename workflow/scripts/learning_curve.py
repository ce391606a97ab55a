"""Outcomes in, error of the surrogate against the number of outcomes out."""

from dldsim.analysis.benchmark import learning_curve
from dldsim.analysis.learning import survey_of
from dldsim.app.job_log import job_log
from dldsim.config.provenance import derive_seed, provenance
from dldsim.tables.parquet import read_table, write_csv, write_table

with job_log(snakemake.log[0]) as progress:
    settings, table = snakemake.params.settings, snakemake.output.table
    seed = derive_seed(settings["seed"], "learning_curve")
    outcomes = read_table("outcomes", snakemake.input[0])
    curve = learning_curve(outcomes, seed, survey_of(settings), progress)
    write_table("learning_curve", curve, table, provenance(settings, seed))
    write_csv("learning_curve", table)
