"""Where the survey is simulated."""

import math
from pathlib import Path

import numpy as np
import pytest

from dldsim import laws
from dldsim.analysis import survey
from dldsim.config.identifiers import parse_outcome
from dldsim.config.presets import read_config
from dldsim.errors import DldsimError
from dldsim.tables.parquet import write_table

CONFIG = Path(__file__).parents[2] / "config.yaml"


def few(**shapes):
    """The campaign with few points of the shapes; more changes by shape."""
    counts = {"first_points": 24, "round_points": 6}
    shapes = {"biconcave": {}, "sphere": {}} | shapes
    return read_config(
        CONFIG,
        {"survey": {"shapes": {s: c if c is None else counts | c for s, c in shapes.items()}}},
    )


@pytest.fixture(scope="module")
def settings():
    return few()


@pytest.fixture(scope="module")
def first(settings):
    return survey.plan(0, settings)


def simulated(row, critical=1.0):
    """An outcome that bumps where 2R/D_c exceeds a value."""
    size = 2 * row["cell_radius_um"]
    ratio = size / laws.critical_diameter(row["gap_um"], row["row_shift_fraction"])
    angle = math.degrees(math.atan(row["row_shift_fraction"])) if ratio > critical else 0.0
    return {**row, "migration_angle_deg": angle}


def test_first_points_are_within_the_ranges_and_what_their_names_say(settings, first, tmp_path):
    assert [row["number"] for row in first] == list(range(48))
    assert [row["cell_shape"] for row in first] == ["biconcave"] * 24 + ["sphere"] * 24
    assert first[7]["outcome_id"].endswith("_sdisc-0007")
    assert first[30]["outcome_id"].endswith("_ssphere-0030")
    radius, mu = settings.cell.radius_um, settings.flow.viscosity_mPa_s
    for row in first:
        drawn = settings.survey.shapes[row["cell_shape"]]
        geometry, name = parse_outcome(row["outcome_id"])
        assert geometry.gap_um == row["gap_um"] and name == row["stiffness_set"]
        spacing, _ = laws.whole_shift_spacing(geometry, settings.numerics.spacing_um)
        values = {
            "pillar_radius_to_radius": row["pillar_radius_um"] / radius,
            "gap_to_radius": row["gap_um"] / radius,
            "periodicity": row["periodicity"],
            "capillary_number": mu * row["mean_velocity_mm_s"] / row["ks_uN_per_m"],
        }
        for key, value in values.items():
            low, high = getattr(drawn, key)
            assert low - 1e-4 <= value <= high + 1e-4, key
        low, high = drawn.height_to_radius
        assert low <= row["height_um"] / radius <= high + spacing / radius
        assert row["height_um"] / spacing == pytest.approx(
            round(row["height_um"] / spacing), abs=1e-3
        )
        assert values["capillary_number"] == pytest.approx(row["capillary_number"])
        assert 5.1 <= row["ks_uN_per_m"] <= 20.3
        assert row["kal_uN_per_m"] == pytest.approx(2 * row["ks_uN_per_m"], rel=0.02)
    write_table("survey_plan", first, tmp_path / "plan.parquet", {})


def test_half_of_the_first_points_lie_in_the_band(settings, first):
    for shape, drawn in settings.survey.shapes.items():
        rows = [row for row in first if row["cell_shape"] == shape]
        low, high = drawn.transition_band
        for row in rows[12:]:
            ratio = 15 / laws.critical_diameter(row["gap_um"], row["row_shift_fraction"])
            assert low * 0.999 <= ratio <= high * 1.001
            assert f"2R/D_c = {ratio:.2f}" in row["why"]
        assert {row["why"] for row in rows[:12]} == {"fills the space"}


def test_coordinates_invert_the_drawing(settings):
    drawn = settings.survey.shapes["sphere"]
    points = survey.sobol(6, 1)
    values = survey.values_at(points, drawn)
    back = survey.coordinates(values, drawn)
    exact = [0, 1, 3, 4]  # N_p is rounded
    np.testing.assert_allclose(back[:, exact], points[:, exact], atol=1e-12)
    low, high = drawn.periodicity
    assert set(values[:, 2]) == set(range(low, high + 1))


def test_points_fill_their_ranges_evenly(settings):
    """No tenth of a range, in the logarithm, is left out or crowded."""
    drawn = settings.survey.shapes["biconcave"]
    where = survey.coordinates(survey.values_at(survey.sobol(8, 3), drawn), drawn)
    for column in (0, 1, 3, 4):
        counts, _ = np.histogram(where[:, column], bins=10, range=(0, 1))
        assert counts.min() >= 23 and counts.max() <= 28


def test_a_seed_gives_its_own_points_again(settings, first):
    assert survey.plan(0, settings) == first
    other = survey.plan(0, settings, seed=2)
    assert not {r["outcome_id"] for r in other} & {r["outcome_id"] for r in first}


@pytest.fixture(scope="module")
def known(first):
    return [simulated(row, 1.4 if row["cell_shape"] == "biconcave" else 1.0) for row in first]


@pytest.mark.slow
def test_a_refining_round_goes_to_the_transition_and_not_to_where_it_has_been(settings, known):
    rows = survey.plan(1, settings, known)
    assert [row["number"] for row in rows] == list(range(48, 60))
    assert survey.plan(1, settings, known) == rows
    for shape, critical in (("biconcave", 1.4), ("sphere", 1.0)):
        drawn = settings.survey.shapes[shape]

        def off(rows, shape=shape, critical=critical):
            return [
                abs(
                    math.log(
                        15 / laws.critical_diameter(r["gap_um"], r["row_shift_fraction"]) / critical
                    )
                )
                for r in rows
                if r["cell_shape"] == shape
            ]

        assert np.median(off(rows)) < 0.4 * np.median(off(known))
        where = survey.coordinates(
            np.array(
                [
                    survey._values_of(r, settings.flow)
                    for r in [*known, *rows]
                    if r["cell_shape"] == shape
                ]
            ),
            drawn,
        )
        between = np.linalg.norm(where[:, None] - where, axis=2)
        assert between[24:][between[24:] > 0].min() > 0.1
    assert "from the nearest point" in rows[0]["why"]


def test_failed_points_are_not_learnt_from_but_not_chosen_again(settings, known):
    told = [row for row in known if row["cell_shape"] == "sphere"]
    broken = [dict(row, migration_angle_deg=None) for row in told[:3]]
    rows = survey.plan(1, few(biconcave=None), broken + told[3:])
    assert len(rows) == 6
    with pytest.raises(
        DldsimError, match="none of 3 outcomes of shape sphere has an angle"
    ) as caught:
        survey.plan(1, few(biconcave=None), broken)
    assert caught.value.key == "survey.shapes.sphere"


@pytest.mark.parametrize(
    ("change", "part", "key"),
    [
        (
            {"transition_band": [20, 30]},
            "0 have 2R/D_c of 20 to 30",
            "survey.shapes.sphere.transition_band",
        ),
        (
            {"gap_to_radius": [0.3, 0.4], "transition_band": [1, 99]},
            "smaller than a squeezed",
            "gap_um",
        ),
        ({"height_to_radius": [1, 1.1]}, "height_um", "height_um"),
    ],
)
def test_points_that_cannot_be_simulated_are_refused_at_once(change, part, key):
    with pytest.raises(DldsimError, match=part) as caught:
        survey.plan(0, few(biconcave=None, sphere=change))
    assert caught.value.key == key
