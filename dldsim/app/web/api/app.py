"""The service: the application of /api/v1, put together from its subjects."""

import sys
from contextlib import asynccontextmanager

from fastapi import FastAPI
from fastapi.middleware.cors import CORSMiddleware
from starlette.concurrency import run_in_threadpool

from dldsim import __version__
from dldsim.app.web.api import campaigns, designs, outcomes, questions
from dldsim.app.web.api.middleware import BodyLimit, Prefix
from dldsim.app.web.api.problems import add_handlers
from dldsim.app.web.api.service import Service
from dldsim.app.web.api.settings import Settings
from dldsim.errors import DldsimError


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
    add_handlers(app)
    for subject in (designs, outcomes, questions, campaigns):
        app.include_router(subject.make_router(service))
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
