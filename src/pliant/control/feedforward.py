"""Feedforward control: the pressure at which the model, with its hysteresis, holds the tip at a target displacement."""

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
    """Static inverse of a model: the pressure that holds a tip displacement, for the present hysteresis states.

    The body is assumed to follow the reference through its equilibria. The hysteresis states, and the torque that they
    add to the springs' torque, are then known at every instant. The torque law is inverted for the sum of both torques.

    Parameters
    ----------
    model : Model
    highest : float
        Highest pressure, Pa.

    Raises
    ------
    InputError
        When the model has gravity, lengthens or moves in space, or its torque law does not rise with pressure.
    """

    def __init__(self, model: Model, highest: float) -> None:
        if model.gravity.any():
            raise InputError(
                "the feedforward does not support gravity, which this model has: use the controller lqr or mpc"
            )
        self.model, self.highest = model, float(highest)
        self.equilibria: Equilibria = equilibria(model, highest)
        self._law = model.memory.law()
        grid = np.linspace(0.0, 1.5 * highest, 400)
        torque = np.asarray(model.torque_at(grid))
        if not np.all(np.diff(torque) > 0):
            raise InputError(
                "the torque law cannot be inverted, since it does not increase up to 1.5 times the highest pressure: "
                "lower the highest pressure"
            )
        self._inverse = (torque, grid)
        self.reset()

    def reset(self) -> None:
        """Reset the hysteresis states to those after a long rest without pressure."""
        self._q = state.equilibrium(self.model, 0.0)
        self._states = state.relaxed(self.model, self._q)
        self.saturated = 0

    def pressure(self, displacement: float, period: float) -> float:
        """Return the pressure [Pa] at which the model's tip is displaced by `displacement` [m] from rest. The stored
        hysteresis states are advanced by `period` [s].

        The pressure is clipped to 0 ... highest, and `saturated` counts how often. For a model without hysteresis it is
        the static inverse.
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
