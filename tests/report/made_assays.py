"""Tables of made-up passages through constrictions and what they calibrate."""

import numpy as np
import pandas as pd

from dldsim.analysis.passages import calibrate, correlations
from dldsim.tables.registry import COLUMNS

GROUPS = ("G1", "G2", "G3", "G4", "G5", "G6", "G7")


def make_passages() -> tuple[pd.DataFrame, list[pd.DataFrame]]:
    """`assay_runs` of two assays, one passage of them stuck; the paths of the first."""
    moduli = {g: (5 + 2.5 * i, 0.04 + 0.05 * i, 10 + 5 * i) for i, g in enumerate(GROUPS)}
    set_of = {"G1": "1", "G2": "2", "G5": "3", "G6": "4", "G7": "5"}
    constriction, paths = [], []
    for i, group in enumerate(GROUPS):
        for j in range(3):
            ks, kb, kal = moduli[group]
            index = 0.5 + 0.04 * i + 0.02 * j
            lost = (group, j) == ("G4", 2)
            row = dict.fromkeys((c.name for c in COLUMNS["assay_runs"]), 0.1) | {
                "run_id": f"group-velocity_{group}_{j}",
                "assay": "group-velocity",
                "kind": "constriction",
                "cell_shape": "biconcave",
                "cell_radius_um": 7.5,
                "varied": "release" if j else "nothing",
                "axis": "z",
                "group": group,
                "stiffness_set": set_of.get(group, ""),
                "ks_uN_per_m": ks,
                "kb_pN_um": kb,
                "kal_uN_per_m": kal,
                "velocity_mm_s": 1.095 + 0.33 * i,
                "release_position_um": 3.0 * j,
                "status": "stuck" if lost else "passed",
                "stop_reason": "clogged the throat" if lost else "left the channel",
                "deformation_index": None if lost else index,
                "steps": 9000,
            }
            constriction.append(row)
            x = np.linspace(8 + 3 * j, 110, 120)
            squeeze = index * np.exp(-(((x - 60) / 18) ** 4))
            paths.append(
                pd.DataFrame(
                    {c.name: np.ones(120) for c in COLUMNS["assay_trajectory"]}
                    | {
                        "run_id": [row["run_id"]] * 120,
                        "step": np.arange(120),
                        "x_um": x,
                        "diameter_d_um": 15 * (1 + squeeze),
                        "diameter_h_um": 15 * (1 - squeeze),
                        "deformation_index": squeeze,
                    }
                )
            )
    own = pd.DataFrame(constriction)
    fixed = own.assign(
        assay="fixed-velocity",
        stiffness_set="",
        velocity_mm_s=2.0,
        run_id=lambda t: t["run_id"].str.replace("group", "fixed"),
        deformation_index=lambda t: 1.2 - t["deformation_index"],
    )
    return pd.concat([own, fixed]), paths


def assay_tables(passages: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """What passages calibrate, by kind."""
    calibration = calibrate(passages, "group-velocity")
    kinds = ("calibration", "assay_study", "calibration_library")
    return dict.fromkeys(kinds, calibration) | {
        "assay_runs": passages,
        "calibration_correlations": correlations(passages),
    }
