"""Closed triangulated surfaces: geodesic spheres, red-cell, sphere and ellipsoid shapes, topology.

Lengths are in any one unit. Faces list their vertices anticlockwise seen from outside.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.polynomial.polynomial import polyval

from dldsim.errors import DldsimError
from dldsim.laws import EVANS_FUNG

GOLDEN = (1 + 5**0.5) / 2
ICOSAHEDRON = np.array(
    [np.roll((0, s, t * GOLDEN), k) for k in range(3) for s in (-1, 1) for t in (-1, 1)]
)


@dataclass(frozen=True)
class Topology:
    """What is joined to what on a closed surface of V vertices, E = 3V − 6, F = 2V − 4.

    faces (F, 3); edges (E, 2) sorted, first vertex the smaller; edge_faces (E, 2) are the face
    that runs along the edge from first to second vertex and the one that runs back; face_edges
    (F, 3) are the edges opposite to each vertex of a face. All int32.
    """

    faces: np.ndarray
    edges: np.ndarray
    edge_faces: np.ndarray
    face_edges: np.ndarray


def icosahedron_faces() -> np.ndarray:
    """The 20 faces (20, 3) of ICOSAHEDRON, outward."""
    distance = np.linalg.norm(ICOSAHEDRON[:, None] - ICOSAHEDRON, axis=2)
    near = np.abs(distance - 2) < 1e-9
    a, b, c = np.nonzero(near[:, :, None] & near[:, None, :] & near[None])
    outward = np.linalg.det(ICOSAHEDRON[np.stack([a, b, c], axis=1)]) > 0
    once = outward & (a < b) & (a < c)
    return np.stack([a, b, c], axis=1)[once]


def icosphere(frequency: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit geodesic sphere: icosahedron edges cut into `frequency` parts.

    Returns vertices (10 n² + 2, 3) and outward faces (20 n², 3) int32. A point with barycentric
    weights w of its icosahedron face goes along Σ sin(w θ) corner, θ the angle of an icosahedron
    edge: edges then differ by ±8 % from their mean, by −23 to +10 % with plain weights.
    Raises DldsimError for a frequency below 1.
    """
    n = frequency
    if n != int(n) or n < 1:
        raise DldsimError(f"mesh frequency is {n}; it must be a whole number of at least 1")
    i, j = (index.ravel() for index in np.mgrid[: n + 1, : n + 1])
    i, j = i[i + j <= n], j[i + j <= n]
    at = np.full((n + 2, n + 2), -1)
    at[i, j] = np.arange(len(i))
    up = np.stack([at[i, j], at[i + 1, j], at[i, j + 1]], axis=1)
    down = np.stack([at[i + 1, j], at[i + 1, j + 1], at[i, j + 1]], axis=1)
    local = np.concatenate([up[i + j < n], down[i + j < n - 1]])

    corners = icosahedron_faces()
    weights = np.zeros((20, len(i), 12), dtype=np.int64)
    for column, weight in enumerate((n - i - j, i, j)):
        weights[np.arange(20)[:, None], np.arange(len(i)), corners[:, [column]]] = weight
    weights, index = np.unique(weights.reshape(-1, 12), axis=0, return_inverse=True)
    faces = index.reshape(20, -1)[:, local].reshape(-1, 3)

    vertices = np.sin(weights * (np.arctan(2) / n)) @ ICOSAHEDRON
    vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
    return vertices, faces.astype(np.int32)


def frequency_for_edge(area: float, edge: float) -> int:
    """Icosphere frequency whose mean edge on a surface of `area` comes nearest to `edge`.

    Takes the faces as equilateral: area = 20 n² · √3/4 · edge².
    Raises DldsimError unless both are positive.
    """
    if not (area > 0 and edge > 0):
        raise DldsimError(f"area {area} and edge {edge} must be positive to choose a mesh")
    edge_times_n = (area / (5 * 3**0.5)) ** 0.5
    low = max(int(edge_times_n / edge), 1)
    return min((low, low + 1), key=lambda n: abs(edge_times_n / n - edge))


def make_shape(
    shape: Literal["biconcave", "sphere", "ellipsoid"],
    radius: float,
    frequency: int,
    aspect_ratio: float = 1.0,
    axis: Literal["x", "y", "z"] = "z",
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) and outward faces (F, 3) of a cell centred at the origin.

    `radius` is the largest distance from the symmetry `axis`; `aspect_ratio` (ellipsoid only) is
    the half axis along it over `radius`. The biconcave profile is that of `laws.EVANS_FUNG`.
    Vertices lie on the surface, so the mesh encloses a little less than the smooth shape.
    Raises DldsimError for unknown shape or axis, or sizes that are not positive.
    """
    if shape not in ("biconcave", "sphere", "ellipsoid"):
        raise DldsimError(f"cell shape {shape!r} is unknown; use biconcave, sphere or ellipsoid")
    if axis not in ("x", "y", "z"):
        raise DldsimError(f"cell axis {axis!r} is unknown; use x, y or z")
    if not (radius > 0 and aspect_ratio > 0):
        raise DldsimError(
            f"cell radius {radius} and aspect ratio {aspect_ratio} must both be positive"
        )
    vertices, faces = icosphere(frequency)
    if shape == "ellipsoid":
        vertices = revolve(vertices, (aspect_ratio,))
    elif shape == "biconcave":
        vertices = revolve(vertices, [0.5 * c for c in EVANS_FUNG])
    shift = {"x": 1, "y": 2, "z": 0}[axis]
    return np.roll(radius * vertices, shift, axis=1), faces


def revolve(sphere: np.ndarray, coefficients: Sequence[float]) -> np.ndarray:
    """Vertices (V, 3) of the unit sphere moved to z = ±√(1−r²) Σ c_k r^(2k), about z.

    A vertex keeps its fraction of the arc from pole to equator. Keeping r instead would crowd the
    rim: shortest edge of the biconcave mesh 0.58 of the mean instead of 0.85.
    """
    angle = np.linspace(0, np.pi / 2, 4001)
    profile = np.cos(angle) * polyval(np.sin(angle) ** 2, coefficients)
    arc = np.cumsum(np.hypot(np.diff(np.sin(angle)), np.diff(profile)))
    arc = np.concatenate([[0], arc / arc[-1]])
    x, y, z = sphere.T
    distance = np.hypot(x, y)
    angle = np.interp(np.arctan2(distance, np.abs(z)) / (np.pi / 2), arc, angle)
    r = np.sin(angle)
    stretch = np.divide(r, distance, out=np.ones_like(r), where=distance > 0)
    profile = np.cos(angle) * polyval(r**2, coefficients)
    return np.stack([x * stretch, y * stretch, np.sign(z) * profile], axis=1)


def frequency_of(vertices: np.ndarray) -> int:
    """Frequency of the icosphere that a mesh of these vertices (V, 3) is built on."""
    return round(((len(vertices) - 2) / 10) ** 0.5)


def resample(vertices: np.ndarray, rest: Callable[[int], np.ndarray], frequency: int) -> np.ndarray:
    """A deformed icosphere (V, 3) on the icosphere of another ``frequency`` (W, 3).

    ``rest(n)``: vertices at rest on the icosphere of frequency n. Beyond the affine map of the rest
    shape that fits best, displacements are smooth on the unit sphere on which both meshes are
    built: there they are interpolated by r³ splines. What the vertices of an affine map of the rest
    shape become is exact, and so is a mesh of the same frequency.
    """
    from scipy.interpolate import RBFInterpolator

    n = frequency_of(vertices)

    def affine(of: int) -> np.ndarray:
        at_rest = rest(of)
        return np.column_stack([np.ones(len(at_rest)), at_rest])

    fitted = np.linalg.lstsq(affine(n), vertices)[0]
    spline = RBFInterpolator(icosphere(n)[0], vertices - affine(n) @ fitted, kernel="cubic")
    return affine(frequency) @ fitted + spline(icosphere(frequency)[0])


def make_topology(faces: np.ndarray) -> Topology:
    """What is joined to what, from faces (F, 3).

    Raises DldsimError if the faces do not form one closed, consistently oriented surface with the
    Euler characteristic 2 of a sphere that uses every vertex number.
    """
    faces = np.ascontiguousarray(faces, dtype=np.int32)
    if faces.ndim != 2 or faces.shape[1] != 3 or len(faces) == 0 or faces.min() < 0:
        raise DldsimError(f"faces of shape {faces.shape}: need (F, 3) non-negative vertex numbers")
    count = int(faces.max()) + 1
    start, end = faces.ravel().astype(np.int64), np.roll(faces, -1, axis=1).ravel()
    along, back = np.flatnonzero(start < end), np.flatnonzero(start > end)
    along = along[np.argsort(start[along] * count + end[along])]
    back = back[np.argsort(end[back] * count + start[back])]
    edges = np.stack([start[along], end[along]], axis=1)
    if (
        len(along) + len(back) != faces.size
        or not np.array_equal(edges, np.stack([end[back], start[back]], axis=1))
        or np.any(np.all(edges[1:] == edges[:-1], axis=1))
    ):
        raise DldsimError(
            "the mesh is not a closed, consistently oriented surface: some edge does not belong "
            "to exactly two faces that run along it in opposite directions. Mend or flip its faces"
        )
    euler = len(np.unique(faces)) - len(edges) + len(faces)
    if euler != 2 or len(np.unique(faces)) != count:
        raise DldsimError(
            f"the mesh has Euler characteristic {euler} and {count} vertex numbers; "
            "a cell needs one sphere-like surface (2) that uses every vertex"
        )
    face_edges = np.empty(faces.size, dtype=np.int32)
    for sides in (along, back):
        face_edges[sides - sides % 3 + (sides + 2) % 3] = np.arange(len(edges))
    edge_faces = np.stack([along, back], axis=1) // 3
    return Topology(
        faces, edges.astype(np.int32), edge_faces.astype(np.int32), face_edges.reshape(-1, 3)
    )


def area_vectors(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Outward normals (F, 3) of faces, as long as the area of each."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return 0.5 * np.cross(b - a, c - a)


def area(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Surface area."""
    return float(np.linalg.norm(area_vectors(vertices, faces), axis=1).sum())


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Enclosed volume, positive for outward faces."""
    corner = vertices[faces[:, 0]] - vertices.mean(axis=0)
    return float(np.sum(corner * area_vectors(vertices, faces)) / 3)
