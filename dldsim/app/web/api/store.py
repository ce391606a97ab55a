"""Queue, results, files and uploaded campaigns in one SQLite file.

What was accepted is committed before it is answered, and stays until it is done: a job that was
running when its process died goes back into the queue. Every write of a worker names the worker, so
that one whose job was cancelled or taken from it changes nothing.
"""

import json
import sqlite3
import time
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from dldsim.errors import DldsimError

SEARCH, VERIFICATION = "search", "verification"
"""Lanes of the queue, each with its own processes."""
ATTEMPTS_MAX = 3
UNFINISHED = ("waiting", "queued", "running")

TABLES = """
CREATE TABLE IF NOT EXISTS jobs(
  seq INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL, kind TEXT NOT NULL, lane TEXT NOT NULL,
  state TEXT NOT NULL, spec TEXT NOT NULL, created REAL NOT NULL, started REAL, finished REAL,
  worker TEXT, attempts INTEGER NOT NULL DEFAULT 0, progress TEXT NOT NULL DEFAULT '{}',
  error TEXT, result BLOB, UNIQUE(id, kind));
CREATE INDEX IF NOT EXISTS waiting ON jobs(lane, state, seq);
CREATE TABLE IF NOT EXISTS files(
  job TEXT NOT NULL, name TEXT NOT NULL, kind TEXT NOT NULL, candidate INTEGER, verified INTEGER,
  sha256 TEXT NOT NULL, bytes INTEGER NOT NULL, content BLOB NOT NULL, PRIMARY KEY(job, name));
CREATE TABLE IF NOT EXISTS parts(
  campaign TEXT NOT NULL, name TEXT NOT NULL, content BLOB NOT NULL,
  PRIMARY KEY(campaign, name));
"""


class Busy(Exception):
    """The queue is full."""


class Job(NamedTuple):
    """One row of `jobs`, JSON parsed, without the result."""

    seq: int
    id: str
    kind: str
    lane: str
    state: str
    spec: dict
    created: float
    started: float | None
    finished: float | None
    worker: str | None
    attempts: int
    progress: dict
    error: str | None


_COLUMNS = ", ".join(Job._fields)


def _job(row: tuple) -> Job:
    values = dict(zip(Job._fields, row, strict=True))
    return Job(**values | {k: json.loads(values[k]) for k in ("spec", "progress")})


class Store:
    """The database; a connection of its own for every transaction."""

    def __init__(self, folder: Path):
        folder = Path(folder)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self.path = folder / "service.sqlite"
            with self._open() as db:
                db.execute("PRAGMA journal_mode=WAL")
                db.executescript(TABLES)
        except (OSError, sqlite3.Error) as error:
            raise DldsimError(
                f"state = {folder}: queue and results cannot be kept there: {error}. "
                "Name a folder that can be written with --state."
            ) from error

    @contextmanager
    def _open(self) -> Iterator[sqlite3.Connection]:
        db = sqlite3.connect(self.path, timeout=30, isolation_level=None)
        try:
            db.execute("PRAGMA synchronous=FULL")
            yield db
        finally:
            db.close()

    @contextmanager
    def _write(self) -> Iterator[sqlite3.Connection]:
        with self._open() as db:
            db.execute("BEGIN IMMEDIATE")
            try:
                yield db
            except BaseException:
                db.execute("ROLLBACK")
                raise
            db.execute("COMMIT")

    # ------------------------------------------------------------------------------------- the API

    def add(
        self,
        jobs: list[tuple[str, str, str, str, Mapping]],
        limits: Mapping[str, int],
        parts: Mapping[str, bytes] | None = None,
        kept: int | None = None,
    ) -> int:
        """Accept jobs (id, kind, lane, state, spec) together; returns how many are before them.

        ``parts``: of a campaign; ``kept``: how many campaigns there may be. Raises Busy.
        """
        with self._write() as db:
            before = 0
            for lane in {job[2] for job in jobs}:
                count = db.execute(
                    "SELECT count(*) FROM jobs WHERE lane=? AND state IN (?,?,?)",
                    (lane, *UNFINISHED),
                ).fetchone()[0]
                if count >= limits[lane]:
                    raise Busy(
                        f"{count} jobs of kind {lane} are waiting or running, as many as "
                        "this service takes."
                    )
                before = count if lane == jobs[0][2] else before
            if kept is not None:
                count = db.execute("SELECT count(*) FROM jobs WHERE kind='campaign'").fetchone()[0]
                if count >= kept:
                    raise Busy(
                        f"{count} campaigns are kept, as many as this service takes. Delete "
                        "one of yours."
                    )
            now = time.time()
            for identifier, kind, lane, state, spec in jobs:
                db.execute(
                    "INSERT INTO jobs(id, kind, lane, state, spec, created) VALUES(?,?,?,?,?,?)",
                    (identifier, kind, lane, state, json.dumps(spec), now),
                )
            for name, content in (parts or {}).items():
                db.execute("INSERT INTO parts VALUES(?,?,?)", (jobs[0][0], name, content))
        return before

    def find(self, identifier: str, *kinds: str) -> Job | None:
        """The job of an id that is of one of these kinds."""
        marks = ",".join("?" * len(kinds))
        with self._open() as db:
            row = db.execute(
                f"SELECT {_COLUMNS} FROM jobs WHERE id=? AND kind IN ({marks})",
                (identifier, *kinds),
            ).fetchone()
        return row and _job(row)

    def position(self, job: Job) -> int | None:
        """Jobs that will be done before a waiting one; None if it does not wait."""
        if job.state != "queued":
            return None
        with self._open() as db:
            return db.execute(
                "SELECT count(*) FROM jobs WHERE lane=? AND state='queued' AND seq<?",
                (job.lane, job.seq),
            ).fetchone()[0]

    def result(self, identifier: str, kind: str) -> str | None:
        """The result of a job as JSON text."""
        with self._open() as db:
            row = db.execute(
                "SELECT result FROM jobs WHERE id=? AND kind=?", (identifier, kind)
            ).fetchone()
        return zlib.decompress(row[0]).decode() if row and row[0] else None

    def files(self, identifier: str) -> list[dict[str, Any]]:
        """Files of a job without their content."""
        names = ("name", "kind", "candidate", "verified", "sha256", "bytes")
        with self._open() as db:
            rows = db.execute(
                f"SELECT {', '.join(names)} FROM files WHERE job=? ORDER BY name", (identifier,)
            ).fetchall()
        return [dict(zip(names, row, strict=True)) for row in rows]

    def content(self, identifier: str, name: str) -> bytes | None:
        """Content of one file, found by the name it is stored under."""
        with self._open() as db:
            row = db.execute(
                "SELECT content FROM files WHERE job=? AND name=?", (identifier, name)
            ).fetchone()
        return row and row[0]

    def cancel(self, identifier: str) -> None:
        """Cancel what has not finished of an id."""
        with self._write() as db:
            db.execute(
                "UPDATE jobs SET state='cancelled', finished=?, worker=NULL "
                "WHERE id=? AND state IN (?,?,?)",
                (time.time(), identifier, *UNFINISHED),
            )

    def delete_campaign(self, identifier: str) -> None:
        """Forget a campaign. What was made from it stays."""
        with self._write() as db:
            db.execute("DELETE FROM parts WHERE campaign=?", (identifier,))
            db.execute("DELETE FROM jobs WHERE id=? AND kind='campaign'", (identifier,))

    def counts(self) -> dict[str, dict[str, int]]:
        """Number of unfinished jobs by lane and state."""
        found: dict[str, dict[str, int]] = {SEARCH: {}, VERIFICATION: {}}
        with self._open() as db:
            for lane, state, count in db.execute(
                "SELECT lane, state, count(*) FROM jobs WHERE state IN (?,?,?) "
                "GROUP BY lane, state",
                UNFINISHED,
            ):
                found[lane][state] = count
        return found

    def mean_seconds(self, lane: str) -> float:
        """Mean time of the last jobs of a lane, a guess before there are any."""
        with self._open() as db:
            rows = db.execute(
                "SELECT finished - started FROM jobs WHERE lane=? AND state='done' "
                "ORDER BY finished DESC LIMIT 10",
                (lane,),
            ).fetchall()
        return sum(r[0] for r in rows) / len(rows) if rows else 10.0

    # --------------------------------------------------------------------------------- the workers

    def claim(self, lane: str, worker: str) -> Job | None:
        """The next job of a lane, now running in this worker."""
        with self._open() as db:
            if not db.execute(
                "SELECT 1 FROM jobs WHERE lane=? AND state='queued' LIMIT 1", (lane,)
            ).fetchone():
                return None
            row = db.execute(
                "UPDATE jobs SET state='running', worker=?, started=?, attempts=attempts+1, "
                "progress='{}' WHERE seq=(SELECT seq FROM jobs WHERE lane=? AND state='queued' "
                f"ORDER BY seq LIMIT 1) RETURNING {_COLUMNS}",
                (worker, time.time(), lane),
            ).fetchone()
        return row and _job(row)

    def report(self, job: Job, progress: Mapping[str, Any]) -> bool:
        """Note the progress of a job; False if it is no longer this worker's."""
        with self._open() as db:
            done = db.execute(
                "UPDATE jobs SET progress=? WHERE seq=? AND worker=?",
                (json.dumps(progress), job.seq, job.worker),
            )
            return done.rowcount == 1

    def keep_result(self, job: Job, result: str) -> bool:
        """Keep a result before the job has finished."""
        with self._open() as db:
            done = db.execute(
                "UPDATE jobs SET result=? WHERE seq=? AND worker=?",
                (zlib.compress(result.encode()), job.seq, job.worker),
            )
            return done.rowcount == 1

    def finish(
        self,
        job: Job,
        *,
        error: str | None = None,
        result: str | None = None,
        files: list[dict[str, Any]] = (),
        parts: Mapping[str, bytes] | None = None,
    ) -> bool:
        """End a job with its files, and let what waited for it begin; False if it was cancelled."""
        with self._write() as db:
            state = "done" if error is None else "failed"
            done = db.execute(
                "UPDATE jobs SET state=?, finished=?, error=?, worker=NULL, "
                "result=coalesce(?, result) WHERE seq=? AND worker=?",
                (
                    state,
                    time.time(),
                    error,
                    zlib.compress(result.encode()) if result else None,
                    job.seq,
                    job.worker,
                ),
            )
            if done.rowcount != 1:
                return False
            for file in files:
                db.execute(
                    "INSERT OR REPLACE INTO files(job, name, kind, candidate, verified, sha256, "
                    "bytes, content) VALUES(:job, :name, :kind, :candidate, :verified, :sha256, "
                    ":bytes, :content)",
                    file | {"job": job.id},
                )
            for name, content in (parts or {}).items():
                db.execute("INSERT OR REPLACE INTO parts VALUES(?,?,?)", (job.id, name, content))
            if job.kind != "verification":
                after = (
                    ("queued", None)
                    if error is None
                    else ("failed", "The search failed, so there is nothing to simulate.")
                )
                db.execute(
                    "UPDATE jobs SET state=?, error=? WHERE id=? AND state='waiting'",
                    (*after, job.id),
                )
        return True

    def release(
        self, worker: str | None, reason: str, attempts_max: int = ATTEMPTS_MAX, counts: bool = True
    ) -> None:
        """Queue again what a dead worker was at; None: what any was at.

        A job that was begun ``attempts_max`` times fails; ``counts``: whether this was an attempt.
        """
        where, args = ("worker=?", (worker,)) if worker else ("state='running'", ())
        with self._write() as db:
            db.execute(
                f"UPDATE jobs SET state='failed', finished=?, worker=NULL, error=? WHERE {where} "
                "AND state='running' AND attempts>=?",
                (time.time(), reason, *args, attempts_max),
            )
            db.execute(
                "UPDATE jobs SET state='queued', worker=NULL, attempts=attempts-? "
                f"WHERE {where} AND state='running'",
                (0 if counts else 1, *args),
            )
            db.execute(
                "UPDATE jobs SET state='failed', finished=?, error='The search failed.' "
                "WHERE state='waiting' AND id IN (SELECT id FROM jobs WHERE state='failed')",
                (time.time(),),
            )

    def overrun(self, lane: str, seconds: float) -> list[str]:
        """Workers whose job takes longer than allowed; these jobs now have failed."""
        with self._write() as db:
            rows = db.execute(
                "SELECT worker, id FROM jobs WHERE lane=? AND state='running' AND started<?",
                (lane, time.time() - seconds),
            ).fetchall()
            for worker, identifier in rows:
                reason = f"It took longer than the {seconds:g} s that this service allows."
                db.execute(
                    "UPDATE jobs SET state='failed', finished=?, worker=NULL, error=? "
                    "WHERE worker=?",
                    (time.time(), reason, worker),
                )
                db.execute(
                    "UPDATE jobs SET state='failed', error=? WHERE id=? AND state='waiting'",
                    (reason, identifier),
                )
        return [worker for worker, _ in rows]

    def parts(self, campaign: str) -> dict[str, bytes]:
        """Tables and model of an uploaded campaign by name."""
        with self._open() as db:
            return dict(db.execute("SELECT name, content FROM parts WHERE campaign=?", (campaign,)))

    def forget(self, days: float) -> None:
        """Delete what was finished so many days ago."""
        with self._write() as db:
            old = "finished < ?"
            age = (time.time() - 86400 * days,)
            db.execute(f"DELETE FROM files WHERE job IN (SELECT id FROM jobs WHERE {old})", age)
            db.execute(
                f"DELETE FROM parts WHERE campaign IN (SELECT id FROM jobs WHERE {old})", age
            )
            db.execute(f"DELETE FROM jobs WHERE {old}", age)
