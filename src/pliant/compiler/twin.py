"""Compiled twins of plain kernels: the same text, made once by Numba, cached on disk.

A decorated kernel could not be traced, differentiated by complex step or run on symbols, and a decorator inside a
factory never finds its cache. So the text stays plain and a copy is compiled whose callees are twins too, see
`choose.twin`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection
from dis import get_instructions
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, TypeGuard

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
    return [f for f in found if is_kernel(f)]


def is_kernel(value: Any) -> TypeGuard[FunctionType]:
    """Whether something is a plain function of this package."""
    return isinstance(value, FunctionType) and value.__module__.startswith("pliant.")


def reached(kernel: FunctionType, replaced: Collection[FunctionType] = ()) -> set[FunctionType]:
    """`kernel` and every pliant kernel that it calls, directly or not."""
    todo = [kernel]
    seen: set[FunctionType] = set()
    while todo:
        function = todo.pop()
        if function not in seen and function not in replaced:
            seen.add(function)
            todo += callees(function)
    return seen


def options(kernel: FunctionType, replaced: Collection[FunctionType] = ()) -> dict[str, Any]:
    """How Numba compiles a kernel: inlined by its callers, without counting references to arrays unless it makes some.

    A call copies every number of the records that it hands over, which can take several times as long as the step that
    is called. Where the caller owns every array the counting is idle, and with many arrays it takes longer than the
    mathematics. Kernels that are `replaced` by stand-ins do not matter here: those were compiled for themselves.
    """
    return {"_nrt": any(map(makes_arrays, reached(kernel, replaced))), "forceinline": True}


@cache
def makes_arrays(kernel: FunctionType) -> bool:
    """Whether a kernel allocates an array or writes a whole part of one, which Numba may do by a copy.

    Taking a part does not count: no kernel hands an array back.
    """
    steps = list(get_instructions(kernel))
    parts = [s.opname == "BUILD_SLICE" or isinstance(s.argval, slice) for s in steps]
    written = any(part and after.opname == "STORE_SUBSCR" for part, after in zip(parts, steps[1:], strict=False))
    written = written or any(s.opname == "STORE_SLICE" for s in steps)
    return written or bool(ALLOCATORS & set(kernel.__code__.co_names))


def fingerprint(kernel: FunctionType, *sources: str) -> str:
    """Digest of all that the machine code of `kernel` comes from.

    The texts that it reaches, what they take from around them, and the files `sources` of those who rewrite them.

    Of the texts it takes what this process runs, not what may meanwhile stand in their files.
    """
    found = sorted(reached(kernel), key=lambda f: (f.__module__, f.__qualname__))
    texts = repr([(f.__module__, f.__qualname__, contents(f.__code__), f.__defaults__, frozen(f)) for f in found])
    return hashlib.sha256(b"".join([texts.encode(), *map(bytes_of, sorted(sources))])).hexdigest()[:12]


@cache
def bytes_of(file: str) -> bytes:
    """A source file, read once: what is edited later is not what this process runs."""
    return Path(file).read_bytes()


def contents(code: CodeType) -> tuple[Any, ...]:
    """What a text does, without where it stands."""
    constants = [contents(c) if isinstance(c, CodeType) else stable(c) for c in code.co_consts]
    names = (code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars)
    return (code.co_code, code.co_flags, code.co_argcount, code.co_kwonlyargcount, names, constants)


def frozen(kernel: FunctionType) -> list[tuple[str, Any]]:
    """The values from outside that compiling puts into a text; the kernels among them are `callees`."""
    given = [(name, kernel.__globals__[name]) for name in mentioned(kernel.__code__) if name in kernel.__globals__]
    return [(name, stable(value)) for name, value in given if not is_kernel(value)]


def mentioned(code: CodeType) -> list[str]:
    """Names that a text looks up, the expressions inside it included."""
    inner = (name for c in code.co_consts if isinstance(c, CodeType) for name in mentioned(c))
    return sorted({*code.co_names, *inner})


def stable(value: Any) -> Any:
    """Something that is printed alike in every process, and differs where the value does."""
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
    raise TypeError(f"a kernel reads numbers, tuples, functions and records from around it, not {value!r}")


def compiled_twin(
    kernel: FunctionType, tag: str, made: Kernel, sources: tuple[str, ...], *, replaced: Collection[FunctionType] = (),
    **more: Any,
) -> Any:
    """The compiled twin of a plain kernel (Numba, nopython, kept on disk, fastmath off).

    `made` gives the twin of a kernel that it calls, `sources` are the files that made stand-ins for those `replaced`,
    `more` holds further options of Numba; `tag` tells twins of one kernel apart.
    """
    from pliant.compiler.cache import kept, part

    scope = {**kernel.__globals__, **{f.__name__: part(made(f)) for f in callees(kernel)}}
    copy = FunctionType(kernel.__code__, scope, kernel.__name__, kernel.__defaults__)
    copy.__module__ = kernel.__module__
    digest = fingerprint(kernel, __file__, *sources)
    copy.__qualname__ = f"{kernel.__qualname__}_{tag}_{digest}"  # names the file of the cache
    return kept(copy, **(options(kernel, replaced) | more))
