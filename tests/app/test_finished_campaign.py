"""What a finished campaign knows: its settings, and the survey that it learnt from."""

import pytest

from dldsim.analysis import learning, surrogate
from dldsim.app import design_answers
from dldsim.config.configuration import Partial
from dldsim.config.design_sections import DesignRequest, Device
from dldsim.config.explain import validate
from dldsim.config.sections import Flow, Numerics
from dldsim.design import finished_campaign
from dldsim.errors import DldsimError
from dldsim.tables.parquet import read_table, write_table
from tests.analysis.made_outcomes import make_survey
from tests.app.conftest import filled


def test_a_campaign_that_learnt_from_the_survey_has_it_among_its_tables(
    campaign, tmp_path, monkeypatch
):
    for name in ("outcomes", "calibration", "flows"):
        target = tmp_path / f"{name}.parquet"
        target.write_bytes((campaign / f"{name}.parquet").read_bytes())
    kept = tmp_path / "survey.parquet"
    monkeypatch.setattr(learning, "SURVEY", kept)
    write_table("outcomes", filled("outcomes", make_survey(40, 30)), kept, {})
    outcomes = read_table("outcomes", tmp_path / "outcomes.parquet")
    model = surrogate.fit(outcomes, 1, learning.read_survey())
    model.save(tmp_path / "surrogate.json", tmp_path / "surrogate_card.json")
    known = finished_campaign.read_campaign(tmp_path, Device(), 2.0)
    assert len(known.tables["survey"]) == 70 and set(known.model.domains) == {"biconcave", "sphere"}
    write_table("outcomes", filled("outcomes", make_survey(40, 31)), kept, {})
    with pytest.raises(DldsimError, match="and the survey that comes with the package"):
        finished_campaign.read_campaign(tmp_path, Device(), 2.0)
    kept.unlink()
    with pytest.raises(DldsimError, match="No survey comes"):
        finished_campaign.read_campaign(tmp_path, Device(), 2.0)


def test_a_field_that_is_named_as_nothing_is_not_named(campaign):
    known = finished_campaign.read_campaign(campaign, Device(), 2.0)
    config = validate(Partial, {"flow": {"mean_velocity_mm_s": 5.0}})
    indices = {"deformation_index_1": 0.5, "deformation_index_2": 0.7}
    request = DesignRequest(name="r", **indices, radius_1_um=7, radius_2_um=7, velocity_mm_s=None)
    with pytest.raises(DldsimError, match=r"mean_velocity_mm_s = 5\.0 .* --velocity"):
        finished_campaign.check_settings(config, known, request)


@pytest.mark.parametrize(("key", "value"), [("contact_range_um", 0.1), ("area_forces", "gradient")])
def test_numerics_that_say_what_a_cell_is_matter_to_every_answer(campaign, key, value):
    known = finished_campaign.read_campaign(campaign, Device(), 2.0)
    config = validate(Partial, {"numerics": {key: value}})
    with pytest.raises(DldsimError, match=rf"numerics\.{key} = {value} .* campaign with"):
        finished_campaign.check_settings(config, known)


def test_other_numerics_matter_only_to_a_simulation(campaign):
    known = finished_campaign.read_campaign(campaign, Device(), 2.0)
    config = validate(Partial, {"numerics": {"spacing_um": 0.8}})
    request = DesignRequest(
        name="r", deformation_index_1=0.5, deformation_index_2=0.7, radius_1_um=7, radius_2_um=7
    )
    finished_campaign.check_settings(config, known, request)
    with pytest.raises(DldsimError, match=r"numerics\.spacing_um = 0\.8 .* 1\.25"):
        finished_campaign.check_settings(config, known, request, simulate=True)


def test_a_kept_campaign_answers_like_its_results(campaign, tmp_path):
    kept = tmp_path / "kept"
    finished_campaign.keep_campaign(campaign, kept)
    first, second = (
        finished_campaign.read_campaign(place, Device(), 2.0) for place in (campaign, kept)
    )
    assert first.settings == second.settings and first.model.card == second.model.card
    for kind, table in first.tables.items():
        assert table.equals(second.tables[kind])
    (kept / "flows.parquet").unlink()
    with pytest.raises(DldsimError, match=r"flows\.parquet"):
        finished_campaign.keep_campaign(kept, tmp_path / "again")


def test_settings_are_those_of_the_runs(campaign):
    known = finished_campaign.read_campaign(campaign, Device(), 2.0)
    assert Flow(**known.settings["flow"]) == Flow()
    assert known.settings["flow"]["viscosity_mPa_s"] == 1.5
    assert Numerics(**known.settings["numerics"]) == Numerics()
    assert known.settings["run_control"]["max_rows"] == 7
    assert known.settings["stiffness_sets"]["3"]["ks_uN_per_m"] == 20.3
    scene = design_answers.scene_of(known.settings)
    assert scene.cell.axis == "y" and scene.flow.height_um == 20.0


@pytest.mark.parametrize(
    ("column", "value"), [("height_um", 30.0), ("kernel", "linear"), ("wanted_spacing_um", 0.9)]
)
def test_runs_of_several_channels_or_numerics_are_refused(campaign, column, value):
    outcomes = read_table("outcomes", campaign / "outcomes.parquet")
    outcomes.loc[0, column] = value
    with pytest.raises(DldsimError, match=f"mixes several values of {column}") as caught:
        finished_campaign.settings_of_outcomes(outcomes)
    assert caught.value.key == column


def test_values_that_no_configuration_has_are_refused_by_column(campaign):
    outcomes = read_table("outcomes", campaign / "outcomes.parquet")
    for column, value in (("kernel", "round"), ("rows_in_domain", 0), ("cell_shape", "cube")):
        with pytest.raises(DldsimError) as caught:
            finished_campaign.settings_of_outcomes(outcomes.assign(**{column: value}))
        error = caught.value
        assert (error.key, error.value) == (column, value) and error.allowed in str(error)
