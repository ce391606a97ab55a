"""Start the parts of the service: the API, the page, or both on this machine."""

import errno
import importlib.util
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from typing import NoReturn

from dldsim.app.web.ui import API_VARIABLE, SCRIPT, api_address
from dldsim.errors import DldsimError

PREFIX = "DLDSIM_WEB_"
START_S = 180
STOP_S = 10


def _need(*modules: str) -> None:
    missing = [name for name in modules if importlib.util.find_spec(name) is None]
    if missing:
        raise DldsimError(
            f"serve needs {', '.join(missing)}, which are not installed. Install "
            "them with: pip install -r requirements-web.txt"
        )


def address(host: str, port: int) -> str:
    """Where a part that listens on this host can be reached from this machine."""
    host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
    return f"http://[{host.replace('%', '%25')}]:{port}" if ":" in host else f"http://{host}:{port}"


def check_free(host: str, port: int, port_setting: str) -> None:
    """Raise DldsimError that names the setting if nothing can listen there."""
    where = f"host = {host} (--host, {PREFIX}HOST)"
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        family, kind, protocol, _, place = found[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(place)
    except socket.gaierror as error:
        raise DldsimError(
            f"{where}: no address of this name is known ({error.strerror}). Name an "
            "address of this machine, such as 127.0.0.1 or ::1."
        ) from error
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise DldsimError(
                f"port = {port} ({port_setting}): another program listens there "
                "already. Stop it, or name another port."
            ) from error
        if error.errno == errno.EACCES:
            raise DldsimError(
                f"port = {port} ({port_setting}): not permitted to this user. Name "
                "a port from 1024 to 65535."
            ) from error
        raise DldsimError(
            f"{where}: nothing can listen there ({error.strerror}). Name an address "
            "of this machine, such as 127.0.0.1 or ::1."
        ) from error


API_PORT = "--port, DLDSIM_WEB_PORT"
PAGE_PORT = "--page-port"


def serve_api(settings) -> None:
    """Serve the API until it is interrupted. Raises DldsimError if it cannot start."""
    _need("fastapi", "uvicorn", "multipart")
    import uvicorn

    from dldsim.app.web.api.app import make_app

    check_free(settings.host, settings.port, API_PORT)
    app = make_app(settings)
    app.state.service.pool.lock()
    uvicorn.run(
        app,
        host=settings.host,
        port=settings.port,
        log_level="info",
        timeout_keep_alive=15,
        timeout_graceful_shutdown=STOP_S,
        server_header=False,
    )


def page_command(host: str, port: int) -> list[str]:
    """Command line that serves the page."""
    _need("streamlit")
    return [
        sys.executable,
        "-m",
        "streamlit",
        "run",
        str(SCRIPT),
        "--server.address",
        host,
        "--server.port",
        str(port),
        "--server.headless",
        "true",
        "--browser.gatherUsageStats",
        "false",
    ]


def serve_page(host: str, port: int, api: str | None) -> NoReturn:
    """Serve the page in place of this process, so that a signal to stop reaches it.

    ``api``: None for the address in API_VARIABLE, or API_DEFAULT. Raises DldsimError.
    """
    page = page_command(host, port)
    try:
        api = api_address(api)
    except ValueError as error:
        raise DldsimError(str(error)) from error
    check_free(host, port, PAGE_PORT)
    os.execve(page[0], page, {**os.environ, API_VARIABLE: api})


def serve_both(settings, page_port: int, say: Callable[[str], None]) -> int:
    """Serve the API and the page that asks it, until either ends or both are interrupted.

    ``say`` is told where to look, once the API answers. Raises DldsimError if it does not.
    """
    _need("fastapi", "uvicorn", "multipart")
    page = page_command(settings.host, page_port)
    check_free(settings.host, settings.port, API_PORT)
    check_free(settings.host, page_port, PAGE_PORT)
    if not settings.port:
        raise DldsimError(
            f"port = 0 ({API_PORT}): the page must know where the API is. Name a "
            "port from 1 to 65535."
        )
    api = address(settings.host, settings.port)
    options = [
        x
        for key, value in settings.model_dump(mode="json").items()
        if key in ("results", "config", "state", "host", "port", "workers", "verify_workers")
        and value is not None
        for x in ("--" + key.replace("_", "-"), str(value))
    ]
    parts = [subprocess.Popen([sys.executable, "-m", "dldsim", "serve", "api", *options])]
    # a service that is told to stop ends its parts, too
    previous = signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        health = _wait(api, parts[0])
        parts.append(subprocess.Popen(page, env={**os.environ, API_VARIABLE: api}))
        say(f"page: {address(settings.host, page_port)}")
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
    direct = urllib.request.build_opener(urllib.request.ProxyHandler({}))  # it is this machine
    while time.monotonic() < end:
        if process.poll() is not None:
            raise DldsimError(f"The API ended with code {process.returncode}; see above.")
        try:
            with direct.open(f"{api}/api/v1/health", timeout=5):
                return ""
        except urllib.error.HTTPError as error:  # it answers: unhealthy
            return error.read().decode(errors="replace")
        except OSError:
            time.sleep(0.3)
    raise DldsimError(f"The API did not answer at {api} within {START_S} s; see above.")
