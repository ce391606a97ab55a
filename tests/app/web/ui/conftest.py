"""The service in memory that the page asks."""

import httpx
import pytest

from dldsim.app.web.ui import client
from tests.app.web.ui.fake_service import Fake


@pytest.fixture
def service(monkeypatch):
    import streamlit as st

    fake = Fake()
    connection = httpx.Client(base_url="http://api", transport=httpx.MockTransport(fake))
    monkeypatch.setattr(client, "connect", lambda base: connection)
    st.cache_data.clear()
    return fake
