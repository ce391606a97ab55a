"""Who may import whom: the floors of the package and the weight of each."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "dldsim"

FLOORS = [
    {"errors", "_numba"},
    {"config", "tables", "units", "campaign", "mesh", "trajectory", "reference", "uncertainty",
     "accuracy", "spot_check"},
    {"lattice", "geometry", "membrane", "finite_element", "coupling", "mirror"},
    {"flow", "cellflow", "reference_study"},
    {"stability"},
    {"simulation", "constriction"},
    {"shear", "drag", "stability_sweep", "validation", "validation_fluid", "validation_membrane",
     "validation_cell", "validation_scenes", "vtk"},
    {"statistics", "calibration", "regressors", "surrogate", "sensitivity", "design", "mask"},
    {"figures", "analysis_figures", "validation_figures", "stability_figures", "accuracy_figures",
     "design_figures", "report", "movie"},
    {"export", "design_report"},
    {"jobs"},
    {"verification", "reference_jobs"},
    {"design_jobs"},
    {"cli"},
    {"__main__"},
]
"""From the ground up; a module imports from its own floor and those below."""

LIGHT = {"errors", "stability_sweep", "config", "campaign", "accuracy", "reference", "validation",
         "reference_study", "spot_check", "uncertainty", "cli", "__main__"}
"""Read by rule files and at the start of every command: no heavy import at their top."""
HEAVY = {"numpy", "pyarrow", "numba", "pandas", "scipy", "sklearn", "statsmodels", "optuna",
         "xgboost", "matplotlib", "gdstk", "ezdxf", "h5py"}
ANALYSIS = {"statistics", "calibration", "regressors", "surrogate", "sensitivity", "design",
            "figures", "analysis_figures", "validation_figures", "accuracy_figures", "report"}
"""These read tables and never touch a kernel."""
SLOW = HEAVY - {"numpy", "pyarrow", "numba", "scipy", "pandas", "matplotlib"}
"""Only inside the functions that need them."""

FLOOR_OF = {name: i for i, floor in enumerate(FLOORS) for name in floor}
MODULES = sorted(path.stem for path in PACKAGE.glob("*.py") if path.stem != "__init__")


def imports(module: str, top: bool) -> set[str]:
    """Top-level packages and dldsim.X modules imported; `top`: those executed on import only."""
    tree = ast.parse((PACKAGE / f"{module}.py").read_text(encoding="utf-8"))
    nodes = tree.body if top else ast.walk(tree)
    found = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            if node.module == "dldsim":
                found |= {f"dldsim.{alias.name}" for alias in node.names}
            else:
                found.add(node.module)
    return found


def inside(found: set[str]) -> set[str]:
    return {name.split(".")[1] for name in found if name.startswith("dldsim.")} & set(FLOOR_OF)


@pytest.mark.parametrize("module", MODULES)
def test_module_has_a_floor(module):
    assert module in FLOOR_OF, f"give dldsim/{module}.py a floor in tests/test_imports.py"


@pytest.mark.parametrize("module", MODULES)
def test_imports_only_what_is_below(module):
    above = {name for name in inside(imports(module, top=False))
             if FLOOR_OF[name] > FLOOR_OF.get(module, 0)}
    assert not above


@pytest.mark.parametrize("module", sorted(LIGHT))
def test_light_modules_start_light(module):
    top = imports(module, top=True)
    assert not {name.split(".")[0] for name in top} & HEAVY
    assert inside(top) <= LIGHT


@pytest.mark.parametrize("module", sorted(ANALYSIS & set(MODULES)))
def test_analysis_does_without_kernels(module):
    kernels = {m for m in MODULES if "dldsim.solver.jit" in imports(m, top=False)} | FLOORS[5]
    found = imports(module, top=False)
    assert "numba" not in found
    assert not inside(found) & kernels


@pytest.mark.parametrize("module", sorted(set(MODULES)))
def test_slow_packages_are_imported_where_used(module):
    assert not {name.split(".")[0] for name in imports(module, top=True)} & SLOW
