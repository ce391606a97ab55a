"""The service for real, as processes: load, kill -9, fuzzing, time and memory.

    python -m pytest -m service tests/app/web -s

DLDSIM_WEB_TEST_RESULTS names the campaign; without it, the one that comes with the package.
"""

import concurrent.futures
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

import pytest
import yaml

pytestmark = pytest.mark.service
PREFIX = "/api/v1"
LIMIT_S = float(os.environ.get("DLDSIM_WEB_TEST_LIMIT_S", 600))
ASK = {"stiffness_set_1": "1", "stiffness_set_2": "5"}
SMALL = ASK | {"trials": 10, "startup_trials": 5, "candidates": 1, "draws": 16}
ONE_GIB_MIB = 1024


class Served:
    """A service in its own process; `call` returns status and JSON."""

    def __init__(self, state: Path, **options):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        results = os.environ.get("DLDSIM_WEB_TEST_RESULTS")
        argv = ["--results", results] if results else []
        argv += ["--state", str(state), "--port", str(self.port)]
        environment = {f"DLDSIM_WEB_{k.upper()}": str(v) for k, v in options.items()}
        self.log = (state / "log").open("a")
        self.process = subprocess.Popen(
            [sys.executable, "-m", "dldsim", "serve", "api", *argv],
            stdout=self.log,
            stderr=self.log,
            env={**os.environ, **environment},
        )
        self.base = f"http://127.0.0.1:{self.port}"
        end = time.monotonic() + LIMIT_S
        while time.monotonic() < end:
            assert self.process.poll() is None, (state / "log").read_text()
            try:
                assert self.call("GET", "/health")[0] == 200
                return
            except OSError:
                time.sleep(0.5)
        raise AssertionError("the service does not answer")

    def call(self, method, path, body=None):
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(
            self.base + PREFIX + path.removeprefix(PREFIX),
            data,
            {"Content-Type": "application/json"},
            method=method,
        )
        try:
            with urllib.request.urlopen(request, timeout=LIMIT_S) as answer:
                return answer.status, json.load(answer)
        except urllib.error.HTTPError as error:
            return error.code, json.loads(error.read())

    def finished(self, url, seen=None):
        end = time.monotonic() + LIMIT_S
        while time.monotonic() < end:
            _, found = self.call("GET", url)
            if seen is not None:
                seen(found)
            if found["state"] in ("done", "failed", "cancelled"):
                return found
            time.sleep(0.3)
        raise AssertionError(f"not finished: {found['state']} {found['progress']}")

    def processes(self):
        """Process ids of the service and of its workers."""
        found = {self.process.pid}
        for path in Path("/proc").glob("[0-9]*/stat"):
            try:
                parent = int(path.read_text().rpartition(")")[2].split()[1])
            except (OSError, ValueError):
                continue
            if parent == self.process.pid:
                found.add(int(path.parent.name))
        return found

    def memory_mib(self):
        """Resident memory of all processes: sum of proportional shares, now."""
        total = 0
        for pid in self.processes():
            try:
                lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
            except OSError:
                continue
            total += sum(int(line.split()[1]) for line in lines if line.startswith("Pss:"))
        return total / 1024

    def kill(self):
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()

    def stop(self):
        self.process.terminate()
        self.process.wait(60)
        self.log.close()


@pytest.fixture
def serve(tmp_path):
    started = []

    def start(**options):
        started.append(Served(tmp_path, **options))
        return started[-1]

    yield start
    for service in started:
        if service.process.poll() is None:
            service.stop()


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_default_design_is_quick_and_small(serve):
    service = serve()
    peak, first = 0.0, None
    start = time.monotonic()

    def look(found):
        nonlocal peak, first
        peak = max(peak, service.memory_mib())
        if found["result"] is not None and first is None:
            first = time.monotonic() - start

    status, accepted = service.call("POST", "/designs", ASK)
    assert status == 202
    found = service.finished(accepted["url"], look)
    total = time.monotonic() - start
    assert found["state"] == "done", found["error"]
    seconds = found["result"]["seconds"]
    sys.stdout.write(
        f"\ndefault request: result after {first:.1f} s, files after {total:.1f} s; parts "
        f"{ {k: round(v, 2) for k, v in seconds.items()} }; peak memory {peak:.0f} MiB "
        "(proportional, API and worker)\n"
    )
    assert first < 60 and peak < ONE_GIB_MIB


def test_fifty_requests_at_once_are_all_answered(serve):
    service = serve()
    seeds = range(50)
    with concurrent.futures.ThreadPoolExecutor(50) as pool:
        answers = list(
            pool.map(lambda seed: service.call("POST", "/designs", SMALL | {"seed": seed}), seeds)
        )
    assert [status for status, _ in answers] == [202] * 50
    assert len({a["id"] for _, a in answers}) == 50
    found = [service.finished(a["url"]) for _, a in answers]
    assert [f["state"] for f in found] == ["done"] * 50
    assert [f["spec"]["seed"] for f in found] == list(seeds)
    assert all(f["result"]["designs"] and len(f["files"]) == 5 for f in found)


def test_kill_in_mid_job_loses_nothing(serve):
    service = serve()
    jobs = [service.call("POST", "/designs", ASK | {"seed": s, "candidates": 1})[1] for s in (1, 2)]
    end = time.monotonic() + LIMIT_S
    while service.call("GET", jobs[0]["url"])[1]["progress"]["trial"] < 10:
        assert time.monotonic() < end
        time.sleep(0.1)
    workers = service.processes() - {service.process.pid}
    service.kill()
    while any(map(alive, workers)):  # they see the end of their pipe
        assert time.monotonic() < end
        time.sleep(0.1)
    service = serve()
    found = [service.finished(job["url"]) for job in jobs]
    assert [f["state"] for f in found] == ["done", "done"]
    assert found[0]["attempts"] == 2
    again = service.finished(service.call("POST", "/designs", ASK | {"candidates": 1})[1]["url"])
    assert again["result"]["trials"] == found[0]["result"]["trials"]


def test_a_killed_worker_is_replaced(serve):
    service = serve()
    _, accepted = service.call("POST", "/designs", SMALL | {"trials": 100})
    end = time.monotonic() + LIMIT_S
    while service.call("GET", accepted["url"])[1]["progress"]["trial"] < 5:
        assert time.monotonic() < end
        time.sleep(0.1)
    [worker] = service.processes() - {service.process.pid}
    os.kill(worker, signal.SIGKILL)
    found = service.finished(accepted["url"])
    assert (found["state"], found["attempts"]) == ("done", 2)


def test_a_killed_check_goes_on_with_the_cells_that_it_has(serve, tmp_path):
    service = serve()
    cells = {"stiffness_set_1": "3", "stiffness_set_2": "3", "radius_1_um": 6, "radius_2_um": 8.5}
    array = {"pillar_radius_um": 8.91, "gap_um": 12.06, "periodicity": 6}
    status, accepted = service.call("POST", "/checks", cells | array | {"simulate": 3})
    assert status == 202, accepted
    folder, end = tmp_path / "outcomes" / accepted["id"], time.monotonic() + LIMIT_S
    while not list(folder.glob("cell-*.parquet")):
        assert time.monotonic() < end
        time.sleep(0.1)
    workers = service.processes() - {service.process.pid}
    service.kill()
    while any(map(alive, workers)):
        assert time.monotonic() < end
        time.sleep(0.1)
    kept = {path: path.stat().st_mtime_ns for path in folder.glob("cell-*.parquet")}
    service, said = serve(), set()
    while (found := service.call("GET", f"/checks/{accepted['id']}")[1])["state"] != "done":
        assert time.monotonic() < end and found["state"] in ("queued", "running"), found
        if found["attempts"] == 2:
            said.add(found["message"])
            assert all(p.stat().st_mtime_ns == t for p, t in kept.items() if p.exists())
        time.sleep(0.1)
    assert found["attempts"] == 2 and not any(s.startswith("cell 1 of") for s in said)
    assert sum(row["simulated"] for row in found["result"]["device_checks"]) == 3
    assert not folder.exists()


def test_a_verdict_is_attached_when_it_is_ready(serve, tmp_path):
    settings = yaml.safe_load((Path(__file__).parents[3] / "config.yaml").read_text())
    settings["verification"] = {
        "rounds": 1,
        "designs_per_round": 1,
        "transition_geometries": 0,
        "height_runs": False,
        "exports": 1,
        "outcomes_max": 2,
    }
    config = tmp_path / "config.yaml"
    config.write_text(yaml.safe_dump(settings))
    service = serve(config=config)
    _, accepted = service.call("POST", "/designs", SMALL | {"verify": True})
    found = service.finished(accepted["url"])
    assert found["state"] == "done" and found["result"]["designs"]  # long before the verdict
    assert found["verification"]["state"] in ("queued", "running")
    end, peak = time.monotonic() + LIMIT_S, 0.0
    while found["verification"]["state"] in ("queued", "running"):
        assert time.monotonic() < end
        peak = max(peak, service.memory_mib())
        time.sleep(1)
        _, found = service.call("GET", accepted["url"])
    verdict = found["verification"]
    assert verdict["state"] == "done", verdict["message"]
    assert len(verdict["designs"]) == 1 and len(verdict["verifications"]) == 3
    sys.stdout.write(
        f"\nverdict after {verdict['elapsed_s']:.0f} s, peak memory {peak:.0f} MiB: "
        f"{verdict['designs'][0]['verdict']}\n"
    )
    kinds = {f["kind"] for f in found["files"] if f["verified"] == 1}
    assert kinds == {"json", "csv", "gds", "dxf"}
    _, record = service.call("GET", f"{accepted['url']}/files/json?verified=1")
    assert len(record["verification"]) == 2
    assert not list((tmp_path / "outcomes").iterdir())


@pytest.mark.skipif(
    shutil.which("schemathesis") is None
    and not (Path(sys.executable).parent / "schemathesis").exists(),
    reason="schemathesis is not installed",
)
def test_fuzzing_meets_no_server_error(serve):
    service = serve(
        queue_max=1000,
        verify_queue_max=2,
        campaigns_max=20,
        search_s_max=5,
        verify_s_max=5,
        optimize_wait_s=1,
    )
    command = shutil.which("schemathesis") or str(Path(sys.executable).parent / "schemathesis")
    examples = os.environ.get("DLDSIM_WEB_TEST_EXAMPLES", "40")
    done = subprocess.run(
        [
            command,
            "run",
            f"{service.base}/openapi.json",
            "--checks",
            "not_a_server_error",
            "--max-examples",
            examples,
            "--request-timeout",
            "120",
            "--mode",
            "all",
            "--generation-database",
            "none",
        ],
        capture_output=True,
        text=True,
    )
    sys.stdout.write(done.stdout[-3000:])
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]
    assert service.process.poll() is None
    assert service.call("GET", "/health")[0] == 200
