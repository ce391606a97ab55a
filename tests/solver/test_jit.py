"""The home of compiled kernels: another one for every change of a kernel, wherever it lies."""

import ast

import pytest

from dldsim.solver import jit


def test_every_module_with_kernels_is_part_of_the_key():
    compiling = set()
    for path in jit.PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in getattr(node, "names", []) if hasattr(alias, "name")]
            if (isinstance(node, ast.ImportFrom) and node.module == "dldsim.solver.jit"
                    or "numba" in names
                    or isinstance(node, ast.ImportFrom) and node.module == "dldsim.solver"
                    and "jit" in names):  # fmt: skip
                compiling.add(path)
    assert compiling and set(jit._kernel_sources()) == compiling
    assert {path.parent for path in compiling} > {jit.PACKAGE / "solver"}


@pytest.mark.parametrize("folder", [".", "solver", "evidence/deep"])
def test_a_changed_kernel_gets_a_fresh_cache(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(jit, "PACKAGE", tmp_path)
    kernel, plain = tmp_path / folder / "kernel.py", tmp_path / folder / "plain.py"
    kernel.parent.mkdir(parents=True, exist_ok=True)
    kernel.write_text("from dldsim.solver.jit import jit\nx = 1\n")
    plain.write_text("x = 1\n")
    first = jit._cache_directory()
    plain.write_text("x = 2\n")
    assert jit._cache_directory() == first
    kernel.write_text("from dldsim.solver.jit import jit\nx = 2\n")
    assert jit._cache_directory() != first
