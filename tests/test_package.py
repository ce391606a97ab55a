"""Source archive and wheel: built from a clean copy, complete, and working once installed."""

import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BUILD = "from setuptools import build_meta; build_meta.build_{}({!r})"
pytest.importorskip("setuptools", minversion="77")  # in requirements-dev.txt
pytestmark = pytest.mark.slow


def tracked() -> list[str]:
    """Paths of the repository's files; skips where this is no checkout."""
    if not (ROOT / ".git").exists():
        pytest.skip("not a checkout: what belongs to the archive is not known")
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return [name for name in listed.stdout.split("\0") if name and (ROOT / name).exists()]


def build(what: str, source: Path, directory: Path) -> Path:
    """Build `what` (sdist, wheel) of `source` without the network; returns the file."""
    directory.mkdir()
    subprocess.run(
        [sys.executable, "-c", BUILD.format(what, str(directory))],
        cwd=source,
        check=True,
        capture_output=True,
        text=True,
    )
    (made,) = directory.iterdir()
    return made


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    """Archive made from a copy of the tracked files, so that nothing is left in the checkout."""
    folder = tmp_path_factory.mktemp("package")
    for name in tracked():
        target = folder / "source" / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, target)
    return build("sdist", folder / "source", folder / "sdist")


@pytest.fixture(scope="module")
def wheel(archive):
    unpacked = archive.parent.parent / "unpacked"
    with tarfile.open(archive) as file:
        file.extractall(unpacked, filter="data")
    (source,) = unpacked.iterdir()
    return build("wheel", source, unpacked.parent / "wheel")


def test_archive_has_every_file_of_the_repository(archive):
    with tarfile.open(archive) as file:
        names = {name.partition("/")[2] for name in file.getnames()}
    left_out = {name for name in tracked() if name not in names}
    assert left_out == {".ci/run", ".gitignore"}


def test_wheel_has_every_file_of_the_package(wheel):
    with zipfile.ZipFile(wheel) as file:
        names = set(file.namelist())
    assert [name for name in tracked() if name.startswith("dldsim/") and name not in names] == []
    assert not [name for name in names if name.startswith(("tests/", "benchmarks/"))]


def test_wheel_in_a_clean_environment_answers_a_design(wheel, tmp_path):
    environment = tmp_path / "environment"
    venv.create(environment, with_pip=False, symlinks=True)
    variables = {**os.environ, "MPLBACKEND": "Agg"}
    variables.pop("PYTHONPATH", None)
    pip = [sys.executable, "-m", "pip", "--python", str(environment / "bin" / "python")]
    subprocess.run(
        [*pip, "install", "--quiet", "--no-deps", "--no-index", str(wheel)],
        cwd=tmp_path,
        env=variables,
        check=True,
    )
    (packages,) = environment.glob("lib/python*/site-packages")
    # Dependencies of this environment; its editable installation is not taken over by such a line.
    (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")

    def answer(*words: str) -> str:
        return subprocess.run(
            [str(environment / "bin" / words[0]), *words[1:]],
            cwd=tmp_path,
            env=variables,
            check=True,
            capture_output=True,
            text=True,
        ).stdout

    place = answer("python", "-c", "import dldsim; print(dldsim.__file__)")
    assert Path(place.strip()).is_relative_to(packages)
    assert "design" in answer("dldsim", "--help")
    request = ["--set1", "3", "--set2", "3", "--r1", "6", "--r2", "9", "--trials", "20"]
    answer("dldsim", "design", *request, "--output", "mine")
    assert list((tmp_path / "mine" / "files").glob("*.gds"))
    assert (tmp_path / "mine" / "report.html").stat().st_size > 0
