"""Moduli of membranes between the stiffness sets of a campaign, and beyond them."""

from collections.abc import Mapping

import numpy as np
from pydantic import ValidationError

from dldsim.config.sections import Stiffness
from dldsim.errors import DldsimError

VISCOUS = "kvisc_nN_s_per_m"
"""The one coefficient that does not go along with the elastic moduli."""


def stiffness_at(ks_uN_per_m: float, sets: Mapping[str, Stiffness], key: str) -> Stiffness:
    """Moduli at a spring constant: linear between the campaign's stiffness sets.

    Beyond them the elastic moduli of the nearest set are scaled in proportion, which leaves all
    ratios of Stokes flow but Ca as they are. ``key``: name of the spring constant in the input, for
    errors. Raises DldsimError for one that is not positive, one whose other moduli are out of
    range, without sets, and for sets of one k_s with other moduli.
    """
    by_ks: dict[float, list[str]] = {}
    for name, s in sets.items():
        if s.ks_uN_per_m > 0:
            by_ks.setdefault(s.ks_uN_per_m, []).append(name)
    for ks, names in by_ks.items():
        if len({tuple(sets[name].model_dump().values()) for name in names}) > 1:
            raise DldsimError(
                f"{key}: stiffness sets {' and '.join(names)} have the same k_s of {ks:g} µN/m and "
                "other moduli; k_s does not tell which a cell has.",
                key=key,
                value=ks_uN_per_m,
                allowed="stiffness sets of different k_s",
                remedy="Name the cell by its stiffness set.",
            )
    curve = sorted((ks, sets[names[0]]) for ks, names in by_ks.items())
    if not curve or not ks_uN_per_m > 0:
        raise DldsimError(
            f"{key}: no moduli for k_s = {ks_uN_per_m:.4g} µN/m; they are those of the stiffness "
            f"sets ({', '.join(sets) or 'none'}) at this k_s.",
            key=key,
            value=ks_uN_per_m,
            allowed="k_s above 0, and a campaign with stiffness sets",
        )
    ks = [k for k, _ in curve]
    near = float(np.clip(ks_uN_per_m, ks[0], ks[-1]))
    found = {
        name: float(np.interp(near, ks, [getattr(s, name) for _, s in curve]))
        for name in Stiffness.model_fields
    }
    factor = ks_uN_per_m / near
    try:
        return Stiffness(**{n: v if n == VISCOUS else factor * v for n, v in found.items()})
    except ValidationError as error:
        names = ", ".join(str(e["loc"][0]) for e in error.errors())
        raise DldsimError(
            f"{key} = {ks_uN_per_m:g}: {names} in proportion to it is beyond what a membrane may "
            "have.",
            key=key,
            value=ks_uN_per_m,
            allowed="k_s whose other moduli are within their ranges",
            remedy="Lower it, or name a bead.",
        ) from error
