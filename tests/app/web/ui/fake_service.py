"""A service that answers like /api/v1 from memory, to test the page without processes."""

import io
import json
import uuid
from math import atan, degrees

import httpx
import pandas as pd

from dldsim.app.web.api import answers, field_limits, outcome_specs, specs
from tests.app.web.ui.made_answers import ABOUT, ARRAYS, HIGH, LOW, angle, outcome, result, row

ID = "11111111-2222-3333-4444-555555555555"
CHECK = "66666666-7777-8888-9999-000000000000"
PREFIX = "/api/v1"
SHAPES = ("biconcave", "sphere")


class Fake:
    """State of the service: designs by id, what is to go wrong, and all requests so far."""

    def __init__(self):
        self.designs: dict[str, answers.DesignStatus] = {}
        self.campaigns: dict[str, answers.CampaignStatus] = {}
        self.checks: dict[str, answers.CheckStatus] = {}
        self.asked: list[httpx.Request] = []
        self.refuse: dict[str, tuple[int, answers.Problem]] = {}
        self.down = False

    def __call__(self, request: httpx.Request) -> httpx.Response:
        self.asked.append(request)
        if self.down:
            raise httpx.ConnectError("refused", request=request)
        path = request.url.path.removeprefix(PREFIX)
        key = f"{request.method} /{path.split('/')[1]}"
        if key in self.refuse:
            status, problem = self.refuse[key]
            return httpx.Response(status, text=problem.model_dump_json())
        return getattr(self, key.lower().replace(" /", "_"))(request, path.split("/")[2:])

    @staticmethod
    def answer(found, status: int = 200) -> httpx.Response:
        return httpx.Response(status, text=found.model_dump_json())

    def get_health(self, *_) -> httpx.Response:
        return self.answer(
            answers.Health(
                status="healthy",
                problems=[],
                version="0",
                campaign="c",
                workers={"search": 1},
                queued=0,
                running=0,
                uptime_s=1.0,
            )
        )

    def get_model(self, request, _) -> httpx.Response:
        about = ABOUT.model_copy(update={"campaign": request.url.params.get("campaign")})
        geometries = [[r / 7.5, g / 7.5, n] for r, g, n in ARRAYS]
        return self.answer(
            answers.ModelInfo(
                card={},
                deformation_index_range=(LOW, HIGH),
                domain={
                    "shapes": {shape: {"geometries": geometries} for shape in SHAPES},
                    "geometries": geometries,
                    "ranges": {},
                    "arrays": ARRAYS,
                },
                calibrated_range={"group-velocity": (LOW, HIGH)},
                stiffness_sets=[
                    answers.CalibratedSet(
                        stiffness_set=str(k), deformation_index=i, deformation_index_std=0.003
                    )
                    for k, i in enumerate((LOW, 0.71, HIGH), start=1)
                ],
                flow={"height_um": 20.0, "mean_velocity_mm_s": 0.5},
                cell={"radius_um": 7.5},
                device={},
                safety_distance_um=2.0,
                fields=field_limits.limits_of(specs.DesignSpec),
                limits={"trials_max": 500, "upload_max_bytes": 4_000_000},
                provenance=about,
            )
        )

    def post_designs(self, request, _) -> httpx.Response:
        spec = specs.DesignSpec(**json.loads(request.content))
        identifier = str(uuid.uuid4()) if ID in self.designs else ID
        self.designs[identifier] = self.status(identifier, spec, "running")
        return self.answer(
            answers.Accepted(id=identifier, state="queued", url="", queue_position=0), 202
        )

    def status(self, identifier: str, spec: specs.DesignSpec, state: str) -> answers.DesignStatus:
        best = answers.Best(
            trial=3,
            pillar_radius_um=5.0,
            gap_um=13.0,
            periodicity=6,
            value=1.0,
            separation_deg=1.5,
            angle_1_deg=4.0,
            angle_2_deg=2.5,
            inside_training_domain=True,
        )
        done = state == "done"
        return answers.DesignStatus(
            id=identifier,
            state=state,
            created="2026-01-01T00:00:00Z",
            spec=spec,
            attempts=1,
            progress=answers.Progress(
                stage="search",
                trial=40,
                trials=spec.trials,
                best=best,
                convergence=[None, 0.5, 1.0],
                elapsed_s=3.0,
                left_s=5.0,
            ),
            error="no memory" if state == "failed" else None,
            result=result(spec) if done else None,
            provenance=ABOUT if done else None,
            verification=answers.Verdict(state="not-wanted"),
            files=[
                answers.FileInfo(
                    kind=k,
                    name=f"request-1.{k}",
                    candidate=1,
                    verified=None,
                    bytes=1000,
                    sha256="c" * 64,
                    url=f"{PREFIX}/designs/{identifier}/files/{k}?candidate=1",
                )
                for k in ("json", "csv", "gds", "dxf")
            ]
            if done
            else [],
        )

    def finish(self, identifier: str = ID, state: str = "done") -> None:
        self.designs[identifier] = self.status(identifier, self.designs[identifier].spec, state)

    def get_designs(self, _, rest) -> httpx.Response:
        if rest[0] not in self.designs:
            return self.answer(answers.Problem(error="not-found", message="there is none"), 404)
        if len(rest) > 1:
            return httpx.Response(200, content=b"file " + rest[2].encode())
        return self.answer(self.designs[rest[0]])

    def delete_designs(self, _, rest) -> httpx.Response:
        self.finish(rest[0], "cancelled")
        return self.answer(self.designs[rest[0]])

    def get_campaign(self, _, rest) -> httpx.Response:
        if rest[0] == "outcomes":
            rows = [
                row(
                    "outcomes",
                    outcome_id=f"outcome-{k}",
                    pillar_radius_um=r,
                    gap_um=g,
                    periodicity=n,
                    stiffness_set=str(1 + k % 3),
                    deformation_index=LOW,
                    mode=("bump", "mixed", "zigzag", "none")[k % 4],
                    migration_angle_deg=None if k % 4 == 3 else angle(r, g, n, LOW),
                    bump_angle_deg=degrees(atan(1 / n)),
                    status="decided" if k % 2 else "undecided",
                    sigma_num_deg=0.1,
                )
                for k, (r, g, n) in enumerate(ARRAYS)
            ]
        else:
            rows = [
                row(
                    "calibration",
                    assay="group-velocity",
                    group=f"G{k}",
                    ks_uN_per_m=5.0 * k,
                    stiffness_set=str(k),
                    deformation_index=LOW + 0.02 * k,
                    deformation_index_std=0.005,
                )
                for k in (1, 2, 3)
            ]
        return self.answer(
            answers.Table(
                kind=rest[0], columns=[], provenance=ABOUT, rows=[r.model_dump() for r in rows]
            )
        )

    def post_stiffness(self, request, _) -> httpx.Response:
        given = json.loads(request.content)
        names = [
            f"{m}{e}"
            for m in ("ks_uN_per_m", "kal_uN_per_m", "kb_pN_um")
            for e in ("", "_low", "_high")
        ]
        return self.answer(
            answers.StiffnessAnswer(
                **dict.fromkeys(names, 7.0),
                deformation_index=given["deformation_index"],
                error=given["error"],
                velocity_mm_s=1.0,
                shear_stress_Pa=None,
                between=["G1", "G2"],
                assay=given["assay"],
                index="(a − b)/(a + b)",
                label=None,
                cell_shape="biconcave",
                cell_radius_um=7.5,
                truncated=True,
                provenance=ABOUT,
            )
        )

    def post_outcome(self, request, _) -> httpx.Response:
        spec = outcome_specs.OutcomeSpec(**json.loads(request.content))
        return self.answer(answers.OutcomeAnswer(**outcome(spec)))

    def post_checks(self, request, _) -> httpx.Response:
        spec = outcome_specs.CheckSpec(**json.loads(request.content))
        self.checks[CHECK] = answers.CheckStatus(
            id=CHECK,
            state="running",
            created="",
            spec=spec,
            message="cell 1 of 4",
            elapsed_s=30.0,
            attempts=2,
        )
        return self.answer(self.checks[CHECK], 202)

    def finish_check(self, **change) -> None:
        """The check with what it found: cells of type 1 as predicted, of type 2 not."""
        status = self.checks[CHECK]
        rows = [
            row(
                "device_checks",
                population=p,
                simulated=2,
                own=3 - p,
                predicted=0.9,
                predicted_low=0.8,
                predicted_high=1.0,
                recovery=(3 - p) / 2,
                agrees=p == 1,
            )
            for p in (1, 2)
        ]
        cells = [
            row("checked_cells", cell=k, population=p, exit_um=y)
            for k, (p, y) in enumerate(((1, 480.0), (1, 490.0), (2, 485.0), (2, None)), start=1)
        ]
        result = answers.CheckAnswer(
            **outcome(status.spec), device_checks=rows, checked_cells=cells
        )
        done = {"state": "done", "result": result}
        self.checks[CHECK] = status.model_copy(update=done | change)

    def get_checks(self, _, rest) -> httpx.Response:
        if rest[0] not in self.checks:
            return self.answer(answers.Problem(error="not-found", message="there is none"), 404)
        return self.answer(self.checks[rest[0]])

    def delete_checks(self, _, rest) -> httpx.Response:
        found = self.checks[rest[0]].model_copy(update={"state": "cancelled"})
        self.checks[rest[0]] = found
        return self.answer(found)

    def post_predict(self, request, _) -> httpx.Response:
        given = json.loads(request.content)
        return self.answer(
            answers.Prediction(
                angle_deg=4.0,
                low_deg=3.0,
                high_deg=5.0,
                level=given["level"],
                mode="mixed",
                bump_angle_deg=7.0,
                sigma_num_deg=None,
                inside_domain=False,
                distance_outside=0.2,
                warnings=["extrapolated"],
                provenance=ABOUT,
            )
        )

    def _campaign(self, name: str, origin: str, rows: int) -> httpx.Response:
        found = answers.CampaignStatus(
            id=str(uuid.uuid4()),
            state="ready",
            name=name,
            origin=origin,
            created="",
            rows=rows,
            provenance=ABOUT,
            url="",
        )
        self.campaigns[found.id] = found
        return self.answer(found, 202)

    def post_measurements(self, request, _) -> httpx.Response:
        spec = specs.MeasurementsSpec(**json.loads(request.content))
        return self._campaign(spec.name, "measurements", 27 + len(spec.measurements))

    def post_campaigns(self, request, _) -> httpx.Response:
        text = request.content.split(b"\r\n\r\n")[-1].split(b"\r\n--")[0]
        return self._campaign("mine", "uploaded", len(pd.read_csv(io.BytesIO(text))))

    def get_campaigns(self, _, rest) -> httpx.Response:
        return self.answer(self.campaigns[rest[0]])

    def delete_campaigns(self, _, rest) -> httpx.Response:
        del self.campaigns[rest[0]]
        return httpx.Response(204)
