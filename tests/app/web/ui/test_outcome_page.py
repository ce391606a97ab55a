"""The page of outcomes, against a service in memory: devices, cascades, simulated checks."""

import json

import httpx
import pytest
from streamlit.testing.v1 import AppTest

from dldsim.app.web.api import outcome_specs, specs
from tests.app.web.ui.fake_service import CHECK, ID
from tests.app.web.ui.made_answers import problem
from tests.app.web.ui.reading import button, opened, run_page, sent, sound, texts

pytestmark = pytest.mark.slow


def page_with(**state) -> AppTest:
    """The page of outcomes, not yet run, with a session that has these."""
    page = AppTest.from_string(
        "from dldsim.app.web.ui import outcome_page\noutcome_page.page()", default_timeout=60
    )
    for key, value in state.items():
        page.session_state[key] = value
    return page


def test_outcome_of_an_own_array(service):
    page = sound(run_page("outcome_page"))
    button(page, "Compute the outcome").click().run()
    [asked] = sent(service, "POST", "/outcome")
    spec = outcome_specs.OutcomeSpec(**json.loads(asked.content))
    assert (spec.gap_um, spec.periodicity, spec.array_length_mm) == (12.0, 10, None)
    shown = texts(sound(page))
    assert "does not tell the two cell types apart" in shown and "At the outlets" in shown
    page.number_input(key="form:outcome_gap_um").set_value(13.0).run()
    assert "changed since" in texts(sound(page))


def test_refused_outcome_is_shown_at_its_field(service):
    found = problem("infeasible", "outlets = 9: too many", "outlets")
    service.refuse["POST /outcome"] = 422, found
    page = run_page("outcome_page")
    button(page, "Compute the outcome").click().run()
    assert texts(sound(page)).count("outlets = 9\\: too many") == 2


def test_a_cascade_is_asked_for_and_shown_by_device(service):
    page = run_page("outcome_page")
    page.toggle(key="form:cascade").set_value(True).run()
    page.number_input(key="form:then_periodicity").set_value(6)
    page.number_input(key="form:then_outlets").set_value(3).run()
    button(sound(page), "Compute the outcome").click().run()
    [asked] = sent(service, "POST", "/outcome")
    spec = outcome_specs.OutcomeSpec(**json.loads(asked.content))
    assert (spec.from_outlet, spec.then.periodicity, spec.then.outlets) == (2, 6, 3)
    shown = texts(sound(page))
    assert "outlets of the first device" in shown and "outlets of the second device" in shown
    page.toggle(key="form:cascade").set_value(False).run()
    button(page, "Compute the outcome").click().run()
    assert "then" not in json.loads(sent(service, "POST", "/outcome")[1].content)


def test_refused_cascade_is_shown_at_the_second_array(service):
    found = problem("infeasible", "The second device: too short", "then.array_length_mm")
    service.refuse["POST /outcome"] = 422, found
    page = run_page("outcome_page")
    page.toggle(key="form:cascade").set_value(True).run()
    button(page, "Compute the outcome").click().run()
    assert texts(sound(page)).count("The second device\\: too short") == 2


def test_a_check_is_watched_then_shown_beside_the_prediction(service):
    page = run_page("outcome_page")
    page.toggle(key="form:cascade").set_value(True).run()
    button(page, "Compute the outcome").click().run()
    page.number_input(key="form:simulate").set_value(4).run()
    button(page, "Simulate them").click().run()
    [asked] = sent(service, "POST", "/checks")
    spec = outcome_specs.CheckSpec(**json.loads(asked.content))  # of the first device alone
    assert (spec.simulate, spec.gap_um) == (4, 12.0)
    shown = texts(sound(page)).replace("\\", "")
    assert "Simulating (0.5 min): cell 1 of 4" in shown and "Attempt 2" in shown
    service.finish_check()
    shown = texts(sound(page.run())).replace("\\", "")
    assert "2 of 2 simulated cells leave by its outlet" in shown and "They agree" in shown
    assert "1 of 2 simulated cells leave by its outlet" in shown and "They do not agree" in shown


def test_a_check_in_the_address_brings_its_request_back(service):
    spec = outcome_specs.CheckSpec(
        stiffness_set_1="1", ks_2_uN_per_m=9.0, gap_um=13.0, pillar_radius_um=7.0, periodicity=8
    )
    service.post_checks(httpx.Request("POST", "http://api", content=spec.model_dump_json()), [])
    page = page_with(check=CHECK)
    page = sound(page.run())
    assert page.number_input(key="form:outcome_gap_um").value == 13.0
    assert page.number_input(key="form:ks_2_uN_per_m").value == 9.0
    button(page, "Cancel the simulation").click().run()
    assert sent(service, "DELETE", f"/checks/{CHECK}")
    assert "was cancelled" in texts(sound(page.run()))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"state": "failed", "error": "no moduli", "result": None}, "no moduli"),
        ({"state": "queued", "queue_position": 2, "result": None}, "2 jobs are before this one"),
    ],
)
def test_a_check_that_waits_or_failed_says_so(service, change, words):
    spec = outcome_specs.CheckSpec(
        stiffness_set_1="1", stiffness_set_2="3", gap_um=13.0, pillar_radius_um=7.0, periodicity=8
    )
    service.post_checks(httpx.Request("POST", "http://api", content=spec.model_dump_json()), [])
    service.finish_check(**change)
    page = page_with(check=CHECK)
    assert words in texts(sound(page.run()))


def test_an_unknown_check_can_be_forgotten(service):
    page = page_with(check=CHECK)
    page = sound(page.run())
    assert "Not found" in texts(page)
    button(page, "Forget this check").click().run()
    assert "Not found" not in texts(sound(page))


def test_a_candidate_can_be_taken_from_its_page_with_its_form(service):
    """Its fields are drawn already when the button is."""
    spec = specs.DesignSpec(stiffness_set_1="1", stiffness_set_2="3")
    service.designs[ID] = service.status(ID, spec, "done")
    page = sound(opened(design=ID))
    [found] = [b for b in page.button if "page Outcome" in b.label]
    sound(found.click().run())
    taken = {k: page.session_state[f"form:outcome_{k}"] for k in ("gap_um", "periodicity")}
    first = service.designs[ID].result.designs[0]
    assert taken == {"gap_um": first.gap_um, "periodicity": first.periodicity}


def test_a_candidate_is_taken_to_the_page_of_outcomes(service):
    from dldsim.app.web.ui import outcome_page

    spec = specs.DesignSpec(stiffness_set_1="1", ks_2_uN_per_m=9.0, draws=32)
    design = {"pillar_radius_um": 6.5, "gap_um": 13.5, "periodicity": 7}
    taken = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(outcome_page.st, "session_state", taken)
        outcome_page.take(spec, design, 3.2, 612.5)
    page = page_with(**taken)
    button(sound(page.run()), "Compute the outcome").click().run()
    asked = json.loads(sent(service, "POST", "/outcome")[0].content)
    assert {k: asked[k] for k in design} == design and asked["array_length_mm"] == 3.2
    assert asked["outlet_walls_um"] == [612.5]
    assert (asked["stiffness_set_1"], asked["ks_2_uN_per_m"], asked["draws"]) == ("1", 9.0, 32)


def test_csv_of_an_outcome_leaves_unknown_values_empty():
    from dldsim.app.web.ui.outlets_chapter import as_csv, interval

    assert as_csv([{"purity": None, "recovery": 0.5}]) == "purity,recovery\n,0.5\n"
    assert interval({"purity": None}, "purity") == "–"
