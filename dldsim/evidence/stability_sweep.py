"""Which scenes the explicit step carries, beside what `time_step` predicts of them.

A point is a short run of one cell through a small array, with one thing driven to an extreme. Each
runs with the time step chosen automatically, and, where that is shorter than the step given, with
the step given as well, to see whether the refusal was right.
"""

import difflib
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from dldsim.config.configuration import Config
from dldsim.config.explain import validate
from dldsim.config.sections import Cell, Flow, Geometry, Numerics, RunControl, Stiffness
from dldsim.errors import DldsimError

GEOMETRY = {"pillar_radius_um": 5.0, "gap_um": 12.0, "periodicity": 4}
ROWS = 3
"""Rows of a point; stiffness shows within hundreds of steps, leakage and drift within a row."""
ROWS_IF_STIFF = 2
"""From a stiffness multiplier of 100 on."""
RAN = "ran"


class Point(NamedTuple):
    """One scene: what is changed in each section of the configuration, from ``set``'s membrane."""

    label: str
    value: float
    changes: dict[str, dict[str, Any]]
    set: str
    rows: int = ROWS


class Family(NamedTuple):
    """Points that differ in one parameter; ``points`` makes them from the configuration."""

    title: str
    parameter: str
    points: Callable[[Config], list[Point]]


def _stiffness_family(multiplier: int) -> Family:
    def points(config: Config) -> list[Point]:
        rows = ROWS_IF_STIFF if multiplier >= 100 else ROWS
        return [
            Point(name, multiplier, {"stiffness": _scaled(membrane, multiplier)}, name, rows)
            for name, membrane in membranes(config).items()
        ]

    return Family(f"Stiffness × {multiplier}", "multiplier of k_s, k_b, k_α", points)


def _scaled(membrane: Stiffness, multiplier: float) -> dict[str, float]:
    keys = "ks_uN_per_m", "kb_pN_um", "kal_uN_per_m"
    return {key: multiplier * getattr(membrane, key) for key in keys}


def _along(
    title: str,
    parameter: str,
    section: str,
    key: str,
    values: Iterable,
    stiffest: bool = True,
    **others: dict,
) -> Family:
    """One key of one section through values; ``others``: changes common to all points."""
    values = list(values)

    def points(config: Config) -> list[Point]:
        names = list(config.stiffness_sets)
        name = names[-1] if stiffest else names[0]
        result = []
        for value in values:
            changes = {k: dict(v) for k, v in others.items()}
            changes.setdefault(section, {})[key] = value
            result.append(Point(f"{value:g}", value, changes, name))
        return result

    return Family(title, parameter, points)


def _pressed_spheres() -> Family:
    """Stiff spheres that bump along the pillars."""

    def points(config: Config) -> list[Point]:
        name, membrane = list(config.stiffness_sets.items())[-1]
        changes = {
            "geometry": {"periodicity": 12},
            "flow": TALL,
            "cell": {"shape": "sphere", "radius_um": 5.0, "release_gap_fraction": 0.45},
        }
        return [
            Point(
                f"{m}",
                m,
                changes
                | {"stiffness": _scaled(membrane, m) | {"kag_uN_per_m": m * membrane.kag_uN_per_m}},
                name,
                rows=6,
            )
            for m in (1, 3, 10, 30)
        ]

    return Family("Stiff spheres pressed against pillars", "multiplier of all moduli", points)


TALL = {"height_um": 40.0}
FAMILIES: dict[str, Family] = {
    **{f"stiffness-{m}": _stiffness_family(m) for m in (1, 10, 100, 1000)},
    "bending": _along(
        "Bending", "k_b [pN·µm]", "stiffness", "kb_pN_um", (0, 0.043, 0.43, 4.3, 43, 430), False
    ),
    "membrane-viscosity": _along(
        "Membrane viscosity",
        "k_visc [nN·s/m]",
        "stiffness",
        "kvisc_nN_s_per_m",
        (0, 1.5, 15, 150, 1500),
    ),
    "area": _along("Total area", "k_ag [µN/m]", "stiffness", "kag_uN_per_m", (0, 500, 5e3, 5e4)),
    "volume": _along("Volume", "k_v [Pa]", "stiffness", "kv_Pa", (0, 900, 9e4, 9e6)),
    "friction": _along(
        "Friction, dissipative coupling",
        "γ [nN·s/m]",
        "numerics",
        "friction_nN_s_per_m",
        (0.05, 0.2, 0.66, 1.56, 5, 20),
        numerics={"coupling": "dissipative"},
    ),
    "time-step": _along(
        "Time step",
        "mean velocity [lattice units]",
        "numerics",
        "velocity_lu",
        (0.003, 0.0125, 0.025, 0.05, 0.1),
    ),
    "relaxation-time": _along(
        "Relaxation time",
        "τ",
        "numerics",
        "relaxation_time",
        (0.505, 0.52, 0.55, 0.65, 0.8, 1.25, 2, 3),
    ),
    "mesh-ratio": _along(
        "Mesh to lattice",
        "edge / lattice spacing",
        "numerics",
        "edge_to_spacing",
        (0.3, 0.4, 0.6, 0.8, 1, 1.4, 2),
    ),
    "velocity": _along(
        "Capillary number by way of the velocity",
        "mean velocity [mm/s]",
        "flow",
        "mean_velocity_mm_s",
        (0.005, 0.05, 0.5, 5, 50),
        False,
    ),
    "gap": _along("Gap", "P_g [µm]", "geometry", "gap_um", (4, 5, 6, 7, 8, 10, 12, 16, 24)),
    "periodicity": _along(
        "Periodicity", "N_p", "geometry", "periodicity", (2, 3, 4, 8, 12, 16, 20)
    ),
    "pillar-radius": _along(
        "Pillar radius", "P_r [µm]", "geometry", "pillar_radius_um", (1, 2, 4, 12, 20, 30)
    ),
    "release": _along(
        "Release: 0 and 1 touch a pillar",
        "height in the gap / P_g",
        "cell",
        "release_gap_fraction",
        (0, 0.1, 0.25, 0.5, 0.75, 1),
    ),
    "cell-radius": _along(
        "Cell against a gap of 12 µm, upright",
        "cell radius [µm]",
        "cell",
        "radius_um",
        (3, 5, 7.5, 10, 12, 15),
        flow=TALL,
    ),
    "sphere": _along(
        "Sphere against a gap of 12 µm",
        "sphere radius [µm]",
        "cell",
        "radius_um",
        (3, 5, 5.5, 6, 7),
        flow=TALL,
        cell={"shape": "sphere"},
    ),
    "pressed-sphere": _pressed_spheres(),
}


def membranes(config: Config) -> dict[str, Stiffness]:
    """The stiffness sets, and the membranes of the constriction groups that are not one of them."""
    sets = {f"set {name}": value for name, value in config.stiffness_sets.items()}
    groups = {name: group.stiffness for name, group in config.constriction_groups.items()}
    return sets | {name: value for name, value in groups.items() if value not in sets.values()}


def check_families(names: Iterable[str]) -> list[str]:
    """The names, all families if there are none. Raises DldsimError for an unknown one."""
    names = list(names) or list(FAMILIES)
    for name in names:
        if name not in FAMILIES:
            close = difflib.get_close_matches(name, FAMILIES, n=1)
            hint = f" Did you mean {close[0]}?" if close else ""
            raise DldsimError(
                f"Stability family {name!r} is unknown.{hint} Known: {', '.join(FAMILIES)}.",
                key="family",
                value=name,
                allowed=", ".join(FAMILIES),
            )
    return names


def sections_of(point: Point, config: Config) -> dict[str, Any]:
    """The validated sections of one point. Raises DldsimError for a value outside its range."""
    membrane = (membranes(config) | config.stiffness_sets)[point.set]
    base = {
        "geometry": (Geometry, GEOMETRY),
        "stiffness": (Stiffness, membrane.model_dump()),
        "cell": (Cell, config.cell.model_dump()),
        "flow": (Flow, config.flow.model_dump()),
        "numerics": (Numerics, config.numerics.model_dump()),
    }
    return {
        name: validate(model, values | point.changes.get(name, {}))
        for name, (model, values) in base.items()
    }


def run_family(
    name: str, config: Config, progress: Callable[[str], None] | None = None
) -> list[dict]:
    """Rows of `stability` of one family."""
    family = FAMILIES[name]
    rows = []
    for point in family.points(config):
        about = {
            "family": name,
            "title": family.title,
            "parameter_of": family.parameter,
            "label": point.label,
            "parameter": float(point.value),
            "stiffness_set": point.set,
        }
        automatic = _attempt(point, config, "automatic")
        rows.append(about | automatic)
        if automatic["refinement"] and automatic["refinement"] > 1:
            rows.append(about | _attempt(point, config, "as-given"))
        if progress:
            said = ", ".join(
                f"{r['time_step']}: {r['outcome']}" for r in rows[-2:] if r["label"] == point.label
            )
            progress(f"{name} {point.label}: {said}")
    return rows


MARGINS = "elastic", "mass", "lag", "speed"
"""Margins of stability; the fluid's lag behind the cell makes no run unstable."""
ANY_LAG = 1e6
OF_RUN = (
    "steps",
    "wall_time_s",
    "nodes",
    "vertices",
    "mach_max",
    "volume_drift_max",
    "area_drift_max",
    "inverted_faces_max",
    "min_clearance_um",
)
"""Columns that are those of the run by the same name."""


def _attempt(point: Point, config: Config, time_step: str) -> dict:
    from dldsim.experiments.array_run import simulate_run

    blank = [*(f"margin_{m}" for m in MARGINS), "margin", "refinement", *OF_RUN, "predicted_safe"]
    row = {"time_step": time_step, **dict.fromkeys(blank)}
    try:
        sections = sections_of(point, config)
        sections["numerics"] = sections["numerics"].model_copy(
            update={"time_step": time_step, "reynolds_max": ANY_LAG}
        )
        result = simulate_run(
            **sections,
            control=RunControl(max_rows=point.rows),
            run_id=point.label,
            stiffness_set=point.set,
            probe=False,
        ).row
    except DldsimError as error:
        return row | {"outcome": "refused", "reason": str(error)}
    asked = {f"margin_{m}": result[f"margin_{m}"] for m in MARGINS}
    margin = max(asked.values())
    failed = result["status"] in ("unstable", "stuck")
    return (
        row
        | asked
        | {
            "margin": margin,
            "refinement": result["time_step_refinement"],
            "predicted_safe": (time_step == "automatic" or margin <= 1) and not result["incurable"],
            "outcome": result["status"] if failed else RAN,
            "reason": "; ".join([result["stop_reason"]] * failed + result["incurable"]),
            **{key: result[key] for key in OF_RUN},
        }
    )


def verdict(rows: Iterable[dict]) -> dict[str, Any]:
    """Whether the bound is right: what it calls safe must run, what it refuses should not.

    ``broken``: rows predicted safe that blew up; ``least_failing``: smallest margin of a run with
    the step given that blew up; ``largest_running``: largest that did not.
    """
    rows = list(rows)
    given = [r for r in rows if r["time_step"] == "as-given"]
    return {
        "points": len(rows),
        "broken": [r for r in rows if r["predicted_safe"] and r["outcome"] == "unstable"],
        "refused": sum(r["outcome"] == "refused" for r in rows),
        "least_failing": min(
            (r["margin"] for r in given if r["outcome"] == "unstable"), default=None
        ),
        "largest_running": max((r["margin"] for r in given if r["outcome"] == RAN), default=None),
    }
