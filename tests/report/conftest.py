"""A made-up campaign, and figures that need not be looked at."""

import pytest

from dldsim.report import style
from tests.report.made_results import make_results


@pytest.fixture(scope="session")
def results(tmp_path_factory):
    """Folder with the tables of the made-up campaign, and the tables by kind."""
    folder = tmp_path_factory.mktemp("campaign") / "results"
    return folder, make_results(folder)


@pytest.fixture(scope="session")
def tables(results):
    """Tables of the made-up campaign by kind."""
    return results[1]


@pytest.fixture
def blank_figures(monkeypatch):
    """Figures are drawn and not rendered, which is most of the time that a page takes."""
    monkeypatch.setattr(style, "render", lambda figure, kind: b"<svg/>")
