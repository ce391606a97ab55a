"""Elastic and viscous forces of a closed membrane, in the force- and torque-free forms of
Cimrák, Gusenbauer & Jančigová, Comput. Phys. Commun. 185 (2014) 900, and Jančigová & Cimrák,
Int. J. Numer. Methods Biomed. Eng. 32 (2016) e02757, that ESPResSo's object-in-fluid code uses.

Any consistent units. With λ = L/L₀ of an edge, φ the angle between the outward normals of the
two faces of an edge (positive where convex), A a face's area, m_i = centroid − vertex i of a face,
S and V the total area and volume, and ₀ for the rest state:

- stretching k_s: k_s κ(λ) (L − L₀) along the edge, κ = (λ^½ + λ^−5⁄2)/(λ + λ⁻³); its energy is
  the integral over L
- bending k_b: −∇ of k_b (φ − φ₀)²/2; less in faces about to vanish, see `tense_edges`
- local area k_α: k_α (A − A₀) m_i / Σ|m|² on vertex i; derives from no energy, see `energies`
- global area k_ag: k_ag (S − S₀)/S₀ · A m_i / Σ|m|² on vertex i; likewise
- volume k_v: −k_v (V − V₀)/V₀ · A n̂/3 on each vertex of a face, which sums to −∇ of
  k_v (V − V₀)²/(2 V₀)
- viscosity k_visc: k_visc [(v_B − v_A)·d] d/|d|² on end A of an edge AB, d = x_B − x_A; nothing
  for rigid motion, translation or rotation


Instead of springs: a neo-Hookean or Skalak membrane, see :mod:`dldsim.solver.hyperelastic`.

No term exerts a net force or torque.
"""

from math import atan, copysign, cos, log, pi, sin, sqrt
from typing import NamedTuple

import numpy as np

from dldsim.errors import DldsimError
from dldsim.solver import mesh
from dldsim.solver.hyperelastic import add_neo_hookean_forces, add_skalak_forces, in_plane_energy
from dldsim.solver.jit import aligned_zeros, jit, restrict

ARCTAN_TERMS = 18
VANISHING = 0.1
"""Part of an equilateral triangle's area over an edge at rest, below which bending is let go."""


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
    """Who meets whom, work space of the kernels, and what they leave there.

        One array per component, so that loops vectorise.

        - corner_vertex: 3 arrays (F), edge_vertex: 2 arrays (E): vertices times 3, the place of x
        - edge_face: 2 arrays (E); face_edge: 3 arrays (F), opposite to each vertex
        - vertex_corner (K, V): corners 3 f + k that meet in a vertex, filled up with 3 F
        - sides: x, y, z (F) of the side opposite to a face's first vertex, then second, then third
        - normals: x, y, z (F) of the outward normal times the area; areas (F)
        - directions: x, y, z (E) from first to second vertex; lengths (E), angles (E): φ
    - smaller (E): squared area of the smaller face of an edge
        - pulls, twists (E): see `tense_edges`
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


@jit
def elastic_forces(x, v, membrane, moduli, scratch, force):
    """Sum of all terms on every vertex, force (V, 3), overwritten.

    x and v (V, 3) are positions and velocities. No loop writes to what another entry of it may
    write to, so that all vectorise: edges and faces leave their share, vertices collect it.
    """
    area, volume = measure_faces(x, scratch)
    if moduli.ks != 0 or moduli.kvisc != 0 or moduli.kb != 0:
        measure_edges(x, scratch)
        tense_edges(v, membrane, moduli, scratch)
    else:
        scratch.pulls[:] = 0.0
        scratch.twists[:] = 0.0
    tension = moduli.kag * (area / membrane.rest_area - 1)
    pressure = -moduli.kv * (volume / membrane.rest_volume - 1)
    load_corners(membrane, moduli.kal, tension, pressure, scratch)
    collect_corners(scratch, force)
    if moduli.neo_hookean != 0:
        add_neo_hookean_forces(x, membrane, moduli.neo_hookean, force)
    if moduli.skalak != 0:
        add_skalak_forces(x, membrane, moduli.skalak, moduli.skalak_c, force)


@restrict
def measure_faces(x, scratch):
    """Total area and volume; fills sides, normals and areas of scratch."""
    ax, ay, az, bx, by, bz, cx, cy, cz = scratch.sides
    nx, ny, nz = scratch.normals
    areas, share = scratch.areas, scratch.face_share
    first, second, third = scratch.corner_vertex
    x = x.reshape(x.size)
    ox, oy, oz = x[0], x[1], x[2]
    area = 0.0
    volume = 0.0
    for f in range(len(areas)):
        a, b, c = first[f], second[f], third[f]
        px, py, pz = x[a], x[a + 1], x[a + 2]
        ux, uy, uz = x[b] - px, x[b + 1] - py, x[b + 2] - pz
        vx, vy, vz = px - x[c], py - x[c + 1], pz - x[c + 2]
        mx = 0.5 * (uz * vy - uy * vz)
        my = 0.5 * (ux * vz - uz * vx)
        mz = 0.5 * (uy * vx - ux * vy)
        size = sqrt(mx * mx + my * my + mz * mz)
        ax[f], ay[f], az[f] = -ux - vx, -uy - vy, -uz - vz
        bx[f], by[f], bz[f] = vx, vy, vz
        cx[f], cy[f], cz[f] = ux, uy, uz
        nx[f], ny[f], nz[f] = mx, my, mz
        areas[f] = size
        area += share[f] * size
        volume += share[f] * ((px - ox) * mx + (py - oy) * my + (pz - oz) * mz)
    return area, volume / 3


@restrict
def measure_edges(x, scratch):
    """Fill directions, lengths, angles (E) in [−π, π] and smaller, from the normals in scratch.

    The angle is atan2 in a form that vectorises: tan φ/4, for an angle beyond π/2 that of its
    supplement, by halving twice, then the series of the inverse tangent, good to rounding for
    |tan φ/4| ≤ √2 − 1.
    """
    nx, ny, nz = scratch.normals
    dx, dy, dz = scratch.directions
    lengths, angles, smaller = scratch.lengths, scratch.angles, scratch.smaller
    first, second = scratch.edge_vertex
    right, left = scratch.edge_face
    x = x.reshape(x.size)
    for e in range(len(lengths)):
        a, b, f, g = first[e], second[e], right[e], left[e]
        ux, uy, uz = x[b] - x[a], x[b + 1] - x[a + 1], x[b + 2] - x[a + 2]
        px, py, pz, qx, qy, qz = nx[f], ny[f], nz[f], nx[g], ny[g], nz[g]
        length = sqrt(ux * ux + uy * uy + uz * uz)
        sine = (py * qz - pz * qy) * ux + (pz * qx - px * qz) * uy + (px * qy - py * qx) * uz
        cosine = length * (px * qx + py * qy + pz * qz)
        radius = sqrt(sine * sine + cosine * cosine)
        along = radius + abs(cosine)
        t = sine / (along + sqrt(2 * radius * along))
        u = t * t
        series = 0.0
        for k in range(ARCTAN_TERMS - 1, -1, -1):
            series = 1 / (2 * k + 1) - u * series
        angle = 4 * t * series
        smaller[e] = min(px * px + py * py + pz * pz, qx * qx + qy * qy + qz * qz)
        dx[e], dy[e], dz[e] = ux, uy, uz
        lengths[e] = length
        angles[e] = angle if cosine > 0 else copysign(pi, sine) - angle


@restrict
def tense_edges(v, membrane, moduli, scratch):
    """Fill pulls and twists (E): the part of each of the two faces in stretching and viscosity,
    as a factor of the edge's direction, and k_b (φ − φ₀)/L.

    κ of an edge in terms of L and L₀: √(L L₀) (L³ + L₀³)/(L⁴ + L₀⁴).

    The force of bending on the vertex of a face is inverse to its height, which in a sharp fold may
    pass through zero; no time step resolves that. Both faces of an edge are therefore relieved as
    the area of the smaller, squared, once that is VANISHING of what it should be. What they bear
    stays free of net force and torque.
    """
    rest, flat, smaller = membrane.rest_lengths, membrane.rest_angles, scratch.smaller
    floor = (VANISHING * sqrt(3) / 4) ** 2
    dx, dy, dz = scratch.directions
    lengths, angles, pulls, twists = scratch.lengths, scratch.angles, scratch.pulls, scratch.twists
    ks, kvisc, kb = 0.5 * moduli.ks, 0.5 * moduli.kvisc, moduli.kb
    first, second = scratch.edge_vertex
    v = v.reshape(v.size)
    for e in range(len(lengths)):
        a, b = first[e], second[e]
        along = (v[b] - v[a]) * dx[e] + (v[b + 1] - v[a + 1]) * dy[e]
        along += (v[b + 2] - v[a + 2]) * dz[e]
        now, r = lengths[e], rest[e]
        now3, r3 = now * now * now, r * r * r
        sum4 = now3 * now + r3 * r
        inverse = 1 / (sum4 * now * now)
        pull = ks * sqrt(now * r) * (now3 + r3) * (now - r) * now
        pulls[e] = (pull + kvisc * along * sum4) * inverse
        relief = min(1.0, smaller[e] / (floor * r3 * r))
        twists[e] = kb * (angles[e] - flat[e]) * relief * (sum4 * now * inverse)


@restrict
def load_corners(membrane, kal, tension, pressure, scratch):
    """Fill corners: the forces of each face, and of its sides, on its vertices.

    Local area, isotropic tension and inner pressure; from the sides pulls and bending. In a face
    of normal n̂, ∇φ of an edge is −n̂/h at the vertex h above it, with the reaction shared by the
    lever rule between the edge's ends. Summed over the edges of a face, p_i = k_b (φ − φ₀)/L of
    the edge opposite vertex i: the force on i is n̂/(2A) Σ_k (p_i − p_j) d_k over the other two
    vertices j, k, where d_k is the dot product of the sides that meet in k.
    """
    ax, ay, az, bx, by, bz, cx, cy, cz = scratch.sides
    nx, ny, nz = scratch.normals
    fx, fy, fz = scratch.corners
    rest, areas, pulls, twists = (membrane.rest_areas, scratch.areas, scratch.pulls, scratch.twists)
    first, second, third = scratch.face_edge
    for f in range(len(first)):
        i, j, k = first[f], second[f], third[f]
        sax, say, saz, sbx, sby, sbz = ax[f], ay[f], az[f], bx[f], by[f], bz[f]
        scx, scy, scz, mx, my, mz, area = cx[f], cy[f], cz[f], nx[f], ny[f], nz[f], areas[f]
        dab = sax * sbx + say * sby + saz * sbz
        dbc = sbx * scx + sby * scy + sbz * scz
        dca = scx * sax + scy * say + scz * saz
        # Σ|m|² is a third of the sum of the squared sides, and these add up to -2 (dab + dbc + dca)
        area2, spread = area * area, -2 * (dab + dbc + dca)
        inverse = 1 / (area2 * spread)
        swell = (kal * (area - rest[f]) + tension * area) * area2 * inverse
        factor = -0.5 * spread * inverse
        pa, pb, pc = factor * twists[i], factor * twists[j], factor * twists[k]
        ab, bc, ca = (pa - pb) * dab, (pb - pc) * dbc, (pc - pa) * dca
        push = pressure / 3
        na, nb, nc = ab - ca + push, bc - ab + push, ca - bc + push
        pa, pb, pc = swell + pulls[i], swell + pulls[j], swell + pulls[k]
        ux, uy, uz = pa * sax, pa * say, pa * saz
        vx, vy, vz = pb * sbx, pb * sby, pb * sbz
        wx, wy, wz = pc * scx, pc * scy, pc * scz
        fx[3 * f], fx[3 * f + 1], fx[3 * f + 2] = (
            wx - vx + na * mx,
            ux - wx + nb * mx,
            vx - ux + nc * mx,
        )
        fy[3 * f], fy[3 * f + 1], fy[3 * f + 2] = (
            wy - vy + na * my,
            uy - wy + nb * my,
            vy - uy + nc * my,
        )
        fz[3 * f], fz[3 * f + 1], fz[3 * f + 2] = (
            wz - vz + na * mz,
            uz - wz + nb * mz,
            vz - uz + nc * mz,
        )


@restrict
def collect_corners(scratch, force):
    """Sum the corners that meet in each vertex, force (V, 3), overwritten."""
    fx, fy, fz = scratch.corners
    at = scratch.vertex_corner
    force = force.reshape(force.size)
    for v in range(at.shape[1]):
        a, b, c, d, e, f = at[0, v], at[1, v], at[2, v], at[3, v], at[4, v], at[5, v]
        force[3 * v] = fx[a] + fx[b] + fx[c] + fx[d] + fx[e] + fx[f]
        force[3 * v + 1] = fy[a] + fy[b] + fy[c] + fy[d] + fy[e] + fy[f]
        force[3 * v + 2] = fz[a] + fz[b] + fz[c] + fz[d] + fz[e] + fz[f]
    for k in range(6, at.shape[0]):
        for v in range(at.shape[1]):
            force[3 * v] += fx[at[k, v]]
            force[3 * v + 1] += fy[at[k, v]]
            force[3 * v + 2] += fz[at[k, v]]


def vertex_areas(membrane: Membrane) -> np.ndarray:
    """Area of membrane at rest that each vertex stands for (V,): a third of the faces around it."""
    loaded = membrane.faces[: len(membrane.face_edges)]
    areas = np.broadcast_to(membrane.rest_areas[:, None] / 3, loaded.shape)
    return np.bincount(loaded.ravel(), areas.ravel(), int(membrane.faces.max()) + 1)


@restrict
def vertex_normals(scratch, normal):
    """Sum over the faces that meet in a vertex of their outward normals times area, normal (L, 3),
    overwritten; from the normals in scratch."""
    nx, ny, nz = scratch.normals
    normal = normal.reshape(normal.size)
    normal[:] = 0.0
    for corner in scratch.corner_vertex:
        for f in range(len(nx)):
            v = corner[f]
            normal[v] += nx[f]
            normal[v + 1] += ny[f]
            normal[v + 2] += nz[f]


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

    Stretching, bending and volume forces are exactly minus the gradients of these. The area
    forces derive from no energy: k_α (A − A₀) m_i / Σ|m|² = −k_α/2 (A − A₀) ∇ ln Σ|m|², and Σ|m|²
    is a function of A only while the shape of the triangle stays the same. Reported is their
    work under uniform dilation, exact for triangles of any shape: k_α/2 (A − A₀ − A₀ ln(A/A₀)) per
    face, which is k_α (A − A₀)²/(4 A₀) for small strain, and k_ag (S − S₀)²/(4 S₀). The
    energy-consistent forces would be −k_α/2 (1 − A₀/A) ∇A and −k_ag/2 (S − S₀)/S₀ ∇S, equal to the
    ones used where triangles are equilateral.
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
