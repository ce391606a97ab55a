"""Outcomes: several runs of one cell through one array."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import dldsim
from dldsim.analysis.uncertainty import SIGMA
from dldsim.config.sections import Cell, Flow, Geometry, RunControl
from dldsim.errors import NoRoom
from dldsim.experiments.array_outcome import simulate_outcome
from dldsim.experiments.array_run import RunResult, simulate_run
from dldsim.tables.parquet import write_table
from dldsim.tables.registry import COLUMNS
from tests.experiments.small_array import CELL, FLOW, GEOMETRY, NUMERICS, SET_1


def test_an_outcome_is_its_runs_summed_up(empty, tmp_path):
    """Two rows are too few for anything to be decided, so all places are tried."""
    control = RunControl(max_rows=2, release_gap_fractions=[0.5, 0.35])
    kept = []
    made = simulate_outcome(
        GEOMETRY,
        SET_1,
        CELL,
        FLOW,
        NUMERICS,
        control,
        outcome_id="r",
        stiffness_set="1",
        empty_flow=empty,
        keep=lambda place, run: kept.append(place),
    )
    assert kept == [*made.runs] == [0.5, 0.35]
    assert set(made.row) == {c.name for c in COLUMNS["outcomes"]} - {
        "deformation_index",
        "deformation_index_std",
        *SIGMA,
    }
    rows = made.rows()
    assert [row["run_id"] for row in rows] == ["r_y0.50", "r_y0.35"]
    assert made.row["status"] == "undecided" and made.row["mode"] == "none"
    assert made.row["rows_total"] == sum(row["rows_completed"] for row in rows) == 4
    assert made.row["steps"] == sum(row["steps"] for row in rows)
    write_table("trajectory", made.trajectory(), tmp_path / "t.parquet", {})
    starts = [run.trajectory["y_um"][0] for run in made.runs.values()]
    assert starts[0] - starts[1] == pytest.approx(0.15 * GEOMETRY.gap_um)
    first = simulate_run(
        GEOMETRY,
        SET_1,
        CELL,
        FLOW,
        NUMERICS,
        control,
        run_id="r_y0.50",
        outcome_id="r",
        stiffness_set="1",
        empty_flow=empty,
    )
    np.testing.assert_equal(first.trajectory, made.runs[0.5].trajectory)


def test_places_where_the_cell_does_not_fit_are_left_out():
    # The rim of an upright cell midway between rows is near the next row's displaced pillar.
    def outcome(*places):
        control = RunControl(max_rows=2, release_gap_fractions=list(places))
        return simulate_outcome(
            GEOMETRY,
            SET_1,
            Cell(radius_um=7.5),
            Flow(),
            NUMERICS,
            control,
            outcome_id="r",
            stiffness_set="1",
        )

    made = outcome(0.8, 0.5)
    assert [*made.runs] == [0.5] and made.row["releases"] == 1
    assert made.row["stop_reason"].endswith("does not fit at 0.8")
    with pytest.raises(NoRoom, match="does not fit at its release"):
        outcome(0.8, 0.85)


def test_two_motions_stay_two_when_rows_are_spent():
    """Means of the bounds of different motions would pass for the bounds of one."""
    package = Path(dldsim.__file__).parent / "data/campaign"
    outcomes = pd.read_parquet(package / "outcomes.parquet").set_index("outcome_id")
    about = outcomes.loc["r09.0_g20.0_n10_s5"]
    runs = pd.read_parquet(package / "runs.parquet")
    finished = {
        row["release_gap_fraction"]: RunResult(row, {})
        for row in runs[runs["outcome_id"] == about.name].to_dict("records")
    }
    del finished[0.8]
    made = simulate_outcome(
        Geometry(**about[["pillar_radius_um", "gap_um", "periodicity"]].to_dict()),
        SET_1,
        CELL,
        FLOW,
        NUMERICS,
        RunControl(max_rows=40, outcome_rows_max=55, release_gap_fractions=[0.5, 0.2, 0.8]),
        outcome_id=about.name,
        stiffness_set="5",
        finished=finished,
    )
    assert about["status"] == made.row["status"] == "coexisting" and made.row["coexisting"]
    assert "55 rows spent" in made.row["stop_reason"]
