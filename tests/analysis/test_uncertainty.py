"""σ_num from the transition distance: its laws, its fit, its coverage, its refusals."""

import json
import math
import re
import statistics

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dldsim import PHYSICS_VERSION
from dldsim.analysis import uncertainty
from dldsim.analysis.uncertainty import (
    check_row,
    coverage,
    cross_validated,
    fit_model,
    mode_probability,
    numerical_uncertainty,
    with_uncertainty,
)
from dldsim.config.sections import Numerics
from dldsim.errors import DldsimError
from dldsim.report import accuracy_figures, style
from dldsim.tables.numerics import columns_of
from dldsim.tables.registry import COLUMNS

BUMP = math.degrees(math.atan(1 / 10))
NUMERICS = Numerics()
SIGMA_D, SHARE = 0.1, 0.02


def outcome(angle=BUMP, distance=0.3, **changes):
    """A row of `outcomes` as far as σ_num reads it; bumping, and far from the transition."""
    bumps = angle is not None and angle > 0.9 * BUMP
    return {
        "outcome_id": "r08.0_g17.0_n10_s1",
        "pillar_radius_um": 8.0,
        "gap_um": 17.0,
        "periodicity": 10,
        "stiffness_set": "1",
        "cell_shape": "biconcave",
        "aspect_ratio": None,
        "cell_radius_um": 7.5,
        "release_axis": "y",
        "height_um": 20.0,
        "mean_velocity_mm_s": 0.5,
        "drive": "no-lateral-flux",
        **columns_of(NUMERICS),
        "spacing_um": 1.2,
        "status": "decided",
        "start": "release",
        "mode": "bump" if bumps else "mixed" if angle else "none",
        "migration_angle_deg": angle,
        "angle_low_deg": angle,
        "angle_high_deg": angle,
        "bump_angle_deg": BUMP,
        "transition_distance": distance,
    } | changes


def model(**changes):
    """Of σ_d = 0.1 and c = 0.02."""
    return {
        "kind": uncertainty.KIND,
        "physics_version": PHYSICS_VERSION,
        "distance": dict.fromkeys(uncertainty.SIDES, {"pairs": 20, "value": SIGMA_D}),
        "share": {"pairs": 18, "value": SHARE},
        "numerics": NUMERICS.model_dump(),
        "conditions": {"cell_shape": "biconcave", "cell_radius_um": 7.5},
        "ranges": {"pillar_radius_um": [5.0, 9.0], "gap_um": [12.0, 20.0], "periodicity": [4, 12]},
    } | changes


def sigma(*args, **changes):
    return numerical_uncertainty(outcome(*args, **changes), model())["sigma_num_deg"]


# ------------------------------------------------------------------------------------------- laws


@given(st.floats(-3, 3), st.floats(0.01, 2))
def test_the_probability_is_that_of_a_normal_error(distance, spread):
    """Against the standard library's distribution: the chance that d and d + error differ in
    sign."""
    expected = statistics.NormalDist(0, spread).cdf(-abs(distance))
    assert mode_probability(distance, spread) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("angle", [BUMP, 1.0])
def test_sigma_falls_with_the_distance_to_the_transition(angle):
    """Level while the mode is open, to 1.645 σ_d, then falling to what errors within a mode are."""
    sign = 1 if angle == BUMP else -1
    found = [sigma(angle, sign * d * SIGMA_D) for d in (0.0, 0.8, 1.64, 1.65, 2.0, 3.0, 8.0)]
    assert found[0] == found[1] == found[2]
    assert all(a > b for a, b in zip(found[2:], found[3:], strict=False))
    assert found[-1] == pytest.approx(SHARE * BUMP, rel=1e-9)  # nothing else can happen


@given(st.floats(1e-6, 0.5))
def test_a_step_is_within_two_sigma_or_rarer_than_one_in_twenty(p):
    """And σ is never below its standard deviation."""
    v = uncertainty.step_variance(p)
    assert 2 * math.sqrt(v) >= 1 or p < 0.05
    assert v >= p * (1 - p)


def test_sigma_spans_the_modes_at_the_transition():
    """Two σ reach from bump to zigzag and back: a fair coin has half the step as its σ."""
    assert 2 * sigma(BUMP, 0.0) == pytest.approx(math.hypot(BUMP, 2 * SHARE * BUMP))
    assert 2 * sigma(1.0, 0.0) == pytest.approx(math.hypot(BUMP - 1.0, 2 * SHARE * BUMP))


@pytest.mark.parametrize(
    ("changes", "word"), [({"distance": None}, "unknown"), ({"distance": -0.4}, "contradicts")]
)
def test_an_open_mode_spans_the_modes(changes, word):
    found = numerical_uncertainty(outcome(**changes), model())
    assert 2 * found["sigma_num_deg"] >= BUMP
    assert found["sigma_num_kind"] == "modelled" and found["mode_open"] is True
    basis = found["sigma_num_basis"]
    assert basis.startswith("modelled: spans the modes, ") and word in basis


@pytest.mark.parametrize("status", ["undecided", "coexisting"])
def test_what_is_not_decided_spans_the_modes_with_or_without_a_study(status):
    """Half the bump angle and what the interval of the mean has."""
    row = outcome(2.0, 0.3, status=status, angle_low_deg=0.0, angle_high_deg=4.0)
    for study in (model(), None):
        found = numerical_uncertainty(row, study)
        assert found["sigma_num_deg"] == pytest.approx(math.hypot(BUMP / 2, 2 / 1.96))
        assert (found["sigma_num_kind"], found["mode_open"]) == ("spans the modes", True)
        assert found["sigma_num_basis"] == f"spans the modes: {status}"


def test_a_mode_is_open_where_the_other_is_not_left_out():
    """p = Φ(−1.645) = 0.05; the kind is that of the study either way."""
    near, far = (numerical_uncertainty(outcome(BUMP, d * SIGMA_D), model()) for d in (1.64, 1.65))
    assert (near["mode_open"], far["mode_open"]) == (True, False)
    assert near["sigma_num_kind"] == far["sigma_num_kind"] == "modelled"


def test_the_interval_of_the_angle_adds_in_quadrature():
    plain, wide = sigma(), sigma(angle_low_deg=BUMP - 1.96, angle_high_deg=BUMP + 1.96)
    assert wide**2 - plain**2 == pytest.approx(1.0)


# -------------------------------------------------------------------------------------------- fit


def test_one_pair_has_students_factor_of_one_degree_of_freedom():
    """tan(π/2 · 0.6827) for the Cauchy distribution; it falls to 1 for many pairs."""
    assert uncertainty.confidence_factor(1) == pytest.approx(math.tan(math.pi / 2 * 0.6827))
    assert uncertainty.confidence_factor(10_000) == pytest.approx(1, abs=1e-3)


def test_the_fit_separates_distance_and_share():
    """σ_d from all pairs whose distance is known, by side, c from those that stay on a side."""
    finer = {"spacing_um": 0.6}
    pairs = [
        (outcome(BUMP, 0.30), outcome(BUMP - 0.2, 0.25, **finer)),
        (outcome(1.0, -0.20), outcome(0.8, -0.35, **finer)),
        (outcome(BUMP, 0.05), outcome(1.0, -0.10, **finer)),  # the mode changes: no share
        (outcome(BUMP, None), outcome(BUMP, 0.2, **finer)),  # no distance
        (outcome(2.0, -0.2, status="undecided"), outcome(0.5, -0.2, **finer)),  # no share
        (outcome(None, None), outcome(BUMP, None, **finer)),  # nothing
        # of what went on with a settled cell the angle, not the distance
        (outcome(BUMP, 0.30), outcome(BUMP - 0.2, 0.9, start="settled", **finer)),
    ]
    fitted = fit_model(pairs)
    sides = fitted["distance"]
    for found, errors in (
        (sides["bump lane"], [0.05, 0.15]),
        (sides["no bump lane"], [0.15, 0.0]),
        (fitted["share"], [0.2 / BUMP, 0.2 / BUMP, 0.0, 0.2 / BUMP]),
    ):
        assert found["pairs"] == len(errors)
        assert found["rms"] == pytest.approx(math.sqrt(np.mean(np.square(errors))))
        assert found["value"] == pytest.approx(
            found["rms"] * uncertainty.confidence_factor(len(errors))
        )
    assert fitted["spacing_ratio"] == [2.0, 2.0]
    assert fitted["numerics"] == NUMERICS.model_dump() and len(fitted["pairs"]) == 7
    json.dumps(fitted, allow_nan=False)


def test_what_periodic_images_change_is_added():
    """To the error beside the finer lattice, of which it is a part of its own; a pair without a
    distance, or of another side, in the other domain tells nothing of it."""
    finer = {"spacing_um": 0.6}
    rows = [outcome(BUMP, d, outcome_id=name) for name, d in (("a", 0.3), ("b", 0.2), ("c", 0.1))]
    references = [(0.2, 0.25), (0.1, 0.30), (0.0, 0.2)]
    pairs = [
        (row, outcome(BUMP - off, d, **finer))
        for row, (off, d) in zip(rows, references, strict=True)
    ]
    domain = {
        "a": outcome(BUMP + 0.1, 0.26),
        "b": outcome(BUMP - 0.2, 0.16),
        "c": outcome(1.0, None),
    }
    fitted = fit_model(pairs, domain)
    lane, share = fitted["distance"]["bump lane"], fitted["share"]
    assert lane["pairs"] == share["pairs"] == 2
    assert lane["rms"] == pytest.approx(math.hypot(0.05 + 0.04, -0.1 + 0.04) / math.sqrt(2))
    assert lane["images"] == pytest.approx(0.04)
    assert lane["lattice"] == pytest.approx(math.hypot(0.05, 0.1) / math.sqrt(2))
    assert share["rms"] * BUMP == pytest.approx(math.hypot(0.2 - 0.1, 0.1 + 0.2) / math.sqrt(2))
    alone = fit_model(pairs)
    assert alone["distance"]["bump lane"]["pairs"] == 3 and alone["share"]["images"] is None
    with pytest.raises(DldsimError, match="c was not simulated in the other domain"):
        fit_model(pairs, {k: domain[k] for k in "ab"})


@pytest.mark.parametrize(
    "pairs",
    [
        [],
        [(outcome(), outcome(spacing_um=0.6)), (outcome(kernel="linear"), outcome(spacing_um=0.6))],
    ],
)
def test_pairs_of_different_numerics_or_none_are_refused(pairs):
    with pytest.raises(DldsimError, match="different numerics"):
        fit_model(pairs)


def test_a_reference_that_is_no_finer_is_refused():
    with pytest.raises(DldsimError, match="r08.0_g17.0_n10_s1 has a spacing of 1.2 µm"):
        fit_model([(outcome(), outcome())])


def ensemble(seed, count=400):
    """Pairs over the transition whose distance is wrong by 0.1: the mode follows the distance."""
    random = np.random.default_rng(seed)

    def made(distance, gap, spacing):
        share = 1 if distance > 0 else 0.3 / (1 - 2 * distance)
        angle = BUMP * (share + 0.01 * random.standard_normal())
        return outcome(
            angle,
            distance,
            mode="bump" if distance > 0 else "mixed",
            gap_um=gap,
            spacing_um=spacing,
            outcome_id=f"g{gap}",
        )

    result = []
    for i in range(count):
        true = random.uniform(-0.8, 0.8)
        seen = true + 0.1 * random.standard_normal()
        result.append((made(seen, 12 + 8 * i / count, 1.25), made(true, 12 + 8 * i / count, 0.6)))
    return result


@pytest.mark.parametrize("seed", range(4))
def test_a_synthetic_ensemble_is_covered(seed):
    """Fitted to one half, the model covers nine tenths of the other; errors it did not expect, a
    distance three times as wrong, it does not."""
    pairs = ensemble(seed)
    fitted = fit_model(pairs[::2])
    for side in uncertainty.SIDES:
        assert fitted["distance"][side]["rms"] == pytest.approx(0.1, rel=0.2)
    flipped = sum((row["mode"] == "bump") != (ref["mode"] == "bump") for row, ref in pairs[1::2])
    seen = coverage(check_row(*pair, fitted) for pair in pairs[1::2])
    assert flipped > 5 and seen["pairs"] == 200 and seen["holds"]
    assert seen["within_2_sigma"] >= 0.9 * seen["pairs"]
    assert seen["within_2_sigma"] > seen["within_1_sigma"]
    certain = dict.fromkeys(uncertainty.SIDES, {"pairs": 1, "value": 1e-6})
    blind = fitted | {"distance": certain}  # takes every mode for certain
    missed = coverage(check_row(*pair, blind) for pair in pairs[1::2])
    assert missed["within_2_sigma"] <= seen["within_2_sigma"] - flipped / 2


def test_small_where_nothing_can_happen():
    pairs = ensemble(5)
    fitted = fit_model(pairs)
    least = fitted["share"]["value"] * BUMP
    far = [check_row(*p, fitted) for p in pairs if abs(p[0]["transition_distance"]) > 0.5]
    near = [check_row(*p, fitted) for p in pairs if abs(p[0]["transition_distance"]) < 0.05]
    assert max(r["sigma_num_deg"] for r in far) < 1.05 * least
    assert min(r["sigma_num_deg"] for r in near) > 0.3 * BUMP > 5 * least


def test_no_pair_is_judged_by_a_model_that_saw_its_array():
    """One array is wrong by half a degree within its mode: its own error is not in its σ."""

    def finer(angle):
        return outcome(angle, 0.25, spacing_um=0.6)

    quiet = [(outcome(BUMP, 0.3, gap_um=g), finer(BUMP - 0.01)) for g in (13, 15, 17, 19)]
    odd = (outcome(BUMP, 0.3, gap_um=16), finer(BUMP - 0.5))
    rows = cross_validated([*quiet, odd])
    assert rows[-1]["sigma_num_deg"] < 0.02 and rows[-1]["verdict"].startswith("disagrees")
    assert rows[0]["sigma_num_deg"] > 0.1
    assert not coverage(rows)["holds"]


# ----------------------------------------------------------------------------------------- limits


@pytest.mark.parametrize(
    ("row", "other", "word"),
    [
        (outcome(None), {}, "no angle"),
        (outcome(), None, "no reference is installed"),
        (outcome(), {"physics_version": 3}, "physics version 3"),
        (outcome(wanted_spacing_um=2.0), {}, r"spacing_um = 2.0 \(studied 1.25\)"),
        (outcome(), {"share": {"pairs": 0, "value": None}}, "too few pairs"),
    ],
)
def test_no_sigma_without_a_study(row, other, word):
    found = numerical_uncertainty(row, None if other is None else model(**other))
    assert found["sigma_num_deg"] is None and found["mode_open"] is None
    assert found["sigma_num_kind"] in ("no angle", "not studied")
    assert re.search(word, found["sigma_num_basis"])


@pytest.mark.parametrize(
    ("changes", "word"),
    [({"gap_um": 25.0}, "gap_um = 25"), ({"cell_radius_um": 6.0}, "cell_radius_um = 6.0")],
)
def test_beyond_the_study_it_is_extrapolated(changes, word):
    found = numerical_uncertainty(outcome(**changes), model())
    assert found["sigma_num_deg"] > 0 and found["sigma_num_kind"] == "extrapolated"
    assert word in found["sigma_num_basis"]


def test_a_table_is_filled():
    rows = pd.DataFrame([outcome(), outcome(None), outcome(distance=None)])
    filled = with_uncertainty(rows, {"biconcave": model()})
    assert filled["sigma_num_deg"].isna().tolist() == [False, True, False]
    assert filled["sigma_num_deg"][2] > filled["sigma_num_deg"][0]
    assert filled["sigma_num_kind"].tolist() == ["modelled", "no angle", "modelled"]
    assert filled["mode_open"].tolist() == [False, None, True]
    assert filled["sigma_num_basis"][1] == "no angle"


def test_each_shape_is_judged_by_its_own_study():
    """And one that has none by that of discs, which is called extrapolated."""
    spheres = model()
    spheres["conditions"] = spheres["conditions"] | {"cell_shape": "sphere"}
    spheres["distance"] = {
        side: known | {"value": known["value"] / 10} for side, known in spheres["distance"].items()
    }
    row = outcome(distance=SIGMA_D)
    rows = pd.DataFrame([row, row | {"cell_shape": "sphere"}, row | {"cell_shape": "ellipsoid"}])
    both = with_uncertainty(rows, {"biconcave": model(), "sphere": spheres})
    assert both["mode_open"].tolist() == [True, False, True]
    assert both["sigma_num_kind"].tolist() == ["modelled", "modelled", "extrapolated"]
    discs = with_uncertainty(rows, {"biconcave": model()})
    assert discs["sigma_num_kind"].tolist() == ["modelled", "extrapolated", "extrapolated"]
    assert with_uncertainty(rows, {})["sigma_num_kind"].tolist() == ["not studied"] * 3


def test_rows_of_the_check_have_the_columns_of_their_table():
    row = check_row(outcome(), outcome(1.0, -0.3), model())
    assert set(row) == {c.name for c in COLUMNS["reference_check"]}
    assert row["verdict"].startswith("disagrees: ")
    assert row["error_over_sigma"] == pytest.approx((BUMP - 1) / row["sigma_num_deg"])
    untold = check_row(outcome(), outcome(None), model())
    assert untold["error_deg"] is None and untold["verdict"].startswith("cannot be told")


def test_the_sentence_names_who_disagrees():
    rows = [
        check_row(outcome(), outcome(BUMP - 0.01, 0.3), model()),
        check_row(outcome(outcome_id="odd"), outcome(1.0, -0.3), model()),
        check_row(outcome(), outcome(None), model()),
    ]
    sentence = uncertainty.closing_sentence(rows)
    assert sentence.startswith("1 of 2 pairs are within 2 σ_num of the reference; 90% must be.")
    assert "odd (" in sentence and "Of 1 it cannot be told." in sentence


@pytest.mark.parametrize("status", ["converged", "periodic", "stationary"])
def test_a_settled_run_has_the_uncertainty_of_a_decided_outcome(status):
    assert sigma(status=status) == sigma()


def test_the_figure_draws():
    rows = [
        check_row(outcome(), outcome(BUMP - 0.01), model()),
        check_row(outcome(), outcome(1.0, -0.3), model()),
        check_row(outcome(1.0, -0.3), outcome(1.0, -0.3), model()),
        check_row(outcome(None), outcome(), model()),
    ]
    figure = accuracy_figures.draw_sigma(pd.DataFrame(rows))
    assert style.render(figure, "svg").startswith(b"<?xml")


# ------------------------------------------------------------------------------------------ files


def test_models_come_back(tmp_path):
    assert uncertainty.read_models(tmp_path) == {} and uncertainty.models_hash(tmp_path) is None
    path = tmp_path / "biconcave" / "sigma_num.json"
    path.parent.mkdir()
    path.write_text(json.dumps(model()))
    assert uncertainty.read_models(tmp_path) == {"biconcave": model()}
    assert uncertainty.models_hash(tmp_path)


@pytest.mark.parametrize("text", ["{", "[]", '{"kind": "another"}'])
def test_a_file_that_is_no_model_is_refused(tmp_path, text):
    path = tmp_path / "sigma_num.json"
    path.write_text(text)
    with pytest.raises(DldsimError, match="make reference"):
        uncertainty.read_model(path)


@pytest.mark.parametrize("shape", sorted(uncertainty.read_models()))
def test_the_model_of_the_package_is_that_of_its_pairs(shape):
    """Refitted from the pairs as in a campaign, on finer lattices and in larger domains."""
    from dldsim.tables.parquet import read_rows

    campaign, finer, domain = (
        {
            row["outcome_id"]: row
            for row in read_rows(
                "reference_outcomes", uncertainty.STUDIES / shape / f"{name}_outcomes.parquet"
            )
        }
        for name in ("campaign", "reference", "domain")
    )
    pairs = [(campaign[name], row) for name, row in finer.items()]
    known = uncertainty.read_models()[shape]
    fitted = fit_model(pairs, domain)
    for part in (*known["distance"].items(), ("share", known["share"])):
        name, values = part
        assert values == pytest.approx(fitted["distance"].get(name, fitted["share"]))
    assert known["check"] == coverage(cross_validated(pairs, domain))
    assert set(known["pairs"]) == set(fitted["pairs"]) and known["numerics"] == fitted["numerics"]
