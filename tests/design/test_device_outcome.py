"""What comes out of a device: sources of cells, tables, cascade, limits on an array."""

import numpy as np
import pandas as pd
import pytest

from dldsim.config.design_sections import DesignRequest, Device
from dldsim.config.sections import Flow, Geometry
from dldsim.design.cell_source import make_sources
from dldsim.design.chip import Chip
from dldsim.design.device_outcome import device_outcome, tables_of, warnings_of
from dldsim.design.measured_cells import read_measured
from dldsim.design.motion import UNKNOWN
from dldsim.design.outlet_task import OutletTask
from dldsim.design.verified import Verdicts, devices_of
from dldsim.errors import DldsimError
from dldsim.report.outlet_figures import draw_fan
from dldsim.tables.parquet import write_table
from tests.design.test_motion import GEOMETRY, Law, population, row

DEVICE = Device(array_length_mm=5.0, sample_position_mm=0.4)
BETWEEN = DEVICE.model_copy(update={"outlet_walls_um": [650.0]})
"""A wall between the streams of cells that bump and of those that do not."""
KS = {"ks_1_uN_per_m": 15.0, "ks_2_uN_per_m": 15.0}


def ask(**changes):
    given = {"name": "t", **KS, "radius_1_um": 6.0, "radius_2_um": 8.0, "draws": 16, "cells": 256}
    return DesignRequest(**given | changes)


def sources(request, measured=(None, None), **changes):
    both = [population(i, getattr(request, f"radius_{i}_um"), **changes) for i in (1, 2)]
    return make_sources(request, both, None, measured)


STEP = Law(lambda r, g, n, size, ca: np.where(size > 7, 1.0, 0.0))
"""Cells of more than 7 µm radius bump, others follow the flow."""


def outcome(
    request=None, law=STEP, device=DEVICE, geometry=GEOMETRY, measured=(None, None), **options
):
    request = request or ask()
    made = options.pop("sources", None) or sources(request, measured)
    return device_outcome(
        request, "d", geometry, device, made, law, (UNKNOWN, UNKNOWN), 1, **options
    )


def test_two_sizes_part_completely(tmp_path):
    tables = tables_of([outcome()])
    rows = tables["device_outcomes"]
    assert rows["outlet"].tolist() == ["lower", "upper"]
    for name in ("purity", "recovery", "value", "recovery_of_sample", "purity_recovery"):
        np.testing.assert_allclose(rows[name], 1.0)
    np.testing.assert_allclose(rows["enrichment"], 2.0)
    np.testing.assert_allclose(rows["lost"], 0.0)
    assert rows["share_bump"].tolist() == [0.0, 1.0] and rows["share_zigzag"].tolist() == [1.0, 0]
    assert rows["array_length_mm"][0] == pytest.approx(4.98) and rows["extrapolated"].sum() == 0
    # the wall is midway between the edges of the two streams: 400 + 30 and 898 − 30 µm at most
    assert rows["cut_um"][0] == pytest.approx((430 + 868) / 2, abs=15)
    for kind, table in tables.items():  # units, types, no NaN
        write_table(kind, table, tmp_path / f"{kind}.parquet", {})


def test_scatter_of_the_radius_is_what_recovery_loses():
    """Of radii 7.5 ± 0.5 µm the part below 7 µm follows the flow."""
    request = ask(radius_2_um=7.5, radius_std_2_um=0.5, tolerance_um=0)
    rows = tables_of([outcome(request, device=BETWEEN)])["device_outcomes"]
    assert rows["recovery"][1] == pytest.approx(0.8413, abs=0.005)
    assert rows["purity"][0] == pytest.approx(1 / (1 + 1 - 0.8413), abs=0.005)


def test_concentration_counts_in_purity_and_enrichment():
    request = ask(radius_2_um=7.5, radius_std_2_um=0.5, tolerance_um=0, concentration_ratio=1 / 99)
    rows = tables_of([outcome(request, device=BETWEEN)])["device_outcomes"]
    pure = 0.01 / (0.01 + 0.99 * (1 - 0.8413))
    assert rows["purity"][0] == pytest.approx(pure, abs=0.003)
    assert rows["enrichment"][0] == pytest.approx(100 * pure, abs=0.3)


def test_measured_cells_are_taken_as_they_are():
    """A quarter of the cells of the first type are large."""
    cells = read_measured(b"radius_um\n6.1\n6.2\n6.3\n8.7\n", "a.csv")
    found = outcome(ask(tolerance_um=0), device=BETWEEN, measured=(cells, None))
    rows = tables_of([found])["device_outcomes"]
    assert rows["recovery"][0] == pytest.approx(0.75)
    assert rows["radius_mean_um"][0] == pytest.approx(cells.radius_um.mean())


def test_a_measured_stiffness_stays_with_its_radius():
    soft = Law(lambda r, g, n, size, ca: np.where((size > 7) & (ca > 0.02), 1.0, 0.0))
    cells = read_measured(b"radius_um,ks_uN_per_m\n6.1,15\n6.2,15\n8.6,15\n8.7,150\n", "a.csv")
    found = outcome(ask(tolerance_um=0), soft, BETWEEN, measured=(cells, None))
    rows = tables_of([found])
    assert rows["device_outcomes"]["recovery"][0] == pytest.approx(0.75)


def test_stiffness_scatters_lognormally_or_by_its_interval():
    level = (np.arange(4000) + 0.5) / 4000
    lognormal, _ = sources(ask(ks_cv_1=0.3))
    _, ks = lognormal.draw(level, level)
    assert ks.mean() == pytest.approx(15, rel=1e-3) and ks.std() == pytest.approx(4.5, rel=0.01)
    by_index, _ = sources(ask(), ks_low=10.0, ks_high=20.0)
    _, ks = by_index.draw(level, level)
    below, middle, above = np.quantile(ks, [0.1587, 0.5, 0.8413])
    assert (below, middle, above) == pytest.approx((10, 15, 20), rel=2e-3)


def test_cells_wider_than_the_gap_are_lost():
    request = ask(radius_1_um=8.0, radius_std_1_um=0.5, radius_2_um=5.0, tolerance_um=0)
    tight = Geometry(pillar_radius_um=7, gap_um=8, periodicity=10)
    both = [population(1, 8.0, width_um=8.0), population(2, 5.0, width_um=5.0)]
    rows = tables_of([outcome(request, geometry=tight, sources=make_sources(request, both))])
    assert rows["device_outcomes"]["lost"].tolist() == pytest.approx([0.5, 0.0], abs=0.01)
    assert rows["device_outcomes"]["recovery"][0] <= 0.5


def test_cells_outside_what_was_learnt_are_told():
    wide = Geometry(pillar_radius_um=7, gap_um=21, periodicity=10)
    found = outcome(geometry=wide)
    assert found.extrapolated == (1.0, 1.0)
    told = warnings_of([found, found])
    assert [note[:53] for note in told] == [
        f"extrapolated: 100% of the cells of type {k} in d: array" for k in (1, 2)
    ]
    assert warnings_of([outcome()]) == []


def test_outlets_of_an_array_that_was_not_learnt_say_nothing():
    """The surrogate is sure of a complete separation, where it knows nothing."""
    found = outcome(
        ask(draws=256), geometry=Geometry(pillar_radius_um=7, gap_um=21, periodicity=10)
    )
    rows = tables_of([found])["device_outcomes"]
    for name in ("purity", "recovery"):
        assert (rows[f"{name}_low"] < 0.1).all() and (rows[f"{name}_high"] > 0.9).all()
    assert rows["purity_recovery"].max() < 0.1


def unsure(size=7.0):
    """A surrogate that is sure of neither cell type."""
    return Law(
        lambda r, g, n, radius, ca: np.where(radius > size, 0.8, 0.2),
        scores=[[0.008 * i] for i in range(99)],
        sigma={"bump": 0.1},
    )


def test_a_result_does_not_depend_on_which_type_is_called_the_first():
    cells = {"radius_1_um": 6.0, "radius_2_um": 8.0, "radius_std_2_um": 0.5}
    turned = {"radius_2_um": 6.0, "radius_1_um": 8.0, "radius_std_1_um": 0.5}
    one, two = (outcome(ask(draws=64, **c), unsure()).split for c in (cells, turned))
    assert one.robust == two.robust and one.cut_um == two.cut_um and one.upper != two.upper
    np.testing.assert_array_equal(one.recovery, two.recovery[::-1])


def test_what_nine_of_ten_exceed_is_the_same_for_all_seeds_but_for_a_few_per_cent():
    found = []
    for seed in range(8):
        request = ask(draws=None)
        split = device_outcome(
            request, "d", GEOMETRY, DEVICE, sources(request), unsure(), (UNKNOWN, UNKNOWN), seed,
            along=False,
        ).split  # fmt: skip
        found.append(split.robust)
    assert 0.2 < np.mean(found) < 0.9 and np.std(found) < 0.01


def test_a_wall_that_is_placed_says_the_same_as_one_that_is_given():
    """A mask has the wall that was placed: what comes out of it is what was said then."""
    first = outcome(ask(draws=64), unsure())
    given = DEVICE.model_copy(update={"outlet_walls_um": list(first.walls_um)})
    again = outcome(ask(draws=64), unsure(), given)
    assert again.split.robust == first.split.robust
    np.testing.assert_array_equal(again.split.purity, first.split.purity)


def test_a_type_that_never_enters_is_undefined_in_every_table(tmp_path):
    """The lower outlet of a complete separation feeds the second device with one type alone."""
    first = outcome()
    second = outcome(inflow=first.inflow(1))
    tables = tables_of([first, second])
    rows = tables["device_outcomes"][2:].set_index("population")
    assert rows["recovery"][1] == rows["purity"][1] == 1.0
    for name in ("recovery", "lost", "purity_recovery", "value"):
        assert np.isnan(rows[name][2])
    assert rows["recovery_of_sample"].tolist() == [1.0, 0.0]
    outlets = tables["device_outlets"][2:]
    assert outlets["cells_2"].isna().all() and outlets["cells_1"].sum() == 1.0
    assert sorted(outlets["purity_1"].isna()) == [False, True]  # one outlet gets all, one nothing
    for kind, table in tables.items():
        write_table(kind, table, tmp_path / f"{kind}.parquet", {})
    assert any("type 2 enter d at stage 2 in 0.0% of the draws" in n for n in warnings_of([second]))
    assert draw_fan(tables)


def test_outlet_tables_and_types_say_the_same_of_a_rare_type():
    """A few draws send cells of the second type to the lower outlet: both tables are of these."""
    first = outcome(ask(draws=64), unsure())
    collects = 2 if first.split.upper == 0 else 1
    second = outcome(ask(draws=64), unsure(), inflow=first.inflow(collects))
    enters = second.paths[1].weight.any(axis=1)
    assert 0 < enters.mean() < 1
    tables = tables_of([second])
    for one in tables["device_outcomes"].to_dict("records"):
        number = 2 if one["outlet"] == "upper" else 1
        outlet = tables["device_outlets"].set_index("outlet").loc[number]
        for end in ("", "_low", "_high"):
            assert outlet[f"cells_{one['population']}{end}"] == one[f"recovery{end}"]
        pure = [outlet[f"purity_1{end}"] for end in ("", "_low", "_high")]
        if one["population"] == 2:
            pure = [1 - pure[i] for i in (0, 2, 1)]
        assert [one[f"purity{end}"] for end in ("", "_low", "_high")] == pytest.approx(pure)
    assert np.isnan(second.split.value[~enters]).all()


def test_an_outlet_that_nothing_reaches_has_no_purity():
    """Both types follow the flow to the lower outlet: the upper one is empty, pure of neither."""
    still = Law(lambda r, g, n, size, ca: 0 * size)
    found = outcome(ask(tolerance_um=0), still, BETWEEN)
    tables = tables_of([found])
    [empty] = [r for r in tables["device_outcomes"].to_dict("records") if r["recovery"] == 0]
    assert np.isnan(empty["purity"]) and np.isnan(empty["enrichment"])
    assert tables["device_outlets"]["purity_1"].isna().tolist() == [False, True]
    assert found.split.robust == 0.0  # what recovers nothing is no separation


def test_outlets_add_up():
    device = DEVICE.model_copy(update={"outlets": 5})
    found = outcome(ask(radius_std_2_um=0.5), device=device)
    table = tables_of([found])["device_outlets"]
    assert len(table) == 5 and table["low_um"][0] == 0 and table["high_um"][4] == 1996
    for name in ("cells_1", "cells_2"):
        assert table[name].sum() == pytest.approx(1.0, abs=1e-6)
    assert found.split.cut_um in found.walls_um
    assert set(table["collects"]) == {1, 2}


def test_exits_and_positions_are_of_all_cells():
    tables = tables_of([outcome(ask(radius_std_2_um=0.5))])
    exits = tables["device_exits"]
    assert exits.groupby("population")["cells"].sum().tolist() == pytest.approx([1.0, 1.0])
    last = tables["device_positions"].groupby("population").last()
    assert last.loc[1, "y_50_um"] == pytest.approx(400, abs=2)
    assert last.loc[2, "y_50_um"] == pytest.approx(400 + 498, abs=2)
    order = last[[f"y_{q}_um" for q in ("05", "25", "50", "75", "95")]].to_numpy()
    assert (np.diff(order, axis=1) >= 0).all()


def test_a_cascade_gets_an_outlet_of_the_first():
    request = ask(radius_1_um=6.5, radius_std_1_um=0.5, radius_std_2_um=0.5, tolerance_um=0)
    first = outcome(request, device=BETWEEN)
    second = outcome(request, device=BETWEEN, inflow=first.inflow(2))
    rows = tables_of([first, second])["device_outcomes"]
    assert rows["stage"].tolist() == [1, 1, 2, 2]
    # the same array again sorts nothing out: what came up comes up once more
    large = rows[(rows["population"] == 2)]
    assert large["recovery"].tolist() == pytest.approx([0.9772, 1.0], abs=0.005)
    assert large["recovery_of_sample"].tolist()[1] == pytest.approx(0.9772, abs=0.005)
    assert rows["purity"].iloc[3] == pytest.approx(rows["purity"].iloc[1], abs=0.005)


@pytest.mark.parametrize(("outlet", "message"), [(3, "has 2 outlets"), (0, "1 to 2|has 2")])
def test_a_cascade_from_an_outlet_that_is_not_there_is_refused(outlet, message):
    with pytest.raises(DldsimError, match=message):
        outcome().inflow(outlet)


def test_a_tolerance_by_which_a_pillar_vanishes_is_refused():
    with pytest.raises(DldsimError, match=r"tolerance_um.*10.*below 7"):
        outcome(ask(tolerance_um=10.0))


def test_a_cascade_from_an_outlet_without_cells_is_refused():
    device = DEVICE.model_copy(update={"outlet_walls_um": [100.0, 700.0]})
    with pytest.raises(DldsimError, match="from_outlet = 1: no cell leaves"):
        outcome(device=device).inflow(1)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"radius_cv_1": 0.6}, r"radius_cv_1: 3.6 µm .* negative"),
        ({"radius_std_2_um": 4.0}, r"radius_std_2_um: 4 µm about a mean of 8 µm"),
    ],
)
def test_radii_that_are_negative_are_refused(changes, message):
    with pytest.raises(DldsimError, match=message):
        sources(ask(**changes))


def task(**changes):
    request = ask(objective="purity-recovery", tolerance_um=0, **changes)
    chip = Chip(population().flow, DEVICE, 2.0)
    return OutletTask(STEP, request, sources(request), (UNKNOWN, UNKNOWN), chip, 1)


def test_an_array_is_as_long_as_its_limits_allow():
    assert task().device(GEOMETRY).array_length_mm == 5.0
    assert task(footprint_max_mm2=4.0).device(GEOMETRY).array_length_mm == 2.0

    class Drag:
        def drag_over_mu_U(self, radius, gap, periodicity):
            return np.array([12.0])

    limited = task(pressure_max_kPa=0.02)
    limited.chip = limited.chip._replace(resistance=Drag())
    length = limited.device(GEOMETRY).array_length_mm
    assert limited.chip.pressure_kPa(12.0, 30.0, length) == pytest.approx(0.02)


def test_an_array_shorter_than_a_period_violates_a_limit():
    short = task(footprint_max_mm2=0.5)
    place = [np.array([v]) for v in (7.0, 16.0, 10)]
    assert short.limits(*place)["array must hold a period"][0] == pytest.approx(50)
    assert task().limits(*place)["array must hold a period"][0] < 0


def test_a_sample_flow_that_no_array_gives_is_refused():
    task(sample_min_uL_per_h=2.0).check()
    with pytest.raises(DldsimError, match=r"sample_min_uL_per_h = 3, but .* carries 2.16 µL/h"):
        task(sample_min_uL_per_h=3.0).check()


def test_the_value_of_a_search_is_that_of_the_candidate():
    made = task(radius_2_um=7.5, radius_std_2_um=0.5)
    [quick] = made.score([7.0], [16.0], [10])
    assert quick == pytest.approx(made.outcome("d", GEOMETRY).split.robust, abs=0.02)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"radius_cv_1": -0.1}, "radius_cv_1"),
        ({"radius_cv_1": 0.1, "radius_std_1_um": 0.5}, "one of radius_std_1_um and radius_cv_1"),
        ({"draws": 4096, "cells": 65_536}, "draws times cells at most 4,000,000"),
        ({"draws": 5000}, "4096"),
        ({"footprint_max_mm2": 2.0}, "footprint_max_mm2 with objective: purity-recovery"),
    ],
)
def test_settings_that_contradict_each_other_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        ask(**changes)


def verdicts():
    """One design that was simulated: the first cell type follows the flow, the second bumps."""
    place = GEOMETRY.model_dump()
    rows = {
        f"o{i}": row(share, "decided") | {"outcome_id": f"o{i}", **place}
        for i, share in ((1, 0.0), (2, 1.0))
    }
    found = [
        {"array": 1, "role": "design", "population": str(i), "outcome_id": f"o{i}"} for i in (1, 2)
    ]
    found += [found[0] | {"population": "difference"}, found[0] | {"role": "finer"}]
    designs = [
        {"name": "t-1", "array": 1, "separation_deg": 5.7, **place},
        {"name": "t-2", "array": 2, "separation_deg": None, **place},
    ]
    return Verdicts(
        pd.DataFrame(found), pd.DataFrame(designs), pd.DataFrame(), pd.DataFrame(), rows
    )


def test_what_was_simulated_takes_the_place_of_what_was_predicted():
    """The surrogate knows nothing of these arrays: alone it parts nothing for certain."""
    ignorant = Law(lambda r, g, n, size, ca: 0.5 + 0 * size, scores=[[9.0]] * 99)
    request = ask(tolerance_um=0)
    task = OutletTask(
        ignorant, request, sources(request), (UNKNOWN, UNKNOWN), Chip(Flow(), DEVICE, 2.0), 1
    )
    assert task.outcome("t-1", GEOMETRY).split.robust < 0.1
    [known] = devices_of(verdicts(), task, 2)  # the second has no angles
    assert known.name == "t-1" and known.split.robust == 1.0
    assert known.basis[0].startswith("simulated in this array: decided")
