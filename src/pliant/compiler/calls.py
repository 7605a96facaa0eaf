"""Calls of the machine code of recorded kernels from compiled loops, by the shapes of the arguments."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from hashlib import sha256
from types import FunctionType
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from pliant.compiler import machine_code
from pliant.compiler.cache import kept
from pliant.compiler.llvm import LlvmWriter, declared
from pliant.compiler.trace import kept_by, passed, record, shapes_of
from pliant.compiler.twin import fingerprint

KINDS = {"float64": "float", "vector(8)": "vector", "dual(8)": "dual"}  # by the names of Numba's types
WORD = ir.IntType(64)
PURE = ("readnone", "nounwind", "willreturn", "speculatable")  # so that LLVM moves the search out of loops over time


def leaves(name: str, kind: Any) -> Iterator[tuple[str, Any, tuple[int, ...]]]:
    """Yield path, Numba type and position of each array and number in an argument, such as ``body.B``."""
    if not isinstance(kind, types.BaseTuple):
        yield name, kind, ()
        return
    record: Any = kind
    for i, (field, part) in enumerate(zip(record.fields, record.types, strict=True)):
        for path, leaf, where in leaves(f"{name}.{field}", part):
            yield path, leaf, (i, *where)


def array_of(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Return the parts of an array, such as its shape, from its Numba type and LLVM value."""
    return context.make_array(kind)(context, builder, value)


class Arguments:
    """Leaves of the arguments of a call of a kernel that are passed to its machine code, with their Numba types."""

    def __init__(self, kernel: FunctionType, given: Any) -> None:
        names = kernel.__code__.co_varnames[: kernel.__code__.co_argcount]
        every = {
            path: (kind, (i, *where)) for i, (name, whole) in enumerate(zip(names, given, strict=True))
            for path, kind, where in leaves(name, whole)
        }
        self.leaves = [every[path] for path in passed(kernel, every)]
        arrays = [kind for kind, _ in self.leaves if isinstance(kind, types.Array)]
        self.number = arrays[0].dtype
        self.fit = all(a.layout == "C" and a.dtype == self.number for a in arrays) and str(self.number) in KINDS

    def values(self, builder: Any, given: Any) -> Iterator[tuple[Any, Any]]:
        """Yield Numba type and LLVM value of each leaf, from the LLVM value of all arguments."""
        for kind, where in self.leaves:
            yield kind, builder.extract_value(given, where)

    def entry(self, context: Any, builder: Any, given: Any, seed: int) -> Any:
        """Return the key of the machine code for the shapes of the arguments, as `machine_code.key` does."""
        key: Any = ir.Constant(WORD, seed)
        for kind, value in self.values(builder, given):
            if isinstance(kind, types.Array):
                shape = array_of(context, builder, kind, value).shape
                for size in (builder.extract_value(shape, k) for k in range(kind.ndim)):
                    key = builder.mul(builder.xor(key, size), ir.Constant(WORD, machine_code.PRIME))
        return key

    def handed(self, context: Any, builder: Any, given: Any) -> Iterator[Any]:
        """Yield the arguments of the machine code: a pointer for each array, and each number or its two parts."""
        for kind, value in self.values(builder, given):
            if isinstance(kind, types.Array):
                yield array_of(context, builder, kind, value).data
                continue
            number = context.cast(builder, value, kind, self.number)
            if KINDS[str(self.number)] == "dual":
                yield from (builder.extract_value(number, 0), builder.extract_value(number, 1))
            else:
                yield number


def addressed(kernel: FunctionType, seeds: dict[str, int]) -> Any:
    """Return a function for compiled code, which returns the address of a kernel's machine code for its arguments."""

    @intrinsic
    def address(_context: Any, given: Any) -> Any:
        arguments = Arguments(kernel, given)

        def generate(context: Any, builder: Any, _sig: Any, values: Any) -> Any:
            entry = arguments.entry(context, builder, values[0], seeds[KINDS[str(arguments.number)]])
            kind = ir.FunctionType(WORD, [WORD])
            finder = declared(builder.module, kind, machine_code.FINDER)
            finder.attributes.update(PURE)
            return builder.call(finder, [entry])

        return (types.int64(given), generate) if arguments.fit else None

    return address


def by_pointer(kernel: FunctionType) -> Any:
    """Return a function for compiled code, which calls the machine code of a kernel at an address."""

    @intrinsic
    def call(_context: Any, address: Any, given: Any) -> Any:
        arguments = Arguments(kernel, given)

        def generate(context: Any, builder: Any, _sig: Any, values: Any) -> Any:
            handed = list(arguments.handed(context, builder, values[1]))
            kind = ir.FunctionType(ir.VoidType(), [value.type for value in handed])
            builder.call(builder.inttoptr(values[0], kind.as_pointer()), handed)
            return context.get_dummy_value()

        return types.void(address, given), generate

    return call


def _run(*arguments):
    where = address(arguments)  # noqa: F821  given by `caller`, as `call`
    if where == 0:
        raise RuntimeError("no machine code for arguments of these shapes: compile the loop with `twin` for this chain")
    call(where, arguments)  # noqa: F821


@cache
def caller(kernel: FunctionType, sources: tuple[str, ...], *, fused: bool) -> Any:
    """Return a kernel for compiled loops which calls the machine code of the recorded `kernel` for the shapes of its
    arguments, with the same arguments as the kernel. `provide` makes this code.
    """
    machine_code.code_table()
    name = title(kernel, sources, fused=fused)
    seeds = {kind: machine_code.seed_of(f"{name}_{kind}") for kind in KINDS.values()}
    copy = FunctionType(_run.__code__, {"address": addressed(kernel, seeds), "call": by_pointer(kernel)}, name)
    copy.__qualname__ = name  # Numba links by this name, which must differ between kernels
    copy.__module__ = __name__
    return kept(copy, _nrt=False, forceinline=True)


def title(kernel: FunctionType, sources: tuple[str, ...], *, fused: bool) -> str:
    """Return a name that identifies a kernel and the text that makes machine code of it."""
    return f"{kernel.__name__}{'_fused' * fused}_{fingerprint(kernel, __file__, machine_code.__file__, *sources)}"


def provide(
    kernel: FunctionType, written: FunctionType, examples: dict[str, Any], kind: str, sources: tuple[str, ...], *,
    fused: bool,
) -> None:
    """Make machine code ready for the calls of `kernel`, see `caller`, for arguments with the shapes of `examples` and
    numbers of a kind: "float", "vector" or "dual". It is that of the kernel `written`, with the same arguments.

    The kernel is recorded only if its machine code is not stored.
    """
    shapes = {path: shape for name, e in examples.items() for path, shape in shapes_of(name, e).items()}
    paths, seed = passed(kernel, shapes), machine_code.seed_of(f"{title(kernel, sources, fused=fused)}_{kind}")
    entry = machine_code.key(seed, [size for path in paths for size in shapes[path]])
    order = sha256(repr(paths).encode()).hexdigest()[:8]  # of the arguments: fields of records, declared elsewhere
    name = f"{title(written, sources, fused=fused)}_{kind}_{order}_{entry:016x}"

    def text() -> str:
        return LlvmWriter(record(written, examples, kept_by(kernel)), paths, name, kind, fused=fused).write()

    machine_code.provide(entry, name, text)
