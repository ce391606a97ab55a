"""Compilation options of every kernel and the home of the compiled code.

numba does not notice that a kernel called from another file has changed, so the cache directory is
named after the kernel sources: an edit starts a fresh one.
"""

import hashlib
import os
from pathlib import Path

import numba
import numpy as np
from numba.core.codegen import get_host_cpu_features
from numba.core.cpu import CPUTargetOptions
from numba.core.options import TargetOptions

PACKAGE = Path(__file__).parents[1]
CACHE_LINE = 64  # bytes


def _kernel_sources() -> list[Path]:
    marker = "from dldsim.solver.jit import"
    return [p for p in sorted(PACKAGE.rglob("*.py")) if marker in p.read_text("utf-8")]


def _cache_directory() -> Path:
    digest = hashlib.sha256(Path(__file__).read_bytes())
    for path in _kernel_sources():
        digest.update(path.read_bytes())
    home = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    return home / "dldsim" / f"numba-{digest.hexdigest()[:16]}"


if "NUMBA_CACHE_DIR" not in os.environ:
    numba.config.CACHE_DIR = str(_cache_directory())

# Loops over populations and faces gain up to a half from vectors of 512 bits, which LLVM avoids
# because the first processors that had them lowered their clock.
if numba.config.CPU_FEATURES is None and "+avx512vl" in get_host_cpu_features():
    numba.config.CPU_FEATURES = get_host_cpu_features() + ",-prefer-256-bit"

# numba can tell LLVM that arrays do not overlap (C's restrict), but offers no option for it.
CPUTargetOptions.noalias = TargetOptions.Mapping("noalias")

# NaN and infinity keep their meaning, so that the stability guard can see them.
_options = {
    "cache": True,
    "error_model": "numpy",
    "fastmath": {"nsz", "arcp", "contract", "afn", "reassoc"},
}
jit = numba.njit(**_options)
restrict = numba.njit(**_options, noalias=True)
"""For kernels none of whose arrays overlap, unless they are only read."""


def aligned_zeros(shape, dtype=np.float64) -> np.ndarray:
    """Zeros that begin with a cache line: a vector that straddles two of them costs twice."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    memory = np.zeros(size + CACHE_LINE, np.uint8)
    start = -memory.ctypes.data % CACHE_LINE
    return memory[start : start + size].view(dtype).reshape(shape)
