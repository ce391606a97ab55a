"""Start the parts of the service: the API, the page, or both on this machine."""

import importlib.util
import os
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path

from dldsim.errors import DldsimError

API_VARIABLE = "DLDSIM_WEB_API"
"""Environment variable with the address of the API that the page asks."""
PAGE = Path(__file__).parent / "ui" / "app.py"
START_S = 180
STOP_S = 10


def _need(*modules: str) -> None:
    missing = [name for name in modules if importlib.util.find_spec(name) is None]
    if missing:
        raise DldsimError(f"serve needs {', '.join(missing)}, which are not installed. Install "
                          "them with: pip install -r requirements-web.txt")


def serve_api(settings) -> None:
    """Serve the API until it is interrupted. Raises DldsimError if it cannot start."""
    _need("fastapi", "uvicorn", "multipart")
    import uvicorn

    from dldsim.app.web.api.app import make_app

    app = make_app(settings)
    app.state.service.pool.lock()
    uvicorn.run(app, host=settings.host, port=settings.port, log_level="info",
                timeout_keep_alive=15, timeout_graceful_shutdown=STOP_S, server_header=False)


def page_command(host: str, port: int) -> list[str]:
    """Command line that serves the page."""
    _need("streamlit")
    return [sys.executable, "-m", "streamlit", "run", str(PAGE), "--server.address", host,
            "--server.port", str(port), "--server.headless", "true",
            "--browser.gatherUsageStats", "false"]  # fmt: skip


def serve_page(host: str, port: int, api: str) -> int:
    """Serve the page until it is interrupted; returns its exit code."""
    page = page_command(host, port)
    return subprocess.run(page, env={**os.environ, API_VARIABLE: api}).returncode


def serve_both(settings, page_port: int, say: Callable[[str], None]) -> int:
    """Serve the API and the page that asks it, until either ends or both are interrupted.

    ``say`` is told where to look, once the API answers. Raises DldsimError if it does not.
    """
    _need("fastapi", "uvicorn", "multipart")
    page = page_command(settings.host, page_port)
    shown = "127.0.0.1" if settings.host in ("0.0.0.0", "::") else settings.host
    api = f"http://{shown}:{settings.port}"
    options = [x for key, value in settings.model_dump(mode="json").items()
               if key in ("results", "config", "state", "host", "port", "workers",
                          "verify_workers") and value is not None
               for x in ("--" + key.replace("_", "-"), str(value))]  # fmt: skip
    parts = [subprocess.Popen([sys.executable, "-m", "dldsim", "serve", "api", *options])]
    # a service that is told to stop ends its parts, too
    previous = signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        health = _wait(api, parts[0])
        parts.append(subprocess.Popen(page, env={**os.environ, API_VARIABLE: api}))
        say(f"page: http://{shown}:{page_port}")
        say(f"API:  {api}/docs")
        if health:
            say(f"unhealthy: {health}")
        while all(part.poll() is None for part in parts):
            time.sleep(0.5)
        return next(part.returncode for part in parts if part.returncode is not None)
    finally:
        signal.signal(signal.SIGTERM, previous)
        for part in parts:
            part.terminate()
        for part in parts:
            try:
                part.wait(2 * STOP_S)
            except subprocess.TimeoutExpired:
                part.kill()


def _wait(api: str, process: subprocess.Popen) -> str:
    """Wait until the API answers; returns what it complains of."""
    end = time.monotonic() + START_S
    while time.monotonic() < end:
        if process.poll() is not None:
            raise DldsimError(f"The API ended with code {process.returncode}; see above.")
        try:
            with urllib.request.urlopen(f"{api}/api/v1/health", timeout=5):
                return ""
        except urllib.error.HTTPError as error:  # it answers: unhealthy
            return error.read().decode(errors="replace")
        except OSError:
            time.sleep(0.3)
    raise DldsimError(f"The API did not answer at {api} within {START_S} s; see above.")
