"""Sampled-data form of a linear model with dead time and zero-order hold, and stability margins of a feedback loop."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pliant.errors import InputError
from pliant.linear.linearisation import LinearModel

Array = np.ndarray
KILO = 1e3  # pressures enter a Riccati equation in kPa, so that its numbers are of one size


class Sampled(NamedTuple):
    """A discrete-time model x[k+1] = A x[k] + B u[k], whose state includes the commands delayed by dead time.

    The delayed commands follow the N states, chamber by chamber, the most recent first; D is the sum of `waiting`.
    """

    A: Array  # (N + D, N + D)
    B: Array  # (N + D, C)
    waiting: tuple[int, ...]  # (C,) number of delayed commands of each chamber


class Margins(NamedTuple):
    """Stability margins of a feedback loop that is opened at the commanded pressure."""

    gain_db: float  # dB, smallest factor above 1 that makes the loop unstable
    phase_deg: float  # degrees
    delay: float  # s, additional dead time that makes the loop unstable
    modulus: float  # smallest distance of the Nyquist curve from -1
    crossover: float  # Hz, the highest frequency of gain 1

    def __str__(self) -> str:
        return (
            f"gain margin {self.gain_db:.1f} dB, phase margin {self.phase_deg:.0f} deg, delay margin "
            f"{self.delay * 1e3:.1f} ms, modulus margin {self.modulus:.2f}, crossover {self.crossover:.1f} Hz"
        )


def least_margins(each: Iterable[Margins]) -> Margins:
    """Return the smallest gain, phase, delay and modulus margin over several loops, and the highest crossover
    frequency.
    """
    gain, phase, delay, modulus, crossover = np.array(list(each)).T
    return Margins(
        float(gain.min()), float(phase.min()), float(delay.min()), float(modulus.min()), float(crossover.max())
    )


@dataclass(frozen=True)
class LoopCurve:
    """The frequency response of an open loop L(i omega), for negative feedback, at `omega` [rad/s]."""

    omega: Array
    value: Array


def sample(linear: LinearModel, period: float, latency: float = 0.0) -> Sampled:
    """Return the discrete-time model for samples every `period` [s] with zero-order hold. The dead times of the valves
    and the additional delay `latency` [s] need not be multiples of the period.

    Raises
    ------
    InputError
        When the period is not positive or the latency negative.
    """
    if not (np.isfinite(period) and period > 0):
        raise InputError(f"period, the time between samples, must be positive and finite, got {period} s")
    if not (np.isfinite(latency) and latency >= 0):
        raise InputError(f"latency, an additional delay, must be finite and not negative, got {latency} s")
    waits = [periods_late(float(late) + latency, period) for late in linear.dead_times]
    N, C, D = linear.A.shape[0], len(waits), sum(most for _, _, most in waits)
    A, B, first = np.zeros((N + D, N + D)), np.zeros((N + D, C)), N
    for c, (whole, part, most) in enumerate(waits):
        Ad, fresh = hold(linear.A, linear.B[:, c], period - part)
        old = np.zeros_like(fresh)
        if part:
            early, old = hold(linear.A, linear.B[:, c], part)
            old, Ad = Ad @ old, Ad @ early
        A[:N, :N] = Ad
        for vector, age in ((fresh, whole), (old, whole + 1)):
            if age == 0:
                B[:N, c] += vector
            elif vector.any():
                A[:N, first + age - 1] += vector
        if most:
            B[first, c] = 1.0
            A[first + 1 : first + most, first : first + most - 1] = np.eye(most - 1)
        first += most
    return Sampled(A, B, tuple(most for _, _, most in waits))


def periods_late(late: float, period: float) -> tuple[int, float, int]:
    """Split a delay `late` [s] into whole sampling periods and a remainder [s]. Also return how many past commands the
    discrete-time model must store because of this delay.
    """
    whole, part = divmod(late, period)
    part = 0.0 if part < 1e-9 * period else part
    if period - part < 1e-9 * period:
        whole, part = whole + 1, 0.0
    return int(whole), part, int(whole) + (part > 0)


def hold(A: Array, B: Array, period: float) -> tuple[Array, Array]:
    """Return exp(A period) and its integral times B, the discrete state and input matrices of a zero-order hold."""
    from scipy.linalg import expm

    N = A.shape[0]
    columns = B.reshape(N, -1)
    block = np.zeros((N + columns.shape[1], N + columns.shape[1]))
    block[:N, :N], block[:N, N:] = A, columns
    exponential = expm(block * period)
    return exponential[:N, :N], exponential[:N, N:].reshape(B.shape)


def loop_curve(plant: Sampled, gain: Array, period: float, points: int = 4000) -> LoopCurve:
    """Return the open-loop frequency response L = gain (z - A)^{-1} B of a state feedback u = -gain x on one input.

    `gain` (N + D,) is that of the feedback, `period` [s] the sampling time. The frequencies run from 0.01 Hz to half
    the sampling rate. A is brought to triangular (Schur) form once; then the states at all frequencies follow by back
    substitution.
    """
    from scipy.linalg import schur

    omega = np.geomspace(2 * np.pi * 0.01, np.pi / period, points)
    T, U = schur(plant.A, output="complex")
    z, b = np.exp(1j * omega * period), U.conj().T @ plant.B[:, 0]
    states = np.empty((b.size, points), dtype=complex)
    for k in reversed(range(b.size)):
        states[k] = (b[k] + T[k, k + 1 :] @ states[k + 1 :]) / (z - T[k, k])
    return LoopCurve(omega, gain @ U @ states)


def margins(curve: LoopCurve) -> Margins:
    """Return the stability margins of a closed loop from its open-loop response up to half the sampling rate."""
    L, omega = curve.value, curve.omega
    phase = np.unwrap(np.angle(L))
    turned = np.mod(phase, 2 * np.pi) - np.pi
    crossings = np.flatnonzero((turned[1:] * turned[:-1] <= 0) & (np.abs(np.diff(turned)) < np.pi))
    crossings = np.append(crossings, [L.size - 1] * bool(L[-1].real < 0))  # ends on the real axis, but for rounding
    factors = [1.0 / abs(L[k]) for k in crossings if abs(L[k]) > 0]
    above = [f for f in factors if f > 1.0]
    gain = 20 * np.log10(min(above)) if above else np.inf
    size = np.log(np.abs(L))
    crossed = np.flatnonzero(size[1:] * size[:-1] <= 0)
    phases = [abs(float(np.angle(-L[k]))) for k in crossed]
    lead = [float(np.mod(phase[k] + np.pi, 2 * np.pi)) / omega[k] for k in crossed]
    return Margins(
        float(gain), float(np.rad2deg(min(phases, default=np.pi))), float(min(lead, default=np.inf)),
        float(np.abs(1 + L).min()), float(omega[crossed[-1]] / (2 * np.pi)) if crossed.size else 0.0,
    )
