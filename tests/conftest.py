"""Settings of all tests."""

from hypothesis import settings

# How long an example takes says nothing on a machine shared with other work.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")


def pytest_collection_modifyitems(items):
    """What takes longest first, so that no core waits for it at the end."""
    longest = "test_end_to_end", "test_package", "test_half_scene", "test_mirror"
    items.sort(key=lambda item: not any(name in item.nodeid for name in longest))
