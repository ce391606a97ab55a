"""Settings of the service, from environment variables DLDSIM_WEB_… and from the command line."""

import difflib
import ipaddress
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError, field_validator

from dldsim.config import limits
from dldsim.config.configuration import Partial, Sweep
from dldsim.config.design_sections import Device, Verification
from dldsim.config.explain import allowed_at
from dldsim.config.presets import read_partial
from dldsim.config.sections import Section
from dldsim.errors import DldsimError

PREFIX = "DLDSIM_WEB_"
OTHERS = ("API", "TEST_")
"""Variables of this prefix, or beginnings of them, that others read: the page and the tests."""


def _state() -> Path:
    base = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(base) / "dldsim-web"


class Settings(Section):
    """How the service runs; there is no secret among them."""

    results: Path | None = Field(
        None, description="campaign folder; none: the campaign that comes with the package"
    )
    config: Path | None = Field(
        None,
        description="configuration for device, safety distance and verification; none: "
        "./config.yaml if there is one, else defaults, as the commands do",
    )
    state: Path = Field(default_factory=_state, description="folder of queue and results")
    host: str = Field("127.0.0.1", description="address to listen on")
    port: int = Field(8000, ge=0, le=65535, description="port to listen on")
    root_path: str = Field(
        "", description="path under which a proxy shows the service, such as /dldsim"
    )
    workers: int = Field(1, ge=1, le=64, description="processes that search and fit")
    verify_workers: int = Field(1, ge=0, le=64, description="processes that simulate; 0: none")
    queue_max: int = Field(100, ge=1, description="searches and fits waiting or running at most")
    verify_queue_max: int = Field(
        10, ge=0, description="verifications and checks waiting or running at most"
    )
    optimize_max: int = Field(8, ge=1, description="requests that are waited for at once")
    optimize_wait_s: float = Field(55.0, gt=0, le=600, description="longest wait for them")
    trials_max: int = Field(500, ge=1, le=1000, description="trials of a search at most")
    grid_draws_max: int = Field(
        1_500_000, ge=1, description="points of a grid × draws of the robust objective at most"
    )
    search_s_max: float = Field(900.0, gt=0, description="a search or fit is ended after this")
    verify_s_max: float = Field(
        4 * 3600.0, gt=0, description="a verification or check is ended after this"
    )
    body_max_bytes: int = Field(256 * 1024, ge=1024, description="of a request")
    upload_max_bytes: int = Field(16 * 1024**2, ge=1024, description="of an upload")
    upload_rows_max: int = Field(20_000, ge=1, description="rows of an uploaded table")
    campaigns_max: int = Field(50, ge=1, description="uploaded campaigns kept at once")
    keep_days: float = Field(30.0, gt=0, description="results and campaigns are deleted after this")
    cors_origins: tuple[str, ...] = Field(
        (), description="origins whose pages may call the service; none: closed"
    )

    @field_validator("host")
    @classmethod
    def _host(cls, value: str) -> str:
        """A name or an address; of IPv6 without brackets."""
        bare = value.removeprefix("[").removesuffix("]")
        if ":" in bare:
            try:
                ipaddress.IPv6Address(bare)
            except ValueError:
                raise ValueError(
                    "a name or an address alone, without http:// and without a port, "
                    "such as 127.0.0.1, ::1 or 0.0.0.0"
                ) from None
        elif not re.fullmatch(r"[A-Za-z0-9._-]+", bare):
            raise ValueError("a name or an address, such as 127.0.0.1, ::1 or 0.0.0.0")
        return bare

    @field_validator("root_path")
    @classmethod
    def _root_path(cls, value: str) -> str:
        bare = value.rstrip("/")
        if not re.fullmatch(r"(/[\w.~-]+)*", bare):
            raise ValueError("a path that begins with a slash, such as /dldsim")
        return bare

    @field_validator("cors_origins")
    @classmethod
    def _origins(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        bare = [origin.strip().rstrip("/") for origin in value if origin.strip()]
        for origin in bare:
            if not re.fullmatch(r"\*|https?://[^/\s,'\"]+", origin):
                raise ValueError(
                    f"origins without path and without quotes, separated by commas, "
                    f"such as https://lab.example, not {origin[:60]}"
                )
        return tuple(bare)

    @classmethod
    def read(cls, given: Mapping[str, Any] | None = None) -> "Settings":
        """Settings of the environment, with those given over them.

        Raises DldsimError that names the variable or the option, and for unknown variables.
        """
        variables = {PREFIX + key.upper(): key for key in cls.model_fields}
        for name in os.environ:
            if (
                name.startswith(PREFIX)
                and name not in variables
                and not any(name.startswith(PREFIX + other) for other in OTHERS)
            ):
                close = difflib.get_close_matches(name, variables, n=1)
                raise DldsimError(
                    f"{name}: there is no such setting."
                    + (f" Did you mean {close[0]}?" if close else "")
                )
        values, origins = {}, {}
        for name, key in variables.items():
            if text := os.environ.get(name):
                values[key] = text.split(",") if key == "cors_origins" else text
                origins[key] = f"environment variable {name}"
        for key, value in (given or {}).items():
            if value is not None:
                values[key], origins[key] = value, f"option --{key.replace('_', '-')}"
        try:
            return cls.model_validate(values)
        except ValidationError as error:
            problems = [
                f"{origins.get(str(e['loc'][0]), str(e['loc'][0]))} = {e['input']!r}: "
                f"allowed: {allowed_at(cls, e['loc'], e)}."
                for e in error.errors()
            ]
        raise DldsimError("The service cannot be started. " + " ".join(problems))

    def configuration(self) -> Partial | None:
        """The configuration file, found as the commands find it; None if there is none."""
        path = self.config or Path("config.yaml")
        if self.config is None and not path.exists():
            return None
        config = read_partial(path)
        limits.enforce(config.limits)
        return config

    def campaign(self) -> tuple[Device, float, Verification]:
        """Device, safety distance and verification budget, found as the commands find them."""
        config = self.configuration()
        if config is None:
            return Device(), Sweep.model_fields["safety_distance_um"].default, Verification()
        safety = (
            config.sweep.safety_distance_um
            if config.sweep
            else (Sweep.model_fields["safety_distance_um"].default)
        )
        return config.device, safety, config.verification
