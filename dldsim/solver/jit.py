"""Compilation options of every kernel and the home of the compiled code.

numba does not notice that a kernel called from another file has changed, and keeps compiled code
beside the source where it cannot use the directory that it was given. So the kernels have a cache
of their own, in a directory named after the kernel sources: an edit starts a fresh one. Where no
directory can be written, kernels are compiled anew in each process.
"""

import hashlib
import inspect
import os
import sys
import tempfile
import warnings
from pathlib import Path

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.caching import CompileResultCacheImpl, FunctionCache, UserProvidedCacheLocator
from numba.core.codegen import get_host_cpu_features
from numba.core.cpu import CPUTargetOptions
from numba.core.options import TargetOptions
from numba.extending import intrinsic

PACKAGE = Path(__file__).parents[1]
CACHE_LINE = 64  # bytes
PROBE = 64 * 1024
"""Bytes that a cache directory must take, about as much as one compiled kernel."""


def _kernel_sources() -> list[Path]:
    """The solver, whose constants are frozen into kernels, and modules with kernels elsewhere."""
    marker = "from dldsim.solver.jit import"
    return [
        p
        for p in sorted(PACKAGE.rglob("*.py"))
        if PACKAGE / "solver" in p.parents or marker in p.read_text("utf-8")
    ]


def _cache_home() -> Path:
    """Where the user wants caches. Raises RuntimeError for a user without a home directory."""
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(chosen)
    home = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(home) if Path(home).is_absolute() else Path.home() / ".cache") / "dldsim"


def _cache_directory() -> Path:
    digest = hashlib.sha256()
    for path in _kernel_sources():
        digest.update(path.read_bytes())
    return _cache_home() / f"numba-{digest.hexdigest()[:16]}"


def _usable_cache() -> Path | None:
    """The cache directory if something can be written there, else None, and a warning."""
    try:
        directory = _cache_directory()
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory) as file:
            file.write(bytes(PROBE))
    except (OSError, RuntimeError) as error:
        _warn(error)
        return None
    return directory


def _warn(error: Exception) -> None:
    warnings.warn(
        f"Compiled kernels cannot be kept ({error}): they are compiled anew in every process, "
        "which takes about a minute. Set NUMBA_CACHE_DIR to a directory that can be written.",
        RuntimeWarning,
        stacklevel=2,
    )


CACHE = _usable_cache()


class _InOurDirectory(CompileResultCacheImpl):
    """Compiled code of one kernel, in CACHE whatever numba's own settings are."""

    def __init__(self, function):
        path = inspect.getfile(function)
        self._locator = _Locator(function, path)
        name = f"{Path(path).stem}.{function.__qualname__}"
        self._filename_base = self.get_filename_base(name, sys.abiflags)


class _Locator(UserProvidedCacheLocator):
    def __init__(self, function, path):
        self._py_file, self._lineno = path, function.__code__.co_firstlineno
        self._cache_path = str(CACHE / self.get_suitable_cache_subpath(path))


class _KernelCache(FunctionCache):
    """A cache that is given up, with a warning, when its disk is full or goes away."""

    _impl_class = _InOurDirectory
    given_up = False

    def load_overload(self, sig, target_context):
        try:
            return super().load_overload(sig, target_context)
        except OSError as error:
            self._give_up(error)
            return None

    def save_overload(self, sig, data):
        try:
            super().save_overload(sig, data)
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        self.disable()
        if not _KernelCache.given_up:
            _KernelCache.given_up = True
            _warn(error)


def _compiler(**options):
    def compiled(function):
        kernel = numba.njit(**options)(function)
        if CACHE is not None and not numba.config.DISABLE_JIT:
            kernel._cache = _KernelCache(function)
        return kernel

    return compiled


# Loops over populations and faces gain up to a half from vectors of 512 bits, which LLVM avoids
# because the first processors that had them lowered their clock.
if numba.config.CPU_FEATURES is None and "+avx512vl" in get_host_cpu_features():
    numba.config.CPU_FEATURES = get_host_cpu_features() + ",-prefer-256-bit"

# numba can tell LLVM that arrays do not overlap (C's restrict), but offers no option for it.
CPUTargetOptions.noalias = TargetOptions.Mapping("noalias")

# NaN and infinity keep their meaning, so that the stability guard can see them.
# Python's lock is left to other threads, each with a scene of its own.
_options = {
    "error_model": "numpy",
    "fastmath": {"nsz", "arcp", "contract", "afn", "reassoc"},
    "nogil": True,
}
jit = _compiler(**_options)
restrict = _compiler(**_options, noalias=True)
"""For kernels none of whose arrays overlap, unless they are only read."""
inlined = _compiler(**_options, noalias=True, forceinline=True)
"""The same where many arguments make a call dear."""


LANES = 16
"""Elements that `copy_masked` copies at once: a vector of 512 bits in single precision."""


@intrinsic
def copy_masked(typing_context, target, at, source, begin, mask):
    """target[at + i] = source[begin + i] for the LANES elements i whose bit of ``mask`` is set.

    Arrays (n,) of one floating-point type, which do not overlap here; places as uint64, the mask as
    uint32. One vector and a masked store, for which numba has no words.
    """

    def generate(context, builder, signature, arguments):
        target, at, source, begin, mask = arguments
        element = context.get_data_type(signature.args[0].dtype)
        size = context.get_abi_sizeof(element)
        vector, bits = ir.VectorType(element, LANES), ir.VectorType(ir.IntType(1), LANES)

        def place(kind, array, index):
            data = context.make_array(kind)(context, builder, array).data
            return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())

        values = builder.load(place(signature.args[2], source, begin))
        values.align = size
        width = ir.IntType(32)
        store = cgutils.get_or_insert_function(
            builder.module,
            ir.FunctionType(ir.VoidType(), [vector, vector.as_pointer(), width, bits]),
            f"llvm.masked.store.v{LANES}f{8 * size}.p0",
        )
        chosen = builder.bitcast(builder.trunc(mask, ir.IntType(LANES)), bits)
        where = place(signature.args[0], target, at)
        builder.call(store, [values, where, ir.Constant(width, size), chosen])
        return context.get_dummy_value()

    places = types.uint64
    return types.void(target, places, source, places, types.uint32), generate


def aligned_zeros(shape, dtype=np.float64) -> np.ndarray:
    """Zeros that begin with a cache line: a vector that straddles two of them costs twice."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    memory = np.zeros(size + CACHE_LINE, np.uint8)
    start = -memory.ctypes.data % CACHE_LINE
    return memory[start : start + size].view(dtype).reshape(shape)
