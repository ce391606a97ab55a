"""Membrane of a run over time, as VTKHDF: opens in ParaView 5.12 and newer, and is read back here.

Layout of the file after the VTKHDF 2.0 specification: temporal PolyData of one partition, whose
topology is stored once and whose points and cell data are stored step after step. Lengths in µm,
times in ms. x = y = 0 is a pillar's centre and z = 0 mid-height, as in the `trajectory` table.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dldsim import PHYSICS_VERSION, __version__
from dldsim.config.sections import Geometry
from dldsim.errors import DldsimError
from dldsim.files import atomic_path
from dldsim.laws import pillar_centres
from dldsim.solver.mesh import area_vectors

if TYPE_CHECKING:
    from dldsim.experiments.array_run import RunResult

TOPOLOGIES = ("Vertices", "Lines", "Polygons", "Strips")
"""Kinds of PolyData cells in the order of the specification."""


@dataclass(frozen=True)
class Shapes:
    """Membrane of one run at T recorded times; the first is the rest shape at release.

    ``step`` (T,); ``t_ms`` (T,); ``centre_um`` (T, 3), of the enclosed volume; ``points_um``
    (T, V, 3), float32; ``faces`` (F, 3). ``height_um``: channel height on the lattice.
    """

    geometry: Geometry
    height_um: float
    cell_radius_um: float
    step: np.ndarray
    t_ms: np.ndarray
    centre_um: np.ndarray
    points_um: np.ndarray
    faces: np.ndarray

    def area_strain(self) -> np.ndarray:
        """Relative growth A/A₀ − 1 of every face since release (T, F), float32."""
        size = np.stack(
            [
                np.linalg.norm(area_vectors(x.astype(float), self.faces), axis=1)
                for x in self.points_um
            ]
        )
        return (size / size[0] - 1).astype(np.float32)

    def departure_um(self, trajectory: Mapping[str, np.ndarray]) -> float:
        """Largest distance between the recorded centres and a `trajectory` table at equal steps.

        Raises DldsimError if the table lacks a recorded step.
        """
        known = np.asarray(trajectory["step"])
        row = np.searchsorted(known, self.step)
        if row[-1] >= len(known) or np.any(known[row] != self.step):
            raise DldsimError(
                "The recorded shapes and the trajectory have other steps: they belong to runs with "
                "other settings. Record the shapes with the settings of the run."
            )
        path = np.column_stack([np.asarray(trajectory[f"{axis}_um"])[row] for axis in "xyz"])
        return float(np.linalg.norm(self.centre_um - path, axis=1).max())


class Recorder:
    """Observer of `simulate_run`: the membrane at every ``every``-th sample of the trajectory.

    Of several runs one after the other, `shapes` is about the last.
    """

    def __init__(self, every: int = 1):
        self.every = every
        self._points, self._faces, self._record = [], None, None

    def __call__(self, scene, record) -> None:
        if self._record is not record:  # another run, or the run has begun anew
            self._points, self._record = [], record
            self._faces = np.array(scene.surface[0].faces, dtype=np.int32)
        if (len(record.samples) - 1) % self.every == 0:
            spacing = record.units.spacing_um
            self._points.append(((scene.positions() - record.origin) * spacing).astype(np.float32))

    def shapes(self, geometry: Geometry, result: "RunResult") -> Shapes:
        """What was recorded of this run."""
        kept = {name: values[:: self.every] for name, values in result.trajectory.items()}
        return Shapes(
            geometry,
            result.row["height_on_lattice_um"],
            result.row["cell_radius_um"],
            kept["step"],
            kept["t_ms"],
            np.column_stack([kept[f"{axis}_um"] for axis in "xyz"]),
            np.stack(self._points),
            self._faces,
        )


def write_vtkhdf(shapes: Shapes, path: Path, about: Mapping[str, Any]) -> None:
    """Write the membrane over time, with its area strain; ``about`` goes beside it as JSON."""
    times, vertices = shapes.points_um.shape[:2]
    faces = len(shapes.faces)
    frames = np.arange(times)
    with atomic_path(path) as part:
        file = _open(part)
        root = file["VTKHDF"]
        _polygons(root, shapes.points_um.reshape(-1, 3), shapes.faces, vertices)
        _packed(root, "CellData/area_strain", shapes.area_strain().ravel())
        steps = root.create_group("Steps")
        steps.attrs["NSteps"] = times
        steps["Values"] = shapes.t_ms
        steps["NumberOfParts"] = np.ones(times, np.int64)
        steps["PartOffsets"] = np.zeros(times, np.int64)
        steps["PointOffsets"] = frames * vertices
        for name in ("CellOffsets", "ConnectivityIdOffsets"):  # one topology for all steps
            steps[name] = np.zeros((times, len(TOPOLOGIES)), np.int64)
        steps["CellDataOffsets/area_strain"] = frames * faces
        # outside VTKHDF: what readers of the format ignore and `read_vtkhdf` needs
        extra = file.create_group("dldsim")
        extra.attrs["json"] = json.dumps(
            {
                "dldsim_version": __version__,
                "physics_version": PHYSICS_VERSION,
                "geometry": shapes.geometry.model_dump(),
                "height_um": shapes.height_um,
                "cell_radius_um": shapes.cell_radius_um,
                "about": dict(about),
            },
            ensure_ascii=False,
            sort_keys=True,
        )
        extra["step"] = shapes.step
        extra["centre_um"] = shapes.centre_um
        file.close()


def read_vtkhdf(path: Path) -> Shapes:
    """The shapes of a file of `write_vtkhdf`. Raises DldsimError for any other file."""
    import h5py

    try:
        with h5py.File(path) as file:
            root, extra = file["VTKHDF"], file["dldsim"]
            about = json.loads(extra.attrs["json"])
            points = root["Points"][:].reshape(len(root["Steps/Values"]), -1, 3)
            return Shapes(
                Geometry(**about["geometry"]),
                about["height_um"],
                about["cell_radius_um"],
                extra["step"][:],
                root["Steps/Values"][:],
                extra["centre_um"][:],
                points,
                root["Polygons/Connectivity"][:].reshape(-1, 3).astype(np.int32),
            )
    except (OSError, KeyError, ValueError) as error:
        raise DldsimError(
            f"{path} is no membrane time series of dldsim, or is damaged ({error}). Make it anew."
        ) from error


def write_pillars(passages: Sequence[Shapes], path: Path, sides: int = 48) -> None:
    """The pillars beside the paths of runs through one array, as static PolyData."""
    g = passages[0].geometry
    way = np.concatenate([shapes.centre_um[:, :2] for shapes in passages])
    centres = pillars_near(g, way, 1.5 * g.pitch_um)
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = g.pillar_radius_um * np.column_stack([np.cos(angle), np.sin(angle)])
    half = passages[0].height_um / 2
    ends = [np.column_stack([ring, np.full(sides, z)]) for z in (-half, half)]
    one = np.concatenate(ends)
    i = np.arange(sides)
    quads = np.column_stack([i, (i + 1) % sides, (i + 1) % sides + sides, i + sides])
    places = np.column_stack([centres, np.zeros(len(centres))])
    points = (places[:, None] + one).reshape(-1, 3).astype(np.float32)
    cells = (quads + 2 * sides * np.arange(len(centres))[:, None, None]).reshape(-1, 4)
    with atomic_path(path) as part:
        file = _open(part)
        _polygons(file["VTKHDF"], points, cells, len(points))
        file.close()


def pillars_near(geometry: Geometry, path_um: np.ndarray, reach_um: float) -> np.ndarray:
    """Centres (n, 2) of the pillars within ``reach_um`` laterally of the path (T, 2), row by row,
    from one row before its start to one after its end; x = y = 0 is one of them."""
    pitch, shift = geometry.pitch_um, geometry.pitch_um / geometry.periodicity
    x, y = path_um.T
    centres = []
    for row in range(int(np.floor(x.min() / pitch)), int(np.ceil(x.max() / pitch)) + 1):
        beside = y[np.abs(x - row * pitch) <= pitch]
        if not beside.size:
            continue
        low, high = beside.min() - reach_um, beside.max() + reach_um
        centres += pillar_centres(pitch, shift, row, low, high)
    return np.array(centres)


def _open(path: Path):
    """A new file with the empty VTKHDF group of PolyData."""
    import h5py

    file = h5py.File(path, "w")
    root = file.create_group("VTKHDF")
    root.attrs["Version"] = np.array([2, 0], np.int64)
    kind = np.bytes_("PolyData")
    root.attrs.create("Type", kind, dtype=h5py.string_dtype("ascii", len(kind)))
    return file


def _polygons(root, points: np.ndarray, cells: np.ndarray, vertices: int) -> None:
    """Points (steps · vertices, 3) and one set of polygons (n, corners) in one partition."""
    _packed(root, "Points", points)
    root["NumberOfPoints"] = np.array([vertices], np.int64)
    for name in TOPOLOGIES:
        some = cells if name == "Polygons" else np.zeros((0, cells.shape[1]), np.int64)
        root[f"{name}/NumberOfCells"] = np.array([len(some)], np.int64)
        root[f"{name}/NumberOfConnectivityIds"] = np.array([some.size], np.int64)
        root[f"{name}/Connectivity"] = some.ravel().astype(np.int64)
        root[f"{name}/Offsets"] = np.arange(len(some) + 1, dtype=np.int64) * cells.shape[1]


def _packed(root, name: str, values: np.ndarray) -> None:
    root.create_dataset(name, data=values, compression="gzip", compression_opts=4, shuffle=True)
