"""Compiled twins of plain kernels: the same text, made once by Numba, cached on disk.

A decorated kernel could not be traced, differentiated by complex step or run on symbols, and a decorator inside a
factory never finds its cache. So the text stays plain and a copy is compiled whose callees are twins too; `choose.twin`
is the door.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from time import time
from types import FunctionType
from typing import Any

Kernel = Callable[..., Any]
ALLOCATORS = {"zeros", "empty"}


def rebuild(kernel: FunctionType, wrap: Kernel, names: dict[str, Any] | None = None) -> Any:
    """Copy of `kernel` and of every pliant kernel that it calls, each passed through `wrap`.

    `names` replaces globals by name, e.g. ``{"np": shim}`` to run a kernel on symbols.
    """
    made: dict[FunctionType, Any] = {}

    def make(function: FunctionType) -> Any:
        if function not in made:
            scope = dict(function.__globals__)
            for callee in callees(function):
                scope[callee.__name__] = make(callee)
            scope.update(names or {})
            copy = FunctionType(function.__code__, scope, function.__name__, function.__defaults__)
            copy.__module__ = function.__module__
            copy.__qualname__ = function.__qualname__
            made[function] = wrap(copy)
        return made[function]

    return make(kernel)


def callees(kernel: FunctionType) -> list[FunctionType]:
    """The pliant kernels that `kernel` calls by their global names."""
    found = (kernel.__globals__.get(name) for name in kernel.__code__.co_names)
    return [f for f in found if isinstance(f, FunctionType) and f.__module__.startswith("pliant.")]


def reached(kernel: FunctionType) -> set[FunctionType]:
    """`kernel` and every pliant kernel that it calls, directly or not."""
    todo = [kernel]
    seen: set[FunctionType] = set()
    while todo:
        function = todo.pop()
        if function not in seen:
            seen.add(function)
            todo += callees(function)
    return seen


def options(kernel: FunctionType) -> dict[str, Any]:
    """How Numba compiles a kernel: cached, and without counting references to arrays unless it makes some.

    Where the caller owns every array the counting is idle, and with many arrays it takes longer than the mathematics.
    """
    makes = any(ALLOCATORS & set(function.__code__.co_names) for function in reached(kernel))
    return {"cache": True, "_nrt": makes}


def fingerprint(kernel: FunctionType, *more: str) -> str:
    """Digest of every source file that `kernel` reaches, of the parameter records beside them, and of `more` files.

    Numba's cache sees only the kernel's own file; an edit in a callee's file must miss the cache too, and so must a
    NamedTuple whose fields trade places: compiled code knows them by their place.
    """
    files = {__file__, *more, *(function.__code__.co_filename for function in reached(kernel))}
    for folder in {Path(f).parent for f in files}:
        files |= {str(f) for f in folder.glob("*.py") if "(NamedTuple)" in f.read_text(encoding="utf-8")}
    return hashlib.sha256(b"".join(Path(f).read_bytes() for f in sorted(files))).hexdigest()[:12]


def compiled_twin(kernel: FunctionType, tag: str, fast: dict[Any, Any], sources: tuple[str, ...]) -> Any:
    """The compiled twin of a plain kernel (Numba, nopython, cache on, fastmath off).

    `fast` holds compiled stand-ins for kernels that it calls, `sources` the files that made them; `tag` tells twins of
    one kernel apart.
    """
    from numba import njit

    digest, how = fingerprint(kernel, *sources), options(kernel)

    def wrap(copy: FunctionType) -> Any:
        copy.__qualname__ = f"{copy.__qualname__}_{tag}_{digest}"  # names the file of the cache
        return njit(**how)(copy)

    return swept(rebuild(kernel, wrap, {k.__name__: made for k, made in fast.items()}))


def swept(made: Any) -> Any:
    """A compiled kernel, after removing from the cache what older texts of it left there more than a day ago.

    Their names hold another digest, so that Numba would never look for them again, nor ever remove them.
    """
    name, _, digest = made.py_func.__qualname__.rpartition("_")
    for file in Path(made.stats.cache_path).glob(f"*.{name}_*-*.nb[ci]"):
        with suppress(OSError):  # another process may have been first
            if f"_{digest}-" not in file.name and time() - file.stat().st_mtime > 86400.0:
                file.unlink()
    return made
