"""What the periodic images of a cell do to the flow that it meets."""

import numpy as np

SMEARED = 1 / 6
"""Width to which cells are smeared, over the distance of the nearest image: what another one feels
of it is less than 1e-7."""
REACH = 6.0
"""Waves up to this number over the width are summed; what is left out is less than 1e-7."""


def images_share(along, across, mobility) -> np.ndarray:
    """Part L (2, 2) of what the cells of all domains do to the mean velocity that the images do at
    the place of a cell.

    ``along``, ``across`` (2,): from a cell to its images, in any unit; ``mobility`` K (2, 2): mean
    velocity per force density of the medium without cells. Seen from far away a cell is a dipole
    of the Darcy flow: it adds s to the velocity where it is, and pressure makes the sum free of
    divergence. Per wave vector k that leaves s - K k (k s)/(k K k), of all s at k = 0, the mean.
    What a lattice of cells has at each of them, less what one alone has at its own place, is the
    images': L = 1/2 + Σ [1/2 - K k k/(k K k)] over k ≠ 0, since one alone has 1/2 per wave in the
    mean over all directions. The trace is 1 for every lattice (the Lorentz field of dipoles in the
    plane), and L is 1/2 where it is square and K isotropic; where rows are shifted it is neither.
    """
    values, vectors = np.linalg.eigh((np.asarray(mobility) + np.transpose(mobility)) / 2)
    root = (vectors * np.sqrt(values)) @ vectors.T
    lattice = np.array([along, across], float) @ np.linalg.inv(root)  # K is isotropic there
    waves = 2 * np.pi * np.linalg.inv(lattice).T
    count = np.arange(-20, 21)
    images = np.stack(np.meshgrid(count, count), axis=-1).reshape(-1, 2) @ lattice
    distances = np.hypot(*images.T)
    width = SMEARED * distances[distances > 0].min()
    most = np.ceil(REACH / width * np.hypot(*lattice.T) / (2 * np.pi)).astype(int)
    numbers = np.meshgrid(*(np.arange(-n, n + 1) for n in most))
    k = np.stack(numbers, axis=-1).reshape(-1, 2)
    k = k[np.any(k != 0, axis=1)] @ waves
    square = np.einsum("ki,ki->k", k, k)
    weight = np.exp(-square * width**2 / 2)
    along_k = np.einsum("k,ki,kj->ij", weight / square, k, k)
    return root @ (np.eye(2) * (1 + weight.sum()) / 2 - along_k) @ np.linalg.inv(root)
