"""The compiled `cos_sin` for real and complex angles. This module is imported only when something is compiled."""

from __future__ import annotations

import numpy as np
from numba import types
from numba.extending import overload, register_jitable

from pliant.numerics import trig

_real = register_jitable(trig.cos_sin)


def _pair(x):
    return np.cos(x), np.sin(x)


def _complex_pair(x):
    """Return cosine and sine of a complex angle; for a tiny imaginary part, by its first power, which is then exact."""
    if not abs(x.imag) < 1e-9:
        return np.cos(x), np.sin(x)
    c, s = _real(x.real)
    return complex(c, -s * x.imag), complex(s, c * x.imag)


@overload(_pair)
def _choose(x):
    if isinstance(x, types.Complex):
        return _complex_pair
    return getattr(x, "cos_sin", None) or (lambda x: _real(x))  # noqa: PLW0108  Numba wants a function of its own


def pair(x):
    """Return (cos x, sin x) of an angle of any type, for Numba's `compile_internal`."""
    return _pair(x)
