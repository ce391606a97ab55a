"""A calibration outside a campaign: passages one after the other, kept as they come."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from dldsim import PHYSICS_VERSION
from dldsim.analysis.passages import calibrate
from dldsim.app.assay_jobs import assay_job
from dldsim.config.provenance import provenance, settings_hash
from dldsim.experiments.outcome_files import Progress, made_with
from dldsim.files import atomic_path
from dldsim.report.assay_figures import draw_curves
from dldsim.report.style import render
from dldsim.tables.parquet import concatenate, read_table, write_csv, write_table


def run_calibration(
    name: str, settings: Mapping[str, Mapping], output: Path, progress: Progress
) -> tuple[pd.DataFrame, list[Path]]:
    """Simulate the points of an assay that are not in ``output`` yet, and write there
    `assay_runs`, `calibration` and a figure; returns the calibration and the files.

    ``settings``: of every point by its identifier. What was made with others is made anew.
    """
    sources = []
    for number, (identifier, given) in enumerate(settings.items(), start=1):
        given = {**given, "physics_version": PHYSICS_VERSION}
        rows = output / "passages" / f"{identifier}.runs.parquet"
        sources.append(rows)
        where = f"{identifier}, {number} of {len(settings)}"
        if made_with(rows, settings_hash(given)):
            progress(f"{where}: kept")
            continue
        progress(f"{where}: begins")
        assay_job(
            identifier,
            given,
            rows=rows,
            trajectory=output / "passages" / f"{identifier}.trajectory.parquet",
            crashes=output / "crashes",
            progress=lambda sentence, where=where: progress(f"{where}: {sentence}"),
        )
    about = provenance({"points": dict(settings), "physics_version": PHYSICS_VERSION})
    files = [output / f"{kind}.parquet" for kind in ("assay_runs", "calibration")]
    concatenate("assay_runs", sources, files[0], about)
    table = calibrate(read_table("assay_runs", files[0]), name)
    write_table("calibration", table, files[1], about)
    for kind, path in zip(("assay_runs", "calibration"), files, strict=True):
        write_csv(kind, path)
    figure = output / "calibration.png"
    with atomic_path(figure) as part:
        part.write_bytes(render(draw_curves(table), "png"))
    return table, [*files, figure]
