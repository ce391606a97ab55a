"""Bad configuration is refused with key, value and allowed values; units match the source."""

import json
from pathlib import Path

import pytest
import yaml

from dldsim.config.design_sections import DesignRequest
from dldsim.config.explain import validate
from dldsim.config.feasibility import check_gap, check_passable, smallest_passable_um
from dldsim.config.presets import merge, read_config, resolve
from dldsim.config.schema import json_schema
from dldsim.config.sections import Cell, Geometry
from dldsim.errors import DldsimError

ROOT = Path(__file__).parents[2]
RAW = yaml.safe_load((ROOT / "config.yaml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("preset", RAW["presets"])
def test_presets_are_valid(preset):
    assert resolve(RAW, {"preset": preset}).preset == preset


@pytest.mark.parametrize(
    ("overrides", "parts"),
    [
        ({"preset": "papr"}, ["'papr'", "Did you mean paper?", "quick"]),
        ({"flow": {"heigth_um": 3}}, ["flow.heigth_um", "unknown key", "Did you mean height_um?"]),
        ({"numeric": {}}, ["numeric", "Did you mean numerics?"]),
        ({"flow": {"drive": "axal"}}, ["flow.drive", "'axal'", "Did you mean axial?"]),
        ({"flow": {"viscosity_mPa_s": -3}}, ["flow.viscosity_mPa_s", "-3", "number > 0"]),
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
        ({"constriction_groups": {"G1": None}}, ["no constriction group", "set 1"]),
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


@pytest.mark.parametrize("places", [[], [0.5, 0.5], [1.5], [0.1234]])
def test_places_of_release_are_distinct_and_in_the_gap(places):
    with pytest.raises(DldsimError, match="run_control.release_gap_fractions"):
        resolve(RAW, {"run_control": {"release_gap_fractions": places}})


def test_a_campaign_has_no_single_place_of_release():
    """It would be ignored; the message says where the places are."""
    with pytest.raises(DldsimError, match="run_control.release_gap_fractions"):
        resolve(RAW, {"cell": {"release_gap_fraction": 0.3}})


def test_every_problem_is_told_in_three_lines():
    with pytest.raises(DldsimError) as caught:
        resolve(RAW, {"flow": {"height_um": -1, "drive": "x"}})
    problems = str(caught.value).splitlines()[1:-1]
    assert [line.split()[0] for line in problems] == ["key", "value", "allowed"] * 2


def test_order_of_precedence():
    raw = merge(RAW, {"numerics": {"spacing_um": 1.0, "rows": 2}})
    raw["presets"] = merge(RAW["presets"], {"quick": {"numerics": {"spacing_um": 0.9}}})
    assert resolve(raw).numerics.spacing_um == 0.9
    assert resolve(raw).numerics.rows == 2
    over = resolve(raw, {"numerics": {"spacing_um": 0.8}})
    assert (over.numerics.spacing_um, over.numerics.rows) == (0.8, 2)


def test_command_line_numbers_come_as_text():
    config = resolve(RAW, {"numerics": {"kernel": "4-point"}, "sweep": {"stiffness_sets": ["1"]}})
    assert config.numerics.kernel == "4-point"
    assert config.sweep.stiffness_sets == ["1"]


def test_not_a_configuration(tmp_path):
    path = tmp_path / "config.yaml"
    with pytest.raises(DldsimError, match="Cannot read"):
        read_config(path)
    path.write_text("a: [")
    with pytest.raises(DldsimError, match="not valid YAML"):
        read_config(path)
    path.write_text("just text")
    with pytest.raises(DldsimError, match="mapping"):
        read_config(path)


def test_stiffness_units_are_converted_from_the_source():
    """Table 1 and the group table of the source, in nN, µm and µs."""
    sets = {"1": (0.0051, 4.3e-5, 0.0102), "2": (0.0076, 9.5e-5, 0.0152),
            "3": (0.01524, 2.5e-4, 0.03), "4": (0.01778, 3e-4, 0.035),
            "5": (0.0203, 3.5e-4, 0.0406)}
    groups = {"G1": (0.0051, 4.33e-5, 0.0102, 1.095), "G2": (0.0076, 9.526e-5, 0.0152, 1.5495),
              "G3": (0.01016, 1.5e-4, 0.0203, 1.8975), "G4": (0.0127, 2e-4, 0.02, 2.121),
              "G5": (0.01524, 2.5e-4, 0.03, 2.739), "G6": (0.01778, 3e-4, 0.035, 3.0),
              "G7": (0.0203, 3.5e-3, 0.0406, 3.0975)}
    config = resolve(RAW)
    assert set(config.stiffness_sets) == set(sets)
    assert set(config.constriction_groups) == set(groups)
    nano, micro = 1e-9, 1e-6
    pairs = [(config.stiffness_sets[name], row) for name, row in sets.items()]
    for name, (*row, velocity) in groups.items():
        group = config.constriction_groups[name]
        assert group.velocity_mm_s == velocity
        pairs.append((group.stiffness, row))
    for stiffness, (ks, kb, kal) in pairs:
        assert stiffness.ks_uN_per_m * 1e-6 == pytest.approx(ks * nano / micro)
        assert stiffness.kb_pN_um * 1e-18 == pytest.approx(kb * nano * micro)
        assert stiffness.kal_uN_per_m * 1e-6 == pytest.approx(kal * nano / micro)
        assert stiffness.kag_uN_per_m * 1e-6 == pytest.approx(0.5 * nano / micro)
        assert stiffness.kv_Pa == pytest.approx(0.9 * nano / micro**2)
        assert stiffness.kvisc_nN_s_per_m * 1e-9 == pytest.approx(1.5 * nano * micro / micro)


def test_stiffness_sets_are_calibrated_by_the_groups_of_the_source():
    groups = resolve(RAW).constriction_groups
    found = {g.stiffness_set: name for name, g in groups.items() if g.stiffness_set}
    assert found == {"1": "G1", "2": "G2", "3": "G5", "4": "G6", "5": "G7"}


def test_gap_must_exceed_radius_and_safety_distance():
    check_gap(Geometry(pillar_radius_um=10, gap_um=12.1, periodicity=6), 2)
    with pytest.raises(DldsimError, match=r"12 µm"):
        check_gap(Geometry(pillar_radius_um=10, gap_um=12, periodicity=6), 2)


def test_smallest_passable_tube():
    """The classic 2.7 µm of a red cell, a little less with the area reserve; slimmer than rest."""
    assert 2.3 < smallest_passable_um(Cell(radius_um=3.91)) < 2.9
    assert 9 < smallest_passable_um(Cell(shape="sphere", radius_um=7.5)) < 15
    sphere = smallest_passable_um(Cell(shape="sphere"))
    round_ellipsoid = smallest_passable_um(Cell(shape="ellipsoid", aspect_ratio=1.0))
    assert round_ellipsoid == pytest.approx(sphere)
    geometry = Geometry(pillar_radius_um=2, gap_um=20, periodicity=4)
    with pytest.raises(DldsimError, match="height_um"):
        check_passable(geometry, Cell(), height_um=4)


def test_design_request_takes_calibrated_indices():
    request = validate(
        DesignRequest, {"name": "a", "stiffness_set_1": "1", "deformation_index_2": 0.7}
    )
    filled = request.with_deformation_indices({"1": 0.5})
    assert (filled.deformation_index_1, filled.deformation_index_2) == (0.5, 0.7)
    with pytest.raises(DldsimError, match="no calibrated"):
        request.with_deformation_indices({"2": 0.5})


def test_json_schema_is_up_to_date():
    stored = (ROOT / "workflow/schemas/config.schema.json").read_text(encoding="utf-8")
    assert json.loads(stored) == json_schema(), "repair with: make schema"
