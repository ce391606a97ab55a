"""Both cell types of a request as they are simulated."""

from collections.abc import Mapping
from typing import NamedTuple

import pandas as pd

from dldsim.analysis.calibration import stiffness_for
from dldsim.analysis.stiffness import stiffness_at
from dldsim.config.design_sections import DesignRequest
from dldsim.config.sections import Stiffness
from dldsim.errors import DldsimError


class Population(NamedTuple):
    """One cell type as it is simulated; ``basis`` says where its moduli come from."""

    number: int
    name: str
    deformation_index: float
    deformation_index_std: float
    radius_um: float
    stiffness: Stiffness
    basis: str


def make_populations(
    request: DesignRequest,
    resolved: DesignRequest,
    calibration: pd.DataFrame,
    sets: Mapping[str, Stiffness],
) -> list[Population]:
    """Both cell types of a request; ``resolved``: the same request by deformation indices.

    A stiffness set named in the request is simulated as it is. Else k_s follows from the
    deformation index, and the other moduli are those that the campaign's sets have at this k_s,
    linear between sets: the calibration's groups have other bending moduli, which no array run has.

    Raises DldsimError for a set of which the campaign has no moduli, outside the calibrated range,
    and beyond the sets.
    """
    found = []
    for i in (1, 2):
        index = getattr(resolved, f"deformation_index_{i}")
        named = getattr(request, f"stiffness_set_{i}")
        if named is not None and named not in sets:
            raise DldsimError(
                f"design request {request.name}: stiffness_set_{i} = {named} was not simulated in "
                f"this campaign, which has {', '.join(sorted(sets))}. Its angles can be predicted "
                "by its deformation index.",
                key=f"stiffness_set_{i}",
                value=named,
                allowed=", ".join(sorted(sets)),
                remedy="To simulate it, name one of these or another campaign.",
            )
        if named is not None:
            stiffness, basis = sets[named], f"stiffness set {named}"
        else:
            key = f"deformation_index_{i}"
            inverse = stiffness_for(index, calibration, key=key)
            stiffness = stiffness_at(inverse["ks_uN_per_m"], sets, key)
            basis = (
                f"inverse of the calibration, k_s {inverse['ks_uN_per_m']:.3g} µN/m between "
                + " and ".join(inverse["between"])
            )
        found.append(
            Population(
                i,
                f"{request.name}-{i}",
                index,
                getattr(resolved, f"deformation_index_std_{i}") or 0.0,
                getattr(request, f"radius_{i}_um"),
                stiffness,
                basis,
            )
        )
    return found
