"""The cell that a run leaves behind, and a finer run that goes on from it.

What is kept is the state that a motion has: lateral place, phase in the unit cell, height,
orientation and shape. The fluid is not; it starts as at a release and has forgotten that within the
time that the lag number stands for.

A run that goes on stays in the basin of the motion that it goes on from. Whether the finer lattice
has other motions only releases on it can tell.
"""

import json
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from dldsim import PHYSICS_VERSION
from dldsim.config.provenance import flattened
from dldsim.config.sections import CellShape, Flow, Geometry, Stiffness
from dldsim.errors import DldsimError
from dldsim.experiments.releases import far
from dldsim.files import atomic_path, why_not_read
from dldsim.solver.mesh import frequency_of, resample
from dldsim.solver.pillars import ArrayLattice
from dldsim.solver.scene import CellInFlow, shape_at_rest
from dldsim.vocabulary import SETTLED

AT_REST = SETTLED[0]


def row_origin(array: ArrayLattice, row: int) -> np.ndarray:
    """Where positions seen from a row count from (3,), nodes: the plane midway before row ``row``,
    there the height midway between the lower pillars of both rows, and mid-height."""
    return np.array(
        [row * array.pitch, array.pitch / 2 + (row - 0.5) * array.row_shift, array.height / 2]
    )


@dataclass(frozen=True)
class SettledCell:
    """A cell in the unit cell of its array [µm], origin as in `row_origin`.

    ``geometry``, ``stiffness``, ``cell``, ``flow``: of the run, plain values; ``spacing_um`` of its
    lattice and the ``row`` that it had come to. ``positions_um`` (V, 3): vertices just behind the
    plane; ``before_um`` (3,): centre at the sample before, ahead of it, for the crossing.
    ``status``, ``angle_low_deg``, ``angle_high_deg``, ``transition_distance``: of its motion, None
    where not known.
    """

    geometry: dict[str, Any]
    stiffness: dict[str, Any]
    cell: dict[str, Any]
    flow: dict[str, Any]
    spacing_um: float
    row: int
    positions_um: np.ndarray
    before_um: np.ndarray
    status: str | None = None
    angle_low_deg: float | None = None
    angle_high_deg: float | None = None
    transition_distance: float | None = None

    @property
    def goes_on(self) -> bool:
        """Whether a finer run may go on with it, and need not release the cell.

        Near the transition where a cell is released decides its motion, and what goes on is no
        release. A cell at rest in the bump lane, or held by it, is so a few rows after a release.
        """
        return self.status != AT_REST and far(self.transition_distance)

    def same_motion(self, other: "SettledCell") -> bool:
        """Whether both intervals have an angle in common."""
        low = max(self.angle_low_deg, other.angle_low_deg)
        return low <= min(self.angle_high_deg, other.angle_high_deg)

    def check(self, sections: Mapping[str, Mapping[str, Any]]) -> None:
        """Refuse to go on as another cell, in another array or another flow.

        ``sections``: as `sections_of`. Raises DldsimError that names what differs.
        """
        mine, asked = (flattened(part) for part in ({n: getattr(self, n) for n in KNOWN}, sections))
        other = [key for key in {**mine, **asked} if mine.get(key) != asked.get(key)]
        if other:
            said = ", ".join(f"{key} = {mine.get(key)} (run: {asked.get(key)})" for key in other)
            raise DldsimError(
                f"The settled cell is that of another run: {said}.",
                key=other,
                remedy="Begin with a release, or settle this cell on the coarser lattice first.",
            )

    def enter(self, scene: CellInFlow, array: ArrayLattice) -> np.ndarray:
        """Put the cell into the first gap of a scene; returns the centre before (3,), nodes."""
        rest = shape_at_rest(CellShape(**self.cell), self.cell["radius_um"])
        frequency = frequency_of(scene.positions())
        positions = resample(self.positions_um, lambda n: rest(n)[0], frequency)
        origin = row_origin(array, 0)
        scene.deform(positions / array.spacing_um + origin)
        return self.before_um / array.spacing_um + origin


KNOWN = ("geometry", "stiffness", "cell", "flow")
"""What a run must have in common with that whose cell it goes on with."""


def sections_of(
    geometry: Geometry, stiffness: Stiffness, cell: CellShape, flow: Flow
) -> dict[str, dict[str, Any]]:
    """What a settled cell is known by, the place of release left out."""
    parts = (
        geometry,
        stiffness,
        CellShape(**cell.model_dump(include={*CellShape.model_fields})),
        flow,
    )
    return {name: part.model_dump() for name, part in zip(KNOWN, parts, strict=True)}


def settled_cell(
    scene: CellInFlow,
    array: ArrayLattice,
    row: int,
    before: np.ndarray,
    sections: Mapping[str, dict[str, Any]],
) -> SettledCell:
    """The cell of a scene that has just crossed the plane before ``row``, from the gap it is in.

    ``before`` (2,): x and y of its centre at the sample before; ``sections``: as `sections_of`.
    """
    origin = row_origin(array, row)
    origin[1] += array.pitch * np.floor((scene.sample().centre[1] - origin[1]) / array.pitch)
    return SettledCell(
        **sections,
        spacing_um=array.spacing_um,
        row=row,
        positions_um=(scene.positions() - origin) * array.spacing_um,
        before_um=(np.array([*before, origin[2]]) - origin) * array.spacing_um,
    )


# ------------------------------------------------------------------------------------------ files

KIND = "dldsim settled cells"
ARRAYS = ("positions_um", "before_um")


def save(cells: Mapping[float, SettledCell], path: Path) -> None:
    """Write cells by place of release, whole or not at all, as .npz."""
    meta, arrays = [], {}
    for number, (place, cell) in enumerate(cells.items()):
        values = asdict(cell)
        arrays |= {f"{name}_{number}": values.pop(name) for name in ARRAYS}
        meta.append({"place": place, **values})
    about = {"kind": KIND, "physics_version": PHYSICS_VERSION, "cells": meta}
    with atomic_path(Path(path)) as part, part.open("wb") as stream:
        np.savez(stream, meta=json.dumps(about), **arrays)


def load(path: Path) -> dict[float, SettledCell]:
    """Read what `save` wrote.

    Raises DldsimError if the file is damaged, foreign or of another physics version.
    """
    path, names = Path(path), {field.name for field in fields(SettledCell)}
    try:
        with np.load(path) as data:
            about = json.loads(str(data["meta"]))
            if about["kind"] != KIND:
                raise ValueError(f"it holds {about['kind']}")
            version, cells = about["physics_version"], {}
            for number, values in enumerate(about["cells"]):
                place = values.pop("place")
                values |= {name: data[f"{name}_{number}"] for name in ARRAYS}
                if set(values) != names:
                    raise ValueError("other fields")
                cells[place] = values
    except (OSError, TypeError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        damaged = f"{path} holds no settled cells, or is damaged ({error})."
        raise DldsimError(
            why_not_read(path, error) or damaged,
            key=str(path),
            remedy="Delete it and run snakemake again.",
        ) from error
    if version != PHYSICS_VERSION:
        raise DldsimError(
            f"The settled cells of {path} were made by physics version {version}; this is version "
            f"{PHYSICS_VERSION}.",
            key=str(path),
            value=version,
            allowed=str(PHYSICS_VERSION),
            remedy="Move the file away and run snakemake again.",
        )
    return {place: SettledCell(**values) for place, values in cells.items()}
