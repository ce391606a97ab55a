"""A crash becomes a row with its reason, so that the campaign goes on."""

import errno
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from dldsim.app import assay_jobs, job_log, jobs
from dldsim.config import campaign, identifiers
from dldsim.config.assays import settings_of_point
from dldsim.config.presets import read_config
from dldsim.errors import DldsimError
from dldsim.experiments import assays
from dldsim.experiments.array_run import MIGRATION, RunResult, known_of, migration_of
from dldsim.experiments.outcome_files import OutcomeFiles, Partial
from dldsim.tables.parquet import read_rows, write_table
from dldsim.tables.registry import COLUMNS

GEOMETRY = "r05.0_g20.0_n04"
CONFIG = read_config(
    Path(__file__).parents[2] / "config.yaml",
    {"preset": "tiny", "run_control": {"release_gap_fractions": [0.5, 0.2, 0.8]}},
)
SETTINGS = CONFIG.model_dump(mode="json")
OUTCOME = f"{GEOMETRY}_s1"
OF_SET = SETTINGS | {"stiffness": SETTINGS["stiffness_sets"]["1"]}


def outcome_files(folder):
    return OutcomeFiles(*(folder / f"{kind}.parquet" for kind in OutcomeFiles._fields))


@pytest.fixture
def files(tmp_path):
    return {"flow": tmp_path / "f.npz", "row": tmp_path / "f.parquet", "crashes": tmp_path / "c"}


def crash(error):
    def simulate(*arguments, **options):
        raise error

    return simulate


def test_crashed_flow_becomes_a_row_and_so_do_its_outcomes(files, monkeypatch, tmp_path):
    monkeypatch.setattr("dldsim.solver.flow.solve_empty_array", crash(MemoryError("no room")))
    said = []
    jobs.flow_job(GEOMETRY, SETTINGS, **files, progress=said.append)
    [row] = read_rows("flows", files["row"])
    assert (row["status"], row["stop_reason"]) == ("failed", "MemoryError: no room")
    assert row["nodes"] is None and files["flow"].exists()
    assert "Traceback" in said[-1] and campaign.count_crashes(files["crashes"], GEOMETRY) == 1

    tables = outcome_files(tmp_path)
    jobs.outcome_job(
        OUTCOME,
        OF_SET,
        flow=files["flow"],
        flow_row=files["row"],
        files=tables,
        partial=tmp_path / "p",
        crashes=files["crashes"],
        progress=said.append,
    )
    [row] = read_rows("outcomes", tables.outcome)
    assert row["status"] == "failed" and "no room" in row["stop_reason"]
    assert (row["outcome_id"], row["migration_angle_deg"], row["mode"]) == (OUTCOME, None, "none")
    assert (row["releases"], row["rows_total"]) == (0, 0)
    assert read_rows("runs", tables.runs) == read_rows("trajectory", tables.trajectory) == []
    assert campaign.count_crashes(files["crashes"], OUTCOME) == 1


def finished_flow(files, monkeypatch):
    """A flow job that has succeeded, without a solver."""
    row = dict.fromkeys((c.name for c in COLUMNS["flows"]), 1.0) | {
        "drive": "axial",
        "status": "steady",
        "stop_reason": "steady",
    }
    write_table("flows", [row], files["row"], {})
    monkeypatch.setattr("dldsim.solver.flow.EmptyFlow.load", lambda path: "the flow")


def release(place, rows=4, lane=True):
    """RunResult of a made-up run: bumping row after row, or wandering."""
    outcome, name = OUTCOME, identifiers.run_id(OUTCOME, place)
    config = resolve_sections()
    row = {
        **dict.fromkeys(c.name for c in COLUMNS["runs"] if c.nullable),
        **known_of(outcome, *config),
        "run_id": name,
        "release_gap_fraction": place,
        "status": "converged" if lane else "undecided",
        "stop_reason": "why",
        "mode": "bump" if lane else "none",
        "rows_completed": rows,
        "orbit_rows": int(lane),
        "lateral_steps_um": [7.5] * rows,
        **dict.fromkeys(("probe_offsets", "probe_steps"), []),
        "left_out": "",
        "steps": 100,
        "wall_time_s": 2.0,
        "lag_number": 0.1,
        "spacing_um": 1.25,
        "capillary_number": 0.3,
    }
    if lane:
        row |= {
            "migration_angle_deg": 14.0,
            "angle_low_deg": 13.9,
            "angle_high_deg": 14.1,
            "first_period_angle_deg": 12.0 + place,
            "settled_row": 2,
            "transition_distance": 0.5,
        }
    track = {c.name: np.full(3, place) for c in COLUMNS["trajectory"]}
    return RunResult(row, track | {"run_id": np.full(3, name), "step": np.arange(3)})


def resolve_sections():
    geometry = identifiers.parse_geometry(GEOMETRY)
    return (geometry, CONFIG.stiffness_sets["1"], "1", CONFIG.cell, CONFIG.flow, CONFIG.numerics)


def do(files, tmp_path, settings=OF_SET):
    tables = outcome_files(tmp_path)
    jobs.outcome_job(
        OUTCOME,
        settings,
        flow=files["flow"],
        flow_row=files["row"],
        files=tables,
        partial=tmp_path / "p",
        crashes=files["crashes"],
        progress=print,
    )
    return tables


def test_an_interrupted_outcome_loses_only_the_release_under_way(files, monkeypatch, tmp_path):
    finished_flow(files, monkeypatch)
    asked = []

    def simulate(*sections, stop=None, **options):
        place = sections[2].release_gap_fraction
        asked.append(place)
        if place == stop:
            raise KeyboardInterrupt
        return release(place)

    monkeypatch.setattr(
        "dldsim.experiments.array_outcome.simulate_run", partial(simulate, stop=0.2)
    )
    with pytest.raises(KeyboardInterrupt):
        do(files, tmp_path)
    assert asked == [0.5, 0.2] and not outcome_files(tmp_path).outcome.exists()

    monkeypatch.setattr("dldsim.experiments.array_outcome.simulate_run", simulate)
    other = OF_SET | {"flow": OF_SET["flow"] | {"mean_velocity_mm_s": 2.0}}
    assert Partial(tmp_path / "p", OUTCOME, other).finished([0.5]) == {}
    asked.clear()
    tables = do(files, tmp_path)
    assert asked == [0.2]  # two that agree, far from the transition, are enough
    rows = read_rows("runs", tables.runs)
    assert [row["release_gap_fraction"] for row in rows] == [0.5, 0.2]
    assert [row["run_id"] for row in rows] == [f"{OUTCOME}_y0.50", f"{OUTCOME}_y0.20"]
    assert rows[0] == release(0.5).row
    track = read_rows("trajectory", tables.trajectory)
    assert [r["run_id"] for r in track] == [rows[0]["run_id"]] * 3 + [rows[1]["run_id"]] * 3
    [row] = read_rows("outcomes", tables.outcome)
    assert (row["status"], row["mode"], row["releases"]) == ("decided", "bump", 2)
    assert (row["rows_total"], row["steps"], row["wall_time_s"]) == (8, 200, 4.0)
    assert row["source_angle_deg"] == 12.5  # of the release at mid-gap
    assert row["sigma_num_basis"] == "not joined yet"
    assert not (tmp_path / "p").exists()


def test_an_outcome_without_rows_left_is_undecided_within_bounds(files, monkeypatch, tmp_path):
    finished_flow(files, monkeypatch)
    limits = []

    def simulate(*sections, **options):
        limits.append(sections[5].max_rows)
        return release(sections[2].release_gap_fraction, sections[5].max_rows, lane=False)

    monkeypatch.setattr("dldsim.experiments.array_outcome.simulate_run", simulate)
    control = OF_SET["run_control"] | {"max_rows": 8, "outcome_rows_max": 14}
    tables = do(files, tmp_path, OF_SET | {"run_control": control})
    assert limits == [8, 6]  # the third place has no rows left
    [row] = read_rows("outcomes", tables.outcome)
    assert (row["status"], row["rows_total"], row["releases"]) == ("undecided", 14, 2)
    assert "14 of outcome_rows_max = 14 rows spent before a release at 0.8" in row["stop_reason"]


def test_a_crash_keeps_the_finished_releases(files, monkeypatch, tmp_path):
    finished_flow(files, monkeypatch)

    def simulate(*sections, **options):
        place = sections[2].release_gap_fraction
        if place != 0.5:
            raise DldsimError("does not fit")
        return release(place)

    monkeypatch.setattr("dldsim.experiments.array_outcome.simulate_run", simulate)
    tables = do(files, tmp_path)
    [row] = read_rows("outcomes", tables.outcome)
    assert (row["status"], row["stop_reason"]) == ("failed", "does not fit")
    assert (row["releases"], row["rows_total"], row["migration_angle_deg"]) == (1, 4, None)
    assert [r["release_gap_fraction"] for r in read_rows("runs", tables.runs)] == [0.5]
    settings = OF_SET
    assert [*Partial(tmp_path / "p", OUTCOME, settings).finished([0.5, 0.2])] == [0.5]


def test_a_row_of_runs_gives_its_migration_back():
    made = release(0.2)
    again = migration_of(made.row)
    assert {name: getattr(again, name) for name in MIGRATION} == {
        name: made.row[name] for name in MIGRATION
    }
    assert (again.status, again.reason) == ("converged", "why")
    assert again.lateral_steps.tolist() == [7.5] * 4


POINT = "fixed-velocity_biconcave-7.5_G1"


def point_settings():
    slit = CONFIG.constriction.model_copy(update={"release_positions_um": [0.0, 3.0]})
    config = CONFIG.model_copy(update={"constriction": slit})
    return settings_of_point(identifiers.parse_point(POINT), config)


def test_a_crashed_passage_becomes_a_row_and_the_others_count(tmp_path, monkeypatch):
    def simulate(name, assay, membrane, cell, flow, numerics, passage, *, run_id, progress):
        if passage.release_position_um:
            raise DldsimError("too fast")
        known = assays.known_of(name, assay, membrane, cell, 1.5, passage, run_id)
        blank = {c.name: None for c in COLUMNS["assay_runs"] if c.nullable}
        row = {**blank, **known, "status": "converged", "stop_reason": "", "deformation_index": 0.6}
        return assay_jobs.Measured(row, {c.name: [] for c in COLUMNS["assay_trajectory"]})

    monkeypatch.setattr("dldsim.experiments.assays.simulate_passage", simulate)
    out = {"rows": tmp_path / "r.parquet", "trajectory": tmp_path / "t.parquet"}
    said = []
    assay_jobs.assay_job(POINT, point_settings(), **out, crashes=tmp_path, progress=said.append)
    first, second = read_rows("assay_runs", out["rows"])
    assert (first["status"], first["deformation_index"]) == ("converged", 0.6)
    assert (second["status"], second["stop_reason"]) == ("failed", "too fast")
    assert (second["group"], second["stiffness_set"], second["velocity_mm_s"]) == ("G1", "", 2.0)
    assert (second["run_id"], second["varied"]) == (f"{POINT}_1", "release")
    assert said == ["too fast"] and campaign.count_crashes(tmp_path, POINT) == 1


@pytest.mark.parametrize(
    "error", [TypeError("a bug"), ZeroDivisionError("by zero"), OSError(5, "Input/output error")]
)
def test_a_bug_stops(error, files, monkeypatch, tmp_path):
    """It is no row that the analyses go on without; likewise in the other jobs."""
    monkeypatch.setattr("dldsim.solver.flow.solve_empty_array", crash(error))
    monkeypatch.setattr("dldsim.experiments.assays.simulate_passage", crash(error))
    monkeypatch.setattr("dldsim.experiments.array_outcome.simulate_run", crash(error))
    with pytest.raises(type(error)):
        jobs.flow_job(GEOMETRY, SETTINGS, **files, progress=print)
    with pytest.raises(type(error)):
        assay_jobs.assay_job(
            POINT,
            point_settings(),
            rows=files["row"],
            progress=print,
            trajectory=tmp_path / "t.parquet",
            crashes=files["crashes"],
        )
    assert not files["row"].exists() and not files["crashes"].exists()
    finished_flow(files, monkeypatch)
    with pytest.raises(type(error)):
        do(files, tmp_path)
    assert not outcome_files(tmp_path).outcome.exists() and not files["crashes"].exists()


def test_interruption_is_no_crash(files, monkeypatch):
    monkeypatch.setattr("dldsim.solver.flow.solve_empty_array", crash(KeyboardInterrupt()))
    with pytest.raises(KeyboardInterrupt):
        jobs.flow_job(GEOMETRY, SETTINGS, **files, progress=print)
    assert not files["row"].exists() and not files["crashes"].exists()


def test_log_takes_everything_and_bad_input_has_no_traceback(tmp_path, capsys):
    log = tmp_path / "logs" / "a.log"
    with pytest.raises(SystemExit) as stop, job_log.job_log(log) as progress:
        progress("step 1 of 2")
        raise DldsimError("gap too small")
    assert stop.value.code == 1
    text = log.read_text(encoding="utf-8")
    assert "step 1 of 2" in text and "gap too small" in text and "Traceback" not in text
    assert "gap too small" in capsys.readouterr().err
    with pytest.raises(ValueError), job_log.job_log(log):
        raise ValueError("odd")
    assert "Traceback" in log.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("error", "code", "part"),
    [
        (OSError(errno.ENOSPC, "No space left on device", "results/a.parquet"), 1, "Make room"),
        (OSError(errno.EROFS, "Read-only file system", "results/a.parquet"), 1, "--directory"),
        (KeyboardInterrupt(), 130, ""),
    ],
)
def test_a_full_disk_and_ctrl_c_have_no_traceback(error, code, part, tmp_path, capsys):
    log = tmp_path / "a.log"
    with pytest.raises(SystemExit) as stop, job_log.job_log(log):
        raise error
    said = capsys.readouterr().err
    assert stop.value.code == code and part in said and said.count("\n") == bool(part)
    assert stop.value.__suppress_context__ and "Traceback" not in log.read_text(encoding="utf-8")


def test_a_log_on_a_full_disk_is_told_in_one_line(capsys):
    with pytest.raises(SystemExit), job_log.job_log(Path("/dev/full")) as progress:
        progress("step 1 of 2")
    assert capsys.readouterr().err.startswith("No space left on device")


def test_a_flow_that_cannot_be_written_leaves_no_part(files, monkeypatch, tmp_path):
    """Neither a row of status failed: the disk is to blame, not the array."""
    from dldsim.solver.flow import EmptyFlow

    class Flow:
        geometry = flow = numerics = CONFIG.cell
        spacing_um = pitch = nodes = steps = wall_time_s = 1
        mobility = body_force = mean_velocity = populations = np.zeros(3)

        def summary(self):
            row = dict.fromkeys((c.name for c in COLUMNS["flows"]), 1.0)
            return row | {"drive": "axial", "status": "steady"}

        save = EmptyFlow.save

    def full(*arguments, **options):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("dldsim.solver.flow.solve_empty_array", lambda *sections: Flow())
    monkeypatch.setattr("dldsim.experiments.streamlines.critical_follower", lambda flow: None)
    monkeypatch.setattr(np, "savez", full)
    with pytest.raises(OSError):
        jobs.flow_job(GEOMETRY, SETTINGS, **files, progress=print)
    assert not [*tmp_path.glob("**/*.part")] and not files["crashes"].exists()
