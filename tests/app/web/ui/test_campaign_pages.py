"""Pages of the campaign and of measurements, against a service in memory."""

import json

import pytest
from streamlit.testing.v1 import AppTest

from dldsim.app.web.api import specs
from tests.app.web.ui.made_answers import problem
from tests.app.web.ui.reading import button, run_page, sent, sound, texts

pytestmark = pytest.mark.slow


def test_campaign_page_shows_angles_calibration_and_a_prediction(service):
    page = sound(run_page("campaign_page"))
    shown = texts(page)
    assert "27 outcomes, 6 of them without an angle" in shown
    assert "the true one is wider" in shown
    button(page, "Predict").click().run()
    assert "Full bump" in texts(sound(page)) and "outside" in texts(page)
    [asked] = sent(service, "POST", "/predict")
    specs.PredictSpec(**json.loads(asked.content))


def test_refused_inversion_is_shown_below_its_fields(service):
    service.refuse["POST /stiffness"] = (
        422,
        problem(
            "infeasible", "deformation_index = 0.9: calibrated 0.68 to 0.74", "deformation_index"
        ),
    )
    shown = texts(sound(run_page("campaign_page")))
    assert shown.count("calibrated 0\\.68 to 0\\.74") == 1


def test_measurements_are_refused_in_place(service):
    service.refuse["POST /measurements"] = (
        422,
        problem("invalid", "measurements: at least 1 of", "measurements"),
    )
    page = run_page("measurements_page")
    button(page, "Fit with these angles").click().run()
    assert texts(sound(page)).count("measurements\\: at least 1 of") >= 1


def test_campaign_that_is_ready_can_be_used_and_deleted(service):
    found = json.loads(service._campaign("my *own*", "uploaded", 5).text)
    page = AppTest.from_string(
        "from dldsim.app.web.ui import measurements_page\nmeasurements_page.page()",
        default_timeout=60,
    )
    page.session_state["campaigns_made"] = {found["id"]: found["name"]}
    page = sound(page.run())
    assert "my \\*own\\*" in texts(page) and "is ready" in texts(page)
    button(page, "Use it").click().run()
    assert page.session_state["campaign"] == found["id"]
    assert sent(service, "GET", "/model")[-1].url.params["campaign"] == found["id"]
    button(page, "Delete it").click().run()
    assert page.session_state["campaign"] is None and not service.campaigns
