"""What tests do with a page and read from it."""

from streamlit.testing.v1 import AppTest

from dldsim.app.web.ui import SCRIPT
from tests.app.web.ui.fake_service import Fake


def opened(**query) -> AppTest:
    """The whole page, with these in its address."""
    page = AppTest.from_file(str(SCRIPT), default_timeout=60)
    for name, value in query.items():
        page.query_params[name] = value
    return page.run()


def texts(page: AppTest) -> str:
    """All text that it shows."""
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
    """The page, which must have no fault."""
    assert not page.exception, page.exception[0].message
    return page


def sent(service: Fake, method: str, path: str) -> list:
    """Requests that the service got."""
    return [r for r in service.asked if r.method == method and r.url.path == "/api/v1" + path]


def run_page(name: str) -> AppTest:
    """One of the pages by itself."""
    return AppTest.from_string(
        f"from dldsim.app.web.ui import {name}\n{name}.page()", default_timeout=60
    ).run()
