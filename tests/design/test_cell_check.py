"""Laws of the simulated check: places of release, exits, chances; and a check that goes on."""

import numpy as np
import pytest
from scipy.stats import binom

from dldsim.config.sections import CellShape, Flow, Geometry, Numerics, RunControl, Stiffness
from dldsim.design import cell_check
from dldsim.design.cell_check import (
    Setting,
    chance_of_count,
    chance_of_exits,
    compare,
    draw_checked,
    exit_um,
    half_extent_um,
    release_places,
    simulate_cells,
)
from dldsim.design.outlets import best_split
from tests.design.test_outlets import ARRAY, cells, devices, make_paths, normal_shares

SET = Stiffness(
    ks_uN_per_m=5.1,
    kb_pN_um=0.043,
    kal_uN_per_m=10.2,
    kag_uN_per_m=500,
    kv_Pa=900,
    kvisc_nN_s_per_m=1.5,
)


def test_places_of_release_follow_the_flow():
    level = (np.arange(20000) + 0.5) / 20000
    places = release_places(level, np.zeros(1))
    below = np.mean(places < 0.2)
    assert below == pytest.approx(3 * 0.2**2 - 2 * 0.2**3, abs=1e-3)
    near = release_places(level, np.full(1, 0.3))
    assert near.min() == pytest.approx(0.3, abs=1e-3) and near.max() == pytest.approx(0.7, abs=1e-3)
    assert set(release_places(level, np.full(1, 0.6))) == {0.5}


def test_extent_across_the_gap():
    assert half_extent_um(CellShape(shape="sphere", radius_um=5)) == 5
    # A red cell of 7.82 µm is 2.57 µm thick by the published profile.
    assert half_extent_um(CellShape(radius_um=3.91)) == pytest.approx(2.57 / 2, rel=0.01)
    assert half_extent_um(CellShape(shape="ellipsoid", radius_um=5, aspect_ratio=0.4)) == 2
    assert half_extent_um(CellShape(radius_um=5, axis="z")) == 5


def test_exit_is_that_of_the_rows_and_then_of_the_settled_motion():
    path = make_paths(ARRAY, cells(), devices(), 0, normal_shares(0.0, 0.0))
    angle = float(np.degrees(np.arctan(0.1)))
    row = {"migration_angle_deg": angle, "lateral_steps_um": [1.0, 2.0], "cell_radius_um": 7.0}
    rows = round(5000 / 30)
    assert exit_um(row, 400.0, path) == pytest.approx(403 + (rows - 2) * 3)
    assert exit_um(row, 1900.0, path) == 1993
    assert exit_um(row | {"migration_angle_deg": None}, 400.0, path) is None


def test_chance_of_a_count_is_exact_for_one_probability():
    """Two-sided, as the exact binomial test has it."""
    chances = binom.pmf(np.arange(21), 20, 0.7)
    for own in (9, 14, 20):
        expected = chances[chances <= chances[own] * (1 + 1e-9)].sum()
        assert chance_of_count(own, 20, np.array([0.7])) == pytest.approx(expected)
    assert chance_of_count(20, 20, np.array([1.0])) == 1.0
    assert chance_of_count(0, 20, np.array([1.0])) == 0.0
    # a device gives all or none: either is as likely
    assert chance_of_count(0, 20, np.array([0.0, 1.0])) == pytest.approx(1.0)


def test_chance_of_exits_tells_another_distribution():
    path = make_paths(ARRAY, cells(), devices(), 0, normal_shares(0.5, 0.1))
    rng = np.random.default_rng(3)
    like = 500 + 500 * rng.normal(0.5, 0.1, 20)
    assert chance_of_exits(like, path, seed=1) > 0.05
    assert chance_of_exits(like + 50, path, seed=1) < 0.01
    assert chance_of_exits(np.array([]), path, seed=1) == 1.0


def test_chances_of_agreeing_samples_are_even():
    """Of samples of the prediction itself one in twenty is called unlike it, not more."""
    path = make_paths(ARRAY, cells(), devices(), 0, normal_shares(0.5, 0.1))
    rng = np.random.default_rng(4)
    chances = [chance_of_exits(500 + 500 * rng.normal(0.5, 0.1, 15), path, 5) for _ in range(40)]
    assert np.mean(np.array(chances) < 0.5) == pytest.approx(0.5, abs=0.25)
    assert np.mean(np.array(chances) < 0.05) <= 0.15


def test_an_error_that_cells_share_widens_what_agrees():
    shifted = normal_shares(0.5, 0.1)._replace(off=lambda s, u: s + 0.2 * u)
    wide = devices(64, deviate=np.tile(np.linspace(-1, 1, 64), (2, 1)))
    path = make_paths(ARRAY, cells(count=256), wide, 0, shifted)
    rng = np.random.default_rng(3)
    assert chance_of_exits(550 + 500 * rng.normal(0.5, 0.1, 20), path, seed=1) > 0.05


def row(place, status="converged"):
    return {"status": status, "stop_reason": "so", "migration_angle_deg": place}


def test_compared_counts_own_lost_open_and_failed():
    paths = tuple(
        make_paths(ARRAY, cells(), devices(), k, normal_shares(d, 0.1))
        for k, d in enumerate((0.2, 0.6))
    )
    split = best_split(paths, (0.5, 0.5), np.array([700.0]))
    rows = [row(1), row(1, "undecided"), row(1), row(None, "stuck"), row(None, "failed")]
    exits = [720.0, 810.0, 690.0, None, None]
    found = compare(rows, exits, 1, paths[1], split, seed=1)
    assert (found.counted, found.own, found.lost, found.open_, found.failed) == (4, 2, 1, 1, 1)
    assert found.recovery_low < found.recovery == 0.5 < found.recovery_high
    low = compare(rows, exits, 0, paths[0], split, seed=1)
    assert low.own == 1 and not low.agrees


def drawn_cells(count=3):
    def of(levels):
        return 3.5 + levels[0], 5 + levels[1], 400 + 60 * levels[2]

    shapes = [CellShape(radius_um=4), CellShape(shape="sphere", radius_um=4)]

    def make(ks):
        return SET.model_copy(update={"ks_uN_per_m": ks})

    return draw_checked(count, [of, of], shapes, make, 12.0, 0.6, seed=8)


def test_cells_are_drawn_from_both_populations():
    drawn = drawn_cells(5)
    assert [d.population for d in drawn] == [1, 1, 1, 2, 2]
    assert [d.number for d in drawn] == [1, 2, 3, 4, 5]
    assert [d.cell.shape for d in drawn] == ["biconcave"] * 3 + ["sphere"] * 2
    for d in drawn:
        room = (half_extent_um(d.cell) + 0.6) / 12
        assert room - 1e-3 <= d.release_gap_fraction <= 1 - room + 1e-3
        assert 3.5 <= d.cell.radius_um <= 4.5 and 400 <= d.start_um <= 460
    assert drawn == drawn_cells(5)


def test_a_check_is_simulated_and_goes_on_where_it_stopped(tmp_path, monkeypatch):
    setting = Setting(
        Geometry(pillar_radius_um=5, gap_um=12, periodicity=4),
        Flow(height_um=12.0),
        Numerics(spacing_um=2.0),
        RunControl(max_rows=4),
    )
    drawn, said = drawn_cells(3), []
    rows = simulate_cells(drawn, setting, tmp_path, said.append, processes=1)
    assert [r["rows_completed"] for r in rows] == [4, 4, 4]
    assert all(len(r["lateral_steps_um"]) == 4 for r in rows)
    assert "cell 3 of 3 (type 2, radius" in said[-1] and "about 0 min left" in said[-1]
    kept = sorted(p.name for p in tmp_path.glob("cell-*.parquet"))
    assert kept == ["cell-0001.parquet", "cell-0002.parquet", "cell-0003.parquet"]
    (tmp_path / kept[1]).unlink()
    again, run = [], cell_check._run
    monkeypatch.setattr(cell_check, "_run", lambda d, *a: again.append(d.number) or run(d, *a))
    assert simulate_cells(drawn, setting, tmp_path, said.append, processes=1) == [
        r
        | {
            k: n[k]
            for k in ("wall_time_s", "processor_time_s", "ms_per_step", "mlups", "start_up_s")
        }
        for r, n in zip(
            rows, simulate_cells(drawn, setting, tmp_path, said.append, processes=1), strict=True
        )
    ]
    assert again == [2]


def test_a_cell_that_fits_nowhere_is_lost(tmp_path):
    setting = Setting(
        Geometry(pillar_radius_um=5, gap_um=6, periodicity=4),
        Flow(height_um=12.0),
        Numerics(spacing_um=1.5),
        RunControl(max_rows=4),
    )
    shape = CellShape(shape="sphere", radius_um=7)
    [drawn, *_] = draw_checked(
        2,
        [lambda u: (7 + 0 * u[0], 5 + 0 * u[1], 400 + 0 * u[2])] * 2,
        [shape] * 2,
        lambda ks: SET,
        6.0,
        0.6,
        seed=1,
    )
    assert drawn.release_gap_fraction == 0.5
    [found] = simulate_cells([drawn], setting, tmp_path, lambda s: None, processes=1)
    assert found["status"] == "does not fit"
