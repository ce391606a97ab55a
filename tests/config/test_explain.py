"""Problems of a configuration are told by key, value and range, in plain words."""

from pathlib import Path

import pytest
import yaml

from dldsim.config.configuration import Config
from dldsim.config.design_sections import DesignRequest, Device
from dldsim.config.explain import check_value, validate
from dldsim.config.presets import resolve
from dldsim.config.sections import Cell, Geometry, RunControl
from dldsim.errors import DldsimError

ROOT = Path(__file__).parents[2]
RAW = yaml.safe_load((ROOT / "config.yaml").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("overrides", "parts"),
    [
        ({"preset": "papr"}, ["'papr'", "Did you mean paper?", "quick"]),
        ({"flow": {"heigth_um": 3}}, ["flow.heigth_um", "unknown key", "Did you mean height_um?"]),
        ({"numeric": {}}, ["numeric", "Did you mean numerics?"]),
        ({"flow": {"drive": "axal"}}, ["flow.drive", "'axal'", "Did you mean axial?"]),
        ({"flow": {"viscosity_mPa_s": -3}}, ["flow.viscosity_mPa_s", "-3", "number ≥ 0.01"]),
        ({"flow": {"viscosity_mPa_s": ".inf"}}, ["flow.viscosity_mPa_s", "inf"]),
        ({"sweep": {"periodicity": [1]}}, ["sweep.periodicity.0", "1", "whole number ≥ 2"]),
        ({"sweep": {"periodicity": [4.5]}}, ["sweep.periodicity.0", "4.5", "whole number"]),
        ({"sweep": {"periodicity": []}}, ["sweep.periodicity", "[]", "at least 1"]),
        ({"sweep": {"gap_um": []}}, ["sweep.gap_um", "[]", "at least 1"]),
        ({"sweep": {"gap_um": [9]}}, ["gap_um = 9", "P_r + d_safety", "Widen"]),
        ({"sweep": {"gap_um": [4.5], "pillar_radius_um": [2]}}, ["4.5", "squeezed", "Widen"]),
        ({"sweep": {"gap_um": [6], "skip_infeasible": True}}, ["no combination is left"]),
        ({"sweep": {"gap_minus_radius_um": 9}}, ["sweep", "exactly one of gap_um"]),
        ({"sweep": {"gap_um": [18, 18]}}, ["sweep.gap_um", "repeated: 18"]),
        ({"sweep": {"gap_um": [18.00001]}}, ["sweep.gap_um.0", "three decimals"]),
        ({"sweep": {"stiffness_sets": ["9"]}}, ["unknown stiffness set", "9", "1, 2, 3, 4, 5"]),
        ({"stiffness_sets": {"1": {"ks_uN_per_m": -1}}}, ["ks_uN_per_m", "-1", "number ≥ 0"]),
        (
            {
                "default_assay": "group-velocity",
                "constriction_groups": {"G1": {"stiffness_set": None}},
            },
            ["no membrane of assay group-velocity", "set 1"],
        ),
        ({"default_assay": "gouge"}, ["one of the assays gauge"]),
        ({"assays": {"gauge": {"kind": "shaer"}}}, ["assays.gauge.kind", "Did you mean shear?"]),
        (
            {"assays": {"gauge": {"cells": [{"shape": "sphere", "radius_um": 6}]}}},
            ["assays.gauge.cells", "biconcave of 7.5 µm"],
        ),
        ({"reference": {"releases": [0.2, 0.2]}}, ["reference.releases", "each place once"]),
        ({"reference": {"releases": [0.21234]}}, ["reference.releases.0", "three decimals"]),
        ({"assays": {"mine": {"stress_Pa": 1}}}, ["assays.mine.kind", "missing", "constriction"]),
        ({"assays": {"gauge": {"stress_Pa": -1}}}, ["assays.gauge.stress_Pa", "≥ 0.0001"]),
        ({"assays": {"gauge": {"stress": 1}}}, ["assays.gauge.stress", "Did you mean stress_Pa?"]),
        ({"assays": {"c": {"kind": "channel"}}}, ["exactly one of velocity_mm_s"]),
        ({"assays": {"c": {"kind": "constriction"}}}, ["a velocity, unless groups"]),
        ({"assays": {"source-table": {"indices": {"9": 0.5}}}}, ["sets 1, 2, 3, 4, 5; 9"]),
        ({"calibration_library": {"assays": ["x"]}}, ["names from assays; x"]),
        ({"assay_study": {"of_campaign": ["x"]}}, ["names from assays; x"]),
        ({"assay_study": {"assays": {"gauge": {"kind": "shear", "stress_Pa": 1}}}}, ["gauge"]),
        ({"constriction_groups": {"G3": {"stiffness_set": "1"}}}, ["several for 1"]),
        ({"design_requests": [{"name": "a", "stiffness_set_1": "1"}]}, ["deformation_index_2"]),
        ({"design_requests": [{"name": "a b"}]}, ["design_requests.0.name", "'a b'"]),
        ({"sweep": {"pillar_radius_um": None}}, ["sweep.pillar_radius_um", "missing"]),
        ({"sweep": 5}, ["sweep", "5"]),
    ],
)
def test_bad_values_are_named(overrides, parts):
    with pytest.raises(DldsimError) as caught:
        resolve(RAW, overrides)
    text = str(caught.value)
    assert all(part in text for part in parts), text
    assert "Traceback" not in text and "pydantic" not in text


def test_settings_that_do_not_fit_each_other_are_all_named():
    with pytest.raises(DldsimError) as caught:
        validate(Device, {"outlets": 3, "outlet_walls_um": [500.0]})
    assert "key      outlets, outlet_walls_um" in str(caught.value)
    assert "value    3, [500.0]" in str(caught.value)
    assert "allowed  outlets = 2 with 1 outlet_walls_um" in str(caught.value)


def test_every_problem_is_told_in_three_lines():
    with pytest.raises(DldsimError) as caught:
        resolve(RAW, {"flow": {"height_um": -1, "drive": "x"}})
    problems = str(caught.value).splitlines()[1:-1]
    assert [line.split()[0] for line in problems] == ["key", "value", "allowed"] * 2


@pytest.mark.parametrize(
    ("overrides", "key", "parts"),
    [
        ({"flow": 5}, "flow", ["a section with some of the keys mean_velocity_mm_s"]),
        ({"sweep": {"gap_um": 18}}, "sweep.gap_um", ["a list, each entry number > 0"]),
        ({"design_requests": [{"gap_um": [5]}]}, "design_requests.0.gap_um.1", ["missing"]),
        ({"design_requests": [{"gap_um": 5}]}, "design_requests.0.gap_um", ["a list of 2"]),
        ({"stiffness_sets": [1]}, "stiffness_sets", ["names, each with a section"]),
        ({"stiffness_sets": {"a b": {}}}, "stiffness_sets.a b", ["text like"]),
        (
            {"accuracy": {"migration_angle": {"cases": {"a": "r05.0_g20.0_n00_s1"}}}},
            "accuracy.migration_angle.cases.a",
            ["periodicity"],
        ),
        ({"reference": {"pairs": ["r5_g20_n4_s1"]}}, "reference.pairs.0", ["identifier"]),
        ({"sweep": {"stiffness_sets": ["9"]}}, "sweep.stiffness_sets", ["unknown stiffness set"]),
        ({"device": {"sample_position_mm": 50}}, "device.sample_position_mm", ["between"]),
    ],
)
def test_a_fault_has_its_key_and_plain_words(overrides, key, parts):
    with pytest.raises(DldsimError) as caught:
        resolve(RAW, overrides)
    assert key in caught.value.keys, caught.value.keys
    text = str(caught.value)
    assert all(part in text for part in parts), text
    assert not {"instance of", "Input should", "valid dictionary"} & {
        word for word in ("instance of", "Input should", "valid dictionary") if word in text
    }


@pytest.mark.parametrize(
    ("overrides", "key"),
    [
        ({"seed": True}, "seed"),
        ({"seed": -1}, "seed"),
        ({"seed": 2**64}, "seed"),
        ({"seed": float("nan")}, "seed"),
        ({"flow": {"height_um": True}}, "flow.height_um"),
        ({"flow": {"height_um": 1e300}}, "flow.height_um"),
        ({"flow": {"mean_velocity_mm_s": 1e30}}, "flow.mean_velocity_mm_s"),
        ({"flow": {"viscosity_mPa_s": 1e-12}}, "flow.viscosity_mPa_s"),
        ({"flow": {"viscosity_mPa_s": float("nan")}}, "flow.viscosity_mPa_s"),
        ({"cell": {"radius_um": 0.01}}, "cell.radius_um"),
        ({"cell": {"radius_um": -5}}, "cell.radius_um"),
        ({"numerics": {"rows": False}}, "numerics.rows"),
        ({"sweep": {"periodicity": [4, True]}}, "sweep.periodicity"),
        ({"sweep": {"periodicity": [0]}}, "sweep.periodicity.0"),
        ({"sweep": {"periodicity": [4.5]}}, "sweep.periodicity.0"),
        ({"sweep": {"pillar_radius_um": [-5]}}, "sweep.pillar_radius_um.0"),
        ({"sweep": {"pillar_radius_um": ["1:30"]}}, "sweep.pillar_radius_um.0"),
        ({"stiffness_sets": {"1": {"ks_uN_per_m": 1e9}}}, "stiffness_sets.1.ks_uN_per_m"),
        ({"constriction": {"release_positions_um": [-3]}}, "constriction.release_positions_um.0"),
        ({"run_control": {"max_rows": 10**9}}, "run_control.max_rows"),
        ({"design_requests": [{"name": "a", "trials": 10**9}]}, "design_requests.0.trials"),
        (
            {"accuracy": {"migration_angle": {"reference": {"rows": float("inf")}}}},
            "accuracy.migration_angle.reference.rows",
        ),
        ({"limits": {"memory_GB": 0}}, "limits.memory_GB"),
    ],
)
def test_nonsense_is_refused_where_it_stands(overrides, key):
    with pytest.raises(DldsimError) as caught:
        resolve(RAW, overrides)
    assert any(found.startswith(key) for found in caught.value.keys), caught.value.keys


def _numbers(model):
    """Every number of a section and of those in it: name and limits."""
    schema = model.model_json_schema()
    for section in [schema, *schema.get("$defs", {}).values()]:
        for name, part in section.get("properties", {}).items():
            for inner in [
                part,
                *part.get("anyOf", []),
                *part.get("prefixItems", []),
                part.get("items", {}),
            ]:
                if inner.get("type") in ("number", "integer"):
                    yield f"{section['title']}.{name}", inner


@pytest.mark.parametrize("model", [Config, Cell, Geometry, RunControl, DesignRequest, Device])
def test_every_number_has_a_range(model):
    found = dict(_numbers(model))
    assert found
    open_ended = {
        name
        for name, part in found.items()
        if not {"minimum", "exclusiveMinimum"} & set(part)
        or not {"maximum", "exclusiveMaximum"} & set(part)
    }
    assert not open_ended


def test_a_value_can_be_checked_alone():
    assert check_value(Config, "seed", 3) == 3
    for value in (-1, 2**64, True, 0.5):
        with pytest.raises(DldsimError) as caught:
            check_value(Config, "seed", value)
        assert caught.value.key == "seed"


def test_texts_of_the_command_line_are_numbers():
    assert validate(Cell, {"radius_um": "6"}).radius_um == 6
