"""The outline of a cell in a picture, and the index that instruments make of it."""

import numpy as np

from dldsim.solver.membrane import Membrane

RAYS = 360
"""Directions from the centre in which the outline is looked for."""


def outline(x: np.ndarray, membrane: Membrane) -> np.ndarray:
    """Radii (RAYS,) of the outline seen along z, from the middle of its box, at even angles.

    ``x`` (V, 3): the vertices. The outline is made of edges between a face that looks up and one
    that looks down; of several in one direction the outermost counts.
    """
    flat = x[:, :2] - (x[:, :2].max(axis=0) + x[:, :2].min(axis=0)) / 2
    a, b, c = (flat[membrane.faces[:, k]] for k in range(3))
    up = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    pair = up[membrane.edge_faces]
    p, q = (flat[ends] for ends in membrane.edges[pair[:, 0] * pair[:, 1] <= 0].T)
    angles = np.arange(RAYS) * 2 * np.pi / RAYS
    along, across = (
        np.array([np.cos(angles), np.sin(angles)]),
        np.array([-np.sin(angles), np.cos(angles)]),
    )
    left, right = p @ across, q @ across
    crosses = (left * right <= 0) & (left != right)
    share = np.divide(left, left - right, where=crosses, out=np.zeros_like(left))
    radii = (1 - share) * (p @ along) + share * (q @ along)
    return np.where(crosses, radii, 0.0).max(axis=0)


def circularity(radii: np.ndarray) -> float:
    """2 √(π A)/P of an outline by its radii at even angles, 1 for a circle: as instruments of
    real-time deformability cytometry report it (Otto et al. 2015, Nat. Methods 12:199)."""
    following, step = np.roll(radii, -1), 2 * np.pi / len(radii)
    area = radii @ following * np.sin(step) / 2
    chords = np.sqrt(radii**2 + following**2 - 2 * radii * following * np.cos(step))
    return float(2 * np.sqrt(np.pi * area) / chords.sum())
