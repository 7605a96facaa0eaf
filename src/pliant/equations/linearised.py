"""Exact Jacobian of one time step of any chain, in the plane and in space, for estimators and controllers.

The derivatives come from the text of the step itself, run on numbers that carry derivatives: on dual numbers if
compiled, which carry several at once, and on complex numbers in plain Python, which carry one. Springs, hysteresis,
gravity, segments that lengthen and tendons are therefore all included.
"""

from __future__ import annotations

from pliant.equations.motion import step

TINY = 1e-20  # imaginary step: its square vanishes beside 1


def step_jacobian(x, v, h, torque, body, joints, slopes):
    """Advance coordinates x (N,) and rates v (N,) in place by one step h [s]. Write the derivatives of the new x and v
    (columns) with respect to the old x, the old v, the torques and the inputs of R tendons (rows) to slopes.J (3N + R,
    2N).

    `motion.step` makes the same step without derivatives; it is replaced by the step of the chain at hand, as
    everywhere.

    J[i, k] = d(x', v')_k / d(x, v, t)_i. t are additional torques (N,) [N m] along the coordinates, in the plane of the
    joints and strains, and then inputs (R,) [N] of tendons, all constant over the step. `slopes` is a
    `symbols.StepSlopes`, see `Mechanics.slopes`.

    Paper: Eq. (5) [eq:eom], discretised and differentiated
    """
    n = len(x)
    J = slopes.J
    moved, rate, work = carriers((slopes.x, slopes.v, slopes.work))
    together = derivatives_carried()
    for first in range(0, J.shape[0], together):
        for i in range(n):
            moved[i] = seeded(x[i], i - first)
            rate[i] = seeded(v[i], n + i - first)
        for i in range(len(work.tau)):
            work.tau[i] = seeded(torque[i], 2 * n + i - first)
        step(moved, rate, h, work.tau, body, joints, work)
        for row in range(first, min(first + together, J.shape[0])):
            for k in range(n):
                J[row, k] = derivative(moved[k], row - first)
                J[row, n + k] = derivative(rate[k], row - first)
    for i in range(n):
        x[i] = moved[i].real
        v[i] = rate[i].real


def carriers(arrays):
    """Return a tuple of arrays, or of tuples of them, as arrays of numbers that carry derivatives."""
    return arrays


def derivatives_carried():
    """Return how many derivatives a number carries at once."""
    return 1


def seeded(value, k):
    """Return a number that carries the derivative 1 by variable `k` of those that it can carry, 0 by the others.

    For another `k` all its derivatives are 0.

    Source: Squire and Trapp, Using complex variables to estimate derivatives of real functions (1998)
    """
    return value + (TINY * 1j if k == 0 else 0.0)


def derivative(number, k):
    """Return the derivative by variable `k` that a number carries."""
    return number.imag / TINY
