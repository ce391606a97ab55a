"""Cells that a finer run goes on with: where they are put, what is refused, what is saved."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from dldsim.config.sections import Cell, Flow, Geometry, Numerics, RunControl
from dldsim.errors import DldsimError
from dldsim.experiments import array_outcome, array_run, settled
from dldsim.experiments.array_outcome import simulate_outcome
from dldsim.experiments.array_run import RunResult, migration_of, simulate_run
from dldsim.experiments.array_scene import make_scene
from dldsim.experiments.migration import mode_of
from dldsim.experiments.settled import load, row_origin, save
from dldsim.solver.flow import array_of, solve_empty_array
from dldsim.solver.time_step import refined
from dldsim.vocabulary import GONE_ON, RELEASED
from tests.experiments.small_array import SET_1

BUMPS = Geometry(pillar_radius_um=4, gap_um=5.5, periodicity=6)
ZIGZAGS = Geometry(pillar_radius_um=5, gap_um=12, periodicity=4)
CELL, FLOW = Cell(radius_um=4.0), Flow(height_um=10.0)
CELLS = {BUMPS: CELL, ZIGZAGS: Cell(radius_um=4.0, shape="sphere")}
"""A red cell that swings in the bump lane, a sphere whose orbit has four rows."""
COARSE = Numerics(spacing_um=1.25, reynolds_max=0.3, rows=2, lanes=1, images="aligned")
FINE = COARSE.model_copy(update={"spacing_um": 0.85})
CONTROL = RunControl(max_rows=40, release_gap_fractions=[0.5, 0.35])


def outcome(geometry, numerics, **options):
    return simulate_outcome(
        geometry,
        SET_1,
        CELLS[geometry],
        FLOW,
        numerics,
        CONTROL,
        outcome_id="r",
        stiffness_set="1",
        **options,
    )


@pytest.fixture(scope="module", params=[BUMPS, ZIGZAGS], ids=["bump", "zigzag"])
def coarse(request):
    """Array, and its outcome on the coarse lattice."""
    return request.param, outcome(request.param, COARSE)


def test_on_the_same_lattice_a_settled_motion_goes_on(coarse):
    geometry, before = coarse
    assert before.row["status"] == "decided" and before.start == RELEASED
    cell = before.settled[0.5]
    again = simulate_run(
        geometry,
        SET_1,
        CELLS[geometry],
        FLOW,
        COARSE,
        CONTROL,
        run_id="r",
        stiffness_set="1",
        start=cell,
    )
    row, first = again.row, before.runs[0.5].row
    width = first["angle_high_deg"] - first["angle_low_deg"]
    width += row["angle_high_deg"] - row["angle_low_deg"]
    assert abs(row["migration_angle_deg"] - first["migration_angle_deg"]) <= width / 2
    assert row["mode"] == first["mode"] == ("bump" if geometry is BUMPS else "zigzag")
    if geometry is ZIGZAGS:  # in the lane it depends on the phase in which that is tried
        assert row["rows_completed"] <= first["rows_completed"]
    assert "begun with the settled cell" in row["stop_reason"]
    assert row["first_period_angle_deg"] is None
    assert (row["transition_distance"] > 0) == (row["mode"] == "bump")
    # Its path begins where the other had crossed its last plane.
    last = migration_of(first).positions()[-1] - cell.row * geometry.pitch_um / geometry.periodicity
    apart = (migration_of(row).positions()[0] - last) / geometry.pitch_um
    assert apart == pytest.approx(round(apart), abs=1e-6)
    if geometry is ZIGZAGS:  # the next rows are those of an orbit before
        assert row["orbit_rows"] == first["orbit_rows"] == 4
        steps = first["lateral_steps_um"][-4:]
        np.testing.assert_allclose(row["lateral_steps_um"][:4], steps, atol=0.05)


@pytest.mark.slow
def test_on_a_finer_lattice_it_comes_to_the_same_in_fewer_rows(coarse):
    """But for a cell in the bump lane, which is released from all places."""
    geometry, before = coarse
    cold, warm = outcome(geometry, FINE), outcome(geometry, FINE, starts=before.settled)
    bumps = geometry is BUMPS
    assert (cold.start, warm.start) == (RELEASED, RELEASED if bumps else GONE_ON)
    assert warm.row["spacing_um"] == cold.row["spacing_um"] < 0.8 * before.row["spacing_um"]
    assert warm.row["status"] == cold.row["status"] == "decided"
    assert warm.row["mode"] == cold.row["mode"] == ("bump" if bumps else "zigzag")
    resolution = np.degrees(CONTROL.orbit_tolerance / geometry.periodicity)
    angles = [made.row["migration_angle_deg"] for made in (cold, warm)]
    assert angles[0] == pytest.approx(angles[1], abs=resolution)
    if bumps:
        assert warm.row["rows_total"] == cold.row["rows_total"]
        assert warm.row["releases"] == cold.row["releases"] > 1
    else:
        assert warm.row["rows_total"] < 0.7 * cold.row["rows_total"]
        assert warm.row["releases"] == 1 < cold.row["releases"]
        assert "0.5 went on with" in warm.row["stop_reason"]
        assert "0.5 stands for 0.35" in warm.row["stop_reason"]
    assert [*warm.settled] == [*cold.settled] == [0.5, 0.35]
    assert warm.row["transition_distance"] == pytest.approx(
        cold.runs[0.5].row["transition_distance"], abs=0.1
    )


# ---------------------------------------------------------------------------------- which begins


def made_up(angle, distance, numerics):
    """RunResult of an angle [°] and a distance, with a cell that knows of them."""
    status = "converged" if distance > 0 else "periodic"
    low, high = angle - 0.1, angle + 0.1
    row = {
        **dict.fromkeys(array_run.MIGRATION),
        "status": status,
        "stop_reason": "why",
        "mode": mode_of(angle, 0.25),
        "migration_angle_deg": angle,
        "angle_low_deg": low,
        "angle_high_deg": high,
        "transition_distance": distance,
        "orbit_rows": 4,
        "lateral_steps_um": [0.0] * 4,
        "release_gap_fraction": 0.5,
        "gap_um": 12.0,
        "rows_completed": 4,
        "steps": 100,
        "wall_time_s": 1.0,
        "capillary_number": 0.3,
        "spacing_um": numerics.spacing_um,
        "lag_number": 0.1,
        "left_out": "",
    }
    cell = settled.SettledCell(
        **settled.sections_of(ZIGZAGS, SET_1, CELL, FLOW),
        spacing_um=numerics.spacing_um,
        row=4,
        positions_um=np.zeros((12, 3)),
        before_um=np.zeros(3),
        angle_low_deg=low,
        angle_high_deg=high,
        transition_distance=distance,
        status=status,
    )
    return RunResult(row, {}, cell)


FAR, NEAR = -0.6, -0.1
SHIFT = np.degrees(np.arctan(0.25))


@pytest.mark.parametrize(
    ("before", "after", "begun"),
    [
        # One motion, far on both lattices: one run.
        ({0.5: (1.0, FAR), 0.2: (1.0, FAR), 0.8: (1.0, FAR)}, (1.0, FAR), {0.5: True}),
        # Near on the coarser one: released from all places. Near on the finer one: from the others.
        (
            {0.5: (1.0, NEAR), 0.2: (1.0, NEAR), 0.8: (1.0, FAR)},
            (1.0, FAR),
            {0.5: False, 0.2: False},
        ),
        (
            {0.5: (1.0, FAR), 0.2: (1.0, FAR), 0.8: (1.0, FAR)},
            (1.0, NEAR),
            {0.5: True, 0.2: False, 0.8: False},
        ),
        # Two motions, each from a release; what is in the bump lane is released.
        (
            {0.5: (1.0, FAR), 0.2: (1.0, FAR), 0.8: (SHIFT, 0.3)},
            (1.0, FAR),
            {0.5: False, 0.8: False},
        ),
        ({0.5: (SHIFT, 0.3), 0.2: (SHIFT, 0.3)}, (SHIFT, 0.3), {0.5: False, 0.2: False}),
        # Another motion than before stands for nothing.
        ({0.5: (SHIFT, 0.3), 0.2: (SHIFT, 0.3)}, (1.0, FAR), {0.5: False, 0.2: False}),
        # Nothing to go on with.
        ({}, (1.0, FAR), {0.5: False, 0.2: False}),
        ({0.2: (1.0, FAR)}, (1.0, FAR), {0.5: False, 0.2: True}),
    ],
)
def test_what_goes_on_what_is_released_and_what_stands_for_others(
    before, after, begun, monkeypatch
):
    asked = {}

    def run(*sections, start=None, **options):
        asked[sections[2].release_gap_fraction] = start is not None
        return made_up(*after, FINE)

    monkeypatch.setattr(array_outcome, "simulate_run", run)
    starts = {place: made_up(*motion, COARSE).cell for place, motion in before.items()}
    control = RunControl(release_gap_fractions=[0.5, 0.2, 0.8])
    make = partial(
        simulate_outcome,
        ZIGZAGS,
        SET_1,
        CELL,
        FLOW,
        FINE,
        control,
        outcome_id="r",
        stiffness_set="1",
        empty_flow="a flow",
        starts=starts,
    )
    made = make()
    assert asked == begun
    assert made.row["releases"] == len(begun) == len(made.runs)
    words = {True: GONE_ON, False: RELEASED}
    assert set(made.start.split(", ")) == {words[went_on] for went_on in begun.values()}
    shares = ("share_bump", "share_mixed", "share_zigzag", "share_none")
    assert sum(made.row[name] for name in shares) == pytest.approx(1)
    # Interrupted after its first run, it comes to the same.
    asked.clear()
    again = make(finished={0.5: made.runs[0.5]})
    assert 0.5 not in asked and again.row == made.row and again.start == made.start


# ------------------------------------------------------------------------------------- the state


@pytest.fixture(scope="module")
def scene():
    """A cell between pillars, deformed, two rows on."""
    empty = solve_empty_array(ZIGZAGS, FLOW, COARSE)
    array = array_of(empty)
    made = make_scene(array, empty.slower(4), SET_1, CELL, FLOW, refined(COARSE, 4))
    made.advance(600)
    return made, array, empty


def cell_of(scene, row=1):
    made, array, _ = scene
    sections = settled.sections_of(ZIGZAGS, SET_1, CELL, FLOW)
    return settled.settled_cell(made, array, row, made.sample().centre[:2] - 1.0, sections)


def test_a_cell_comes_back_to_its_place_in_the_first_gap(scene):
    made, array, empty = scene
    other = make_scene(array, empty, SET_1, CELL, FLOW, COARSE)
    before = cell_of(scene).enter(other, array)
    moved = row_origin(array, 0) - row_origin(array, 1)
    apart = other.positions() - made.positions() - moved
    apart[:, 1] -= array.pitch * np.round(apart[0, 1] / array.pitch)
    np.testing.assert_allclose(apart, 0, atol=1e-6)
    np.testing.assert_allclose(before[:2] - other.sample().centre[:2], -1.0, atol=1e-6)
    assert 0 <= other.sample().centre[1] - row_origin(array, 0)[1] < array.pitch
    assert np.array_equal(other.body.smooth, other.body.v) and other.body.v.any()


def test_on_a_finer_mesh_it_has_the_same_shape(scene):
    made, _, _ = scene
    fine = solve_empty_array(ZIGZAGS, FLOW, FINE)
    array = array_of(fine)
    other = make_scene(array, fine, SET_1, CELL, FLOW, FINE)
    at_rest = other.blend
    cell_of(scene).enter(other, array)
    here, there = other.sample(), made.sample()
    spacings = array.spacing_um, made.units.spacing_um
    assert other.vertices > 1.5 * made.vertices and other.blend == at_rest
    # Of a hundred vertices, none of which need be where the shape is widest.
    np.testing.assert_allclose(
        here.extent * spacings[0], there.extent * spacings[1], rtol=0, atol=0.3
    )
    assert here.volume_ratio == pytest.approx(there.volume_ratio, abs=2e-3)
    assert here.area_ratio == pytest.approx(there.area_ratio, abs=2e-3)
    energies = [
        sum(s.units.energy_aJ(e) for e in s.energies()[:2]) for s in (other, made)
    ]  # springs and hinges
    assert energies[0] == pytest.approx(energies[1], rel=0.1)


def test_half_a_scene_refuses_a_lopsided_cell(scene):
    _, array, empty = scene
    other = make_scene(array, empty, SET_1, CELL, FLOW, COARSE)
    cell = cell_of(scene)
    tilted = cell.positions_um + [0, 0, 0.1] * cell.positions_um[:, :1]
    with pytest.raises(DldsimError, match="not symmetric about mid-height") as caught:
        replace(cell, positions_um=tilted).enter(other, array)
    assert caught.value.key == "numerics.half_scene"


@pytest.mark.parametrize(
    ("changed", "key"),
    [
        ({"geometry": ZIGZAGS.model_copy(update={"gap_um": 11.0})}, "geometry.gap_um"),
        ({"stiffness": SET_1.model_copy(update={"ks_uN_per_m": 6.0})}, "stiffness.ks_uN_per_m"),
        ({"cell": Cell(radius_um=4.5)}, "cell.radius_um"),
        ({"cell": Cell(radius_um=4.0, axis="x")}, "cell.axis"),
        ({"flow": Flow(height_um=12.0)}, "flow.height_um"),
    ],
)
def test_a_cell_of_another_run_is_refused_by_name(scene, changed, key):
    parts = {"geometry": ZIGZAGS, "stiffness": SET_1, "cell": CELL, "flow": FLOW} | changed
    with pytest.raises(DldsimError, match=f"another run: {key} = ") as caught:
        simulate_run(
            *parts.values(), COARSE, CONTROL, run_id="r", stiffness_set="1", start=cell_of(scene)
        )
    assert caught.value.key == key


def test_cells_come_back_from_their_file(scene, tmp_path, monkeypatch):
    path = tmp_path / "cells.npz"
    cells = {0.5: cell_of(scene), 0.2: replace(cell_of(scene, 2), transition_distance=0.3)}
    save(cells, path)
    again = load(path)
    assert [*again] == [0.5, 0.2]
    for place, cell in cells.items():
        for name, value in vars(cell).items():
            assert np.array_equal(getattr(again[place], name), value), name
        again[place].check(settled.sections_of(ZIGZAGS, SET_1, CELL, FLOW))
    save({}, path)
    assert load(path) == {}
    monkeypatch.setattr(settled, "PHYSICS_VERSION", -1)
    with pytest.raises(DldsimError, match="made by physics version"):
        load(path)


def test_what_is_no_file_of_cells_is_refused(scene, tmp_path):
    _, _, empty = scene
    flow, text = tmp_path / "flow.npz", tmp_path / "text.npz"
    empty.save(flow)
    text.write_text("cells")
    for path in (flow, text, tmp_path / "none.npz"):
        with pytest.raises(DldsimError) as caught:
            load(path)
        assert caught.value.key == str(path)
