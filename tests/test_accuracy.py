"""The study of error against run time: which runs it makes and what it says of them."""

import pytest

from dldsim.accuracy import (
    DEFAULT,
    Variant,
    parse_variant,
    settings_for,
    spread_deg,
    table,
    variant_id,
    variants,
)
from dldsim.config import Accuracy, read_config
from dldsim.errors import DldsimError
from dldsim.tables import COLUMNS


@pytest.fixture(scope="module")
def config():
    base = read_config("config.yaml")
    study = Accuracy(
        cases={"one": {"geometry": {"pillar_radius_um": 5, "gap_um": 20, "periodicity": 4},
                       "stiffness_set": "1"}},
        knobs={"spacing_um": [2.0, base.numerics.spacing_um, 0.5], "axis": ["z", "y"]},
    )  # fmt: skip
    return base.model_copy(update={"accuracy": study})


def row(angle):
    return {
        "migration_angle_deg": angle, "bump_angle_deg": 14.0, "mode": "zigzag",
        "status": "periodic", "sigma_num_deg": 0.0, "wall_time_s": 1.0, "steps": 2, "nodes": 3,
        "vertices": 4,
    }  # fmt: skip


def test_identifiers_are_their_own_inverse(config):
    for variant in variants(config):
        assert parse_variant(variant_id(variant)) == variant


def test_the_default_runs_once(config):
    assert variants(config) == [
        Variant("one", DEFAULT, 0), Variant("one", "spacing_um", 0),
        Variant("one", "spacing_um", 2), Variant("one", "axis", 0),
    ]  # fmt: skip


def test_a_variant_changes_one_setting(config):
    default = settings_for(Variant("one", DEFAULT, 0), config)
    fine = settings_for(Variant("one", "spacing_um", 2), config)
    assert fine["numerics"] == default["numerics"] | {"spacing_um": 0.5}
    assert {k: v for k, v in fine.items() if k != "numerics"} == {
        k: v for k, v in default.items() if k != "numerics"
    }
    assert settings_for(Variant("one", "axis", 0), config)["cell"]["axis"] == "z"


def test_errors_are_against_the_finest_value(config):
    angles = {("default", 0): 1.0, ("spacing_um", 0): 3.0, ("spacing_um", 2): 0.5, ("axis", 0): 1.2}
    rows = table([(Variant("one", *k), row(v)) for k, v in angles.items()], config)
    assert all(set(r) == {c.name for c in COLUMNS["accuracy"]} for r in rows)
    errors = {(r["knob"], r["rank"]): r["error_deg"] for r in rows}
    assert errors == pytest.approx(
        {("spacing_um", 0): 2.5, ("spacing_um", 1): 0.5, ("spacing_um", 2): 0.0,
         ("axis", 0): 0.2, ("axis", 1): 0.0}
    )  # fmt: skip
    assert spread_deg(rows, "one") == pytest.approx(((2**2 + 0.5**2 + 0.2**2) / 3) ** 0.5)


def test_a_run_without_angle_has_no_error(config):
    angles = {("default", 0): 1.0, ("spacing_um", 0): None, ("spacing_um", 2): 0.5, ("axis", 0): 1}
    rows = table([(Variant("one", *k), row(v)) for k, v in angles.items()], config)
    assert [r["error_deg"] for r in rows if r["knob"] == "spacing_um"] == [None, 0.5, 0.0]


def test_an_unknown_setting_is_named(config):
    study = config.accuracy.model_copy(update={"knobs": {"colour": [1, 2]}})
    with pytest.raises(DldsimError, match="colour"):
        variants(config.model_copy(update={"accuracy": study}))
