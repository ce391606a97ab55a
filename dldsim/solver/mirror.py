"""Half of a membrane below a plane of symmetry z = constant, and what stands for the other half.

Of V vertices are computed: those on the plane, then those below it, R in all. Behind them in the
same arrays follow the images above the plane that forces on these need, L in all: the corners of
every face that touches a computed vertex (loaded) and of its neighbours, whose normals bending
asks for. Everything else follows from symmetry. Lattice units.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dldsim.errors import DldsimError
from dldsim.solver.immersed_boundary import add_images, spread
from dldsim.solver.jit import aligned_zeros, jit
from dldsim.solver.membrane import Membrane, Scratch, make_scratch

SYMMETRIC = 1e-9
"""Distance, over the size of the mesh, within which two places are the same."""
REFLECT = np.array([1.0, 1.0, -1.0])


class Mirror(NamedTuple):
    """``height``: z of the plane; ``plane``: number of vertices on it, which come first;
    ``image`` (L - R,): the vertices whose images come last."""

    height: float
    plane: int
    image: np.ndarray


NO_MIRROR = Mirror(0.0, 0, np.zeros(0, np.uint32))


@jit
def reflect(x, v, smooth, mirror):
    """Renew the images in positions and vectors (L, 3); vertices on the plane stay there."""
    for i in range(mirror.plane):
        x[i, 2] = mirror.height
        v[i, 2] = 0.0
        smooth[i, 2] = 0.0
    computed = x.shape[0] - len(mirror.image)
    for g in range(len(mirror.image)):
        i, k = computed + g, mirror.image[g]
        for d in range(2):
            x[i, d], v[i, d], smooth[i, d] = x[k, d], v[k, d], smooth[k, d]
        x[i, 2] = 2.0 * mirror.height - x[k, 2]
        v[i, 2], smooth[i, 2] = -v[k, 2], -smooth[k, 2]


@jit
def spread_both(force, stencil, domain, mirror, near, field):
    """Add the vertex forces (R, 3), and those of the images, to the density ``field`` (3 stride,).

    Images spread to the images of nodes, which stand for these nodes; a vertex on the plane is its
    own image and gives half of its force from either side. ``near`` (blocks,): see
    `immersed_boundary.surround`.
    """
    for i in range(mirror.plane):
        for d in range(3):
            force[i, d] *= 0.5
    spread(force, stencil, field)
    for i in range(mirror.plane):
        for d in range(3):
            force[i, d] *= 2.0
    add_images(field, domain, near)


@dataclass(frozen=True)
class Half:
    """The computed half of a membrane, with work space, and its place in the ``whole`` one.

    ``vertex`` (L,): numbers in the whole of the vertices here; ``opposite`` (V,): number of the
    image of every vertex of the whole; ``share`` (R, 1): how many vertices of the whole each
    computed one stands for.
    """

    whole: Membrane
    whole_scratch: Scratch
    membrane: Membrane
    scratch: Scratch
    mirror: Mirror
    vertex: np.ndarray
    opposite: np.ndarray
    share: np.ndarray

    def unfold(self, values: np.ndarray, height: float = 0.0) -> np.ndarray:
        """Positions (V, 3) of the whole from those here (at least R, 3) and the plane's height, or
        vectors."""
        computed = self.vertex[: len(self.share)]
        below = values[: len(computed)]
        whole = np.empty((len(self.opposite), 3))
        whole[self.opposite[computed]] = REFLECT * below + [0.0, 0.0, 2 * height]
        whole[computed] = below
        return whole

    def fold(self, vectors: np.ndarray) -> np.ndarray:
        """Symmetric part (L, 3) of vectors (V, 3) of the whole."""
        return (0.5 * (vectors + REFLECT * vectors[self.opposite]))[self.vertex]


def images(vertices: np.ndarray) -> np.ndarray:
    """Number of the mirror image about z = 0 of every vertex (V, 3).

    Raises DldsimError if one has none.
    """
    size = np.abs(vertices).max()
    # A projection in which no two vertices but mirror images are likely to meet.
    x, y, z = vertices.T
    key = 0.5413 * x + 0.7719 * y + 0.6137 * np.abs(z)
    order = np.argsort(key)
    opposite = np.arange(len(vertices))
    pair = np.flatnonzero(np.diff(key[order]) < SYMMETRIC * size)
    opposite[order[pair]], opposite[order[pair + 1]] = order[pair + 1], order[pair]
    apart = np.abs(REFLECT * vertices[opposite] - vertices).max()
    if apart > SYMMETRIC * size:
        raise DldsimError(
            f"The membrane is not symmetric about its middle plane: a vertex is {apart:.1e} from "
            "its image.",
            key="numerics.half_scene",
            value=True,
            remedy="Set numerics.half_scene: false.",
        )
    return opposite


def half_of(vertices: np.ndarray, whole: Membrane, scratch: Scratch) -> Half:
    """The half below z = 0 of a membrane at rest at ``vertices`` (V, 3).

    Raises DldsimError if it is not symmetric.
    """
    opposite = images(vertices)
    on_plane = opposite == np.arange(len(vertices))
    below = ~on_plane & (vertices[:, 2] < 0)
    computed = on_plane | below
    loaded = computed[whole.faces].any(axis=1)
    edges = np.unique(whole.face_edges[loaded])
    held = loaded.copy()
    held[whole.edge_faces[edges]] = True
    faces = np.concatenate([np.flatnonzero(loaded), np.flatnonzero(held & ~loaded)])
    corners = np.unique(whole.faces[faces])
    beyond = corners[~computed[corners]]
    vertex = np.concatenate([np.flatnonzero(on_plane), np.flatnonzero(below), beyond])
    count = int(computed.sum())

    def renumbered(table, kept, length):
        number = np.full(length, -1, np.int32)
        number[kept] = np.arange(len(kept))
        return np.ascontiguousarray(number[table])

    def picked(values, kept):
        some = aligned_zeros(len(kept))
        some[:] = values[kept]
        return some

    first = np.flatnonzero(loaded)
    membrane = Membrane(
        renumbered(whole.faces[faces], vertex, len(vertices)),
        renumbered(whole.edges[edges], vertex, len(vertices)),
        renumbered(whole.edge_faces[edges], faces, len(whole.faces)),
        renumbered(whole.face_edges[first], edges, len(whole.edges)),
        picked(whole.rest_lengths, edges),
        picked(whole.rest_angles, edges),
        picked(whole.rest_areas, first),
        whole.rest_area,
        whole.rest_volume,
    )
    other = _opposite_faces(whole.faces, opposite)
    own = other == np.arange(len(whole.faces))
    times = np.where(own, 1.0, 2.0 / np.maximum(1, held.astype(int) + held[other]))
    half = make_scratch(membrane)
    half = half._replace(
        vertex_corner=np.ascontiguousarray(half.vertex_corner[:, :count]),
        face_share=picked(times, faces),
    )
    image = renumbered(opposite[beyond], vertex, len(vertices)).astype(np.uint32)
    mirror = Mirror(0.0, int(on_plane.sum()), image)
    share = np.where(on_plane, 1.0, 2.0)[vertex[:count], None]
    return Half(whole, scratch, membrane, half, mirror, vertex, opposite, share)


def _opposite_faces(faces: np.ndarray, opposite: np.ndarray) -> np.ndarray:
    """Number of the mirror image of every face (F, 3). Raises DldsimError if one has none."""
    base = len(opposite) ** np.arange(3)
    key, wanted = (np.sort(corners, axis=1) @ base for corners in (faces, opposite[faces]))
    order = np.argsort(key)
    found = order[np.minimum(np.searchsorted(key[order], wanted), len(key) - 1)]
    if not np.array_equal(key[found], wanted):
        raise DldsimError(
            "The membrane's faces are not symmetric about its middle plane.",
            key="numerics.half_scene",
            value=True,
            remedy="Set numerics.half_scene: false.",
        )
    return found
