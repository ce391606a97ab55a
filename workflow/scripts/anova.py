"""Outcomes in, analysis of variance and its diagnostics out."""

from dldsim.analysis.anova import analyse
from dldsim.app.job_log import job_log
from dldsim.config.provenance import derive_seed, provenance
from dldsim.tables.parquet import read_table, write_csv, write_table

with job_log(snakemake.log[0]):
    seed = derive_seed(snakemake.params.settings["seed"], "anova")
    about = provenance(snakemake.params.settings, seed)
    table, diagnostics = analyse(read_table("outcomes", snakemake.input[0]), seed)
    write_table("anova", table, snakemake.output.table, about)
    write_csv("anova", snakemake.output.table)
    write_table("anova_diagnostics", diagnostics, snakemake.output.diagnostics, about)
    write_csv("anova_diagnostics", snakemake.output.diagnostics)
