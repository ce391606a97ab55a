"""Both cell types of a request: from what was measured to what acts, and to what is simulated.

A deformation index ± its spread gives an interval of k_s by the assay's calibration, that one of
Ca = μU/k_s, in which the surrogate predicts. Nothing else of a cell enters but shape and radius.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
import pandas as pd

from dldsim.analysis.calibration import check_assay, curve_of
from dldsim.analysis.domain import Domain
from dldsim.analysis.features import CellInFlow
from dldsim.analysis.stiffness import stiffness_at
from dldsim.analysis.surrogate import BEAD
from dldsim.config.design_sections import DEFORMABILITIES, SPRING_LEAST, DesignRequest
from dldsim.config.feasibility import smallest_passable_um
from dldsim.config.sections import CellShape, Flow, Stiffness
from dldsim.design.deformability import SLIT, default_assay, ks_of_index, ks_of_sets, seen_at
from dldsim.errors import DldsimError
from dldsim.laws import rest_thickness


class Asked(NamedTuple):
    """One cell type as a request names it, and the names of its fields there."""

    shape: str
    radius_um: float
    deformation_index: float | None
    deformation_index_std: float
    stiffness_set: str | None
    ks_uN_per_m: float | None
    rigid: bool
    keys: tuple[str, str, str, str, str, str]
    """Of the index, the set, the spring constant, the flag of a bead, the shape and the radius."""


class Population(NamedTuple):
    """One cell type as it is predicted and simulated; low to high: one standard deviation each."""

    number: int
    name: str
    shape: str
    radius_um: float
    flow: Flow
    stiffness: Stiffness
    basis: str
    """Where its moduli come from, in words."""
    ks_low: float
    ks_high: float
    deformation_index: float | None = None
    deformation_index_std: float = 0.0
    assay: str | None = None
    """By which the index was turned into k_s; None: k_s was named."""
    rigid: bool = False
    width_um: float = 0.0
    """Narrowest width that it is trusted to take."""
    width_basis: str = ""
    key: str = ""
    """Field of the request that its stiffness follows from."""
    shape_key: str = ""

    def capillary(self, ks_uN_per_m: Any) -> Any:
        """Ca = μU/k_s."""
        return self.flow.viscosity_mPa_s * self.flow.mean_velocity_mm_s / ks_uN_per_m

    @property
    def capillary_number(self) -> float:
        return self.capillary(self.stiffness.ks_uN_per_m)

    @property
    def cell(self) -> CellInFlow:
        """What the surrogate is asked with."""
        return self.cell_at(self.capillary_number)

    def cell_at(self, capillary_number) -> CellInFlow:
        """The same at another capillary number, or at many."""
        return CellInFlow(self.shape, self.radius_um, self.flow.height_um, capillary_number)

    @property
    def spread(self) -> tuple[float, float]:
        """Standard deviations of ln Ca below and above its value."""
        ks = self.stiffness.ks_uN_per_m
        return float(np.log(self.ks_high / ks)), float(np.log(ks / self.ks_low))

    def row(self, request: str) -> dict[str, Any]:
        """Row of `design_populations` but for what both cell types share."""
        return {
            "request": request,
            "population": str(self.number),
            "cell_shape": self.shape,
            "cell_radius_um": self.radius_um,
            "height_um": self.flow.height_um,
            "mean_velocity_mm_s": self.flow.mean_velocity_mm_s,
            "rigid": self.rigid,
            "assay": self.assay or "",
            "deformation_index": self.deformation_index,
            "deformation_index_std": self.deformation_index_std,
            "ks_uN_per_m": self.stiffness.ks_uN_per_m,
            "ks_low_uN_per_m": self.ks_low,
            "ks_high_uN_per_m": self.ks_high,
            "capillary_number": self.capillary_number,
            "capillary_number_low": self.capillary(self.ks_high),
            "capillary_number_high": self.capillary(self.ks_low),
            "stiffness_basis": self.basis,
            "narrowest_width_um": self.width_um,
            "narrowest_width_basis": self.width_basis,
        }


class InFlow(Protocol):
    """What names a flow."""

    velocity_mm_s: float | None
    height_um: float | None


def flow_of(request: InFlow, flow: Flow) -> Flow:
    """The campaign's flow with the velocity and height that a request names."""
    named = {"mean_velocity_mm_s": request.velocity_mm_s, "height_um": request.height_um}
    return flow.model_copy(update={k: v for k, v in named.items() if v is not None})


def make_populations(
    request: DesignRequest,
    flow: Flow,
    sets: Mapping[str, Stiffness],
    calibration: pd.DataFrame | None,
    domains: Mapping[str, Domain],
) -> list[Population]:
    """Both cell types of a request; ``flow``: of `flow_of`, ``domains``: of the surrogate.

    Raises DldsimError as `make_population` does.
    """
    found = []
    for i in (1, 2):
        index, by_set, ks, rigid = (key.format(i) for key in DEFORMABILITIES)
        asked = Asked(
            getattr(request, f"shape_{i}"),
            getattr(request, f"radius_{i}_um"),
            getattr(request, index),
            getattr(request, f"deformation_index_std_{i}") or 0.0,
            getattr(request, by_set),
            getattr(request, ks),
            getattr(request, rigid),
            (index, by_set, ks, rigid, f"shape_{i}", f"radius_{i}_um"),
        )
        name = f"{request.name}-{i}"
        found.append(
            make_population(i, name, asked, flow, sets, calibration, domains, request.assay)
        )
    return found


def make_population(
    number: int,
    name: str,
    asked: Asked,
    flow: Flow,
    sets: Mapping[str, Stiffness],
    calibration: pd.DataFrame | None,
    domains: Mapping[str, Domain],
    assay: str | None = None,
) -> Population:
    """One cell type: a stiffness set named is taken as it is, else the moduli are those at its k_s.

    Raises DldsimError for an assay that is not calibrated, whether it is needed or not, a set that
    neither campaign nor calibration knows, an index outside the calibrated range or without a
    calibration, beads where no spheres were learnt, and a channel too low for the cell.
    """
    if assay is not None and calibration is not None:
        check_assay(calibration, assay)
    index_key, set_key, ks_key, rigid_key, shape_key, _ = asked.keys
    index, ends, by = asked.deformation_index, None, None
    if asked.rigid:
        key, stiffness, basis = rigid_key, *_bead(rigid_key, flow, sets, domains)
    elif asked.ks_uN_per_m is not None:
        key, stiffness = ks_key, stiffness_at(asked.ks_uN_per_m, sets, ks_key)
        basis = "k_s as named"
    elif asked.stiffness_set is not None:
        key, stiffness = set_key, _of_set(asked.stiffness_set, sets, calibration, set_key)
        basis = f"stiffness set {asked.stiffness_set}"
        seen = seen_at(stiffness.ks_uN_per_m, asked.shape, asked.radius_um, calibration, assay)
        index = None if seen is None else seen.deformation_index
        if asked.deformation_index_std > 0:
            if index is None:
                raise _not_seen(asked, stiffness, calibration, assay)
            found = _by_assay(asked, index, calibration, assay, set_key)
            ends, by = found, found["assay"]
    else:
        key = index_key
        found = _by_assay(asked, index, calibration, assay, index_key)
        ends, by = found, found["assay"]
        stiffness = stiffness_at(found["ks_uN_per_m"], sets, index_key)
        basis = (
            f"inverse of the calibration {by}, k_s {found['ks_uN_per_m']:.3g} µN/m between "
            + " and ".join(found["between"])
        )
        if found["label"]:
            basis += f", {found['label']}"
        if found["truncated"]:
            basis += "; its interval reaches the end of the calibrated range"
    ks = stiffness.ks_uN_per_m
    low, high = (ks, ks) if ends is None else (ends["ks_uN_per_m_low"], ends["ks_uN_per_m_high"])
    if min(low, ks) < SPRING_LEAST:
        raise DldsimError(
            f"{key}: k_s = {min(low, ks):g} µN/m has no finite Ca = μU/k_s, by which cells "
            f"are known; allowed {SPRING_LEAST:g} or more.",
            key=key,
            value=min(low, ks),
            allowed=f"k_s of {SPRING_LEAST:g} µN/m or more",
        )
    made = Population(
        number,
        name,
        asked.shape,
        asked.radius_um,
        flow,
        stiffness,
        basis,
        min(low, ks),
        max(high, ks),
        index,
        asked.deformation_index_std,
        by,
        asked.rigid,
        key=key,
        shape_key=shape_key,
    )
    width, width_basis = narrowest(made, calibration, assay)
    if 0 < flow.height_um < width:
        raise DldsimError(
            f"height_um = {flow.height_um:.4g}: cell type {number} needs {width:.3g} µm "
            f"({width_basis}).",
            key=("height_um", asked.keys[-1]),
            value=flow.height_um,
            allowed=f"{width:.3g} µm or more, or 0 for a channel without top and bottom",
            remedy="Name a higher channel, or 0 for one without top and bottom.",
        )
    return made._replace(width_um=width, width_basis=width_basis)


def _by_assay(
    asked: Asked, index: float | None, calibration: pd.DataFrame | None, assay: str | None, key: str
) -> dict[str, Any]:
    """`ks_of_index` of a cell type as it is named."""
    cell = asked.shape, asked.radius_um
    error = asked.deformation_index_std
    return ks_of_index(index, *cell, calibration, error, assay, keys=(key, *asked.keys[-2:]))


def _not_seen(
    asked: Asked, stiffness: Stiffness, calibration: pd.DataFrame | None, assay: str | None
) -> DldsimError:
    """Why a spread of the index cannot be had of a stiffness set: no assay has an index there."""
    why = "there is no calibration"
    if calibration is not None:
        by = assay or default_assay(calibration)
        why = f"assay {by} is not calibrated at its k_s of {stiffness.ks_uN_per_m:.4g} µN/m"
        try:
            curve_of(calibration, by, asked.shape, asked.radius_um)
        except DldsimError as error:
            why = str(error).rstrip(".")
    number = asked.keys[1].rpartition("_")[2]
    return DldsimError(
        f"{asked.keys[1]} = {asked.stiffness_set}: there is no index that would spread by "
        f"deformation_index_std_{number} = {asked.deformation_index_std:g}: {why}.",
        key=(f"deformation_index_std_{number}", asked.keys[1]),
        value=asked.deformation_index_std,
        allowed="a spread of k_s instead, or a cell that the assay is calibrated for",
        remedy=f"Give the spread of k_s instead (ks_cv_{number}, --ks{number}-cv).",
    )


def _of_set(
    name: str, sets: Mapping[str, Stiffness], calibration: pd.DataFrame | None, key: str
) -> Stiffness:
    """Moduli of a stiffness set: the campaign's own, else those at the k_s of its calibration."""
    if name in sets:
        return sets[name]
    calibrated = ks_of_sets(calibration)
    if name in calibrated:
        return stiffness_at(calibrated[name], sets, key)
    known = ", ".join(sorted({*sets, *calibrated}))
    raise DldsimError(
        f"{key}: stiffness set {name:.64} is not known (known: {known}).",
        key=key,
        value=name,
        allowed=known,
        remedy="Name one of these, or the cell type by its spring constant.",
    )


def _bead(
    key: str, flow: Flow, sets: Mapping[str, Stiffness], domains: Mapping[str, Domain]
) -> tuple[Stiffness, str]:
    """Moduli that stand for a bead: the stiffest spheres that the surrogate has learnt."""
    if BEAD not in domains:
        raise DldsimError(
            f"{key}: the surrogate has learnt no spheres, whose stiff limit a bead is.",
            key=key,
            value=True,
            allowed="false",
            remedy="Learn from the survey (surrogate.survey: true).",
        )
    capillary = domains[BEAD].capillary_number[0]
    ks = flow.viscosity_mPa_s * flow.mean_velocity_mm_s / capillary
    return stiffness_at(ks, sets, key), (
        f"bead: the stiffest spheres learnt, Ca {capillary:.2g}, stand for it"
    )


# ------------------------------------------------------------------------------------ narrowest gap


def squeezed_width_um(radius_um: float, deformation_index: float) -> float:
    """Narrowest width that a cell has been seen to take [µm].

    In the calibration's throat a cell of deformation index DI = (a − b)/(a + b) has axes a and b.
    If its projected area stays that of a disc of radius R, ab = (2R)², so that
    b = 2R √((1 − DI)/(1 + DI)). A gap narrower than b would need a larger deformation than the one
    measured; an undeformable cell needs 2R.
    """
    return float(2 * radius_um * np.sqrt((1 - deformation_index) / (1 + deformation_index)))


def narrowest(
    cell: Population, calibration: pd.DataFrame | None, assay: str | None = None
) -> tuple[float, str]:
    """Narrowest width that a cell type is trusted to take [µm], and on what that rests.

    A bead its diameter; a cell of which the assay has seen the passage of a slit, at its k_s, the
    width of `squeezed_width_um`; else a disc, edge on, its thickness, and another shape the
    narrowest tube that a sphere of its radius fits through (how flat an ellipsoid is no request
    says). ``assay``: as in the request, by default the calibration's.
    """
    if cell.rigid:
        return 2 * cell.radius_um, "diameter of the bead"
    ks = cell.stiffness.ks_uN_per_m
    seen = seen_at(ks, cell.shape, cell.radius_um, calibration, assay)
    if seen is not None and seen.kind == SLIT:
        width = squeezed_width_um(cell.radius_um, seen.deformation_index)
        return (
            width,
            f"width in the slit of {seen.assay}, whose index is {seen.deformation_index:.3g} there",
        )
    if cell.shape == "biconcave":
        thickness = rest_thickness(cell.shape, 1.0) * cell.radius_um
        return thickness, "thickness of the disc at rest, edge on"
    ball = smallest_passable_um(CellShape(shape="sphere", radius_um=cell.radius_um))
    if cell.shape == "ellipsoid":
        return ball, "narrowest tube that a sphere of its largest radius fits through at its volume"
    return ball, "narrowest tube that it fits through at its volume"


# ------------------------------------------------------------------------------- what is told apart


def told_apart(populations: Sequence[Population]) -> bool | None:
    """Whether the k_s intervals of two cell types are apart; None if no assay gave either."""
    first, second = populations
    if first.assay is None and second.assay is None:
        return None
    return first.ks_high < second.ks_low or second.ks_high < first.ks_low


def doubt(populations: Sequence[Population]) -> str:
    """What an answer must say first of its cell types, in words; empty where there is nothing."""
    return " ".join(filter(None, [_not_told_apart(populations), _inertia(populations)]))


INERTIA_FROM = 0.5
"""Particle Reynolds number from which on an answer says that inertia is left out."""
WATER_KG_PER_L = 1.0


def _inertia(populations: Sequence[Population]) -> str:
    """That the fluid of the simulations has no inertia, where that of the device has."""
    largest = max(
        1e-3 * WATER_KG_PER_L * p.flow.mean_velocity_mm_s * 2 * p.radius_um / p.flow.viscosity_mPa_s
        for p in populations
    )
    if largest < INERTIA_FROM:
        return ""
    return (
        f"The particle Reynolds number U·2R/ν is {largest:.2g} (in water): inertia, which nothing "
        "here simulates, counts from about 1."
    )


def _not_told_apart(populations: Sequence[Population]) -> str:
    if told_apart(populations) is not False:
        return ""
    assays = " and ".join(dict.fromkeys(p.assay for p in populations if p.assay))
    spans = " and ".join(f"{p.ks_low:.3g} to {p.ks_high:.3g}" for p in populations)
    alike = {(p.shape, p.radius_um) for p in populations}
    left = (
        "nothing else tells them apart" if len(alike) == 1 else "only size or shape may part them"
    )
    return (
        f"The assay {assays} does not tell the two cell types apart: their k_s, {spans} µN/m, "
        f"overlap; {left}."
    )


def rows_of(populations: Sequence[Population], request: str) -> list[dict[str, Any]]:
    """Rows of `design_populations`."""
    shared = {"told_apart": told_apart(populations), "doubt": doubt(populations)}
    return [population.row(request) | shared for population in populations]
