"""The floors of the package and who imports whom, read from the sources; and a picture of it.

`python -m tests.architecture` draws docs/images/architecture.png anew.
"""

import ast
import json
from collections.abc import Container
from pathlib import Path

from matplotlib.figure import Figure

from dldsim.files import atomic_path

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "dldsim"
PICTURE = ROOT / "docs" / "images" / "architecture.png"
FLOORS = [
    "dldsim",
    "dldsim.errors",
    "dldsim.vocabulary",
    "dldsim.files",
    "dldsim.laws",
    "dldsim.config",
    "dldsim.tables",
    "dldsim.solver",
    "dldsim.experiments",
    "dldsim.analysis",
    "dldsim.evidence",
    "dldsim.report",
    "dldsim.design",
    "dldsim.app",
    "dldsim.__main__",
]
"""From the ground up: folders with all that is in them, and modules beside them.

A module imports from its own floor and from those before it.
"""


def sources(package: Path) -> dict[str, Path]:
    """All modules by dotted name; a folder's own is its __init__.py."""
    found = {}
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package.parent).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports(path: Path, modules: Container[str], top: bool = False) -> set[str]:
    """Modules that a file imports, ours by full name; `top`: those executed on import only."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    found = set()
    for node in tree.body if top else ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: a relative import"
            for alias in node.names:
                name = f"{node.module}.{alias.name}"
                found.add(name if name in modules else node.module)
    return found


def within(name: str, *places: str) -> bool:
    return any(name == place or name.startswith(f"{place}.") for place in places)


def floor_of(module: str) -> str:
    """Where a module belongs: the part of its name after `dldsim`."""
    return ".".join(module.split(".")[:2])


def graph(package: Path) -> dict[str, set[str]]:
    """Which module of the package imports which, also inside functions."""
    modules = sources(package)
    return {
        name: {m for m in imports(path, modules) if within(m, "dldsim")} - {name}
        for name, path in modules.items()
    }


def floor_imports(package: Path) -> dict[str, list[str]]:
    """Floors from which each floor imports, both from the ground up."""
    found: dict[str, set[str]] = {floor: set() for floor in FLOORS}
    for name, others in graph(package).items():
        found[floor_of(name)] |= {floor_of(other) for other in others} - {floor_of(name)}
    return {floor: [other for other in FLOORS if other in found[floor]] for floor in FLOORS}


def draw(below: dict[str, list[str]]) -> Figure:
    """Floors as a stair, and a dot where the floor of a row imports from that of a column."""
    figure = Figure(figsize=(8.4, 5.6), layout="constrained")
    axes = figure.subplots()
    place = {floor: i for i, floor in enumerate(below)}
    for floor, others in below.items():
        y = place[floor]
        axes.text(
            y,
            y,
            floor.removeprefix("dldsim."),
            ha="center",
            va="center",
            fontsize=8.5,
            bbox={"boxstyle": "round,pad=0.35", "facecolor": "#DCE9F5", "edgecolor": "#0072B2"},
        )
        above = [place[f] for f in below if floor in below[f]]
        lines = {"color": "#C9CDD2", "linewidth": 0.8, "zorder": 0}
        axes.plot([y, y], [y, max(above, default=y)], **lines)
        axes.plot([y, min(map(place.get, others), default=y)], [y, y], **lines)
        axes.plot([place[other] for other in others], [y] * len(others), "o", color="#0072B2")
    axes.set(xlim=(-0.8, len(below) - 0.2), ylim=(-0.6, len(below) - 0.4))
    axes.set_axis_off()
    axes.text(
        0.99,
        0.02,
        "Each row: a floor, and dots above the floors\nthat it imports from. No dot lies right of "
        "the stair:\nnothing imports from a floor above.",
        transform=axes.transAxes,
        ha="right",
        fontsize=9,
    )
    return figure


def main() -> None:
    """Draw the picture; the imports that it shows are kept in the file, under "Imports"."""
    below = floor_imports(PACKAGE)
    with atomic_path(PICTURE) as part:
        about = {"Software": None, "Imports": json.dumps(below)}
        draw(below).savefig(part, format="png", dpi=130, metadata=about, facecolor="white")


if __name__ == "__main__":
    main()
