"""Outcomes in, fitted surrogate and its card out."""

from pathlib import Path

from dldsim.analysis.surrogate import fit
from dldsim.app.jobs import job_log
from dldsim.config.provenance import derive_seed
from dldsim.tables.parquet import read_table

with job_log(snakemake.log[0]):
    seed = derive_seed(snakemake.params.settings["seed"], "surrogate")
    model = fit(read_table("outcomes", snakemake.input[0]), seed)
    model.save(Path(snakemake.output.model), Path(snakemake.output.card))
