"""API, page and Chromium, started for these tests."""

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest

from tests.app.web.browser.steps import HEIGHT, SHOTS, WAIT_S, WIDTH

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]


def free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


class Part:
    """One part of the service as a process."""

    def __init__(self, part: str, log: Path, port: int, *options: str, **environment: str):
        name = {"api": "--port", "ui": "--page-port"}[part]
        self.argv = [sys.executable, "-m", "dldsim", "serve", part, name, str(port), *options]
        self.base, self.log = f"http://127.0.0.1:{port}", log
        self.environment = {**os.environ, **environment}
        self.start()

    def start(self) -> None:
        self.process = subprocess.Popen(
            self.argv,
            stdout=self.log.open("a"),
            stderr=subprocess.STDOUT,
            env=self.environment,
            start_new_session=True,
        )

    def wait(self, path: str) -> None:
        end = time.monotonic() + WAIT_S
        while time.monotonic() < end:
            assert self.process.poll() is None, self.log.read_text()
            try:
                with urllib.request.urlopen(self.base + path, timeout=30):
                    return
            except OSError:
                time.sleep(0.5)
        raise AssertionError(f"{self.argv} does not answer")

    def stop(self) -> None:
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGTERM)
            self.process.wait(60)


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    """API and page."""
    folder = tmp_path_factory.mktemp("service")
    port = free_port()
    results = os.environ.get("DLDSIM_WEB_TEST_RESULTS")
    options = ["--results", results] if results else []
    api = Part(
        "api",
        folder / "api.log",
        port,
        "--state",
        str(folder / "state"),
        *options,
        DLDSIM_WEB_QUEUE_MAX="2",
    )
    page = Part("ui", folder / "page.log", free_port(), "--api", api.base)
    try:
        api.wait("/api/v1/health")
        page.wait("/_stcore/health")
        yield api, page
    finally:
        page.stop()
        api.stop()


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    playwright = pytest.importorskip("playwright.sync_api")
    if not CHROMIUM:
        pytest.skip("chromium is not installed")
    with playwright.sync_playwright() as driver:
        found = driver.chromium.launch_persistent_context(
            tmp_path_factory.mktemp("profile"),
            executable_path=CHROMIUM,
            headless=True,
            args=FLAGS,
            viewport={"width": WIDTH, "height": HEIGHT},
            accept_downloads=True,
        )
        found.set_default_timeout(WAIT_S * 1e3)
        yield found
        found.close()


@pytest.fixture
def tab(browser, service, request):
    """A fresh session of the page, which must ask nobody but this machine."""
    found = browser.new_page()
    outside = []
    found.on(
        "request",
        lambda r: (
            outside.append(r.url) if r.url.startswith("http") and "127.0.0.1" not in r.url else None
        ),
    )
    yield found
    if SHOTS is not None:
        found.screenshot(path=Path(SHOTS) / f"last-{request.node.name}.png")
    found.close()
    assert not outside
