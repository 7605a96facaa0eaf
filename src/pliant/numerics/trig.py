"""Cosine and sine of an angle computed together, without a call of a library function.

Argument reduction by multiples of pi/2 in two parts, then the minimax polynomials of fdlibm (Sun Microsystems, k_cos.c
and k_sin.c). A test checks that the absolute error is below 3e-16 for |x| < 1e5 rad.
"""

from __future__ import annotations

import numpy as np


def cos_sin(x):
    """Return (cos x, sin x) for real x [rad], |x| < 1e5 rad."""
    q = np.rint(x * 0.6366197723675814)
    r = (x - q * 1.5707963267341256) - q * 6.077100506506192e-11  # pi/2 = 33 bits + the rest
    z = r * r
    s = z * (2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10))
    s = z * (8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04 + s))
    s = r + r * z * (-1.66666666666666324348e-01 + s)
    c = z * (-2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 - z * 1.13596475577881948265e-11))
    c = z * (-1.38888888888741095749e-03 + z * (2.48015872894767294178e-05 + c))
    c = 1.0 - (0.5 * z - z * z * (4.16666666666666019037e-02 + c))
    half = 0.5 * q
    odd = 2.0 * (half - np.floor(half))  # 1 in the second and fourth quadrant, where cosine and sine change places
    quarter = 0.25 * q
    sine = 1.0 - 2.0 * np.floor(2.0 * (quarter - np.floor(quarter)))  # -1 in the third and fourth
    cosine = sine * (1.0 - 2.0 * odd)  # -1 in the second and third
    return cosine * (c + odd * (s - c)), sine * (s + odd * (c - s))
