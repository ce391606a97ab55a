"""The service: what each address answers. Physics and fitting are calls of the package."""

import asyncio
import json
import math
import sys
import threading
import time
import traceback
import uuid
from contextlib import asynccontextmanager
from datetime import UTC, datetime
from typing import Annotated, Any, Literal

from fastapi import FastAPI, File, Form, Path, Query, Request, Response, UploadFile
from fastapi.exceptions import RequestValidationError
from fastapi.middleware.cors import CORSMiddleware
from pydantic import BaseModel
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException

from dldsim import PHYSICS_VERSION, __version__
from dldsim.analysis.calibration import default_curves, stiffness_for
from dldsim.app import design_answers, outcome_answers
from dldsim.app.asked import ask
from dldsim.app.web.api import models
from dldsim.app.web.api.data import (
    Data,
    NotFound,
    NotReady,
    Source,
    Unavailable,
    check_sets,
    columns_of,
    read_upload,
    table_rows,
)
from dldsim.app.web.api.models import UUID
from dldsim.app.web.api.pool import Pool
from dldsim.app.web.api.settings import Settings
from dldsim.app.web.api.store import SEARCH, VERIFICATION, Busy, Job, Store
from dldsim.app.web.api.worker import at_outlets
from dldsim.config.design_sections import CellTypes, Device
from dldsim.config.explain import allowed_at, validate
from dldsim.design import finished_campaign, search
from dldsim.design.measured_cells import INDEX, RADIUS, STIFFNESS
from dldsim.design.populations import doubt, flow_of, rows_of
from dldsim.design.task import angle_interval, check_cell
from dldsim.errors import DldsimError
from dldsim.experiments.migration import mode_of
from dldsim.vocabulary import GEOMETRY

PREFIX = "/api/v1"
MEDIA = {
    "json": "application/json",
    "csv": "text/csv; charset=utf-8",
    "gds": "application/octet-stream",
    "dxf": "application/dxf",
    "report": "text/html; charset=utf-8",
}
BODIES: dict[str, type[BaseModel]] = {
    "/designs": models.DesignSpec,
    "/optimize": models.OptimizeSpec,
    "/outcome": models.OutcomeSpec,
    "/predict": models.PredictSpec,
    "/stiffness": models.StiffnessSpec,
    "/measurements": models.MeasurementsSpec,
}
OUTSIDE = (
    "This array or cell lies outside what was simulated: the prediction is extrapolated and "
    "its interval is the whole range that is possible."
)
FROM_TABLE = (RADIUS, INDEX, STIFFNESS)
"""Keys of refusals that mean a column of measured cells."""
Id = Annotated[str, Path(pattern=UUID, description="as it was answered by POST")]
CampaignQuery = Annotated[
    str | None, Query(pattern=UUID, description="an uploaded campaign; left out: the service's own")
]


class Refused(Exception):
    """An answer that is a problem."""

    def __init__(
        self,
        status: int,
        error: str,
        message: str,
        fields: list[models.FieldProblem] = (),
        retry_after_s: int | None = None,
    ):
        self.status = status
        self.problem = models.Problem(
            error=error, message=message, fields=list(fields), retry_after_s=retry_after_s
        )


def _answer(status: int, problem: models.Problem) -> Response:
    text = json.dumps(problem.model_dump(mode="json"))  # ASCII: half characters cannot break it
    headers = {"Cache-Control": "no-store"}
    if problem.retry_after_s is not None:
        headers["Retry-After"] = str(problem.retry_after_s)
    return Response(text, status, headers, "application/json")


def _problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    return {s: {"model": models.Problem} for s in (*statuses, 400, 413, 422, 500, 503)}


def route_of(scope) -> str:
    """Path of a request in this service: without the proxy's prefix and a slash at the end."""
    return scope["path"].removeprefix(scope.get("root_path", "")).rstrip("/")


class Prefix:
    """Tell the application the path of a proxy before it, whether the proxy strips that or not."""

    def __init__(self, app, root_path: str):
        self.app, self.root_path = app, root_path

    async def __call__(self, scope, receive, send):
        if scope["type"] == "http" and self.root_path:
            path = scope["path"]
            if not f"{path}/".startswith(f"{self.root_path}/"):
                path = self.root_path + path
            scope = {**scope, "root_path": self.root_path, "path": path}
        await self.app(scope, receive, send)


class BodyLimit:
    """Refuse a body that is too large, also one that does not tell its size beforehand."""

    def __init__(self, app, settings: Settings):
        self.app, self.settings = app, settings

    async def __call__(self, scope, receive, send):
        if scope["type"] != "http":
            return await self.app(scope, receive, send)
        upload = route_of(scope) == f"{PREFIX}/campaigns"
        most = self.settings.upload_max_bytes if upload else self.settings.body_max_bytes
        message = f"The body is larger than the {most} bytes that this service takes."
        given = dict(scope["headers"]).get(b"content-length", b"0")
        if not given.isdigit() or int(given) > most:
            refused = _answer(413, models.Problem(error="too-large", message=message))
            return await refused(scope, receive, send)
        seen = 0

        async def counted():
            nonlocal seen
            part = await receive()
            seen += len(part.get("body", b""))
            if seen > most:
                raise HTTPException(413, message)
            return part

        async def guarded(part):
            if part["type"] == "http.response.start":
                part["headers"] = [
                    *part.get("headers", []),
                    (b"x-content-type-options", b"nosniff"),
                ]
            await send(part)

        await self.app(scope, counted, guarded)


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

    def check(self, spec: models.DesignSpec) -> None:
        """Refuse what no search can answer, before it waits in the queue."""
        most = self.settings.trials_max
        if spec.trials > most:
            raise _field(spec, "trials", f"1 to {most}")
        if spec.sampler == "grid":
            low, high = spec.periodicity
            points = spec.grid_steps**2 * (high - low + 1)
            draws = points * (spec.draws if spec.objective == "robust" else 1)
            if draws > self.settings.grid_draws_max:
                raise _field(
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
            if spec.verify and self.settings.verify_workers == 0:
                raise DldsimError(
                    "verify = true: this service does not simulate.",
                    key="verify",
                    value=True,
                    allowed="false",
                    remedy="Leave it out.",
                )
        except DldsimError as error:
            raise _infeasible(spec, error) from error

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
        found = models.DesignStatus(
            id=job.id,
            state=job.state,
            queue_position=position,
            created=_time(job.created),
            started=_time(job.started),
            finished=_time(job.finished),
            attempts=job.attempts,
            spec=job.spec,
            error=job.error,
            progress=models.Progress(**progress),
            verification=self._verdict(job, verdict),
            files=[
                models.FileInfo(**f, url=self.file_url(job.id, f)) for f in self.store.files(job.id)
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

    def _verdict(self, job: Job, found: Job | None) -> models.Verdict:
        if found is None:
            return models.Verdict(state="not-wanted")
        if found.state == "done":
            return models.Verdict.model_validate_json(self.store.result(job.id, "verification"))
        return models.Verdict(
            state=found.state,
            message=found.error or found.progress.get("message", ""),
            elapsed_s=found.progress.get("elapsed_s"),
        )


def _time(seconds: float | None) -> str | None:
    return seconds and datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds")


def _shown(value: Any) -> str:
    """A value as short text."""
    return ascii(value) if len(ascii(value)) <= 100 else ascii(value)[:97] + "..."


def _field(spec: BaseModel, name: str, allowed: str) -> Refused:
    value = _shown(getattr(spec, name))
    message = f"{name} = {value}: allowed {allowed}"
    problem = models.FieldProblem(field=name, value=value, message=message)
    return Refused(422, "invalid", message + ".", [problem])


def _infeasible(spec: BaseModel, error: DldsimError) -> Refused:
    """A request that cannot be met, with the fields that are at fault."""
    given = spec.model_dump()
    named = []
    for fault in error.faults:
        tables = [k for k in given if k.endswith("_csv") and given[k] and k in str(fault)]
        for key in fault.keys:
            for name in [key.removeprefix("device.")] if key not in FROM_TABLE else tables:
                value, *inner = given.get(name.partition(".")[0]), *name.split(".")[1:]
                for part in inner if value is not None else ():
                    value = value[int(part) if part.isdigit() else part]
                if value is not None:
                    named.append(
                        models.FieldProblem(field=name, value=_shown(value), message=str(fault))
                    )
    return Refused(422, "infeasible", str(error), named)


def _invalid(request: Request, error: RequestValidationError) -> Response:
    """Field, value and allowed range of everything that is wrong."""
    route = route_of(request.scope).removeprefix(PREFIX)
    model = BODIES.get(route)
    wanted = "application/json" if model else "multipart/form-data" * (route == "/campaigns")
    given = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if (
        wanted
        and given != wanted
        and not (model and given.endswith("+json"))
        and any(tuple(details["loc"])[:1] == ("body",) for details in error.errors())
    ):
        message = (
            f"Content-Type = {_shown(given) if given else 'missing'}: allowed: {wanted}. "
            "Say with this header what the body is."
        )
        return _answer(
            422,
            models.Problem(
                error="invalid",
                message=message,
                fields=[
                    models.FieldProblem(field="Content-Type", value=given[:100], message=message)
                ],
            ),
        )
    fields = []
    for details in error.errors():
        loc = tuple(details["loc"])
        path = loc[1:] if loc and loc[0] in ("body", "query", "path", "header") else loc
        name = ".".join(str(part) for part in path)[:200]
        allowed = details["msg"]
        if (
            model is not None
            and loc[:1] == ("body",)
            and details["type"] not in ("json_invalid", "model_attributes_type")
        ):
            if details["type"] == "extra_forbidden":
                allowed = "no such field; known: " + ", ".join(model.model_fields)
            elif path:
                allowed = allowed_at(model, path, details)
                most = models.LARGEST.get(path[0])
                if most is not None and "up to" not in allowed:
                    allowed += f", up to {most:g}"
            elif "ctx" in details and "error" in details["ctx"]:
                allowed = str(details["ctx"]["error"])
        value = "missing" if details["type"] == "missing" else _shown(details.get("input"))
        if not path:
            value = ""
        message = f"{name or 'request'}{' = ' + value if value else ''}: allowed: {allowed}"
        keys = getattr(details.get("ctx", {}).get("error"), "keys", ())
        fields += [
            models.FieldProblem(field=_ascii(key), value=value, message=_ascii(message))
            for key in keys or [name]
        ]
    text = "; ".join(list(dict.fromkeys(f.message for f in fields))[:5])
    return _answer(422, models.Problem(error="invalid", message=text, fields=fields[:20]))


def _ascii(text: str) -> str:
    """The text without half characters, which no answer can carry."""
    return text.encode("utf-8", "backslashreplace").decode()


def make_app(settings: Settings | None = None) -> FastAPI:
    """The application. Raises DldsimError if its state folder or configuration cannot be used."""
    service = Service(settings or Settings.read())
    settings = service.settings

    @asynccontextmanager
    async def lifespan(_: FastAPI):
        service.pool.start()
        try:
            await run_in_threadpool(service.data.own)
        except DldsimError as error:
            sys.stderr.write(f"dldsim: unhealthy: {error}\n")
        yield
        await run_in_threadpool(service.pool.stop)

    app = FastAPI(
        title="dldsim",
        version=__version__,
        lifespan=lifespan,
        description="Designs of pillar arrays that separate two types of deformable cells. Every "
        "number comes from a campaign of simulations, which each answer names.",
    )
    app.state.service = service
    _add_problems(app)
    _add_designs(app, service)
    _add_questions(app, service)
    _add_campaigns(app, service)
    if settings.cors_origins:
        app.add_middleware(
            CORSMiddleware,
            allow_origins=list(settings.cors_origins),
            allow_methods=["GET", "POST", "DELETE"],
            allow_headers=["Content-Type"],
        )
    app.add_middleware(BodyLimit, settings=settings)
    app.add_middleware(Prefix, root_path=settings.root_path)
    return app


def _add_problems(app: FastAPI) -> None:
    names = {400: "invalid", 404: "not-found", 405: "no-such-method", 413: "too-large"}

    @app.exception_handler(Refused)
    async def refused(_: Request, error: Refused) -> Response:
        return _answer(error.status, error.problem)

    @app.exception_handler(RequestValidationError)
    async def invalid(request: Request, error: RequestValidationError) -> Response:
        return _invalid(request, error)

    @app.exception_handler(HTTPException)
    async def http(_: Request, error: HTTPException) -> Response:
        kind = names.get(error.status_code, "refused")
        answer = _answer(error.status_code, models.Problem(error=kind, message=str(error.detail)))
        answer.headers.update(error.headers or {})
        return answer

    @app.exception_handler(DldsimError)
    async def told(_: Request, error: DldsimError) -> Response:
        return _answer(422, models.Problem(error="infeasible", message=_ascii(str(error))))

    @app.exception_handler(Exception)
    async def failed(request: Request, error: Exception) -> Response:
        sys.stderr.write("".join(traceback.format_exception(error)))
        return _answer(
            500,
            models.Problem(
                error="defect",
                message="The service failed at this request; its log has the details. "
                "It goes on for others.",
            ),
        )


def _add_designs(app: FastAPI, service: Service) -> None:
    store = service.store

    def accept(spec: models.DesignSpec, kind: str) -> models.Accepted:
        service.check(spec)
        identifier = str(uuid.uuid4())
        given = spec.model_dump(mode="json")
        jobs = [(identifier, kind, SEARCH, "queued", given)]
        if spec.verify:
            jobs.append((identifier, "verification", VERIFICATION, "waiting", given))
        before = service.add(jobs)
        return models.Accepted(
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

    @app.post(
        f"{PREFIX}/designs",
        status_code=202,
        response_model=models.Accepted,
        responses=_problems(404, 409, 429),
        tags=["designs"],
    )
    def ask(spec: models.DesignSpec) -> models.Accepted:
        """Ask for designs; the answer comes at once, the designs later."""
        return accept(spec, "design")

    @app.get(
        f"{PREFIX}/designs/{{id}}",
        response_model=models.DesignStatus,
        responses=_problems(404),
        tags=["designs"],
    )
    def look(id: Id) -> Response:
        """How far it is, then the result."""
        return Response(
            service.status(find(id)),
            media_type="application/json",
            headers={"Cache-Control": "no-store"},
        )

    @app.delete(
        f"{PREFIX}/designs/{{id}}",
        response_model=models.DesignStatus,
        responses=_problems(404),
        tags=["designs"],
    )
    def cancel(id: Id) -> Response:
        """End what has not finished; what has, stays."""
        find(id)
        store.cancel(id)
        service.pool.wake()
        return Response(service.status(find(id)), media_type="application/json")

    @app.get(
        f"{PREFIX}/designs/{{id}}/files/{{kind}}",
        response_class=Response,
        tags=["designs"],
        responses={200: {"content": {"application/octet-stream": {}}}, **_problems(404, 409)},
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

    @app.post(
        f"{PREFIX}/optimize",
        response_model=models.OptimizeAnswer,
        tags=["designs"],
        responses={202: {"model": models.Accepted}, **_problems(404, 409, 429)},
    )
    async def optimize(spec: models.OptimizeSpec, request: Request) -> Response:
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
        answer = models.OptimizeAnswer(
            **{k: best[k] for k in models.OptimizeAnswer.model_fields if k in best},
            id=job.id,
            convergence=result["convergence"],
            importance=result["importance"],
            seconds=job.finished - job.created,
            url=accepted.url,
            provenance=found["provenance"],
        )
        return Response(answer.model_dump_json(), media_type="application/json")


def _add_questions(app: FastAPI, service: Service) -> None:
    @app.post(
        f"{PREFIX}/predict",
        response_model=models.Prediction,
        responses=_problems(404, 409),
        tags=["questions"],
    )
    def predict(spec: models.PredictSpec) -> models.Prediction:
        """The angle of one cell type in one array, and what acts on the cell."""
        source = service.source(spec.campaign)
        model = source.known.model
        place = (spec.pillar_radius_um, spec.gap_um, spec.periodicity)
        try:
            cell, _ = design_answers.resolve_by(source.known, spec.request)
            check_cell("prediction", cell, model)
        except DldsimError as error:
            raise _infeasible(spec, error) from error
        angle = float(model.predict(*place, cell.cell)[0])
        low, high = (float(v[0]) for v in angle_interval(model, cell, *place, spec.level))
        sigma = model.sigma_num_deg(angle, spec.periodicity)
        inside = bool(model.inside_domain(*place, cell.cell)[0])
        outside = model.distance_outside(*place, cell.cell)[0]
        warnings = list(source.provenance.warnings)
        if not inside:
            warnings.append(OUTSIDE)
        safety = source.known.chip.safety_distance_um
        if spec.gap_um <= spec.pillar_radius_um + safety:
            warnings.append(
                "gap_um does not exceed pillar_radius_um by the safety distance of "
                f"{safety:g} µm: a search would not propose this array."
            )
        return models.Prediction(
            angle_deg=angle,
            low_deg=low,
            high_deg=high,
            level=spec.level,
            mode=mode_of(angle, 1 / spec.periodicity),
            bump_angle_deg=math.degrees(math.atan(1 / spec.periodicity)),
            sigma_num_deg=None if sigma is None else float(sigma[0]),
            inside_domain=inside,
            distance_outside=models.finite(float(outside)),
            cell=cell.row("prediction") | {"told_apart": None, "doubt": ""},
            warnings=warnings,
            provenance=source.provenance,
        )

    @app.post(
        f"{PREFIX}/outcome",
        response_model=models.OutcomeAnswer,
        responses=_problems(404, 409, 429),
        tags=["questions"],
    )
    def outcome(spec: models.OutcomeSpec) -> models.OutcomeAnswer:
        """Purity and recovery of two populations at the outlets of one device."""
        source = service.source(spec.campaign)
        known = source.known
        if not service.outcomes.acquire(blocking=False):
            raise service.busy(SEARCH, "Two outcomes are being computed already.")
        try:
            request = spec.request
            populations = design_answers.resolve_by(known, request)
            asked = ask(request, populations, known.tables, spec.measured)
            device = _device(known.chip.device, spec.device)
            design = outcome_answers.Design(
                "array", design_answers.geometry_of(spec.model_dump()), device, {}
            )
            found = outcome_answers.make_outcomes(asked, [design], known, spec.seed)
        except DldsimError as error:
            raise _infeasible(spec, error) from error
        finally:
            service.outcomes.release()
        return models.OutcomeAnswer(
            **at_outlets(found, asked.notes),
            request=request.model_dump(include=set(CellTypes.model_fields) | {"tolerance_um"}),
            device=device.model_dump(),
            populations=rows_of(populations, request.name),
            doubt=doubt(populations),
            warnings=source.provenance.warnings,
            provenance=source.provenance,
        )

    @app.post(
        f"{PREFIX}/stiffness",
        response_model=models.StiffnessAnswer,
        responses=_problems(404, 409),
        tags=["questions"],
    )
    def stiffness(spec: models.StiffnessSpec) -> models.StiffnessAnswer:
        """Moduli of a cell with a measured deformation index."""
        source = service.source(spec.campaign)
        try:
            cell = source.known.settings["cell"]
            found = stiffness_for(
                spec.deformation_index,
                calibration_of(source),
                spec.error,
                spec.assay,
                shape=cell["shape"],
                radius_um=cell["radius_um"],
            )
        except DldsimError as error:
            raise _infeasible(spec, error) from error
        return models.StiffnessAnswer(
            **found,
            deformation_index=spec.deformation_index,
            error=spec.error,
            provenance=source.provenance,
        )

    @app.get(
        f"{PREFIX}/model",
        response_model=models.ModelInfo,
        responses=_problems(404, 409),
        tags=["questions"],
    )
    def model(campaign: CampaignQuery = None) -> models.ModelInfo:
        """The surrogate, where it holds, and what may be asked."""
        source = service.source(campaign)
        known = source.known
        card = known.model.card
        outcomes = known.tables["outcomes"]
        sets, ranges, own_assay = [], {}, None
        if "calibration" in known.tables:
            table = known.tables["calibration"]
            for name in dict.fromkeys(table["assay"]):
                values = table.loc[table["assay"] == name, "deformation_index"].dropna()
                if len(values):
                    ranges[name] = (float(values.min()), float(values.max()))
            named = default_curves(table)
            own_assay = named["assay"].iloc[0]
            named = named[(named["stiffness_set"] != "") & named["deformation_index"].notna()]
            sets = [
                models.CalibratedSet(**row)
                for row in table_rows(
                    "calibration",
                    named[["stiffness_set", "deformation_index", "deformation_index_std"]],
                )
            ]
        columns = GEOMETRY
        used = outcomes.dropna(subset=["migration_angle_deg", "capillary_number"])
        shapes = card["domain"]
        own = shapes.get(known.settings["cell"]["shape"]) or next(iter(shapes.values()))
        limits = {
            k: v
            for k, v in service.settings.model_dump().items()
            if isinstance(v, int | float) and k.endswith(("_max", "_bytes", "_s"))
        }
        return models.ModelInfo(
            card=models.finite({k: v for k, v in card.items() if k != "domain"}),
            deformation_index_range=ranges.get(own_assay, (0.0, 1.0)),
            domain=models.finite(
                {
                    "shapes": shapes,
                    "geometries": own["geometries"],
                    "arrays": used[columns].drop_duplicates().to_numpy(float).tolist(),
                    "array_columns": columns,
                }
            ),
            calibrated_range=ranges,
            stiffness_sets=sets,
            flow=known.settings["flow"],
            cell=known.settings["cell"],
            device=known.settings["device"],
            safety_distance_um=known.chip.safety_distance_um,
            fields=models.limits_of(models.DesignSpec),
            limits=limits,
            provenance=source.provenance,
        )

    def table(kind: str, source: Source) -> models.Table:
        frame = calibration_of(source) if kind == "calibration" else source.known.tables[kind]
        return models.Table(
            kind=kind,
            columns=columns_of(kind),
            rows=table_rows(kind, frame),
            provenance=source.provenance,
        )

    @app.get(
        f"{PREFIX}/campaign/outcomes",
        response_model=models.Table,
        responses=_problems(404, 409),
        tags=["campaign"],
    )
    def outcomes(campaign: CampaignQuery = None) -> models.Table:
        """The outcomes learnt from, and measurements."""
        return table("outcomes", service.source(campaign))

    @app.get(
        f"{PREFIX}/campaign/calibration",
        response_model=models.Table,
        responses=_problems(404, 409),
        tags=["campaign"],
    )
    def calibration(campaign: CampaignQuery = None) -> models.Table:
        """Index of each membrane in each assay."""
        return table("calibration", service.source(campaign))

    @app.get(
        f"{PREFIX}/health",
        response_model=models.Health,
        responses={503: {"model": models.Health}},
        tags=["service"],
    )
    def health(response: Response) -> models.Health:
        """Whether the service can answer; 503 if not."""
        problems = service.pool.problems()
        name, counts = None, {}
        try:
            name = service.data.own().provenance.campaign_name
        except DldsimError as error:
            problems.append(str(error))
        try:
            counts = service.store.counts()
        except Exception as error:
            problems.append(f"Queue and results cannot be read: {error}")
        response.status_code = 503 if problems else 200
        response.headers["Cache-Control"] = "no-store"
        states = [state for lane in counts.values() for state in lane.items()]
        return models.Health(
            status="unhealthy" if problems else "healthy",
            problems=problems,
            campaign=name,
            version=f"dldsim {__version__}, physics version {PHYSICS_VERSION}",
            workers=service.pool.alive(),
            uptime_s=time.time() - service.started,
            queued=sum(n for s, n in states if s in ("queued", "waiting")),
            running=sum(n for s, n in states if s == "running"),
        )


def _device(own: Device, given: dict[str, Any]) -> Device:
    """The service's device with what a request gives. Raises DldsimError that names the fields."""
    try:
        return validate(Device, own.model_dump() | given)
    except DldsimError as error:
        text = "; ".join(fault.allowed for fault in error.faults)
        raise DldsimError(f"The device: {text}.", key=error.keys) from error


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


def _add_campaigns(app: FastAPI, service: Service) -> None:
    store, settings = service.store, service.settings

    def status(job: Job) -> models.CampaignStatus:
        states = {"running": "fitting", "done": "ready"}
        stored = store.result(job.id, job.kind)
        return models.CampaignStatus(
            id=job.id,
            state=states.get(job.state, job.state),
            name=job.spec["name"],
            origin=job.spec["origin"],
            rows=job.spec["rows"],
            found=job.spec.get("found", []),
            created=_time(job.created),
            error=job.error,
            url=f"{service.prefix}/campaigns/{job.id}",
            **(json.loads(stored) if stored else {}),
        )

    def find(identifier: str) -> Job:
        job = store.find(identifier, "campaign")
        if job is None:
            raise Refused(
                404,
                "not-found",
                f"campaign {identifier}: there is none of this id, or it was deleted.",
            )
        return job

    def accept(
        name: str, origin: str, rows: int, parts: dict[str, bytes], found: list[str] = ()
    ) -> models.CampaignStatus:
        identifier = str(uuid.uuid4())
        spec = {"name": name, "origin": origin, "rows": rows, "found": list(found)}
        service.add(
            [(identifier, "campaign", SEARCH, "queued", spec)],
            parts=parts,
            kept=settings.campaigns_max,
        )
        return status(find(identifier))

    @app.post(
        f"{PREFIX}/campaigns",
        status_code=202,
        response_model=models.CampaignStatus,
        responses=_problems(429),
        tags=["campaign"],
    )
    def upload(
        outcomes: Annotated[UploadFile, File(description="table of outcomes, CSV or Parquet")],
        calibration: Annotated[
            UploadFile | None, File(description="for stiffness sets and verification")
        ] = None,
        flows: Annotated[UploadFile | None, File(description="for pressure drops")] = None,
        name: Annotated[str, Form(max_length=80)] = "uploaded campaign",
    ) -> models.CampaignStatus:
        """Bring the tables of a campaign; a surrogate is fitted to them."""
        if not service.uploads.acquire(blocking=False):
            raise service.busy(SEARCH, "Two uploads are being read already.")
        given = {"outcomes": outcomes, "calibration": calibration, "flows": flows}
        uploads = {}
        try:
            for field, file in given.items():
                if file is not None:
                    uploads[field] = read_upload(field, file.file.read(), settings.upload_rows_max)
            parts = {kind: upload.content for kind, upload in uploads.items()}
            check_sets(parts)
        except DldsimError as error:
            message = _ascii(str(error))
            at_fault = error.key if error.key in given else field
            raise Refused(
                422,
                "invalid",
                message,
                [models.FieldProblem(field=at_fault, value="", message=message)],
            ) from error
        finally:
            service.uploads.release()
        found = [
            _ascii(f"{kind}: {note}") for kind, upload in uploads.items() for note in upload.found
        ]
        return accept(_ascii(name), "uploaded", uploads["outcomes"].rows, parts, found)

    @app.post(
        f"{PREFIX}/measurements",
        status_code=202,
        response_model=models.CampaignStatus,
        responses=_problems(404, 409, 429),
        tags=["campaign"],
    )
    def measure(spec: models.MeasurementsSpec) -> models.CampaignStatus:
        """Measured angles to be learnt from, beside the outcomes of a campaign."""
        source = service.source(spec.campaign)
        flow = spec.model_dump(include={"height_um", "mean_velocity_mm_s"})
        given = [flow | row for row in spec.model_dump()["measurements"]]
        simulated = source.known.tables["outcomes"]
        simulated = simulated[simulated["status"] != finished_campaign.MEASURED]
        calibration = source.known.calibration
        try:
            finished_campaign.with_measurements(simulated, given, calibration)
        except DldsimError as error:
            raise _infeasible(spec, error) from error
        parts = service.data.snapshot(spec.campaign)
        given = json.loads(parts.get("measurements", b"[]")) + given
        parts["measurements"] = json.dumps(given).encode()
        return accept(_ascii(spec.name), "measurements", len(simulated) + len(given), parts)

    @app.get(
        f"{PREFIX}/campaigns/{{id}}",
        response_model=models.CampaignStatus,
        responses=_problems(404),
        tags=["campaign"],
    )
    def look(id: Id) -> models.CampaignStatus:
        """Whether it can be used, and its card."""
        return status(find(id))

    @app.delete(
        f"{PREFIX}/campaigns/{{id}}",
        status_code=204,
        response_class=Response,
        responses=_problems(404),
        tags=["campaign"],
    )
    def delete(id: Id) -> Response:
        """Forget the campaign; designs made from it stay."""
        find(id)
        store.delete_campaign(id)
        return Response(status_code=204)
