"""Measurement noise of a shape-sensing fibre for learning environments: noisy joint angles with a bias that drifts."""

from __future__ import annotations

import numpy as np

from pliant.model import Model
from pliant.testbed.fibre import FibreSensor

Array = np.ndarray
POINTS = 24  # points per link at which the bias is integrated


class FibreView:
    """Simulated fibre sensor that measures the joint angles of N chains with noise, drifting bias and gain error.

    The sensor is that of the virtual laboratory, `pliant.testbed.fibre.FibreSensor`.

    A joint's angle is the curvature integrated along its link. White noise of the gauges accumulates along the link. A
    bias that is smooth along the fibre varies in time, and a gain error scales the angle. Errors out of the plane, and
    lost frames, are not modelled.

    Parameters
    ----------
    model : Model
    size : int
        Number of chains N.
    period : float
        Time between two frames [s].
    sensor : FibreSensor
    """

    def __init__(self, model: Model, size: int, period: float, sensor: FibreSensor | None = None) -> None:
        self.sensor = sensor or FibreSensor()
        self.model, self.size = model, size
        s, lengths = self.sensor, np.asarray(model.link_length, dtype=float)
        self.white = s.noise * np.sqrt(s.spacing * lengths)  # (n,) rad
        starts = model.base_length + np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
        at = (starts[:, None] + lengths[:, None] * (np.arange(POINTS) + 0.5) / POINTS).ravel()
        alike = s.bias**2 * np.exp(-0.5 * ((at[:, None] - at) / s.bias_length) ** 2)
        sums = np.kron(np.eye(model.n), np.ones(POINTS)) * np.repeat(lengths / POINTS, POINTS)
        values, vectors = np.linalg.eigh(sums @ alike @ sums.T)
        self.root = vectors * np.sqrt(np.maximum(values, 0.0))  # (n, n) rad
        self.keep = float(np.exp(-period / s.bias_time))
        self.gain = np.ones((size, 1))
        self.bias = np.zeros((size, model.n))

    def reset(self, which: Array, rng: np.random.Generator) -> None:
        """Draw a new random gain error and a new random bias for each of M chains, whose indices are `which` (M,)."""
        self.gain[which] = 1.0 + self.sensor.gain_error * rng.standard_normal((len(which), 1))
        self.bias[which] = rng.standard_normal((len(which), self.model.n)) @ self.root.T

    def see(self, angle: Array, rng: np.random.Generator) -> Array:
        """Return the link angles (N, n) [rad] that the fibre measures on N chains with n links, and advance its slowly
        drifting bias by one sample.
        """
        turn = np.diff(angle, axis=1, prepend=self.model.base_angle)
        kick = np.sqrt(1.0 - self.keep**2) * rng.standard_normal(turn.shape) @ self.root.T
        self.bias = self.keep * self.bias + kick
        seen = self.gain * turn + self.bias + self.white * rng.standard_normal(turn.shape)
        return np.asarray(self.model.base_angle + np.cumsum(seen, axis=1))
