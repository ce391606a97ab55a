"""All runs into one table, with the deformation index of their stiffness sets."""

from dldsim.calibration import join_deformation_index
from dldsim.jobs import job_log, provenance
from dldsim.tables import read_many, read_table, write_csv, write_table

with job_log(snakemake.log[0]):
    runs = read_many("runs", snakemake.input.rows)
    calibration = read_table("calibration", snakemake.input.calibration)
    joined = join_deformation_index(runs, calibration)
    write_table("runs", joined, snakemake.output.table, provenance(snakemake.params.settings))
    write_csv("runs", snakemake.output.table)
