"""Cells and runs of a verification: what is simulated, used again, gone on with and recorded."""

import threading

import pytest

from dldsim.config.sections import CellShape, Flow, Geometry, Numerics, RunControl
from dldsim.design.populations import Population
from dldsim.design.simulator import Scene, Simulator
from dldsim.errors import DldsimError, NoRoom
from dldsim.experiments import array_run
from dldsim.tables.registry import COLUMNS
from tests.experiments.test_vtk import SOFT

SCENE = Scene(
    CellShape(radius_um=5.0),
    Flow(height_um=12.0),
    Numerics(),
    RunControl(max_rows=2, release_gap_fractions=[0.5, 0.4]),
)
GEOMETRY = Geometry(pillar_radius_um=5, gap_um=12, periodicity=4)
SMALL = Population(
    1, "small-1", "biconcave", 4.0, SCENE.flow, SOFT, "by hand", 5.0, 5.0, deformation_index=0.5
)


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    """One real outcome of two releases, two rows long each."""
    folder = tmp_path_factory.mktemp("outcomes")
    simulator = Simulator(folder, SCENE)
    return simulator, simulator(GEOMETRY, SMALL, 12.0)


def test_an_outcome_has_the_radius_of_its_population(simulated):
    simulator, row = simulated
    assert row["cell_radius_um"] == 4.0 and row["height_um"] == 12.0
    assert row["outcome_id"] == "r05.0_g12.0_n04_ssmall-1"
    assert row["deformation_index"] == 0.5 and row["deformation_index_std"] == 0
    assert (row["releases"], row["rows_total"]) == (2, 4)
    assert set(row) == {c.name for c in COLUMNS["outcomes"]}
    assert not (simulator.directory / row["outcome_id"]).exists()  # nothing partial is left


def test_both_cell_types_are_simulated_at_a_time(simulated, tmp_path):
    """With the same outcomes as one after the other; what they tell says whose it is."""
    other = SMALL._replace(number=2, name="small-2", radius_um=4.4)
    told = []
    together = Simulator(tmp_path / "two", SCENE, told.append, threads=2)
    alone = Simulator(tmp_path / "one", SCENE)
    found = together.each(lambda p: together(GEOMETRY, p, 12.0), [SMALL, other])
    expected = alone.each(lambda p: alone(GEOMETRY, p, 12.0), [SMALL, other])
    assert [r["cell_radius_um"] for r in found] == [4.0, 4.4]
    for row, same in zip(found, expected, strict=True):
        assert {**row, "wall_time_s": 0} == {**same, "wall_time_s": 0}
    names = {sentence.partition(":")[0] for sentence in told}
    assert names == {row["outcome_id"] for row in found}


@pytest.mark.parametrize("populations", [[None, SMALL], [SMALL, None]])
def test_where_one_fails_the_other_ends(populations):
    simulator = Simulator("nowhere", SCENE, threads=2)
    begun, ended = threading.Event(), []

    def simulate(population):
        if population is None:
            begun.wait(10)
            raise ZeroDivisionError
        tell = simulator._told("other")
        begun.set()
        try:
            while True:
                tell("still running")
        except KeyboardInterrupt:
            ended.append(population)
            raise

    with pytest.raises(ZeroDivisionError):
        simulator.each(simulate, populations)
    assert ended == [SMALL]
    assert simulator.each(lambda p: p, [1, 2]) == [1, 2]


def test_on_the_finer_lattice_the_cell_is_released(simulated, monkeypatch):
    """And nothing is recorded there, since no file of a design shows it."""
    simulator, row = simulated
    asked = []

    def stop(*sections, **options):
        asked.append((sections[4].spacing_um, options.get("starts"), options["observe"]))
        raise DldsimError("enough seen")

    monkeypatch.setattr("dldsim.experiments.array_outcome.simulate_outcome", stop)
    with pytest.raises(DldsimError, match="enough seen"):
        simulator(GEOMETRY, SMALL, 12.0, finer=True)
    [(spacing, starts, observe)] = asked
    assert spacing < row["spacing_um"] and starts is None and observe is None


def test_a_glance_is_the_first_release_of_what_follows(simulated, tmp_path, monkeypatch):
    _, row = simulated
    simulate, places = array_run.simulate_run, []

    def watched(*sections, **options):
        places.append(sections[2].release_gap_fraction)
        return simulate(*sections, **options)

    monkeypatch.setattr("dldsim.experiments.array_outcome.simulate_run", watched)
    simulator = Simulator(tmp_path, SCENE)
    seen = simulator.glance(GEOMETRY, SMALL, 12.0, finer=False)
    assert (seen["releases"], seen["outcome_id"], places) == (1, row["outcome_id"], [0.5])
    assert simulator.glance(GEOMETRY, SMALL, 12.0, finer=False) | {"wall_time_s": 0} == seen | {
        "wall_time_s": 0
    }
    whole = simulator(GEOMETRY, SMALL, 12.0)
    assert {**whole, "wall_time_s": 0} == {**row, "wall_time_s": 0}
    assert simulator.glance(GEOMETRY, SMALL, 12.0, finer=False) == whole


def test_a_finished_outcome_is_used_again(simulated, monkeypatch):
    simulator, row = simulated

    def forbidden(*arguments, **options):
        raise AssertionError("simulated again")

    monkeypatch.setattr("dldsim.experiments.array_outcome.simulate_run", forbidden)
    monkeypatch.setattr("dldsim.solver.flow.solve_empty_array", forbidden)
    again = Simulator(simulator.directory, SCENE)
    assert again(GEOMETRY, SMALL, 12.0) == row
    stiffer = SMALL._replace(stiffness=SOFT.model_copy(update={"ks_uN_per_m": 9.0}))
    for changed in (
        lambda: again(GEOMETRY, stiffer, 12.0),
        lambda: again(GEOMETRY, SMALL, 13.0),
        lambda: Simulator(simulator.directory, SCENE._replace(control=RunControl(max_rows=3)))(
            GEOMETRY, SMALL, 12.0
        ),
    ):
        with pytest.raises(AssertionError, match="simulated again"):
            changed()
    (simulator.directory / f"{row['outcome_id']}.outcome.parquet").write_bytes(b"cut off")
    with pytest.raises(AssertionError, match="simulated again"):
        again(GEOMETRY, SMALL, 12.0)


def test_an_interrupted_outcome_goes_on_with_its_next_release(simulated, tmp_path, monkeypatch):
    _, row = simulated
    simulate, places = array_run.simulate_run, []

    def stop(*sections, **options):
        places.append(sections[2].release_gap_fraction)
        if places == [0.5, 0.4]:
            raise KeyboardInterrupt
        return simulate(*sections, **options)

    monkeypatch.setattr("dldsim.experiments.array_outcome.simulate_run", stop)
    simulator = Simulator(tmp_path, SCENE)
    with pytest.raises(KeyboardInterrupt):
        simulator(GEOMETRY, SMALL, 12.0)
    again = simulator(GEOMETRY, SMALL, 12.0)
    assert places == [0.5, 0.4, 0.4]
    assert again["angle_high_deg"] == row["angle_high_deg"] and again["steps"] == row["steps"]
    assert simulator.passage(again).shapes.cell_radius_um == 4.0


def test_shapes_are_recorded_where_the_cell_does_not_fit_at_the_first_place(tmp_path, monkeypatch):
    simulate = array_run.simulate_run

    def narrow(*sections, **options):
        if sections[2].release_gap_fraction == 0.5:
            raise NoRoom("does not fit")
        return simulate(*sections, **options)

    monkeypatch.setattr("dldsim.experiments.array_outcome.simulate_run", narrow)
    simulator = Simulator(tmp_path, SCENE)
    passage = simulator.passage(simulator(GEOMETRY, SMALL, 12.0))
    assert passage.shapes.departure_um(passage.trajectory) == 0


def test_recorded_shapes_belong_to_the_first_release(simulated):
    simulator, row = simulated
    passage = simulator.passage(row)
    assert set(passage.trajectory["run_id"]) == {f"{row['outcome_id']}_y0.50"}
    assert passage.shapes.departure_um(passage.trajectory) == 0
    assert passage.shapes.cell_radius_um == 4.0


def test_the_cell_has_the_shape_of_its_population(tmp_path):
    simulator = Simulator(tmp_path, SCENE)
    cell = simulator._cell(SMALL._replace(shape="sphere"))
    assert (cell.shape, cell.radius_um, cell.axis) == ("sphere", 4.0, SCENE.cell.axis)


def test_another_height_is_another_run():
    simulator = Simulator("nowhere", SCENE)
    assert simulator.name(GEOMETRY, SMALL, 12.0) == "r05.0_g12.0_n04_ssmall-1"
    assert simulator.name(GEOMETRY, SMALL, 11.5) == "r05.0_g12.0_n04_ssmall-1-h11500"


def test_flow_of_a_design_is_kept(simulated, monkeypatch):
    simulator, _ = simulated
    row = simulator.resistance(GEOMETRY)
    assert row["drag_over_mu_U"] > 0 and row["permeability_over_pitch2"] > 0
    monkeypatch.setattr("dldsim.solver.flow.solve_empty_array", None)
    assert Simulator(simulator.directory, SCENE).resistance(GEOMETRY) == row
