"""The processes that work on the queue: started, watched, started again."""

import fcntl
import os
import subprocess
import sys
import threading
import time
import uuid
from pathlib import Path

import dldsim
from dldsim.app.web.api.settings import Settings
from dldsim.app.web.api.store import SEARCH, VERIFICATION, Store
from dldsim.errors import DldsimError

WATCH_EVERY_S = 0.5
FAILURES = 3
"""Starts of a worker in a row that end at once, after which the pool counts as broken."""
YOUNG_S = 20.0
RESTARTS_MAX = 10
"""Times that a job is begun again after the whole service was killed, which it may have caused."""


class Pool:
    """A fixed number of processes that search and fit; others that simulate, while needed.

    One service has one state folder: a second is refused by a lock, which ends with its process.
    """

    def __init__(self, settings: Settings, store: Store):
        self.settings, self.store = settings, store
        self.sizes = {SEARCH: settings.workers, VERIFICATION: settings.verify_workers}
        self.workers: dict[str, tuple[str, subprocess.Popen, float]] = {}
        self.failures = dict.fromkeys(self.sizes, 0)
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._lock = None
        self._swept = 0.0

    def start(self) -> None:
        """Take the lock, queue again what was interrupted, start the processes."""
        self.lock()
        self.store.release(
            None,
            "It was begun many times, and the service ended each time.",
            attempts_max=RESTARTS_MAX,
        )
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def lock(self) -> None:
        """Keep other services away from the state folder. Raises DldsimError if one is there."""
        if self._lock is not None:
            return
        file = (self.settings.state / "lock").open("w")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            file.close()
            raise DldsimError(
                f"state = {self.settings.state}: another service works there. Stop "
                "it, or name another folder with --state."
            ) from error
        self._lock = file

    def stop(self) -> None:
        """End the processes; what they were at is done after the next start."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
        for name, (_, process, _) in self.workers.items():
            process.kill()
            process.wait()
            self.store.release(name, "", attempts_max=RESTARTS_MAX, counts=False)
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def wake(self) -> None:
        """Tell the processes that there is work."""
        for _, process, _ in list(self.workers.values()):
            try:
                process.stdin.write(b"\n")
                process.stdin.flush()
            except OSError:  # it has just ended; the watch sees it
                pass

    def problems(self) -> list[str]:
        """What keeps the pool from working."""
        found = [
            f"The processes for {lane} end as soon as they are started; see the log."
            for lane, count in self.failures.items()
            if count >= FAILURES
        ]
        if self._thread is None or not self._thread.is_alive():
            found.append("The pool of processes is not running.")
        return found

    def alive(self) -> dict[str, int]:
        """Number of processes by lane."""
        return {
            lane: sum(1 for of, p, _ in self.workers.values() if of == lane and p.poll() is None)
            for lane in self.sizes
        }

    def pids(self, lane: str) -> list[int]:
        return [p.pid for of, p, _ in list(self.workers.values()) if of == lane]

    def _watch(self) -> None:
        while True:
            try:
                self._look()
            except Exception as error:  # such as a full disk: say it, and try again
                sys.stderr.write(f"pool: {error!r}\n")
            if self._stop.wait(WATCH_EVERY_S):
                return

    def _look(self) -> None:
        for name, (lane, process, started) in list(self.workers.items()):
            code = process.poll()
            if code is None:
                continue
            del self.workers[name]
            process.stdin.close()
            if code != 0:
                young = time.monotonic() - started < YOUNG_S
                self.failures[lane] = self.failures[lane] + 1 if young else 1
                self.store.release(name, _ended(code))
        limits = {SEARCH: self.settings.search_s_max, VERIFICATION: self.settings.verify_s_max}
        for lane, seconds in limits.items():
            for name in self.store.overrun(lane, seconds):
                if name in self.workers:  # its job failed; the process itself did not
                    _, process, _ = self.workers.pop(name)
                    process.kill()
                    process.wait()
                    process.stdin.close()
        waiting = self.store.counts()
        for lane, size in self.sizes.items():
            alive = sum(1 for of, _, _ in self.workers.values() if of == lane)
            wanted = (
                size
                if lane == SEARCH
                else min(size, sum(waiting[lane].get(state, 0) for state in ("queued", "running")))
            )
            old = [s for of, _, s in self.workers.values() if of == lane]
            if old and time.monotonic() - max(old) > YOUNG_S:
                self.failures[lane] = 0
            pause = self.failures[lane] >= FAILURES and time.monotonic() % 10 > WATCH_EVERY_S
            for _ in range(0 if pause else max(0, wanted - alive)):
                self._begin(lane)
        if time.monotonic() - self._swept > 3600:
            self._swept = time.monotonic()
            self.store.forget(self.settings.keep_days)

    def _begin(self, lane: str) -> None:
        name = str(uuid.uuid4())
        path = os.pathsep.join(
            filter(None, [str(Path(dldsim.__file__).parents[1]), os.environ.get("PYTHONPATH")])
        )
        process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "dldsim.app.web.api.worker",
                lane,
                name,
                self.settings.model_dump_json(),
            ],
            stdin=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": path},
        )
        self.workers[name] = lane, process, time.monotonic()


def _ended(code: int) -> str:
    cause = f"signal {-code}" if code < 0 else f"code {code}"
    hint = " Perhaps there was not enough memory." if code == -9 else ""
    return f"The process that worked on it ended with {cause}, several times.{hint}"
