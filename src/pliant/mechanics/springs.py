"""The springs of a model on whole arrays: slopes, the angle under a torque, and where a softening spring holds no more.

The law itself is `equations.elastic.spring_torque`; here stand its inverse and its limits.
"""

from __future__ import annotations

import numpy as np

from pliant.equations.elastic import spring_slope, spring_torque
from pliant.errors import SimulationError
from pliant.model import Model

Array = np.ndarray


def coefficients(model: Model) -> tuple[Array, Array, Array]:
    """Return K [N m/rad], K2 [N m/rad^2] and K3 [N m/rad^3] (n,) of the joints' springs."""
    K = model.stiffness
    return K, K * model.stiffening, K * model.cubic_stiffening


def torques(model: Model, q: Array) -> Array:
    """Return the torques (..., n) of the springs at joint angles (..., n), N m."""
    return np.asarray(spring_torque(*coefficients(model), q, q))


def slopes(model: Model, q: Array) -> Array:
    """Return the slopes (..., n) of the springs at joint angles (..., n), N m/rad."""
    return np.asarray(spring_slope(*coefficients(model), q))


def angle_under(model: Model, torque: Array) -> Array:
    """Return the joint angles (n,) at which the springs alone hold `torque` (n,) [N m], on the branch from 0 on.

    Raises
    ------
    SimulationError
        When softening springs cannot hold it.
    """
    x = np.asarray(torque / model.stiffness)
    q = bend(x, model.stiffening, model.cubic_stiffening)
    if not np.isfinite(q).all():
        i = int(np.argmin(np.isfinite(q)))
        most = model.stiffness[i] * softest_bend(x, model.stiffening, model.cubic_stiffening)[1][i]
        raise SimulationError(
            f"the spring of joint {i + 1}, which softens with its angle, holds at most "
            f"{np.copysign(most, torque[i]):.4g} N m, but {torque[i]:.4g} N m bend it: lower the "
            "pressure or the size of the stiffening"
        )
    return q


def bend(x: Array, s: Array, a: Array) -> Array:
    """Return q, from 0 on without a turn, of q (1 + s q + a q^2) = x; not a number where there is none."""
    root = 1.0 + 4.0 * s * x
    with np.errstate(invalid="ignore"):
        q = np.where(root > 0, x * (2.0 / (1.0 + np.sqrt(root))), np.nan)
    if not np.any(a):
        return q
    turn, most = softest_bend(x, s, a)
    size, s = np.abs(x), np.sign(x) * s
    low, high = np.zeros_like(q), np.minimum(turn, 4.0 * size)  # a spring that never softens to nothing: x > q/4
    for _ in range(60):
        middle = 0.5 * (low + high)
        below = spring_torque(1.0, s, a, middle, middle) < size
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.where(size < most, np.sign(x) * 0.5 * (low + high), np.nan)


def softest_bend(x: Array, s: Array, a: Array) -> tuple[Array, Array]:
    """Return the size of q at which the slope 1 + 2 s q + 3 a q^2 falls to 0 on the side of x, and that of x there."""
    s = np.sign(x) * s
    inside = s * s - 3.0 * a
    inverse = np.where(inside > 0, np.sqrt(np.maximum(inside, 0.0)) - s, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        q = np.where(inverse > 0, 1.0 / inverse, np.inf)
        most = np.where(inverse > 0, spring_torque(1.0, s, a, q, q), np.inf)
    return q, most


def softened(model: Model, q: Array, least: float = 0.0) -> str:
    """Return a sentence on the first spring whose slope at q (n,) falls to a fraction `least` of K, or ''."""
    lost = np.flatnonzero(slopes(model, q) <= least * model.stiffness)
    if not lost.size:
        return ""
    i = int(lost[0])
    cubic = f"and {model.cubic_stiffening[i]:.4g} 1/rad^2 " if model.cubic_stiffening[i] else ""
    return (
        f"the spring of joint {i + 1} has softened to nothing at {q[i]:.4g} rad, beyond what the stiffening of "
        f"{model.stiffening[i]:.4g} 1/rad {cubic}describes: lower the pressure or the size of the stiffening"
    )
