"""What a request is simulated with: its own shapes, velocity and height."""

import pandas as pd
import pytest

from dldsim.analysis.domain import domains_of
from dldsim.app import design_answers
from dldsim.config.design_sections import DesignRequest, Device, Verification
from dldsim.design import finished_campaign
from dldsim.design.verified import Verdicts
from tests.analysis.made_outcomes import make_survey


@pytest.fixture
def asked(campaign, monkeypatch, tmp_path):
    """What a verification is asked with for a request."""
    known = finished_campaign.read_campaign(campaign, Device(), 2.0)
    known.model.domains = domains_of(make_survey(60, 60))
    known.tables["survey"] = make_survey(8, 8)
    seen = {}

    def verify(model, outcomes, request, chip, budget, populations, simulator, seed, **more):
        seen.update(chip=chip, populations=populations, simulator=simulator, **more)
        none = pd.DataFrame()
        return Verdicts(none, pd.DataFrame({"separation_deg": []}), none, none, {})

    monkeypatch.setattr(design_answers, "verify", verify)
    monkeypatch.setattr(design_answers, "export", lambda *arguments: {})
    settings = known.settings | {"seed": 1, "verification": Verification().model_dump()}

    def ask(**named):
        design_answers.verify_request(
            DesignRequest(name="r", **named),
            settings,
            known.chip,
            known.model,
            known.tables,
            work=tmp_path / "work",
            files=tmp_path / "files",
            progress=None,
        )
        return seen

    return ask


def test_a_request_is_simulated_at_its_own_velocity_height_and_shapes(asked):
    seen = asked(
        shape_1="sphere",
        rigid_1=True,
        ks_2_uN_per_m=8.0,
        radius_2_um=5.0,
        velocity_mm_s=1.5,
        height_um=26.0,
    )
    flow = seen["simulator"].scene.flow
    assert (flow.mean_velocity_mm_s, flow.height_um, flow.viscosity_mPa_s) == (1.5, 26.0, 1.5)
    assert seen["chip"].flow == flow and "height 20 µm" in seen["chip"].no_resistance
    bead, disc = seen["populations"]
    assert [p.flow for p in (bead, disc)] == [flow, flow]
    cells = [seen["simulator"]._cell(population) for population in (bead, disc)]
    assert [(c.shape, c.radius_um) for c in cells] == [("sphere", 7.5), ("biconcave", 5.0)]
    assert disc.stiffness.ks_uN_per_m == 8.0
    assert bead.stiffness.ks_uN_per_m == pytest.approx(1.5 * 1.5 / bead.capillary_number)


def test_without_them_it_is_the_campaigns_flow_and_the_survey_is_learnt_from(asked):
    seen = asked(stiffness_set_1="1", stiffness_set_2="3")
    assert seen["chip"].flow.mean_velocity_mm_s == 0.5 and seen["chip"].resistance is not None
    assert len(seen["fit"].keywords["survey"]) == 16
