"""What an assay consists of: cells, membranes, passages."""

from pathlib import Path

import pytest

from dldsim.config import assays
from dldsim.config.assay_sections import AssayCell, ChannelAssay
from dldsim.config.presets import read_config
from dldsim.errors import DldsimError

CONFIG = Path(__file__).parents[2] / "config.yaml"


@pytest.fixture(scope="module")
def config():
    return read_config(CONFIG)


def names(points):
    return [point.membrane for point in points]


def test_the_default_assays(config):
    assert names(assays.points_of("gauge", config)) == ["1", "2", "3", "4", "5"]
    groups = [f"G{i}" for i in range(1, 8)]
    assert names(assays.points_of("group-velocity", config)) == groups
    assert assays.points_of("source-table", config) == []
    assert len(assays.points(config)) == len(set(assays.points(config))) == 5 + 7 + 7
    assert len(assays.points_of_library(config)) == 6 * 5


def test_groups_bring_their_velocity_and_stand_for_sets_at_it_only(config):
    own, fixed = (
        {m.name: m for m in assays.membranes_of(assays.assay_of(name, config), config)}
        for name in ("group-velocity", "fixed-velocity")
    )
    assert own["G5"].velocity_mm_s == 2.739 and own["G5"].stiffness_set == "3"
    assert fixed["G5"].velocity_mm_s == 2.0 and fixed["G5"].stiffness_set == ""


def test_membranes_between_sets_are_log_spaced(config):
    assay = assays.assay_of("gauge", config).model_copy(update={"between": 1})
    found = assays.membranes_of(assay, config)
    assert [m.name for m in found[:3]] == ["1", "ks-6.226", "2"]
    middle = found[1].stiffness
    assert middle.ks_uN_per_m == pytest.approx((5.1 * 7.6) ** 0.5)
    share = (middle.ks_uN_per_m - 5.1) / (7.6 - 5.1)
    assert middle.kal_uN_per_m == pytest.approx(10.2 + share * 5.0)
    assert middle.kag_uN_per_m == 500 and found[1].stiffness_set == ""
    assert len(found) == 9


def test_passages_differ_in_one_thing_at_a_time():
    assay = ChannelAssay(
        kind="channel",
        velocity_mm_s=1,
        offsets_um=[1.0],
        radius_factors=[0.95, 1.05],
        other_axes=["z"],
    )
    first, *others = assays.passages_of(assay, "biconcave")
    assert first == ("nothing", 0.0, 0.0, 1.0, "x")
    for passage in others:
        changed = [a for a, b in zip(first[1:], passage[1:], strict=True) if a != b]
        assert len(changed) == 1
    assert [p.varied for p in others] == ["offset", "size", "size", "orientation"]
    assert [p.varied for p in assays.passages_of(assay, "sphere")[1:]] == ["offset", "size", "size"]


def test_cells_are_the_campaigns_unless_named(config):
    [point] = {(p.shape, p.radius_um) for p in assays.points_of("gauge", config)}
    assert point == ("biconcave", 7.5)
    cells = [AssayCell(shape="sphere", radius_um=6.0)]
    assert {(p.shape, p.radius_um) for p in assays.points_of("gauge", config, cells)} == {
        ("sphere", 6.0)
    }


def test_a_job_reads_what_its_passages_depend_on(config):
    point = assays.points_of("fixed-velocity", config)[0]
    settings = assays.settings_of_point(point, config)
    assert settings["assay"]["channel"] == config.constriction.model_dump(mode="json")
    assert settings["membrane"]["velocity_mm_s"] == 2.0
    assert settings["flow"] == {"viscosity_mPa_s": 1.5}
    assert "spacing_um" not in settings["numerics"] and "axis" not in settings["cell"]


def test_a_flow_rate_is_a_velocity():
    # 40 nl/s through 400 µm² is 0.1 m/s.
    assay = ChannelAssay(kind="channel", flow_rate_nl_per_s=40, width_um=20, height_um=20)
    assert assay.mean_velocity_mm_s == pytest.approx(100)


def test_an_unknown_assay_is_named(config):
    with pytest.raises(DldsimError, match="Did you mean gauge") as caught:
        assays.assay_of("gouge", config)
    assert "source-table" in caught.value.allowed
