"""Who may import whom: the floors of the package and the weight of each module."""

import ast
import graphlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

from tests import architecture
from tests.architecture import (
    FLOORS,
    PACKAGE,
    PICTURE,
    ROOT,
    floor_imports,
    floor_of,
    graph,
    imports,
    sources,
    within,
)

LIGHT = {
    "dldsim",
    "dldsim.__main__",
    "dldsim.errors",
    "dldsim.vocabulary",
    "dldsim.files",
    "dldsim.laws",
    *(
        f"dldsim.config.{name}"
        for name in (
            "sections",
            "assay_sections",
            "assays",
            "population_sections",
            "design_sections",
            "study_sections",
            "survey_section",
            "configuration",
            "presets",
            "explain",
            "feasibility",
            "limits",
            "yaml_files",
            "schema",
            "identifiers",
            "provenance",
            "campaign",
        )
    ),
    "dldsim.tables.numerics",
    "dldsim.analysis.learning",
    "dldsim.analysis.uncertainty",
    "dldsim.evidence.accuracy",
    "dldsim.evidence.reference",
    "dldsim.evidence.critical_gaps",
    "dldsim.evidence.reference_study",
    "dldsim.evidence.spot_check",
    "dldsim.evidence.stability_sweep",
    "dldsim.evidence.validation",
    "dldsim.app.cli",
    *(
        f"dldsim.app.commands.{name}"
        for name in (
            "calibration",
            "design",
            "options",
            "outcome",
            "output",
            "populations",
            "service",
            "settings",
            "simulation",
            "tables",
            "validation",
        )
    ),
}
"""Read by rule files and at the start of every command: no heavy import at their top."""
HEAVY = {
    "numpy",
    "pyarrow",
    "numba",
    "pandas",
    "scipy",
    "sklearn",
    "statsmodels",
    "optuna",
    "xgboost",
    "matplotlib",
    "gdstk",
    "ezdxf",
    "h5py",
}
WITHOUT_KERNELS = (
    "dldsim.config",
    "dldsim.tables",
    "dldsim.analysis",
    "dldsim.report",
    *(
        f"dldsim.design.{name}"
        for name in (
            "candidates",
            "cell_source",
            "chip",
            "deformability",
            "device_outcome",
            "draws",
            "finished_campaign",
            "layout",
            "mask",
            "measured_cells",
            "measured_devices",
            "motion",
            "neighbourhood",
            "outlet_task",
            "outlets",
            "populations",
            "search",
            "side_walls",
            "task",
            "verdict",
            "verified",
        )
    ),
)
"""These read tables and never touch a kernel."""
RUNS = {
    f"dldsim.experiments.{name}"
    for name in (
        "array_run",
        "array_outcome",
        "array_scene",
        "assays",
        "channel",
        "constriction",
        "passage",
        "sheared",
    )
}
SLOW = HEAVY - {"numpy", "pyarrow", "numba", "scipy", "pandas", "matplotlib"}
"""Only inside the functions that need them."""


def unlisted(package: Path) -> set[str]:
    """Top-level folders and modules without a floor, and floors without any module."""
    return {floor_of(name) for name in sources(package)} ^ set(FLOORS)


def upwards(package: Path) -> set[tuple[str, str]]:
    """Imports from a floor above."""
    height = {name: i for i, name in enumerate(FLOORS)}
    return {
        (name, other)
        for name, found in graph(package).items()
        for other in found
        if height[floor_of(other)] > height[floor_of(name)]
    }


MODULES = sources(PACKAGE)
KERNELS = {m for m, found in graph(PACKAGE).items() if "dldsim.solver.jit" in found}


def test_every_folder_and_module_has_a_floor():
    assert len(MODULES) > len(FLOORS)
    assert not unlisted(PACKAGE), "keep FLOORS in tests/architecture.py the list of what is there"


def test_every_folder_is_a_package():
    folders = {path.parent for path in MODULES.values()}
    assert not {f for f in folders if not (f / "__init__.py").exists()}


def test_imports_only_what_is_below():
    assert not upwards(PACKAGE)


def test_no_module_imports_itself_by_way_of_others():
    graphlib.TopologicalSorter(graph(PACKAGE)).prepare()


@pytest.mark.parametrize(
    ("path", "text", "fault"),
    [
        ("attic/old.py", "", "unlisted"),
        ("attic.py", "", "unlisted"),
        ("solver/deep/loop.py", "def f():\n    from dldsim.app.web import pool\n", "upwards"),
        ("solver/loop.py", "from dldsim import app\n", "upwards"),
        ("config/sections.py", "import dldsim.tables.parquet\n", "upwards"),
        ("solver/mesh.py", "def f():\n    from dldsim.solver.lattice import g\n", "cycle"),
    ],
)
def test_a_fault_is_found(path, text, fault, tmp_path):
    for floor in FLOORS[4:-1]:
        (tmp_path / "dldsim" / floor.split(".")[1]).mkdir(parents=True)
        (tmp_path / "dldsim" / floor.split(".")[1] / "__init__.py").write_text("")
    for name in (
        "__init__",
        "__main__",
        "errors",
        "vocabulary",
        "files",
        "laws",
        "tables/parquet",
        "app/web",
    ):
        (tmp_path / "dldsim" / f"{name}.py").write_text("")
    lattice = tmp_path / "dldsim" / "solver" / "lattice.py"
    lattice.write_text("from dldsim.errors import E\nfrom dldsim.solver.mesh import m\n")
    package = tmp_path / "dldsim"
    (package / "solver" / "mesh.py").write_text("")
    assert not unlisted(package) and not upwards(package)
    graphlib.TopologicalSorter(graph(package)).prepare()
    (package / path).parent.mkdir(parents=True, exist_ok=True)
    (package / path).write_text(text)
    assert bool(unlisted(package)) == (fault == "unlisted")
    if fault == "upwards":
        assert len(upwards(package)) == 1
    if fault == "cycle":
        with pytest.raises(graphlib.CycleError):
            graphlib.TopologicalSorter(graph(package)).prepare()


def test_the_imports_of_floors_are_those_of_their_modules(tmp_path):
    (tmp_path / "dldsim" / "solver").mkdir(parents=True)
    for name, text in {
        "laws": "",
        "errors": "",
        "solver/mesh": "from dldsim.laws import f\nimport numpy\n",
        "solver/loop": "def f():\n    from dldsim import errors\n    import dldsim.solver.mesh\n",
    }.items():
        (tmp_path / "dldsim" / f"{name}.py").write_text(text)
    below = floor_imports(tmp_path / "dldsim")
    assert list(below) == FLOORS
    assert below.pop("dldsim.solver") == ["dldsim.errors", "dldsim.laws"]
    assert not any(below.values())


def test_the_picture_has_a_dot_for_every_import_and_no_other():
    below = {"dldsim.a": [], "dldsim.b": ["dldsim.a"], "dldsim.c": ["dldsim.a", "dldsim.b"]}
    [axes] = architecture.draw(below).axes
    dots = [line.get_xydata().tolist() for line in axes.lines if line.get_marker() == "o"]
    assert sum(dots, []) == [[0, 1], [0, 2], [1, 2]]
    names = {text.get_text(): text.get_position() for text in axes.texts}
    assert [names[name] for name in "abc"] == [(0, 0), (1, 1), (2, 2)]


def test_the_picture_is_that_of_the_sources():
    shown = json.loads(Image.open(PICTURE).text["Imports"])
    assert shown == floor_imports(PACKAGE), "draw it anew: make architecture"


def test_the_guide_lists_the_floors():
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    table = text[text.index("| room") :].partition("\n\n")[0].splitlines()[2:]
    rooms = re.findall(r"`(\w+)/?`", " ".join(line.split("|")[1] for line in table))
    assert [f"dldsim.{room}" for room in rooms] == FLOORS[1:-1]


def test_the_guide_leads_to_what_is_there():
    """Files of the table of questions, and what is named in brackets beside them."""
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    rows = [line.split("|")[2] for line in text.partition("| question")[2].splitlines()[2:]]
    assert len(rows) > 10
    for row in rows:
        paths = re.findall(r"`([\w./]+\.(?:py|smk))`", row)
        files = [at / path for path in paths for at in (PACKAGE, ROOT) if (at / path).exists()]
        assert paths and len(files) == len(paths), row
        sources = " ".join(file.read_text(encoding="utf-8") for file in files)
        for name in re.findall(r"`(\w+)", " ".join(re.findall(r"\((.*?)\)", row))):
            assert re.search(rf"\b{name}\b", sources), (row, name)


@pytest.mark.parametrize("module", sorted(LIGHT))
def test_light_modules_start_light(module):
    top = imports(MODULES[module], MODULES, top=True)
    assert not {name.split(".")[0] for name in top} & HEAVY
    assert {name for name in top if within(name, "dldsim")} <= LIGHT


@pytest.mark.parametrize("module", sorted(m for m in MODULES if within(m, *WITHOUT_KERNELS)))
def test_tables_are_read_without_kernels(module):
    assert KERNELS and RUNS <= set(MODULES)
    found = imports(MODULES[module], MODULES)
    assert not found & (KERNELS | RUNS | {"dldsim.solver.jit", "numba"})


@pytest.mark.parametrize("module", sorted(MODULES))
def test_slow_packages_are_imported_where_used(module):
    top = imports(MODULES[module], MODULES, top=True)
    assert not {name.split(".")[0] for name in top} & SLOW


@pytest.mark.parametrize("folder", [f for f in FLOORS if (PACKAGE / f.split(".")[-1]).is_dir()])
def test_folders_hold_no_code_of_their_own(folder):
    """A folder's __init__.py says what it is for, and names are imported from where they live."""
    tree = ast.parse(MODULES[folder].read_text(encoding="utf-8"))
    assert len(tree.body) == 1 and ast.get_docstring(tree)


@pytest.mark.slow
def test_numerical_libraries_run_on_one_thread():
    """Their threads wait for each other on a busy machine; what the user has set is kept."""
    code = (
        "import dldsim.analysis.surrogate, sklearn.ensemble, xgboost, threadpoolctl;"
        "print(sorted({i['num_threads'] for i in threadpoolctl.threadpool_info()}))"
    )
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    bare = {k: v for k, v in os.environ.items() if k not in names}
    for chosen, threads in (({}, "[1]"), (dict.fromkeys(names, "2"), "[2]")):
        done = subprocess.run(
            [sys.executable, "-c", code],
            env=bare | chosen,
            check=True,
            capture_output=True,
            text=True,
        )
        assert done.stdout.strip() == threads
