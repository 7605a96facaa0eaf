"""Derivatives without truncation error: the imaginary part of a function at a complex step."""

from __future__ import annotations

import numpy as np

STEP = 1e-30


def complex_step(function, x):
    """d function / d x, the variable as the last axis; `function` maps (n,) complex to an array."""
    columns = []
    for k in range(len(x)):
        at = np.asarray(x, complex).copy()
        at[k] += 1j * STEP
        columns.append(np.imag(function(at)) / STEP)
    return np.stack(columns, axis=-1)
