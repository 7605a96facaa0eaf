"""Compiled kernels: copies of plain Python functions, compiled by Numba from the same source and cached on disk.

The kernels themselves are not decorated: a decorated kernel could not be recorded, differentiated by complex step or
run on symbols, and a decorator inside a factory function never finds its cache. A copy is compiled instead, whose
callees are compiled copies too; see `choose.twin`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Mapping
from dis import get_instructions
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, TypeGuard

Kernel = Callable[..., Any]
ALLOCATORS = {"zeros", "empty"}


def rebuild(kernel: FunctionType, wrap: Kernel, names: dict[str, Any] | None = None) -> Any:
    """Return a copy of `kernel`, wrapped by `wrap`. It calls wrapped copies of the pliant functions in place of the
    originals.

    `names` replaces globals by name, e.g. ``{"np": shim}`` to run a kernel on symbols.
    """
    rebuilt: dict[FunctionType, Any] = {}

    def make(function: FunctionType) -> Any:
        if function not in rebuilt:
            scope = dict(function.__globals__)
            for callee in callees(function):
                scope[callee.__name__] = make(callee)
            scope.update(names or {})
            copy = FunctionType(function.__code__, scope, function.__name__, function.__defaults__)
            copy.__module__ = function.__module__
            copy.__qualname__ = function.__qualname__
            rebuilt[function] = wrap(copy)
        return rebuilt[function]

    return make(kernel)


def callees(kernel: FunctionType) -> list[FunctionType]:
    """Return the pliant functions that `kernel` calls directly by their global names."""
    candidates = (kernel.__globals__.get(name) for name in kernel.__code__.co_names)
    return [f for f in candidates if is_kernel(f)]


def is_kernel(value: Any) -> TypeGuard[FunctionType]:
    """Return whether a value is a plain Python function of the package pliant."""
    return isinstance(value, FunctionType) and value.__module__.startswith("pliant.")


def reached(kernel: FunctionType, replaced: Collection[FunctionType] = ()) -> set[FunctionType]:
    """Return the set of `kernel` and all pliant functions that it calls directly or indirectly, except those in
    `replaced`.
    """
    todo = [kernel]
    visited: set[FunctionType] = set()
    while todo:
        function = todo.pop()
        if function not in visited and function not in replaced:
            visited.add(function)
            todo += callees(function)
    return visited


def options(kernel: FunctionType, replaced: Collection[FunctionType] = ()) -> dict[str, Any]:
    """Return Numba's compile options for a kernel: inlining, and reference counting only if it allocates arrays.

    References are counted if the kernel allocates arrays. A call which is not inlined copies every number of its record
    arguments, which can take several times as long as the step itself. Reference counting is not needed where the
    caller owns every array, and with many arrays it takes longer than the mathematics. Kernels in `replaced` are not
    considered, because they are compiled separately.
    """
    return {"_nrt": any(map(makes_arrays, reached(kernel, replaced))), "forceinline": True}


@cache
def makes_arrays(kernel: FunctionType) -> bool:
    """Return whether a kernel's code allocates an array or writes to a slice, for which Numba may allocate a temporary
    copy.

    Reading a slice does not count, because no kernel returns an array.
    """
    steps = list(get_instructions(kernel))
    parts = [s.opname == "BUILD_SLICE" or isinstance(s.argval, slice) for s in steps]
    written = any(part and after.opname == "STORE_SUBSCR" for part, after in zip(parts, steps[1:], strict=False))
    written = written or any(s.opname == "STORE_SLICE" for s in steps)
    return written or bool(ALLOCATORS & set(kernel.__code__.co_names))


def fingerprint(kernel: FunctionType, *sources: str) -> str:
    """Return a digest (12 hex digits) of everything that determines the machine code of `kernel`.

    This is the code of all kernels that it calls, the global values which they use, and the files `sources` of the
    modules which transform them. The code is that of this process, even if the source files have changed since it
    started.
    """
    functions = sorted(reached(kernel), key=lambda f: (f.__module__, f.__qualname__))
    texts = repr([(f.__module__, f.__qualname__, contents(f.__code__), f.__defaults__, frozen(f)) for f in functions])
    return hashlib.sha256(b"".join([texts.encode(), *map(bytes_of, sorted(sources))])).hexdigest()[:12]


@cache
def bytes_of(file: str) -> bytes:
    """Return the content of a source file, which is read once in each process."""
    return Path(file).read_bytes()


def contents(code: CodeType) -> tuple[Any, ...]:
    """Return a tuple of everything that determines the behaviour of a code object, without its line numbers."""
    constants = [contents(c) if isinstance(c, CodeType) else stable(c) for c in code.co_consts]
    names = (code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars)
    return (code.co_code, code.co_flags, code.co_argcount, code.co_kwonlyargcount, names, constants)


def frozen(kernel: FunctionType) -> list[tuple[str, Any]]:
    """Return the global values, except functions, that compilation copies into a kernel's code as constants."""
    constants = [(name, kernel.__globals__[name]) for name in mentioned(kernel.__code__) if name in kernel.__globals__]
    return [(name, stable(value)) for name, value in constants if not is_kernel(value)]


def mentioned(code: CodeType) -> list[str]:
    """Return all names that a code object looks up, including those in nested expressions."""
    inner = (name for c in code.co_consts if isinstance(c, CodeType) for name in mentioned(c))
    return sorted({*code.co_names, *inner})


def stable(value: Any) -> Any:
    """Return a representation of `value` that is equal in every process and differs for different values."""
    if isinstance(value, frozenset):
        return ("frozenset", sorted(map(repr, map(stable, value))))
    if isinstance(value, tuple):
        return (type(value).__qualname__, *map(stable, value))
    if value is None or value is Ellipsis or isinstance(value, bool | int | float | complex | str | bytes):
        return repr(value)
    if isinstance(value, ModuleType) and not value.__name__.startswith("pliant"):
        return value.__name__
    if callable(value):
        return (getattr(value, "__module__", ""), getattr(value, "__qualname__", type(value).__qualname__),
                getattr(value, "_fields", ()))  # fmt: skip
    raise TypeError(f"a kernel may use global numbers, tuples, functions and records, not {value!r}")


def compiled_twin(
    kernel: FunctionType, tag: str, made: Kernel, sources: tuple[str, ...], *, replaced: Collection[FunctionType] = (),
    names: Mapping[str, Any] | None = None, **more: Any,
) -> Any:
    """Return a copy of the plain Python `kernel`, compiled by Numba and cached on disk.

    Numba's options are nopython, and fastmath off.

    `made` returns the compiled form of a kernel that it calls, which for the kernels in `replaced`, and for those that
    call them, comes from other source text. `sources` are the files that transform the text, and `names` Numba
    functions in place of kernels of these names. `more` holds further options of Numba. `tag` distinguishes the
    compiled forms of one kernel.
    """
    from pliant.compiler.cache import kept, part

    namespace = names or {}
    linked = {f.__name__: part(made(f)) for f in callees(kernel) if f.__name__ not in namespace}
    scope = {**kernel.__globals__, **namespace, **linked}
    copy = FunctionType(kernel.__code__, scope, kernel.__name__, kernel.__defaults__)
    copy.__module__ = kernel.__module__
    digest = fingerprint(kernel, __file__, *sources)
    if replaced:  # the names of what is linked end in digests of its own text and of what it calls
        names_linked = [digest, *(f.py_func.__qualname__ for f in linked.values())]
        digest = hashlib.sha256(repr(names_linked).encode()).hexdigest()[:12]
    copy.__qualname__ = f"{kernel.__qualname__}_{tag}_{digest}"  # names the file of the cache
    return kept(copy, **(options(kernel, replaced) | more))
