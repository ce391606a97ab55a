"""The home of compiled kernels: another one for every change of a kernel, wherever it lies."""

import ast
import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from dldsim.solver import jit


def test_every_module_with_kernels_is_part_of_the_key():
    compiling = set()
    for path in jit.PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in getattr(node, "names", []) if hasattr(alias, "name")]
            if (
                isinstance(node, ast.ImportFrom)
                and node.module == "dldsim.solver.jit"
                or "numba" in names
                or isinstance(node, ast.ImportFrom)
                and node.module == "dldsim.solver"
                and "jit" in names
            ):
                compiling.add(path)
    assert compiling and set(jit._kernel_sources()) >= compiling
    assert {path.parent for path in compiling} > {jit.PACKAGE / "solver"}


@pytest.mark.parametrize("folder", [".", "solver", "evidence/deep"])
def test_a_changed_kernel_gets_a_fresh_cache(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(jit, "PACKAGE", tmp_path)
    kernel, plain = tmp_path / folder / "kernel.py", tmp_path / "evidence" / "plain.py"
    for path in (kernel, plain):
        path.parent.mkdir(parents=True, exist_ok=True)
    kernel.write_text("from dldsim.solver.jit import jit\nx = 1\n")
    plain.write_text("x = 1\n")
    first = jit._cache_directory()
    plain.write_text("x = 2\n")
    assert jit._cache_directory() == first
    kernel.write_text("from dldsim.solver.jit import jit\nx = 2\n")
    assert jit._cache_directory() != first


def test_a_changed_constant_of_the_solver_gets_a_fresh_cache(tmp_path, monkeypatch):
    """A kernel may have frozen it, though its own file has no kernel."""
    monkeypatch.setattr(jit, "PACKAGE", tmp_path)
    (tmp_path / "solver").mkdir()
    (tmp_path / "solver" / "stencil.py").write_text("WEIGHT = 1\n")
    first = jit._cache_directory()
    (tmp_path / "solver" / "stencil.py").write_text("WEIGHT = 2\n")
    assert jit._cache_directory() != first


KERNELS = """
from dldsim.solver.jit import CACHE, jit
from dldsim.solver.inner import inner

@jit
def outer(x):
    return 10 * inner(x)

if __name__ == "__main__":
    print(outer(1.0), CACHE)
"""
INNER = "from dldsim.solver.jit import jit\n\n@jit\ndef inner(x):\n    return x + {}\n"


@pytest.fixture
def package(tmp_path):
    """A package of two kernels, one of which calls the other, and the real jit.py."""
    solver = tmp_path / "code" / "dldsim" / "solver"
    solver.mkdir(parents=True)
    for folder in (solver, solver.parent):  # a package without goes behind the installed one
        (folder / "__init__.py").touch()
    shutil.copy(jit.__file__, solver / "jit.py")
    (solver / "outer.py").write_text(KERNELS)
    (solver / "inner.py").write_text(INNER.format("0.0"))
    return solver


def outer(package, **environment):
    """What the outer kernel gives in a fresh process, and what the process said."""
    done = subprocess.run(
        [sys.executable, "-m", "dldsim.solver.outer"],
        cwd=package.parents[1],
        env={"PATH": os.environ["PATH"], "PYTHONPATH": str(package.parents[1]), **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    value, cache = done.stdout.split(maxsplit=1)
    return float(value), cache.strip(), done.stderr


@pytest.mark.slow
def test_no_kernel_of_older_sources_runs_whatever_the_environment_says(package, tmp_path):
    kept = tmp_path / "kept"
    wanted = {"NUMBA_CACHE_DIR": str(kept), "NUMBA_CACHE_LOCATOR_CLASSES": "InTreeCacheLocator"}
    value, cache, said = outer(package, **wanted)
    assert (value, said) == (10.0, "") and Path(cache).parent == kept
    assert {path.suffix for path in kept.rglob("*") if path.is_file()} == {".nbi", ".nbc"}
    assert not [*package.rglob("*.nb?")]
    # Of another length: bytecode of the same second and length would pass for the new source's.
    (package / "inner.py").write_text(INNER.format("2.00"))
    assert outer(package, **wanted)[0] == 30.0


@pytest.mark.slow
@pytest.mark.parametrize(
    "environment",
    [
        {"NUMBA_CACHE_DIR": "/dev/null/cache"},
        {"XDG_CACHE_HOME": "/dev/null/cache"},
        {"HOME": "/dev/null", "XDG_CACHE_HOME": ""},
    ],
)
def test_without_a_place_to_write_kernels_are_compiled_anew_and_that_is_said(package, environment):
    value, cache, said = outer(package, **environment)
    assert (value, cache) == (10.0, "None")
    assert said.count("Set NUMBA_CACHE_DIR to a directory that can be written") == 1
    assert "Traceback" not in said


def test_a_user_without_a_home_is_told(monkeypatch):
    def homeless():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", homeless)
    with pytest.warns(RuntimeWarning, match="Set NUMBA_CACHE_DIR"):
        assert jit._usable_cache() is None


@pytest.mark.parametrize(
    ("variable", "value", "home"),
    [
        ("NUMBA_CACHE_DIR", "/a", "/a"),
        ("XDG_CACHE_HOME", "/b", "/b/dldsim"),
        ("XDG_CACHE_HOME", "", "/c/.cache/dldsim"),
        ("XDG_CACHE_HOME", "here", "/c/.cache/dldsim"),
    ],
)
def test_the_home_of_caches(variable, value, home, monkeypatch):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("HOME", "/c")
    monkeypatch.setenv(variable, value)
    assert jit._cache_home() == Path(home)


def test_a_disk_that_fills_up_ends_the_cache_and_not_the_run(tmp_path, monkeypatch):
    monkeypatch.setattr(jit, "CACHE", tmp_path)
    monkeypatch.setattr(jit._KernelCache, "given_up", False)

    @jit.jit
    def doubled(x):
        return 2 * x

    def full(*arguments):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(doubled._cache._cache_file, "save", full)
    with pytest.warns(RuntimeWarning, match="No space left") as said:
        assert doubled(2) == 4 and doubled(2.0) == 4.0
    assert len(said) == 1
