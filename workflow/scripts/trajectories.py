"""All trajectories into one table."""

from dldsim.app.job_log import job_log
from dldsim.config.provenance import provenance
from dldsim.tables.parquet import concatenate

with job_log(snakemake.log[0]):
    about = provenance(snakemake.params.settings)
    concatenate("trajectory", snakemake.input, snakemake.output[0], about)
