"""Calls of /api/v1. What is refused or fails becomes an :class:`ApiError` that can be shown."""

from collections.abc import Mapping
from functools import cache
from typing import Any, TypeVar

import httpx
from pydantic import BaseModel, ValidationError

from dldsim.app.web.api import answers
from dldsim.app.web.ui import api_address

PREFIX = "/api/v1"
TIMEOUT = httpx.Timeout(30.0, connect=3.0)
FINAL = ("done", "failed", "cancelled")
"""States of a design, and of its verification, that do not change any more."""
Model = TypeVar("Model", bound=BaseModel)


class ApiError(Exception):
    """A refusal or failure as the API told it; `status` 0: no answer at all."""

    def __init__(self, status: int, problem: answers.Problem):
        super().__init__(problem.message)
        self.status, self.problem = status, problem


def address() -> str:
    """Where the API is. Raises ApiError if the setting is no address."""
    try:
        return api_address()
    except ValueError as error:
        raise _silent(f"This page does not know where the service is. {error}") from error


@cache
def connect(base: str) -> httpx.Client:
    """The connections to one API, shared by all sessions. Never through a proxy: it is local."""
    return httpx.Client(base_url=base, timeout=TIMEOUT, trust_env=False)


def call(method: str, path: str, **more: Any) -> httpx.Response:
    """The answer to one request. Raises ApiError."""
    try:
        answer = connect(address()).request(method, PREFIX + path, **more)
    except httpx.TimeoutException as error:
        raise _silent(
            f"The service at {address()} did not answer within {TIMEOUT.read:g} s. It "
            "may be busy; try again."
        ) from error
    except (httpx.HTTPError, httpx.InvalidURL) as error:
        raise _silent(
            f"The service cannot be reached at {address()}. Start it with "
            "`python -m dldsim serve api`, or both parts with `make web`."
        ) from error
    if answer.is_success:
        return answer
    try:
        problem = answers.Problem.model_validate_json(answer.content)
    except ValidationError:
        problem = answers.Problem(
            error="failed",
            message=f"{address()} answered with status {answer.status_code} and not as this "
            "service does. Is something else at that address?",
        )
    raise ApiError(answer.status_code, problem)


def _silent(message: str) -> ApiError:
    return ApiError(0, answers.Problem(error="unreachable", message=message))


def _ask(model: type[Model], method: str, path: str, **more: Any) -> Model:
    answer = call(method, path, **more)
    try:
        return model.model_validate_json(answer.content)
    except ValidationError as error:
        raise ApiError(
            answer.status_code,
            answers.Problem(
                error="failed",
                message=f"The answer of {address()} is not what this page expects. "
                "Page and service are of different versions.",
            ),
        ) from error


def _of(campaign: str | None) -> dict[str, str]:
    return {"campaign": campaign} if campaign else {}


def model(campaign: str | None) -> answers.ModelInfo:
    return _ask(answers.ModelInfo, "GET", "/model", params=_of(campaign))


def table(kind: str, campaign: str | None) -> answers.Table:
    return _ask(answers.Table, "GET", f"/campaign/{kind}", params=_of(campaign))


def health() -> answers.Health:
    """Also when it is unhealthy. Raises ApiError if there is no such answer."""
    try:
        return _ask(answers.Health, "GET", "/health")
    except ApiError as error:
        if error.status != 503:
            raise
        answer = connect(address()).get(PREFIX + "/health")
        return answers.Health.model_validate_json(answer.content)


def ask(spec: Mapping[str, Any]) -> answers.Accepted:
    return _ask(answers.Accepted, "POST", "/designs", json=spec)


def design(identifier: str) -> answers.DesignStatus:
    return _ask(answers.DesignStatus, "GET", f"/designs/{identifier}")


def cancel(identifier: str) -> answers.DesignStatus:
    return _ask(answers.DesignStatus, "DELETE", f"/designs/{identifier}")


def content(file: answers.FileInfo) -> bytes:
    """Bytes of a file of a design, whose address is as the API gave it."""
    return call("GET", file.url.partition(PREFIX)[2]).content


def outcome(spec: Mapping[str, Any]) -> answers.OutcomeAnswer:
    return _ask(answers.OutcomeAnswer, "POST", "/outcome", json=spec)


def check(spec: Mapping[str, Any]) -> answers.CheckStatus:
    return _ask(answers.CheckStatus, "POST", "/checks", json=spec)


def checked(identifier: str) -> answers.CheckStatus:
    return _ask(answers.CheckStatus, "GET", f"/checks/{identifier}")


def cancel_check(identifier: str) -> answers.CheckStatus:
    return _ask(answers.CheckStatus, "DELETE", f"/checks/{identifier}")


def predict(spec: Mapping[str, Any]) -> answers.Prediction:
    return _ask(answers.Prediction, "POST", "/predict", json=spec)


def stiffness(spec: Mapping[str, Any]) -> answers.StiffnessAnswer:
    return _ask(answers.StiffnessAnswer, "POST", "/stiffness", json=spec)


def measure(spec: Mapping[str, Any]) -> answers.CampaignStatus:
    return _ask(answers.CampaignStatus, "POST", "/measurements", json=spec)


def upload(name: str, files: Mapping[str, tuple[str, bytes]]) -> answers.CampaignStatus:
    return _ask(answers.CampaignStatus, "POST", "/campaigns", data={"name": name}, files=files)


def campaign(identifier: str) -> answers.CampaignStatus:
    return _ask(answers.CampaignStatus, "GET", f"/campaigns/{identifier}")


def forget(identifier: str) -> None:
    call("DELETE", f"/campaigns/{identifier}")
