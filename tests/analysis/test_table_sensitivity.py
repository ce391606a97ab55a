"""Sobol indices of anybody's table: what is learnt of it, and what they depend on."""

import numpy as np
import pandas as pd
import pytest

from dldsim.analysis import table_sensitivity
from dldsim.errors import DldsimError
from tests.analysis.made_outcomes import make_outcomes

NEEDED = [
    "pillar_radius_um",
    "gap_um",
    "periodicity",
    "stiffness_set",
    "deformation_index",
    "migration_angle_deg",
]


@pytest.fixture(scope="module")
def anybodys():
    return make_outcomes(radii=(5.0, 10.0), indices=(0.5, 0.78))[NEEDED]


@pytest.fixture
def learnt():
    """What the surrogate of a table learns from, lengths over the cell radius, and the notes."""

    def of(frame):
        means, notes = table_sensitivity.table_learnt(frame, seed=2)
        for name in ("pillar_radius_um", "gap_um"):
            means[name] /= means["cell_radius_um"]
        return means.drop(columns="cell_radius_um"), notes

    return of


@pytest.mark.parametrize(
    ("change", "note"),
    [
        (lambda f: f.assign(migration_angle_deg=-f["migration_angle_deg"]), "turned"),
        (lambda f: f.assign(migration_angle_deg=np.radians(f["migration_angle_deg"])), None),
        (lambda f: f.assign(migration_angle_deg=-0.37 * f["migration_angle_deg"]), "turned"),
        (
            lambda f: f.assign(pillar_radius_um=2 * f["pillar_radius_um"], gap_um=2 * f["gap_um"]),
            None,
        ),
        (lambda f: f.drop(columns="stiffness_set"), "stiffness_set"),
        (lambda f: f.astype({"periodicity": str}).astype({"periodicity": "category"}), None),
        (
            lambda f: pd.concat([f, f.assign(migration_angle_deg=np.nan, stiffness_set="x")[:3]]),
            "3 of 39 rows left out: no migration_angle_deg",
        ),
        (lambda f: pd.concat([f.assign(replicate=i) for i in (1, 2)]), "are repeats of 36"),
    ],
)
def test_what_is_learnt_of_a_table_depends_on_no_unit_sign_or_type(anybodys, learnt, change, note):
    expected, none = learnt(anybodys)
    found, notes = learnt(change(anybodys))
    pd.testing.assert_frame_equal(found, expected, rtol=1e-12)
    assert not none and (any(note in n for n in notes) if note else notes == [])


def test_indices_of_a_table_depend_on_no_sign_or_radius(anybodys):
    plain, _ = table_sensitivity.sobol_of_table(anybodys, seed=2)
    turned = anybodys.assign(migration_angle_deg=-anybodys["migration_angle_deg"])
    pd.testing.assert_frame_equal(table_sensitivity.sobol_of_table(turned, seed=2)[0], plain)
    other, _ = table_sensitivity.sobol_of_table(anybodys.assign(cell_radius_um=3.0), seed=2)
    pd.testing.assert_frame_equal(plain, other, rtol=1e-2, atol=1e-2)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda f: f.assign(cell_radius_um="7.5 um"), ["cell_radius_um", "'7.5 um' is no number"]),
        (lambda f: f.assign(cell_radius_um=7.5e-6), ["cell_radius_um", "In m it would be 7.5 µm"]),
        (
            lambda f: f.assign(mean_velocity_mm_s=1.0 + np.arange(len(f)) % 2),
            ["differ in mean_velocity_mm_s", "capillary_number"],
        ),
        (lambda f: f.assign(height_um=-2.0), ["height_um", "-2"]),
    ],
)
def test_tables_that_no_surrogate_can_learn_are_refused(anybodys, change, words):
    with pytest.raises(DldsimError) as error:
        table_sensitivity.sobol_of_table(change(anybodys), seed=2)
    assert all(word in str(error.value) for word in words), error.value


def test_many_arrays_are_drawn_from_and_counted(anybodys, learnt, monkeypatch):
    monkeypatch.setattr(table_sensitivity, "LEARNT", 10)
    means, notes = learnt(anybodys)
    assert any("arrays: 8 of 18 left out" in note for note in notes), notes
    assert len(means) == 20


@pytest.mark.slow
def test_ca_is_the_input_where_the_table_tells_it(anybodys):
    outcomes = make_outcomes(radii=(5.0, 10.0), indices=(0.5, 0.78))
    told = outcomes[[*NEEDED, "capillary_number"]]
    found, notes = table_sensitivity.sobol_of_table(told, seed=2)
    assert "capillary_number" in set(found["factor"]) and notes == []
    found, notes = table_sensitivity.sobol_of_table(anybodys, seed=2)
    assert "deformation_index" in set(found["factor"])
    assert "deformation index stands for it" in notes[0]
    part = told.assign(capillary_number=told["capillary_number"].where(told.index > 0))
    assert "deformation_index" in set(table_sensitivity.sobol_of_table(part, seed=2)[0]["factor"])


def test_velocities_may_differ_where_ca_tells_them():
    outcomes = make_outcomes(radii=(5.0, 10.0), indices=(0.5, 0.78))
    told = outcomes[[*NEEDED, "capillary_number"]].assign(
        mean_velocity_mm_s=1.0 + outcomes.index % 2
    )
    assert "capillary_number" in set(table_sensitivity.sobol_of_table(told, seed=2)[0]["factor"])
