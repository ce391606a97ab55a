"""What is kept of a run while it goes on."""

from dataclasses import dataclass, field

import numpy as np

from dldsim.solver.observe import Sample, deformation_index
from dldsim.solver.units import Units


@dataclass
class Record:
    """Samples of a run, turned into the columns of a table at the end."""

    run_id: str
    units: Units
    origin: np.ndarray
    samples: list = field(default_factory=list)
    energies: list = field(default_factory=list)

    def add(self, sample: Sample, energies) -> None:
        self.samples.append(sample)
        self.energies.append(energies)

    def column(self, name: str) -> np.ndarray:
        return np.array([getattr(s, name) for s in self.samples])

    def positions_um(self) -> np.ndarray:
        """Centres (samples, 3) [µm] from the origin."""
        return (self.column("centre") - self.origin) * self.units.spacing_um

    def extents_um(self) -> np.ndarray:
        """Bounding boxes (samples, 3) [µm]."""
        return self.column("extent") * self.units.spacing_um

    def time_and_place(self) -> dict[str, np.ndarray]:
        """Columns that every trajectory table has."""
        x, y, z = self.positions_um().T
        return {
            "run_id": np.full(len(self.samples), self.run_id),
            "step": self.column("step"),
            "t_ms": self.column("step") * self.units.time_step_us / 1e3,
            "x_um": x,
            "y_um": y,
            "z_um": z,
        }

    def trajectory(self) -> dict[str, np.ndarray]:
        """Columns of the `trajectory` table."""
        dx, dy, _ = self.extents_um().T
        index, a, b = deformation_index(dx, dy)
        v = self.units.velocity_from_lu(self.column("velocity"))
        energy = self.units.energy_aJ(np.array(self.energies))
        terms = ("stretching", "bending", "local_area", "global_area", "volume")
        return {
            **self.time_and_place(),
            **{f"v{axis}_mm_s": v[:, d] for d, axis in enumerate("xyz")},
            "deformation_index": index,
            "axis_a_um": a,
            "axis_b_um": b,
            "volume_ratio": self.column("volume_ratio"),
            "area_ratio": self.column("area_ratio"),
            "clearance_um": self.column("clearance") * self.units.spacing_um,
            **{f"energy_{term}_aJ": energy[:, k] for k, term in enumerate(terms)},
        }
