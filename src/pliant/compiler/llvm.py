"""Compilation of a kernel from the list of its arithmetic operations, which the module `trace` has recorded. The
operations are written directly as LLVM instructions.

Numba compiles only the call. If the same operations were Python source, Numba would need up to six times as long. The
operands may be floats, complex numbers and `simd` vectors: an operation is done in the wider type of its operands.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from types import FunctionType
from typing import Any

import numpy as np
from numba import types
from numba.core import cgutils
from numba.core.extending import intrinsic
from numba.core.typing.templates import signature

from pliant.compiler.cache import kept
from pliant.compiler.trace import KernelProgram, Mark
from pliant.compiler.trig import pair

OPERATORS = {"+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv}
FLOATS = {"+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv"}
Value = tuple[Any, Any]  # Numba's type and LLVM's value


def square_root(x):
    """Return the square root of a number of any type."""
    return np.sqrt(x)


class LlvmWriter:
    """Writer of a kernel's recorded operations as LLVM instructions of one function, for given argument types."""

    def __init__(
        self, target: tuple[Any, Any], made: KernelProgram, arguments: dict[str, Value], *, fused: bool,
    ) -> None:
        self.context, self.builder = target
        self.made, self.arguments, self.flags = made, arguments, ("contract",) if fused else ()
        self.values: dict[int, Value] = {}
        self.arrays: dict[str, Value] = {}
        self.angles: dict[int, Any] = {}

    def write(self) -> None:
        """Write the LLVM instructions that compute the results of the kernel and store them in the arrays among its
        arguments.
        """
        for row in self.made.needed:
            self.values[row] = self.number(*self.made.rows[row])
        for where, mark in self.made.stores:
            kind, pointer = self.element(where)
            self.builder.store(self.cast(self.values[mark.row], kind), pointer)

    def number(self, what: str, operands: tuple[Any, ...]) -> Value:
        """Return the LLVM value of one recorded operation, or of one number among the kernel's arguments."""
        if not operands:
            return self.given(what)
        if what in ("cos", "sin"):
            kind, both = self.cosine_and_sine(operands[0])
            return kind, self.builder.extract_value(both, int(what == "sin"))
        if what == "sqrt":
            kind, value = self.values[operands[0].row]
            return kind, self.context.compile_internal(self.builder, square_root, signature(kind, kind), [value])
        values = [self.values[o.row] if isinstance(o, Mark) else self.constant(o) for o in operands]
        kind = next((k for k, _ in values if k != types.float64), types.float64)
        if len(values) == 1:
            values = [self.constant(-0.0), *values]
        kinds = [k for k, _ in values] if getattr(kind, "mixes", False) else [kind, kind]
        constants = [self.cast(v, k) for v, k in zip(values, kinds, strict=True)]
        if kind == types.float64 or getattr(kind, "plain", False):
            return kind, getattr(self.builder, FLOATS[what])(*constants, flags=self.flags)
        done = self.context.get_function(OPERATORS[what], signature(kind, *kinds))
        return kind, done(self.builder, constants)

    def constant(self, value: float) -> Value:
        """Return a Python number as an LLVM constant with its Numba type."""
        return types.float64, self.context.get_constant(types.float64, float(value))

    def cast(self, value: Value, kind: Any) -> Any:
        """Return an LLVM value converted to the Numba type `kind`."""
        return value[1] if value[0] == kind else self.context.cast(self.builder, value[1], value[0], kind)

    def cosine_and_sine(self, angle: Mark) -> Value:
        """Return cosine and sine of an angle as one LLVM value, computed once for each angle of the kernel."""
        kind, value = self.values[angle.row]
        if angle.row not in self.angles:
            result_type = signature(types.UniTuple(kind, 2), kind)
            self.angles[angle.row] = self.context.compile_internal(self.builder, pair, result_type, [value])
        return kind, self.angles[angle.row]

    def given(self, where: str) -> Value:
        """Return the LLVM value of a number among the kernel's arguments: an array element or a scalar."""
        if "[" in where:
            kind, pointer = self.element(where)
            return kind, self.builder.load(pointer)
        kind, value = self.argument(where)
        wide = types.float64 if isinstance(kind, types.Float | types.Integer) else kind
        return wide, self.cast((kind, value), wide)

    def argument(self, path: str) -> Value:
        """Return Numba type and LLVM value of a kernel's argument or of a field in it, given by a path such as
        ``body.gx``.
        """
        name, *fields = path.split(".")
        kind, value = self.arguments[name]
        for field in fields:
            index = kind.fields.index(field)
            kind, value = kind.types[index], self.builder.extract_value(value, index)
        return kind, value

    def element(self, where: str) -> Value:
        """Return the Numba type and the LLVM pointer of an array element, given by a path such as ``body.B[2, 1]``."""
        path, _, numbers = where.removesuffix("]").partition("[")
        if path not in self.arrays:
            from numba.np.arrayobj import make_array  # slow import, not needed for code from the cache

            kind, value = self.argument(path)
            self.arrays[path] = kind, make_array(kind)(self.context, self.builder, value)
        kind, array = self.arrays[path]
        indices = [self.context.get_constant(types.intp, int(i)) for i in numbers.split(",")]
        return kind.dtype, cgutils.get_item_pointer(self.context, self.builder, kind, array, indices)


def compiled(name: str, recorded: Callable[[], KernelProgram], *, fused: bool = False) -> Any:
    """Return a kernel's recorded operations as a compiled function, stored in the cache on disk under `name`.

    `name` must identify everything on which the code depends. `recorded` returns the recording when it must be
    compiled.

    With `fused`, a multiplication and the addition of its result may be one instruction with one rounding.
    """

    @intrinsic
    def run(_context: Any, arguments: Any) -> Any:
        def generate(context: Any, builder: Any, _sig: Any, values: Any) -> Any:
            trace = recorded()
            parts = (builder.extract_value(values[0], i) for i in range(len(arguments)))
            named_values = zip(trace.names, zip(arguments, parts, strict=True), strict=True)
            LlvmWriter((context, builder), trace, dict(named_values), fused=fused).write()
            return context.get_dummy_value()

        return types.void(arguments), generate

    copy = FunctionType(_run.__code__, {"run": run}, name)
    copy.__qualname__ = name  # Numba links by this name, which must differ between kernels
    copy.__module__ = __name__
    return kept(copy, _nrt=False)


def _run(*arguments):
    run(arguments)  # noqa: F821  given by `compiled`
