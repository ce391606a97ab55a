"""Validation case of spheres between zigzag and bump; see :mod:`dldsim.evidence.validation`."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from dldsim.config.sections import Cell, Flow, Geometry, Numerics, Stiffness
from dldsim.errors import DldsimError
from dldsim.evidence.validation import Comparison
from dldsim.experiments.array_run import Path, row_patience
from dldsim.experiments.array_scene import make_scene
from dldsim.experiments.runner import Stop, advance_until
from dldsim.experiments.shear import inertia_ellipse
from dldsim.experiments.streamlines import critical_follower
from dldsim.laws import SCATTER_OF_DAVIS, SOURCE_OF_DAVIS, critical_diameter
from dldsim.solver.flow import EmptyFlow, array_of, solve_empty_array
from dldsim.solver.observe import Sample
from dldsim.vocabulary import BROKEN

GAP_UM = 20.0
SPHERE_FLOW = Flow(mean_velocity_mm_s=1.0, viscosity_mPa_s=1.0, height_um=GAP_UM)
TRANSITIONS = (5, 25), (5, 40), (10, 40), (10, 60), (16, 48)
"""Periodicity and nodes per pitch, coarse before fine: radii of three and a half to seven nodes."""
SPHERE_CA = 0.01
"""μU/k_s, with k_α = k_s and k_ag = 20 k_s. At N_p 10 and 40 nodes 0.005 and 0.015 gave the same
critical diameter, before the membrane's slip was mended."""
SPHERE_VELOCITY = 0.003
"""Mean velocity in lattice units, within the bound of the time step for such stiff membranes."""
SPHERE_CONTACT = 0.4
"""Reach of the contact in nodes, as in the campaign."""
THIN_CONTACT, THIN_TRANSITIONS = 0.1, ((10, 40), (16, 48))
"""Reach and scenes of the searches that show what the contact's film does."""
FIRST_STEP, LAST_STEP = 0.06, 0.02
"""Of the search, over the gap: outward from the law, then bisection down to this interval."""
BUMPING = 0.97
"""Share of the row shift that a bumping sphere gains, two rows in succession."""
GAP_NODES = "nodes per gap"
SOURCE_OF_FOLLOWER = "streamlines of the same flow at mid-height (dldsim.experiments.streamlines)"


class Passage(NamedTuple):
    """A sphere that has been told to bump or to zigzag.

    ``deformation``: largest Taylor deformation on the way, in the picture plane.
    """

    bumps: bool
    rows: int
    deformation: float
    volume_ratio: float


def rigid_transition() -> Iterator[Comparison]:
    """Diameter at which a stiff sphere goes over from zigzag to bump, beside the empirical law.

    Pillars as wide as the gap, a channel as high, the sphere at half height, released near the bump
    lane. A sphere zigzags once it falls below the level of its pillars, and bumps when it has
    gained a row shift in two rows running (or not fallen in N_p + 2). The diameter is bisected to
    2 % of the gap. The sphere is a membrane with springs and area terms as stiff as the time step
    bears; the Taylor deformation that is left is in the note.

    Mark: 10 %, by which measured devices scatter about the law, on the middle of the interval.
    Without mark: the value extrapolated from two resolutions, by the first order of a sphere that
    the coupling and the film it leaves make larger by a part of a node; and, as a lower bound, the
    critical diameter of a point-like follower of the same flow at mid-height: the law, of finite
    spheres, lies 18 to 32 % above that of the plane, which a channel as high as the gap lowers by
    5 to 12 %; the law lowered by as much, as if it were of deep devices; and the diameter with a
    contact of shorter reach, which is all that differs.
    """
    coarser = {}
    for periodicity, pitch in TRANSITIONS:
        flow = sphere_flow(periodicity, pitch)
        low, high, passages = critical_interval(flow)
        about = {
            "unit": "gap",
            "parameter": periodicity,
            "parameter_of": "periodicity N_p",
            "resolution": pitch / 2,
            "resolution_of": GAP_NODES,
        }
        law = critical_diameter(1, 1 / periodicity)
        worst = max(passages, key=lambda passage: passage.deformation)
        drift = max(abs(passage.volume_ratio - 1) for passage in passages)
        middle = (low + high) / 2
        radius = middle * pitch / 4
        note = (
            f"{len(passages)} spheres, {radius:.1f} nodes in radius, of which half a node is "
            f"{0.5 / radius:.0%}; Taylor deformation up to {worst.deformation:.3f}, volume within "
            f"{drift:.2%}"
        )
        yield Comparison(
            "critical diameter",
            middle,
            law,
            SCATTER_OF_DAVIS,
            source=SOURCE_OF_DAVIS,
            note=note,
            **about,
        )
        follower = critical_follower(flow)
        deep = critical_follower(sphere_flow(periodicity, pitch, height_um=0.0))
        assert follower and deep  # these arrays make followers bump
        yield Comparison(
            "critical diameter beside streamline bound",
            middle,
            follower,
            source=SOURCE_OF_FOLLOWER,
            **about,
        )
        yield Comparison(
            "critical diameter beside the law at this height",
            middle,
            law * follower / deep,
            source=f"{SOURCE_OF_DAVIS}, times what the height changes of the {SOURCE_OF_FOLLOWER}",
            **about,
        )
        yield Comparison("largest diameter that zigzags", low, law, source=SOURCE_OF_DAVIS, **about)
        yield Comparison("smallest diameter that bumps", high, law, source=SOURCE_OF_DAVIS, **about)
        if periodicity in coarser:
            before, coarse = coarser[periodicity]
            value = middle + (middle - before) / (pitch / coarse - 1)
            spread = (high - low) / 2 * (pitch / coarse + 1) / (pitch / coarse - 1)
            yield Comparison(
                "critical diameter",
                value,
                law,
                source=SOURCE_OF_DAVIS,
                **about | {"variant": "extrapolated", "resolution": None, "resolution_of": ""},
                note=f"from {coarse} and {pitch} nodes per pitch; ±{spread:.3f} from the bisection",
            )
        coarser[periodicity] = middle, pitch
    for periodicity, pitch in THIN_TRANSITIONS:
        low, high, passages = critical_interval(sphere_flow(periodicity, pitch, THIN_CONTACT))
        yield Comparison(
            f"critical diameter, contact of {THIN_CONTACT:g} nodes",
            (low + high) / 2,
            critical_diameter(1, 1 / periodicity),
            source=SOURCE_OF_DAVIS,
            unit="gap",
            parameter=periodicity,
            parameter_of="periodicity N_p",
            resolution=pitch / 2,
            resolution_of=GAP_NODES,
            note=f"{len(passages)} spheres; otherwise the contact reaches {SPHERE_CONTACT:g} nodes",
        )


def sphere_flow(
    periodicity: int, pitch: int, contact: float = SPHERE_CONTACT, height_um: float = GAP_UM
) -> EmptyFlow:
    """Flow through the empty array, ``pitch`` and reach of the contact in nodes."""
    geometry = Geometry(pillar_radius_um=GAP_UM / 2, gap_um=GAP_UM, periodicity=periodicity)
    spacing = geometry.pitch_um / pitch
    numerics = Numerics(
        spacing_um=spacing, velocity_lu=SPHERE_VELOCITY, contact_range_um=contact * spacing
    )
    flow = SPHERE_FLOW.model_copy(update={"height_um": height_um})
    return solve_empty_array(geometry, flow, numerics)


def critical_interval(flow: EmptyFlow) -> tuple[float, float, list[Passage]]:
    """Largest diameter / gap that zigzags, smallest that bumps, LAST_STEP apart; all passages."""
    passages = []

    def bumps(diameter: float) -> bool:
        passages.append(sphere_passage(flow, diameter))
        return passages[-1].bumps

    low = high = critical_diameter(1, 1 / flow.geometry.periodicity)
    if bumps(low):
        while bumps(low := high - FIRST_STEP):
            high = low
    else:
        while not bumps(high := low + FIRST_STEP):
            low = high
    while high - low > 1.01 * LAST_STEP:
        middle = (low + high) / 2
        low, high = (low, middle) if bumps(middle) else (middle, high)
    return low, high, passages


def sphere_passage(flow: EmptyFlow, diameter: float) -> Passage:
    """Carry a stiff sphere of ``diameter`` over gap along the pillars until its mode is clear.

    Raises DldsimError if the run leaves its safe range or the sphere stops.
    """
    array, periodicity = array_of(flow), flow.geometry.periodicity
    ks = flow.flow.viscosity_mPa_s * flow.flow.mean_velocity_mm_s / SPHERE_CA  # µN/m
    stiffness = Stiffness(
        ks_uN_per_m=ks,
        kb_pN_um=0,
        kal_uN_per_m=ks,
        kag_uN_per_m=20 * ks,
        kv_Pa=1e6,
        kvisc_nN_s_per_m=0,
    )
    cell = Cell(shape="sphere", radius_um=diameter * GAP_UM / 2, release_gap_fraction=0.0)
    scene = make_scene(array, flow, stiffness, cell, flow.flow, flow.numerics)
    path, deformations = Path(float(array.pitch)), []

    def fallen() -> bool:
        return path.crossings()[-1] < array.pitch / 2 + (path.rows - 0.5) * array.row_shift

    def watch(sample: Sample) -> Stop | None:
        a, b, _ = inertia_ellipse(scene.positions()[:, [0, 2, 1]], scene.surface[0].faces)
        deformations.append((a - b) / (a + b))
        if not path.add(sample):
            return None
        gained = np.diff(path.crossings())[-2:] / array.row_shift
        bumps = len(gained) == 2 and gained.min() > BUMPING
        clear = fallen() or bumps or path.rows >= periodicity + 2
        return Stop("converged", "the mode is clear") if clear else None

    chunk = 2 * round(array.pitch / SPHERE_VELOCITY / 40)
    stop = advance_until(scene, chunk, watch, patience=row_patience(array, flow.numerics))
    if stop.status in BROKEN:
        raise DldsimError(
            f"Sphere of {diameter:.3f} gaps at N_p = {periodicity}, {array.pitch} nodes per "
            f"pitch: {stop.reason}."
        )
    return Passage(not fallen(), path.rows, max(deformations), scene.sample().volume_ratio)
