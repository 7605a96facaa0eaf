"""SIMD vectors: `WIDTH` numbers in one processor register, so that one kernel call advances `WIDTH` chains at once.

Numba is given a scalar type `vector`, which is an LLVM vector. It has the arithmetic of floats, mixes with floats, and
has sine, cosine, floor and rounding. A kernel is compiled for arrays of such vectors from its own source. An array of
vectors is a float array whose last axis has `WIDTH` entries (`as_lanes`, in compiled code).
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from functools import reduce
from math import prod
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core.typeconv.castgraph import Conversion
from numba.extending import (
    intrinsic,
    lower_builtin,
    lower_cast,
    models,
    overload,
    register_jitable,
    register_model,
    type_callable,
)

from pliant.compiler import WIDTH
from pliant.compiler.llvm import declared, filled
from pliant.numerics.trig import cos_sin

_ALIGN = 8 * WIDTH  # bytes
_DOUBLES = ir.VectorType(ir.DoubleType(), WIDTH)
_INDICES = ir.VectorType(ir.IntType(32), WIDTH)
NUMBERS = (types.Float, types.Integer)


class Wide(types.Type):
    """Numba type of several doubles that act as one number. Floats and integers are converted to it."""

    def __init__(self, name: str, doubles: int) -> None:
        super().__init__(name=f"{name}({WIDTH})")
        self.bitwidth = 64 * doubles

    def can_convert_from(self, _context: Any, other: Any) -> Any:
        """Tell Numba that floats and integers can be converted to this type."""
        return Conversion.safe if isinstance(other, NUMBERS) else None

    def unify(self, _context: Any, other: Any) -> Any:
        """Tell Numba that a variable has this type if it is a float on one branch of the code and of this type on
        another.
        """
        return self if isinstance(other, NUMBERS) else None


class Lanes(Wide):
    """Numba type of a SIMD vector of `WIDTH` doubles. A float is converted to a vector of equal elements."""

    def __init__(self) -> None:
        super().__init__("vector", WIDTH)


vector = Lanes()


@register_model(Lanes)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _DOUBLES)


@lower_cast(types.Float, Lanes)  # type: ignore[untyped-decorator]
@lower_cast(types.Integer, Lanes)  # type: ignore[untyped-decorator]
def _repeat(context: Any, builder: Any, kind: Any, _lanes: Any, value: Any) -> Any:
    number = context.cast(builder, value, kind, types.float64)
    none = ir.Constant(_DOUBLES, ir.Undefined)
    first = builder.insert_element(none, number, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, none, ir.Constant(_INDICES, [0] * WIDTH))


def _define(operation: Any, instruction: str, operands: int) -> None:
    """Register with Numba an operator of vectors, implemented by one LLVM instruction."""

    @type_callable(operation)
    def _typed(_context: Any) -> Any:
        def signature(*args: Any) -> Any:
            fits = len(args) == operands and vector in args and all(a == vector or isinstance(a, NUMBERS) for a in args)
            return vector(*[vector] * operands) if fits else None

        return signature

    @lower_builtin(operation, *[Lanes] * operands)  # type: ignore[untyped-decorator]
    def _lowered(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        return getattr(builder, instruction)(*args)


for _name, _instruction in (("add", "fadd"), ("sub", "fsub"), ("mul", "fmul"), ("truediv", "fdiv")):
    _define(getattr(operator, _name), _instruction, 2)
    _define(getattr(operator, f"i{_name}"), _instruction, 2)
_define(operator.neg, "fneg", 1)


def _vector_function(builder: Any, name: str, x: Any) -> Any:
    kind = ir.FunctionType(_DOUBLES, [_DOUBLES])
    return builder.call(declared(builder.module, kind, f"llvm.{name}.v{WIDTH}f64"), [x])


def _unary(name: str) -> Any:
    """Return the LLVM intrinsic `name` as a function of vectors."""

    @intrinsic
    def call(_context: Any, x: Any) -> Any:
        def generate(_target: Any, builder: Any, _sig: Any, args: Any) -> Any:
            return _vector_function(builder, name, args[0])

        return vector(x), generate

    return call


_floor, _rint, _sqrt = _unary("floor"), _unary("rint"), _unary("sqrt")
_cos_sin = register_jitable(cos_sin)


@overload(np.floor)
def _np_floor(x):
    return (lambda x: _floor(x)) if x == vector else None  # noqa: PLW0108  Numba takes Python functions here


@overload(np.rint)
def _np_rint(x):
    return (lambda x: _rint(x)) if x == vector else None  # noqa: PLW0108


@overload(np.sqrt)
def _np_sqrt(x):
    return (lambda x: _sqrt(x)) if x == vector else None  # noqa: PLW0108


@overload(np.sin)
def _np_sin(x):
    return (lambda x: _cos_sin(x)[1]) if x == vector else None


@overload(np.cos)
def _np_cos(x):
    return (lambda x: _cos_sin(x)[0]) if x == vector else None


@intrinsic
def within(_context: Any, x: Any, limit: Any) -> Any:
    """Return an integer whose bit k is 1 if the absolute value of element k of the SIMD vector x is at most `limit`,
    else 0 (also for NaN).
    """

    def generate(_target: Any, builder: Any, _sig: Any, args: Any) -> Any:
        size = _vector_function(builder, "fabs", args[0])
        bits = builder.bitcast(builder.fcmp_ordered("<=", size, args[1]), ir.IntType(WIDTH))
        return builder.zext(bits, ir.IntType(64))

    return types.int64(vector, vector), generate


@intrinsic
def as_lanes(_context: Any, array: Any) -> Any:
    """Return a float array (..., WIDTH) as an array (...) of SIMD vectors that shares its memory.

    `aligned` makes such arrays.
    """
    if not (isinstance(array, types.Array) and array.layout == "C" and array.dtype == types.float64):
        return None
    result = types.Array(vector, array.ndim - 1, "C")

    def generate(context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        return borrowed(context, builder, result, rows_as_numbers(context, builder, array, result, args[0]))

    return result(array), generate


def rows_as_numbers(context: Any, builder: Any, array: Any, result: Any, value: Any) -> Any:
    """Return a float array (..., k) as an array (...) of the Numba type `result`, whose numbers are k floats."""
    source = context.make_array(array)(context, builder, value)
    wide = context.make_array(result)(context, builder)
    shape, strides = ([builder.extract_value(part, k) for k in range(result.ndim)]
                      for part in (source.shape, source.strides))
    wide.meminfo, wide.parent, wide.data = source.meminfo, source.parent, builder.bitcast(source.data, wide.data.type)
    wide.shape, wide.strides = (filled(wide.shape.type, part, builder) for part in (shape, strides))
    wide.itemsize = context.get_constant(types.intp, result.dtype.bitwidth // 8)
    wide.nitems = reduce(builder.mul, shape, context.get_constant(types.intp, 1))
    return wide._getvalue()  # noqa: SLF001  Numba's own way


def borrowed(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Return a value that shares memory with an argument, after counting one more reference to this memory."""
    if context.enable_nrt:
        context.nrt.incref(builder, kind, value)
    return value


@intrinsic
def lanes_of(_context: Any, record: Any) -> Any:
    """Return a record of float arrays (..., WIDTH) as the same record of arrays (...) of SIMD vectors that share their
    memory. An array (WIDTH,) becomes one vector, read when the record is made.
    """
    if not isinstance(record, types.NamedTuple):
        return None
    kinds = [types.Array(vector, a.ndim - 1, "C") if a.ndim > 1 else vector for a in record.types]
    result = types.NamedTuple(kinds, record.instance_class)

    def generate(context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        parts = []
        for k, (array, kind) in enumerate(zip(record.types, kinds, strict=True)):
            value = builder.extract_value(args[0], k)
            if kind is vector:
                data = context.make_array(array)(context, builder, value).data
                parts.append(builder.load(builder.bitcast(data, _DOUBLES.as_pointer()), align=_ALIGN))
            else:
                parts.append(rows_as_numbers(context, builder, array, kind, value))
        return borrowed(context, builder, result, context.make_tuple(builder, result, parts))

    return result(record), generate


def aligned(shape: tuple[int, ...], made: Callable[[int], np.ndarray] = np.empty) -> np.ndarray:
    """Return a float array of `shape` (..., WIDTH) whose memory address is aligned to SIMD registers.

    It is not initialised unless `made` does so (np.zeros).
    """
    size = prod(shape)
    raw = made(size + WIDTH)
    skip = -(raw.__array_interface__["data"][0] // 8) % WIDTH
    return raw[skip : skip + size].reshape(shape)
