"""Runs of one cell through one array: laws, statuses, rows of the tables."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from dldsim.config import limits
from dldsim.config.sections import Cell, Flow, Geometry, Numerics, RunControl, Stiffness
from dldsim.errors import DldsimError
from dldsim.experiments import array_run
from dldsim.experiments.array_run import Path, simulate_run
from dldsim.experiments.array_scene import make_scene
from dldsim.experiments.migration import Migration, row_crossings
from dldsim.solver.flow import array_of, solve_empty_array
from dldsim.solver.time_step import refined
from dldsim.tables.numerics import settings_of
from dldsim.tables.parquet import read_rows, write_table
from dldsim.tables.registry import COLUMNS
from tests.experiments.small_array import CELL, FLOW, GEOMETRY, NUMERICS, SET_1

THREE_ROWS = RunControl(max_rows=3)


def run(empty, control=THREE_ROWS, stiffness=SET_1, numerics=NUMERICS, **options):
    """A run of a small cell at the default resolution, tenths of a second."""
    return simulate_run(
        GEOMETRY,
        stiffness,
        CELL,
        FLOW,
        numerics,
        control,
        run_id="r",
        stiffness_set="1",
        empty_flow=empty,
        **options,
    )


@pytest.fixture(scope="module")
def result(empty):
    return run(empty)


def test_a_run_that_takes_too_long_is_refused_before_it_starts(empty, monkeypatch):
    stiff = SET_1.model_copy(update={"ks_uN_per_m": 1e6, "kb_pN_um": 1e5})
    long = THREE_ROWS.model_copy(update={"max_rows": 1000})
    monkeypatch.setattr(array_run.CellInFlow, "advance", None)
    with pytest.raises(DldsimError, match="time step shortened by .* too stiff") as caught:
        run(empty, long, stiff)
    assert caught.value.key == "limits.run_hours" and "hours" in str(caught.value)
    monkeypatch.setenv(limits.VARIABLE, limits.Limits(run_hours=1e-9).model_dump_json())
    with pytest.raises(DldsimError, match=r"run_hours is 1e-09"):
        run(empty)


def columns(result):
    """Columns with numbers, those of the row and those of the trajectory."""
    row = {k: v for k, v in result.row.items() if isinstance(v, float | int | list)}
    return {**row, **{k: v for k, v in result.trajectory.items() if k != "run_id"}}


def test_row_and_trajectory_fill_their_tables(result, tmp_path):
    names = [c.name for c in COLUMNS["runs"]]
    assert set(result.row) == set(names)
    assert set(result.trajectory) == {c.name for c in COLUMNS["trajectory"]}
    # The writer checks types and refuses NaN.
    write_table("runs", [result.row], tmp_path / "run.parquet", {})
    write_table("trajectory", result.trajectory, tmp_path / "trajectory.parquet", {})
    (row,) = read_rows("runs", tmp_path / "run.parquet")
    assert row["rows_completed"] == 3 and len(row["lateral_steps_um"]) == 3
    assert (row["status"], row["migration_angle_deg"]) == ("undecided", None)
    assert Numerics(**settings_of(row)) == NUMERICS  # as asked for
    assert row["velocity_lu"] == pytest.approx(
        NUMERICS.velocity_lu / row["time_step_refinement"], rel=1e-3
    )
    assert (row["begun_anew"], row["incurable"]) == (False, [])
    assert row["lag_number"] <= NUMERICS.reynolds_max * (1 + 1e-9)
    assert row["pitch_nodes"] * row["spacing_um"] == pytest.approx(row["pitch_um"])
    assert row["bump_angle_deg"] == pytest.approx(math.degrees(math.atan(0.25)))


def test_row_agrees_with_its_trajectory(result):
    t, row = result.trajectory, result.row
    # Released midway between rows; x = y = 0 is a pillar's centre.
    pitch = row["pitch_um"]
    assert t["x_um"][0] == pytest.approx(-pitch / 2)
    assert t["y_um"][0] == pytest.approx(pitch / 2 - pitch / 8)  # gaps there differ by λ/4
    crossings = row_crossings(t["x_um"], t["y_um"], -pitch / 2, pitch)
    np.testing.assert_allclose(np.diff(crossings), row["lateral_steps_um"], atol=1e-9)
    assert row["min_clearance_um"] == pytest.approx(t["clearance_um"].min())
    assert row["volume_drift_max"] == pytest.approx(np.abs(t["volume_ratio"] - 1).max())
    assert row["area_drift_max"] == pytest.approx(np.abs(t["area_ratio"] - 1).max())
    assert row["mean_deformation_index"] == pytest.approx(t["deformation_index"].mean())
    a, b = t["axis_a_um"], t["axis_b_um"]
    np.testing.assert_allclose(t["deformation_index"], (a - b) / (a + b))
    assert (a >= b).all() and a[0] == pytest.approx(2 * CELL.radius_um, rel=0.05)
    np.testing.assert_allclose(t["t_ms"], t["step"] * row["time_step_us"] / 1e3)


def test_recorded_velocity_is_that_of_the_path(result):
    # Mean over vertices against centroid of the volume, trapezium rule between twenty samples a
    # row: a few percent. The first sample is before the first step, with the cell still at rest.
    t = {k: v[1:] for k, v in result.trajectory.items()}
    moved = t["x_um"][-1] - t["x_um"][0]
    assert np.trapezoid(t["vx_mm_s"], t["t_ms"]) == pytest.approx(moved, rel=0.04)
    # In the array the cell outruns the mean over fluid and pillars, but not threefold.
    mean = moved / (t["t_ms"][-1] - t["t_ms"][0])
    assert 1 < mean / FLOW.mean_velocity_mm_s < 3


def test_energies_rise_from_rest(result):
    t = result.trajectory
    for term in ("stretching", "bending", "local_area", "global_area", "volume"):
        energy = t[f"energy_{term}_aJ"]
        assert abs(energy[0]) < 1e-9 * energy.max()
        assert (energy > -1e-9 * energy.max()).all()


def test_velocity_and_moduli_scaled_alike_give_the_same_trajectory(empty):
    """Of velocity and stiffness only Ca acts, where the contact, which does not scale along, is out
    of reach; the dashpots are viscosities and stay."""
    factor, numerics = 3.0, NUMERICS.model_copy(update={"contact_range_um": 0.0})
    flow = FLOW.model_copy(update={"mean_velocity_mm_s": factor * FLOW.mean_velocity_mm_s})
    moduli = {name: factor * value for name, value in SET_1.model_dump().items()}
    stiffer = Stiffness(**moduli | {"kvisc_nN_s_per_m": SET_1.kvisc_nN_s_per_m})
    faster = solve_empty_array(GEOMETRY, flow, numerics)

    def path(stiffness, flow, empty_flow):
        return simulate_run(
            GEOMETRY,
            stiffness,
            CELL,
            flow,
            numerics,
            RunControl(max_rows=2),
            run_id="r",
            stiffness_set="1",
            empty_flow=empty_flow,
        ).trajectory

    one, alike, softer = (
        path(*scene)
        for scene in ((SET_1, FLOW, empty), (stiffer, flow, faster), (SET_1, flow, faster))
    )
    for name in ("step", "x_um", "y_um", "z_um", "deformation_index", "area_ratio"):
        np.testing.assert_allclose(alike[name], one[name], rtol=0, atol=1e-4, err_msg=name)
    np.testing.assert_allclose(factor * alike["t_ms"], one["t_ms"])
    np.testing.assert_allclose(alike["vx_mm_s"], factor * one["vx_mm_s"], atol=1e-3)
    assert np.abs(softer["deformation_index"][:10] - one["deformation_index"][:10]).max() > 0.05


def test_a_run_repeats_bit_for_bit(empty, result):
    again = run(empty)
    timed = {"wall_time_s", "processor_time_s", "start_up_s", "ms_per_step", "mlups"}
    expected = columns(result)
    for name, values in columns(again).items():
        if name not in timed:
            assert np.array_equal(values, expected[name]), name


@pytest.mark.parametrize(("fewest", "rows"), [(1, 1), (2, 2), (5, 3)])
def test_a_settled_run_goes_on_to_its_fewest_rows(empty, monkeypatch, fewest, rows):
    """But to no more than the most."""
    settled = Migration(
        "converged",
        "told so",
        mode="none",
        **dict.fromkeys(
            (
                "migration_angle_deg",
                "angle_low_deg",
                "angle_high_deg",
                "first_period_angle_deg",
                "settled_row",
                "row_map_peak",
                "transition_distance",
                "capture_chance",
            )
        ),
        orbit_rows=1,
        lateral_steps=np.zeros(1),
    )
    monkeypatch.setattr("dldsim.experiments.array_run.analyse_path", lambda *_: settled)
    control = THREE_ROWS.model_copy(update={"min_rows": fewest})
    assert run(empty, control).row["rows_completed"] == rows


def test_a_given_empty_flow_is_the_one_a_run_solves(result):
    alone = run(None)
    assert np.array_equal(alone.trajectory["x_um"], result.trajectory["x_um"])


def test_progress_is_a_sentence_and_at_most_one_a_second(empty):
    said = []
    run(empty, progress=said.append)
    assert len(said) <= 3


# ------------------------------------------------------------------ laws


def test_recording_does_not_change_the_motion(empty):
    scenes = []
    for chunk in (40, 2):
        slow = empty.slower(4)
        scene = make_scene(array_of(empty), slow, SET_1, CELL, FLOW, refined(NUMERICS, 4))
        for _ in range(400 // chunk):
            scene.advance(chunk)
        scenes.append(scene)
    assert np.isfinite(scenes[0].body.x).all()
    assert np.array_equal(scenes[0].body.x, scenes[1].body.x)


@pytest.fixture(scope="module")
def default_run():
    """The default numerics, flow and cell over a few rows: the one test at full size."""
    geometry = Geometry(pillar_radius_um=10, gap_um=20, periodicity=6)
    return simulate_run(
        geometry,
        SET_1,
        Cell(),
        Flow(),
        NUMERICS,
        RunControl(max_rows=4),
        run_id="default",
        stiffness_set="1",
    )


def test_area_and_volume_hold_over_a_default_run(default_run):
    assert default_run.row["status"] == "undecided"
    assert default_run.row["volume_drift_max"] < 0.02
    assert default_run.row["area_drift_max"] < 0.02


def test_a_default_run_stays_on_the_mid_plane(default_run):
    # The mesh is its own mirror image, so that only rounding can lift the cell, until the soft
    # membrane folds at the second pillar: snapping folds raise rounding to some nanometres.
    t = default_run.trajectory
    before = t["x_um"] < 2.5 * 40
    assert np.abs(t["z_um"][before]).max() < 1e-4
    assert np.abs(t["vz_mm_s"][before]).max() < 1e-4
    assert np.abs(t["z_um"]).max() < 0.05


def test_a_default_run_carries_no_lateral_flux(default_run):
    # The cell turns the flow around it; the drive answers within hundreds of steps.
    assert abs(default_run.row["lateral_flux_ratio"]) < 5e-3
    assert default_run.row["mach_max"] < 0.3
    assert default_run.row["reynolds_number"] < 1.5


@pytest.mark.parametrize("coupling", ["no-slip", "dissipative"])
def test_a_run_mirrored_in_height_is_the_mirror_image(coupling):
    # Double precision, three rows of an uneven path; rounding of 1e-16 has no time to grow.
    numerics = Numerics(precision="float64", coupling=coupling, velocity_lu=0.01, half_scene=False)
    empty = solve_empty_array(GEOMETRY, FLOW, numerics)
    array = array_of(empty)
    paths = []
    for side in (1, -1):
        scene = make_scene(array, empty, SET_1, CELL, FLOW, numerics)
        start = scene.sample().centre
        scene.place(start + [0, 0, side * 1.2])
        path = []
        for _ in range(20):
            scene.advance(100)
            path.append(scene.sample().centre - [0, 0, array.height / 2])
        paths.append(path)
    up, down = np.array(paths)
    np.testing.assert_allclose(down * [1, 1, -1], up, rtol=0, atol=1e-8)
    assert up[-1, 0] - up[0, 0] > array.pitch
    assert (up[:, 2] > 0.1).all()


def test_a_cell_passes_columns_that_are_on_the_surface_of_pillars():
    # Eight columns of each pillar at 0.005 nodes from it: seen to blow up in the third row.
    result = simulate_run(
        Geometry(pillar_radius_um=6, gap_um=16, periodicity=4),
        SET_1,
        Cell(),
        Flow(),
        Numerics(time_step="as-given"),
        THREE_ROWS,
        run_id="r",
        stiffness_set="1",
    )
    assert result.row["status"] == "undecided"
    assert result.row["mach_max"] < 0.2


# ------------------------------------------------------------------ statuses and bad input


def test_an_absurd_stiffness_is_an_unstable_run(empty, tmp_path):
    stiff = {n: getattr(SET_1, n) * 1e4 for n in ("ks_uN_per_m", "kal_uN_per_m")}
    numerics = NUMERICS.model_copy(update={"time_step": "as-given"})
    result = run(empty, stiffness=SET_1.model_copy(update=stiff), numerics=numerics)
    row = result.row
    assert row["status"] == "unstable"
    assert f"step {row['steps']}" in row["stop_reason"] and "cures" in row["stop_reason"]
    assert (row["mode"], row["migration_angle_deg"], row["orbit_rows"]) == ("none", None, 0)
    for name, values in columns(result).items():
        assert np.isfinite(values).all(), name
    write_table("runs", [row], tmp_path / "run.parquet", {})
    write_table("trajectory", result.trajectory, tmp_path / "trajectory.parquet", {})


def test_a_stiff_cell_gets_a_shorter_time_step(empty, result):
    stiff = {n: getattr(SET_1, n) * 100 for n in ("ks_uN_per_m", "kal_uN_per_m", "kb_pN_um")}
    said = []
    row = run(
        empty,
        stiffness=SET_1.model_copy(update=stiff),
        progress=said.append,
        control=RunControl(max_rows=2),
    ).row
    assert row["status"] == "undecided" and row["rows_completed"] == 2
    assert row["time_step_refinement"] == row["margin_elastic"] > 2
    assert row["velocity_lu"] == pytest.approx(
        NUMERICS.velocity_lu / row["margin_elastic"], rel=1e-3
    )
    assert row["time_step_us"] < result.row["time_step_us"]
    assert row["volume_drift_max"] < 0.01 and row["area_drift_max"] < 0.01
    assert any("too stiff" in sentence for sentence in said)


def test_a_path_says_when_a_row_is_complete():
    path, centre = Path(pitch=20.0), [0.0, 0.3, 0.0]
    said = [path.add(SimpleNamespace(centre=[x, *centre[1:]])) for x in (0.0, 19, 21, 18, 22, 41)]
    assert said == [False, False, True, False, False, True] and path.rows == 2
    np.testing.assert_allclose(path.crossings(), [0.3, 0.3, 0.3])


def test_a_cell_that_does_not_advance_is_stuck(empty, monkeypatch):
    # With next to no patience every cell is.
    monkeypatch.setattr(array_run, "STUCK_ROWS", 0.01)
    row = run(empty).row
    assert row["status"] == "stuck" and "moved less than 2.2 µm" in row["stop_reason"]
    assert (row["mode"], row["migration_angle_deg"]) == ("none", None)


def test_what_a_scene_leaves_out_is_said(empty):
    soft = SET_1.model_copy(update={"kb_pN_um": 0.0, "kvisc_nN_s_per_m": 0.0})
    row = run(empty, RunControl(max_rows=2), stiffness=soft).row
    assert "3 of 4 rows" in row["left_out"]
    assert "kb_pN_um, kvisc_nN_s_per_m" in row["left_out"]


def simulate(geometry=GEOMETRY, cell=CELL, flow=FLOW, numerics=NUMERICS, **options):
    return simulate_run(
        geometry, SET_1, cell, flow, numerics, THREE_ROWS, run_id="r", stiffness_set="1", **options
    )


def test_a_release_inside_a_pillar_is_refused(empty):
    with pytest.raises(DldsimError, match="does not fit at .*release_gap_fraction"):
        simulate(cell=Cell(radius_um=9.0, axis="z"), empty_flow=empty)
    with pytest.raises(DldsimError, match="height_um"):
        simulate(cell=Cell(radius_um=6.5), empty_flow=empty)  # taller than the channel


def test_the_two_dimensional_limit_is_refused():
    with pytest.raises(DldsimError, match="height_um = 0"):
        simulate(flow=Flow(height_um=0))


def test_an_empty_flow_of_another_lattice_is_refused(empty):
    with pytest.raises(DldsimError, match="rows = 1 .run: 3"):
        simulate(numerics=Numerics(rows=3), empty_flow=empty)


def test_an_empty_flow_of_another_drive_is_refused(empty):
    with pytest.raises(DldsimError, match="flow without a cell"):
        simulate(numerics=Numerics(velocity_lu=0.02), empty_flow=empty)
    with pytest.raises(DldsimError, match="flow without a cell"):
        simulate(flow=Flow(height_um=12.0, drive="axial"), empty_flow=empty)
