"""The common problem of all methods: the paper's pulse of 119 kPa, 4 s, five links, all tips every 10 ms."""

from __future__ import annotations

import numpy as np

from pliant.actuators import chen2018
from pliant.model import Model
from pliant.simulation import Pulse

Array = np.ndarray
DURATION = 4.0  # s
BETWEEN = 0.01  # s, between outputs; the edges of the pulse are outputs
TARGET_MM = 0.02


class Problem:
    """The pulse, and the error of a solution relative to the reference."""

    def __init__(self, links: int = 5) -> None:
        self.model: Model = chen2018.model(links=links)
        self.pressure = Pulse(chen2018.PULSE_PRESSURE, chen2018.PULSE_START, chen2018.PULSE_WIDTH)
        self.times = np.round(np.arange(round(DURATION / BETWEEN) + 1) * BETWEEN, 9)
        self.torque = float(self.model.torque_at(chen2018.PULSE_PRESSURE))
        self.truth = np.zeros((0, links, 2))  # tips (T, n, 2), m: see `methods.solved`

    @property
    def pieces(self) -> list[tuple[Array, float]]:
        """Return output times between the edges of the pulse, both ends included, with the torque [N m] there."""
        rise, fall = np.searchsorted(self.times, np.round(self.pressure.jumps, 9))
        return [
            (self.times[: rise + 1], 0.0), (self.times[rise : fall + 1], self.torque), (self.times[fall:], 0.0),
        ]

    def error_mm(self, tips: Array) -> float:
        """Return the largest distance of any tip at any time from the reference, mm."""
        return 1e3 * float(np.linalg.norm(tips - self.truth, axis=-1).max())

    def tips(self, q: Array) -> Array:
        """Return tips (T, n, 2) of joint angles (T, n) from the base, m."""
        phi = np.cumsum(q, axis=-1)
        l = self.model.link_length
        return np.stack([-np.cumsum(l * np.sin(phi), axis=-1), np.cumsum(l * np.cos(phi), axis=-1)], axis=-1)
