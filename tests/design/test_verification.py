"""Laws of the verification: what is simulated, compared, learnt from, and when it ends."""

import json
import math

import numpy as np
import pandas as pd
import pytest

from dldsim.config.design_sections import Verification as Budget
from dldsim.config.identifiers import checked_outcome_id
from dldsim.design.rounds import verify, with_outcomes
from dldsim.design.verified import plain
from dldsim.errors import DldsimError
from dldsim.experiments.migration import mode_of
from dldsim.tables.parquet import write_table
from tests.design.known_surrogate import CHIP, Known, ask, people

OUTCOMES = pd.DataFrame(
    {
        "outcome_id": ["r1", "r2"],
        "pillar_radius_um": [5.0, 9.0],
        "gap_um": [14.0, 20.0],
        "periodicity": [4, 12],
        "migration_angle_deg": [1.0, 2.0],
        "capillary_number": [0.5, 0.8],
    }
)
REQUEST = ask(trials=25, startup_trials=10, height_tolerance_um=1.0)
PEOPLE = people(REQUEST)


def summit(r, g, n, d, cell):
    """Best at the thickest pillar: up to 4.5° of difference."""
    return 3 * d * (r - 5)


def flat(r, g, n, d, cell):
    return 3 * d + 0 * r


class Nature:
    """Answers as a formula does, at every setting, and counts the outcomes."""

    def __init__(self, angle, sigma=0.05, status="decided"):
        self.angle, self.sigma, self.status, self.asked = angle, sigma, status, []

    def __call__(self, geometry, population, height_um, finer=False):
        self.asked.append((geometry, population.number, height_um))
        angle = float(
            self.angle(
                geometry.pillar_radius_um,
                geometry.gap_um,
                geometry.periodicity,
                population.capillary_number,
                population.radius_um,
            )
        )
        angle += 0.1 * (height_um - 20.0) * population.number
        known = self.status not in ("stuck", "failed")
        return {
            "outcome_id": f"outcome-{len(self.asked)}",
            **geometry.model_dump(),
            "migration_angle_deg": angle if known else None,
            "capillary_number": population.capillary_number,
            "sigma_num_deg": self.sigma if known else None,
            "mode_open": False if known else None,
            "mode": mode_of(angle, geometry.row_shift_fraction) if known else "none",
            "status": self.status,
            "stop_reason": "why",
            "wall_time_s": 2.0,
            "angle_spread_deg": 0.0,
            "spacing_um": 0.9 if finer else 1.25,
            "rows_in_domain": 2 if finer else 1,
            "lanes_in_domain": 2,
            "lag_number": 0.1,
        }


def check(surrogate, nature, fit=None, request=REQUEST, chip=CHIP, glance=None, **budget):
    none = {"height_runs": False, "transition_geometries": 0, "finer_designs": 0}
    budget = Budget(**(none | budget))
    learnt = fit or (lambda outcomes, seed: surrogate)
    cells = PEOPLE, nature, 1
    return verify(surrogate, OUTCOMES, request, chip, budget, *cells, fit=learnt, glance=glance)


def differences(verdicts):
    return verdicts.verifications[verdicts.verifications["population"] == "difference"]


def test_a_true_prediction_is_confirmed_and_ends_the_rounds():
    verdicts = check(Known(summit), Nature(summit), designs_per_round=2, rounds=5, finer_designs=1)
    table = differences(verdicts)
    assert table["role"].tolist() == ["design", "design", "finer"]
    assert table["round"].tolist() == [1] * 3
    assert table["agrees"].tolist() == [True, True, None]  # the surrogate had learnt from it
    best = verdicts.designs.iloc[0]
    assert best["separation_finer_deg"] == pytest.approx(best["separation_deg"])
    assert pd.isna(verdicts.designs["separates"].iloc[1])  # only the best was confirmed
    assert (best["stop"], best["stopped"]) == ("confirmed", "round 1: predictions confirmed")
    assert best["separates"] and "separates by" in best["verdict"]
    assert "prediction confirmed" in best["verdict"]
    at_setting = verdicts.verifications.query("role == 'design'")
    rows = at_setting.set_index(["array", "population"])
    for array in (1, 2):
        assert rows["simulated_deg"][array, "difference"] == pytest.approx(
            rows["simulated_deg"][array, "2"] - rows["simulated_deg"][array, "1"]
        )
        assert rows["sigma_num_deg"][array, "difference"] == pytest.approx(0.05 * math.sqrt(2))
    assert verdicts.designs["separation_deg"].is_monotonic_decreasing


class FirstIsOpen(Nature):
    """The first array simulated is undecided with the larger difference, within σ_num; ``denied``:
    on a finer lattice cells part nowhere."""

    def __init__(self, angle, denied=False):
        super().__init__(angle)
        self.denied = denied

    def __call__(self, geometry, population, height_um, finer=False):
        row = super().__call__(geometry, population, height_um, finer)
        if finer and self.denied:
            return row | {"migration_angle_deg": 1.0, "mode": "mixed"}
        first = self.first = getattr(self, "first", geometry)
        if geometry != first:
            return row
        angle = row["migration_angle_deg"]
        bounds = {"angle_low_deg": -90.0, "angle_high_deg": 90.0, "mode": "none"}
        return row | bounds | {"status": "undecided", "migration_angle_deg": angle * 1.001}


def test_a_decided_design_goes_before_an_open_one_of_the_same_rank():
    nature = FirstIsOpen(summit)
    verdicts = check(Known(summit), nature, designs_per_round=2, rounds=1, finer_designs=1)
    designs = verdicts.designs
    assert designs["rank"].tolist() == [1, 1]
    assert designs["separation_deg"].iloc[0] < designs["separation_deg"].iloc[1]
    assert designs["array"].tolist() == [2, 1]
    assert designs["separates"].tolist() == [True, None]
    finer = verdicts.verifications.query("role == 'finer'")
    assert set(finer["array"]) == {2}


def test_a_design_that_the_finer_lattice_denies_goes_behind_an_open_one_of_the_same_rank():
    nature = FirstIsOpen(summit, denied=True)
    verdicts = check(Known(summit), nature, designs_per_round=2, rounds=1, finer_designs=1)
    designs = verdicts.designs
    assert designs["rank"].tolist() == [1, 1]
    assert designs["array"].tolist() == [1, 2]
    assert designs["separates"].tolist() == [None, False]


@pytest.mark.parametrize("alike", [True, False])
def test_cells_that_go_alike_from_one_place_on_the_finer_lattice_need_no_other(alike):
    nature, first = Nature(summit), Nature(summit)
    asked = []

    def glance(geometry, population, height_um, finer):
        row = first(geometry, population, height_um, finer)
        asked.append(population.number)
        return row | ({"migration_angle_deg": 9.46, "mode": "bump"} if alike else {})

    found = check(
        Known(summit), nature, glance=glance, rounds=1, designs_per_round=1, finer_designs=1
    )
    assert asked == [1, 2]
    assert len(nature.asked) == (2 if alike else 4)
    best = found.designs.iloc[0]
    assert bool(best["separates"]) is not alike
    assert ("but 0.00° at spacing" in best["verdict"]) is alike


def test_a_missed_prediction_is_learnt_from():
    """Nature knows no summit there; the refitted surrogate does not either."""
    seen = []

    def other(r, g, n, d, cell):
        return 3 * d * (20 - g)

    def fit(outcomes, seed):
        seen.append(len(outcomes))
        return Known(other)

    nature = Nature(other)
    verdicts = check(Known(summit), nature, fit, designs_per_round=1, rounds=4)
    table = differences(verdicts)
    assert table["agrees"].tolist() == [False, True]
    assert table["verdict"].iloc[0].startswith("prediction missed by")
    assert table["gap_um"].iloc[1] < 15  # where the refitted surrogate looks
    assert seen == [len(OUTCOMES) + 2, len(OUTCOMES) + 4]
    assert set(verdicts.outcomes["outcome_id"]) == {"r1", "r2", *verdicts.rows}
    assert verdicts.designs["round"].iloc[0] == 2


def test_candidates_simulated_before_end_the_rounds():
    """A surrogate that learns nothing proposes the same arrays again."""
    request = ask(sampler="grid", grid_steps=5)
    verdicts = check(Known(summit), Nature(flat), request=request, designs_per_round=1, rounds=3)
    assert len(differences(verdicts)) == 1
    assert verdicts.designs["stop"].iloc[0] == "known"
    assert "have been simulated before" in verdicts.designs["stopped"].iloc[0]


def test_budget_is_never_exceeded():
    nature = Nature(flat)
    verdicts = check(
        Known(summit), nature, rounds=9, designs_per_round=3, outcomes_max=5, height_runs=True
    )
    assert len(nature.asked) == 4
    assert verdicts.designs["stop"].iloc[0] == "budget"
    assert verdicts.designs["stopped"].iloc[0] == "round 1: budget of 5 outcomes spent"


def test_an_interval_that_includes_zero_confirms_nothing_and_the_rounds_go_on():
    vague = Known(summit, half=20.0)
    verdicts = check(vague, Nature(summit), rounds=2, designs_per_round=1)
    table = differences(verdicts)
    assert table["agrees"].tolist() == [None, None]
    assert table["verdict"].str.startswith("prediction uninformative: its interval, -").all()
    assert "prediction confirmed" not in " ".join(verdicts.designs["verdict"])
    assert verdicts.designs["stop"].iloc[0] == "rounds"
    assert verdicts.designs["stopped"].iloc[0] == "2 rounds done"
    missed = differences(check(vague, Nature(lambda r, g, n, d, cell: 200 * d), rounds=1))
    assert missed["agrees"].tolist() == [False, False]  # that much says even a wide interval


def test_a_separation_within_the_numerical_uncertainty_is_none():
    verdicts = check(
        Known(summit),
        Nature(lambda r, g, n, d, cell: 0.2 * d, sigma=0.5),
        rounds=1,
        designs_per_round=1,
    )
    best = verdicts.designs.iloc[0]
    assert not best["separates"] and best["verdict"].startswith("does not separate")
    unknown = check(Known(summit), Nature(summit, sigma=None), rounds=1, designs_per_round=1)
    best = unknown.designs.iloc[0]
    assert best["separates"] is None and "not studied" in best["verdict"]


def test_a_cell_that_clogs_is_a_result():
    verdicts = check(
        Known(summit),
        Nature(summit, status="stuck"),
        rounds=1,
        designs_per_round=1,
        height_runs=True,
    )
    table = differences(verdicts)
    assert table["agrees"].tolist() == [None]
    best = verdicts.designs.iloc[0]
    assert best["verdict"] == "no separation measured: why" and pd.isna(best["length_mm"])


def test_a_run_that_cannot_start_is_told_and_not_learnt_from():
    def refuse(geometry, population, height_um, finer=False):
        raise DldsimError("the cell does not fit")

    verdicts = check(Known(summit), refuse, rounds=1, designs_per_round=1)
    assert verdicts.designs["verdict"].iloc[0] == "no separation measured: the cell does not fit"
    assert len(verdicts.outcomes) == len(OUTCOMES)


def test_a_height_that_cannot_start_leaves_the_design_as_it_is():
    nature = Nature(summit)

    def refuse(geometry, population, height_um, finer=False):
        if height_um < 20:
            raise DldsimError("the cell does not fit")
        found = nature(geometry, population, height_um, finer)
        other = None if height_um == 20 else height_um
        return found | {"outcome_id": checked_outcome_id(geometry, population.name, finer, other)}

    verdicts = check(Known(summit), refuse, rounds=1, designs_per_round=1, height_runs=True)
    best = verdicts.designs.iloc[0]
    assert best["separation_deg"] > 0 and pd.isna(best["separation_low_height_deg"])
    status = {name: row["status"] for name, row in verdicts.rows.items()}
    assert sorted(status.values()) == ["decided"] * 4 + ["failed"] * 2
    assert all(("-h19000" in name) == (s == "failed") for name, s in status.items())


def test_what_an_outcome_does_not_know_is_null_in_the_table():
    """The settled row of a campaign whose outcomes all settled is a whole number."""
    known = OUTCOMES.assign(settled_row=[3, 4])
    row = {name: known[name].iloc[0].item() for name in known if name != "outcome_id"}
    rows = {"a": row | {"outcome_id": "a", "settled_row": None, "status": "undecided"}}
    assert with_outcomes(known, rows)["settled_row"].isna().tolist() == [False, False, True]


def test_nothing_is_compared_outside_the_training_geometries():
    outside = Known(summit, outside=lambda r, g, n: 1.0)
    verdicts = check(outside, Nature(flat), rounds=1, designs_per_round=1)
    assert verdicts.verifications["agrees"].isna().all()
    assert verdicts.verifications["verdict"].str.startswith("not compared").all()


def test_the_opposite_order_is_told():
    verdicts = check(
        Known(summit),
        Nature(lambda r, g, n, d, cell: -3 * d * (r - 5)),
        rounds=1,
        designs_per_round=1,
    )
    assert "in the opposite order" in verdicts.designs["verdict"].iloc[0]
    assert (verdicts.designs["separation_deg"] > 0).all()


def test_the_best_design_is_simulated_at_both_heights():
    """The formula moves cell 1 by 0.1° and cell 2 by 0.2° for each µm of height."""
    nature = Nature(summit)
    verdicts = check(Known(summit), nature, rounds=1, designs_per_round=2, height_runs=True)
    best = verdicts.designs.iloc[0]
    assert best["separation_low_height_deg"] == pytest.approx(best["separation_deg"] - 0.1)
    assert best["separation_high_height_deg"] == pytest.approx(best["separation_deg"] + 0.1)
    heights = verdicts.verifications[verdicts.verifications["role"] == "height"]
    assert sorted(set(heights["height_um"])) == [19.0, 21.0]
    # predicted at their own height, which the formula of the surrogate does not know
    difference = heights[heights["population"] == "difference"]
    assert difference["verdict"].str.startswith("prediction").all()
    assert len(verdicts.outcomes) == len(OUTCOMES) + 8  # and learnt from, like all others
    assert verdicts.designs["separation_low_height_deg"].iloc[1:].isna().all()


def test_runs_near_a_transition_are_learnt_from_but_are_no_designs():
    def ramp(r, g, n, d, cell):
        return np.degrees(np.arctan(np.clip((r - 5) / 4 * d, 0, 1) / n))

    nature = Nature(ramp)
    verdicts = check(Known(ramp), nature, rounds=1, designs_per_round=1, transition_geometries=2)
    roles = differences(verdicts)["role"].tolist()
    assert roles == ["design", "transition", "transition"]
    assert len(verdicts.designs) == 1 and len(verdicts.outcomes) == len(OUTCOMES) + 6


def test_pressure_and_length_of_a_design_by_hand():
    def resistance(geometry):
        return {"permeability_over_pitch2": 0.01, "drag_over_mu_U": 100.0}

    budget = Budget(
        rounds=1, designs_per_round=1, transition_geometries=0, height_runs=False, finer_designs=0
    )
    verdicts = verify(
        Known(summit),
        OUTCOMES,
        REQUEST,
        CHIP,
        budget,
        PEOPLE,
        Nature(summit),
        1,
        fit=lambda outcomes, seed: Known(summit),
        resistance=resistance,
    )
    best = verdicts.designs.iloc[0]
    slopes = np.tan(np.radians([best["angle_1_deg"], best["angle_2_deg"]]))
    assert best["length_mm"] == pytest.approx(0.1 / (slopes[1] - slopes[0]))
    pitch = 2 * best["pillar_radius_um"] + best["gap_um"]
    assert best["pressure_drop_kPa"] == pytest.approx(
        100 * 1.5 * 0.5 * best["length_mm"] / pitch**2
    )
    assert best["permeability_over_pitch2"] == 0.01


def test_tables_can_be_written(tmp_path):
    """Of a confirmed, a missed and a stuck design, null where nothing was measured."""
    for i, nature in enumerate((Nature(summit), Nature(flat), Nature(summit, status="stuck"))):
        verdicts = check(Known(summit), nature, rounds=2, height_runs=True, transition_geometries=1)
        for kind, table in (
            ("verifications", verdicts.verifications),
            ("verified_designs", verdicts.designs),
        ):
            write_table(kind, plain(table), tmp_path / f"{kind}{i}.parquet", {})


def test_plain_rows():
    table = pd.DataFrame({"a": [np.float64(1.5), np.nan], "b": [True, None], "c": [None, "x"]})
    assert plain(table) == [{"a": 1.5, "b": True, "c": None}, {"a": None, "b": None, "c": "x"}]
    json.dumps(plain(table))
