"""Formulae with one home, in plain arithmetic: numbers or arrays in, the same out."""

import math

SOURCE_OF_DAVIS = "D_c = 1.4 G ε^0.48, Davis 2008 (thesis, Princeton)"
SCATTER_OF_DAVIS = 0.10
"""Relative scatter of measured critical diameters about 1.4 G ε^0.48 (Davis's devices)."""
EVANS_FUNG = (0.207161, 2.002558, -1.122762)
"""c₀, c₂, c₄ of the biconcave profile z = ±(R/2) √(1−r²) (c₀ + c₂ r² + c₄ r⁴), r in units of R:
Evans & Fung, Microvasc. Res. 4 (1972) 335."""


def critical_diameter(gap, row_shift_fraction):
    """Critical diameter D_c = 1.4 G ε^0.48 of rigid spheres, in the unit of the gap (Davis 2008;
    Inglis et al. 2006)."""
    return 1.4 * gap * row_shift_fraction**0.48


def viscosity(relaxation_time: float) -> float:
    """Kinematic viscosity ν = (τ − 1/2)/3 in lattice units."""
    return (relaxation_time - 0.5) / 3


def rest_volume(shape: str, aspect_ratio: float) -> float:
    """Volume / (4π R³/3) of a cell at rest; `aspect_ratio` counts for the ellipsoid only.

    The biconcave profile is integrated exactly.
    """
    if shape == "ellipsoid":
        return aspect_ratio
    c0, c1, c2 = EVANS_FUNG
    biconcave = 0.75 * (2 / 3 * c0 + 4 / 15 * c1 + 16 / 105 * c2)
    return {"sphere": 1.0, "biconcave": biconcave}[shape]


def rest_area(shape: str, aspect_ratio: float) -> float:
    """Area / R² of a cell at rest; `aspect_ratio` counts for the ellipsoid only."""
    if shape == "biconcave":  # Evans & Fung (1972): 134.1 µm² at R = 3.91 µm
        return 134.1 / 3.91**2
    q = aspect_ratio if shape == "ellipsoid" else 1.0
    e = math.sqrt(1 - q * q)
    side = q * q * math.atanh(e) / e if e > 1e-6 else 1.0
    return 2 * math.pi * (1 + side)


def rest_thickness(shape: str, aspect_ratio: float) -> float:
    """Largest extent / R along the symmetry axis of a cell at rest; `aspect_ratio` counts for the
    ellipsoid only."""
    if shape == "biconcave":  # largest of √(1−r²) (c₀ + c₂ r² + c₄ r⁴), at r = 0.70
        return 0.6562
    return 2 * aspect_ratio if shape == "ellipsoid" else 2.0


def area_modulus(ks: float, kal: float, kag: float) -> float:
    """K = √3/2 k_s + k_α/2 + k_ag/2 of a network of equilateral triangles.

    Springs: Seung & Nelson, Phys. Rev. A 38 (1988) 1005. The area terms follow from their work
    under uniform dilation (see `solver.membrane.energies`); k_ag resists only changes of the total
    area.
    """
    return math.sqrt(3) / 2 * ks + kal / 2 + kag / 2


LARGEST_TENSION = 0.1
"""Viscous stress μU over area modulus K + k_ag/2: at 0.3 the flow tears cells to twice their area.
"""


def pillar_centres(
    pitch: float, row_shift: float, row: int, low: float, high: float
) -> list[tuple[float, float]]:
    """Centres of one row of pillars from y = `low` to `high`; x = y = 0 is a pillar of row 0.

    Row i stands at x = iλ, its pillars at y = i·shift + jλ, j any integer.
    """
    shift = row * row_shift
    first, last = math.ceil((low - shift) / pitch), math.floor((high - shift) / pitch)
    return [(row * pitch, shift + lane * pitch) for lane in range(first, last + 1)]


COARSER_ALLOWED = 1.1
"""The lattice spacing may exceed the wanted one by this factor to make the row shift whole."""


def whole_shift_spacing(geometry, spacing_um: float) -> tuple[float, int]:
    """Spacing [µm] that makes the row shift λ/N_p a whole number of nodes, and that number.

    `geometry` has `pitch_um` and `periodicity`.
    """
    shift_um = geometry.pitch_um / geometry.periodicity
    nodes = max(1, math.ceil(shift_um / (COARSER_ALLOWED * spacing_um) - 1e-9))
    return shift_um / nodes, nodes


def even_throat(throat_um: float, spacing_um: float) -> tuple[float, int]:
    """Spacing [µm] that divides a throat into an even number of nodes, and that number."""
    nodes = 2 * math.ceil(throat_um / spacing_um / 2)
    return throat_um / nodes, nodes
