"""Validation cases: what the simulator computes beside what others have published or computed.

A case is a function that yields :class:`Comparison` objects; the modules that hold them,
``validation_*``, are imported when a case runs, so that rule files and commands can list the cases
without numba.
"""

import difflib
import importlib
import math
import time
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

from dldsim.errors import DldsimError

BROKEN = "the case itself"
"""Quantity of the row that stands for a case that raised."""
ROUNDING = 1e-7
"""Relative errors below this are left over from iteration and rounding and have no order."""


class Comparison(NamedTuple):
    """One computed value beside its reference.

    ``variant``: what is told apart in the same quantity, such as half-way and interpolated;
    ``parameter``: what the quantity is a function of, ``parameter_of`` says what that is;
    ``resolution``: lattice nodes or mesh edges over the length ``resolution_of``; ``mark``: allowed
    |relative error|, None for what is only shown; ``error``: relative error of a whole field, where
    value / reference - 1 would not show it; ``source``: of the reference, None for the case's.
    """

    quantity: str
    value: float
    reference: float
    mark: float | None = None
    unit: str = "1"
    variant: str = ""
    parameter: float | None = None
    parameter_of: str = ""
    resolution: float | None = None
    resolution_of: str = ""
    error: float | None = None
    source: str | None = None
    note: str = ""


class Case(NamedTuple):
    """A validation case; ``function``: module and name of the generator of its comparisons."""

    title: str
    group: str
    function: str
    source: str

    def comparisons(self) -> Iterator[Comparison]:
        module, name = self.function.split(".")
        return getattr(importlib.import_module(f"dldsim.evidence.{module}"), name)()


_BOUNDARY_INTEGRAL = "spectral boundary-integral Stokes solution"
_ESPRESSO = "ESPResSo 4.2.2, object-in-fluid"
CASES = {
    "plane-poiseuille": Case(
        "Flow between two plates", "fluid", "validation_fluid.plane_poiseuille", "exact solution"
    ),
    "duct-poiseuille": Case(
        "Flow through rectangular ducts",
        "fluid",
        "validation_fluid.duct_poiseuille",
        "exact Fourier series",
    ),
    "taylor-green": Case(
        "Decay of a Taylor-Green vortex", "fluid", "validation_fluid.taylor_green", "exact solution"
    ),
    "viscosity-independence": Case(
        "Permeability at different relaxation times",
        "fluid",
        "validation_fluid.viscosity_independence",
        "Stokes flow: no dependence",
    ),
    "square-arrays": Case(
        "Permeability of square arrays of cylinders",
        "fluid",
        "validation_fluid.square_arrays",
        "Sangani & Acrivos 1982, Int. J. Multiphase Flow 8:193, Table 1, recomputed to 1e-10",
    ),
    "row-shifted-arrays": Case(
        "Permeability tensor and tilt of row-shifted arrays",
        "fluid",
        "validation_fluid.row_shifted_arrays",
        _BOUNDARY_INTEGRAL,
    ),
    "finite-height-arrays": Case(
        "Permeability and tilt of arrays between plates",
        "fluid",
        "validation_fluid.finite_height_arrays",
        "spectral-element Stokes solution",
    ),
    "first-lane-width": Case(
        "Width of the first stream lane",
        "fluid",
        "validation_fluid.first_lane_width",
        _BOUNDARY_INTEGRAL,
    ),
    "membrane-forces": Case(
        "Membrane forces term by term", "membrane", "validation_membrane.membrane_forces", _ESPRESSO
    ),
    "static-stretching": Case(
        "Cell stretched by a pair of forces",
        "membrane",
        "validation_membrane.static_stretching",
        _ESPRESSO,
    ),
    "continuum-moduli": Case(
        "Spring constants and continuum moduli",
        "membrane",
        "validation_membrane.continuum_moduli",
        "Seung & Nelson 1988, Phys. Rev. A 38:1005; Gompper & Kroll 1996, J. Phys. I 6:1305",
    ),
    "erythrocyte-stretching": Case(
        "Red cell in optical tweezers",
        "membrane",
        "validation_membrane.erythrocyte_stretching",
        "Mills et al. 2004, Mech. Chem. Biosyst. 1:169; Suresh et al. 2005, Acta Biomater. 1:15",
    ),
    "hydrodynamic-radius": Case(
        "Sphere of vertices under uniform traction",
        "cell",
        "validation_drag.hydrodynamic_radius",
        "Zick & Homsy 1982, J. Fluid Mech. 115:13, simple cubic",
    ),
    "capsule-in-shear": Case(
        "Capsule in simple shear",
        "cell",
        "validation_capsule.capsule_in_shear",
        "boundary integral",
    ),
    "rigid-transition": Case(
        "Stiff sphere between bump and zigzag",
        "cell",
        "validation_transition.rigid_transition",
        "D_c = 1.4 G ε^0.48, Davis 2008",
    ),
    "sphere-in-channel": Case(
        "Stiff sphere on the axis of a square channel",
        "assays",
        "validation_assays.sphere_in_channel",
        "Faxén 1922, Ann. Phys. 373:89; flow: exact Fourier series",
    ),
    "bullet-in-channel": Case(
        "Soft sphere on the axis of a square channel",
        "assays",
        "validation_assays.bullet_in_channel",
        "first-order theory, derived in evidence/small_deformation.py; flow: exact Fourier series",
    ),
    "spheres-in-shear": Case(
        "Spheres in shear at small stress",
        "assays",
        "validation_assays.spheres_in_shear",
        "Barthès-Biesel & Rallison 1981, J. Fluid Mech. 113:251, for this membrane: "
        "evidence/small_deformation.py",
    ),
    "red-cell-in-shear": Case(
        "Red cell in shear",
        "assays",
        "validation_red_cell.red_cell_in_shear",
        "ektacytometer; Fischer & Korzeniewski 2015, Biophys. J. 108:1352",
    ),
    "constriction-shape": Case(
        "Cell in a constriction, channel inferred",
        "cell",
        "validation_constriction.constriction_shape",
        "source paper, table of the constriction validation",
    ),
    "left-out": Case(
        "What scenes do without",
        "scenes",
        "validation_scenes.left_out",
        "the same scene with what was left out",
    ),
}


def check_cases(names: Iterable[str]) -> list[str]:
    """The names, all cases if there are none. Raises DldsimError if no name is known.

    An unknown name beside known ones passes: it fails as a case, and the others still run.
    """
    names = list(names) or list(CASES)
    if not any(name in CASES for name in names):
        known = ", ".join(CASES)
        raise DldsimError(
            " ".join(map(_unknown, names)) + f" Known: {known}.",
            key="case",
            value=names,
            allowed=known,
        )
    return names


def _unknown(name: str) -> str:
    close = difflib.get_close_matches(name, CASES, n=1)
    hint = f" Did you mean {close[0]}?" if close else ""
    return f"Validation case {name!r} is unknown.{hint}"


def run_case(name: str, progress: Callable[[str], None] | None = None) -> list[dict]:
    """Rows of `validation` of one case.

    A case that raises keeps the rows that it has, and a failing one with the reason is added. An
    unknown case has one failing row.
    """
    if name not in CASES:
        nothing = Case("", "", "", "")
        return [_shell(name, nothing, 0.0) | {"quantity": BROKEN, "note": _unknown(name)}]
    case, rows, coarser = CASES[name], [], {}
    start = told = time.perf_counter()
    try:
        for comparison in case.comparisons():
            now = time.perf_counter()
            rows.append(_row(name, case, comparison, coarser, now - start))
            if progress and now - told > 1:
                told = now
                progress(f"{name}: {rows[-1]['quantity']}, {len(rows)} comparisons made")
            start = time.perf_counter()
    except (DldsimError, MemoryError) as error:
        expected = isinstance(error, DldsimError)
        reason = str(error) if expected else f"{type(error).__name__}: {error}"
        wall = time.perf_counter() - start
        rows.append(_shell(name, case, wall) | {"quantity": BROKEN, "note": reason})
    return rows


def _shell(name: str, case: Case, wall: float) -> dict:
    """A row of a case that has failed, without a quantity."""
    blank = (
        "parameter",
        "resolution",
        "reference",
        "value",
        "relative_error",
        "observed_order",
        "mark",
    )
    return {
        "case": name,
        "group": case.group,
        "variant": "",
        "unit": "1",
        "parameter_of": "",
        "resolution_of": "",
        "source": case.source,
        **dict.fromkeys(blank),
        "passed": False,
        "wall_time_s": wall,
    }


def _row(name: str, case: Case, comparison: Comparison, coarser: dict, wall: float) -> dict:
    """Row of one comparison; ``coarser``: resolution and error last seen of each quantity."""
    given = comparison._asdict()
    error = given.pop("error")
    row = _shell(name, case, wall) | given | {"source": comparison.source or case.source}
    if not (math.isfinite(comparison.value) and (error is None or math.isfinite(error))):
        return row | {"value": None, "note": f"not finite. {comparison.note}".strip()}
    if error is None:
        error = comparison.value / comparison.reference - 1
    row |= {"value": float(comparison.value), "relative_error": float(error)}
    row["passed"] = None if comparison.mark is None else bool(abs(error) <= comparison.mark)
    key = comparison.quantity, comparison.variant, comparison.parameter
    row["observed_order"] = _order(coarser.get(key), (comparison.resolution, error))
    coarser[key] = comparison.resolution, error
    return row


def _order(coarse: tuple | None, fine: tuple) -> float | None:
    """Order p of an error ∝ resolution⁻ᵖ between two resolutions.

    None without a coarser resolution, below rounding, and where the error changes its sign.
    """
    if coarse is None or None in (coarse[0], fine[0]) or coarse[0] == fine[0]:
        return None
    if min(abs(coarse[1]), abs(fine[1])) < ROUNDING or coarse[1] * fine[1] < 0:
        return None
    return math.log(coarse[1] / fine[1]) / math.log(fine[0] / coarse[0])


def verdicts(rows: Iterable[dict]) -> list[dict]:
    """One entry per case: comparisons, those with a mark, those that fail, the worst, time.

    ``error_over_mark`` is the largest, None if nothing with a mark was measured.
    """
    by_case = {}
    for row in rows:
        by_case.setdefault(row["case"], []).append(row)
    entries = []
    for name, of_case in by_case.items():
        shares = [
            abs(r["relative_error"]) / r["mark"]
            for r in of_case
            if r["passed"] is not None and r["relative_error"] is not None
        ]
        entries.append(
            {
                "case": name,
                "group": of_case[0]["group"],
                "comparisons": len(of_case),
                "marked": sum(r["passed"] is not None for r in of_case),
                "failed": sum(r["passed"] is False for r in of_case),
                "error_over_mark": max(shares, default=None),
                "wall_time_s": sum(r["wall_time_s"] for r in of_case),
            }
        )
    return entries


def failures(rows: Iterable[dict]) -> list[str]:
    """A sentence for each row that misses its mark."""
    return [_failure(row) for row in rows if row["passed"] is False]


def _failure(row: dict) -> str:
    at = [row["case"], row["quantity"], row["variant"]]
    if row["parameter"] is not None:
        at.append(f"{row['parameter_of']} {row['parameter']:g}")
    if row["relative_error"] is None:
        result = row["note"]
    else:
        result = f"error {row['relative_error']:+.2%}, allowed {row['mark']:.2%}"
    return f"{', '.join(filter(None, at))}: {result}"
