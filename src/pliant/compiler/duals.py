"""Dual numbers in memory: arrays of floats as arrays of dual numbers, which are values with up to `WIDTH` derivatives.

A kernel is compiled for arrays of dual numbers from its own source (`choose.dual_twin`), and its values equal those on
floats to the bit. In memory a dual number is a row of `SLOTS` floats with the value first (see `duals`).

Source: Griewank and Walther, Evaluating Derivatives (2008), Sec. 3.1, the vector forward mode
"""

from __future__ import annotations

from types import FunctionType
from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic, register_jitable

from pliant.compiler import SLOTS, WIDTH
from pliant.compiler.cache import kept
from pliant.compiler.dual_numbers import dual, joined, parts
from pliant.compiler.simd import aligned, borrowed, rows_as_numbers, vector

__all__ = ["CARRYING", "SLOTS", "WIDTH", "duals", "from_floats"]
Array = np.ndarray


def _of(kind: Any) -> Any:
    """Return the type which `_as_duals` gives an argument: arrays of floats (..., SLOTS) become duals (...).

    Other types are returned unchanged.
    """
    if isinstance(kind, types.Array) and kind.dtype == types.float64:
        return dual if kind.ndim == 1 else types.Array(dual, kind.ndim - 1, "C")
    if not isinstance(kind, types.BaseTuple):
        return kind
    parts: Any = kind
    return types.BaseTuple.from_types(tuple(map(_of, parts)), getattr(kind, "instance_class", None))


def _taken(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Return an argument converted to the type of `_of`, without copying its memory."""
    dual_kind = _of(kind)
    if isinstance(kind, types.BaseTuple):
        kinds: Any = kind
        parts = [_taken(context, builder, k, builder.extract_value(value, i)) for i, k in enumerate(kinds)]
        return context.make_tuple(builder, dual_kind, parts)
    if dual_kind == kind:
        return value
    if dual_kind == dual:
        data = context.make_array(kind)(context, builder, value).data
        return builder.load(builder.bitcast(data, context.get_value_type(dual).as_pointer()))
    return borrowed(context, builder, dual_kind, rows_as_numbers(context, builder, kind, dual_kind, value))


@intrinsic
def _as_duals(_context: Any, arguments: Any) -> Any:
    """Return all arguments with dual numbers in place of arrays of floats (..., SLOTS)."""

    def generate(context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        return _taken(context, builder, arguments, args[0])

    return _of(arguments)(arguments), generate


@intrinsic
def _value(_context: Any, x: Any) -> Any:
    """Return the value of a dual number; anything else is returned unchanged."""

    def generate(context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        return parts(context, builder, dual, args[0])[0] if x == dual else args[0]

    return (types.float64 if x == dual else x)(x), generate


def _run(*arguments):
    return _value(inner(*_as_duals(arguments)))  # noqa: F821  given by `from_floats`


def from_floats(inner: Any) -> Any:
    """Return a compiled kernel of dual numbers as one whose arrays are floats with an additional last axis of `SLOTS`
    numbers.
    """
    copy = FunctionType(_run.__code__, {"inner": inner, "_as_duals": _as_duals, "_value": _value}, _run.__name__)
    copy.__module__ = inner.__module__
    copy.__qualname__ = f"{inner.__qualname__}_whole"
    return kept(copy, _nrt=False, nogil=True)


@intrinsic
def _unit(_context: Any, k: Any) -> Any:
    """Return the derivatives of variable number k: 1 by itself, 0 by others."""

    def generate(context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        none, unity = context.get_constant_null(vector), context.get_constant(types.float64, 1.0)
        return builder.insert_element(none, unity, args[0])

    return vector(k), generate


@intrinsic
def _entry(_context: Any, slopes: Any, k: Any) -> Any:
    """Return number k of a vector of derivatives."""

    def generate(_target: Any, builder: Any, _sig: Any, args: Any) -> Any:
        return builder.extract_element(*args)

    return types.float64(slopes, k), generate


def _carriers(arrays):
    return _as_duals(arrays)


def _width():
    return WIDTH


def _seeded(value, k):
    return joined(value, _unit(k)) if 0 <= k < WIDTH else joined(value, 0.0)


def _derivative(x, k):
    return _entry(x.slopes, k)


# The functions of `equations.linearised` for dual numbers, by their names there.
CARRYING = {
    "carriers": register_jitable(_carriers), "derivatives_carried": register_jitable(_width),
    "seeded": register_jitable(_seeded), "derivative": register_jitable(_derivative),
}


def duals(values: Any, slopes: Array | None = None) -> Array:
    """Return dual numbers as an array of floats (..., SLOTS), from values (...) and their derivatives with respect to P
    variables (..., P). The `SLOTS` floats of a dual number are its value, padding and its derivatives.

    `dual_twin` takes such arrays.

    P is at most `WIDTH`.
    """
    values = np.asarray(values, dtype=float)
    array = aligned((*values.shape, SLOTS), np.zeros)
    array[..., 0] = values
    if slopes is not None:
        array[..., WIDTH : WIDTH + slopes.shape[-1]] = slopes
    return array
