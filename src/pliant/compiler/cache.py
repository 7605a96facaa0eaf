"""Compilation of kernels by Numba, with a cache on disk that all processes of a user share.

`pliant.compiler.kernel_cache` describes the contents and the folder of this cache. It uses private names of Numba. With
a version of Numba that lacks one of them, kernels are compiled again in every process, with one warning.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from types import FunctionType
from typing import Any
from warnings import warn

import numba
from numba import njit, types
from numba.core.compiler_lock import global_compiler_lock

from pliant.compiler.kernel_files import alone

try:
    from pliant.compiler import kernel_cache
except (ImportError, AttributeError):  # a Numba version with other private names
    kernel_cache = None  # type: ignore[assignment]

__all__ = ["alone", "kept", "kernel_cache", "part"]
OBJECTS = 100_000  # made between two searches for cyclic garbage; a kernel makes millions


def has_array(kind: Any) -> bool:
    """Return whether a Numba type is an array, or a tuple or record that contains one."""
    parts: Any = kind if isinstance(kind, types.BaseTuple) else ()
    return isinstance(kind, types.Array) or any(map(has_array, parts))


def kept(function: Any, *, stored: bool = True, **options: Any) -> Any:
    """Return `function` compiled by Numba. Its machine code is loaded from the cache on disk if it is `stored` there,
    else compiled at the first call.

    Numba's options are nopython, and fastmath off.

    If several processes need the same kernel at once, one compiles it and the others wait. If the cache cannot be
    written, every process compiles the kernel, with one warning.
    """
    options["no_cfunc_wrapper"] = True  # an interface for C, which is not used
    compiled = njit(**options)(function)
    compiled.given = options
    compile_unchecked = compiled.compile

    def compile_now(signature: Any) -> Any:
        entry = compile_unchecked(signature)
        handed = [done.signature.return_type for done in compiled.overloads.values()]
        if not options.get("_nrt", True) and any(map(has_array, handed)):
            raise TypeError(f"{function.__qualname__} returns an array, but is compiled without reference counting: "
                            "write into an array of the caller")  # fmt: skip
        return entry

    compiled.compile = compile_now
    if stored:
        store(compiled)
    return compiled


def store(compiled: Any) -> None:
    """Make a compiled function load its machine code from the cache on disk, and store it there."""
    if kernel_cache is None:
        warn_of_numba()
        return
    try:
        compiled._cache = kernel_cache.KernelCache(compiled.py_func)  # noqa: SLF001  as `enable_caching` of Numba does
    except RuntimeError:  # no writable folder, neither the shared one nor Numba's defaults
        tell_uncached()
        return
    lock, compile_now = compiled._cache.index.with_suffix(".lock"), compiled.compile  # noqa: SLF001

    def compile_alone(signature: Any) -> Any:
        with global_compiler_lock, rare_collections():  # the lock first: two threads could deadlock in another order
            with alone(lock) as first:
                if first:
                    return compile_now(signature)
            compiled._cache.disable()  # noqa: SLF001
            try:
                return compile_now(signature)
            finally:
                compiled._cache.enable()  # noqa: SLF001

    compiled.compile = compile_alone


@contextmanager
def rare_collections() -> Iterator[None]:
    """Context manager in which Python looks for cyclic garbage less often. Most objects that Numba makes live until a
    kernel is compiled, so that looking for others took a tenth of the time.
    """
    before = gc.get_threshold()
    gc.set_threshold(OBJECTS if before[0] else 0, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)


@cache
def part(whole: Any) -> Any:
    """Return a compiled kernel in a form that only other compiled kernels can call, which is faster to compile.

    It saves a third of the compile time: there is no interface for Python, and less optimisation, which is repeated
    where its callers are optimised. It is not stored: its code is in that of its callers.
    """
    function = whole.py_func
    copy = FunctionType(function.__code__, function.__globals__, function.__name__, function.__defaults__)
    copy.__module__ = function.__module__
    kernel, _, digest = function.__qualname__.rpartition("_")
    copy.__qualname__ = f"{kernel}_part_{digest}"
    pipeline = {} if kernel_cache is None else {"pipeline_class": kernel_cache.Part}
    return kept(copy, stored=False, **whole.given, no_cpython_wrapper=True, **pipeline)


@cache
def tell_uncached() -> None:
    """Warn once that compiled kernels cannot be stored on disk, because no cache folder can be written."""
    warn(
        "compiled kernels cannot be stored, so each start compiles them again, which takes seconds: set the "
        "environment variable NUMBA_CACHE_DIR to a folder that can be written",
        RuntimeWarning, stacklevel=2,
    )


@cache
def warn_of_numba() -> None:
    """Warn once that compiled kernels cannot be stored on disk, because the installed Numba version
    is not supported.
    """
    warn(
        f"compiled kernels cannot be stored with Numba {numba.__version__}, so each start compiles them again, which "
        "takes seconds: install a version that pliant was tested with (pip install 'numba<0.69')",
        RuntimeWarning, stacklevel=2,
    )
