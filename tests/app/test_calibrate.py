"""An assay of one's own: what is simulated, what is kept, what is refused before anything runs."""

from pathlib import Path

import pytest

from dldsim.analysis.calibration import stiffness_for
from dldsim.app import assay_jobs
from dldsim.experiments import assays
from dldsim.tables.parquet import read_table
from dldsim.tables.registry import COLUMNS
from tests.app.test_cli import call

ROOT = Path(__file__).parents[2]
MINE = "kind: channel\nvelocity_mm_s: 0.5\nradius_factors: [0.95, 1.05]\n"


@pytest.fixture
def simulated(monkeypatch, tmp_path):
    """The passages that were simulated, by run_id; index 0.5 − k_s/100 at the first size."""
    monkeypatch.chdir(ROOT)
    (tmp_path / "mine.yaml").write_text(MINE)
    done = []

    def simulate(name, assay, membrane, cell, flow, numerics, passage, *, run_id, progress):
        done.append(run_id)
        known = assays.known_of(name, assay, membrane, cell, 1.5, passage, run_id)
        blank = {c.name: None for c in COLUMNS["assay_runs"] if c.nullable}
        index = 0.5 - membrane.stiffness.ks_uN_per_m / 100 + 0.2 * (passage.radius_factor - 1)
        found = {"status": "converged", "stop_reason": "", "deformation_index": index}
        row = {**blank, **known, **found, "circularity_index": index / 4}
        return assay_jobs.Measured(row, {c.name: [] for c in COLUMNS["assay_trajectory"]})

    monkeypatch.setattr(assays, "simulate_passage", simulate)
    return done


def run(capsys, tmp_path, *more):
    files = "--assay", tmp_path / "mine.yaml", "--output", tmp_path / "out"
    return call(capsys, "calibrate", *files, *more)


def test_a_calibration_is_made_and_goes_on_where_it_was(simulated, capsys, tmp_path):
    code, summary, said = run(capsys, tmp_path, "--shape", "sphere", "--radius", 6)
    assert code == 0, said
    assert len(simulated) == 5 * 3 and simulated[0] == "mine_sphere-6_1_0"
    names = {"assay_runs.parquet", "assay_runs.csv", "calibration.parquet", "calibration.csv"}
    assert names | {"calibration.png"} <= {p.name for p in (tmp_path / "out").iterdir()}
    table = read_table("calibration", tmp_path / "out" / "calibration.parquet")
    assert set(table["assay"]) == {"mine", "mine-circularity"}
    assert table["std_size"].notna().all() and table["std_offset"].isna().all()
    found = stiffness_for(0.4, table, shape="sphere", radius_um=6)
    assert found["ks_uN_per_m"] == pytest.approx(10) and found["assay"] == "mine"
    assert summary["assay"] == "mine" and len(summary["rows"]) == 10
    simulated.clear()
    rows = next((tmp_path / "out" / "passages").glob("*_3.runs.parquet"))
    rows.unlink()
    run(capsys, tmp_path, "--shape", "sphere", "--radius", 6, 7)
    assert len(simulated) == 3 + 15  # the lost point, and those of the other radius


def test_the_cells_of_an_assay_are_those_that_it_measures(simulated, capsys, tmp_path):
    own = "cells: [{shape: sphere, radius_um: 6}]\n"
    (tmp_path / "mine.yaml").write_text(MINE + own)
    code, _, said = run(capsys, tmp_path)
    assert code == 0, said
    assert {name.split("_")[1] for name in simulated} == {"sphere-6"}


def test_a_named_assay_of_the_configuration(simulated, capsys, tmp_path):
    code, summary, _ = call(capsys, "calibrate", "--assay", "gauge", "--output", tmp_path / "out")
    assert code == 0 and {row["cell_shape"] for row in summary["rows"]} == {"biconcave"}


@pytest.mark.parametrize(
    ("text", "argv", "words"),
    [
        (MINE, ["--radius", 12], ["width_um = 20", "does not fit"]),
        (MINE, ["--radius", -1], ["radius_um", "≥ 0.1"]),
        (MINE.replace("0.5", "100"), [], ["the flow tears a membrane"]),
        (MINE.replace("channel", "chanel"), [], ["assays.mine.kind", "Did you mean channel?"]),
        (MINE + "widht_um: 3\n", [], ["assays.mine.widht_um", "Did you mean width_um?"]),
        ("kind: shear\nstress_Pa: 1\n", ["--config", "empty.yaml"], ["stiffness_sets"]),
    ],
)
def test_what_cannot_be_measured_is_refused_before_anything_runs(
    text, argv, words, simulated, capsys, tmp_path
):
    (tmp_path / "mine.yaml").write_text(text)
    (tmp_path / "empty.yaml").write_text("seed: 1\n")
    argv = [tmp_path / a if a == "empty.yaml" else a for a in argv]
    code, _, message = run(capsys, tmp_path, *argv)
    assert code == 2 and all(word in message for word in words), message
    assert not simulated and not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("gouge", ["Did you mean gauge", "source-table"]),
        ("source-table", ["read from the paper", "nothing to simulate"]),
        ("no.yaml", ["no.yaml"]),
    ],
)
def test_an_assay_that_is_none_is_named(name, words, simulated, capsys, tmp_path):
    code, _, message = call(capsys, "calibrate", "--assay", name, "--output", tmp_path / "out")
    assert code == 2 and all(word in message for word in words), message
