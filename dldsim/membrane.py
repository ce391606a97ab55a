"""Elastic and viscous forces of a closed membrane, in the force- and torque-free forms of
Cimrák, Gusenbauer & Jančigová, Comput. Phys. Commun. 185 (2014) 900, and Jančigová & Cimrák,
Int. J. Numer. Methods Biomed. Eng. 32 (2016) e02757, that ESPResSo's object-in-fluid code uses.

Any consistent units. With λ = L/L₀ of an edge, φ the angle between the outward normals of the
two faces of an edge (positive where convex), A a face's area, m_i = centroid − vertex i of a face,
S and V the total area and volume, and ₀ for the rest state:

- stretching k_s: k_s κ(λ) (L − L₀) along the edge, κ = (λ^½ + λ^−5⁄2)/(λ + λ⁻³); its energy is
  the integral over L
- bending k_b: −∇ of k_b (φ − φ₀)²/2
- local area k_α: k_α (A − A₀) m_i / Σ|m|² on vertex i; derives from no energy, see `energies`
- global area k_ag: k_ag (S − S₀)/S₀ · A m_i / Σ|m|² on vertex i; likewise
- volume k_v: −k_v (V − V₀)/V₀ · A n̂/3 on each vertex of a face, which sums to −∇ of
  k_v (V − V₀)²/(2 V₀)
- viscosity k_visc: k_visc [(v_B − v_A)·d] d/|d|² on end A of an edge AB, d = x_B − x_A; nothing
  for rigid motion, translation or rotation


Instead of springs: a neo-Hookean or Skalak membrane, see :mod:`dldsim.finite_element`.

No term exerts a net force or torque.
"""

from math import atan, copysign, cos, log, pi, sin, sqrt
from typing import NamedTuple

import numpy as np

from dldsim import mesh
from dldsim._numba import jit
from dldsim.errors import DldsimError
from dldsim.finite_element import add_neo_hookean_forces, add_skalak_forces, in_plane_energy

ARCTAN_TERMS = 18


class Moduli(NamedTuple):
    """Coefficients in one consistent system of units; a zero skips its term.

    ``neo_hookean``, ``skalak``: surface shear modulus of a continuous membrane, with the latter's
    area constant C.
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
    """Work space of the kernels, and what they leave there.

    area_vectors (F, 3): outward normal of a face times its area; lengths (E), angles (E): edge
    length and φ; cosines (E).
    """

    area_vectors: np.ndarray
    lengths: np.ndarray
    angles: np.ndarray
    cosines: np.ndarray


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
    area, volume = measure_faces(x, topology.faces, scratch.area_vectors)
    if not volume > 0:
        raise DldsimError(
            f"the mesh encloses a volume of {volume}: its faces point inward; flip them"
        )
    measure_edges(x, topology.edges, topology.edge_faces, scratch)
    return Membrane(
        topology.faces, topology.edges, topology.edge_faces, topology.face_edges,
        scratch.lengths, scratch.angles, np.linalg.norm(scratch.area_vectors, axis=1),
        area, volume,
    )  # fmt: skip


def make_scratch(membrane: Membrane | mesh.Topology) -> Scratch:
    """Work space for one membrane; threads need one each."""
    edges = len(membrane.edges)
    return Scratch(
        np.empty((len(membrane.faces), 3)), np.empty(edges), np.empty(edges), np.empty(edges)
    )


def shear_modulus(ks: float) -> float:
    """G_s = √3/4 k_s of a network of equilateral triangles (Seung & Nelson 1988).

    Phys. Rev. A 38, 1005; small strains.
    """
    return sqrt(3) / 4 * ks


def area_modulus(ks: float, kal: float, kag: float) -> float:
    """K = √3/2 k_s + k_α/2 + k_ag/2 of a network of equilateral triangles.

    Springs: Seung & Nelson, Phys. Rev. A 38 (1988) 1005. The area terms follow from their work
    under uniform dilation (see `energies`); k_ag resists only changes of the total area.
    """
    return sqrt(3) / 2 * ks + kal / 2 + kag / 2


def bending_modulus(kb: float) -> float:
    """κ = √3/2 k_b of a network of equilateral triangles bent to a cylinder.

    Seung & Nelson, Phys. Rev. A 38 (1988) 1005; other curvatures see another factor, a sphere
    7.26 k_b of energy instead of 8π κ = 21.8 k_b, since κ_G = −4/3 κ (Gompper & Kroll,
    J. Phys. I France 6 (1996) 1305).
    """
    return sqrt(3) / 2 * kb


@jit
def elastic_forces(x, v, membrane, moduli, scratch, force):
    """Sum of all terms on every vertex, force (V, 3), overwritten.

    x and v (V, 3) are positions and velocities.
    """
    force[:] = 0.0
    if moduli.ks != 0 or moduli.kvisc != 0:
        add_edge_forces(x, v, membrane, moduli.ks, moduli.kvisc, force)
    if moduli.neo_hookean != 0:
        add_neo_hookean_forces(x, membrane, moduli.neo_hookean, force)
    if moduli.skalak != 0:
        add_skalak_forces(x, membrane, moduli.skalak, moduli.skalak_c, force)
    if moduli.kb != 0 or moduli.kal != 0 or moduli.kag != 0 or moduli.kv != 0:
        area, volume = measure_faces(x, membrane.faces, scratch.area_vectors)
    if moduli.kb != 0:
        measure_edges(x, membrane.edges, membrane.edge_faces, scratch)
        add_bending_forces(x, membrane, moduli.kb, scratch, force)
    if moduli.kal != 0 or moduli.kag != 0 or moduli.kv != 0:
        tension = moduli.kag * (area / membrane.rest_area - 1)
        pressure = -moduli.kv * (volume / membrane.rest_volume - 1)
        add_face_forces(x, membrane, moduli.kal, tension, pressure, scratch.area_vectors, force)


@jit
def add_edge_forces(x, v, membrane, ks, kvisc, force):
    """Add stretching and viscous forces of the edges."""
    edges, rest = membrane.edges, membrane.rest_lengths
    for e in range(edges.shape[0]):
        a, b = edges[e, 0], edges[e, 1]
        dx, dy, dz = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2]
        ux, uy, uz = v[b, 0] - v[a, 0], v[b, 1] - v[a, 1], v[b, 2] - v[a, 2]
        length2 = dx * dx + dy * dy + dz * dz
        length = sqrt(length2)
        s = length / rest[e]
        s3 = s * s * s
        kappa = sqrt(s) * (s3 + 1) / (s3 * s + 1)
        pull = ks * kappa * (length - rest[e]) / length
        pull += kvisc * (ux * dx + uy * dy + uz * dz) / length2
        force[a, 0] += pull * dx
        force[a, 1] += pull * dy
        force[a, 2] += pull * dz
        force[b, 0] -= pull * dx
        force[b, 1] -= pull * dy
        force[b, 2] -= pull * dz


@jit
def add_bending_forces(x, membrane, kb, scratch, force):
    """Add −∇ k_b (φ − φ₀)²/2 of every edge; reads scratch as `measure_edges` leaves it.

    In a face of normal n̂, ∇φ of an edge is −n̂/h at the vertex h above it, with the reaction shared
    by the lever rule between the edge's ends. Summed over the edges of a face, p_i = k_b (φ − φ₀)/L
    of the edge opposite vertex i: the force on i is n̂/(2A) Σ_k (p_i − p_j) d_k over the other two
    vertices j, k, where d_k is the dot product of the sides that meet in k.
    """
    faces, face_edges, rest = membrane.faces, membrane.face_edges, membrane.rest_angles
    normals, lengths, angles = scratch.area_vectors, scratch.lengths, scratch.angles
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        i, j, k = face_edges[f, 0], face_edges[f, 1], face_edges[f, 2]
        ax, ay, az = x[c, 0] - x[b, 0], x[c, 1] - x[b, 1], x[c, 2] - x[b, 2]
        bx, by, bz = x[a, 0] - x[c, 0], x[a, 1] - x[c, 1], x[a, 2] - x[c, 2]
        cx, cy, cz = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2]
        nx, ny, nz = normals[f, 0], normals[f, 1], normals[f, 2]
        factor = -0.5 * kb / (nx * nx + ny * ny + nz * nz)
        pa = factor * (angles[i] - rest[i]) / lengths[i]
        pb = factor * (angles[j] - rest[j]) / lengths[j]
        pc = factor * (angles[k] - rest[k]) / lengths[k]
        ab = (pa - pb) * (ax * bx + ay * by + az * bz)
        bc = (pb - pc) * (bx * cx + by * cy + bz * cz)
        ca = (pc - pa) * (cx * ax + cy * ay + cz * az)
        force[a, 0] += (ab - ca) * nx
        force[a, 1] += (ab - ca) * ny
        force[a, 2] += (ab - ca) * nz
        force[b, 0] += (bc - ab) * nx
        force[b, 1] += (bc - ab) * ny
        force[b, 2] += (bc - ab) * nz
        force[c, 0] += (ca - bc) * nx
        force[c, 1] += (ca - bc) * ny
        force[c, 2] += (ca - bc) * nz


@jit
def add_face_forces(x, membrane, kal, tension, pressure, area_vectors, force):
    """Add the forces of local area, of an isotropic tension, and of an inner pressure."""
    faces, rest = membrane.faces, membrane.rest_areas
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        nx, ny, nz = area_vectors[f, 0], area_vectors[f, 1], area_vectors[f, 2]
        area = sqrt(nx * nx + ny * ny + nz * nz)
        gx = (x[a, 0] + x[b, 0] + x[c, 0]) / 3
        gy = (x[a, 1] + x[b, 1] + x[c, 1]) / 3
        gz = (x[a, 2] + x[b, 2] + x[c, 2]) / 3
        ax, ay, az = gx - x[a, 0], gy - x[a, 1], gz - x[a, 2]
        bx, by, bz = gx - x[b, 0], gy - x[b, 1], gz - x[b, 2]
        cx, cy, cz = gx - x[c, 0], gy - x[c, 1], gz - x[c, 2]
        spread = ax * ax + ay * ay + az * az + bx * bx + by * by + bz * bz
        spread += cx * cx + cy * cy + cz * cz
        pull = (kal * (area - rest[f]) + tension * area) / spread
        nx *= pressure / 3
        ny *= pressure / 3
        nz *= pressure / 3
        force[a, 0] += pull * ax + nx
        force[a, 1] += pull * ay + ny
        force[a, 2] += pull * az + nz
        force[b, 0] += pull * bx + nx
        force[b, 1] += pull * by + ny
        force[b, 2] += pull * bz + nz
        force[c, 0] += pull * cx + nx
        force[c, 1] += pull * cy + ny
        force[c, 2] += pull * cz + nz


@jit
def measure_faces(x, faces, area_vectors):
    """Total area and volume; fills area_vectors (F, 3), the outward normal times the area."""
    ox, oy, oz = x[0, 0], x[0, 1], x[0, 2]
    area = 0.0
    volume = 0.0
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, az = x[a, 0], x[a, 1], x[a, 2]
        bx, by, bz = x[b, 0] - ax, x[b, 1] - ay, x[b, 2] - az
        cx, cy, cz = x[c, 0] - ax, x[c, 1] - ay, x[c, 2] - az
        nx = 0.5 * (by * cz - bz * cy)
        ny = 0.5 * (bz * cx - bx * cz)
        nz = 0.5 * (bx * cy - by * cx)
        area_vectors[f, 0] = nx
        area_vectors[f, 1] = ny
        area_vectors[f, 2] = nz
        area += sqrt(nx * nx + ny * ny + nz * nz)
        volume += ((ax - ox) * nx + (ay - oy) * ny + (az - oz) * nz) / 3
    return area, volume


@jit
def measure_edges(x, edges, edge_faces, scratch):
    """Fill lengths (E) and angles (E) in [−π, π], from the area vectors in scratch.

    The second loop is atan2 in a form that vectorises: tan φ/8 by halving the angle twice from
    tan φ/2, then the series of the inverse tangent, good to rounding for |tan φ/8| ≤ √2 − 1.
    """
    normals, lengths = scratch.area_vectors, scratch.lengths
    angles, cosines = scratch.angles, scratch.cosines
    for e in range(edges.shape[0]):
        a, b, f, g = edges[e, 0], edges[e, 1], edge_faces[e, 0], edge_faces[e, 1]
        dx, dy, dz = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2]
        nx, ny, nz = normals[f, 0], normals[f, 1], normals[f, 2]
        mx, my, mz = normals[g, 0], normals[g, 1], normals[g, 2]
        length = sqrt(dx * dx + dy * dy + dz * dz)
        sine = (ny * mz - nz * my) * dx + (nz * mx - nx * mz) * dy + (nx * my - ny * mx) * dz
        lengths[e] = length
        angles[e] = sine / length
        cosines[e] = nx * mx + ny * my + nz * mz
    for e in range(edges.shape[0]):
        sine, cosine = angles[e], cosines[e]
        radius = sqrt(sine * sine + cosine * cosine)
        across = sine if cosine > 0 else copysign(radius - cosine, sine)
        along = radius + cosine if cosine > 0 else abs(sine)
        t = across / (along + sqrt(along * along + across * across))
        t /= 1 + sqrt(1 + t * t)
        series = 0.0
        for k in range(ARCTAN_TERMS - 1, -1, -1):
            series = 1 / (2 * k + 1) - t * t * series
        angles[e] = 8 * t * series


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


def energies(x: np.ndarray, membrane: Membrane, moduli: Moduli) -> Energies:
    """Elastic energy of each term at positions x (V, 3).

    Stretching, bending and volume forces are exactly minus the gradients of these. The area
    forces derive from no energy: k_α (A − A₀) m_i / Σ|m|² = −k_α/2 (A − A₀) ∇ ln Σ|m|², and Σ|m|²
    is a function of A only while the shape of the triangle stays the same. Reported is their
    work under uniform dilation, exact for triangles of any shape: k_α/2 (A − A₀ − A₀ ln(A/A₀)) per
    face, which is k_α (A − A₀)²/(4 A₀) for small strain, and k_ag (S − S₀)²/(4 S₀). The
    energy-consistent forces would be −k_α/2 (1 − A₀/A) ∇A and −k_ag/2 (S − S₀)/S₀ ∇S, equal to the
    ones used where triangles are equilateral.
    """
    return Energies(*energy_terms(x, membrane, moduli, make_scratch(membrane)))


@jit
def energy_terms(x, membrane, moduli, scratch):
    """Energies of stretching, bending, local area, global area and volume."""
    area, volume = measure_faces(x, membrane.faces, scratch.area_vectors)
    measure_edges(x, membrane.edges, membrane.edge_faces, scratch)
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
        n = scratch.area_vectors[f]
        face_area = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
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
