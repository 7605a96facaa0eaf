"""Dual numbers: a value with `WIDTH` derivatives beside it, so that a kernel's one text carries them exactly.

Numba learns a scalar type `dual` that is a float and `lanes` of derivatives. It adds, multiplies and divides by the
rules of Leibniz, mixes with floats, and has sine, cosine and powers; what a text compares are the values, `x.real`. A
kernel compiled for arrays of duals is the kernel: nothing is written twice, and the values are those of the kernel on
floats, to the bit. In memory a dual is a row of `SLOTS` floats, the value first (`duals`).

Source: Griewank and Walther, Evaluating Derivatives (2008), Sec. 3.1, the vector forward mode
"""

from __future__ import annotations

import operator
from functools import cache
from types import FunctionType
from typing import Any

import numpy as np
from numba import types
from numba.core import cgutils
from numba.core.extending import (
    intrinsic,
    lower_builtin,
    lower_cast,
    make_attribute_wrapper,
    models,
    overload,
    register_jitable,
    register_model,
)
from numba.core.imputils import impl_ret_borrowed
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.np.arrayobj import populate_array

from pliant.compiler import choose
from pliant.compiler.cache import kept
from pliant.compiler.simd import NUMBERS, WIDTH, Wide, aligned, lanes
from pliant.compiler.twin import compiled_twin
from pliant.numerics.trig import cos_sin

__all__ = ["WIDTH", "dual_twin", "duals"]
Array = np.ndarray
SLOTS = 2 * WIDTH  # floats in memory: the value, a gap up to where a register may be loaded from, the derivatives
_CONTRACT = ("contract",)  # of derivatives: a product and a sum may be rounded once


class Dual(Wide):
    """A double with `WIDTH` derivatives; a float mixes in as one without."""

    def __init__(self) -> None:
        super().__init__("dual", SLOTS)

    @property
    def cos_sin(self) -> Any:
        """What `trig.pair` compiles of it."""
        return lambda x: _cos_sin(x)  # noqa: PLW0108  Numba takes Python functions here

    mixes = True  # `llvm` leaves the floats among operands as they are


dual = Dual()


@register_model(Dual)
class _Model(models.StructModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, [("real", types.float64), ("slopes", lanes)])


make_attribute_wrapper(Dual, "real", "real")
make_attribute_wrapper(Dual, "slopes", "slopes")


def _parts(context: Any, builder: Any, kind: Any, value: Any) -> tuple[Any, Any]:
    """Value and derivatives; None for those of a float."""
    if kind == dual:
        return builder.extract_value(value, 0), builder.extract_value(value, 1)
    return context.cast(builder, value, kind, types.float64), None


def _made(context: Any, builder: Any, real: Any, slopes: Any) -> Any:
    made = cgutils.create_struct_proxy(dual)(context, builder)
    made.real, made.slopes = real, slopes
    return made._getvalue()  # noqa: SLF001  Numba's own way


@intrinsic
def _joined(_context: Any, real: Any, slopes: Any) -> Any:
    """The dual of a value and its derivatives."""

    def generate(context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        return _made(context, builder, *args)

    return dual(types.float64, lanes), generate


@lower_cast(types.Float, Dual)  # type: ignore[untyped-decorator]
@lower_cast(types.Integer, Dual)  # type: ignore[untyped-decorator]
def _constant(context: Any, builder: Any, kind: Any, _dual: Any, value: Any) -> Any:
    real = context.cast(builder, value, kind, types.float64)
    return _made(context, builder, real, context.get_constant_null(lanes))


class _Rules:
    """Value and derivatives (in LLVM) of an operation on a, with derivatives da, and b; None are those of a float."""

    def __init__(self, context: Any, builder: Any) -> None:
        self.context, self.builder = context, builder

    def scaled(self, da: Any, x: Any) -> Any:
        """Derivatives times a float; None without any."""
        build, cast = self.builder, self.context.cast
        return None if da is None else build.fmul(da, cast(build, x, types.float64, lanes), flags=_CONTRACT)

    def sum(self, da: Any, db: Any) -> Any:
        """Of derivatives, either of which may be None."""
        if da is None or db is None:
            return da if db is None else db
        return self.builder.fadd(da, db, flags=_CONTRACT)

    def add(self, a: Any, da: Any, b: Any, db: Any) -> tuple[Any, Any]:
        return self.builder.fadd(a, b), self.sum(da, db)

    def sub(self, a: Any, da: Any, b: Any, db: Any) -> tuple[Any, Any]:
        if da is not None and db is not None:
            return self.builder.fsub(a, b), self.builder.fsub(da, db, flags=_CONTRACT)
        return self.builder.fsub(a, b), da if db is None else self.builder.fneg(db)

    def mul(self, a: Any, da: Any, b: Any, db: Any) -> tuple[Any, Any]:
        return self.builder.fmul(a, b), self.sum(self.scaled(da, b), self.scaled(db, a))

    def truediv(self, a: Any, da: Any, b: Any, db: Any) -> tuple[Any, Any]:  # (da - (a / b) db) / b
        quotient, one = self.builder.fdiv(a, b), self.context.get_constant(types.float64, 1.0)
        less = None if db is None else self.builder.fneg(self.scaled(db, quotient))
        return quotient, self.scaled(self.sum(da, less), self.builder.fdiv(one, b))


def _define(operation: Any, rule: str) -> None:
    """Teach Numba an operator of two numbers, of which one at least is a dual."""

    @infer_global(operation)
    class _Typed(AbstractTemplate):
        def generic(self, args: Any, _kws: Any) -> Any:
            if len(args) == 2 and dual in args and all(a == dual or isinstance(a, NUMBERS) for a in args):
                return signature(dual, *(a if a == dual else types.float64 for a in args))
            return None

    def lowered(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        (a, da), (b, db) = (_parts(context, builder, k, v) for k, v in zip(sig.args, args, strict=True))
        return _made(context, builder, *getattr(_Rules(context, builder), rule)(a, da, b, db))

    for kinds in ((Dual, Dual), (Dual, types.Float), (types.Float, Dual)):
        lower_builtin(operation, *kinds)(lowered)


for _name in ("add", "sub", "mul", "truediv"):
    _define(getattr(operator, _name), _name)
    _define(getattr(operator, f"i{_name}"), _name)


@infer_global(operator.neg)
class _Negative(AbstractTemplate):
    def generic(self, args: Any, _kws: Any) -> Any:
        return signature(dual, dual) if args == (dual,) else None


@lower_builtin(operator.neg, Dual)  # type: ignore[untyped-decorator]
def _negated(context: Any, builder: Any, _sig: Any, args: Any) -> Any:
    real, slopes = _parts(context, builder, dual, args[0])
    return _made(context, builder, builder.fneg(real), builder.fneg(slopes))


_real_pair = register_jitable(cos_sin)


@register_jitable
def _cos_sin(x):
    c, s = _real_pair(x.real)
    return _joined(c, -s * x.slopes), _joined(s, c * x.slopes)


@overload(np.sin)
def _np_sin(x):
    return (lambda x: _cos_sin(x)[1]) if x == dual else None


@overload(np.cos)
def _np_cos(x):
    return (lambda x: _cos_sin(x)[0]) if x == dual else None


def _power(x, y):
    """x^y of a positive x."""
    z = x.real**y.real
    return _joined(z, (y.real * z / x.real) * x.slopes + (np.log(x.real) * z) * y.slopes)


@overload(operator.pow)
def _pow(x, y):
    return _power if x == dual and y == dual else None


def _of(kind: Any) -> Any:
    """What `as_duals` makes of an argument's type: of floats (..., SLOTS) duals (...); the rest stays."""
    if isinstance(kind, types.Array) and kind.dtype == types.float64:
        return dual if kind.ndim == 1 else types.Array(dual, kind.ndim - 1, "C")
    if not isinstance(kind, types.BaseTuple):
        return kind
    parts: Any = kind
    return types.BaseTuple.from_types(tuple(map(_of, parts)), getattr(kind, "instance_class", None))


def _taken(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """An argument as `_of` has it, sharing its memory."""
    made = _of(kind)
    if isinstance(kind, types.BaseTuple):
        kinds: Any = kind
        parts = [_taken(context, builder, k, builder.extract_value(value, i)) for i, k in enumerate(kinds)]
        return context.make_tuple(builder, made, parts)
    if made == kind:
        return value
    source = context.make_array(kind)(context, builder, value)
    data = builder.bitcast(source.data, context.get_value_type(dual).as_pointer())
    if made == dual:
        return builder.load(data)
    array = context.make_array(made)(context, builder)
    shape, strides = (cgutils.unpack_tuple(builder, part)[:-1] for part in (source.shape, source.strides))
    populate_array(
        array, data=data, shape=cgutils.pack_array(builder, shape), strides=cgutils.pack_array(builder, strides),
        itemsize=context.get_constant(types.intp, 8 * SLOTS), meminfo=source.meminfo, parent=source.parent,
    )
    return impl_ret_borrowed(context, builder, made, array._getvalue())  # noqa: SLF001


@intrinsic
def _as_duals(_context: Any, arguments: Any) -> Any:
    """All arguments with duals in the place of floats (..., SLOTS)."""

    def generate(context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        return _taken(context, builder, arguments, args[0])

    return _of(arguments)(arguments), generate


@intrinsic
def _value(_context: Any, x: Any) -> Any:
    """The value of a dual; what is none stays."""

    def generate(context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        return _parts(context, builder, dual, args[0])[0] if x == dual else args[0]

    return (types.float64 if x == dual else x)(x), generate


def _run(*arguments):
    return _value(inner(*_as_duals(arguments)))  # noqa: F821  given by `dual_twin`


@cache
def dual_twin(kernel: FunctionType, links: int | None, segments: int = 0) -> Any:
    """The compiled twin of a kernel on duals: as `choose.twin`, floats and arrays of floats as `duals` lays them.

    What is not of floats (counts, arrays of integers) stays as it is; a dual that is returned comes as its value.
    """
    inner = _inner(kernel, links, segments)
    copy = FunctionType(_run.__code__, {"inner": inner, "_as_duals": _as_duals, "_value": _value}, _run.__name__)
    copy.__module__ = kernel.__module__
    copy.__qualname__ = f"{inner.__qualname__}_whole"
    return kept(copy, _nrt=False)


@cache
def _inner(kernel: FunctionType, links: int | None, segments: int) -> Any:
    """The twin that takes duals themselves."""
    fast = choose.substitutes(kernel, links, segments) if links else {}
    if kernel in fast:
        return fast[kernel]
    tag = f"{links or 'n'}_{segments}_duals"
    return compiled_twin(kernel, tag, lambda callee: _inner(callee, links, segments), choose.SOURCES, replaced=fast)


def duals(values: Any, slopes: Any = 0.0) -> Array:
    """Floats (..., SLOTS) for `dual_twin`: `values` (...) and their derivatives, (..., P) with P up to `WIDTH`."""
    values = np.asarray(values, dtype=float)
    made = aligned((*values.shape, SLOTS))
    made[..., 0], made[..., 1:] = values, 0.0
    slopes = np.asarray(slopes, dtype=float)
    made[..., WIDTH : WIDTH + (slopes.shape[-1] if slopes.ndim else WIDTH)] = slopes
    return made
