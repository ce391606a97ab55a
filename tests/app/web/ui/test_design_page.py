"""The page of designs, against a service in memory: its form, states and results."""

import json

import pytest

from dldsim.app.web.api import answers, field_limits, specs
from dldsim.app.web.ui.parts import allowed
from tests.app.web.ui import made_answers
from tests.app.web.ui.fake_service import ID
from tests.app.web.ui.made_answers import HIGH, LOW
from tests.app.web.ui.reading import button, opened, sent, sound, texts

pytestmark = pytest.mark.slow


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
    [limit] = [f for f in field_limits.limits_of(specs.DesignSpec) if f.name == "radius_1_um"]
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
                    made_answers.row(
                        "verified_designs", rank=1, separates=True, verdict="separates as predicted"
                    )
                ],
                verifications=[
                    made_answers.row(
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


def test_measured_indices_are_not_asked_for_once_more(service):
    table = "radius_um,deformation_index\n6.0,0.6\n6.5,0.7\n"
    page = opened()
    page.session_state["form:population_1_csv"] = table
    page = sound(page.run())
    assert "of the measured cells" in texts(page)
    button(page, "Search for designs").click().run()
    given = json.loads(sent(service, "POST", "/designs")[0].content)
    assert not {"deformation_index_1", "stiffness_set_1", "ks_cv_1", "radius_1_um"} & given.keys()
    assert specs.DesignSpec(**given).deformation_index_1 == pytest.approx(0.65)


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
