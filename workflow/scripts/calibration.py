"""Constriction runs in, deformation index per group and its correlations out."""

from dldsim.analysis.calibration import calibrate, correlations
from dldsim.app.jobs import job_log
from dldsim.config.provenance import provenance
from dldsim.tables.parquet import read_table, write_csv, write_table

with job_log(snakemake.log[0]):
    runs = read_table("constriction_runs", snakemake.input[0])
    about = provenance(snakemake.params.settings)
    write_table("calibration", calibrate(runs), snakemake.output.calibration, about)
    write_csv("calibration", snakemake.output.calibration)
    write_table(
        "calibration_correlations", correlations(runs), snakemake.output.correlations, about
    )
    write_csv("calibration_correlations", snakemake.output.correlations)
