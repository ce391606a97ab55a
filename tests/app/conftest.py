"""A made-up campaign, for the commands, the jobs and the service."""

import pandas as pd
import pytest

from dldsim.analysis import surrogate
from dldsim.config.sections import Numerics, RunControl
from dldsim.tables.numerics import columns_of
from dldsim.tables.parquet import read_table, write_table
from dldsim.tables.registry import COLUMNS
from tests.analysis.made_outcomes import make_outcomes
from tests.design.test_chip import make_flows

SETS = {"1": 5.1, "2": 10.0, "3": 20.3}


def filled(kind, frame):
    """A table with every column: null, 0 or empty where the frame has none."""
    zero = {"string": "", "double": 0.0, "int64": 0, "bool": False}
    for column in COLUMNS[kind]:
        if column.name not in frame:
            empty = zero.get(str(column.type), [[]] * len(frame))
            frame[column.name] = None if column.nullable else empty
    return frame[[c.name for c in COLUMNS[kind]]]


@pytest.fixture
def nowhere(monkeypatch, tmp_path):
    """No config.yaml in the working directory."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="session")
def campaign(tmp_path_factory):
    """Folder with the tables that a campaign leaves for designs; tests add CSV files at most."""
    folder = tmp_path_factory.mktemp("campaign")
    outcomes = make_outcomes()
    ks = outcomes["stiffness_set"].map(SETS)
    outcomes = outcomes.assign(
        ks_uN_per_m=ks,
        kb_pN_um=0.1,
        kal_uN_per_m=2 * ks,
        kag_uN_per_m=500.0,
        kv_Pa=900.0,
        kvisc_nN_s_per_m=1.5,
        mean_velocity_mm_s=0.5,
        capillary_number=1.5 * 0.5 / ks,
        **columns_of(Numerics()),
        release_axis="y",
        drive="no-lateral-flux",
    )
    control = RunControl(max_rows=7).model_dump()
    write_table(
        "outcomes",
        filled("outcomes", outcomes),
        folder / "outcomes.parquet",
        {"config_hash": "x", "seed": 1, "settings": {"run_control": control}},
    )
    index = outcomes.groupby("stiffness_set")["deformation_index"].first()
    calibration = pd.DataFrame(
        [
            {
                "assay": "group-velocity",
                "default": True,
                "kind": "constriction",
                "cell_shape": "biconcave",
                "cell_radius_um": 7.5,
                "group": f"G{name}",
                "stiffness_set": name,
                "ks_uN_per_m": k,
                "kb_pN_um": 0.1,
                "kal_uN_per_m": 2 * k,
                "velocity_mm_s": 1.0,
                "runs": 4,
                "deformation_index": index[name],
                "deformation_index_std": 0.01,
            }
            for name, k in SETS.items()
        ]
    )
    about = {"config_hash": "x", "seed": 1, "settings": {}}
    write_table(
        "calibration", filled("calibration", calibration), folder / "calibration.parquet", about
    )
    write_table("flows", filled("flows", make_flows()), folder / "flows.parquet", about)
    write_table("runs", [], folder / "runs.parquet", about)
    model = surrogate.fit(read_table("outcomes", folder / "outcomes.parquet"), 1)
    model.save(folder / "surrogate.json", folder / "surrogate_card.json")
    return folder
