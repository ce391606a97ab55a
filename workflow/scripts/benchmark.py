"""Outcomes in, errors and predictions of each regressor out."""

from dldsim.analysis.benchmark import benchmark
from dldsim.analysis.learning import survey_of
from dldsim.app.job_log import job_log
from dldsim.config.provenance import derive_seed, provenance
from dldsim.tables.parquet import read_table, write_csv, write_table

with job_log(snakemake.log[0]) as progress:
    settings = snakemake.params.settings
    seed = derive_seed(settings["seed"], "benchmark")
    outcomes = read_table("outcomes", snakemake.input[0])
    scores, predictions = benchmark(outcomes, seed, survey=survey_of(settings), progress=progress)
    for kind, table, path in (
        ("benchmark", scores, snakemake.output.table),
        ("predictions", predictions, snakemake.output.predictions),
    ):
        write_table(kind, table, path, provenance(settings, seed))
        write_csv(kind, path)
