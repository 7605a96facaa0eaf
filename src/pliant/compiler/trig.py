"""Compiled function for cosine and sine of real and complex angles, with the same results as in Python.

This module is imported only when something is compiled.
"""

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
    """Return (cos x, sin x) of a real or complex angle x, a SIMD vector or a dual number, in compiled code."""
    return _pair(x)
