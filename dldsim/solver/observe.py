"""What is seen of a cell in a fluid, and when a run has left its safe range. Lattice units.

Thresholds are far from what sound runs reach, given with each for the 178 settled and undecided
runs of the campaign that comes with the package: what passes them is broken, not merely inexact.
"""

from dataclasses import dataclass

import numpy as np

from dldsim.solver.jit import jit

SPEED_LIMIT = 0.35
"""Of the fluid, Mach 0.6 (sound runs: 0.05, Mach 0.09). A run may start at 0.2
(`time_step.LARGEST_SPEED`), which a cell in a gap has been seen to raise by 1.7."""
DEPTH_LIMIT = 1.0
"""Of a vertex in a solid, nodes (sound runs: none inside). So deep its kernel hardly reaches fluid
that could move it."""
VOLUME_DRIFT_LIMIT = 0.2
"""Of the volume at rest (sound runs: 0.023). The membrane is impermeable but for numerical leakage;
a cell that has lost a fifth is another cell."""
AREA_DRIFT_LIMIT = 0.5
"""Of the area at rest (sound runs: 0.03, in a throat 0.1). Red cells rupture near 0.04
(literature), but how far a membrane of soft moduli stretches is a result."""
INVERTED_LIMIT = 0.05
"""Share of faces turned against their neighbours (sound runs: 0.007, in sharp folds). A crumpled
membrane may keep area and volume."""


@jit
def fastest(velocity, nodes):
    """Largest speed on the fluid nodes; NaN if any velocity is not finite."""
    stride = len(velocity) // 3
    most = 0.0
    for i in range(nodes):
        u, v, w = velocity[i], velocity[stride + i], velocity[2 * stride + i]
        speed2 = u * u + v * v + w * w
        if not speed2 < 1e30:
            return np.nan
        most = max(most, speed2)
    return np.sqrt(most)


@jit
def centroid(x, faces, centre):
    """Centroid of the enclosed volume."""
    total = 0.0
    centre[:] = 0.0
    for n in range(faces.shape[0]):
        a, b, c = faces[n, 0], faces[n, 1], faces[n, 2]
        ax, ay, az = x[a, 0] - x[0, 0], x[a, 1] - x[0, 1], x[a, 2] - x[0, 2]
        bx, by, bz = x[b, 0] - x[0, 0], x[b, 1] - x[0, 1], x[b, 2] - x[0, 2]
        cx, cy, cz = x[c, 0] - x[0, 0], x[c, 1] - x[0, 1], x[c, 2] - x[0, 2]
        part = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
        total += part
        centre[0] += part * (ax + bx + cx)
        centre[1] += part * (ay + by + cy)
        centre[2] += part * (az + bz + cz)
    for d in range(3):
        centre[d] = x[0, d] + centre[d] / (4.0 * total)


@jit
def inverted_faces(normals, membrane):
    """Number of faces whose normal points against those of all three neighbours."""
    count = 0
    nx, ny, nz = normals
    for f in range(len(nx)):
        against = 0
        for k in range(3):
            pair = membrane.edge_faces[membrane.face_edges[f, k]]
            g = pair[0] + pair[1] - f
            against += nx[f] * nx[g] + ny[f] * ny[g] + nz[f] * nz[g] < 0
        count += against == 3
    return count


def deformation_index(extent_x, extent_y):
    """DI = (a - b)/(a + b) of the bounding box of the profile seen along z, and a, b."""
    a, b = np.maximum(extent_x, extent_y), np.minimum(extent_x, extent_y)
    return (a - b) / (a + b), a, b


@dataclass(frozen=True)
class Sample:
    """What is recorded of a cell at one instant; lattice units.

    ``inverted``: share of the faces that are turned against all three neighbours.
    """

    step: int
    centre: np.ndarray
    velocity: np.ndarray
    extent: np.ndarray
    volume_ratio: float
    area_ratio: float
    clearance: float
    speed_max: float
    mean_velocity: np.ndarray
    inverted: float = 0.0

    def trouble(self) -> str | None:
        """Why the run has left its safe range, or None."""
        if not np.isfinite([*self.centre, self.speed_max, self.volume_ratio]).all():
            return "a value is not finite"
        if self.speed_max > SPEED_LIMIT:
            return f"fluid speed {self.speed_max:.2f} exceeds {SPEED_LIMIT:g} (lattice units)"
        if self.clearance < -DEPTH_LIMIT:
            return f"a vertex is {-self.clearance:.1f} nodes inside a solid"
        if abs(self.volume_ratio - 1) > VOLUME_DRIFT_LIMIT:
            return f"cell volume drifted by {self.volume_ratio - 1:+.0%}"
        if abs(self.area_ratio - 1) > AREA_DRIFT_LIMIT:
            return f"cell area drifted by {self.area_ratio - 1:+.0%}"
        if self.inverted > INVERTED_LIMIT:
            return f"{self.inverted:.0%} of the membrane's faces are inverted"
        return None
