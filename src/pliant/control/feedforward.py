"""Feedforward: the pressure at which the model holds a wanted bend, with what it remembers inverted as well."""

from __future__ import annotations

import numpy as np

from pliant.control.equilibria import Equilibria, equilibria
from pliant.equations import memory as kernels
from pliant.errors import InputError
from pliant.mechanics import mechanics_of
from pliant.mechanics.springs import springs_of
from pliant.model import Model
from pliant.simulation import state

Array = np.ndarray


class Feedforward:
    """Static inverse of the model: which pressure holds a tip displacement, now that it has crept and slipped so far.

    The body is taken to follow the wanted path through its rests. Along that path the states of the memory are known at
    every instant, and so is the torque that they ask for beside the springs'; the torque law is inverted for both.

    Parameters
    ----------
    model : Model
    highest : float
        Highest pressure, Pa.

    Raises
    ------
    InputError
        When the model has gravity or swells: its rests are then no multiple of one shape.
    """

    def __init__(self, model: Model, highest: float) -> None:
        if model.gravity.any():
            raise InputError("the feedforward's inverse of the memory takes a model without gravity")
        self.model, self.highest = model, float(highest)
        self.equilibria: Equilibria = equilibria(model, highest)
        self._law = model.memory.law()
        grid = np.linspace(0.0, 1.5 * highest, 400)
        torque = np.asarray(model.torque_at(grid))
        if not np.all(np.diff(torque) > 0):
            raise InputError("the torque law must rise up to one and a half times the highest pressure to be inverted")
        self._inverse = (torque, grid)
        self.reset()

    def reset(self) -> None:
        """Long at rest without pressure."""
        self._q = state.equilibrium(self.model, 0.0)
        self._states = state.relaxed(self.model, self._q)
        self.saturated = 0

    def pressure(self, displacement: float, period: float) -> float:
        """Pressure [Pa] that brings the tip `displacement` [m] from its rest within the next `period` [s].

        Clipped to 0 ... highest; `saturated` counts how often. For a model without memory the inverse of its rests.
        """
        static = self.equilibria.pressure_for(displacement)
        wanted = static
        if self.model.memory:
            q = mechanics_of(self.model).joint_angles(self.equilibria.at(static)[0])
            K = self.model.stiffness
            kernels.remember(self._q, q - self._q, period, K, self._states, self._law)
            self._q = q
            more = np.array([kernels.memory_angle(i, q[i], self._states, self._law) for i in range(self.model.n)])
            gain = self.model.joint_gain
            held = springs_of(self.model).torque(q) + K * more
            mean = float(gain @ held / (gain @ gain))  # one pressure for all joints: least squares
            wanted = float(np.interp(mean, *self._inverse))
        command = min(max(wanted, 0.0), self.highest)
        self.saturated += command != wanted
        return command
