"""Questions that are answered at once: prediction, stiffness, model, tables, health."""

import math
import time

from fastapi import APIRouter, Response

from dldsim import PHYSICS_VERSION, __version__
from dldsim.analysis.calibration import default_curves, stiffness_for
from dldsim.app.web.api import answers, field_limits, specs
from dldsim.app.web.api.data import Source, columns_of, table_rows
from dldsim.app.web.api.problems import PREFIX, infeasible, problems
from dldsim.app.web.api.service import CampaignQuery, Service, calibration_of
from dldsim.design.populations import flow_of, make_population
from dldsim.design.task import angle_interval, check_cell
from dldsim.errors import DldsimError
from dldsim.experiments.migration import mode_of
from dldsim.vocabulary import GEOMETRY

OUTSIDE = (
    "This array or cell lies outside what was simulated: the prediction is extrapolated and "
    "its interval is the whole range that is possible."
)


def make_router(service: Service) -> APIRouter:
    """Addresses of questions."""
    routes = APIRouter(prefix=PREFIX)

    @routes.post(
        "/predict",
        response_model=answers.Prediction,
        responses=problems(404, 409),
        tags=["questions"],
    )
    def predict(spec: specs.PredictSpec) -> answers.Prediction:
        """The angle of one cell type in one array, and what acts on the cell."""
        source = service.source(spec.campaign)
        known, model = source.known, source.known.model
        place = (spec.pillar_radius_um, spec.gap_um, spec.periodicity)
        try:
            cell = make_population(
                1,
                "prediction",
                spec.asked,
                flow_of(spec, known.chip.flow),
                known.sets,
                known.calibration,
                model.domains,
                spec.assay,
            )
            check_cell("prediction", cell, model)
        except DldsimError as error:
            raise infeasible(spec, error) from error
        angle = float(model.predict(*place, cell.cell)[0])
        low, high = (float(v[0]) for v in angle_interval(model, cell, *place, spec.level))
        sigma = model.sigma_num_deg(angle, spec.periodicity)
        inside = bool(model.inside_domain(*place, cell.cell)[0])
        outside = model.distance_outside(*place, cell.cell)[0]
        warnings = list(source.provenance.warnings)
        if not inside:
            warnings.append(OUTSIDE)
        if spec.gap_um < cell.width_um:
            warnings.append(
                f"The cell does not pass: it needs a gap of {cell.width_um:.3g} µm "
                f"({cell.width_basis})."
            )
        safety = known.chip.safety_distance_um
        if spec.gap_um <= spec.pillar_radius_um + safety:
            warnings.append(
                "gap_um does not exceed pillar_radius_um by the safety distance of "
                f"{safety:g} µm: a search would not propose this array."
            )
        return answers.Prediction(
            angle_deg=angle,
            low_deg=low,
            high_deg=high,
            level=spec.level,
            mode=mode_of(angle, 1 / spec.periodicity),
            bump_angle_deg=math.degrees(math.atan(1 / spec.periodicity)),
            sigma_num_deg=None if sigma is None else float(sigma[0]),
            inside_domain=inside,
            distance_outside=answers.finite(float(outside)),
            cell=cell.row("prediction") | {"told_apart": None, "doubt": ""},
            warnings=warnings,
            provenance=source.provenance,
        )

    @routes.post(
        "/stiffness",
        response_model=answers.StiffnessAnswer,
        responses=problems(404, 409),
        tags=["questions"],
    )
    def stiffness(spec: specs.StiffnessSpec) -> answers.StiffnessAnswer:
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
            raise infeasible(spec, error) from error
        return answers.StiffnessAnswer(
            **found,
            deformation_index=spec.deformation_index,
            error=spec.error,
            provenance=source.provenance,
        )

    @routes.get(
        "/model", response_model=answers.ModelInfo, responses=problems(404, 409), tags=["questions"]
    )
    def model(campaign: CampaignQuery = None) -> answers.ModelInfo:
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
                answers.CalibratedSet(**row)
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
        return answers.ModelInfo(
            card=answers.finite({k: v for k, v in card.items() if k != "domain"}),
            deformation_index_range=ranges.get(own_assay, (0.0, 1.0)),
            domain=answers.finite(
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
            fields=field_limits.limits_of(specs.DesignSpec),
            limits=limits,
            provenance=source.provenance,
        )

    def table(kind: str, source: Source) -> answers.Table:
        frame = calibration_of(source) if kind == "calibration" else source.known.tables[kind]
        return answers.Table(
            kind=kind,
            columns=columns_of(kind),
            rows=table_rows(kind, frame),
            provenance=source.provenance,
        )

    @routes.get(
        "/campaign/outcomes",
        response_model=answers.Table,
        responses=problems(404, 409),
        tags=["campaign"],
    )
    def outcomes(campaign: CampaignQuery = None) -> answers.Table:
        """The outcomes learnt from, and measurements."""
        return table("outcomes", service.source(campaign))

    @routes.get(
        "/campaign/calibration",
        response_model=answers.Table,
        responses=problems(404, 409),
        tags=["campaign"],
    )
    def calibration(campaign: CampaignQuery = None) -> answers.Table:
        """Index of each membrane in each assay."""
        return table("calibration", service.source(campaign))

    @routes.get(
        "/health",
        response_model=answers.Health,
        responses={503: {"model": answers.Health}},
        tags=["service"],
    )
    def health(response: Response) -> answers.Health:
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
        return answers.Health(
            status="unhealthy" if problems else "healthy",
            problems=problems,
            campaign=name,
            version=f"dldsim {__version__}, physics version {PHYSICS_VERSION}",
            workers=service.pool.alive(),
            uptime_s=time.time() - service.started,
            queued=sum(n for s, n in states if s in ("queued", "waiting")),
            running=sum(n for s, n in states if s == "running"),
        )

    return routes
