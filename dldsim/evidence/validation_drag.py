"""Validation case of a sphere's drag and lag; see :mod:`dldsim.evidence.validation`."""

from collections.abc import Iterator

from dldsim.evidence.drag import lag_under_traction
from dldsim.evidence.validation import Comparison
from dldsim.solver.time_loop import MEMBRANE_SLIP

DRAG_RADII = 3, 4, 6, 9
SIZE_MARK = 0.05
"""Nodes by which a sphere may act larger or smaller: 1 % of a radius of five nodes, half of what
the critical diameter is bisected to."""
OFFSETS = (0.5, 0.5, 0.5), (0.25, 0.0, 0.0), (0.1, 0.3, 0.2)
PUSHED = "radius of the sphere"


def hydrodynamic_radius() -> Iterator[Comparison]:
    """Radius of the solid sphere that moves as fast as a sphere of vertices under uniform traction.

    Mark: a twentieth of a node, at any radius, relaxation time, place of the centre, mesh and
    kernel. Without mark: what the velocities of the vertices lack without the slip that offsets it,
    along the membrane and across it, over t/ν with t the traction, beside `MEMBRANE_SLIP`.
    """
    cases = [("default", radius, {}) for radius in DRAG_RADII]
    cases += [(f"τ = {tau:g}", 6, {"relaxation_time": tau}) for tau in (0.8, 1.25)]
    cases += [
        ("centre at " + " ".join(f"{o:g}" for o in offset), 6, {"offset": offset})
        for offset in OFFSETS
    ]
    cases += [(f"edge / spacing {edge:g}", 6, {"edge_to_spacing": edge}) for edge in (0.7, 1.4)]
    cases += [
        (f"{kernel} kernel", 6, {"kernel": kernel}) for kernel in ("linear", "3-point", "4-point")
    ]
    for variant, radius, settings in cases:
        lag = lag_under_traction(radius, **settings)
        about = {"variant": variant, "resolution": radius, "resolution_of": PUSHED}
        yield Comparison(
            "hydrodynamic radius",
            lag.radius,
            radius,
            SIZE_MARK / radius,
            "spacing",
            note=f"{lag.radius - radius:+.3f} nodes",
            **about,
        )
        slips = MEMBRANE_SLIP[settings.get("kernel", "compact")]
        for part, value, slip in zip(("along", "across"), lag[1:3], slips, strict=True):
            yield Comparison(f"lag {part} the membrane", value, slip, unit="t/ν", **about)
