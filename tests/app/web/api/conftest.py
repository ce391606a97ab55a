"""A service that answers from a made-up campaign."""

import pytest
from fastapi.testclient import TestClient

from dldsim.app.web.api.app import make_app
from dldsim.app.web.api.settings import Settings


@pytest.fixture(scope="package")
def client(campaign, tmp_path_factory):
    """Asks a service with its processes, one for all files of this folder."""
    settings = Settings(
        results=campaign,
        state=tmp_path_factory.mktemp("state"),
        trials_max=100,
        body_max_bytes=20_000,
        upload_rows_max=5000,
    )
    with TestClient(make_app(settings), raise_server_exceptions=False) as found:
        yield found
