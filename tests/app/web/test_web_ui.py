"""The page, against a service in memory: requests, states, results and refusals."""

import ast
import json
from pathlib import Path

import httpx
import pytest
from streamlit.testing.v1 import AppTest

from dldsim.app.web.api import answers, outcome_specs, specs
from dldsim.app.web.ui import SCRIPT, client
from dldsim.app.web.ui.parts import allowed, plain
from tests.app.web import web_page_fake
from tests.app.web.web_page_fake import CHECK, HIGH, ID, LOW, Fake

pytestmark = pytest.mark.slow

PAGE = Path(SCRIPT).parent


@pytest.fixture
def service(monkeypatch):
    import streamlit as st

    fake = Fake()
    connection = httpx.Client(base_url="http://api", transport=httpx.MockTransport(fake))
    monkeypatch.setattr(client, "connect", lambda base: connection)
    st.cache_data.clear()
    return fake


def opened(**query) -> AppTest:
    page = AppTest.from_file(str(SCRIPT), default_timeout=60)
    for name, value in query.items():
        page.query_params[name] = value
    return page.run()


def texts(page: AppTest) -> str:
    kinds = (
        "title",
        "header",
        "subheader",
        "markdown",
        "caption",
        "error",
        "warning",
        "info",
        "success",
    )
    return "\n".join(e.value for kind in kinds for e in getattr(page, kind))


def button(page: AppTest, label: str):
    [found] = [b for b in page.button if b.label == label]
    return found


def sound(page: AppTest) -> AppTest:
    assert not page.exception, page.exception[0].message
    return page


def sent(service: Fake, method: str, path: str) -> list:
    return [r for r in service.asked if r.method == method and r.url.path == "/api/v1" + path]


@pytest.mark.parametrize("path", sorted(PAGE.glob("*.py")), ids=lambda p: p.stem)
def test_the_page_asks_and_never_computes(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    found = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    found |= {a.name for node in ast.walk(tree) if isinstance(node, ast.Import) for a in node.names}
    own = {name for name in found if name.startswith("dldsim")}
    shared = {"dldsim.app.web.api", "dldsim.vocabulary"}
    assert all(n.startswith("dldsim.app.web.ui") for n in own - shared)


# ------------------------------------------------------------------------------------ design page


def test_default_form_is_a_request_that_the_contract_takes(service):
    page = sound(opened())
    button(page, "Search for designs").click().run()
    [request] = sent(service, "POST", "/designs")
    spec = specs.DesignSpec(**json.loads(request.content))
    assert LOW <= spec.deformation_index_1 < spec.deformation_index_2 <= HIGH
    assert spec.gap_um == (12.0, 22.0) and spec.periodicity == (4, 12)
    assert sound(page).query_params["design"] in (ID, [ID])


def test_fields_show_unit_and_allowed_range(service):
    page = opened()
    radius = page.number_input(key="form:radius_1_um")
    [limit] = [f for f in answers.limits_of(specs.DesignSpec) if f.name == "radius_1_um"]
    assert "[µm]" in radius.label and radius.max == limit.maximum
    assert f"allowed {allowed(limit)}" in texts(page)
    assert page.slider(key="form:trials").max == 500  # the service takes fewer than the contract


def test_search_shows_its_course_then_the_dashboard(service):
    page = opened()
    button(page, "Search for designs").click().run()
    assert "Searching" in texts(page)
    service.finish()
    page = sound(page.run())
    shown = texts(page)
    for words in (
        "Ranked candidates",
        "Downloads",
        "Importance for the objective",
        "made\\-up",
        "Parallel coordinates",
        "Predicted difference",
        "Verification by simulation",
        "Search 2.0 s of 3.1 s",
        "The best candidate is extrapolated",
    ):
        assert words in shown
    assert "extrapolated: it lies outside" in shown  # the candidate that is looked at


def test_headline_figures_wrap_and_are_never_cut(service):
    """Not in columns, whose width cuts them, and as wide as they are."""
    page = opened()
    button(page, "Search for designs").click().run()
    service.finish()
    page = sound(page.run())
    assert len(page.metric) == 5

    def holders(block, found=()):
        for child in getattr(block, "children", {}).values():
            if child.type == "metric":
                yield found
            yield from holders(child, (*found, child.type))

    assert all("column" not in found for found in holders(page.main))


def test_periodicity_is_typed_like_the_other_bounds(service):
    page = opened()
    assert not [s for s in page.slider if "periodicity" in s.key]
    page.number_input(key="form:periodicity_low").set_value(5).run()
    button(page, "Search for designs").click().run()
    [request] = sent(service, "POST", "/designs")
    assert json.loads(request.content)["periodicity"] == [5, 12]


def test_the_first_lines_say_what_answers_hold_for(service):
    page = opened()
    first = [e.value for e in page.main if hasattr(e, "value")][:3]
    assert any("Holds for biconcave discs" in str(text) for text in first), first


def test_the_dashboard_does_not_wait_for_the_files(service):
    page = opened()
    button(page, "Search for designs").click().run()
    service.finish()
    done = service.designs[ID]
    service.designs[ID] = done.model_copy(update={"state": "running", "files": []})
    shown = texts(sound(page.run()))
    assert "Ranked candidates" in shown and "Masks and report are being written" in shown
    service.designs[ID] = done
    assert "are being written" not in texts(sound(page.run()))


def test_cancelled_and_failed_searches_say_so(service):
    page = opened()
    button(page, "Search for designs").click().run()
    button(page, "Cancel").click().run()
    assert sent(service, "DELETE", f"/designs/{ID}")
    assert "cancelled" in texts(sound(page.run()))
    page = opened()
    button(page, "Search for designs").click().run()
    other = page.query_params["design"]
    service.finish(other if isinstance(other, str) else other[0], "failed")
    assert "The search failed" in texts(sound(page.run())) and "no memory" in texts(page)


def test_design_in_the_address_brings_request_and_result_back(service):
    spec = specs.DesignSpec(
        stiffness_set_1="1",
        deformation_index_2=0.7,
        radius_2_um=9.0,
        gap_um=(13, 19),
        trials=30,
        objective="separation",
    )
    service.designs[ID] = service.status(ID, spec, "done")
    page = sound(opened(design=ID))
    assert "Ranked candidates" in texts(page)
    assert page.number_input(key="form:radius_2_um").value == 9.0
    assert page.number_input(key="form:gap_um_low").value == 13.0
    assert page.radio(key="form:by_1").value == "stiffness set"
    button(page, "Search for designs").click().run()
    again = specs.DesignSpec(**json.loads(sent(service, "POST", "/designs")[0].content))
    assert again == spec


@pytest.mark.parametrize(
    ("verdict", "words"),
    [
        (
            answers.Verdict(state="running", message="step 12 of 40", elapsed_s=90.0),
            "Simulating (1.5 min): step 12 of 40",
        ),
        (answers.Verdict(state="failed", message="no moduli"), "The simulation failed"),
        (answers.Verdict(state="cancelled"), "The simulation was cancelled"),
        (
            answers.Verdict(
                state="done",
                designs=[
                    web_page_fake.row(
                        "verified_designs", rank=1, separates=True, verdict="separates as predicted"
                    )
                ],
                verifications=[
                    web_page_fake.row(
                        "verifications",
                        population="difference",
                        role="design",
                        agrees=True,
                        simulated_deg=2.0,
                    )
                ],
            ),
            "separates as predicted",
        ),
    ],
)
def test_verdict_of_the_simulation_is_attached(service, verdict, words):
    spec = specs.DesignSpec(deformation_index_1=LOW, deformation_index_2=HIGH, verify=True)
    service.designs[ID] = service.status(ID, spec, "done").model_copy(
        update={"verification": verdict}
    )
    page = sound(opened(design=ID))
    assert words in texts(page).replace("\\", "")


def test_address_with_something_else_never_reaches_the_service(service):
    page = sound(opened(design="../health"))
    assert "no id" in texts(page)
    assert not [r for r in service.asked if "designs" in r.url.path]


def test_unknown_design_is_said_and_can_be_forgotten(service):
    page = sound(opened(design=ID))
    assert "Not found" in texts(page)
    button(page, "Forget this design").click().run()
    assert "Not found" not in texts(sound(page))


def test_fields_survive_another_page(service):
    page = opened()
    page.number_input(key="form:radius_1_um").set_value(6.0).run()
    state = page.session_state["form:radius_1_um"]
    page.run()
    assert state == page.number_input(key="form:radius_1_um").value == 6.0


# ---------------------------------------------------------------------------------------- refusals


def problem(kind: str, message: str, field: str = "", **more) -> answers.Problem:
    fields = [answers.FieldProblem(field=field, value="", message=message)] if field else []
    return answers.Problem(error=kind, message=message, fields=fields, **more)


@pytest.mark.parametrize(
    ("status", "found", "words"),
    [
        (
            422,
            problem(
                "infeasible",
                "deformation_index_2 = 0.9 is outside, 0.68 to 0.74",
                "deformation_index_2",
            ),
            "This request cannot be met",
        ),
        (
            422,
            problem("invalid", "gap_um = (5, 4): lowest bound first", "gap_um.0"),
            "The request was refused",
        ),
        (429, problem("busy", "The queue is full.", retry_after_s=7), "Try again in 7 s"),
        (503, problem("unhealthy", "no worker"), "cannot answer now"),
        (500, problem("defect", "The service failed at this request"), "This did not work"),
    ],
)
def test_refused_request_is_shown_in_place_and_the_form_stays(service, status, found, words):
    service.refuse["POST /designs"] = status, found
    page = opened()
    page.number_input(key="form:radius_1_um").set_value(6.0).run()
    button(page, "Search for designs").click().run()
    shown = texts(sound(page))
    assert words in shown and plain(found.message) in shown
    if found.fields:  # above the button, and at the field
        assert shown.count(plain(found.message)) == 2
    assert page.number_input(key="form:radius_1_um").value == 6.0
    del service.refuse["POST /designs"]
    button(page, "Search for designs").click().run()
    assert words not in texts(sound(page))


def test_silent_service_is_said_with_the_remedy(service):
    service.down = True
    page = sound(opened())
    assert "cannot be reached" in texts(page) and "make web" in texts(page).replace("\\", "")
    service.down = False
    button(page, "Try again").click().run()
    assert "Cell type 1" in texts(sound(page))


def test_service_that_goes_away_during_a_search_is_asked_again(service):
    page = opened()
    button(page, "Search for designs").click().run()
    service.down = True
    assert "does not answer" in texts(sound(page.run()))
    service.down = False
    service.finish()
    assert "Ranked candidates" in texts(sound(page.run()))


def test_answer_of_another_program_is_told_from_a_refusal(monkeypatch):
    other = httpx.Client(
        base_url="http://api",
        transport=httpx.MockTransport(
            lambda r: httpx.Response(404, text="<html>no such page</html>")
        ),
    )
    monkeypatch.setattr(client, "connect", lambda base: other)
    with pytest.raises(client.ApiError, match="something else at that address"):
        client.model(None)


def test_text_of_others_is_no_markup():
    assert plain("![x](y) *b* `make -j`") == r"\!\[x\]\(y\) \*b\* `make -j`"


# -------------------------------------------------------------------------------- the other pages


def test_campaign_page_shows_angles_calibration_and_a_prediction(service):
    page = sound(run_page("campaign_page"))
    shown = texts(page)
    assert "27 outcomes, 6 of them without an angle" in shown
    assert "the true one is wider" in shown
    button(page, "Predict").click().run()
    assert "Full bump" in texts(sound(page)) and "outside" in texts(page)
    [asked] = sent(service, "POST", "/predict")
    specs.PredictSpec(**json.loads(asked.content))


def run_page(name: str) -> AppTest:
    return AppTest.from_string(
        f"from dldsim.app.web.ui import {name}\n{name}.page()", default_timeout=60
    ).run()


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


# ----------------------------------------------------------------------------- cells and outlets


def test_cells_of_any_shape_and_scatter_are_asked_for(service):
    page = opened()
    page.radio(key="form:shape_1").set_value("sphere").run()
    page.radio(key="form:by_1").set_value("bead").run()
    page.radio(key="form:by_2").set_value("spring constant k_s").run()
    page.number_input(key="form:ks_2_uN_per_m").set_value(12.0)
    page.number_input(key="form:radius_std_1_um").set_value(0.3)
    page.number_input(key="form:velocity_mm_s").set_value(1.5)
    page.radio(key="form:objective").set_value("purity-recovery").run()
    page.number_input(key="form:footprint_max_mm2").set_value(8.0).run()
    button(sound(page), "Search for designs").click().run()
    [request] = sent(service, "POST", "/designs")
    spec = specs.DesignSpec(**json.loads(request.content))
    assert spec.rigid_1 and spec.shape_1 == "sphere" and spec.radius_std_1_um == 0.3
    assert (spec.ks_2_uN_per_m, spec.velocity_mm_s, spec.height_um) == (12.0, 1.5, None)
    assert (spec.objective, spec.footprint_max_mm2) == ("purity-recovery", 8.0)


def test_a_bead_becomes_a_cell_again_with_its_shape(service):
    page = opened()
    page.radio(key="form:shape_1").set_value("sphere").run()
    page.radio(key="form:by_1").set_value("bead").run()
    page.radio(key="form:shape_1").set_value("biconcave").run()
    assert page.radio(key="form:by_1").value == "deformation index"
    assert "bead" not in page.radio(key="form:by_1").options


def test_measured_cells_are_sent_as_they_are_and_can_be_removed(service):
    table = "radius_um\n6.0\n6.5\n"
    page = opened()
    page.session_state["form:population_1_csv"] = table
    page = sound(page.run())
    assert "2 measured cells" in texts(page)
    button(page, "Search for designs").click().run()
    spec = specs.DesignSpec(**json.loads(sent(service, "POST", "/designs")[0].content))
    assert spec.population_1_csv == table and spec.radius_1_um == 6.25
    page = sound(opened())
    page.session_state["form:population_1_csv"] = table
    page.run()
    button(page, "Remove the table").click().run()
    assert "measured cells" not in texts(sound(page))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_tables_of_spreadsheets_become_text(encoding):
    from dldsim.app.web.ui.cells_form import text_of

    assert text_of("radius_um;größe\n5,1;1".encode(encoding)) == "radius_um;größe\n5,1;1"


def test_outlets_of_a_candidate_are_shown_with_intervals(service):
    spec = specs.DesignSpec(stiffness_set_1="1", stiffness_set_2="3")
    service.designs[ID] = service.status(ID, spec, "done")
    page = sound(opened(design=ID))
    shown = texts(page)
    assert "At the outlets" in shown and "exceed **81%**" in shown
    tables = [t.value for t in page.dataframe]
    assert any("90.0% (80.0% to 95.0%)" in t.to_string() for t in tables)
    assert "transients as \\*outcomes\\* have them" in shown


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


def page_with(**state) -> AppTest:
    """The page of outcomes, not yet run, with a session that has these."""
    page = AppTest.from_string(
        "from dldsim.app.web.ui import outcome_page\noutcome_page.page()", default_timeout=60
    )
    for key, value in state.items():
        page.session_state[key] = value
    return page


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
