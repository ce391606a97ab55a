"""Laws of the search: known optimum, constraints, ranking, tolerance, verdict."""

import re
from itertools import product

import numpy as np
import pandas as pd
import pytest

from dldsim.analysis import surrogate
from dldsim.design.candidates import transition_geometries
from dldsim.design.task import violations
from dldsim.errors import DldsimError
from tests.analysis.made_outcomes import make_outcomes
from tests.design.known_surrogate import (
    CHIP,
    Known,
    ask,
    found,
    hill,
    people,
    regret_of,
    run,
    task_of,
)

OUTLETS = {"objective": "purity-recovery"}


def test_search_finds_what_the_grid_finds():
    designs, trials = found(Known(hill), ask(), seed=1, safety=2.0)
    grid = product(np.linspace(5, 10, 11), np.linspace(14, 22, 9), range(4, 13))
    best = max(0.3 * hill(r, g, n, 1.0, 7.5) for r, g, n in grid)
    first = designs.iloc[0]
    assert first["separation_deg"] > 0.97 * best
    assert first["periodicity"] == 8
    assert len(trials) == 80
    assert trials["separation_deg"].max() == pytest.approx(first["separation_deg"])


def test_same_seed_same_designs():
    a, b = (found(Known(hill), ask(trials=40), seed=7, safety=2.0)[0] for _ in range(2))
    assert a.equals(b)


def test_infeasible_geometry_is_never_ranked():
    """The separation grows towards the forbidden corner."""
    tempting = Known(lambda r, g, n, d, cell: d * (r - g + 30))
    designs, trials = found(tempting, ask(gap_um=(8, 22)), seed=2, safety=5.0)
    assert (designs["gap_um"] > designs["pillar_radius_um"] + 5).all()
    bad = trials[~trials["feasible"]]
    assert len(bad) > 5 and bad["separation_deg"].isna().all() and (bad["reason"] != "").all()
    assert (trials.loc[trials["feasible"], "reason"] == "").all()
    assert designs["gap_um"].iloc[0] - designs["pillar_radius_um"].iloc[0] < 5.5


def test_gap_must_pass_the_larger_cell():
    """Of discs without an index, edge on: the thickness of a red cell of 7.82 µm is 2.58 µm."""
    request = ask(radius_2_um=20)
    cells = people(request)
    width = cells[1].width_um
    assert width == pytest.approx(20 * 2.58 / 3.91, rel=0.01)
    widths = violations(request, cells, CHIP, 5.0, 13.0)
    assert widths["gap must pass the squeezed cells"] == pytest.approx(width - 13.0)
    tight = violations(request, cells, CHIP, 5.0, 7.0)
    assert tight["gap must exceed pillar radius + safety distance"] > 0
    thin = violations(request, cells, CHIP, 1.9, 13.0)
    assert thin["pillars must not be too slender"] > 0


def test_ranks_are_ordered_and_candidates_distinct():
    designs, _ = found(Known(hill), ask(candidates=6, tolerance_um=0.8), seed=3, safety=2.0)
    assert designs["rank"].tolist() == list(range(1, len(designs) + 1))
    assert (np.diff(designs["separation_deg"]) <= 0).all()
    for (_, a), (_, b) in product(designs.iterrows(), repeat=2):
        if a["rank"] < b["rank"] and a["periodicity"] == b["periodicity"]:
            apart = abs(a[["pillar_radius_um", "gap_um"]] - b[["pillar_radius_um", "gap_um"]])
            assert apart.max() > 0.8
    difference = (designs["angle_2_deg"] - designs["angle_1_deg"]).abs()
    assert np.allclose(difference, designs["separation_deg"])


def test_tolerance_of_a_plane_by_hand():
    """Separation 0.3 (r + 2 g): ± 0.5 µm on both is ± 0.45°."""
    plane = Known(lambda r, g, n, d, cell: d * (r + 2 * g))
    row = found(plane, ask(trials=20), seed=1, safety=2.0)[0].iloc[0]
    assert row["separation_tolerance_min_deg"] == pytest.approx(row["separation_deg"] - 0.45)
    assert row["separation_tolerance_max_deg"] == pytest.approx(row["separation_deg"] + 0.45)
    assert row["uncertainty_deg"] == pytest.approx(0.1 * 2**0.5)


def test_reversed_order_within_the_tolerance_is_negative():
    row = found(
        Known(lambda r, g, n, d, cell: d * (r - 7)),
        ask(trials=20, pillar_radius_um=(7.0, 7.3)),
        seed=1,
    )[0].iloc[0]
    assert row["separation_tolerance_min_deg"] < 0 < row["separation_deg"]


@pytest.mark.parametrize(
    "rmse, outside, words",
    [
        (0.1, 0.0, ["resolved"]),
        (20.0, 0.0, ["not resolved", "uncertainty"]),
        (0.1, 0.3, ["resolved", "extrapolated"]),
    ],
)
def test_verdict_is_honest(rmse, outside, words):
    plane = Known(lambda r, g, n, d, cell: d * (r + 2 * g), rmse, lambda r, g, n: outside)
    row = found(plane, ask(trials=20), seed=1, safety=2.0)[0].iloc[0]
    said = "; ".join([row["verdict"], *row["notes"]])
    assert all(word in said for word in words)
    assert row["verdict"].startswith(words[0])
    assert row["inside_training_domain"] == (outside == 0)


def test_sharp_optimum_is_called_not_robust():
    spike = Known(lambda r, g, n, d, cell: 10 * d * (abs(r - 7) < 0.2))
    row = found(spike, ask(), seed=1, safety=2.0)[0].iloc[0]
    assert row["separation_deg"] == pytest.approx(3) and row["verdict"].startswith("not robust")


def test_designs_inside_the_training_domain_come_first():
    """The separation grows outwards, but nothing is known beyond a gap of 18 µm."""
    tempting = Known(lambda r, g, n, d, cell: d * g, outside=lambda r, g, n: max(0.0, g - 18) / 8)
    designs, _ = found(tempting, ask(), seed=1, safety=2.0)
    inside = designs["inside_training_domain"].tolist()
    assert inside[0] and inside == sorted(inside, reverse=True)


@pytest.mark.parametrize(
    "changes, words",
    [
        ({"ca_1": 0.2}, ["cell type 1", "Ca = μU/k_s = 0.2", "0.3 to 0.9", "0.734 to 2.29 mm/s"]),
        ({"ca_2": 0.95}, ["cell type 2", "0.3 to 0.9"]),
        ({"velocity_mm_s": 1.0}, ["Ca = μU/k_s = 1", "velocities of 0.294 to 0.919 mm/s"]),
        ({"shape_1": "sphere"}, ["shape_1 = sphere was not learnt", "biconcave"]),
        ({"ca_2": 0.5}, ["both cell types", "Change"]),
        ({"gap_um": (4, 6)}, ["no geometry", "safety", "gap_um"]),
        ({"radius_1_um": 40.0, "height_um": 80.0}, ["no geometry", "squeezed"]),
        ({"radius_1_um": 40.0}, ["height_um = 20: cell type 1 needs", "higher channel"]),
        ({"tolerance_um": 5.0}, ["tolerance_um", "below 5", "pillar_radius_um = 5"]),
    ],
)
def test_impossible_requests_are_refused(changes, words):
    with pytest.raises(DldsimError) as error:
        found(Known(hill), ask(**changes), seed=1, safety=2.0)
    assert all(word in str(error.value) for word in words)


@pytest.mark.parametrize("ca_1", [0.2, 1.7])
def test_the_velocities_that_a_refusal_names_are_answered(ca_1):
    def search_at(velocity):
        ca_2 = 0.6 * 0.5 / velocity  # of the second type Ca is 0.6 at any velocity
        asked = ask(ca_1=ca_1, ca_2=ca_2, velocity_mm_s=velocity, trials=3)
        found(Known(hill), asked, seed=1, safety=2.0)

    with pytest.raises(DldsimError) as error:
        search_at(0.5)
    ends = re.search(r"velocities of (\S+) to (\S+) mm/s", str(error.value)).groups()
    for end, beyond in zip(map(float, ends), (0.99, 1.01), strict=True):
        search_at(end)
        with pytest.raises(DldsimError, match="cell type 1 .* velocities"):
            search_at(end * beyond)


@pytest.mark.parametrize(
    ("changes", "keys", "words"),
    [
        ({"pillar_aspect_ratio_max": 0.1}, "pillar_aspect_ratio_max", "Raise pillar_aspect"),
        ({"gap_um": (4, 5)}, "gap_um", "Raise the upper bound of gap_um"),
        ({"height_tolerance_um": 19.9}, "height_tolerance_um", "Lower it, or name a higher"),
        (OUTLETS | {"footprint_max_mm2": 0.01}, "footprint_max_mm2", "Raise footprint_max_mm2"),
        (OUTLETS | {"footprint_max_mm2": 0.16}, "footprint_max_mm2", "Raise footprint_max_mm2"),
    ],
)
def test_the_remedy_of_an_impossible_request_is_of_what_makes_it_so(changes, keys, words):
    with pytest.raises(DldsimError, match=words) as error:
        found(Known(hill), ask(trials=5, startup_trials=5, **changes), seed=1, safety=2.0)
    assert error.value.key == keys
    if "gap_um" not in changes:
        assert "gap_um upwards" not in str(error.value)


def test_unlucky_search_is_an_error_not_a_guess():
    with pytest.raises(DldsimError, match="none of 3 trials"):
        found(Known(hill), ask(gap_um=(5, 9), trials=3), seed=1, safety=3.99)


@pytest.mark.slow
def test_real_surrogate_separates_soft_from_stiff_and_small_from_large():
    """Cells of equal radius and of equal capillary number: both kinds of request."""
    fitted = surrogate.fit(make_outcomes(), seed=1)
    soft = ask(0.147, 0.0369, periodicity=(4, 10), trials=40)
    row = found(fitted, soft, seed=1, safety=2.0)[0].iloc[0]
    assert row["inside_training_domain"] and row["angle_1_deg"] > row["angle_2_deg"]
    heights = make_outcomes().assign(height_um=lambda t: 16.0 + 10 * (t.index % 2))
    tall = surrogate.fit(heights, seed=1)
    sizes = ask(0.1, 0.1, radius_1_um=6, radius_2_um=9, periodicity=(4, 10), trials=40)
    row = found(tall, sizes, seed=1, safety=2.0)[0].iloc[0]
    assert row["inside_training_domain"] and row["angle_2_deg"] > row["angle_1_deg"]
    # the same request with every length halved is the same device
    half = ask(
        0.1,
        0.1,
        radius_1_um=3,
        radius_2_um=4.5,
        height_um=10.0,
        periodicity=(4, 10),
        trials=40,
        pillar_radius_um=(2.5, 5),
        gap_um=(7, 11),
    )
    flow = CHIP.flow.model_copy(update={"height_um": 10.0})
    again = run(tall, half, CHIP._replace(safety_distance_um=1.0, flow=flow), 1).designs
    assert again.iloc[0]["separation_deg"] == pytest.approx(row["separation_deg"], rel=0.05)


def test_a_height_that_was_not_learnt_is_told_with_every_candidate():
    """The made-up outcomes have one height: R of 6 and 9 µm are other heights over R."""
    fitted = surrogate.fit(make_outcomes(), seed=1)
    sizes = ask(0.1, 0.1, radius_1_um=6, radius_2_um=7.5, periodicity=(4, 10), trials=20)
    designs, _ = found(fitted, sizes, seed=1)
    assert not designs["inside_training_domain"].any()
    for said in designs["notes"]:
        [why] = [note for note in said if note.startswith("extrapolated")]
        assert "height/R 3.33 of cell type 1 was not learnt (biconcave discs: Ca" in why
        assert "cell type 2" not in why


def test_designs_closer_than_their_uncertainty_share_a_rank():
    """σ_num of an angle 0.1°: of a separation 0.1 √2, of a difference of separations 0.2°."""
    plane = Known(lambda r, g, n, d, cell: d * (r + 2 * g), sigma=0.1)
    designs, _ = found(plane, ask(candidates=8, periodicity=(8, 8)), seed=1, safety=2.0)
    rows = designs.to_dict("records")
    assert designs["sigma_num_deg"].to_numpy() == pytest.approx(0.1 * 2**0.5)
    assert designs["uncertainty_deg"].to_numpy() == pytest.approx(0.1 * 2**0.5)
    leader = rows[0]
    for place, row in enumerate(rows):
        if leader["separation_deg"] - row["separation_deg"] >= 0.2:
            leader = row
            assert row["rank"] == place + 1
        assert row["rank"] == leader["rank"]
    shared = designs[designs["rank"].duplicated(keep=False)]
    assert 1 < len(set(designs["rank"])) < len(designs)
    assert all("not ranked against each other" in "".join(said) for said in shared["notes"])


def test_unstudied_uncertainty_is_said_and_ranks_as_before():
    designs, _ = found(Known(hill), ask(), seed=3, safety=2.0)
    assert designs["sigma_num_deg"].isna().all()
    assert all("numerical uncertainty not studied" in said for said in designs["notes"])
    assert designs["rank"].is_unique


def test_regret_of_a_known_hill():
    """Never negative, falls with the evaluations, and the finest grid finds the summit."""
    table = regret_of(Known(hill), ask(trials=40), CHIP._replace(safety_distance_um=2.0), seed=1)
    assert (table["regret_deg"] >= 0).all() and table["regret_deg"].min() == 0
    for _, part in table[table["method"] != "grid"].groupby(["method", "repeat"]):
        assert part["evaluations"].is_monotonic_increasing
        assert part["regret_deg"].is_monotonic_decreasing and part["time_s"].is_monotonic_increasing
    grid = table[table["method"] == "grid"].sort_values("evaluations")
    assert grid["best_deg"].iloc[-1] == pytest.approx(3.0, rel=1e-3)  # 0.3 × 10, at the summit
    assert grid["evaluations"].tolist() == [9 * k**2 for k in (3, 5, 9, 17, 33)]
    last = table[table["evaluations"] == 40].groupby("method")["regret_deg"].median()
    assert last["tpe"] < last["random"]


def test_regret_counts_only_what_may_be_built_and_is_known():
    """Beyond a gap of 18 µm nothing is known, and no pillar may exceed the gap less 5 µm."""
    tempting = Known(lambda r, g, n, d, cell: d * g, outside=lambda r, g, n: max(0.0, g - 18) / 8)
    table = regret_of(tempting, ask(trials=20), CHIP._replace(safety_distance_um=5.0), seed=1)
    assert table["best_deg"].max() <= 0.3 * (18 + 8 * 0.02) + 1e-9


def test_transition_arrays_are_near_one_and_apart():
    """The share of the bump displacement rises with P_r from 0 at 5 to 1 at 9 µm."""

    def ramp(r, g, n, d, cell):
        return np.degrees(np.arctan(np.clip((r - 5) / 4, 0, 1) / n))

    task = task_of(Known(ramp), ask(), CHIP, seed=1)
    known = pd.DataFrame({"pillar_radius_um": [7.0], "gap_um": [18.0], "periodicity": [8]})
    chosen = transition_geometries(task, known, 4)
    assert len(chosen) == 4
    assert all(6 <= c["pillar_radius_um"] <= 8 for c in chosen)
    assert all(abs(c["gap_um"] - 18) + abs(c["periodicity"] - 8) > 2 for c in chosen)
    assert len({tuple(c.values()) for c in chosen}) == 4
    flat = task_of(Known(lambda r, g, n, d, cell: 0 * r), ask(), CHIP, seed=1)
    assert transition_geometries(flat, known, 4) == []
