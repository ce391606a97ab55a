"""Made-up answers of the service, to test the page.

The angles are a smooth formula, not a surrogate: nothing here is a prediction.
"""

from math import atan, degrees

from dldsim.app.web.api import answers, outcome_specs, specs

LOW, HIGH = 0.68, 0.74
ABOUT = answers.Provenance(
    dldsim_version="0",
    physics_version=0,
    campaign=None,
    campaign_name="a *made up* campaign",
    origin="tracked",
    outcomes=27,
    used=26,
    holds_for="biconcave discs of the radii named, channel height 20 µm",
    geometries=27,
    outcomes_sha256="a" * 64,
    model_sha256="b" * 64,
    fitted_by={"xgboost": "3"},
    scores_by_geometry={
        "rmse_deg": 1.0,
        "median_absolute_error_deg": 0.2,
        "r2": 0.9,
        "predictions": 26,
    },
    warnings=["1 run had not settled"],
)
ARRAYS = [[r, g, n] for r in (5.0, 7.0, 9.0) for g in (12.0, 16.0, 20.0) for n in (4, 8, 12)]


def angle(radius: float, gap: float, rows: int, index: float) -> float:
    share = min(max(1.8 - gap / 15 - 4 * (index - LOW) + radius / 100, 0.0), 1.0)
    return degrees(atan(share / rows))


def row(kind: str, **given):
    """A row of a table: what is given, and something of the right type for the rest."""
    found = {}
    for name, field in answers.row_model(kind).model_fields.items():
        text = str(field.annotation)
        found[name] = given.get(
            name,
            None
            if "None" in text
            else "x"
            if "str" in text
            else True
            if "bool" in text
            else []
            if "list" in text
            else 1,
        )
    return answers.row_model(kind)(**found)


def at_outlets(devices: list[str]) -> dict:
    """What leaves some devices: a cell type above and one below a wall at 500 µm."""
    return {
        "device_outcomes": [
            row(
                "device_outcomes",
                device=d,
                population=p,
                outlet=("lower", "upper")[p - 1],
                purity=0.9,
                purity_low=0.8,
                purity_high=0.95,
                recovery=0.97,
                recovery_low=0.9,
                recovery_high=0.99,
                cut_um=500.0,
                purity_recovery=0.81,
            )
            for d in devices
            for p in (1, 2)
        ],
        "device_outlets": [
            row("device_outlets", device=d, outlet=k + 1, low_um=500.0 * k, high_um=1e3)
            for d in devices
            for k in (0, 1)
        ],
        "device_positions": [
            row(
                "device_positions",
                device=d,
                population=p,
                x_mm=x,
                **{
                    f"y_{q}_um": 400.0 + x * p * 40 + float(q)
                    for q in ("05", "25", "50", "75", "95")
                },
            )
            for d in devices
            for p in (1, 2)
            for x in (0.0, 2.5, 5.0)
        ],
        "device_exits": [
            row("device_exits", device=d, population=p, low_um=y, high_um=y + 20.0, cells=0.5)
            for d in devices
            for p in (1, 2)
            for y in (480.0, 520.0)
        ],
        "notes": ["transients as *outcomes* have them"],
    }


def outcome(spec: outcome_specs.CellsInDevice) -> dict:
    """What comes out of the devices of a request."""
    names = ["array", "second array"][: len(spec.devices)]
    return at_outlets(names) | {
        "request": spec.request.model_dump(mode="json"),
        "device": spec.device,
        "populations": [],
        "doubt": "The assay does not tell the two cell types apart.",
        "warnings": [],
        "provenance": ABOUT,
    }


def result(spec: specs.DesignSpec) -> answers.DesignResult:
    index = [spec.deformation_index_1 or LOW, spec.deformation_index_2 or HIGH]
    trials, best, course = [], None, []
    for t in range(spec.trials):
        at = {
            "pillar_radius_um": 4 + t * 0.71 % 6,
            "gap_um": 12 + t * 1.37 % 9,
            "periodicity": 4 + t % 7,
        }
        one, two = (angle(*at.values(), i) for i in index)
        good = at["gap_um"] > at["pillar_radius_um"] + 2
        value = abs(two - one) - 0.3 if good else None
        best = max(v for v in (best, value, -9.0) if v is not None)
        course.append(best)
        trials.append(
            row(
                "design_trials",
                trial=t,
                **at,
                angle_1_deg=one,
                angle_2_deg=two,
                separation_deg=abs(two - one),
                value=value,
                feasible=good,
                reason="",
            )
        )
    ranked = sorted((t for t in trials if t.feasible), key=lambda t: -t.value)[: spec.candidates]
    place = ("pillar_radius_um", "gap_um", "periodicity")
    designs = [
        row(
            "designs",
            design=k,
            rank=k,
            **{n: getattr(t, n) for n in place},
            angle_1_deg=t.angle_1_deg,
            angle_2_deg=t.angle_2_deg,
            mode_1="bump",
            mode_2="zigzag",
            separation_deg=t.separation_deg,
            uncertainty_deg=0.5,
            value=t.value,
            objective=spec.objective,
            verdict="resolved",
            notes=["one of 2 not ranked against each other: closer than σ_num"],
            mode_change_probability=0.25,
            inside_training_domain=k > 1,
            angle_1_low_deg=t.angle_1_deg - 1,
            angle_1_high_deg=t.angle_1_deg + 1,
            angle_2_low_deg=t.angle_2_deg - 1,
            angle_2_high_deg=t.angle_2_deg + 1,
        )
        for k, t in enumerate(ranked, start=1)
    ]
    axes = {
        "pillar_radius_um": [4.0, 6.0, 8.0],
        "gap_um": [10.0, 14.0, 18.0],
        "periodicity": [4.0, 5.0, 6.0],
    }
    slices = []
    for x, y in (
        ("pillar_radius_um", "gap_um"),
        ("periodicity", "gap_um"),
        ("periodicity", "pillar_radius_um"),
    ):
        slices += [
            row(
                "design_slices",
                x_parameter=x,
                y_parameter=y,
                x=a,
                y=b,
                difference_deg=a - b / 2,
                feasible=b > 10,
                inside_training_domain=a > 4,
            )
            for a in axes[x]
            for b in axes[y]
        ]
    return answers.DesignResult(
        request=spec.model_dump(mode="json")
        | {
            "deformation_index_1": index[0],
            "deformation_index_2": index[1],
            "deformation_index_std_1": 0.0,
            "deformation_index_std_2": 0.01,
        },
        designs=designs,
        trials=trials,
        convergence=course,
        slices=slices,
        tolerances=[
            row(
                "design_tolerances",
                design=d.design,
                parameter=p,
                offset=o,
                separation_deg=d.separation_deg + o,
                mode_1="bump",
                mode_2="zigzag",
            )
            for d in designs
            for p in ("gap_um", "edge_um", "ks_1_uN_per_m", "ks_2_uN_per_m")
            for o in (-0.5, 0.5)
        ],
        importance=[
            row("design_importance", parameter=p, importance=v, evaluator="made-up")
            for p, v in zip(axes, (0.5, 0.3, 0.2), strict=True)
        ],
        at_outlets=answers.AtOutlets(
            **at_outlets([f"{spec.name}-candidate-{d.design}" for d in designs])
        ),
        warnings=["The best candidate is extrapolated."],
        seconds={"load": 0.1, "search": 2.0, "files": 1.0},
    )


def problem(kind: str, message: str, field: str = "", **more) -> answers.Problem:
    """What a service refuses with."""
    fields = [answers.FieldProblem(field=field, value="", message=message)] if field else []
    return answers.Problem(error=kind, message=message, fields=fields, **more)
