"""Nodes of a lattice, as tests look at them."""

import numpy as np

UP = np.array([1.0, 1.0, -1.0])
"""Vectors times this are those of their images beyond a mirror."""


def nodes_of(array, lattice):
    """View (components, columns, nz) of a flat array of populations or vectors."""
    field = array.reshape(-1, lattice.stride)[:, : lattice.nodes]
    return field.reshape(-1, lattice.columns, lattice.nz)


def node_positions(lattice):
    """Positions of all nodes, as `nodes_of` has them: (3, columns, nz)."""
    ix, iy = np.nonzero(lattice.column >= 0)
    x, z = np.broadcast_arrays(ix[:, None] + 0.5, np.arange(lattice.nz) + 0.5)
    return np.stack([x, np.broadcast_to(iy[:, None] + 0.5, x.shape), z])
