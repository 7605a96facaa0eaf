"""Kernels compiled by Numba, kept between runs, and shared by processes that start together.

What is kept, and where, says `pliant.compiler.kernel_cache`. It uses names that Numba keeps to itself; with a Numba
that lacks one, kernels are compiled anew in every process, which is said once.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from time import monotonic, sleep
from types import FunctionType
from typing import IO, Any
from warnings import warn

import numba
from numba import njit, types
from numba.core.compiler_lock import global_compiler_lock

try:
    from pliant.compiler import kernel_cache
except (ImportError, AttributeError):  # a Numba whose inner names are others
    kernel_cache = None  # type: ignore[assignment]

try:
    import fcntl
except ImportError:  # no such locks on this system: processes compile side by side, and only one of them saves well
    fcntl = None  # type: ignore[assignment]

LONGEST_WAIT = 120.0  # s, for another process that compiles the same kernel; then this one compiles for itself


def has_array(kind: Any) -> bool:
    """Whether a type of Numba is that of an array, or of a record with one."""
    parts: Any = kind if isinstance(kind, types.BaseTuple) else ()
    return isinstance(kind, types.Array) or any(map(has_array, parts))


def kept(function: Any, **options: Any) -> Any:
    """`function` compiled by Numba (nopython, fastmath off) when it is first called, or taken from the shared cache.

    Where several processes ask for one kernel at once, one compiles it and the others wait for it. Where nothing can be
    written, it is compiled anew in every process, with one warning.
    """
    options["no_cfunc_wrapper"] = True  # an interface for C, which is not used
    made = njit(**options)(function)
    made.given = options
    if kernel_cache is None:
        warn_of_numba()
        return made
    try:
        made._cache = kernel_cache.KernelCache(made.py_func)  # noqa: SLF001  as `enable_caching` of Numba does
    except RuntimeError:  # no folder takes a file: neither the shared one, nor those that Numba tries
        tell_uncached()
        return made
    lock = made._cache.index.with_suffix(".lock")  # noqa: SLF001
    compile_unchecked = made.compile

    def compile_now(signature: Any) -> Any:
        entry = compile_unchecked(signature)
        handed = [done.signature.return_type for done in made.overloads.values()]
        if not options.get("_nrt", True) and any(map(has_array, handed)):
            raise TypeError(f"{function.__qualname__} hands an array back whose references nobody counts: write into "
                            "one of the caller's")  # fmt: skip
        return entry

    def compile_alone(signature: Any) -> Any:
        with global_compiler_lock:  # first: two threads of which each holds one of both locks would wait for ever
            with alone(lock) as first:
                if first:
                    return compile_now(signature)
            made._cache.disable()  # noqa: SLF001
            try:
                return compile_now(signature)
            finally:
                made._cache.enable()  # noqa: SLF001

    made.compile = compile_alone
    return made


@cache
def part(whole: Any) -> Any:
    """A kernel of `kept` as those take it that call it and are compiled themselves: cheap, and of no use to Python.

    A third of the time that compiling takes goes into interfaces for Python, which are not used there, and into
    optimising what is optimised again in its callers.
    """
    function = whole.py_func
    copy = FunctionType(function.__code__, function.__globals__, function.__name__, function.__defaults__)
    copy.__module__ = function.__module__
    kernel, _, digest = function.__qualname__.rpartition("_")
    copy.__qualname__ = f"{kernel}_part_{digest}"
    pipeline = {} if kernel_cache is None else {"pipeline_class": kernel_cache.Part}
    return kept(copy, **whole.given, no_cpython_wrapper=True, **pipeline)


@cache
def tell_uncached() -> None:
    """Warn, once, that nothing can be kept."""
    warn(
        "no folder takes compiled kernels, so each start compiles them again, which takes seconds: let the environment "
        "variable NUMBA_CACHE_DIR name a folder that can be written",
        RuntimeWarning, stacklevel=2,
    )


@cache
def warn_of_numba() -> None:
    """Warn, once, that this Numba is another than those that pliant was tried with."""
    warn(
        f"Numba {numba.__version__} lacks names that keep compiled kernels between runs, so each start compiles them "
        "again, which takes seconds: install a version that pliant was tried with (pip install 'numba<0.69')",
        RuntimeWarning, stacklevel=2,
    )


@contextmanager
def alone(file: Path, wait: float | None = None) -> Iterator[bool]:
    """Whether this process alone holds the lock `file`; False after `wait` seconds (default: `LONGEST_WAIT`)."""
    if fcntl is None:
        yield True
        return
    with file.open("ab") as handle:
        got = taken(handle, LONGEST_WAIT if wait is None else wait)
        try:
            yield got
        finally:
            if got:
                fcntl.flock(handle, fcntl.LOCK_UN)  # said, not left to closing: a forked child holds the handle too


def taken(handle: IO[bytes], wait: float) -> bool:
    """Whether the lock of an open file came within so many seconds."""
    end = monotonic() + wait
    while True:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            if monotonic() > end:
                return False
            sleep(0.02)
        else:
            return True
