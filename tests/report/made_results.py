"""Tables of a small made-up campaign, of every kind that the report reads."""

from pathlib import Path

import numpy as np
import pandas as pd

from dldsim.report.inputs import TABLES
from dldsim.tables.parquet import write_csv, write_table
from tests.report.design_tables import make_design_tables
from tests.report.made_assays import assay_tables, make_passages
from tests.report.made_runs import SETS, flow_table, make_outcome, make_run
from tests.report.made_statistics import (
    anova_tables,
    benchmark_tables,
    robustness_table,
    sensitivity_tables,
)
from tests.report.made_studies import accuracy_tables, stability_table, validation_table

PROVENANCE = {"config_hash": "0123abcd", "seed": 7}
CONFIG = {
    "preset": "tiny",
    "seed": 7,
    "cell": {"shape": "biconcave", "radius_um": 7.5},
    "run_control": {"max_rows": 12},
    "constriction": {"width_um": 30.0},
}


def make_results(folder: Path, radii=(6.0, 10.0), gaps=(16.0, 20.0), periodicities=(5, 10)) -> dict:
    """All tables of a small campaign with every status; returns the tables by kind."""
    rng = np.random.default_rng(1)
    arrays = [(r, g, n) for r in radii for g in gaps for n in periodicities]
    ends = {(arrays[0], "1"): "stuck", (arrays[0], "3"): "unstable", (arrays[1], "1"): "failed"}
    made = [make_run(*a, s, rng, ends.get((a, s))) for a in arrays for s in SETS]
    pairs = [[row] for row, _ in made]
    known = next(i for i, [row] in enumerate(pairs) if row["mode"] == "bump")
    again, track = make_run(
        *(
            made[known][0][k]
            for k in ("pillar_radius_um", "gap_um", "periodicity", "stiffness_set")
        ),
        rng,
        place=0.2,
    )
    pairs[known].append(again | {"mode": "zigzag", "status": "stationary", "orbit_rows": 0})
    made.insert(known + 1, (pairs[known][1], track))
    runs = [row for rows in pairs for row in rows]
    outcomes = pd.DataFrame([make_outcome(rows) for rows in pairs])
    passages, paths = make_passages()
    tables = {
        "outcomes": outcomes,
        "runs": pd.DataFrame(runs),
        "trajectory": pd.concat(
            [pd.DataFrame(track) for row, track in made if row["status"] != "failed"]
        ),
        "flows": flow_table(arrays),
        "robustness": robustness_table(outcomes),
        "validation": validation_table(),
        "stability": stability_table(),
        **assay_tables(passages),
        **anova_tables(),
        **sensitivity_tables(outcomes),
        **benchmark_tables(outcomes, rng),
        **make_design_tables("soft <from> stiff"),
        **accuracy_tables(),
    }
    for kind, table in tables.items():
        path = folder / TABLES[kind][0]
        write_table(kind, table, path, PROVENANCE)
        if kind != "trajectory":
            write_csv(kind, path)
    for track in paths:
        name = f"{track['run_id'].iloc[0]}.trajectory.parquet"
        write_table("assay_trajectory", track, folder / "assays" / name, PROVENANCE)
    return tables
