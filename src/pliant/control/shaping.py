"""Input shaping (ZV, ZVD): a command is split into delayed parts whose vibrations cancel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pliant.errors import InputError
from pliant.simulation import Trace

Array = np.ndarray
KINDS = ("ZV", "ZVD")
SAME = 1e-8  # s, offset at which a jump is evaluated on both of its sides


@dataclass(frozen=True)
class Shaper:
    """Impulses with which a command is convolved, so that it does not excite one vibration mode.

    Attributes
    ----------
    time : array (k,)
        Times of the impulses [s], from 0 on.
    amplitude : array (k,)
        Fractions of the command; their sum is 1.
    frequency, damping : float
        Natural frequency [Hz] and damping ratio of the mode to be suppressed.
    """

    time: Array
    amplitude: Array
    frequency: float
    damping: float

    @property
    def delay(self) -> float:
        """Time [s] by which the shaped command ends later than the original one."""
        return float(self.time[-1])

    def __call__(self, time: Array, command: Array) -> Trace:
        """Return the shaped command, for a command given by its corners (a jump is two points at one time).

        Parameters
        ----------
        time, command : array (T,)
            Corners of the command [s, Pa]; it is constant before the first and after the last.
        """
        whole = Trace(time, command)
        corners = np.unique(np.add.outer(whole.breakpoints, self.time).round(9))
        parts = list(zip(self.amplitude, self.time, strict=True))
        before, after = (sum(a * whole(corners - t + side) for a, t in parts) for side in (-SAME, SAME))
        return Trace(np.repeat(corners, 2), np.stack([before, after], axis=1).ravel())

    def residual(self, frequency: float, damping: float | None = None) -> float:
        """Return the residual vibration of a mode at `frequency` [Hz] after shaping, as a fraction of that without
        shaping.

        V = exp(-z w t_k) sqrt(C^2 + S^2), C + i S = sum A_i exp(z w t_i) exp(i w_d t_i).
        Source: Singer and Seering, J. Dyn. Sys. Meas. Control 112(1), 1990
        """
        z = self.damping if damping is None else damping
        omega = 2 * np.pi * frequency
        phase = (z + 1j * np.sqrt(1 - z * z)) * omega
        return float(np.exp(-z * omega * self.delay) * abs(np.sum(self.amplitude * np.exp(phase * self.time))))


def shaper(frequency: float, damping: float, kind: str = "ZV") -> Shaper:
    """Return the impulses that suppress one vibration mode: two (ZV) or three (ZVD, which tolerates a frequency error).

    Parameters
    ----------
    frequency : float
        Undamped natural frequency [Hz] of the mode, e.g. from `pliant.modes`.
    damping : float
        Damping ratio of the mode, below 1.
    kind : {"ZV", "ZVD"}

    Raises
    ------
    InputError
        When the mode is not oscillatory, or the kind is unknown.

    Examples
    --------
    >>> from pliant.control import shaper
    >>> zv = shaper(5.0, 0.078, "ZV")
    >>> round(zv.residual(5.5), 2)
    0.14
    """
    if kind not in KINDS:
        raise InputError(f"unknown shaper {kind!r}: use one of {', '.join(KINDS)}")
    if not (np.isfinite(frequency) and frequency > 0 and 0 <= damping < 1):
        raise InputError(
            f"a shaper needs a positive frequency (Hz) and a damping ratio in 0 ... 1, got {frequency} and {damping}: "
            "an overdamped mode needs no shaper"
        )
    root = np.sqrt(1 - damping**2)
    half = 0.5 / (frequency * root)
    decay = np.exp(-damping * np.pi / root)
    row = np.array([1.0, decay]) if kind == "ZV" else np.array([1.0, 2 * decay, decay**2])
    return Shaper(half * np.arange(row.size), row / row.sum(), float(frequency), float(damping))
