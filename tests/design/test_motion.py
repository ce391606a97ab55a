"""What a surrogate and the outcomes behind it say of the motion of a population."""

import numpy as np
import pandas as pd
import pytest

from dldsim.analysis.conformal import conformal_factor, spread_of
from dldsim.config.sections import Flow, Geometry, Stiffness
from dldsim.design.motion import (
    BEYOND,
    LEVELS,
    UNKNOWN,
    error_factors,
    history_of,
    motion_of,
    simulated_in,
)
from dldsim.design.populations import Population

MODULI = {name: 1.0 for name in Stiffness.model_fields}
GEOMETRY = Geometry(pillar_radius_um=7, gap_um=16, periodicity=10)


class Law:
    """A surrogate with the interface of the real one and a formula for the share of the bump
    displacement; it learnt gaps up to 20 µm."""

    domains = {}

    def __init__(self, law, scores=((0.0,),) * 99, sigma=None):
        self.law = law
        self.card = {
            "conformal": {"scores": {"biconcave": [list(s) for s in scores]}, "range": [-0.1, 1.0]},
            "numerical_uncertainty": {"share_by_mode": sigma or {}},
        }

    def share(self, pillar_radius_um, gap_um, periodicity, cell):
        parts = pillar_radius_um, gap_um, periodicity, cell.radius_um, cell.capillary_number
        return np.asarray(self.law(*np.broadcast_arrays(*map(np.atleast_1d, parts))), float)

    def inside_domain(self, pillar_radius_um, gap_um, periodicity, cell):
        return np.broadcast_to(gap_um, np.shape(cell.radius_um)) <= 20


def population(number=1, radius=7.0, ks=15.0, **changes):
    moduli = Stiffness(**MODULI | {"ks_uN_per_m": ks})
    made = Population(number, f"p-{number}", "biconcave", radius, Flow(), moduli, "", ks, ks)
    return made._replace(**{"width_um": 5.0} | changes)


def outcomes(rows):
    """Rows of share, share in the first period and status, N_p 10."""
    angle = np.degrees(np.arctan(np.array([[a, b] for a, b, _ in rows], float) / 10))
    return pd.DataFrame(
        {
            "status": [status for _, _, status in rows],
            "migration_angle_deg": angle[:, 0],
            "source_angle_deg": angle[:, 1],
            "periodicity": 10,
            "cell_shape": "biconcave",
        }
    )


def test_lags_are_the_shares_that_the_first_period_lacks():
    bump = [(1.0, 1.0 - 0.1 * i, "decided") for i in range(6)]
    rest = [(0.0, 0.02, "decided")] * 5 + [(0.9999, np.nan, "decided"), (0.5, 0.0, "undecided")]
    history = history_of(outcomes(bump + rest), "biconcave")
    np.testing.assert_allclose(history.lags["bump"], [0.0, 0.1, 0.2, 0.3, 0.4, 0.5], atol=1e-9)
    np.testing.assert_allclose(history.lags["zigzag"], [-0.02] * 5, atol=1e-9)
    assert len(history.lags["mixed"]) == 11  # of too few, those of all modes
    assert history.coexisting == 0.0 and history.notes == ()


def test_coexistence_is_counted_between_the_modes():
    rows = [(0.5, 0.5, "decided")] * 6 + [(0.3, 0.3, "coexisting")] * 2 + [(0.05, 0, "coexisting")]
    assert history_of(outcomes(rows), "biconcave").coexisting == pytest.approx(0.25)


def test_what_is_not_known_of_a_shape_is_told():
    assert "those of all shapes" in history_of(outcomes([(1, 1, "decided")] * 6), "sphere").notes[0]
    silent = history_of(outcomes([(1, np.nan, "decided")] * 6), "biconcave")
    assert "taken as none" in silent.notes[0]
    assert all(set(lag) == {0.0} for lag in silent.lags.values())


def test_error_factors_are_the_conformal_ones_at_all_levels():
    rng = np.random.default_rng(1)
    scores = [rng.exponential(size=rng.integers(1, 4)).tolist() for _ in range(30)]
    expected = [min(conformal_factor(scores, level), BEYOND) for level in LEVELS]
    np.testing.assert_allclose(error_factors(scores), expected)
    assert set(error_factors([])) == {BEYOND}


def test_the_error_of_the_prediction_is_that_of_its_interval():
    """At a signed level the share is an end of the interval of that level."""
    scores = [[0.1 * i] for i in range(99)]
    law = Law(lambda r, g, n, size, ca: 0.5 + 0 * g, scores)
    motion = motion_of(law, population(), GEOMETRY, UNKNOWN)
    share = np.array([0.5])
    for level in (0.02, 0.03):
        reach = conformal_factor(scores, level) * spread_of(share)
        for sign in (-1, 1):
            off = motion.predictor.off(share, np.array([sign * level]))
            np.testing.assert_allclose(off, share + sign * reach)
    assert motion.predictor.off(share, np.array([0.99])) == 1.0  # no more than bump
    assert motion.basis.endswith("transients are not known")


def test_a_prediction_asks_for_the_cells_own_capillary_number():
    motion = motion_of(Law(lambda r, g, n, size, ca: ca), population(), GEOMETRY, UNKNOWN)
    flow = Flow()
    at = (np.array([7.0]), np.array([16.0]), np.array([7.0]), np.array([30.0]))
    speed = flow.viscosity_mPa_s * flow.mean_velocity_mm_s
    np.testing.assert_allclose(motion.predictor.share(*at), speed / 30.0)


def row(share, status, low=None, high=None, sigma=None):
    def angle(value):
        return float(np.degrees(np.arctan(value / 10)))

    return {
        "migration_angle_deg": angle(share),
        "angle_low_deg": angle(share if low is None else low),
        "angle_high_deg": angle(share if high is None else high),
        "status": status,
        "sigma_num_deg": sigma,
        "periodicity": 10,
    }


def test_a_simulated_motion_takes_the_place_of_the_error():
    law = Law(lambda r, g, n, size, ca: 0.4 + 0 * g, scores=[[9.0]] * 99)
    known = motion_of(law, population(), GEOMETRY, UNKNOWN, row(0.9, "decided")).predictor
    for deviate in (-0.9, 0.0, 0.9):
        np.testing.assert_allclose(known.off(np.array([0.4]), np.array([deviate])), 0.9)
    assert known.coexisting == 0.0


def test_an_undecided_motion_is_anywhere_in_its_interval():
    law = Law(lambda r, g, n, size, ca: 0.4 + 0 * g)
    known = motion_of(law, population(), GEOMETRY, UNKNOWN, row(0.4, "undecided", 0.1, 0.9))
    ends = [known.predictor.off(np.array([0.4]), np.array([u]))[0] for u in (-1.0, 0.0, 1.0)]
    np.testing.assert_allclose(ends, [0.1, 0.5, 0.9])
    mixture = motion_of(law, population(), GEOMETRY, UNKNOWN, row(0.4, "coexisting"))
    assert mixture.predictor.coexisting == 1.0 and "coexisting" in mixture.basis


def test_a_simulated_array_without_an_angle_is_predicted():
    law = Law(lambda r, g, n, size, ca: 0.4 + 0 * g)
    broken = row(0.4, "stuck") | {"migration_angle_deg": None}
    assert motion_of(law, population(), GEOMETRY, UNKNOWN, broken).basis.startswith("predicted")


def test_numerics_that_were_not_studied_are_told():
    law = Law(lambda r, g, n, size, ca: 0.5 + 0 * g)
    silent = motion_of(law, population(), GEOMETRY, UNKNOWN)
    assert silent.predictor.gap_error == 0.0 and "not studied" in silent.basis
    known = motion_of(Law(law.law, sigma={"bump": 0.1}), population(), GEOMETRY, UNKNOWN)
    assert known.predictor.gap_error > 0 and "not studied" not in known.basis


def test_an_error_is_on_the_side_that_has_room():
    """A cell that bumps cannot do more than that: what was seen of errors so large is less."""
    scores = [[1.0]] * 999
    law = Law(lambda r, g, n, size, ca: 0.95 + 0 * g, scores)
    off = motion_of(law, population(), GEOMETRY, UNKNOWN).predictor.off
    reach = spread_of(np.array([0.95]))
    for deviate in (-0.5, 0.5):
        np.testing.assert_allclose(off(np.array([0.95]), np.array([deviate])), 0.95 - reach)
    # of a cell half-way an error may be on either side
    law = Law(lambda r, g, n, size, ca: 0.5 + 0 * g, [[0.3]] * 999)
    off = motion_of(law, population(), GEOMETRY, UNKNOWN).predictor.off
    ends = [off(np.array([0.5]), np.array([u]))[0] for u in (-0.5, 0.5)]
    assert ends[0] < 0.5 < ends[1]


def test_a_simulated_array_is_found_by_all_that_acts():
    known = population()
    cell = {
        **GEOMETRY.model_dump(),
        "cell_shape": "biconcave",
        "cell_radius_um": 7.0,
        "height_um": known.flow.height_um,
        "capillary_number": known.capillary_number,
        "migration_angle_deg": 3.0,
        "sigma_num_deg": np.nan,
    }
    others = [cell | {name: 9.0} for name in ("gap_um", "cell_radius_um", "capillary_number")]
    others += [cell | {"cell_shape": "sphere"}, cell | {"migration_angle_deg": np.nan}]
    table = pd.DataFrame(others)
    assert simulated_in(table, GEOMETRY, known) is None
    found = simulated_in(pd.DataFrame([*others, cell | {"status": "decided"}]), GEOMETRY, known)
    assert found["status"] == "decided" and found["sigma_num_deg"] is None
