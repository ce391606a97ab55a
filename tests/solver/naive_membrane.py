"""Slow, literal twins of the membrane kernels."""

import numpy as np


def neighbours(faces):
    """Edge (a, b) → (c, d): faces (a, b, c) and (b, a, d)."""
    sides = {(f[k], f[k - 2]): f[k - 1] for f in faces.tolist() for k in range(3)}
    return {(a, b): (c, sides[b, a]) for (a, b), c in sides.items() if a < b}


def unit_normal(p, q, r):
    n = np.cross(q - p, r - p)
    return n / np.linalg.norm(n)


def dihedral(a, b, c, d):
    n, m = unit_normal(a, b, c), unit_normal(b, a, d)
    convex = np.dot(n, d - a) < 0
    return (1 if convex else -1) * np.arccos(np.clip(n @ m, -1, 1))


def edge_forces(x, v, x0, faces, ks, kvisc):
    force = np.zeros_like(x)
    for a, b in neighbours(faces):
        d, rest = x[b] - x[a], np.linalg.norm(x0[b] - x0[a])
        length = np.linalg.norm(d)
        s = length / rest
        kappa = (s**0.5 + s**-2.5) / (s + s**-3)
        pull = ks * kappa * (length - rest) * d / length
        pull += kvisc * ((v[b] - v[a]) @ d) * d / length**2
        force[a] += pull
        force[b] -= pull
    return force


def bending_forces(x, x0, faces, kb, step=1e-6):
    """Minus the central difference of every edge's own energy."""
    force = np.zeros_like(x)
    for (a, b), (c, d) in neighbours(faces).items():
        corners = [a, b, c, d]
        rest = dihedral(*x0[corners])
        for i in range(4):
            for axis in range(3):
                energy = []
                for sign in (1, -1):
                    y = x[corners]
                    y[i, axis] += sign * step
                    energy.append(kb / 2 * (dihedral(*y) - rest) ** 2)
                force[corners[i], axis] -= (energy[0] - energy[1]) / (2 * step)
    return force


def face_forces(x, x0, faces, kal, kag, kv):
    def area(y, f):
        return np.linalg.norm(np.cross(y[f[1]] - y[f[0]], y[f[2]] - y[f[0]])) / 2

    def volume(y):
        return sum(np.linalg.det(y[f]) for f in faces) / 6

    force = np.zeros_like(x)
    total, rest_total = (sum(area(y, f) for f in faces) for y in (x, x0))
    for f in faces:
        m = x[f].mean(axis=0) - x[f]
        strain = kal * (area(x, f) - area(x0, f)) + kag * (total / rest_total - 1) * area(x, f)
        force[f] += strain * m / np.sum(m**2)
        force[f] -= kv * (volume(x) / volume(x0) - 1) * area(x, f) * unit_normal(*x[f]) / 3
    return force
