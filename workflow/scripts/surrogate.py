"""Outcomes in, fitted surrogate and its card out."""

from pathlib import Path

from dldsim.analysis.learning import survey_of
from dldsim.analysis.surrogate import fit
from dldsim.app.job_log import job_log
from dldsim.config.provenance import derive_seed, provenance
from dldsim.tables.parquet import read_table

with job_log(snakemake.log[0]):
    settings = snakemake.params.settings
    seed = derive_seed(settings["seed"], "surrogate")
    model = fit(read_table("outcomes", snakemake.input[0]), seed, survey_of(settings))
    model.card["provenance"] = provenance(settings, seed)
    model.save(Path(snakemake.output.model), Path(snakemake.output.card))
