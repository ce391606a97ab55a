"""Moduli of membranes between the stiffness sets of a campaign."""

from collections.abc import Mapping

import numpy as np

from dldsim.config.sections import Stiffness
from dldsim.errors import DldsimError


def stiffness_at(ks_uN_per_m: float, sets: Mapping[str, Stiffness], key: str) -> Stiffness:
    """Moduli at a spring constant, linear between the campaign's stiffness sets."""
    curve = sorted((s.ks_uN_per_m, s) for s in sets.values())
    ks = [k for k, _ in curve]
    if not ks[0] <= ks_uN_per_m <= ks[-1]:
        raise DldsimError(
            f"{key}: its stiffness k_s = {ks_uN_per_m:.4g} µN/m is outside the stiffness sets, "
            f"{ks[0]:g} to {ks[-1]:g} µN/m.",
            key=key,
            value=ks_uN_per_m,
            allowed=f"k_s of {ks[0]:g} to {ks[-1]:g} µN/m",
            remedy="Choose a deformation index between theirs.",
        )
    return Stiffness(
        **{
            name: float(np.interp(ks_uN_per_m, ks, [getattr(s, name) for _, s in curve]))
            for name in Stiffness.model_fields
        }
    )
