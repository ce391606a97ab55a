"""What comes out of a device or a cascade: predicted at once, or checked by simulated cells."""

import json
import uuid
from collections.abc import Iterator
from contextlib import contextmanager

from fastapi import APIRouter

from dldsim.app.web.api import answers, outcome_specs
from dldsim.app.web.api.data import Source
from dldsim.app.web.api.devices import answer_of, outcomes_of
from dldsim.app.web.api.problems import PREFIX, Refused, infeasible, problems
from dldsim.app.web.api.service import Id, Service, iso_time
from dldsim.app.web.api.store import SEARCH, VERIFICATION, Job
from dldsim.design.finished_campaign import check_settings
from dldsim.errors import DldsimError


def make_router(service: Service) -> APIRouter:
    """Addresses of outcomes."""
    routes = APIRouter(prefix=PREFIX)
    store = service.store

    @contextmanager
    def place(spec: outcome_specs.CellsInDevice) -> Iterator[Source]:
        """The campaign of a request, while few others compute; what it cannot meet is refused."""
        source = service.source(spec.campaign)
        if not service.outcomes.acquire(blocking=False):
            raise service.busy(SEARCH, "Two outcomes are being computed already.")
        try:
            yield source
        except DldsimError as error:
            raise infeasible(spec, error) from error
        finally:
            service.outcomes.release()

    @routes.post(
        "/outcome",
        response_model=answers.OutcomeAnswer,
        responses=problems(404, 409, 429),
        tags=["outcomes"],
    )
    def outcome(spec: outcome_specs.OutcomeSpec) -> answers.OutcomeAnswer:
        """Purity and recovery of two populations at the outlets of a device, or of a cascade."""
        with place(spec) as source:
            return answers.OutcomeAnswer(**answer_of(*outcomes_of(spec, source), source))

    @routes.post(
        "/checks",
        status_code=202,
        response_model=answers.CheckStatus,
        responses=problems(404, 409, 429),
        tags=["outcomes"],
    )
    def check(spec: outcome_specs.CheckSpec) -> answers.CheckStatus:
        """Simulate cells drawn from both populations in a device; the answer comes at once, the
        simulated cells take minutes."""
        with place(spec) as source:
            service.simulates("simulate", spec.simulate)
            if spec.campaign is None:
                config = service.settings.configuration()
                check_settings(config, source.known, spec.request, simulate=True)
            outcomes_of(spec, source)  # what has no outcome is refused before it waits
        identifier = str(uuid.uuid4())
        given = spec.model_dump(mode="json")
        service.add([(identifier, "check", VERIFICATION, "queued", given)])
        return status(find(identifier))

    @routes.get(
        "/checks/{id}",
        response_model=answers.CheckStatus,
        responses=problems(404),
        tags=["outcomes"],
    )
    def look(id: Id) -> answers.CheckStatus:
        """How far it is, then predicted and simulated cells side by side."""
        return status(find(id))

    @routes.delete(
        "/checks/{id}",
        response_model=answers.CheckStatus,
        responses=problems(404),
        tags=["outcomes"],
    )
    def cancel(id: Id) -> answers.CheckStatus:
        """End it, after the cell that is being simulated."""
        find(id)
        store.cancel(id)
        service.pool.wake()
        return status(find(id))

    def find(identifier: str) -> Job:
        job = store.find(identifier, "check")
        if job is None:
            raise Refused(
                404,
                "not-found",
                f"check {identifier}: there is none of this id; "
                f"results are kept {service.settings.keep_days:g} days.",
            )
        return job

    def status(job: Job) -> answers.CheckStatus:
        stored = store.result(job.id, job.kind)
        return answers.CheckStatus(
            id=job.id,
            state=job.state,
            queue_position=store.position(job),
            created=iso_time(job.created),
            started=iso_time(job.started),
            finished=iso_time(job.finished),
            attempts=job.attempts,
            spec=job.spec,
            message=job.progress.get("message", ""),
            elapsed_s=job.progress.get("elapsed_s"),
            error=job.error,
            result=json.loads(stored) if stored else None,
        )

    return routes
