"""Conversion between physical and lattice units, in one place.

A run keeps the capillary number μU/k_s and all length ratios of the physical cell; its velocity and
viscosity in lattice units are numerical choices. Every elastic or viscous surface coefficient is
therefore converted relative to the viscous scale μU, and time by advection (Δx·U_lu/U).
"""

from dataclasses import dataclass

from dldsim.config.sections import Flow, Numerics, Stiffness
from dldsim.laws import viscosity

_MICRO, _MILLI, _NANO, _PICO, _ATTO = 1e-6, 1e-3, 1e-9, 1e-12, 1e-18


@dataclass(frozen=True)
class Units:
    """Scales of one run: spacing [µm], velocities (physical [mm/s], lattice) and viscosities."""

    spacing_um: float
    velocity_mm_s: float
    velocity_lu: float
    viscosity_mPa_s: float
    viscosity_lu: float

    @classmethod
    def of(cls, spacing_um: float, flow: Flow, numerics: Numerics) -> "Units":
        return cls(
            spacing_um,
            flow.mean_velocity_mm_s,
            numerics.velocity_lu,
            flow.viscosity_mPa_s,
            viscosity(numerics.relaxation_time),
        )

    @property
    def time_step_us(self) -> float:
        """Duration of a time step by advective scaling [µs]."""
        return self.spacing_um * self.velocity_lu / self.velocity_mm_s * 1e3

    def velocity_from_lu(self, value):
        """Lattice velocity to mm/s."""
        return value * self.velocity_mm_s / self.velocity_lu

    @property
    def _surface_modulus_si(self) -> float:
        """N/m that are one lattice unit: stress scale μU over its lattice value."""
        si = self.viscosity_mPa_s * _MILLI * self.velocity_mm_s * _MILLI
        return si / (self.viscosity_lu * self.velocity_lu)

    def surface_modulus(self, uN_per_m: float) -> float:
        """Surface modulus [µN/m] to lattice units."""
        return uN_per_m * _MICRO / self._surface_modulus_si

    def energy(self, pN_um: float) -> float:
        """Energy [pN·µm] to lattice units."""
        return pN_um * _ATTO / (self._surface_modulus_si * (self.spacing_um * _MICRO) ** 2)

    def energy_aJ(self, energy_lu: float) -> float:
        """Energy in lattice units to attojoule (1 aJ = 1 pN·µm)."""
        return energy_lu * self._surface_modulus_si * (self.spacing_um * _MICRO) ** 2 / _ATTO

    def pressure(self, pascal: float) -> float:
        """Pressure [Pa] to lattice units."""
        return pascal * self.spacing_um * _MICRO / self._surface_modulus_si

    def friction(self, nN_s_per_m: float) -> float:
        """Friction coefficient or edge dashpot [nN·s/m] to lattice units (scale μΔx)."""
        si = self.viscosity_mPa_s * _MILLI * self.spacing_um * _MICRO
        return nN_s_per_m * _NANO / si * self.viscosity_lu

    def stiffness(self, stiffness: Stiffness) -> dict[str, float]:
        """Membrane coefficients, lattice units, named as :class:`dldsim.solver.membrane.Moduli`."""
        return {
            "ks": self.surface_modulus(stiffness.ks_uN_per_m),
            "kb": self.energy(stiffness.kb_pN_um),
            "kal": self.surface_modulus(stiffness.kal_uN_per_m),
            "kag": self.surface_modulus(stiffness.kag_uN_per_m),
            "kv": self.pressure(stiffness.kv_Pa),
            "kvisc": self.friction(stiffness.kvisc_nN_s_per_m),
        }

    def force(self, nN: float) -> float:
        """Force [nN] to lattice units."""
        return nN * _NANO / (self._surface_modulus_si * self.spacing_um * _MICRO)

    def capillary_number(
        self, ks_uN_per_m: float, velocity_mm_s: float | None = None
    ) -> float | None:
        """Ca = μU/k_s with the mean velocity or that given; None for a membrane without springs."""
        if ks_uN_per_m == 0:
            return None
        stress = self.viscosity_mPa_s * _MILLI * (velocity_mm_s or self.velocity_mm_s) * _MILLI
        return stress / (ks_uN_per_m * _MICRO)

    def reynolds_number(self, radius_um: float) -> float:
        """Numerical Re = U·2R/ν of the run in lattice units."""
        return self.velocity_lu * 2 * radius_um / self.spacing_um / self.viscosity_lu
