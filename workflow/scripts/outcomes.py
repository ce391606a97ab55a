"""All outcomes into one table, with deformation index and numerical uncertainty."""

from dldsim.analysis.calibration import join_deformation_index
from dldsim.analysis.uncertainty import read_models, with_uncertainty
from dldsim.app.job_log import job_log
from dldsim.config.provenance import provenance
from dldsim.tables.parquet import read_many, read_table, write_csv, write_table

with job_log(snakemake.log[0]):
    settings = snakemake.params.settings
    outcomes = read_many("outcomes", snakemake.input.rows)
    calibration = read_table("calibration", snakemake.input.calibration)
    outcomes = join_deformation_index(outcomes, calibration)
    outcomes = with_uncertainty(outcomes, read_models())
    write_table("outcomes", outcomes, snakemake.output.table, provenance(settings))
    write_csv("outcomes", snakemake.output.table)
