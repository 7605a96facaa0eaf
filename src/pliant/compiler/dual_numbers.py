"""Numba type for dual numbers: a float with a vector of derivatives, and its arithmetic.

The module `compiler.duals` converts arrays of floats to arrays of this type.

Source: Griewank and Walther, Evaluating Derivatives (2008), Sec. 3.1, the vector forward mode
"""

from __future__ import annotations

import operator
from typing import Any

import numpy as np
from numba import types
from numba.extending import (
    intrinsic,
    lower_builtin,
    lower_cast,
    make_attribute_wrapper,
    models,
    overload,
    register_jitable,
    register_model,
    type_callable,
)

from pliant.compiler import SLOTS
from pliant.compiler.llvm import filled
from pliant.compiler.simd import NUMBERS, Wide, vector
from pliant.numerics.trig import cos_sin

_CONTRACT = ("contract",)  # LLVM may fuse the multiplications and additions of derivatives


class Dual(Wide):
    """Numba type of a dual number: a double with `WIDTH` derivatives. A float is converted to one whose derivatives are
    0.
    """

    def __init__(self) -> None:
        super().__init__("dual", SLOTS)


dual = Dual()


@register_model(Dual)
class _Model(models.StructModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, [("real", types.float64), ("slopes", vector)])


make_attribute_wrapper(Dual, "real", "real")
make_attribute_wrapper(Dual, "slopes", "slopes")


def parts(context: Any, builder: Any, kind: Any, value: Any) -> tuple[Any, Any]:
    """Return two LLVM values: the value of a dual number and its derivatives. For a float, the second is None."""
    if kind == dual:
        return builder.extract_value(value, 0), builder.extract_value(value, 1)
    return context.cast(builder, value, kind, types.float64), None


def _made(context: Any, builder: Any, real: Any, slopes: Any) -> Any:
    return filled(context.get_value_type(dual), (real, slopes), builder)


@intrinsic
def joined(_context: Any, real: Any, slopes: Any) -> Any:
    """Return the dual number of a value and its derivatives."""

    def generate(context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        return _made(context, builder, *args)

    return dual(types.float64, vector), generate


@lower_cast(types.Float, Dual)  # type: ignore[untyped-decorator]
@lower_cast(types.Integer, Dual)  # type: ignore[untyped-decorator]
def _constant(context: Any, builder: Any, kind: Any, _dual: Any, value: Any) -> Any:
    real = context.cast(builder, value, kind, types.float64)
    return _made(context, builder, real, context.get_constant_null(vector))


class _Rules:
    """LLVM code for operations on a and b, with derivatives da and db, which are None for floats."""

    def __init__(self, context: Any, builder: Any) -> None:
        self.context, self.builder = context, builder

    def scaled(self, da: Any, x: Any) -> Any:
        """Return LLVM code for the derivatives `da` times the float `x`; None stands for zero derivatives."""
        build, cast = self.builder, self.context.cast
        return None if da is None else build.fmul(da, cast(build, x, types.float64, vector), flags=_CONTRACT)

    def sum(self, da: Any, db: Any) -> Any:
        """Return LLVM code for the sum of two vectors of derivatives; None stands for zero derivatives."""
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
        quotient, unity = self.builder.fdiv(a, b), self.context.get_constant(types.float64, 1.0)
        less = None if db is None else self.builder.fneg(self.scaled(db, quotient))
        return quotient, self.scaled(self.sum(da, less), self.builder.fdiv(unity, b))


def _define(operation: Any, rule: str) -> None:
    """Register with Numba an operator of two numbers, at least one of which is a dual number."""

    @type_callable(operation)
    def _typed(_context: Any) -> Any:
        def signature(*args: Any) -> Any:
            fits = len(args) == 2 and dual in args and all(a == dual or isinstance(a, NUMBERS) for a in args)
            return dual(*(a if a == dual else types.float64 for a in args)) if fits else None

        return signature

    def lowered(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        (a, da), (b, db) = (parts(context, builder, k, v) for k, v in zip(sig.args, args, strict=True))
        return _made(context, builder, *getattr(_Rules(context, builder), rule)(a, da, b, db))

    for kinds in ((Dual, Dual), (Dual, types.Float), (types.Float, Dual)):
        lower_builtin(operation, *kinds)(lowered)


for _name in ("add", "sub", "mul", "truediv"):
    _define(getattr(operator, _name), _name)
    _define(getattr(operator, f"i{_name}"), _name)


@type_callable(operator.neg)
def _negative(_context: Any) -> Any:
    return lambda x: dual(dual) if x == dual else None


@lower_builtin(operator.neg, Dual)  # type: ignore[untyped-decorator]
def _negated(context: Any, builder: Any, _sig: Any, args: Any) -> Any:
    real, slopes = parts(context, builder, dual, args[0])
    return _made(context, builder, builder.fneg(real), builder.fneg(slopes))


_real_pair = register_jitable(cos_sin)


@register_jitable
def _cos_sin(x):
    c, s = _real_pair(x.real)
    return joined(c, -s * x.slopes), joined(s, c * x.slopes)


@overload(np.sin)
def _np_sin(x):
    return (lambda x: _cos_sin(x)[1]) if x == dual else None


@overload(np.cos)
def _np_cos(x):
    return (lambda x: _cos_sin(x)[0]) if x == dual else None


def _define_function(function: Any, slope: Any) -> None:
    """Register with Numba a function of one dual number; `slope` returns the derivative from x and the value."""
    slope = register_jitable(slope)

    def on_dual(x):
        z = function(x.real)
        return joined(z, slope(x.real, z) * x.slopes)

    overload(function)(lambda x: on_dual if x == dual else None)


_define_function(np.exp, lambda _x, z: z)
_define_function(np.expm1, lambda _x, z: z + 1.0)
_define_function(np.sqrt, lambda _x, z: 0.5 / z)
_define_function(np.log, lambda x, _z: 1.0 / x)
_define_function(np.arctan, lambda x, _z: 1.0 / (1.0 + x * x))


@overload(min)
def _min(x, y):
    return (lambda x, y: y + 0.0 * x if y.real < x.real else x + 0.0 * y) if dual in (x, y) else None


def _power(x, y):
    """Return x^y of a positive x."""
    z = x.real**y.real
    return joined(z, (y.real * z / x.real) * x.slopes + (np.log(x.real) * z) * y.slopes)


def _fixed_power(x, y):
    """Return x^y of a positive x, for a float y."""
    z = x.real**y
    return joined(z, (y * z / x.real) * x.slopes)


@overload(operator.pow)
def _pow(x, y):
    if x == dual and isinstance(y, types.Float):
        return _fixed_power
    return _power if x == dual and y == dual else None
