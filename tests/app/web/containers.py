"""Both images built and run as compose.yaml says, and asked for a design. Not part of the tests.

    python -m pytest -m service tests/app/web/containers.py -s

Needs podman and podman-compose, free ports 8000 and 8501, some GB of disk, and minutes.
DLDSIM_CONTAINER_BASE is the base of both images where that of the Dockerfiles cannot be pulled
(docs/web.md makes one from Debian's packages), DLDSIM_CONTAINER_BUILD more options of
``podman build``: a package mirror's settings, say.
"""

import json
import os
import shlex
import shutil
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest

pytestmark = pytest.mark.service

ROOT = Path(__file__).parents[3]
API, PAGE = "http://127.0.0.1:8000/api/v1", "http://127.0.0.1:8501"
LIMIT_S = float(os.environ.get("DLDSIM_WEB_TEST_LIMIT_S", 300))
ASK = {"stiffness_set_1": "1", "stiffness_set_2": "5", "trials": 40}
PROJECT = "dldsim-try"


def podman(*words: str) -> str:
    """What podman says. Raises CalledProcessError."""
    done = subprocess.run(
        ["podman", *words], cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True
    )
    return done.stdout


def compose(*words: str) -> None:
    subprocess.run(["podman-compose", "-p", PROJECT, *words], cwd=ROOT, check=True)


def answer(url: str, body: dict | None = None) -> bytes:
    """Body of an answer of status 2xx. Raises OSError."""
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(url, data, {"Content-Type": "application/json"})
    with urllib.request.urlopen(request, timeout=30) as found:
        return found.read()


def until_it_answers(url: str) -> bytes:
    end = time.monotonic() + LIMIT_S
    while True:
        try:
            return answer(url)
        except OSError:
            if time.monotonic() > end:
                raise
            time.sleep(1)


def container(service: str) -> str:
    """Id of the container that runs a service."""
    labels = {"project": PROJECT, "service": service}
    filters = [f"--filter=label=com.docker.compose.{k}={v}" for k, v in labels.items()]
    return podman("ps", "-q", *filters).strip()


def in_container(service: str, *words: str) -> subprocess.CompletedProcess:
    command = ["podman", "exec", container(service), *words]
    return subprocess.run(command, capture_output=True, text=True)


def finished(job: str) -> dict:
    """Status of a design that has come to its end."""
    end = time.monotonic() + LIMIT_S
    while time.monotonic() < end:
        found = json.loads(answer(f"{API}/designs/{job}"))
        if found["state"] not in ("queued", "running"):
            return found
        time.sleep(1)
    raise AssertionError(f"not finished: {found['state']} {found['progress']}")


@pytest.fixture(scope="module", autouse=True)
def service():
    """Both containers, up; they, their network and their volume are gone afterwards."""
    for program in ("podman", "podman-compose"):
        if shutil.which(program) is None:
            pytest.skip(f"{program} is missing: apt-get install podman podman-compose")
    base = os.environ.get("DLDSIM_CONTAINER_BASE")
    given = shlex.split(os.environ.get("DLDSIM_CONTAINER_BUILD", ""))
    given += ["--build-arg", f"BASE={base}"] if base else []
    for name in ("api", "ui"):
        start = time.monotonic()
        file = f"containers/{name}.Dockerfile"
        podman("build", "--format", "docker", *given, "-f", file, "-t", f"dldsim-{name}", ".")
        size = int(podman("image", "inspect", "-f", "{{.Size}}", f"dldsim-{name}"))
        sys.stdout.write(
            f"\ndldsim-{name}: {size / 1e6:.0f} MB, {time.monotonic() - start:.0f} s\n"
        )
    try:
        compose("up", "-d", "--no-build")
        yield
    finally:
        compose("down", "-v")


def test_a_design_is_answered():
    health = json.loads(until_it_answers(f"{API}/health"))
    assert health["status"] == "healthy" and health["workers"]
    accepted = json.loads(answer(f"{API}/designs", ASK))
    found = finished(accepted["id"])
    assert found["state"] == "done", found["error"]
    best = found["result"]["designs"][0]
    sys.stdout.write(f"{health['version']}: {best}\n")
    assert len(answer(f"{API}/designs/{accepted['id']}/files/gds")) > 1000


def test_the_page_is_there_and_reaches_the_api():
    assert until_it_answers(f"{PAGE}/_stcore/health") == b"ok"
    ask = (
        "import os, urllib.request as u; u.urlopen(os.environ['DLDSIM_WEB_API'] + '/api/v1/health')"
    )
    asked = in_container("ui", "python", "-c", ask)
    assert asked.returncode == 0, asked.stderr


@pytest.mark.parametrize("name", ["api", "ui"])
def test_containers_are_closed(name):
    status = dict(
        line.split(":\t", 1)
        for line in in_container(name, "cat", "/proc/1/status").stdout.splitlines()
        if ":\t" in line
    )
    assert set(status["Uid"].split()) == {"10001"}
    assert int(status["CapEff"], 16) == int(status["CapBnd"], 16) == 0
    assert status["NoNewPrivs"] == "1"
    written = in_container(name, "touch", "/opt/dldsim/file")
    assert written.returncode and "Read-only file system" in written.stderr
    assert in_container(name, "touch", "/tmp/file").returncode == 0


@pytest.mark.parametrize("name", ["api", "ui"])
def test_health_check_of_the_image_passes(name):
    podman("healthcheck", "run", container(name))


def test_jobs_outlive_their_container():
    accepted = json.loads(answer(f"{API}/designs", ASK))
    compose("down")  # the volume stays
    compose("up", "-d", "--no-build")
    until_it_answers(f"{API}/health")
    assert finished(accepted["id"])["state"] == "done"


@pytest.mark.parametrize("name", ["ui", "api"])
def test_containers_stop_when_they_are_told_to(name):
    stopping = container(name)
    podman("stop", "-t", "60", stopping)
    assert int(podman("inspect", "-f", "{{.State.ExitCode}}", stopping)) != 137  # not killed
