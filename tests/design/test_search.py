"""Laws of the search: known optimum, constraints, ranking, tolerance, verdict."""

from itertools import product

import numpy as np
import pandas as pd
import pytest

from dldsim.analysis import surrogate
from dldsim.analysis.domain import DOMAIN_TOLERANCE, Domain
from dldsim.config.design_sections import DesignRequest, Device
from dldsim.config.sections import Flow, Stiffness
from dldsim.design.candidates import transition_geometries
from dldsim.design.chip import Chip, Resistance
from dldsim.design.populations import flow_of, make_populations
from dldsim.design.search import regret, search
from dldsim.design.task import Task, violations
from dldsim.errors import DldsimError
from tests.analysis.made_outcomes import make_outcomes


class Known:
    """A surrogate with the interface of the real one and a formula for an angle [deg].

    The formula is asked with P_r, P_g, N_p, Ca and the cell's radius.
    """

    domains = {"biconcave": Domain(np.array([[0.1, 0.1, 2], [9, 9, 99]]), (0.3, 0.9), (0.1, 5))}
    card = {"numerical_uncertainty": {"share_by_mode": {}}}

    def __init__(self, angle, half=0.1, outside=lambda r, g, n: 0.0, sigma=None):
        self.angle, self.half, self.outside, self.sigma = angle, half, outside, sigma

    def predict(self, pillar_radius_um, gap_um, periodicity, cell):
        values = pillar_radius_um, gap_um, periodicity, cell.capillary_number, cell.radius_um
        return np.asarray(
            self.angle(
                *np.broadcast_arrays(*(np.atleast_1d(np.asarray(v, float)) for v in values))
            ),
            float,
        )

    def predict_interval(self, radius, gap, periodicity, cell, level=0.9):
        angle = self.predict(radius, gap, periodicity, cell)
        return angle - self.half, angle + self.half

    def inside_domain(self, radius, gap, periodicity, cell):
        return self.distance_outside(radius, gap, periodicity, cell) <= DOMAIN_TOLERANCE

    def sigma_num_deg(self, angle_deg, periodicity):
        return None if self.sigma is None else np.full(len(periodicity), self.sigma)

    def distance_outside(self, radius, gap, periodicity, cell):
        places = np.broadcast(*map(np.atleast_1d, (radius, gap, periodicity)))
        return np.array([self.outside(*at) for at in places])


CHIP = Chip(Flow(), Device(), 2.0)
SOFT = Stiffness(
    ks_uN_per_m=5.0,
    kb_pN_um=0.1,
    kal_uN_per_m=10.0,
    kag_uN_per_m=500.0,
    kv_Pa=900.0,
    kvisc_nN_s_per_m=1.5,
)


def people(request, surrogate=Known, flow=CHIP.flow):
    """Both cell types of a request without a calibration."""
    return make_populations(request, flow_of(request, flow), {"1": SOFT}, None, surrogate.domains)


def task_of(surrogate, request, chip=CHIP, seed=1, populations=None):
    populations = populations or people(request, surrogate)
    return Task(surrogate, request, populations, chip, seed)


def run(surrogate, request, chip=CHIP, seed=1, populations=None):
    return search(surrogate, request, populations or people(request, surrogate), chip, seed)


def regret_of(surrogate, request, chip=CHIP, seed=1):
    return regret(surrogate, request, people(request, surrogate), chip, seed)


def found(surrogate, request, seed, safety=2.0, **changes):
    """Candidates and trials of a search."""
    result = run(surrogate, request, CHIP._replace(safety_distance_um=safety, **changes), seed)
    return result.designs, result.trials


def hill(r, g, n, d, cell):
    """One smooth summit of the separation at P_r 7, P_g 17, N_p 8."""
    return 10 * d * np.exp(-((r - 7) ** 2) / 4 - (g - 17) ** 2 / 9 - (n - 8) ** 2 / 8)


def ask(ca_1=0.5, ca_2=0.8, **changes):
    """A request of two discs by their capillary numbers at 0.5 mm/s and 1.5 mPa·s."""
    return DesignRequest(
        **{
            "name": "test",
            "ks_1_uN_per_m": 0.75 / ca_1,
            "ks_2_uN_per_m": 0.75 / ca_2,
            "pillar_radius_um": (5, 10),
            "gap_um": (14, 22),
            "periodicity": (4, 12),
            "trials": 80,
            "objective": "separation",
        }
        | changes
    )


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
        ({"ca_1": 0.2}, ["cell type 1", "Ca = μU/k_s = 0.2", "0.3 to 0.9", "0.75 to 2.25 mm/s"]),
        ({"ca_2": 0.95}, ["cell type 2", "0.3 to 0.9"]),
        ({"velocity_mm_s": 1.0}, ["Ca = μU/k_s = 1", "velocities of 0.3 to 0.9 mm/s"]),
        ({"shape_1": "sphere"}, ["shape_1 = sphere was not learnt", "biconcave"]),
        ({"ca_2": 0.5}, ["both cell types", "Change"]),
        ({"gap_um": (4, 6)}, ["no geometry", "safety", "gap_um"]),
        ({"radius_1_um": 40.0}, ["no geometry", "squeezed"]),
    ],
)
def test_impossible_requests_are_refused(changes, words):
    with pytest.raises(DldsimError) as error:
        found(Known(hill), ask(**changes), seed=1, safety=2.0)
    assert all(word in str(error.value) for word in words)


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


# ----------------------------------------------------------------------------- robust objective


def test_robust_separation_of_a_line_by_hand():
    """Separation 0.3 g with ± 0.5 µm on the gap: nine of ten draws exceed 0.3 (g − 0.4)."""
    line = Known(lambda r, g, n, d, cell: d * g, half=0.0)
    task = task_of(line, ask(objective="robust", draws=4096), CHIP, seed=1)
    at = np.array([7.0]), np.array([16.0]), np.array([8])
    assert task.robust(*at)[0] == pytest.approx(0.3 * 15.6, abs=2e-3)
    # normal errors of both predictions, ± 0.5 at 90 %: the difference has σ = 0.43
    noisy = task_of(Known(lambda r, g, n, d, cell: 10 * d, half=0.5), task.request, CHIP, seed=1)
    assert noisy.robust(*at)[0] == pytest.approx(3 - 1.2816 * 2**0.5 * 0.5 / 1.6449, abs=0.02)


def test_spread_of_the_cells_counts():
    """θ = 10 ln Ca: the second cell's ± 0.05 of ln k_s is ± 0.5° on a separation of 4.05°."""
    line = Known(lambda r, g, n, d, cell: 10 * np.log(d), half=0.0)
    request = ask(0.4, 0.6, objective="robust", draws=4096, tolerance_um=0)
    first, second = people(request)
    ks = second.stiffness.ks_uN_per_m
    wide = [first, second._replace(ks_low=ks * np.exp(-0.05), ks_high=ks * np.exp(0.05))]
    at = np.array([7.0]), np.array([16.0]), np.array([8])
    wanted = 10 * np.log(1.5)
    task = task_of(line, request, populations=wide)
    assert task.robust(*at)[0] == pytest.approx(wanted - 1.2816 * 0.5, abs=0.02)
    # one-sided: only softer cells, of larger Ca
    softer = [first, second._replace(ks_low=ks * np.exp(-0.05))]
    assert task_of(line, request, populations=softer).robust(*at)[0] == pytest.approx(wanted)


def test_draws_beyond_what_was_learnt_are_taken_at_its_edge():
    request = ask(0.31, 0.6, draws=512)
    first, second = people(request)
    wide = [first._replace(ks_high=first.stiffness.ks_uN_per_m * 2), second]
    drawn = task_of(Known(hill), request, populations=wide).drawn_cell(0).capillary_number
    assert drawn.min() == pytest.approx(0.3) and drawn.max() == pytest.approx(0.31)


def test_intervals_of_angles_span_the_interval_of_ca():
    """θ = 10 Ca ± 0.1°, Ca 0.5 to 0.6 and, cut where nothing is known, 0.8 to 0.9."""
    line = Known(lambda r, g, n, d, cell: 10 * d)
    first, second = people(ask())
    wide = [first._replace(ks_low=0.75 / 0.6), second._replace(ks_low=0.75 / 1.5)]
    designs = run(line, ask(trials=20), populations=wide).designs
    row = designs.iloc[0]
    for i, (low, angle, high) in enumerate(((4.9, 5.0, 6.1), (7.9, 8.0, 9.1)), start=1):
        found = [row[f"angle_{i}_{side}deg"] for side in ("low_", "", "high_")]
        assert found == pytest.approx([low, angle, high])


def test_robust_search_avoids_the_sharp_optimum():
    """A summit of 3° narrower than the tolerance, and a plain of 1.5°."""

    def landscape(r, g, n, d, cell):
        return d * np.where(np.abs(r - 7) < 0.2, 10.0, np.where(r > 8, 5.0, 0.0))

    wants = {
        name: ask(objective=name, trials=150, tolerance_um=0.6) for name in ("separation", "robust")
    }
    best = {
        name: found(Known(landscape, half=0.01), want, seed=1)[0].iloc[0]
        for name, want in wants.items()
    }
    assert best["separation"]["separation_deg"] == pytest.approx(3.0)
    assert best["robust"]["separation_deg"] == pytest.approx(1.5)
    assert best["robust"]["robust_separation_deg"] == pytest.approx(1.5, abs=0.1)


def test_an_open_order_is_no_reason_to_choose_no_separation():
    """The error exceeds every separation, most of all where there is none at all."""

    def landscape(r, g, n, d, cell):
        return d * (r - 5)

    class Unsure(Known):
        def predict_interval(self, radius, gap, periodicity, cell, level=0.9):
            angle = self.predict(radius, gap, periodicity, cell)
            return angle - 1 - (radius - 5), angle + 1 + (radius - 5)

    designs, _ = found(Unsure(landscape), ask(objective="robust"), seed=1)
    assert designs.iloc[0]["robust_separation_deg"] < 0
    assert designs.iloc[0]["pillar_radius_um"] > 9


def test_probability_of_another_mode():
    """The first cell bumps above P_r = 7; at 7 with ± 0.5, half of the draws are below."""

    def step(r, g, n, d, cell):
        return np.where((r > 7) & (d < 0.7), np.degrees(np.arctan(1 / n)), 0.0)

    request = ask(pillar_radius_um=(6.99, 7.01), draws=1024, trials=10)
    row = found(Known(step, half=0.0), request, seed=1)[0].iloc[0]
    assert row["mode_change_probability"] == pytest.approx(0.5, abs=0.03)


# -------------------------------------------------------------------------------- grid, tolerances


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


# ------------------------------------------------------------------------------ length and pressure


def make_flows(height=20.0):
    """Arrays whose drag is a power of gap and pitch."""
    places = list(product((5.0, 7.0, 9.0), (12.0, 16.0, 20.0), (4, 8, 12)))
    frame = pd.DataFrame(places, columns=["pillar_radius_um", "gap_um", "periodicity"])
    pitch = 2 * frame["pillar_radius_um"] + frame["gap_um"]
    drag = 3e-3 * pitch**2 * (frame["gap_um"] / pitch) ** -2
    return frame.assign(drag_over_mu_U=drag, height_um=height, drive="no-lateral-flux")


def test_resistance_of_arrays_on_one_line_stays_sane_off_it():
    # The source's arrays, P_g = P_r + 10 µm: the quadratic is not decided across that line.
    radius = np.repeat([4.0, 6.0, 8.0, 10.0, 11.0, 12.0], 3)
    flows = pd.DataFrame(
        {"pillar_radius_um": radius, "gap_um": radius + 10, "periodicity": np.tile([4, 8, 12], 6)}
    )

    def drag(radius, gap):
        pitch = 2 * radius + gap
        return 3e-3 * pitch**2 * (gap / pitch) ** -2

    noise = 1 + 0.01 * np.cos(np.arange(len(flows)) ** 2)
    flows = flows.assign(
        drag_over_mu_U=noise * drag(radius, radius + 10), height_um=20.0, drive="no-lateral-flux"
    )
    resistance = Resistance(flows)
    assert "larger elsewhere" in resistance.basis
    # Nothing is known there but the order of magnitude; the undamped fit said 1e-90 to infinity.
    radius, gap = np.array([5.0, 10.0]), np.array([20.0, 13.0])
    ratio = resistance.drag_over_mu_U(radius, gap, [8, 8]) / drag(radius, gap)
    assert np.all((ratio > 0.1) & (ratio < 10))
    assert "larger elsewhere" not in Resistance(make_flows()).basis


def test_pressure_drop_by_hand():
    """Δp = drag μ U L/λ²: 75 · 1.5e-3 Pa s · 0.5e-3 m/s · 4e-3 m / (25e-6 m)² = 360 Pa."""
    resistance = Resistance(make_flows())
    assert resistance.error < 1e-9
    assert resistance.drag_over_mu_U(6.0, 13.0, 6)[0] == pytest.approx(3e-3 * 25**4 / 13**2)
    assert CHIP.pressure_kPa(75.0, 25.0, 4.0) == pytest.approx(0.36)
    # 0.5 mm/s through 2 mm × 20 µm
    assert CHIP.throughput_uL_per_h == pytest.approx(0.5 * 2 * 0.02 * 3600)


def test_length_parts_the_cells():
    task = task_of(Known(lambda r, g, n, d, cell: 10 * d), ask(lateral_separation_um=100), CHIP, 1)
    length = task.length_mm(np.array([5.0]), np.array([8.0]))
    assert length[0] * 1e3 * (np.tan(np.radians(8)) - np.tan(np.radians(5))) == pytest.approx(100)
    assert np.isinf(task.length_mm(np.array([5.0]), np.array([5.0])))[0]


def test_pressure_limit_is_kept():
    """Narrow gaps separate best and cost most."""
    tempting = Known(lambda r, g, n, d, cell: d * (20 - g / 10))
    chip = CHIP._replace(resistance=Resistance(make_flows()))
    thin = {"pillar_radius_um": (5, 5.2)}
    free = run(tempting, ask(**thin), chip, 1).designs.iloc[0]
    most = 0.85 * free["pressure_drop_kPa"]
    limited = run(tempting, ask(**thin, pressure_max_kPa=most), chip, 1)
    assert (limited.designs["pressure_drop_kPa"] <= most).all()
    assert limited.designs.iloc[0]["gap_um"] > free["gap_um"]
    assert limited.trials["reason"].str.contains("pressure").any()


def test_pressure_limit_needs_flows():
    with pytest.raises(DldsimError, match="flows.parquet"):
        run(Known(hill), ask(pressure_max_kPa=1.0), CHIP, 1)
    designs, _ = found(Known(hill), ask(trials=20), seed=1)
    assert designs["pressure_drop_kPa"].isna().all()
    assert (designs["pressure_basis"] == "not known: there is no table of flows").all()


def test_flows_of_several_heights_are_refused():
    flows = make_flows()
    flows.loc[3, "height_um"] = 30.0
    with pytest.raises(DldsimError, match="height_um"):
        Resistance(flows)


# ---------------------------------------------------------------------------------- transitions


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


# ----------------------------------------------------------------------------------- by the outlets


class Outlets(Known):
    """Cells of the second type bump, those of the first do in thick pillars; how sure that is
    depends on the gap."""

    card = {
        "conformal": {"scores": {"biconcave": [[0.0]] * 99}, "range": [0.0, 1.0]},
        "numerical_uncertainty": {"share_by_mode": {}},
    }

    def __init__(self):
        super().__init__(lambda r, g, n, ca, size: np.degrees(np.arctan(self.law(r, ca) / n)))

    @staticmethod
    def law(r, ca):
        return np.where(ca > 0.6, 1.0, np.clip((r - 6) / 4, 0, 1))

    def share(self, radius, gap, periodicity, cell):
        ca = np.broadcast_to(cell.capillary_number, np.shape(radius))
        return self.law(np.asarray(radius), ca)

    def predict_interval(self, radius, gap, periodicity, cell, level=0.9):
        angle = self.predict(radius, gap, periodicity, cell)
        half = np.where(np.asarray(gap) > 18, 9.0, 0.1)
        return angle - half, angle + half


def by_outlets(**changes):
    given = {"objective": "purity-recovery", "trials": 40, "candidates": 4, "draws": 8, "cells": 32}
    return ask(**given | {"tolerance_um": 0.2} | changes)


def test_outlets_are_an_objective():
    designs, trials = found(Outlets(), by_outlets(gap_um=(14, 17)), seed=1)
    best = designs.iloc[0]
    assert best["objective"] == "purity-recovery" and best["pillar_radius_um"] < 7
    assert best["value"] == pytest.approx(1.0) and not best["mode_open"]
    assert trials["value"].max() <= 1
    thick = trials[trials["feasible"] & (trials["pillar_radius_um"] > 9.7)]
    assert (thick["value"] < 0.9).all()
    equal = designs[designs["rank"] == 1]
    assert len(equal) > 1 and "equally good outlets" in str(best["notes"])


def test_an_open_mode_is_ranked_behind_by_outlets_and_marked_always():
    designs, _ = found(Outlets(), by_outlets(candidates=40), seed=1)
    assert designs["mode_open"].tolist() == (designs["gap_um"] > 18).tolist()
    assert (np.diff(designs["mode_open"].astype(int)) >= 0).all()
    assert set(designs["mode_open"]) == {False, True}
    assert "a mode is open" in str(designs[designs["mode_open"]]["notes"].iloc[0])
    other = found(Outlets(), by_outlets(candidates=40, objective="separation"), seed=1)[0]
    assert (np.diff(other["separation_deg"]) <= 0).all() and other["mode_open"].any()


def test_a_grid_looks_at_the_outlets_of_the_largest_separations():
    request = by_outlets(sampler="grid", grid_steps=13, periodicity=(6, 10))
    designs, trials = found(Outlets(), request, seed=1)
    looked_at = trials["value"].notna()
    assert looked_at.sum() == 300 < trials["feasible"].sum()
    assert (
        trials["separation_deg"][looked_at].min()
        >= trials["separation_deg"][trials["feasible"] & ~looked_at].max()
    )
    assert designs["value"].notna().all()


def test_footprint_and_sample_flow_are_limits():
    _, trials = found(Outlets(), by_outlets(footprint_max_mm2=0.5), seed=1)
    short = trials[trials["reason"].str.contains("array must hold a period")]
    period = (2 * short["pillar_radius_um"] + short["gap_um"]) * short["periodicity"]
    assert len(short) and (period > 250).all()
    with pytest.raises(DldsimError, match="sample_min_uL_per_h = 99"):
        found(Outlets(), by_outlets(sample_min_uL_per_h=99.0), seed=1)


def test_a_gap_passes_all_but_the_largest_cell_in_a_hundred():
    request = ask(radius_cv_2=0.2)
    alike, scattered = (task_of(Known(hill), r) for r in (ask(), request))
    widths = [task.populations[1].width_um for task in (alike, scattered)]
    assert widths[1] / widths[0] == pytest.approx(1 + 0.2 * 2.326, rel=0.01)
