"""The longest time step for a model, from its highest mode of vibration that moves the tip noticeably.

The midpoint rule slows a mode of angular frequency w by the fraction (w h)^2 / 12 (Hairer, Norsett and Wanner I, Sec.
II.16, applied to an oscillator). The error of a mode that moves the tip by A and decays at the rate d is therefore at
most A w (w h)^2 / 12 t exp(-d t), largest at t = 1/d. An over-damped mode moves with its slow pole s = d - (d^2 -
w^2)^(1/2), which the rule slows by the fraction (s h)^2 / 12: its error is the same with s in place of w and d.

Error of a simulated tip position, estimated by repeating the simulation with a different time step.

A second-order rule with the step 2h has four times the error of the step h, so that the difference of the two is three
times the error of h (Richardson; Hairer, Norsett and Wanner I, Sec. II.4). If this difference is small, the simulation
is accepted. Otherwise it is also repeated with h/2. Where the two differences are not in the ratio of 4, the steps are
too long for this law, and the larger of two estimates is used.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from warnings import warn

import numpy as np

from pliant.errors import SimulationError
from pliant.mechanics import mechanics_of
from pliant.model import Model, Station
from pliant.simulation import state

Array = np.ndarray
EVERY = 1e-3  # s, default interval of output times, and longest automatic step
SHORTEST = 1e-6  # s
TOLERANCE = 3e-3  # of the length: error of one mode at the tip, a third of the error which a simulation reports
TYPICAL = 0.25  # of the length: static displacement of the tip by a typical pressure, a bend of half a radian
DURATION = 1.0  # s, over which an undamped mode keeps its phase
NICE = (5.0, 2.0, 1.0)


LIMIT = 0.01  # of the length: a larger error of the tip is reported
CLEARED = 0.3 * LIMIT  # of the length: a smaller difference to the motion with twice the step is accepted
ORDERS = (3.0, 4.0)  # bounds of the ratio of the two differences
MARGIN = 1.1
Again = Callable[[float], tuple[Array, Array]]


class AccuracyWarning(UserWarning):
    """Warning that the time step of a simulation is too long for the motion."""


def tip_error(again: Again) -> float:
    """Return an upper estimate of the largest error of a simulated tip position, as a fraction of the body's length.

    Parameters
    ----------
    again : callable
        ``again(factor)`` repeats the motion with `factor` times its step, 2 or 1/2, and returns positions (T, ..., d)
        of the motion and of its repetition at equal times, over the length of the body. It may raise SimulationError.
    """
    coarse = difference(again, 2.0)
    if 0.0 < coarse <= CLEARED:  # a difference of 0 may mean that both had the same steps
        return coarse
    fine = difference(again, 0.5)
    if not (np.isfinite(coarse) and fine > 0.0):
        return MARGIN * 4.0 / 3.0 * fine
    ratio = float(np.clip(coarse / fine, *ORDERS))
    by_half, by_both = fine * ratio / (ratio - 1.0), np.sqrt(coarse / 3.0 * fine * 4.0 / 3.0)
    return MARGIN * float(max(by_half, by_both))


def difference(again: Again, factor: float) -> float:
    """Return the largest distance between the tip positions of a motion and of its repetition with other time steps, as
    a fraction of the body's length. It is infinite if the repetition fails.
    """
    try:
        return distance(*again(factor))
    except SimulationError:
        return np.inf


def distance(one: Array, other: Array) -> float:
    """Return the largest distance between corresponding points of two arrays of positions, whose last axis holds the
    components.
    """
    return float(np.sqrt(np.sum((one - other) ** 2, axis=-1).max(initial=0.0)))


def step_for(error: float) -> float:
    """Return the factor, 0.1 to 0.7, by which to shorten a time step so that the tip error falls to half the limit of 1
    % of the body's length. `error` is the present one, as a fraction of the length.
    """
    return float(np.clip(np.sqrt(0.5 * LIMIT / error), 0.1, 0.7))


def resolving_step(
    model: Model, displacement: Array | None = None, duration: float = DURATION, longest: float = EVERY,
) -> float:
    """Return the longest time step [s] that resolves every mode of vibration which noticeably moves the tip.

    A mode counts if it contributes more than 0.15 % of the length to the motion of the tip after the given
    displacement, or after a sudden pressure in one chamber that displaces the tip by a quarter of the length. The step
    keeps the error of each such mode below 0.3 % of the length.

    Parameters
    ----------
    model : Model
    displacement : array (N,), optional
        Joint coordinates at the start of a free motion, from equilibrium, rad (and strains).
    duration : float
        Time for which a mode without damping must keep its phase, s.
    longest : float
        Upper bound of the step, s; default: 1 ms.

    Returns
    -------
    float
        1, 0.5, 0.2, 0.1, ... ms, in s (2 ms for `longest` = 2e-3).

    Raises
    ------
    SimulationError
        When the chain has no stable equilibrium.

    Examples
    --------
    >>> resolving_step(pliant.actuators.chen2018.model())
    0.001
    """
    return nice(min(longest, longest_step(model, displacement, duration)))


def shared_step(models: Iterable[Model], longest: float = EVERY) -> float:
    """Return the shortest `resolving_step` [s] of several models, at most `longest` (default: 1 ms). A model without a
    stable equilibrium does not shorten it.
    """
    steps = [longest]
    for model in models:
        with suppress(SimulationError):
            steps.append(resolving_step(model, longest=longest))
    return min(steps)


def longest_step(model: Model, displacement: Array | None = None, duration: float = DURATION) -> float:
    """Return the longest time step [s], not rounded, that resolves every mode which noticeably moves the tip. It is
    infinite if no mode does.
    """
    return float(mode_steps(*tip_modes(model, displacement), duration).min())


def mode_steps(
    omega: Array, decay: Array, moved: Array, duration: float = DURATION, tolerance: float = TOLERANCE
) -> Array:
    """Return the time step (N,) [s] at which the error of each of N modes of vibration reaches `tolerance`. It is
    infinite for modes that hardly move the tip.
    """
    slow = omega * (omega / np.maximum(decay + np.sqrt(np.maximum(decay**2 - omega**2, 0.0)), omega))
    omega, decay = (np.where(decay > omega, slow, one) for one in (omega, decay))
    peak = np.minimum(duration, 1.0 / np.maximum(decay, 1e-300))
    error = moved * omega**3 / 12.0 * peak * np.exp(-decay * peak)  # over the square of the step
    return np.where(2.0 * moved > tolerance, np.sqrt(tolerance / np.maximum(error, 1e-300)), np.inf)


def rings(model: Model) -> bool:
    """Return whether a mode of vibration that noticeably moves the tip is less than critically damped. A model without
    a stable equilibrium is taken to ring.
    """
    try:
        omega, decay, moved = tip_modes(model)
    except SimulationError:
        return True
    return bool((decay < omega)[2.0 * moved > TOLERANCE].any())


def warn_too_coarse(model: Model, time_step: float) -> None:
    """Issue an `AccuracyWarning` if a step [s] causes an error above 1 % of the length in any noticeable mode."""
    omega, decay, moved = tip_modes(model)
    longest = mode_steps(omega, decay, moved, tolerance=LIMIT)
    worst = int(longest.argmin())
    if time_step > longest[worst]:
        shorter = nice(mode_steps(omega, decay, moved).min())
        warn(
            f"a step of {1e3 * time_step:.3g} ms is too long for the mode of {omega[worst] / (2 * np.pi):.3g} Hz, in "
            f"which a sudden pressure moves the tip by {100 * moved[worst]:.2g} % of the length: use "
            f"time_step={shorter:g}",
            AccuracyWarning, stacklevel=3,
        )


def tip_modes(model: Model, displacement: Array | None = None) -> tuple[Array, Array, Array]:
    """Return arrays (N,) for N modes of vibration: angular frequency [rad/s], decay rate [1/s], and tip displacement as
    a fraction of the body's length.

    The displacement is the largest under the sudden pressures of `resolving_step`.
    """
    body, q = mechanics_of(model), state.equilibrium(model)
    M, K = body.linear_parts(q)
    omega, shapes, decay = state.modal(model, M, K)
    tip = Station("tip", model.n - 1, float(model.link_length[-1]))
    J = body.position_jacobian(body.coordinates(q), tip) @ body.from_joints / model.length
    pushed = np.linalg.solve(K, np.array(model.actuation.gain).T)
    reach = np.linalg.norm(J @ pushed, axis=0)
    loads = [q * (TYPICAL / r) for q, r in zip(pushed.T, reach, strict=True) if r > 0.0]
    loads += [] if displacement is None else [np.asarray(displacement, dtype=float)]
    amplitude = np.abs(shapes.T @ M @ np.array(loads).reshape(-1, model.size).T).max(axis=1, initial=0.0)
    return omega, decay, amplitude * np.linalg.norm(J @ shapes, axis=0)


def nice(time_step: float) -> float:
    """Round a time step [s] down to the series 1, 0.5, 0.2, 0.1, ... ms, in seconds."""
    time_step = max(time_step, SHORTEST)
    power = 10.0 ** np.floor(np.log10(time_step * (1 + 1e-9)))
    return float(f"{next(k * power for k in NICE if k * power <= time_step * (1 + 1e-9)):.6g}")
