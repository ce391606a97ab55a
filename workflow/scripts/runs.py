"""All runs into one table, with deformation index and numerical uncertainty."""

from dldsim.accuracy import read_model, with_uncertainty
from dldsim.calibration import join_deformation_index
from dldsim.jobs import job_log, provenance
from dldsim.tables import read_many, read_table, write_csv, write_table

with job_log(snakemake.log[0]):
    settings = snakemake.params.settings
    runs = read_many("runs", snakemake.input.rows)
    runs = join_deformation_index(runs, read_table("calibration", snakemake.input.calibration))
    runs = with_uncertainty(runs, settings["run_control"], read_model())
    write_table("runs", runs, snakemake.output.table, provenance(settings))
    write_csv("runs", snakemake.output.table)
