"""All tables in, one HTML page out."""

from pathlib import Path

from dldsim.app.job_log import job_log
from dldsim.report.campaign_page import make_report

with job_log(snakemake.log[0]):
    page = Path(snakemake.output[0])
    make_report(page.parent, page, snakemake.params.settings)
