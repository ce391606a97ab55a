"""Answers that are problems: what is refused, what is invalid, what failed."""

import json
import sys
import traceback
from typing import Any

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel
from starlette.exceptions import HTTPException

from dldsim.app.web.api import answers, outcome_specs, ranges, specs
from dldsim.config.explain import allowed_at
from dldsim.errors import DldsimError

PREFIX = "/api/v1"
BODIES: dict[str, type[BaseModel]] = {
    "/designs": specs.DesignSpec,
    "/optimize": specs.OptimizeSpec,
    "/outcome": outcome_specs.OutcomeSpec,
    "/checks": outcome_specs.CheckSpec,
    "/predict": specs.PredictSpec,
    "/stiffness": specs.StiffnessSpec,
    "/measurements": specs.MeasurementsSpec,
}


class Refused(Exception):
    """An answer that is a problem."""

    def __init__(
        self,
        status: int,
        error: str,
        message: str,
        fields: list[answers.FieldProblem] = (),
        retry_after_s: int | None = None,
    ):
        self.status = status
        self.problem = answers.Problem(
            error=error, message=message, fields=list(fields), retry_after_s=retry_after_s
        )


def answer(status: int, problem: answers.Problem) -> Response:
    text = json.dumps(problem.model_dump(mode="json"))  # ASCII: half characters cannot break it
    headers = {"Cache-Control": "no-store"}
    if problem.retry_after_s is not None:
        headers["Retry-After"] = str(problem.retry_after_s)
    return Response(text, status, headers, "application/json")


def problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    return {s: {"model": answers.Problem} for s in (*statuses, 400, 413, 422, 500, 503)}


def route_of(scope) -> str:
    """Path of a request in this service: without the proxy's prefix and a slash at the end."""
    return scope["path"].removeprefix(scope.get("root_path", "")).rstrip("/")


def shown(value: Any) -> str:
    """A value as short text."""
    return ascii(value) if len(ascii(value)) <= 100 else ascii(value)[:97] + "..."


def out_of_range(spec: BaseModel, name: str, allowed: str) -> Refused:
    value = shown(getattr(spec, name))
    message = f"{name} = {value}: allowed {allowed}"
    problem = answers.FieldProblem(field=name, value=value, message=message)
    return Refused(422, "invalid", message + ".", [problem])


def infeasible(spec: BaseModel, error: DldsimError) -> Refused:
    """A request that cannot be met, with the fields that are at fault."""
    given = spec.model_dump()
    named, left_out = [], []
    for fault in error.faults:
        for name in (key.replace("device.", "") for key in fault.keys):
            value = _at(given, name)
            if value is not None:
                named.append(
                    answers.FieldProblem(field=name, value=shown(value), message=str(fault))
                )
            elif name in given:
                left_out.append(
                    answers.FieldProblem(field=name, value="left out", message=str(fault))
                )
    return Refused(422, "infeasible", str(error), named or left_out)


def _at(given: Any, name: str) -> Any:
    """What a request has at a key path; None where it has nothing."""
    for part in name.split("."):
        given = given[int(part)] if isinstance(given, list) else (given or {}).get(part)
    return given


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
            f"Content-Type = {shown(given) if given else 'missing'}: allowed: {wanted}. "
            "Say with this header what the body is."
        )
        return answer(
            422,
            answers.Problem(
                error="invalid",
                message=message,
                fields=[
                    answers.FieldProblem(field="Content-Type", value=given[:100], message=message)
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
            if details["type"] == "extra_forbidden" and len(path) == 1:
                allowed = "no such field; known: " + ", ".join(model.model_fields)
            elif path:
                allowed = allowed_at(model, path, details)
                most = ranges.LARGEST.get(path[0])
                if most is not None and "up to" not in allowed:
                    allowed += f", up to {most:g}"
            elif "ctx" in details and "error" in details["ctx"]:
                allowed = str(details["ctx"]["error"])
        value = "missing" if details["type"] == "missing" else shown(details.get("input"))
        if not path:
            value = ""
        message = f"{name or 'request'}{' = ' + value if value else ''}: allowed: {allowed}"
        error_there = details.get("ctx", {}).get("error")
        if isinstance(getattr(error_there, "__cause__", None), DldsimError):
            message = str(error_there)  # says by itself what, where and what is allowed
        keys = getattr(error_there, "keys", ())
        fields += [
            answers.FieldProblem(field=ascii_safe(key), value=value, message=ascii_safe(message))
            for key in keys or [name]
        ]
    text = "; ".join(list(dict.fromkeys(f.message for f in fields))[:5])
    return answer(422, answers.Problem(error="invalid", message=text, fields=fields[:20]))


def ascii_safe(text: str) -> str:
    """The text without half characters, which no answer can carry."""
    return text.encode("utf-8", "backslashreplace").decode()


def add_handlers(app: FastAPI) -> None:
    names = {400: "invalid", 404: "not-found", 405: "no-such-method", 413: "too-large"}

    @app.exception_handler(Refused)
    async def refused(_: Request, error: Refused) -> Response:
        return answer(error.status, error.problem)

    @app.exception_handler(RequestValidationError)
    async def invalid(request: Request, error: RequestValidationError) -> Response:
        return _invalid(request, error)

    @app.exception_handler(HTTPException)
    async def http(_: Request, error: HTTPException) -> Response:
        kind = names.get(error.status_code, "refused")
        found = answer(error.status_code, answers.Problem(error=kind, message=str(error.detail)))
        found.headers.update(error.headers or {})
        return found

    @app.exception_handler(DldsimError)
    async def told(_: Request, error: DldsimError) -> Response:
        return answer(422, answers.Problem(error="infeasible", message=ascii_safe(str(error))))

    @app.exception_handler(Exception)
    async def failed(request: Request, error: Exception) -> Response:
        sys.stderr.write("".join(traceback.format_exception(error)))
        return answer(
            500,
            answers.Problem(
                error="defect",
                message="The service failed at this request; its log has the details. "
                "It goes on for others.",
            ),
        )
