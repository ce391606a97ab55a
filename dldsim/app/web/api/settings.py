"""Settings of the service, from environment variables DLDSIM_WEB_… and from the command line."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import Field

from dldsim.config import limits
from dldsim.config.configuration import Sweep
from dldsim.config.design_sections import Device, Verification
from dldsim.config.explain import validate
from dldsim.config.presets import read_partial
from dldsim.config.sections import Section

PREFIX = "DLDSIM_WEB_"


def _state() -> Path:
    base = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(base) / "dldsim-web"


class Settings(Section):
    """How the service runs; there is no secret among them."""

    results: Path | None = Field(
        None, description="campaign folder; none: the campaign that comes with the package"
    )
    config: Path | None = Field(
        None, description="configuration for device, safety distance and verification; none: "
        "./config.yaml if there is one, else defaults, as the commands do"
    )
    state: Path = Field(default_factory=_state, description="folder of queue and results")
    host: str = Field("127.0.0.1", description="address to listen on")
    port: int = Field(8000, ge=0, le=65535, description="port to listen on")
    workers: int = Field(1, ge=1, le=64, description="processes that search and fit")
    verify_workers: int = Field(1, ge=0, le=64, description="processes that simulate; 0: none")
    queue_max: int = Field(100, ge=1, description="searches and fits waiting or running at most")
    verify_queue_max: int = Field(10, ge=0, description="verifications waiting or running at most")
    optimize_max: int = Field(8, ge=1, description="requests that are waited for at once")
    optimize_wait_s: float = Field(55.0, gt=0, le=600, description="longest wait for them")
    trials_max: int = Field(500, ge=1, le=1000, description="trials of a search at most")
    grid_draws_max: int = Field(
        1_500_000, ge=1, description="points of a grid × draws of the robust objective at most"
    )
    search_s_max: float = Field(900.0, gt=0, description="a search or fit is ended after this")
    verify_s_max: float = Field(4 * 3600.0, gt=0, description="a verification is ended after this")
    body_max_bytes: int = Field(256 * 1024, ge=1024, description="of a request")
    upload_max_bytes: int = Field(16 * 1024**2, ge=1024, description="of an upload")
    upload_rows_max: int = Field(20_000, ge=1, description="rows of an uploaded table")
    campaigns_max: int = Field(50, ge=1, description="uploaded campaigns kept at once")
    keep_days: float = Field(30.0, gt=0, description="results and campaigns are deleted after this")
    cors_origins: tuple[str, ...] = Field(
        (), description="origins whose pages may call the service; none: closed"
    )

    @classmethod
    def read(cls, given: Mapping[str, Any] | None = None) -> "Settings":
        """Settings of the environment, with those given over them. Raises DldsimError."""
        values: dict[str, Any] = {}
        for key in cls.model_fields:
            text = os.environ.get(PREFIX + key.upper())
            if text:
                values[key] = text.split(",") if key == "cors_origins" else text
        values |= {key: value for key, value in (given or {}).items() if value is not None}
        return validate(cls, values)

    def campaign(self) -> tuple[Device, float, Verification]:
        """Device, safety distance and verification budget, found as the commands find them."""
        path = self.config or Path("config.yaml")
        if self.config is None and not path.exists():
            return Device(), Sweep.model_fields["safety_distance_um"].default, Verification()
        config = read_partial(path)
        limits.enforce(config.limits)
        safety = config.sweep.safety_distance_um if config.sweep else (
            Sweep.model_fields["safety_distance_um"].default)
        return config.device, safety, config.verification
