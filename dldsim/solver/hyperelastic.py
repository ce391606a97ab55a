"""In-plane forces of a thin hyperelastic membrane: linear triangles of constant strain.

After Charrier, Shrivastava & Wu, J. Strain Anal. 24 (1989) 55, and Shrivastava & Tang, ibid. 28
(1993) 31. No rotation into a common plane is needed: a triangle with sides p, q from one corner has
the metric g = (p·p, p·q, q·q), and with the rest metric G the invariants of its deformation are

    T = λ₁² + λ₂² = tr(G⁻¹ g),    D = λ₁² λ₂² = det g / det G.

Its energy is A₀ w(T, D), in any consistent units, with the surface shear modulus G_s:

- neo-Hookean w = G_s/2 (T + 1/D − 3); isotropic tension G_s (1 − λ⁻⁶), area modulus K_s = 3 G_s
- Skalak w = G_s/4 (I₁² + 2 I₁ − 2 I₂ + C I₂²) with I₁ = T − 2, I₂ = D − 1 (Skalak et al.,
  Biophys. J. 13 (1973) 245); isotropic tension G_s (λ² − 1)(1 + C λ² (λ² + 1)), K_s = (1 + 2C) G_s

Minus its gradient at the end of p is −[(w_T G₂₂ + w_D g₂₂) p − (w_T G₁₂ + w_D g₁₂) q]/(2 A₀), and
likewise at the end of q. The rest metric comes from the rest lengths of the membrane's edges.
"""

from math import sqrt

from dldsim.solver.jit import jit


@jit
def rest_metric(membrane, f):
    """G₁₁, G₁₂, G₂₂ of face f for the sides from its first to its second and third vertex."""
    lengths, edges = membrane.rest_lengths, membrane.face_edges
    opposite, second, first = lengths[edges[f, 0]], lengths[edges[f, 1]], lengths[edges[f, 2]]
    a, b = first * first, second * second
    return a, 0.5 * (a + b - opposite * opposite), b


@jit
def metric(x, faces, f):
    """g₁₁, g₁₂, g₂₂ of face f for the sides from its first to its second and third vertex."""
    a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
    px, py, pz = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2]
    qx, qy, qz = x[c, 0] - x[a, 0], x[c, 1] - x[a, 1], x[c, 2] - x[a, 2]
    return px * px + py * py + pz * pz, px * qx + py * qy + pz * qz, qx * qx + qy * qy + qz * qz


@jit
def invariants(rest, now):
    """T, D and det G from the metrics at rest and now."""
    det = rest[0] * rest[2] - rest[1] * rest[1]
    trace = (rest[2] * now[0] - 2 * rest[1] * now[1] + rest[0] * now[2]) / det
    return trace, (now[0] * now[2] - now[1] * now[1]) / det, det


@jit
def add_stress(x, faces, f, m11, m12, m22, force):
    """Add the forces of face f, given (w_T G + w_D g)/(2 A₀)."""
    a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
    for d in range(3):
        p, q = x[b, d] - x[a, d], x[c, d] - x[a, d]
        at_b, at_c = m12 * q - m22 * p, m12 * p - m11 * q
        force[b, d] += at_b
        force[c, d] += at_c
        force[a, d] -= at_b + at_c


@jit
def add_neo_hookean_forces(x, membrane, modulus, force):
    """Add the forces of a neo-Hookean membrane of surface shear modulus G_s; x, force (V, 3)."""
    for f in range(membrane.faces.shape[0]):
        rest, now = rest_metric(membrane, f), metric(x, membrane.faces, f)
        _, area2, det = invariants(rest, now)
        by_trace = 0.5 * modulus / sqrt(det)
        by_area = -by_trace / (area2 * area2)
        add_stress(
            x,
            membrane.faces,
            f,
            by_trace * rest[0] + by_area * now[0],
            by_trace * rest[1] + by_area * now[1],
            by_trace * rest[2] + by_area * now[2],
            force,
        )


@jit
def add_skalak_forces(x, membrane, modulus, c, force):
    """Add the forces of a Skalak membrane, G_s and area constant C; x, force (V, 3)."""
    for f in range(membrane.faces.shape[0]):
        rest, now = rest_metric(membrane, f), metric(x, membrane.faces, f)
        trace, area2, det = invariants(rest, now)
        half = 0.5 * modulus / sqrt(det)
        by_trace = half * (trace - 1)
        by_area = half * (c * (area2 - 1) - 1)
        add_stress(
            x,
            membrane.faces,
            f,
            by_trace * rest[0] + by_area * now[0],
            by_trace * rest[1] + by_area * now[1],
            by_trace * rest[2] + by_area * now[2],
            force,
        )


@jit
def in_plane_energy(x, membrane, neo_hookean, skalak, c):
    """Energy of both laws, given the surface shear modulus of each and Skalak's C."""
    energy = 0.0
    for f in range(membrane.faces.shape[0]):
        trace, area2, det = invariants(rest_metric(membrane, f), metric(x, membrane.faces, f))
        i1, i2 = trace - 2, area2 - 1
        density = 0.5 * neo_hookean * (trace + 1 / area2 - 3)
        density += 0.25 * skalak * (i1 * i1 + 2 * i1 - 2 * i2 + c * i2 * i2)
        energy += 0.5 * sqrt(det) * density
    return energy
