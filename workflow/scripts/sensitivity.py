"""Outcomes and surrogate in, sensitivities and fabrication risks out."""

from pathlib import Path

from dldsim.analysis.sensitivity import examine
from dldsim.analysis.surrogate import load
from dldsim.app.job_log import job_log
from dldsim.config.provenance import derive_seed, provenance
from dldsim.tables.parquet import read_table, write_csv, write_table

with job_log(snakemake.log[0]):
    settings = snakemake.params.settings
    seed = derive_seed(settings["seed"], "sensitivity")
    model = load(Path(snakemake.input.model), Path(snakemake.input.card))
    outcomes = read_table("outcomes", snakemake.input.outcomes)
    for kind, table in examine(model, outcomes, settings["fabrication"], seed).items():
        write_table(kind, table, snakemake.output[kind], provenance(settings, seed))
        write_csv(kind, snakemake.output[kind])
