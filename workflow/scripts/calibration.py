"""Passages of the assays in, calibrations and correlations of the index out."""

from dldsim.analysis.passages import calibrate, correlations
from dldsim.app.assay_jobs import published
from dldsim.app.job_log import job_log
from dldsim.config.provenance import provenance
from dldsim.tables.parquet import read_table, write_csv, write_table

with job_log(snakemake.log[0]):
    settings, out = snakemake.params.settings, snakemake.output
    runs = read_table("assay_runs", snakemake.input[0])
    about = provenance(settings)
    table = calibrate(runs, settings["default_assay"], published(settings))
    write_table("calibration", table, out.calibration, about)
    write_csv("calibration", out.calibration)
    write_table("calibration_correlations", correlations(runs), out.correlations, about)
    write_csv("calibration_correlations", out.correlations)
