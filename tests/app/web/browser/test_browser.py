"""The page for real: API, page and Chromium without a screen, from request to download and error.

    apt-get install chromium && pip install playwright      # Debian's browser drives well
    python -m pytest -m browser tests/app/web -s
    DLDSIM_WEB_TEST_SHOTS=docs/images python -m pytest -m browser tests/app/web -k pictures

The last draws the pictures of docs/web.md anew. DLDSIM_WEB_TEST_RESULTS names the campaign; without
it, the one that comes with the package. DLDSIM_WEB_TEST_SHOTS names a folder for pictures of what
was seen.
"""

import hashlib
import json
import sys
import time
import urllib.request

import pytest

from tests.app.web.browser.steps import (
    ERROR,
    HEIGHT,
    SHOTS,
    WAIT_S,
    WIDTHS,
    asked,
    download,
    fill,
    heading,
    look,
    opened,
    press,
    settled,
    shoot,
)

pytestmark = pytest.mark.browser


def test_request_course_dashboard_and_downloads(tab, service):
    opened(tab, service)
    shoot(tab, "form")
    start = time.monotonic()
    press(tab, "Search for designs")
    tab.get_by_text("Searching").wait_for()
    tab.locator(".js-plotly-plot:visible").first.wait_for()  # the course, while the search runs
    shoot(tab, "live")
    heading(tab, "Ranked candidates")
    sys.stdout.write(f"click to dashboard: {time.monotonic() - start:.1f} s\n")
    tab.get_by_text("Report (HTML)").first.wait_for()  # files come after the dashboard
    settled(tab)
    shoot(tab, "dashboard")
    identifier = tab.url.split("design=")[1].split("&")[0]
    status = asked(service, identifier)
    for text in (
        "Importance for the objective",
        "Parallel coordinates",
        "Tolerances",
        "Array to scale",
        "The request in the training domain",
        "Provenance",
        status["result"]["importance"][0]["evaluator"],
    ):
        assert tab.get_by_text(text).first.count(), text
    assert not tab.get_by_text("WebGL").count()
    files = {f["name"]: f for f in status["files"] if f["candidate"] in (1, None)}
    assert {f["kind"] for f in files.values()} == {"json", "csv", "gds", "dxf", "report"}
    for kind, label in (
        ("json", "JSON, "),
        ("csv", "CSV, "),
        ("gds", "GDSII"),
        ("dxf", "DXF"),
        ("report", "Report (HTML)"),
    ):
        name, content = download(tab, label)
        assert files[name]["kind"] == kind
        assert hashlib.sha256(content).hexdigest() == files[name]["sha256"]


def test_from_two_populations_to_mask_and_outcome(tab, service):
    """Two sizes of cells by mean and scatter, designs for their outlets, the mask of the first, its
    outcome with a second array behind it, and what of it can be taken home."""
    tab.set_viewport_size({"width": min(WIDTHS), "height": HEIGHT})
    opened(tab, service)
    for place, (radius, spread) in enumerate((("4.5", "0.2"), ("7.5", "0.4"))):
        tab.get_by_text("stiffness set", exact=True).nth(place).click()
        settled(tab)
        fill(tab, "Cell radius R", radius, place)
        fill(tab, "± SD of the radius", spread, place)
    tab.get_by_text("Constraints, objective and search").click()
    tab.get_by_text("purity and recovery", exact=True).click()
    settled(tab)
    look(tab, "path-form")
    start = time.monotonic()
    press(tab, "Search for designs")
    heading(tab, "Ranked candidates")
    sys.stdout.write(f"click to dashboard: {time.monotonic() - start:.1f} s\n")
    settled(tab)
    look(tab, "path-design")
    status = asked(service, tab.url.split("design=")[1].split("&")[0])
    found = status["result"]["at_outlets"]["device_outcomes"][0]
    name, content = download(tab, "GDSII")
    assert content[:2] == b"\x00\x06" and name.endswith(".gds")  # the head of a stream file
    press(tab, "Change or simulate it on the page Outcome")
    tab.get_by_role("heading", name="What comes out of a device").wait_for()
    settled(tab)
    press(tab, "Compute the outcome")
    heading(tab, "At the outlets")
    settled(tab)
    name, content = download(tab, "Outcome (JSON)")
    again = json.loads(content)["device_outcomes"][0]
    assert abs(again["array_length_mm"] - found["array_length_mm"]) < 1e-6
    assert abs(again["radius_mean_um"] - found["radius_mean_um"]) < 0.05
    tab.get_by_text("A second device behind an outlet").click()
    settled(tab)
    press(tab, "Compute the outcome")
    heading(tab, "At the outlets of the second device")
    settled(tab)
    name, content = download(tab, "Outcome (CSV)")
    assert content.decode().startswith("request,device,stage,population,outlet,purity")
    look(tab, "path-outcome")


def test_cells_are_simulated_beside_their_prediction(tab, service):
    opened(tab, service)
    tab.get_by_role("link", name="Outcome").click()
    tab.get_by_role("heading", name="What comes out of a device").wait_for()
    settled(tab)
    for place, radius in enumerate(("6", "8.5")):
        tab.get_by_text("stiffness set", exact=True).nth(place).click()
        settled(tab)
        fill(tab, "Cell radius R", radius, place)
    fill(tab, "Pillar radius P_r", "8.91")
    fill(tab, "Gap P_g", "12.06")
    fill(tab, "Periodicity N_p", "6")
    press(tab, "Compute the outcome")
    heading(tab, "Simulated check")
    settled(tab)
    fill(tab, "Cells to simulate", "2")
    press(tab, "Simulate them")
    tab.get_by_text("The result appears here").wait_for()
    tab.get_by_text("Simulating").wait_for()
    shoot(tab, "check-running")
    address = tab.url
    assert "check=" in address
    tab.get_by_text("simulated cells leave by its outlet").first.wait_for()
    settled(tab)
    shoot(tab, "check")
    name, content = download(tab, "Simulated cells (CSV)")
    assert len(content.decode().splitlines()) == 1 + 2
    tab.goto(address)  # as one who comes back to it tomorrow
    tab.get_by_text("simulated cells leave by its outlet").first.wait_for()


@pytest.mark.skipif(SHOTS is None, reason="DLDSIM_WEB_TEST_SHOTS names no folder")
def test_pictures_of_the_docs(tab, service):
    tab.set_viewport_size({"width": 1000, "height": HEIGHT})
    opened(tab, service)
    for place, radius in enumerate(("6", "9")):
        tab.get_by_text("stiffness set", exact=True).nth(place).click()
        settled(tab)
        fill(tab, "Cell radius R", radius, place)
    press(tab, "Search for designs")
    heading(tab, "Ranked candidates")
    settled(tab)
    shoot(tab, "design", 1800)
    press(tab, "Change or simulate it on the page Outcome")
    tab.get_by_role("heading", name="What comes out of a device").wait_for()
    settled(tab)
    press(tab, "Compute the outcome")
    heading(tab, "At the outlets")
    settled(tab)
    shoot(tab, "outcome", 1800)
    tab.get_by_role("link", name="Campaign").click()
    tab.get_by_text("Hollow").wait_for()
    settled(tab)
    shoot(tab, "campaign", 1400)


def test_address_brings_a_design_back(tab, service):
    opened(tab, service)
    fill(tab, "Cell radius R", "7.6", 1)  # its index is calibrated there, too
    press(tab, "Search for designs")
    tab.wait_for_url("**design=*")
    address = tab.url
    press(tab, "Cancel")
    tab.get_by_text("The search was cancelled").wait_for()
    opened(tab, service, "?" + address.split("?")[1])
    tab.get_by_text("The search was cancelled").wait_for()
    tab.get_by_text("Request", exact=True).first.click()
    assert (
        float(tab.get_by_label("Cell radius R").and_(tab.locator("input")).nth(1).input_value())
        == 7.6
    )


REFUSED = {
    "equal": (
        [("Deformation index", "INSIDE", 0), ("Deformation index", "INSIDE", 1)],
        "no array separates equals",
    ),
    "outside": ([("Deformation index", "0.95", 1)], "outside the calibrated range"),
    "bounds": ([("lowest", "30", 1)], "lowest bound first"),
    "infeasible": ([("lowest", "3", 1), ("highest", "4", 1)], "no geometry within the bounds"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusal_is_shown_where_it_belongs(tab, service, case):
    fields, words = REFUSED[case]
    low, high = asked(service, "", path="/model")["deformation_index_range"]
    opened(tab, service)
    for label, value, place in fields:
        fill(tab, label, f"{(low + high) / 2:.4f}" if value == "INSIDE" else value, place)
    press(tab, "Search for designs")
    tab.locator(ERROR).filter(has_text=words).first.wait_for()
    shoot(tab, f"refused-{case}")


def test_full_queue_says_when_to_come_back(tab, service):
    api = service[0].base + "/api/v1/designs"
    body = json.dumps({"stiffness_set_1": "1", "stiffness_set_2": "5", "trials": 400}).encode()
    taken = []
    for _ in range(2):
        request = urllib.request.Request(api, body, {"Content-Type": "application/json"})
        with urllib.request.urlopen(request, timeout=WAIT_S) as answer:
            taken.append(json.load(answer)["id"])
    opened(tab, service)
    press(tab, "Search for designs")
    tab.locator(ERROR).filter(has_text="The service is busy").first.wait_for()
    assert "Try again in" in tab.locator(ERROR).filter(has_text="busy").first.inner_text()
    shoot(tab, "busy")
    for identifier in taken:
        asked(service, identifier, "DELETE")


def test_campaign_page_and_the_inverse(tab, service):
    opened(tab, service)
    tab.get_by_role("link", name="Campaign").click()
    tab.get_by_text("Hollow").wait_for()
    settled(tab)
    shoot(tab, "campaign")
    tab.get_by_role("tab", name="Deformation index").click()
    tab.get_by_text("Bars: standard deviation").wait_for()
    shoot(tab, "calibration")
    fill(tab, "Deformation index", "0.95")
    tab.locator(ERROR).filter(has_text="0.95").first.wait_for()
    shoot(tab, "refused-inverse")
    tab.get_by_role("tab", name="Predict one").click()
    press(tab, "Predict")
    tab.get_by_text("Full bump").wait_for()
    settled(tab)
    shoot(tab, "predict")


def test_uploaded_campaign_is_used_and_deleted(tab, service, tmp_path):
    table = asked(service, "outcomes", path="/campaign/")
    names = [c["name"] for c in table["columns"]]
    good, bad = tmp_path / "outcomes.csv", tmp_path / "bad.csv"
    good.write_text(
        "\n".join(
            [",".join(names), *(",".join(_cell(row[n]) for n in names) for row in table["rows"])]
        ),
        encoding="utf-8",
    )
    bad.write_bytes(b"\x80\x04\x95 not a table")
    opened(tab, service)
    tab.get_by_role("link", name="Measurements").click()
    tab.get_by_role("tab", name="Upload").click()
    tab.locator('input[type="file"]').first.set_input_files(bad)
    settled(tab)
    press(tab, "Upload and fit")
    tab.locator(ERROR).filter(has_text="uploaded table outcomes").first.wait_for()
    shoot(tab, "refused-upload")
    tab.locator('input[type="file"]').first.set_input_files(good)
    settled(tab)
    press(tab, "Upload and fit")
    tab.get_by_text("is ready").first.wait_for()
    settled(tab)
    press(tab, "Use it")
    tab.wait_for_url("**campaign=*")
    settled(tab)
    shoot(tab, "uploaded")
    tab.get_by_role("link", name="Design").click()
    tab.get_by_text("uploaded by a user").first.wait_for()
    tab.get_by_role("link", name="Measurements").click()
    press(tab, "Delete it")
    tab.get_by_text("tracked with the service").first.wait_for()


def _cell(value) -> str:
    """A value as the tables' CSV twins have it."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    text = value if isinstance(value, str) else json.dumps(value)
    return '"' + text.replace('"', '""') + '"' if isinstance(value, str | list) else text


def test_measured_angle_is_typed_and_learnt_from(tab, service):
    low, high = asked(service, "", path="/model")["deformation_index_range"]
    index = f"{(low + high) / 2:.3f}"
    opened(tab, service)
    tab.get_by_role("link", name="Measurements").click()
    tab.locator('[data-testid="stDataFrame"] canvas').first.wait_for()
    settled(tab)
    grid = tab.locator('[data-testid="stDataFrame"]').first
    grid.click(position={"x": 60, "y": 52})  # the empty row below the titles begins one
    tab.locator("input.gdg-input").wait_for()
    for value in ("7", "16", "8", index, "7.5", "3.2"):
        tab.keyboard.type(value)
        tab.wait_for_timeout(500)
        tab.keyboard.press("Tab")
        settled(tab)
    shoot(tab, "measurements")
    press(tab, "Fit with these angles")
    tab.get_by_text("is ready").first.wait_for()
    settled(tab)
    press(tab, "Use it")
    tab.get_by_text("of them measured on devices").first.wait_for()
    shoot(tab, "measured")


def test_api_that_is_gone_is_said_and_comes_back(tab, service):
    opened(tab, service)
    service[0].stop()
    press(tab, "Search for designs")
    tab.locator(ERROR).filter(has_text="cannot be reached").first.wait_for()
    shoot(tab, "api-down")
    service[0].start()
    service[0].wait("/api/v1/health")
    press(tab, "Search for designs")
    heading(tab, "Ranked candidates")
