"""The page as a client: it asks and never computes, and shows what is refused in its place."""

import ast
from pathlib import Path

import httpx
import pytest

from dldsim.app.web.ui import SCRIPT, client
from dldsim.app.web.ui.parts import plain
from tests.app.web.ui.made_answers import problem
from tests.app.web.ui.reading import button, opened, sound, texts

pytestmark = pytest.mark.slow

PAGE = Path(SCRIPT).parent


@pytest.mark.parametrize("path", sorted(PAGE.glob("*.py")), ids=lambda p: p.stem)
def test_the_page_asks_and_never_computes(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    found = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    found |= {a.name for node in ast.walk(tree) if isinstance(node, ast.Import) for a in node.names}
    own = {name for name in found if name.startswith("dldsim")}
    shared = {"dldsim.app.web.api", "dldsim.vocabulary"}
    assert all(n.startswith("dldsim.app.web.ui") for n in own - shared)


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
