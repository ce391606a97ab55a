"""A closed membrane: moduli, topology, state of rest, work space, and elastic energies.

Any consistent units. Its forces: :mod:`dldsim.solver.membrane_forces`.
"""

from math import atan, cos, log, pi, sin, sqrt
from typing import NamedTuple

import numpy as np

from dldsim.errors import DldsimError
from dldsim.solver import mesh
from dldsim.solver.hyperelastic import in_plane_energy
from dldsim.solver.jit import aligned_zeros, jit
from dldsim.solver.membrane_forces import measure_edges, measure_faces


class Moduli(NamedTuple):
    """Coefficients in one consistent system of units; a zero skips its term.

    ``neo_hookean``, ``skalak``: surface shear modulus of a continuous membrane, with the latter's
    area constant C. ``isotropic``: whether the area terms act along the gradient of the area.
    """

    ks: float
    kb: float
    kal: float
    kag: float
    kv: float
    kvisc: float
    neo_hookean: float = 0.0
    skalak: float = 0.0
    skalak_c: float = 1.0
    isotropic: bool = False


class Membrane(NamedTuple):
    """Topology (see mesh.Topology) and rest state of one membrane: V vertices, E edges, F faces."""

    faces: np.ndarray
    edges: np.ndarray
    edge_faces: np.ndarray
    face_edges: np.ndarray
    rest_lengths: np.ndarray
    rest_angles: np.ndarray
    rest_areas: np.ndarray
    rest_area: float
    rest_volume: float


class Scratch(NamedTuple):
    """Who meets whom, work space of the kernels, and what they leave there.

    One array per component, so that loops vectorise.

    - corner_vertex: 3 arrays (F), edge_vertex: 2 arrays (E): vertices times 3, the place of x
    - edge_face: 2 arrays (E); face_edge: 3 arrays (F), opposite to each vertex
    - vertex_corner (K, V): corners 3 f + k that meet in a vertex, filled up with 3 F
    - sides: x, y, z (F) of the side opposite to a face's first vertex, then second, then third
    - normals: x, y, z (F) of the outward normal times the area; areas (F)
    - directions: x, y, z (E) from first to second vertex; lengths (E), angles (E): φ
    - smaller (E): squared area of the smaller face of an edge
    - pulls, twists (E): see `membrane_forces.tense_edges`
    - corners: x, y, z (3 F + 1) of the force of a face on its vertices, the last one zero
    - face_share (F): how often a face counts in the total area and volume

    Of half a membrane (see :mod:`dldsim.solver.mirror`) the faces without face_edge bear no
    force, and vertex_corner has those vertices whose force is asked for.
    """

    corner_vertex: tuple[np.ndarray, ...]
    edge_vertex: tuple[np.ndarray, ...]
    edge_face: tuple[np.ndarray, ...]
    face_edge: tuple[np.ndarray, ...]
    vertex_corner: np.ndarray
    sides: tuple[np.ndarray, ...]
    normals: tuple[np.ndarray, ...]
    areas: np.ndarray
    directions: tuple[np.ndarray, ...]
    lengths: np.ndarray
    angles: np.ndarray
    smaller: np.ndarray
    pulls: np.ndarray
    twists: np.ndarray
    corners: tuple[np.ndarray, ...]
    face_share: np.ndarray


class Energies(NamedTuple):
    """Elastic energy of each term; ``stretching`` is that of springs or continuous membrane."""

    stretching: float
    bending: float
    local_area: float
    global_area: float
    volume: float


def make_membrane(vertices: np.ndarray, faces: np.ndarray) -> Membrane:
    """Membrane at rest in the shape of `vertices` (V, 3).

    Raises DldsimError if the faces do not form one closed, sphere-like surface, seen from outside.
    """
    topology = mesh.make_topology(faces)
    x = np.ascontiguousarray(vertices, dtype=np.float64)
    scratch = make_scratch(topology)
    area, volume = measure_faces(x, scratch)
    if not volume > 0:
        raise DldsimError(
            f"the mesh encloses a volume of {volume}: its faces point inward; flip them"
        )
    measure_edges(x, scratch)
    return Membrane(
        topology.faces,
        topology.edges,
        topology.edge_faces,
        topology.face_edges,
        scratch.lengths,
        scratch.angles,
        scratch.areas,
        area,
        volume,
    )


def make_scratch(membrane: Membrane | mesh.Topology) -> Scratch:
    """Work space for one membrane; threads need one each."""
    faces, edges = membrane.faces, membrane.edges

    def columns(table):
        return tuple(np.ascontiguousarray(c, np.uint32) for c in np.transpose(table))

    def zeros(count, length):
        return tuple(aligned_zeros(length) for _ in range(count))

    loaded = faces[: len(membrane.face_edges)]
    corner = np.argsort(loaded, axis=None, kind="stable")
    vertex = loaded.ravel()[corner]
    rank = np.arange(len(vertex)) - np.searchsorted(vertex, vertex)
    vertex_corner = np.full((max(6, rank.max() + 1), faces.max() + 1), loaded.size, np.uint32)
    vertex_corner[rank, vertex] = corner
    f, e = len(faces), len(edges)
    face_share = aligned_zeros(f)
    face_share[:] = 1.0
    return Scratch(
        columns(3 * faces),
        columns(3 * edges),
        columns(membrane.edge_faces),
        columns(membrane.face_edges),
        vertex_corner,
        zeros(9, f),
        zeros(3, f),
        *zeros(1, f),
        zeros(3, e),
        *zeros(5, e),
        zeros(3, loaded.size + 1),
        face_share,
    )


def shear_modulus(ks: float) -> float:
    """G_s = √3/4 k_s of a network of equilateral triangles (Seung & Nelson 1988).

    Phys. Rev. A 38, 1005; small strains.
    """
    return sqrt(3) / 4 * ks


def bending_modulus(kb: float) -> float:
    """κ = √3/2 k_b of a network of equilateral triangles bent to a cylinder.

    Seung & Nelson, Phys. Rev. A 38 (1988) 1005; other curvatures see another factor, a sphere
    7.26 k_b of energy instead of 8π κ = 21.8 k_b, since κ_G = −4/3 κ (Gompper & Kroll,
    J. Phys. I France 6 (1996) 1305).
    """
    return sqrt(3) / 2 * kb


def vertex_areas(membrane: Membrane) -> np.ndarray:
    """Area of membrane at rest that each vertex stands for (V,): a third of the faces around it."""
    loaded = membrane.faces[: len(membrane.face_edges)]
    areas = np.broadcast_to(membrane.rest_areas[:, None] / 3, loaded.shape)
    return np.bincount(loaded.ravel(), areas.ravel(), int(membrane.faces.max()) + 1)


@jit
def stretching_integral(s):
    """∫₁^λ κ(λ′) (λ′ − 1) dλ′ with s = √λ, up to a constant.

    With λ = s² the integrand is 2(s² − 1) + 2(s² − 1)²/(s⁸ + 1), the second part by partial
    fractions over the roots exp(±iθ), θ an odd multiple of π/8.
    """
    total = 2 * (s * s * s / 3 - s)
    for k in range(4):
        theta = (2 * k + 1) * pi / 8
        real, imag = cos(theta), sin(theta)
        part = 0.5 * cos(3 * theta) * log(s * s - 2 * s * real + 1)
        part -= sin(3 * theta) * atan((s - real) / imag)
        total += 2 * imag * imag * part
    return total


def energies(
    x: np.ndarray, membrane: Membrane, moduli: Moduli, scratch: Scratch | None = None
) -> Energies:
    """Elastic energy of each term at positions x (V, 3).

    Stretching, bending and volume forces are exactly minus the gradients of these, and so are
    isotropic area forces, −k_α/2 (1 − A₀/A) ∇A and −k_ag/2 (S − S₀)/S₀ ∇S. Those towards the
    centroid derive from no energy: k_α (A − A₀) m_i / Σ|m|² = −k_α/2 (A − A₀) ∇ ln Σ|m|², and
    Σ|m|² is a function of A only while the shape of the triangle stays the same. Reported is the
    work of both under uniform dilation, exact for triangles of any shape:
    k_α/2 (A − A₀ − A₀ ln(A/A₀)) per face, which is k_α (A − A₀)²/(4 A₀) for small strain, and
    k_ag (S − S₀)²/(4 S₀).
    """
    return Energies(*energy_terms(x, membrane, moduli, scratch or make_scratch(membrane)))


@jit
def energy_terms(x, membrane, moduli, scratch):
    """Energies of stretching, bending, local area, global area and volume."""
    area, volume = measure_faces(x, scratch)
    measure_edges(x, scratch)
    at_rest = stretching_integral(1.0)
    stretching = 0.0
    bending = 0.0
    for e in range(membrane.edges.shape[0]):
        rest = membrane.rest_lengths[e]
        stretching += rest * rest * (stretching_integral(sqrt(scratch.lengths[e] / rest)) - at_rest)
        bending += (scratch.angles[e] - membrane.rest_angles[e]) ** 2
    local_area = 0.0
    for f in range(membrane.faces.shape[0]):
        rest = membrane.rest_areas[f]
        face_area = scratch.areas[f]
        local_area += face_area - rest - rest * log(face_area / rest)
    stretching *= moduli.ks
    if moduli.neo_hookean != 0 or moduli.skalak != 0:
        stretching += in_plane_energy(
            x, membrane, moduli.neo_hookean, moduli.skalak, moduli.skalak_c
        )
    return (
        stretching,
        moduli.kb / 2 * bending,
        moduli.kal / 2 * local_area,
        moduli.kag / 4 * (area - membrane.rest_area) ** 2 / membrane.rest_area,
        moduli.kv / 2 * (volume - membrane.rest_volume) ** 2 / membrane.rest_volume,
    )
