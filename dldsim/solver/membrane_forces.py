"""Elastic and viscous forces of a closed membrane, in the force- and torque-free forms of
Cimrák, Gusenbauer & Jančigová, Comput. Phys. Commun. 185 (2014) 900, and Jančigová & Cimrák,
Int. J. Numer. Methods Biomed. Eng. 32 (2016) e02757, that ESPResSo's object-in-fluid code uses.

Any consistent units. With λ = L/L₀ of an edge, φ the angle between the outward normals of the
two faces of an edge (positive where convex), A a face's area, m_i = centroid − vertex i of a face,
S and V the total area and volume, and ₀ for the rest state:

- stretching k_s: k_s κ(λ) (L − L₀) along the edge, κ = (λ^½ + λ^−5⁄2)/(λ + λ⁻³); its energy is
  the integral over L
- bending k_b: −∇ of k_b (φ − φ₀)²/2; less in faces about to vanish, see `tense_edges`
- local area k_α: k_α (A − A₀) m_i / Σ|m|² on vertex i; derives from no energy, see
  `membrane.energies`
- global area k_ag: k_ag (S − S₀)/S₀ · A m_i / Σ|m|² on vertex i; likewise
- both, where isotropic: −∇A in place of 2A m_i / Σ|m|², minus the gradient of an energy
- volume k_v: −k_v (V − V₀)/V₀ · A n̂/3 on each vertex of a face, which sums to −∇ of
  k_v (V − V₀)²/(2 V₀)
- viscosity k_visc: k_visc [(v_B − v_A)·d] d/|d|² on end A of an edge AB, d = x_B − x_A; nothing
  for rigid motion, translation or rotation

Instead of springs: a neo-Hookean or Skalak membrane, see :mod:`dldsim.solver.hyperelastic`.

No term exerts a net force or torque.
"""

from math import copysign, pi, sqrt

from dldsim.solver.hyperelastic import add_neo_hookean_forces, add_skalak_forces
from dldsim.solver.jit import jit, restrict

ARCTAN_TERMS = 18
VANISHING = 0.1
"""Part of an equilateral triangle's area over an edge at rest, below which bending is let go."""


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
    to_centroid = 0.0 if moduli.isotropic else 1.0
    load_corners(membrane, to_centroid * moduli.kal, to_centroid * tension, pressure, scratch)
    if moduli.isotropic:
        add_isotropic_tension(membrane, moduli.kal, tension, scratch)
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
def add_isotropic_tension(membrane, kal, tension, scratch):
    """Add to corners what the tension σ of each face, k_α (A − A₀)/(2A) and half of the whole
    membrane's, does to its vertices: −σ∇A.

    ∇A has of every side half the cotangent of the angle opposite (Pinkall & Polthier 1993, Exp.
    Math. 2:15), which is −d/(2A), d the dot product of the other two sides.
    """
    ax, ay, az, bx, by, bz, cx, cy, cz = scratch.sides
    fx, fy, fz = scratch.corners
    rest, areas = membrane.rest_areas, scratch.areas
    for f in range(len(scratch.face_edge[0])):
        sax, say, saz, sbx, sby, sbz = ax[f], ay[f], az[f], bx[f], by[f], bz[f]
        scx, scy, scz, area = cx[f], cy[f], cz[f], areas[f]
        factor = -(kal * (area - rest[f]) + tension * area) / (8 * area * area)
        pa = factor * (sbx * scx + sby * scy + sbz * scz)
        pb = factor * (scx * sax + scy * say + scz * saz)
        pc = factor * (sax * sbx + say * sby + saz * sbz)
        ux, uy, uz = pa * sax, pa * say, pa * saz
        vx, vy, vz = pb * sbx, pb * sby, pb * sbz
        wx, wy, wz = pc * scx, pc * scy, pc * scz
        fx[3 * f] += wx - vx
        fx[3 * f + 1] += ux - wx
        fx[3 * f + 2] += vx - ux
        fy[3 * f] += wy - vy
        fy[3 * f + 1] += uy - wy
        fy[3 * f + 2] += vy - uy
        fz[3 * f] += wz - vz
        fz[3 * f + 1] += uz - wz
        fz[3 * f + 2] += vz - uz


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
