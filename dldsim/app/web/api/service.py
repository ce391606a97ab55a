"""What the addresses share: settings, queue, processes, campaigns, and the checks of requests."""

import math
import threading
import time
from datetime import UTC, datetime
from typing import Annotated, Any

from fastapi import Path, Query

from dldsim.app import design_answers
from dldsim.app.asked import ask
from dldsim.app.web.api import answers, specs
from dldsim.app.web.api.data import Data, NotFound, NotReady, Source, Unavailable
from dldsim.app.web.api.pool import Pool
from dldsim.app.web.api.problems import PREFIX, Refused, infeasible, out_of_range
from dldsim.app.web.api.settings import Settings
from dldsim.app.web.api.specs import UUID
from dldsim.app.web.api.store import SEARCH, VERIFICATION, Busy, Job, Store
from dldsim.design import search
from dldsim.design.populations import flow_of
from dldsim.errors import DldsimError

Id = Annotated[str, Path(pattern=UUID, description="as it was answered by POST")]
CampaignQuery = Annotated[
    str | None, Query(pattern=UUID, description="an uploaded campaign; left out: the service's own")
]


class Service:
    """What the addresses share."""

    def __init__(self, settings: Settings):
        settings.campaign()  # a configuration that cannot be read is told at the start
        self.settings = settings
        self.store = Store(settings.state)
        self.data = Data(settings, self.store)
        self.pool = Pool(settings, self.store)
        self.started = time.time()
        self.waited_for = 0
        self.uploads = threading.Semaphore(2)
        self.outcomes = threading.Semaphore(2)

    @property
    def prefix(self) -> str:
        """What addresses in answers begin with."""
        return self.settings.root_path + PREFIX

    @property
    def limits(self) -> dict[str, int]:
        return {SEARCH: self.settings.queue_max, VERIFICATION: self.settings.verify_queue_max}

    def source(self, campaign: str | None) -> Source:
        """A campaign, or the answer that says why there is none."""
        try:
            return self.data.source(campaign)
        except Unavailable as error:
            raise Refused(503, "unhealthy", str(error), retry_after_s=30) from error
        except NotFound as error:
            raise Refused(404, "not-found", str(error)) from error
        except NotReady as error:
            raise Refused(409, "not-ready", str(error)) from error

    def busy(self, lane: str, reason: str) -> Refused:
        size = self.pool.sizes[lane] or 1
        seconds = math.ceil(min(max(self.store.mean_seconds(lane) / size, 1), 3600))
        return Refused(429, "busy", f"{reason} Try again in {seconds} s.", retry_after_s=seconds)

    def add(self, jobs: list, **more: Any) -> int:
        """Put jobs into the queue and wake the processes."""
        if problems := self.pool.problems():
            raise Refused(503, "unhealthy", " ".join(problems), retry_after_s=30)
        try:
            before = self.store.add(jobs, self.limits, **more)
        except Busy as error:
            raise self.busy(jobs[0][2], str(error)) from error
        self.pool.wake()
        return before

    def check(self, spec: specs.DesignSpec) -> None:
        """Refuse what no search can answer, before it waits in the queue."""
        most = self.settings.trials_max
        if spec.trials > most:
            raise out_of_range(spec, "trials", f"1 to {most}")
        if spec.sampler == "grid":
            low, high = spec.periodicity
            points = spec.grid_steps**2 * (high - low + 1)
            draws = points * (spec.angle_draws if spec.objective == "robust" else 1)
            if draws > self.settings.grid_draws_max:
                raise out_of_range(
                    spec,
                    "grid_steps",
                    f"{draws} values to compute; grid_steps² × number of periodicities × "
                    f"draws up to {self.settings.grid_draws_max}",
                )
        source = self.source(spec.campaign)
        known = source.known
        try:
            request = spec.request
            populations = design_answers.resolve_by(known, request)
            chip = known.chip.at(flow_of(request, known.chip.flow))
            asked = ask(request, populations, known.tables, spec.measured)
            more = asked.sources, asked.history
            search.check(search.Task(known.model, request, populations, chip, spec.seed, *more))
            if spec.verify:
                self.simulates("verify", True)
        except DldsimError as error:
            raise infeasible(spec, error) from error

    def simulates(self, key: str, value: Any) -> None:
        """Raise DldsimError that names a field if this service has no process that simulates."""
        if self.settings.verify_workers == 0:
            raise DldsimError(
                f"{key} = {str(value).lower()}: this service does not simulate.",
                key=key,
                value=value,
                allowed="left out",
                remedy="Start it with --verify-workers 1, or simulate by the command.",
            )

    def status(self, job: Job) -> str:
        """A design as JSON text; results are stored as they are sent."""
        verdict = self.store.find(job.id, "verification")
        stored = self.store.result(job.id, job.kind)
        position = self.store.position(job)
        progress = {"trials": job.spec["trials"]} | job.progress
        if position is not None:
            progress["left_s"] = (
                self.store.mean_seconds(job.lane) * (position + 1) / self.pool.sizes[job.lane]
            )
        found = answers.DesignStatus(
            id=job.id,
            state=job.state,
            queue_position=position,
            created=iso_time(job.created),
            started=iso_time(job.started),
            finished=iso_time(job.finished),
            attempts=job.attempts,
            spec=job.spec,
            error=job.error,
            progress=answers.Progress(**progress),
            verification=self._verdict(job, verdict),
            files=[
                answers.FileInfo(**f, url=self.file_url(job.id, f))
                for f in self.store.files(job.id)
            ],
        )
        text = found.model_dump_json()
        if stored is None:
            return text
        # both are objects: the stored one replaces the two nulls
        head = found.model_dump_json(exclude={"result", "provenance"})
        return f"{head[:-1]},{stored[1:]}"

    def file_url(self, identifier: str, file: dict) -> str:
        which = ""
        if file["candidate"] is not None:
            which = f"?candidate={file['candidate']}"
        if file["verified"] is not None:
            which = f"?verified={file['verified']}"
        return f"{self.prefix}/designs/{identifier}/files/{file['kind']}{which}"

    def _verdict(self, job: Job, found: Job | None) -> answers.Verdict:
        if found is None:
            return answers.Verdict(state="not-wanted")
        if found.state == "done":
            return answers.Verdict.model_validate_json(self.store.result(job.id, "verification"))
        return answers.Verdict(
            state=found.state,
            message=found.error or found.progress.get("message", ""),
            elapsed_s=found.progress.get("elapsed_s"),
        )


def calibration_of(source: Source):
    """The calibration of a campaign, or the answer that it has none."""
    if "calibration" not in source.known.tables:
        raise Refused(
            409,
            "not-available",
            f"{source.provenance.campaign_name}: it came "
            "without a calibration. Upload it with the outcomes.",
        )
    return source.known.tables["calibration"]


def iso_time(seconds: float | None) -> str | None:
    return seconds and datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds")
