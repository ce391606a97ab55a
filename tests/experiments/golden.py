"""Golden runs: short ones that tie trajectories to the physics version, whatever is the default.

`python -m tests.experiments.golden` writes tests/data/golden.json anew. That is right after
PHYSICS_VERSION has been raised, and only then: a change that moves a golden run changes what
everybody's runs give, and packaged data and kept results of the old version must not answer.
"""

import json
from pathlib import Path

from dldsim import PHYSICS_VERSION
from dldsim.config.sections import (
    Cell,
    Constriction,
    Flow,
    Geometry,
    Numerics,
    RunControl,
    Stiffness,
)
from dldsim.experiments.array_run import simulate_run
from dldsim.experiments.constriction import simulate_constriction

FILE = Path(__file__).parents[1] / "data" / "golden.json"
ROWS = 3
SET_3 = Stiffness(
    ks_uN_per_m=15.24,
    kb_pN_um=0.25,
    kal_uN_per_m=30,
    kag_uN_per_m=500,
    kv_Pa=900,
    kvisc_nN_s_per_m=1.5,
)
# Contact reaches far, so that few rows feel it. In double precision processors differ by rounding
# only, which three rows do not amplify.
NUMERICS = Numerics(
    spacing_um=1.5, contact_range_um=1.5, precision="float64", rows=2, lanes=1, images="aligned"
)
DILUTE = NUMERICS.model_copy(update={"rows": 1, "lanes": 2, "images": "dilute"})
FLOW = Flow(height_um=14)
ARRAYS = {
    "bump": Geometry(pillar_radius_um=5, gap_um=11, periodicity=10),
    "mixed": Geometry(pillar_radius_um=5, gap_um=13, periodicity=8),
    "zigzag": Geometry(pillar_radius_um=5, gap_um=19, periodicity=4),
}
CELL = Cell(radius_um=6.0, release_gap_fraction=0.2)
CHANNEL = Constriction(
    spacing_um=1.25,
    width_um=15,
    throat_width_um=7.5,
    throat_length_um=12,
    taper_length_um=4,
    approach_length_um=14,
    height_um=10,
)


def array_path(
    name: str,
    *,
    stiffness: Stiffness = SET_3,
    rows: int = ROWS,
    base: Numerics = NUMERICS,
    **numerics,
) -> list:
    """Lateral steps [µm] and the last place (x, y) [µm] of a run through one of ARRAYS."""
    result = simulate_run(
        ARRAYS[name],
        stiffness,
        CELL,
        FLOW,
        base.model_copy(update=numerics),
        RunControl(max_rows=rows),
        run_id=name,
        stiffness_set="3",
    )
    path = result.trajectory
    return [*result.row["lateral_steps_um"], float(path["x_um"][-1]), float(path["y_um"][-1])]


def passage(name: str = "constriction") -> list:
    """Deformation index and the last place [µm] of a cell that passes a throat."""
    result = simulate_constriction(
        SET_3,
        1.0,
        CHANNEL,
        Cell(radius_um=4.5),
        Flow(),
        NUMERICS,
        release_position_um=0.0,
        run_id=name,
    )
    path = result.trajectory
    return [result.row["deformation_index"], float(path["x_um"][-1]), float(path["y_um"][-1])]


RUNS = {
    **{name: lambda name=name: array_path(name) for name in ARRAYS},
    "one cell in an endless array": lambda: array_path("bump", base=DILUTE),
    "dissipative": lambda: array_path("bump", coupling="dissipative", kernel="4-point"),
    "whole scene": lambda: array_path("bump", half_scene=False),
    "constriction": passage,
}


def read_golden() -> dict:
    return json.loads(FILE.read_text("utf-8"))


if __name__ == "__main__":
    golden = {"physics_version": PHYSICS_VERSION, **{name: run() for name, run in RUNS.items()}}
    FILE.write_text(json.dumps(golden, indent=1) + "\n", "utf-8")
