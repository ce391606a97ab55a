"""Campaigns of users: uploaded tables, and measured angles beside a campaign."""

import json
import uuid
from typing import Annotated

from fastapi import APIRouter, File, Form, Response, UploadFile

from dldsim.app.web.api import answers, specs
from dldsim.app.web.api.data import check_sets, read_upload
from dldsim.app.web.api.problems import PREFIX, Refused, ascii_safe, infeasible, problems
from dldsim.app.web.api.service import Id, Service, iso_time
from dldsim.app.web.api.store import SEARCH, Job
from dldsim.design.measured_devices import MEASURED, with_measurements
from dldsim.errors import DldsimError


def make_router(service: Service) -> APIRouter:
    """Addresses of campaigns."""
    routes = APIRouter(prefix=PREFIX)
    store, settings = service.store, service.settings

    def status(job: Job) -> answers.CampaignStatus:
        states = {"running": "fitting", "done": "ready"}
        stored = store.result(job.id, job.kind)
        return answers.CampaignStatus(
            id=job.id,
            state=states.get(job.state, job.state),
            name=job.spec["name"],
            origin=job.spec["origin"],
            rows=job.spec["rows"],
            found=job.spec.get("found", []),
            created=iso_time(job.created),
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
    ) -> answers.CampaignStatus:
        identifier = str(uuid.uuid4())
        spec = {"name": name, "origin": origin, "rows": rows, "found": list(found)}
        service.add(
            [(identifier, "campaign", SEARCH, "queued", spec)],
            parts=parts,
            kept=settings.campaigns_max,
        )
        return status(find(identifier))

    @routes.post(
        "/campaigns",
        status_code=202,
        response_model=answers.CampaignStatus,
        responses=problems(429),
        tags=["campaign"],
    )
    def upload(
        outcomes: Annotated[UploadFile, File(description="table of outcomes, CSV or Parquet")],
        calibration: Annotated[
            UploadFile | None, File(description="for stiffness sets and verification")
        ] = None,
        flows: Annotated[UploadFile | None, File(description="for pressure drops")] = None,
        name: Annotated[str, Form(max_length=80)] = "uploaded campaign",
    ) -> answers.CampaignStatus:
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
            message = ascii_safe(str(error))
            at_fault = error.key if error.key in given else field
            raise Refused(
                422,
                "invalid",
                message,
                [answers.FieldProblem(field=at_fault, value="", message=message)],
            ) from error
        finally:
            service.uploads.release()
        found = [
            ascii_safe(f"{kind}: {note}")
            for kind, upload in uploads.items()
            for note in upload.found
        ]
        return accept(ascii_safe(name), "uploaded", uploads["outcomes"].rows, parts, found)

    @routes.post(
        "/measurements",
        status_code=202,
        response_model=answers.CampaignStatus,
        responses=problems(404, 409, 429),
        tags=["campaign"],
    )
    def measure(spec: specs.MeasurementsSpec) -> answers.CampaignStatus:
        """Measured angles to be learnt from, beside the outcomes of a campaign."""
        source = service.source(spec.campaign)
        flow = spec.model_dump(include={"height_um", "mean_velocity_mm_s"})
        given = [flow | row for row in spec.model_dump()["measurements"]]
        simulated = source.known.tables["outcomes"]
        simulated = simulated[simulated["status"] != MEASURED]
        calibration = source.known.calibration
        try:
            with_measurements(simulated, given, calibration)
        except DldsimError as error:
            raise infeasible(spec, error) from error
        parts = service.data.snapshot(spec.campaign)
        given = json.loads(parts.get("measurements", b"[]")) + given
        parts["measurements"] = json.dumps(given).encode()
        return accept(ascii_safe(spec.name), "measurements", len(simulated) + len(given), parts)

    @routes.get(
        "/campaigns/{id}",
        response_model=answers.CampaignStatus,
        responses=problems(404),
        tags=["campaign"],
    )
    def look(id: Id) -> answers.CampaignStatus:
        """Whether it can be used, and its card."""
        return status(find(id))

    @routes.delete(
        "/campaigns/{id}",
        status_code=204,
        response_class=Response,
        responses=problems(404),
        tags=["campaign"],
    )
    def delete(id: Id) -> Response:
        """Forget the campaign; designs made from it stay."""
        find(id)
        store.delete_campaign(id)
        return Response(status_code=204)

    return routes
