"""Designs: asked for, looked at, cancelled, their files, and the answer that is waited for."""

import asyncio
import json
import time
import uuid
from typing import Annotated, Literal

from fastapi import APIRouter, Query, Request, Response
from starlette.concurrency import run_in_threadpool

from dldsim.app.web.api import answers, specs
from dldsim.app.web.api.problems import PREFIX, Refused, problems
from dldsim.app.web.api.service import Id, Service
from dldsim.app.web.api.store import SEARCH, VERIFICATION, Job

MEDIA = {
    "json": "application/json",
    "csv": "text/csv; charset=utf-8",
    "gds": "application/octet-stream",
    "dxf": "application/dxf",
    "report": "text/html; charset=utf-8",
}


def make_router(service: Service) -> APIRouter:
    """Addresses of designs."""
    routes = APIRouter(prefix=PREFIX)
    store = service.store

    def accept(spec: specs.DesignSpec, kind: str) -> answers.Accepted:
        service.check(spec)
        identifier = str(uuid.uuid4())
        given = spec.model_dump(mode="json")
        jobs = [(identifier, kind, SEARCH, "queued", given)]
        if spec.verify:
            jobs.append((identifier, "verification", VERIFICATION, "waiting", given))
        before = service.add(jobs)
        return answers.Accepted(
            id=identifier,
            state="queued",
            queue_position=before,
            url=f"{service.prefix}/designs/{identifier}",
        )

    def find(identifier: str) -> Job:
        job = store.find(identifier, "design", "optimize")
        if job is None:
            raise Refused(
                404,
                "not-found",
                f"design {identifier}: there is none of this id; "
                f"results are kept {service.settings.keep_days:g} days.",
            )
        return job

    @routes.post(
        "/designs",
        status_code=202,
        response_model=answers.Accepted,
        responses=problems(404, 409, 429),
        tags=["designs"],
    )
    def ask(spec: specs.DesignSpec) -> answers.Accepted:
        """Ask for designs; the answer comes at once, the designs later."""
        return accept(spec, "design")

    @routes.get(
        "/designs/{id}",
        response_model=answers.DesignStatus,
        responses=problems(404),
        tags=["designs"],
    )
    def look(id: Id) -> Response:
        """How far it is, then the result."""
        return Response(
            service.status(find(id)),
            media_type="application/json",
            headers={"Cache-Control": "no-store"},
        )

    @routes.delete(
        "/designs/{id}",
        response_model=answers.DesignStatus,
        responses=problems(404),
        tags=["designs"],
    )
    def cancel(id: Id) -> Response:
        """End what has not finished; what has, stays."""
        find(id)
        store.cancel(id)
        service.pool.wake()
        return Response(service.status(find(id)), media_type="application/json")

    @routes.get(
        "/designs/{id}/files/{kind}",
        response_class=Response,
        tags=["designs"],
        responses={200: {"content": {"application/octet-stream": {}}}, **problems(404, 409)},
    )
    def download(
        id: Id,
        kind: Literal["json", "csv", "gds", "dxf", "report"],
        candidate: Annotated[int | None, Query(ge=1, le=1000)] = None,
        verified: Annotated[int | None, Query(ge=1, le=1000)] = None,
    ) -> Response:
        """A file of a candidate, of a simulated design, or the report."""
        job = find(id)
        files = [f for f in store.files(id) if f["kind"] == kind]
        if kind == "report":
            found = files
        elif verified is not None:
            found = [f for f in files if f["verified"] == verified]
        elif candidate is not None:
            found = [f for f in files if f["candidate"] == candidate]
        else:
            found = [f for f in files if f["verified"] == 1] or [
                f for f in files if f["candidate"] == 1
            ]
        if not found:
            raise Refused(
                409,
                "not-available",
                f"design {id}, {kind}: there is no such file; the "
                f"job is {job.state}. Those that exist are listed in its `files`.",
            )
        [file] = found
        headers = {
            "Content-Disposition": f'attachment; filename="{file["name"]}"',
            "ETag": f'"{file["sha256"]}"',
            "Content-Security-Policy": "default-src 'none'; img-src data:; "
            "style-src 'unsafe-inline'; sandbox",
        }
        return Response(store.content(id, file["name"]), headers=headers, media_type=MEDIA[kind])

    @routes.post(
        "/optimize",
        response_model=answers.OptimizeAnswer,
        tags=["designs"],
        responses={202: {"model": answers.Accepted}, **problems(404, 409, 429)},
    )
    async def optimize(spec: specs.OptimizeSpec, request: Request) -> Response:
        """Search and wait for the best candidate."""
        if service.waited_for >= service.settings.optimize_max:
            raise service.busy(SEARCH, f"{service.waited_for} requests are waited for already.")
        service.waited_for += 1
        try:
            accepted = await run_in_threadpool(accept, spec, "optimize")
            end = time.monotonic() + service.settings.optimize_wait_s
            while time.monotonic() < end and not await request.is_disconnected():
                await asyncio.sleep(0.1)
                job = await run_in_threadpool(find, accepted.id)
                if job.state in ("done", "failed", "cancelled"):
                    break
            else:
                return Response(accepted.model_dump_json(), 202, media_type="application/json")
        finally:
            service.waited_for -= 1
        if job.state != "done":
            raise Refused(422, "infeasible", job.error or f"design {job.id} was {job.state}.")
        found = json.loads(store.result(job.id, job.kind))
        result, best = found["result"], found["result"]["designs"][0]
        answer = answers.OptimizeAnswer(
            **{k: best[k] for k in answers.OptimizeAnswer.model_fields if k in best},
            id=job.id,
            convergence=result["convergence"],
            importance=result["importance"],
            seconds=job.finished - job.created,
            url=accepted.url,
            provenance=found["provenance"],
        )
        return Response(answer.model_dump_json(), media_type="application/json")

    return routes
