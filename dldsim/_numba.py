"""Compilation options of every kernel and the home of the compiled code.

numba does not notice that a kernel called from another file has changed, so the cache directory is
named after the kernel sources: an edit starts a fresh one.
"""

import hashlib
import os
from pathlib import Path

import numba


def _kernel_sources() -> list[Path]:
    marker = "from dldsim._numba import"
    return [p for p in sorted(Path(__file__).parent.glob("*.py")) if marker in p.read_text("utf-8")]


def _cache_directory() -> Path:
    digest = hashlib.sha256(Path(__file__).read_bytes())
    for path in _kernel_sources():
        digest.update(path.read_bytes())
    home = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    return home / "dldsim" / f"numba-{digest.hexdigest()[:16]}"


if "NUMBA_CACHE_DIR" not in os.environ:
    numba.config.CACHE_DIR = str(_cache_directory())

# NaN and infinity keep their meaning, so that the stability guard can see them.
jit = numba.njit(
    cache=True, error_model="numpy", fastmath={"nsz", "arcp", "contract", "afn", "reassoc"}
)
