"""What a user does in a browser, and what is seen of it."""

import json
import os
import urllib.request
from pathlib import Path

WAIT_S = float(os.environ.get("DLDSIM_WEB_TEST_LIMIT_S", 300))
SHOTS = os.environ.get("DLDSIM_WEB_TEST_SHOTS")
WIDTH, HEIGHT = 1400, 1000
WIDTHS = (400, 1000, 1600)
"""Of a telephone, a small and a large window."""
ERROR = '[data-testid="stAlert"]'


def opened(tab, service, query: str = ""):
    """The page with this behind its address, drawn to its end."""
    tab.goto(service[1].base + query)
    tab.get_by_text("Cell radius R").first.wait_for(state="attached")
    settled(tab)
    return tab


def settled(tab) -> None:
    """Wait until the page has been drawn to its end."""
    tab.wait_for_timeout(500)
    tab.locator('[data-testid="stApp"][data-test-script-state="notRunning"]').wait_for()
    tab.wait_for_timeout(500)


def heading(tab, name: str) -> None:
    """Wait for a heading; what is refused in its place is told at once."""
    found = tab.get_by_role("heading", name=name)
    found.or_(tab.locator(ERROR).filter(has_text="request")).first.wait_for()
    assert found.count(), tab.locator(ERROR).all_inner_texts()


def press(tab, name: str) -> None:
    tab.get_by_role("button", name=name, exact=False).first.click()


def fill(tab, label: str, value: str, place: int = 0) -> None:
    field = tab.get_by_label(label, exact=False).and_(tab.locator("input[type=number]")).nth(place)
    field.fill(value)
    field.press("Enter")
    settled(tab)


def shoot(tab, name: str, tallest: int = 8000) -> None:
    """A picture of the whole page."""
    if SHOTS is None:
        return
    width = tab.viewport_size["width"]
    height = tab.evaluate("document.querySelector('[data-testid=stMain]').scrollHeight")
    tab.set_viewport_size({"width": width, "height": min(height + 20, tallest)})
    tab.wait_for_timeout(2500)
    tab.screenshot(path=Path(SHOTS) / f"web-{name}.png")
    tab.set_viewport_size({"width": width, "height": HEIGHT})


def download(tab, label: str) -> tuple[str, bytes]:
    """Name and content of what a button downloads; tables have a download of their own."""
    with tab.expect_download() as waiting:
        buttons = tab.locator('[data-testid="stDownloadButton"] button').filter(has_text=label)
        buttons.locator("visible=true").first.click()
    return waiting.value.suggested_filename, Path(waiting.value.path()).read_bytes()


def beside(tab) -> list[str]:
    """What stands beyond the right edge of the window, where nobody sees it."""
    return tab.evaluate(
        """() => [...document.querySelectorAll('[data-testid=stMain] *')].filter(e => {
            const box = e.getBoundingClientRect();
            return box.width > 0 && box.right > window.innerWidth + 2
                && !e.closest('[data-testid=stDataFrame],[data-testid=stCode],table')
                && getComputedStyle(e).visibility == 'visible';
        }).map(e => e.tagName + ' ' + (e.dataset.testid || e.className) + ': '
            + e.textContent.slice(0, 40))"""
    )


def asked(service, identifier: str, method: str = "GET", path: str = "/designs/") -> dict:
    """What the service answers behind the page's back."""
    request = urllib.request.Request(service[0].base + "/api/v1" + path + identifier, method=method)
    with urllib.request.urlopen(request, timeout=WAIT_S) as answer:
        return json.load(answer)


def look(tab, name: str) -> None:
    """At the page in all WIDTHS: nothing lies beyond the right edge."""
    before = tab.viewport_size
    for width in WIDTHS:
        tab.set_viewport_size({"width": width, "height": HEIGHT})
        settled(tab)
        shoot(tab, f"{name}-{width}")
        found = beside(tab)
        assert found == [], (width, found)
    tab.set_viewport_size(before)
    settled(tab)
