"""Compilation of kernels for dual numbers, so that they compute exact derivatives. A dual number is a value with up to
`WIDTH` derivatives.

Numba is given a scalar type `dual`, a float with a `vector` of derivatives. It has the four operations by the rules of
differentiation, mixes with floats, and has sine, cosine, exponentials, roots and powers. Comparisons use the values,
`x.real`. A kernel is compiled for arrays of dual numbers from its own source, and its values equal those on floats to
the bit. In memory a dual number is a row of `SLOTS` floats with the value first (see `duals`).

Source: Griewank and Walther, Evaluating Derivatives (2008), Sec. 3.1, the vector forward mode
"""

from __future__ import annotations

from functools import cache
from types import FunctionType
from typing import Any

import numpy as np
from numba import types
from numba.core import cgutils
from numba.core.extending import intrinsic
from numba.core.imputils import impl_ret_borrowed
from numba.np.arrayobj import populate_array

from pliant.compiler import choose
from pliant.compiler.cache import kept, part
from pliant.compiler.dual_numbers import SLOTS, dual, parts
from pliant.compiler.simd import WIDTH, aligned
from pliant.compiler.twin import compiled_twin

__all__ = ["SLOTS", "WIDTH", "dual_twin", "duals"]
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
    return _value(inner(*_as_duals(arguments)))  # noqa: F821  given by `dual_twin`


@cache
def dual_twin(
    kernel: FunctionType, links: int | None, segments: int = 0, turns: int = 1, tendons: int = 0, axial: int = 0,
) -> Any:
    """Return a kernel compiled for dual numbers. Its array arguments have an additional last axis of `SLOTS` floats,
    which holds the value and the derivatives of one dual number.

    The sizes are those of `choose.twin`. `duals` makes such arrays.

    Integers and arrays of integers are passed unchanged. If the kernel returns a dual number, its value is returned.
    """
    sizes = (1, 0, 2, min(tendons, 1)) if turns > 1 else (links, segments, turns, tendons, axial)  # loops fit any size
    inner = part(_inner(kernel, *sizes))
    copy = FunctionType(_run.__code__, {"inner": inner, "_as_duals": _as_duals, "_value": _value}, _run.__name__)
    copy.__module__ = kernel.__module__
    copy.__qualname__ = f"{inner.__qualname__}_whole"
    return kept(copy, _nrt=False)


@cache
def _inner(kernel: FunctionType, links: int | None, *sizes: int) -> Any:
    """Return the compiled kernel whose arguments are dual numbers themselves."""
    fast = choose.substitutes(kernel, links, *sizes, loops=True) if links else {}
    if kernel in fast:
        return fast[kernel]
    few = choose.fewest(kernel, links, *sizes, loops=True) if links and fast else (None, 0, 1, 0, 0)
    if few != (links, *sizes):
        return _inner(kernel, *few)
    tag = f"{choose.size_tag(links, *sizes)}_duals"
    return compiled_twin(
        kernel, tag, lambda callee: _inner(callee, links, *sizes), choose.SOURCES, replaced=fast,
        forceinline=kernel not in choose.CALLED,
    )


def duals(values: Any, slopes: Array | None = None) -> Array:
    """Return dual numbers as an array of floats (..., SLOTS), from values (...) and their derivatives with respect to P
    variables (..., P). The `SLOTS` floats of a dual number are its value, padding and its derivatives.

    `dual_twin` takes such arrays.

    P is at most `WIDTH`.
    """
    values = np.asarray(values, dtype=float)
    made = aligned((*values.shape, SLOTS), np.zeros)
    made[..., 0] = values
    if slopes is not None:
        made[..., WIDTH : WIDTH + slopes.shape[-1]] = slopes
    return made
