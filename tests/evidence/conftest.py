"""The default configuration, whose plans of studies these tests look at."""

import pytest

from dldsim.config.presets import read_config


@pytest.fixture(scope="session")
def config():
    return read_config("config.yaml")
