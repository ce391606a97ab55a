"""A configuration whose assays are not those that a calibration was made with."""

import pandas as pd
import pytest

from dldsim.app.assay_jobs import write_assay_runs
from dldsim.config.configuration import Partial
from dldsim.config.design_sections import DesignRequest, Device
from dldsim.config.explain import validate
from dldsim.config.presets import read_config
from dldsim.config.sections import Flow
from dldsim.design.assay_settings import check_assays, read_made
from dldsim.design.finished_campaign import (
    check_settings,
    packaged_campaign,
    read_campaign,
    with_default_assay,
)
from dldsim.errors import DldsimError

GAUGE = {"kind": "shear", "stress_Pa": 0.8}
SLIT = {"kind": "constriction", "groups": True}
TABLE = {"kind": "table", "indices": {"1": 0.498, "2": 0.599}}


@pytest.fixture(scope="module")
def known():
    return read_campaign(packaged_campaign(), Device(), 2.0)


def asked(assay=None, **fields):
    cells = {"deformation_index_1": 0.08, "stiffness_set_2": "3"} | fields
    return DesignRequest(name="r", assay=assay, **cells)


def refused(known, settings, request=None):
    with pytest.raises(DldsimError) as caught:
        check_settings(validate(Partial, settings), known, request or asked())
    return caught.value


@pytest.mark.parametrize(
    ("change", "key", "made"),
    [
        ({"stress_Pa": 0.2}, "stress_Pa", "0.8"),
        ({"viscosity_mPa_s": 3.0}, "viscosity_mPa_s", "1.5"),
        ({"strain_window": 20.0}, "strain_window", "10.0"),
        ({"radius_factors": [0.9]}, "radius_factors", "[0.95, 1.05]"),
        ({"kind": "channel", "velocity_mm_s": 2.0, "stress_Pa": None}, "kind", "shear"),
    ],
)
def test_another_assay_of_the_same_name_is_refused(known, change, key, made):
    given = {k: v for k, v in (GAUGE | change).items() if v is not None}
    error = refused(known, {"assays": {"gauge": given}})
    assert error.key == f"assays.gauge.{key}" and error.allowed == made
    assert f"{error.key} = {error.value} in" in str(error) and f"made with {made}" in str(error)
    assert "calibrate --assay gauge" in str(error)


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        ({"constriction": {"throat_width_um": 9.0}}, "constriction.throat_width_um"),
        (
            {"assays": {"group-velocity": SLIT | {"channel": {"throat_width_um": 9.0}}}},
            "assays.group-velocity.channel.throat_width_um",
        ),
        (
            {"assays": {"group-velocity": SLIT | {"velocity_mm_s": 1.0}}},
            "assays.group-velocity.velocity_mm_s",
        ),
        (
            {"assays": {"source-table": {**TABLE, "indices": {"1": 0.3, "2": 0.6}}}},
            "assays.source-table.indices",
        ),
        ({"assays": {"source-table": TABLE | {"error": 0.1}}}, "assays.source-table.error"),
    ],
)
def test_so_are_another_slit_and_other_published_indices(known, settings, key):
    settings = {"assays": {"group-velocity": SLIT}} | settings
    assay = "source-table" if "table" in key else "group-velocity"
    assert refused(known, settings, asked(assay, deformation_index_1=0.7)).key == key


GROUP = {"stiffness": {"ks_uN_per_m": 5.1, "kb_pN_um": 0.0433, "kal_uN_per_m": 10.2}}


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        ({"constriction": {"throat_width_um": 9.0}}, "constriction.throat_width_um"),
        (
            {"constriction_groups": {"G1": GROUP | {"velocity_mm_s": 2.0}}},
            "constriction_groups.G1.velocity_mm_s",
        ),
        (
            {
                "constriction_groups": {
                    "G1": {"velocity_mm_s": 1.095}
                    | {"stiffness": GROUP["stiffness"] | {"kb_pN_um": 1.0}}
                }
            },
            "constriction_groups.G1.stiffness.kb_pN_um",
        ),
    ],
)
def test_slit_and_groups_matter_without_the_assay_beside_them(known, settings, key):
    moduli = {"kag_uN_per_m": 500, "kv_Pa": 900, "kvisc_nN_s_per_m": 1.5}
    for group in settings.get("constriction_groups", {}).values():
        group["stiffness"] = moduli | group["stiffness"]
    request = asked("group-velocity", deformation_index_1=0.68)
    assert refused(known, settings, request).key == key
    check_settings(validate(Partial, settings), known, asked())


def test_an_index_is_read_between_the_membranes_of_the_campaign(known):
    own = known.settings["stiffness_sets"]["1"]
    settings = {"stiffness_sets": {"1": own | {"ks_uN_per_m": 6.0}}}
    assert refused(known, settings).key == "stiffness_sets.1.ks_uN_per_m"
    by_set = asked(deformation_index_1=None, ks_1_uN_per_m=5.0)
    check_settings(validate(Partial, settings), known, by_set)


def test_assays_that_are_not_asked_by_do_not_matter(known):
    other = validate(Partial, {"assays": {"group-velocity": SLIT | {"velocity_mm_s": 1.0}}})
    check_settings(other, known, asked())


def test_the_configuration_of_the_packaged_campaign_is_as_it_was_made(known, pytestconfig):
    config = read_config(pytestconfig.rootpath / "config.yaml")
    for assay in ("gauge", "group-velocity", "fixed-velocity", "source-table"):
        check_assays(config, known.calibration, known.assays, assay)


def test_a_campaign_of_ones_own_tells_its_assays_by_its_passages(tmp_path, known):
    made = {"assay": GAUGE | {"strain_window": 15.0}, "flow": Flow().model_dump()}
    rows = tmp_path / "assays" / "gauge_biconcave-7.5_3.runs.parquet"
    write_assay_runs([], rows, tmp_path / "t.parquet", made)
    found = read_made(tmp_path)
    assert found["gauge"]["strain_window"] == 15.0 and found["gauge"]["viscosity_mPa_s"] > 0
    config = validate(Partial, {"assays": {"gauge": GAUGE | {"strain_window": 10.0}}})
    with pytest.raises(DldsimError, match="strain_window = 10"):
        check_assays(config, known.calibration, found, None)
    # without passages, what the calibration itself tells is compared
    check_assays(config, known.calibration, {}, None)
    config = validate(Partial, {"assays": {"gauge": GAUGE | {"stress_Pa": 0.2}}})
    with pytest.raises(DldsimError, match=r"stress_Pa = 0\.2 .* made with 0\.8"):
        check_assays(config, known.calibration, {}, None)
    check_assays(config, pd.DataFrame(), {}, None)


def test_the_default_assay_is_honoured():
    config = validate(Partial, {"default_assay": "source-table"})
    assert with_default_assay(config, asked()).assay == "source-table"
    assert with_default_assay(config, asked("gauge")).assay == "gauge"
    no_index = asked(deformation_index_1=None, ks_1_uN_per_m=10.0)
    assert with_default_assay(config, no_index).assay is None
    assert with_default_assay(Partial(), asked()).assay is None
    assert with_default_assay(None, asked()).assay is None


def test_what_was_learnt_with_the_survey_is_not_without_it(known):
    assert refused(known, {"surrogate": {"survey": False}}).key == "surrogate.survey"
    check_settings(validate(Partial, {"surrogate": {"survey": True}}), known, asked())
