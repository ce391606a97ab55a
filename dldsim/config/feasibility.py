"""What a setting that is valid alone cannot be together with others: gaps, cells, lattices."""

import math
from collections.abc import Iterable

from dldsim import laws
from dldsim.config import assays
from dldsim.config.assay_sections import ChannelAssay, ConstrictionAssay, ShearAssay
from dldsim.config.configuration import Config, Partial
from dldsim.config.identifiers import Point
from dldsim.config.limits import Limits, check_memory
from dldsim.config.sections import CellShape, Constriction, Flow, Geometry, Numerics, RunControl
from dldsim.errors import DldsimError

AREA_RESERVE = 0.1
"""Relative area growth that a squeezed membrane is assumed to bear in `smallest_passable_um`."""


def check_gap(geometry: Geometry, safety_distance_um: float) -> None:
    """Refuse a gap that does not exceed P_r + d_safety."""
    least = geometry.pillar_radius_um + safety_distance_um
    if geometry.gap_um <= least:
        raise DldsimError(
            f"gap_um = {geometry.gap_um:g} is too small for pillar_radius_um = "
            f"{geometry.pillar_radius_um:g}: a gap must exceed P_r + d_safety = {least:g} µm.",
            key="gap_um",
            value=geometry.gap_um,
            allowed=f"> {least:g}",
            remedy="Widen the gap, take a smaller pillar, or lower sweep.safety_distance_um.",
        )


def check_tolerance(tolerance_um: float, pillar_radius_um: float, gap_um: float) -> None:
    """Refuse a fabrication tolerance by which such a pillar or gap could vanish."""
    least = min(pillar_radius_um, gap_um)
    if tolerance_um >= least:
        raise DldsimError(
            key="tolerance_um",
            value=tolerance_um,
            allowed=f"below {least:g}, the smaller of pillar_radius_um = {pillar_radius_um:g} and "
            f"gap_um = {gap_um:g}",
            remedy="A pillar or a gap would vanish: lower the tolerance, or take larger ones.",
        )


def smallest_passable_um(cell: CellShape) -> float:
    """Diameter of the narrowest tube that the cell fits through [µm], a rough lower limit for gaps.

    A membrane keeps its volume and resists growth of its area, so the thinnest it can become is a
    cylinder with hemispherical ends of the same volume V and area A (Canham & Burton 1968):
    V = A r/2 − 2π r³/3. Here A is the rest area plus AREA_RESERVE. A cell between tall pillars can
    also flatten, which is easier: the limit is on the safe side, and only a simulation tells
    whether a wider gap is passed.
    """
    area = (1 + AREA_RESERVE) * laws.rest_area(cell.shape, cell.aspect_ratio)
    volume = 4 / 3 * math.pi * laws.rest_volume(cell.shape, cell.aspect_ratio)
    low, high = 0.0, math.sqrt(area / (4 * math.pi))  # V(r) rises up to the sphere of this area
    for _ in range(60):
        r = (low + high) / 2
        if area * r / 2 - 2 * math.pi * r**3 / 3 < volume:
            low = r
        else:
            high = r
    return 2 * high * cell.radius_um


def check_passable(geometry: Geometry, cell: CellShape, height_um: float = 0.0) -> None:
    """Refuse a gap, or a channel height other than 0, that the squeezed cell cannot pass."""
    least = smallest_passable_um(cell)
    for name, value in (("gap_um", geometry.gap_um), ("height_um", height_um or math.inf)):
        if value < least:
            raise DldsimError(
                f"{name} = {value:g} is smaller than a squeezed {cell.shape} cell of radius "
                f"{cell.radius_um:g} µm, about {least:.1f} µm across.",
                key=name,
                value=value,
                allowed=f"{least:.1f} or more",
                remedy="Widen it, or lower cell.radius_um.",
            )


LEAST_NODES = 4
"""Across a gap and between plates."""


def _check_nodes(key: str, length_um: float, spacing_um: float, finer: str, else_: str) -> None:
    """Refuse a length that the lattice divides into too few nodes."""
    if length_um < LEAST_NODES * spacing_um:
        raise DldsimError(
            f"{key} = {length_um:g} holds fewer than {LEAST_NODES} nodes of {spacing_um:.3g} µm.",
            key=key,
            value=length_um,
            allowed=f"{LEAST_NODES * spacing_um:.3g} or more",
            remedy=f"Refine {finer} to {length_um / LEAST_NODES:.3g} or less, or {else_}.",
        )


def check_array(
    geometry: Geometry, flow: Flow, numerics: Numerics, limits: Limits | None = None
) -> None:
    """Refuse an array that the lattice cannot carry, or that needs too much memory.

    ``limits``: by default those in force.
    """
    if numerics.rows > geometry.periodicity:
        raise DldsimError(
            key="numerics.rows",
            value=numerics.rows,
            allowed=f"1 to the periodicity {geometry.periodicity}",
            remedy="The domain repeats after a period: lower numerics.rows.",
        )
    spacing, shift = laws.whole_shift_spacing(geometry, numerics.spacing_um)
    _check_nodes("gap_um", geometry.gap_um, spacing, "numerics.spacing_um", "widen the gap")
    height = 1.0
    if flow.height_um > 0:
        height = round(flow.height_um / spacing)
        if height < LEAST_NODES:
            _check_nodes(
                "height_um",
                flow.height_um,
                spacing,
                "numerics.spacing_um",
                "set height_um to 0 for the two-dimensional limit",
            )
        height /= 1 + numerics.half_scene
    pitch = shift * geometry.periodicity
    nodes = numerics.rows * numerics.lanes * pitch**2 * height
    check_memory(nodes, numerics.precision, "numerics.spacing_um", numerics.spacing_um, limits)


def check_images(geometry: Geometry, cell: CellShape, numerics: Numerics) -> None:
    """Refuse a periodic domain in which the cell at rest would reach its own image."""
    rows, lanes = numerics.rows, numerics.lanes
    aside = rows / geometry.periodicity + numerics.staggered * (lanes // 2)
    ahead = range(1, lanes // rows + 2)
    apart = min(lanes, *(math.hypot(i * rows, math.remainder(i * aside, lanes)) for i in ahead))
    if apart * geometry.pitch_um <= 2 * cell.radius_um:
        raise DldsimError(
            f"The periodic images of the cell are {apart * geometry.pitch_um:.3g} µm apart in a "
            f"domain of {rows} × {lanes} pillars, no more than its diameter.",
            key="numerics.lanes",
            value=lanes,
            allowed=f"images more than {2 * cell.radius_um:g} µm apart",
            remedy="Raise numerics.lanes and numerics.rows, or take a smaller cell.",
        )


def check_channel(channel: Constriction, numerics: Numerics, limits: Limits | None = None) -> None:
    """Refuse a constriction channel that the lattice cannot carry, or that needs too much memory.

    ``limits``: by default those in force.
    """
    if channel.throat_width_um >= channel.width_um:
        raise DldsimError(
            f"constriction.throat_width_um = {channel.throat_width_um:g} must be below "
            f"constriction.width_um = {channel.width_um:g}.",
            key="constriction.throat_width_um",
            value=channel.throat_width_um,
            allowed=f"< {channel.width_um:g}",
            remedy="Narrow the throat or widen the channel.",
        )
    spacing, _ = laws.even_throat(channel.throat_width_um, channel.spacing_um)
    _check_nodes(
        "constriction.throat_width_um",
        channel.throat_width_um,
        spacing,
        "constriction.spacing_um",
        "widen the throat",
    )
    height = round(channel.height_um / spacing)
    if height < LEAST_NODES:
        _check_nodes(
            "constriction.height_um",
            channel.height_um,
            spacing,
            "constriction.spacing_um",
            "raise the height",
        )
    length = channel.throat_length_um + 2 * (channel.approach_length_um + channel.taper_length_um)
    nodes = length / spacing * channel.width_um / spacing * height / (1 + numerics.half_scene)
    check_memory(nodes, numerics.precision, "constriction.spacing_um", channel.spacing_um, limits)


def check_release(position_um: float, channel: Constriction, cell: CellShape) -> None:
    """Refuse a position of release at which the cell is not in the straight approach."""
    most = channel.approach_length_um - 2 * cell.radius_um
    if most < 0:
        raise DldsimError(
            f"constriction.approach_length_um = {channel.approach_length_um:g} is shorter than the "
            f"cell, {2 * cell.radius_um:g} µm.",
            key="constriction.approach_length_um",
            value=channel.approach_length_um,
            allowed=f"{2 * cell.radius_um:g} or more",
            remedy="Lengthen it, or take a smaller cell.",
        )
    if not 0 <= position_um <= most:
        raise DldsimError(
            f"constriction.release_positions_um: {position_um:g} µm does not fit the approach of "
            f"{channel.approach_length_um:g} µm, counted back from its end; allowed 0 to {most:g}.",
            key="constriction.release_positions_um",
            value=position_um,
            allowed=f"0 to {most:g}",
            remedy="Release the cell there, or lengthen constriction.approach_length_um.",
        )


def check_throat(channel: Constriction, cell: CellShape) -> None:
    """Refuse a throat or a channel that the squeezed cell cannot pass."""
    least = smallest_passable_um(cell)
    for key in ("throat_width_um", "height_um"):
        if (value := getattr(channel, key)) < least:
            raise DldsimError(
                f"constriction.{key} = {value:g} is smaller than a squeezed {cell.shape} cell of "
                f"radius {cell.radius_um:g} µm, about {least:.1f} µm across.",
                key=f"constriction.{key}",
                value=value,
                allowed=f"{least:.1f} or more",
                remedy="Widen it, or lower cell.radius_um.",
            )


def check_fits(assay: ChannelAssay, cell: CellShape, offset_um: float) -> None:
    """Refuse a straight channel in which the cell has no room at release, ``offset_um`` off the
    axis across the picture."""
    thickness = laws.rest_thickness(cell.shape, cell.aspect_ratio)
    for key, axis, aside in (("width_um", "y", offset_um), ("height_um", "z", 0.0)):
        extent = cell.radius_um * (thickness if cell.axis == axis else 2.0)
        least = extent + 2 * aside + assay.spacing_um
        if (value := getattr(assay, key)) < least:
            off = f" released {aside:g} µm off the axis" if aside else ""
            raise DldsimError(
                f"{key} = {value:g}: a {cell.shape} cell of radius {cell.radius_um:g} µm{off} does "
                f"not fit; it is {extent:.3g} µm across and needs half a node of "
                f"{assay.spacing_um:g} µm on either side.",
                key=key,
                value=value,
                allowed=f"{least:.3g} or more",
                remedy="Widen the channel, or lower the radius or the offset.",
            )


def check_passages(passages: Iterable[assays.Passage]) -> None:
    """Refuse two passages that are alike: they would count twice in the scatter."""
    seen = set()
    for passage in passages:
        alike = passage._replace(varied=assays.NOTHING)
        if alike in seen:
            key, value = {
                assays.RELEASE: ("constriction.release_positions_um", passage.release_position_um),
                assays.OFFSET: ("offsets_um", passage.offset_um),
                assays.SIZE: ("radius_factors", passage.radius_factor),
                assays.ORIENTATION: ("other_axes", passage.axis),
            }[passage.varied]
            raise DldsimError(
                f"{key}: a passage with {value} is there before.",
                key=key,
                value=value,
                allowed="each value once, and none of the first passage",
                remedy="Leave it out.",
            )
        seen.add(alike)


def check_tension(key: str, velocity_mm_s: float, viscosity_mPa_s: float, membrane) -> None:
    """Refuse a flow that would tear the membrane, a stiffness, whatever the time step."""
    area_modulus = laws.area_modulus(
        membrane.ks_uN_per_m, membrane.kal_uN_per_m, membrane.kag_uN_per_m
    )
    most = laws.LARGEST_TENSION * area_modulus / viscosity_mPa_s
    if velocity_mm_s > most:
        raise DldsimError(
            f"{key}: at a mean velocity of {velocity_mm_s:.4g} mm/s the flow tears a membrane of "
            f"k_s = {membrane.ks_uN_per_m:.4g} µN/m, and no time step carries that.",
            key=key,
            value=velocity_mm_s,
            allowed=f"mean velocities up to {most:.3g} mm/s",
            remedy="Lower it, or measure stiffer membranes.",
        )


def check_point(point: Point, config: Partial) -> None:
    """Refuse an assay in which a cell and a membrane cannot be measured."""
    assay = assays.simulated(point.assay, config)
    [membrane] = [m for m in assays.membranes_of(assay, config) if m.name == point.membrane]
    cell = config.cell.model_copy(update={"shape": point.shape, "radius_um": point.radius_um})
    viscosity = assay.viscosity_mPa_s or config.flow.viscosity_mPa_s
    check_passages(assays.passages_of(assay, cell.shape))
    for passage in assays.passages_of(assay, cell.shape):
        own = cell.model_copy(
            update={"radius_um": cell.radius_um * passage.radius_factor, "axis": passage.axis}
        )
        if isinstance(assay, ConstrictionAssay):
            check_channel(assay.slit, config.numerics, config.limits)
            check_throat(assay.slit, own)
            check_release(passage.release_position_um, assay.slit, own)
        elif isinstance(assay, ChannelAssay):
            check_fits(assay, own, passage.offset_um)
            spacing = assay.spacing_um
            _check_nodes("height_um", assay.height_um, spacing, "spacing_um", "raise the height")
            _check_nodes("width_um", assay.width_um, spacing, "spacing_um", "widen the channel")
            volume = assay.width_um * assay.height_um * assay.period_um
            nodes = volume / spacing**3 / (1 + config.numerics.half_scene)
            check_memory(nodes, config.numerics.precision, "spacing_um", spacing, config.limits)
    key, velocity = "velocity_mm_s", membrane.velocity_mm_s
    if isinstance(assay, ChannelAssay):
        velocity = assay.mean_velocity_mm_s
    elif isinstance(assay, ShearAssay):
        key, velocity = "stress_Pa", assay.stress_Pa / viscosity * cell.radius_um
    else:
        mean = assay.velocity_mm_s if velocity is None else velocity
        assert mean is not None
        velocity = mean * assay.slit.width_um / assay.slit.throat_width_um
    check_tension(key, velocity, viscosity, membrane.stiffness)


def check_points(points: Iterable[Point], config: Partial) -> None:
    """Refuse assays in which a cell does not fit, or that no lattice or time step carries.

    The error names the assay.
    """
    for point in points:
        try:
            check_point(point, config)
        except DldsimError as error:
            remedy = error.remedy
            raise DldsimError(
                f"assays.{point.assay}: {str(error).removesuffix(remedy).rstrip()}",
                key=_key_of(point.assay, error.key, config),
                value=error.value,
                allowed=error.allowed,
                remedy=remedy,
            ) from None


def _key_of(name: str, key: str, config: Partial) -> str:
    """Where the setting of an assay stands: in the section of the source's slit, or its own."""
    own = {**config.assay_study.assays, **config.assays}[name]
    section = "assay_study.assays" if name not in config.assays else "assays"
    if not key.startswith("constriction."):
        return f"{section}.{name}.{key}"
    if not isinstance(own, ConstrictionAssay) or own.channel is None:
        return key
    return f"{section}.{name}.channel.{key.removeprefix('constriction.')}"


def check_campaign(config: Config) -> None:
    """Refuse a configuration of which a run could not start."""
    check_sweep(config)
    check_points(
        [*assays.points(config), *assays.points_of_library(config), *assays.study_points(config)],
        config,
    )


def check_rows(periodicity: int, control: RunControl) -> None:
    """Refuse a periodicity of which no cell is followed for a whole period."""
    for key in ("max_rows", "outcome_rows_max"):
        if (rows := getattr(control, key)) < periodicity:
            raise DldsimError(
                f"run_control.{key} = {rows} is below N_p = {periodicity}: an angle needs one "
                "period of the array.",
                key=f"run_control.{key}",
                value=rows,
                allowed=f"{periodicity} or more",
                remedy=f"Raise it, or leave out periodicities above {rows}.",
            )


def check_sweep(config: Config) -> None:
    """Every combination of the sweep must be sound; see Sweep.skip_infeasible."""
    sweep, feasible = config.sweep, 0
    check_rows(max(sweep.periodicity), config.run_control)
    if config.flow.height_um == 0:
        raise DldsimError(
            "flow.height_um = 0 is the two-dimensional limit of a flow without a cell; the cells "
            "of a campaign need a channel height.",
            key="flow.height_um",
            value=0,
            allowed="> 0",
            remedy="Name a height; `python -m dldsim flow --height-um 0` has the flow alone.",
        )
    for radius in sweep.pillar_radius_um:
        for gap in sweep.gaps_for(radius):
            geometry = Geometry(pillar_radius_um=radius, gap_um=gap, periodicity=2)
            try:
                check_gap(geometry, sweep.safety_distance_um)
            except DldsimError as error:
                if sweep.skip_infeasible:
                    continue
                raise DldsimError(
                    f"sweep: {error} Or set sweep.skip_infeasible: true to leave such combinations "
                    "out.",
                    key=f"sweep.{error.key}",
                    value=error.value,
                    allowed=error.allowed,
                ) from None
            check_passable(geometry, config.cell, config.flow.height_um)
            for periodicity in sweep.periodicity:
                array = geometry.model_copy(update={"periodicity": periodicity})
                check_array(array, config.flow, config.numerics, config.limits)
                check_images(array, config.cell, config.numerics)
            feasible += 1
    if not feasible:
        raise DldsimError(
            "sweep: no combination is left, every gap_um is at most P_r + d_safety "
            f"(d_safety = {sweep.safety_distance_um:g} µm).",
            key="sweep.gap_um",
            value=sweep.gap_um,
            allowed="> P_r + d_safety",
            remedy="Add wider gaps or smaller pillars.",
        )
