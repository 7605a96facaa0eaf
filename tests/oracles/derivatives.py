"""Derivatives without truncation error: the imaginary part of a function at a complex step."""

from __future__ import annotations

import numpy as np

from pliant.compiler.duals import duals
from pliant.equations.symbols import StepSlopes

STEP = 1e-30


def complex_step(function, x):
    """d function / d x, the variable as the last axis; `function` maps (n,) complex to an array."""
    columns = []
    for k in range(len(x)):
        at = np.asarray(x, complex).copy()
        at[k] += 1j * STEP
        columns.append(np.imag(function(at)) / STEP)
    return np.stack(columns, axis=-1)


def plain_slopes(work):
    """What `linearised.step_jacobian` takes in plain Python: complex numbers, for a complex workspace."""
    N = len(work.a)
    return StepSlopes(np.empty((2 * N + len(work.tau), 2 * N)), np.zeros(N, complex), np.zeros(N, complex), work)


def dual_slopes(work):
    """What it takes compiled: dual numbers, for a workspace of floats."""
    plain = plain_slopes(work)
    return StepSlopes(plain.J, *(duals(np.zeros(len(work.a))) for _ in range(2)), type(work)(*map(duals, work)))
