"""PI-D controller of the tip displacement, with feedforward, anti-windup and a start without a jump of the command."""

from __future__ import annotations

import math

import numpy as np

from pliant.control.contract import ControllerKind
from pliant.control.plan import Plan
from pliant.control.steady_inputs import Equilibria, equilibria
from pliant.control.tuning import Limits, PidTuning
from pliant.equations import memory as kernels
from pliant.errors import InputError
from pliant.estimation.adaptive_observer import frozen
from pliant.estimation.contract import State
from pliant.mechanics import mechanics_of
from pliant.mechanics.springs import springs_of
from pliant.model import Model
from pliant.simulation import modes, state

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
            torque = springs_of(self.model).torque(q) + K * more
            mean = float(gain @ torque / (gain @ gain))  # one pressure for all joints: least squares
            wanted = float(np.interp(mean, *self._inverse))
        command = min(max(wanted, 0.0), self.highest)
        self.saturated += command != wanted
        return command


class Pid:
    """PI-D controller within limits of the command: u = feedforward + P e + I int(e) dt - D dy/dt, with error e and
    measurement y.

    At a limit the error is integrated only if that leads away from the limit. `start` sets the first command equal to
    the command that is already applied.

    Parameters
    ----------
    tuning : PidTuning
    limits : Limits
    period : float
        Control period [s].
    """

    def __init__(self, tuning: PidTuning, limits: Limits, period: float) -> None:
        if not (math.isfinite(period) and period > 0):
            raise InputError(f"the control period must be finite and > 0 s, got {period}")
        self.tuning, self.limits, self.period = tuning, limits, period
        self._keep = math.exp(-2 * math.pi * tuning.cutoff * period)
        self.start(0.0)

    def start(self, command: float, target: float = 0.0, measured: float = 0.0, feedforward: float = 0.0) -> None:
        """Initialise the integral so that the next command equals the present `command` [Pa], without a jump."""
        self.command, self.saturated, self._slope = float(command), 0, 0.0
        self._last: float | None = None
        self.integral = command - feedforward - self.tuning.proportional * (target - measured)

    def step(self, target: float, measured: float, feedforward: float = 0.0) -> float:
        """Return the command [Pa] for the next period, from target and measured displacement [m] and the feedforward
        pressure [Pa].
        """
        error = target - measured
        if self._last is not None:
            self._slope = self._keep * self._slope + (1 - self._keep) * (measured - self._last) / self.period
        self._last = measured
        proposed = self.integral + self.tuning.integral * error * self.period
        fixed = feedforward + self.tuning.proportional * error - self.tuning.derivative * self._slope
        wish = fixed + proposed
        command = self.limits(wish, self.command, self.period)
        if command != wish:
            self.saturated += 1
        if (wish - command) * error <= 0.0:
            self.integral = proposed
        self.command = command
        return command


class PidControl:
    """Controller that moves the tip of a one-chamber actuator to set-points by PI-D, with feedforward and shaped (ZVD)
    set-points.

    Parameters
    ----------
    plan : Plan

    Attributes
    ----------
    pid : Pid
    target : float
        Present target of the tip's displacement [m].
    """

    chambers, fault = 1, ""  # a PI-D law always has a command

    def __init__(self, plan: Plan) -> None:
        self.model, self._setpoint = plan.body, plan.setpoint
        self._impulses = [(1.0, 0.0)]
        if plan.task.planned:
            frequency, damping = (float(row[0]) for row in modes(frozen(plan.body, 0.5)))
            self._impulses = impulses(frequency, damping)
        self.pid = Pid(plan.task.pid, plan.limits, plan.period)
        self.forward = Feedforward(plan.body, plan.limits.highest)
        self._still = self.forward.equilibria.tip[0]
        self.reset()

    @property
    def error(self) -> float:
        """Error of the tip's displacement at the last control step [m], measured minus target."""
        return self._moved - self.target

    @property
    def saturated(self) -> int:
        """Number of control steps in which a limit of pressure or slew rate changed the command."""
        return self.pid.saturated

    def reset(self) -> None:
        """Reset the controller to its initial state, in which the commanded pressure is zero."""
        self._moved = self.target = 0.0
        self.pid.start(0.0)
        self.forward.reset()

    def step(self, time: float, state: State, pressure: float | Array) -> Array:
        """Return the command (1,) [Pa] for the next control period, from the link angles of the estimated `state`."""
        del pressure
        self.target = float(sum(a * self._setpoint(time - t) for a, t in self._impulses))
        self._moved = float(np.linalg.norm(mechanics_of(self.model).tips(state.angle)[-1] - self._still))
        feedforward = self.forward.pressure(self.target, self.pid.period)
        return np.array([self.pid.step(self.target, self._moved, feedforward)])


def impulses(frequency: float, damping: float) -> list[tuple[float, float]]:
    """Return three impulses (fraction, time [s]) into which a set-point is split, so that it does not excite a
    vibration mode of undamped `frequency` [Hz] and ratio `damping` (ZVD shaping).

    Source: Singer and Seering, J. Dyn. Sys. Meas. Control 112(1), 1990

    Raises
    ------
    InputError
        When the mode is not oscillatory.
    """
    if not (np.isfinite(frequency) and frequency > 0 and 0 <= damping < 1):
        raise InputError(
            f"a shaped set-point needs a positive frequency (Hz) and a damping ratio in 0 ... 1, got {frequency} and "
            f"{damping}: set planned = false in the task"
        )
    root = np.sqrt(1 - damping**2)
    decay = np.exp(-damping * np.pi / root)
    fractions = np.array([1.0, 2 * decay, decay**2]) / (1 + decay) ** 2
    return [(float(a), k * 0.5 / (frequency * root)) for k, a in enumerate(fractions)]


CONTROLLER = ControllerKind("pid", PidControl, follows="levels", tunable=False, several=False)
