"""Settings, versions and provenance, for those who repeat the campaign."""

import importlib.metadata
import platform
from collections.abc import Mapping

import dldsim
from dldsim.config.provenance import settings_hash
from dldsim.report.formats import GAP, PERIODICITY, PILLAR_RADIUS, duration, number, text
from dldsim.report.page import Page
from dldsim.report.sections.summary import simulation_time

PACKAGES = (
    "numba",
    "numpy",
    "pandas",
    "statsmodels",
    "scikit-learn",
    "xgboost-cpu",
    "optuna",
    "snakemake",
)


def contents(page: Page) -> dict:
    outcomes = page["outcomes"]

    def values(name: str, unit: str = "") -> str:
        return ", ".join(f"{v:g}" for v in sorted(outcomes[name].unique())) + unit

    rows = {
        "Preset": page.setting("preset"),
        "Seed": page.setting("seed"),
        "Configuration hash": settings_hash(dict(page.config)),
        "Pillar radius " + PILLAR_RADIUS: values("pillar_radius_um", " µm"),
        "Gap " + GAP: values("gap_um", " µm"),
        "Periodicity " + PERIODICITY: values("periodicity"),
        "Stiffness sets": ", ".join(sorted(outcomes["stiffness_set"].unique())),
        "Mean velocity": values("mean_velocity_mm_s", " mm/s"),
        "Lattice spacing": f"{number(outcomes['spacing_um'].min())} to "
        f"{number(outcomes['spacing_um'].max())} µm",
        "Simulation time": f"{duration(simulation_time(page))} summed over jobs",
        "Versions": ", ".join(versions()),
    }
    for section in ("cell", "flow", "numerics", "run_control", "constriction", "assays"):
        found = page.setting(section)
        if isinstance(found, Mapping):
            rows[section.replace("_", " ").capitalize()] = ", ".join(
                f"{key} = {value}" for key, value in found.items()
            )
    return {
        "settings": page.table({"setting": rows, "value": map(text, rows.values())}, ["outcomes"])
    }


def versions() -> list[str]:
    """Versions of this package, of its physics, and of those that the numbers depend on."""
    found = [
        f"dldsim {dldsim.__version__}",
        f"physics version {dldsim.PHYSICS_VERSION}",
        f"Python {platform.python_version()}",
    ]
    for package in PACKAGES:
        try:
            found.append(f"{package} {importlib.metadata.version(package)}")
        except importlib.metadata.PackageNotFoundError:
            continue
    return found
