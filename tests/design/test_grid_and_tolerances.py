"""Searches on a grid, tolerances of candidates, slices through the best one."""

import numpy as np
import pandas as pd
import pytest

from dldsim.design.candidates import transition_geometries
from tests.design.known_surrogate import CHIP, Known, ask, found, hill, people, run, task_of


def test_grid_and_tpe_agree_on_a_hill():
    best = {
        sampler: found(Known(hill), ask(sampler=sampler), seed=1)[0].iloc[0]
        for sampler in ("tpe", "grid")
    }
    # the nearest of 17 values to the summit's P_r is 6.88 µm
    assert best["grid"]["separation_deg"] == pytest.approx(3 * np.exp(-(0.12**2) / 4), rel=1e-6)
    assert best["tpe"]["separation_deg"] == pytest.approx(3.0, rel=0.03)
    trials = found(Known(hill), ask(sampler="grid", grid_steps=5), seed=1)[1]
    assert len(trials) == 5 * 5 * 9


def test_grid_tells_what_matters():
    gap_only = run(Known(lambda r, g, n, d, cell: d * g), ask(sampler="grid"), CHIP, 1)
    shares = gap_only.importance.set_index("parameter")["importance"]
    assert shares["gap_um"] == pytest.approx(1.0) and shares["periodicity"] < 1e-9
    assert "variance" in gap_only.importance["evaluator"].iloc[0]
    ped = run(Known(lambda r, g, n, d, cell: d * g), ask(), CHIP, 1).importance
    assert ped.set_index("parameter")["importance"].idxmax() == "gap_um"


def test_tolerances_of_a_plane_by_hand():
    """Separation 0.3 (r + 2 g): an edge that moves out by 0.5 takes 1 µm from the gap."""
    plane = Known(lambda r, g, n, d, cell: d * (r + 2 * g))
    request = ask(trials=20)
    first, second = people(request)
    wide = [first._replace(ks_low=0.75 / 0.51, ks_high=0.75 / 0.48), second]
    result = run(plane, request, populations=wide)
    design = result.designs.iloc[0]
    table = result.tolerances[result.tolerances["design"] == 1].set_index(["parameter", "offset"])
    change = table["separation_deg"] - design["separation_deg"]
    assert change["pillar_radius_um", 0.5] == pytest.approx(0.15)
    assert change["gap_um", -0.5] == pytest.approx(-0.3)
    assert change["edge_um", 0.5] == pytest.approx(0.15 - 0.6)
    size = design["pillar_radius_um"] + 2 * design["gap_um"]
    of_ks = change["ks_1_uN_per_m"]
    assert of_ks.to_numpy() == pytest.approx([-0.01 * size, 0.02 * size])  # Ca 0.51 and 0.48
    assert of_ks.index.tolist() == pytest.approx([0.75 / 0.51 - 1.5, 0.75 / 0.48 - 1.5])
    assert table["sensitivity_deg_per_unit"]["gap_um", 0.5] == pytest.approx(0.6)
    assert "ks_2_uN_per_m" not in table.index.get_level_values(0)  # no interval


def test_slices_pass_through_the_best_candidate():
    result = run(Known(lambda r, g, n, d, cell: d * (r + 2 * g + n)), ask(trials=20), CHIP, 1)
    best = result.designs.iloc[0]
    part = result.slices[result.slices["x_parameter"] == "periodicity"].groupby("y_parameter")
    for name, table in part:
        other = {"gap_um": "pillar_radius_um", "pillar_radius_um": "gap_um"}[name]
        weight = {"pillar_radius_um": 1, "gap_um": 2}
        expected = table["x"] + weight[name] * table["y"] + weight[other] * best[other]
        assert table["difference_deg"].to_numpy() == pytest.approx(0.3 * expected.to_numpy())
        assert sorted(set(table["x"])) == list(range(4, 13))


FIXED = [
    {"gap_um": (16, 16)},
    {"pillar_radius_um": (7, 7), "periodicity": (8, 8)},
    {"pillar_radius_um": (7, 7), "gap_um": (16, 16), "periodicity": (8, 8)},
]


@pytest.mark.parametrize("sampler", ["tpe", "grid"])
@pytest.mark.parametrize("bounds", FIXED)
def test_fixed_dimensions_have_no_slices(bounds, sampler):
    request = ask(**bounds, sampler=sampler, trials=20)
    result = run(Known(hill), request, CHIP, 1)
    shown = {*result.slices["x_parameter"], *result.slices["y_parameter"]}
    assert not shown & set(bounds) and len(shown) == (0 if len(bounds) > 1 else 2)
    for name, (value, _) in bounds.items():
        assert (result.designs[name] == value).all()
    places = result.slices[["x_parameter", "y_parameter", "x", "y"]]
    assert not places.duplicated().any() and "edge" not in str(result.designs["notes"].tolist())
    if sampler == "grid":
        assert not result.trials[["pillar_radius_um", "gap_um", "periodicity"]].duplicated().any()


def test_arrays_near_a_transition_are_apart_where_a_dimension_is_fixed():
    """A fixed gap that differs from all known ones must not drown the other distances."""

    def ramp(r, g, n, d, cell):
        return np.degrees(np.arctan(np.clip((r - 5) / 4, 0, 1) / n))

    known = pd.DataFrame({"pillar_radius_um": [7.0], "gap_um": [18.0], "periodicity": [12]})
    task = task_of(Known(ramp), ask(gap_um=(16, 16)), CHIP, seed=1)
    assert transition_geometries(task, known, 1)[0]["periodicity"] == 4


def test_a_best_candidate_on_a_bound_is_flagged():
    rising = found(Known(lambda r, g, n, d, cell: d * (g + n)), ask(), seed=1)[0].iloc[0]
    [said] = [note for note in rising["notes"] if note.startswith("on the edge of the search (")]
    assert "(gap_um = " in said and "periodicity = 12, highest bound 12" in said
    inside = found(Known(hill), ask(), seed=1)[0].iloc[0]
    assert "edge" not in str(inside["notes"])
