"""Jobs of the survey with a made-up simulation."""

from pathlib import Path

import pytest

from dldsim.app import survey_jobs
from dldsim.config import campaign
from dldsim.config.presets import read_config
from dldsim.errors import DldsimError
from dldsim.experiments.outcome_files import OutcomeFiles
from dldsim.solver import flow as flow_module
from dldsim.tables.parquet import read_rows
from dldsim.tables.registry import COLUMNS
from tests.app.test_jobs import release

CONFIG = read_config(Path(__file__).parents[2] / "config.yaml", {"preset": "tiny"})
SETTINGS = CONFIG.model_dump(mode="json")
KINDS = ("outcomes", "runs", "flows", "survey_plan")


@pytest.fixture
def planned(tmp_path):
    path = tmp_path / "plans" / "0.parquet"
    survey_jobs.plan_job(0, SETTINGS, outcomes=[], table=path)
    return path


class Solver:
    """Stands for the flow and for the runs; counts what it was asked for."""

    def __init__(self, monkeypatch, fails=None):
        self.flows, self.scenes, self.fails = 0, [], fails
        monkeypatch.setattr(flow_module, "solve_empty_array", self.solve)
        monkeypatch.setattr("dldsim.experiments.array_outcome.solve_empty_array", self.solve)
        monkeypatch.setattr("dldsim.experiments.array_outcome.simulate_run", self.run)
        monkeypatch.setattr("dldsim.experiments.streamlines.critical_follower", lambda flow: None)

    def solve(self, *sections):
        self.flows += 1
        if self.fails:
            raise DldsimError(self.fails)
        return self

    def summary(self):
        row = dict.fromkeys((c.name for c in COLUMNS["flows"]), 1.0)
        return row | {"drive": "axial", "status": "steady"}

    def run(self, geometry, stiffness, cell, flow, *sections, **options):
        self.scenes.append((geometry, stiffness, cell, flow))
        return release(cell.release_gap_fraction, rows=6)


def do(number, planned, folder):
    point = survey_jobs.point_of(number, planned)
    points = folder / "points"
    files = OutcomeFiles(*(points / f"{number}.{kind}.parquet" for kind in OutcomeFiles._fields))
    survey_jobs.point_job(
        point,
        SETTINGS,
        files=files,
        flow=points / f"{number}.flow.parquet",
        releases=folder / "releases",
        crashes=folder / "crashes",
        progress=print,
    )
    return point, files, points / f"{number}.flow.parquet"


def test_a_point_is_simulated_as_planned_and_not_twice(planned, tmp_path, monkeypatch):
    solver = Solver(monkeypatch)
    point, files, flow = do(1, planned, tmp_path)
    geometry, stiffness, cell, stream = solver.scenes[0]
    assert geometry.gap_um == point["gap_um"] and cell.shape == point["cell_shape"]
    assert stream.height_um == point["height_um"] and stream.viscosity_mPa_s == 1.5
    assert stream.mean_velocity_mm_s == point["mean_velocity_mm_s"]
    assert all(value == point[name] for name, value in stiffness.model_dump().items())
    [row] = read_rows("outcomes", files.outcome)
    assert (row["outcome_id"], row["stiffness_set"]) == (point["outcome_id"], "disc-0001")
    assert row["status"] == "decided" and len(read_rows("flows", flow)) == 1
    asked = len(solver.scenes)
    for path in (*files, flow):
        path.unlink()
    do(1, planned, tmp_path)
    assert (solver.flows, len(solver.scenes)) == (1, asked)
    assert read_rows("outcomes", files.outcome) == [row] and len(read_rows("flows", flow)) == 1
    sentence = survey_jobs.sentence(point)
    assert sentence.startswith("point 0001, round 0: biconcave of R = 7.5 µm, Ca = 0.")


def test_a_point_that_fails_becomes_a_row(planned, tmp_path, monkeypatch):
    Solver(monkeypatch, fails="no flow here")
    _, files, flow = do(0, planned, tmp_path)
    [row] = read_rows("outcomes", files.outcome)
    assert (row["status"], row["stop_reason"]) == ("failed", "no flow here")
    assert read_rows("runs", files.runs) == read_rows("flows", flow) == []
    assert campaign.count_crashes(tmp_path / "crashes", "0000") == 1


def test_the_survey_is_gathered_with_its_uncertainty(planned, tmp_path, monkeypatch):
    Solver(monkeypatch)
    made = [do(number, planned, tmp_path) for number in (0, 1)]
    parts = {
        "outcomes": [files.outcome for _, files, _ in made],
        "runs": [files.runs for _, files, _ in made],
        "flows": [flow for *_, flow in made],
        "survey_plan": [planned],
    }
    tables = {kind: tmp_path / f"{kind}.parquet" for kind in KINDS}
    survey_jobs.gather(parts, SETTINGS, tables=tables)
    outcomes = read_rows("outcomes", tables["outcomes"])
    assert [row["outcome_id"] for row in outcomes] == [point["outcome_id"] for point, *_ in made]
    assert all(row["sigma_num_basis"] != "not joined yet" for row in outcomes)
    assert all(path.with_suffix(".csv").exists() for path in tables.values())
    assert len(read_rows("survey_plan", tables["survey_plan"])) == 2
    with pytest.raises(DldsimError, match="survey.shapes"):
        survey_jobs.gather(dict.fromkeys(KINDS, []), SETTINGS, tables=tables)


def test_the_next_round_is_planned_from_the_outcomes(planned, tmp_path, monkeypatch):
    Solver(monkeypatch)
    outcomes = [do(number, planned, tmp_path)[1].outcome for number in (0, 1)]
    path = tmp_path / "plans" / "1.parquet"
    survey_jobs.plan_job(1, SETTINGS, outcomes=outcomes, table=path)
    [row] = read_rows("survey_plan", path)
    assert (row["number"], row["round"], row["cell_shape"]) == (2, 1, "biconcave")
