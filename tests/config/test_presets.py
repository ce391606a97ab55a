"""Files, presets and the command line, one over the other, to one configuration."""

from pathlib import Path

import pytest
import yaml

from dldsim.config.presets import merge, read_config, read_layer, read_partial, resolve
from dldsim.errors import DldsimError

ROOT = Path(__file__).parents[2]
RAW = yaml.safe_load((ROOT / "config.yaml").read_text(encoding="utf-8"))


@pytest.mark.parametrize("preset", RAW["presets"])
def test_presets_are_valid(preset):
    assert resolve(RAW, {"preset": preset}).preset == preset


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


@pytest.mark.parametrize(
    ("raw", "overrides", "key", "parts"),
    [
        ({}, {"preset": ""}, "preset", ["Unknown preset ''", "quick, paper"]),
        ({}, {"preset": None}, "preset", ["no value"]),  # what Snakemake makes of preset=
        ({}, {"seed": None}, "seed", ["no value"]),
        ({"preset": ["quick"]}, {}, "preset", ["['quick']", "quick, paper"]),
        ({"preset": {"quick": 1}}, {}, "preset", ["quick, paper"]),
        ({"preset": 3}, {}, "preset", ["Unknown preset 3"]),
        ({"presets": 5}, {}, "presets", ["presets = 5", "partial configurations"]),
        ({"presets": []}, {}, "presets", ["presets = []", "partial configurations"]),
        ({"presets": {"quick": [1]}}, {}, "presets.quick", ["[1]", "sections"]),
        ({}, {2: None}, "2", ["unknown key"]),
        ({}, {"flwo": None}, "flwo", ["unknown key", "Did you mean flow?"]),
        ({"flow": {"height": None}}, {}, "flow.height", ["unknown key"]),
        ({}, {"constriction_groups": {"G9": None}}, "constriction_groups.G9", ["None"]),
    ],
)
def test_what_is_no_preset_or_no_key_is_refused(raw, overrides, key, parts):
    with pytest.raises(DldsimError) as caught:
        resolve(merge(RAW, raw), overrides)
    assert key in caught.value.keys, caught.value.keys
    assert all(part in str(caught.value) for part in parts), str(caught.value)


def test_a_null_takes_out_what_is_there():
    taken = resolve(RAW, {"constriction_groups": {"G3": None}, "flow": {"height_um": None}})
    assert "G3" not in taken.constriction_groups and taken.flow.height_um == 20
    assert "fixed-velocity" not in resolve(RAW, {"assays": {"fixed-velocity": None}}).assays


def test_one_section_is_enough_for_single_commands(tmp_path):
    path = tmp_path / "flow.yaml"
    path.write_text("flow: {height_um: 12}\n")
    found = read_partial(path)
    assert (found.flow.height_um, found.sweep, found.stiffness_sets) == (12, None, {})
    with pytest.raises(DldsimError) as caught:
        read_config(path)
    assert set(caught.value.keys) == {"sweep", "stiffness_sets", "assays"}
    path.write_text("flow: {heigth_um: 12}\n")
    with pytest.raises(DldsimError, match="Did you mean height_um"):
        read_partial(path)


def test_later_configurations_win_each_with_its_preset_over_its_shared_sections():
    raw = merge(RAW, {"numerics": {"rows": 2}})
    raw["presets"] = merge(RAW["presets"], {"quick": {"numerics": {"spacing_um": 0.9, "rows": 3}}})
    mine = {"numerics": {"spacing_um": 0.7, "rows": 4}}
    assert resolve(raw, files=[mine]).numerics.spacing_um == 0.7
    assert resolve(raw, {"numerics": {"rows": 1}}, [mine]).numerics.rows == 1
    whole = mine | {"presets": {"quick": {"numerics": {"rows": 3}}}}
    numerics = resolve(raw, files=[whole]).numerics
    assert (numerics.spacing_um, numerics.rows) == (0.7, 3)
    own = {"preset": "mine", "presets": {"mine": raw["presets"]["tiny"]}}
    assert resolve(raw, files=[own]).preset == "mine"
    assert resolve(raw, {"preset": "tiny"}, [own]).preset == "tiny"
    with pytest.raises(DldsimError, match="presets.quick = 5: allowed sections"):
        resolve(raw, files=[{"presets": {"quick": 5}}])


def test_later_files_go_over_earlier_ones(tmp_path):
    first, second = tmp_path / "a.yaml", tmp_path / "b.yaml"
    first.write_text("flow: {height_um: 12, viscosity_mPa_s: 2}\nseed: 010\n")
    second.write_text("flow: {height_um: null}\n")
    found = resolve(RAW, files=[read_layer(first), read_layer(second)])
    assert (found.flow.height_um, found.flow.viscosity_mPa_s, found.seed) == (20, 2, 10)
    second.write_text("[1]")
    with pytest.raises(DldsimError, match="not a mapping"):
        read_layer(second)


def test_a_preset_without_a_name_is_refused():
    for files in ({}, {"preset": None}):
        with pytest.raises(DldsimError, match="preset: no value"):
            resolve(RAW | (files or {"preset": None}), files=[files])
