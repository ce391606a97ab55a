"""A request with everything that is known of its cells: types, scatter, transients."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from dldsim.config.design_sections import DEFORMABILITIES, DesignRequest, is_given
from dldsim.design.cell_source import CellSource, make_sources
from dldsim.design.finished_campaign import calibration_of
from dldsim.design.measured_cells import Measured
from dldsim.design.motion import History, history_of
from dldsim.design.populations import Population
from dldsim.errors import DldsimError

Both = tuple[Measured | None, Measured | None]
"""Measured cells of both types, where there are any."""


class Asked(NamedTuple):
    """A request, its cell types, where their cells come from, and what outcomes say of them."""

    request: DesignRequest
    populations: Sequence[Population]
    sources: tuple[CellSource, CellSource]
    history: tuple[History, History]

    @property
    def notes(self) -> list[str]:
        """What an answer must say of measured cells and transients."""
        said = [note for source in self.sources for note in source.notes]
        return list(dict.fromkeys([*said, *(n for h in self.history for n in h.notes)]))


def ask(
    request: DesignRequest,
    populations: Sequence[Population],
    tables: Mapping[str, pd.DataFrame],
    measured: Both = (None, None),
) -> Asked:
    """``tables``: `outcomes`, and calibrations and `survey` if there are any; ``measured``: cells
    whose mean and scatter the request has (`with_measured`).

    Raises DldsimError as `make_sources` does.
    """
    sources = make_sources(request, populations, calibration_of(tables), measured)
    parts = [tables[kind] for kind in ("outcomes", "survey") if tables.get(kind) is not None]
    outcomes = parts[0] if len(parts) == 1 else pd.concat(parts, ignore_index=True)
    first, second = (history_of(outcomes, population.shape) for population in populations)
    return Asked(request, populations, sources, (first, second))


OF_RADII = ("radius_{}_um", "radius_std_{}_um", "radius_cv_{}")
OF_STIFFNESS = (*DEFORMABILITIES, "deformation_index_std_{}", "ks_cv_{}")
"""Fields of a cell type that measured cells take the place of."""


def check_measured(
    given: Mapping[str, Any],
    measured: Both,
    base: Mapping[str, Any] | None = None,
    name: Callable[[str], str] = str,
) -> None:
    """Refuse fields that measured cells make idle: they would change nothing.

    Fields that say what the cells say may stay, as an answer has them. ``given``: what is asked
    for, nothing of it a default; ``base``: what holds where nothing is given; ``name``: of a field
    in the input. Raises DldsimError.
    """
    taken = with_measured(given, measured)
    for i, cells in enumerate(measured, start=1):
        if cells is None:
            continue
        stiffness = cells.deformation_index is not None or cells.ks_uN_per_m is not None
        idle = [
            key.format(i)
            for key in (*OF_RADII, *(OF_STIFFNESS if stiffness else ()))
            if is_given(given.get(key.format(i)))
            and given[key.format(i)] != taken.get(key.format(i))
        ]
        if idle:
            columns = ["radii", *(["deformability"] if stiffness else [])]
            raise _idle(cells.source, idle, f"{' and '.join(columns)} of cell type {i}", name)
    whole = {**(base or {}), **given}
    scatters = any(
        cells is None and any(whole.get(key.format(i)) for key in OF_RADII[1:])
        for i, cells in enumerate(measured, start=1)
    )
    default = DesignRequest.model_fields["radius_distribution"].default
    first = next((cells for cells in measured if cells is not None), None)
    if first and not scatters and given.get("radius_distribution", default) != default:
        raise _idle(first.source, ["radius_distribution"], "radii as they are", name)


def _idle(source: str, keys: Sequence[str], what: str, name: Callable[[str], str]) -> DldsimError:
    names = [name(key) for key in keys]
    return DldsimError(
        f"{source} has the {what}, so {', '.join(names)} would change nothing.",
        key=keys,
        allowed="nothing beside measured cells that they say themselves",
        remedy=f"Leave {'it' if len(names) == 1 else 'them'} out, or that column of the table.",
    )


def with_measured(request: Mapping[str, Any], measured: Both) -> dict[str, Any]:
    """Fields of a request with mean and scatter of measured cells in place of what it says of them.

    A spring constant becomes the geometric mean.
    """
    values = dict(request)
    for i, cells in enumerate(measured, start=1):
        if cells is None:
            continue
        values |= {
            f"radius_{i}_um": float(cells.radius_um.mean()),
            f"radius_std_{i}_um": float(cells.radius_um.std(ddof=1)),
        }
        values.pop(f"radius_cv_{i}", None)
        if cells.deformation_index is None and cells.ks_uN_per_m is None:
            continue
        for key in OF_STIFFNESS:
            values.pop(key.format(i), None)
        if cells.deformation_index is not None:
            values[f"deformation_index_{i}"] = float(cells.deformation_index.mean())
            values[f"deformation_index_std_{i}"] = float(cells.deformation_index.std(ddof=1))
        else:
            values[f"ks_{i}_uN_per_m"] = float(np.exp(np.log(cells.ks_uN_per_m).mean()))
    return values
