"""Jobs of the service outlive its processes, and end."""

import pytest

from dldsim.app.web.api.store import ATTEMPTS_MAX, SEARCH, VERIFICATION, Busy, Store


def test_nothing_accepted_is_lost_with_its_process(tmp_path):
    limits = {SEARCH: 5, VERIFICATION: 5}
    store = Store(tmp_path)
    spec = {"trials": 1}
    store.add(
        [
            ("a", "design", SEARCH, "queued", spec),
            ("a", "verification", VERIFICATION, "waiting", spec),
        ],
        limits,
    )
    job = store.claim(SEARCH, "one")
    assert job.id == "a" and store.claim(SEARCH, "two") is None
    store = Store(tmp_path)  # as after a restart
    store.release(None, "lost")
    again = store.claim(SEARCH, "two")
    assert (again.id, again.attempts) == ("a", 2)
    assert not store.report(job, {}) and not store.finish(job)  # the first worker has lost it
    assert store.claim(VERIFICATION, "three") is None
    assert store.finish(again, result="{}")
    assert store.claim(VERIFICATION, "three").kind == "verification"
    for _ in range(ATTEMPTS_MAX - 1):
        store.release("three", "it ends its process")
        store.claim(VERIFICATION, "three")
    store.release("three", "it ends its process")
    found = store.find("a", "verification")
    assert (found.state, found.error) == ("failed", "it ends its process")


def test_a_cancelled_job_changes_nothing(tmp_path):
    store = Store(tmp_path)
    store.add([("a", "design", SEARCH, "queued", {})], {SEARCH: 1})
    job = store.claim(SEARCH, "one")
    with pytest.raises(Busy):
        store.add([("b", "design", SEARCH, "queued", {})], {SEARCH: 1})
    store.cancel("a")
    assert not store.keep_result(job, "{}") and not store.finish(job, result="{}")
    assert store.result("a", "design") is None
    store.forget(days=-1)
    assert store.find("a", "design") is None


def test_a_job_that_takes_too_long_is_ended(tmp_path):
    store = Store(tmp_path)
    store.add([("a", "design", SEARCH, "queued", {})], {SEARCH: 1})
    store.claim(SEARCH, "one")
    assert store.overrun(SEARCH, 60) == []
    assert store.overrun(SEARCH, -1) == ["one"]
    assert "longer than" in store.find("a", "design").error
